/** What is drawn over the picture: outlines, regions, likely rectangles. */

import { blank } from "../canvas";
import { CORNER_NAMES } from "../geometry";
import type { Corners, Point, Surface } from "../model";
import type { Studio } from "../studio";
import { colour } from "../theme";
import type { StageView } from "./view";

export class Overlay {
  readonly element = document.createElement("canvas");
  private context = this.element.getContext("2d")!;

  constructor(
    private readonly studio: Studio,
    private readonly view: StageView,
  ) {
    this.element.className = "overlay";
    this.element.setAttribute("aria-hidden", "true");
  }

  /** @param frame that is on the stage. @param pointer where a corner would be placed, frame px. */
  draw(frame: number, pointer: Point | null): void {
    const { studio, view } = this;
    const ratio = devicePixelRatio;
    blank(this.element, view.width * ratio, view.height * ratio).scale(ratio, ratio);
    if (studio.view === "steady" || studio.step === "finish" || studio.step === "look") return;
    if (studio.view === "frame") {
      studio.project.surfaces.forEach((surface, i) => this.surface(surface, i, frame));
      this.proposals();
    }
    this.unfinished(pointer);
    if (studio.ghost) this.ring(studio.ghost, 7, colour("accent"), 2);
  }

  private surface(surface: Surface, index: number, frame: number): void {
    const { studio } = this;
    const selected = index === studio.selected;
    const track = studio.tracks.of(surface);
    const keyframe = surface.keyframes.find((k) => k.frame === frame);
    const corners =
      frame === surface.start && !studio.isBusy ? surface.quad : (keyframe?.corners ?? track?.corners[frame] ?? null);
    if (frame === surface.start) this.regions(surface, selected);
    if (!corners) return;
    const found = track?.corners[frame];
    if (selected && keyframe && found && frame !== surface.start) this.outline(found, colour("other"), 1.25, [5, 4]);
    const held = frame !== surface.start && track?.states[frame] === "h";
    const lost = frame !== surface.start && track?.states[frame] === "l";
    const style = !selected ? "other" : lost ? "lost" : held ? "held" : "mark";
    this.outline(corners, colour(style), selected ? 2 : 1.25, held || lost ? [7, 5] : []);
    if (selected && !studio.surface?.ad) this.order(corners);
    if (!selected || studio.project.surfaces.length > 1) this.label(corners[0], `${index + 1}`);
  }

  private regions(surface: Surface, selected: boolean): void {
    if (!selected) return;
    if (surface.region) this.outline(surface.region, colour("accent"), 1.5, [3, 4]);
    for (const polygon of surface.exclude) {
      this.outline(polygon, colour("lost"), 1.5, [3, 4]);
      this.hatch(polygon);
    }
  }

  private proposals(): void {
    this.studio.shownProposals.forEach((proposal, i) => {
      const hot = this.studio.hot === i;
      this.outline(proposal.corners, colour(hot ? "mark" : "other"), hot ? 3 : 1.5, hot ? [] : [6, 5]);
    });
  }

  /** Corners and polygons that are being clicked. */
  private unfinished(pointer: Point | null): void {
    const { studio } = this;
    const points = studio.tool === "corners" ? studio.placing : studio.polygon;
    const open = pointer && (studio.isPlacing || studio.tool !== "corners") ? [...points, pointer] : points;
    if (open.length > 1) this.outline(open, colour("mark"), 1.5, [], open.length > 2 && studio.tool !== "corners");
    points.forEach((p) => this.ring(p, 5, colour("mark"), 2));
  }

  private path(points: Corners, closed = true): void {
    this.context.beginPath();
    points.forEach((p, i) => this.context[i ? "lineTo" : "moveTo"](...this.view.toStage(p)));
    if (closed && points.length > 2) this.context.closePath();
  }

  private outline(points: Corners, style: string, width: number, dash: number[], closed = true): void {
    const { context } = this;
    this.path(points, closed);
    context.setLineDash(dash);
    context.strokeStyle = "#0009";
    context.lineWidth = width + 2;
    context.stroke();
    context.strokeStyle = style;
    context.lineWidth = width;
    context.stroke();
    context.setLineDash([]);
  }

  private hatch(polygon: Corners): void {
    const { context, view } = this;
    context.save();
    this.path(polygon);
    context.clip();
    context.strokeStyle = colour("lost");
    context.lineWidth = 1;
    context.beginPath();
    for (let x = -view.height; x < view.width; x += 9) {
      context.moveTo(x, view.height);
      context.lineTo(x + view.height, 0);
    }
    context.stroke();
    context.restore();
  }

  /** Without an ad to see, the names of the corners tell which way up it will be. */
  private order(corners: Corners): void {
    if (this.studio.dragging) return;
    const { context } = this;
    const centre: Point = [corners.reduce((s, p) => s + p[0], 0) / 4, corners.reduce((s, p) => s + p[1], 0) / 4];
    context.font = `12px ${colour("letters")}`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    corners.forEach((p, i) => {
      const [x, y] = this.view.toStage([p[0] + (centre[0] - p[0]) * 0.22, p[1] + (centre[1] - p[1]) * 0.16]);
      const width = context.measureText(CORNER_NAMES[i]).width + 10;
      context.fillStyle = "#000a";
      context.fillRect(x - width / 2, y - 10, width, 20);
      context.fillStyle = "#fff";
      context.fillText(CORNER_NAMES[i], x, y + 1);
    });
  }

  private label(at: Point, text: string): void {
    const { context } = this;
    const [x, y] = this.view.toStage(at);
    context.font = `600 12px ${colour("letters")}`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillStyle = "#000b";
    context.fillRect(x - 10, y - 26, 20, 18);
    context.fillStyle = "#fff";
    context.fillText(text, x, y - 16.5);
  }

  private ring(at: Point, radius: number, style: string, width: number): void {
    const { context } = this;
    const [x, y] = this.view.toStage(at);
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.strokeStyle = "#000b";
    context.lineWidth = width + 2;
    context.stroke();
    context.strokeStyle = style;
    context.lineWidth = width;
    context.stroke();
  }
}
