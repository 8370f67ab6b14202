/** The picture with its handles, and what the pointer does on it. */

import { blank } from "../canvas";
import { CORNER_NAMES, unitToQuad } from "../geometry";
import type { Corners, Point } from "../model";
import type { Pictures } from "../pictures";
import type { Studio } from "../studio";
import { AdPicture } from "./ad";
import { Loupe } from "./loupe";
import { Overlay } from "./overlay";
import { StageView } from "./view";

const BADGE = 42; // CSS px from one badge to the next
const CLICK = 5; // CSS px that a click may move
const CLOSE = 14; // CSS px from a polygon's first corner that closes it

type Gesture =
  | { kind: "pan"; from: Point; moved: boolean }
  | { kind: "place" }
  | { kind: "wipe" }
  | { kind: "vertex"; index: number; merge: string }
  | { kind: "corner"; index: number; offset: Point; merge: string; free: boolean; moved: boolean }
  | { kind: "pinch"; distance: number; middle: Point };

export class Stage {
  readonly element = document.createElement("div");
  /** Called with the frame that was drawn, whenever there is a new one. */
  onDrawn: (frame: number) => void = () => undefined;
  private readonly view = new StageView();
  private readonly canvas = document.createElement("canvas");
  private readonly ads: AdPicture[] = [];
  private readonly adLayer = document.createElement("div");
  private readonly overlay: Overlay;
  private readonly loupe = new Loupe();
  private readonly handles: HTMLButtonElement[];
  private readonly badges: HTMLButtonElement[] = [];
  private readonly vertices: HTMLButtonElement[] = [];
  private readonly dots: HTMLButtonElement[] = [];
  private readonly divider = document.createElement("div");
  private readonly late = document.createElement("p");
  /** The picture that is shown, and the one without ads beside it: copies, since the cache drops its own. */
  private readonly main = document.createElement("canvas");
  private readonly before = document.createElement("canvas");
  private shown = { frame: -1, source: null as Pictures | null };
  private beforeFrame = -1;
  private readonly pointers = new Map<number, Point>();
  private gesture: Gesture | null = null;
  private hover: Point | null = null;
  private gestures = 0;

  constructor(private readonly studio: Studio) {
    this.overlay = new Overlay(studio, this.view);
    this.element.className = "stage";
    this.canvas.className = "picture";
    this.canvas.setAttribute("role", "img");
    this.adLayer.className = "ads";
    this.handles = CORNER_NAMES.map((name, i) => this.handle(name, i));
    this.divider.className = "divider";
    this.divider.tabIndex = 0;
    this.divider.setAttribute("role", "slider");
    this.divider.setAttribute("aria-label", "Before and after");
    this.divider.setAttribute("aria-valuemin", "0");
    this.divider.setAttribute("aria-valuemax", "100");
    this.divider.addEventListener("keydown", (event) => this.wipeByKey(event));
    const parts = [this.canvas, this.adLayer, this.overlay.element, ...this.handles, this.divider, this.loupe.element, this.late];
    this.late.className = "late";
    this.late.hidden = true;
    this.element.append(...parts);
    this.element.addEventListener("pointerdown", (event) => this.down(event));
    this.element.addEventListener("pointermove", (event) => this.move(event));
    this.element.addEventListener("pointerup", (event) => this.up(event));
    this.element.addEventListener("pointercancel", (event) => this.cancel(event));
    this.element.addEventListener("pointerleave", () => this.hovered(null));
    this.element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    new ResizeObserver(() => this.resized()).observe(this.element);
  }

  zoom(factor: number): void {
    this.view.zoomAt([this.view.width / 2, this.view.height / 2], factor);
    this.studio.changed();
  }

  fit(): void {
    this.view.fit();
    this.studio.changed();
  }

  get isZoomed(): boolean {
    return this.view.isZoomed;
  }

  /** Draws the studio's state. */
  update(): void {
    const { studio } = this;
    const source = this.source();
    this.fetch(source);
    const { width, height } = studio.video;
    const steady = studio.view === "steady" && this.shown.frame >= 0 && this.main.width > 0;
    this.view.content = steady ? [this.main.width, this.main.height] : [width, height];
    this.drawPicture();
    this.drawAds();
    this.placeHandles();
    this.placeVertices();
    this.placeBadges();
    this.placeDivider();
    const placing = studio.isPlacing || studio.tool !== "corners";
    this.overlay.draw(this.shown.frame, placing ? this.hover : null);
    this.drawLoupe();
    this.element.classList.toggle("placing", placing);
  }

  private source(): Pictures {
    const { sources, view, surface, project, selected } = this.studio;
    if (view === "steady" && surface?.track) return sources.steady(selected, surface.track.id);
    if (view === "composite" || view === "wipe") return sources.composites(project.revision);
    return this.view.isZoomed ? sources.full() : sources.frames();
  }

  private fetch(source: Pictures): void {
    const { studio } = this;
    const { sources, frame } = studio;
    const [still, playing] = { frame: [this.view.isZoomed ? 0 : 4, 10], wipe: [0, 8], composite: [0, 8], steady: [2, 8] }[studio.view];
    sources.want(source, frame, studio.isPlaying ? playing : still);
    const picture = source.get(frame);
    if (picture && (this.shown.frame !== frame || this.shown.source !== source)) {
      copy(picture, this.main);
      this.shown = { frame, source };
      this.canvas.dataset.frame = `${frame}`;
      this.canvas.setAttribute("aria-label", `Frame ${frame} of ${studio.video.name}`);
      this.onDrawn(frame);
    }
    this.standIn(source, frame);
    if (this.shown.source === source) this.canvas.dataset.view = studio.view;
    if (studio.view !== "wipe") return;
    const plain = sources.frames();
    sources.want(plain, this.shown.frame >= 0 ? this.shown.frame : frame, studio.isPlaying ? 8 : 0);
    const other = plain.get(this.shown.frame);
    if (other && this.beforeFrame !== this.shown.frame) {
      copy(other, this.before);
      this.beforeFrame = this.shown.frame;
    }
  }

  /** Until a frame is here the nearest that is known is shown, and said to be that. */
  private standIn(source: Pictures, frame: number): void {
    const { shown, canvas } = this;
    const near = shown.frame === frame ? null : source.near(frame);
    if (near && Math.abs(near.frame - frame) < Math.abs(shown.frame - frame)) {
      copy(near.picture, this.main);
      this.shown = { frame: near.frame, source };
      canvas.dataset.frame = `${near.frame}`;
      canvas.setAttribute("aria-label", `Frame ${near.frame} of ${this.studio.video.name}, until frame ${frame} is here`);
    }
    this.late.hidden = this.shown.frame === frame || this.shown.frame < 0 || this.studio.isPlaying;
    this.late.textContent = `Frame ${this.shown.frame}, until ${frame} is here`;
  }

  private drawPicture(): void {
    const { view, canvas } = this;
    const ratio = devicePixelRatio;
    const context = blank(canvas, view.width * ratio, view.height * ratio);
    if (!this.main.width || this.shown.frame < 0) return;
    const [x, y] = view.origin;
    const [w, h] = [view.content[0] * view.scale, view.content[1] * view.scale];
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.imageSmoothingEnabled = view.scale < 4;
    context.imageSmoothingQuality = view.scale * view.content[0] * ratio < 0.6 * this.main.width ? "high" : "low";
    context.drawImage(this.main, x, y, w, h);
    if (this.studio.view === "wipe" && this.beforeFrame === this.shown.frame) {
      context.save();
      context.beginPath();
      context.rect(0, 0, this.dividerAt, view.height);
      context.clip();
      context.drawImage(this.before, x, y, w, h);
      context.restore();
    }
  }

  private get dividerAt(): number {
    const [x] = this.view.origin;
    const at = x + this.studio.wipe * this.view.content[0] * this.view.scale;
    return Math.max(0, Math.min(this.view.width, at));
  }

  private drawAds(): void {
    const { studio } = this;
    const surfaces = studio.project.surfaces;
    while (this.ads.length < surfaces.length) {
      const ad = new AdPicture(() => studio.changed());
      this.ads.push(ad);
      this.adLayer.append(ad.element);
    }
    const { width, height } = studio.video;
    this.ads.forEach((ad, i) => {
      const surface = surfaces[i];
      const marked = studio.step === "mark" && studio.view === "frame" && studio.tool === "corners";
      const here = surface?.quad && marked && surface.start === this.shown.frame;
      if (!here) return ad.hide();
      ad.show(surface, surface.quad!, [width, height], this.view, studio.dragging && i === studio.selected);
    });
  }

  // Handles

  private handle(name: string, index: number): HTMLButtonElement {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "corner";
    button.dataset.name = name;
    button.addEventListener("focus", () => {
      this.studio.corner = index;
      this.studio.changed();
    });
    button.addEventListener("blur", () => {
      this.studio.corner = null;
      this.studio.changed();
    });
    button.addEventListener("keydown", (event) => {
      const by = arrow(event);
      if (!by || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      event.stopPropagation();
      this.studio.nudge(index, by[0], by[1]);
    });
    return button;
  }

  private placeHandles(): void {
    const corners = this.shown.frame === this.studio.frame ? this.studio.handles : null;
    this.handles.forEach((button, i) => {
      button.hidden = !corners;
      if (!corners) return;
      const [x, y] = this.view.toStage(corners[i]);
      button.style.transform = `translate(${x}px, ${y}px)`;
      button.classList.toggle("active", this.studio.corner === i);
      const at = `x ${corners[i][0].toFixed(1)}, y ${corners[i][1].toFixed(1)}`;
      button.setAttribute("aria-label", `Corner ${button.dataset.name}, ${at}; arrow keys move it by 0.1 pixels`);
    });
  }

  /** A polygon's corners, and dots between them that make others. */
  private placeVertices(): void {
    const points = (this.shown.frame === this.studio.frame && this.studio.vertices) || [];
    while (this.vertices.length < points.length) {
      const index = this.vertices.length;
      this.vertices.push(this.vertex("vertex", (event) => this.vertexByKey(index, event)));
      const dot = this.vertex("between", () => undefined);
      // A pointer has made the corner already, as it went down.
      dot.addEventListener("click", (event) => {
        if (event.detail === 0) this.studio.splitEdge(index);
      });
      this.dots.push(dot);
    }
    this.vertices.forEach((button, i) => {
      const dot = this.dots[i];
      button.hidden = dot.hidden = i >= points.length;
      if (button.hidden) return;
      const [[x, y], [nextX, nextY]] = [points[i], points[(i + 1) % points.length]].map((p) => this.view.toStage(p));
      button.style.transform = `translate(${x}px, ${y}px)`;
      dot.style.transform = `translate(${(x + nextX) / 2}px, ${(y + nextY) / 2}px)`;
      button.setAttribute("aria-label", `Corner ${i + 1} of ${points.length}; arrow keys move it, Delete removes it`);
      dot.setAttribute("aria-label", `Another corner after ${i + 1}`);
    });
  }

  private vertex(name: string, key: (event: KeyboardEvent) => void): HTMLButtonElement {
    const button = document.createElement("button");
    button.type = "button";
    button.className = name;
    button.addEventListener("keydown", key);
    this.element.insertBefore(button, this.divider);
    return button;
  }

  private vertexByKey(index: number, event: KeyboardEvent): void {
    const by = arrow(event);
    const at = this.studio.vertices?.[index];
    if (!at || event.ctrlKey || event.metaKey) return;
    if (by) this.studio.moveVertex(index, [at[0] + by[0], at[1] + by[1]], `vertex-${index}`);
    else if (event.key === "Delete" || event.key === "Backspace") this.studio.removeVertex(index);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  private placeBadges(): void {
    const { studio } = this;
    const shown = studio.shownProposals;
    while (this.badges.length < shown.length) {
      const index = this.badges.length;
      const button = document.createElement("button");
      button.type = "button";
      button.className = "badge";
      button.textContent = `${index + 1}`;
      button.setAttribute("aria-label", `Take likely rectangle ${index + 1}`);
      const heat = (hot: number | null) => () => {
        studio.hot = hot;
        studio.changed();
      };
      button.addEventListener("pointerenter", heat(index));
      button.addEventListener("pointerleave", heat(null));
      button.addEventListener("focus", heat(index));
      button.addEventListener("blur", heat(null));
      button.addEventListener("click", () => void studio.mark(studio.proposals[index].corners));
      this.badges.push(button);
      this.element.insertBefore(button, this.divider);
    }
    const places = apart(shown.map((proposal) => proposal.corners.map((p) => this.view.toStage(p))));
    this.badges.forEach((button, i) => {
      button.hidden = i >= shown.length;
      if (button.hidden) return;
      const [x, y] = places[i];
      button.style.transform = `translate(${x}px, ${y}px)`;
    });
  }

  private placeDivider(): void {
    const wiping = this.studio.view === "wipe" && this.shown.frame >= 0;
    this.divider.hidden = !wiping;
    this.divider.style.transform = `translateX(${this.dividerAt}px)`;
    this.divider.setAttribute("aria-valuenow", `${Math.round(this.studio.wipe * 100)}`);
  }

  private wipeByKey(event: KeyboardEvent): void {
    const by = { ArrowLeft: -0.02, ArrowRight: 0.02, Home: -1, End: 1 }[event.key];
    if (!by) return;
    event.preventDefault();
    event.stopPropagation();
    this.studio.wipe = Math.max(0, Math.min(1, this.studio.wipe + by));
    this.studio.changed();
  }

  // The loupe

  private drawLoupe(): void {
    const { studio } = this;
    const corners = studio.handles;
    const corner = studio.corner !== null && corners ? corners[studio.corner] : null;
    const placing = studio.isPlacing || studio.tool !== "corners";
    const at = corner ?? (placing ? this.hover : null);
    if (!at || this.shown.frame !== studio.frame || studio.view !== "frame") return this.loupe.hide();
    const full = studio.sources.full();
    if (full !== this.shown.source) studio.sources.want(full, studio.frame, 0);
    const picture = full.get(studio.frame) ?? this.main;
    const lines: Corners = corner ? corners! : [...(studio.tool === "corners" ? studio.placing : studio.polygon), at];
    this.loupe.show(picture, studio.video.width, at, lines, this.view.toStage(at)[0] > this.view.width / 2);
  }

  // The pointer

  private at(event: PointerEvent | WheelEvent): Point {
    const box = this.element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  private down(event: PointerEvent): void {
    const target = event.target as HTMLElement;
    if (target.classList.contains("badge")) return;
    const at = this.at(event);
    this.pointers.set(event.pointerId, at);
    this.element.setPointerCapture(event.pointerId);
    const { studio } = this;
    if (this.pointers.size === 2) {
      const [a, b] = [...this.pointers.values()];
      this.gesture = { kind: "pinch", distance: Math.hypot(a[0] - b[0], a[1] - b[1]), middle: middle(a, b) };
      studio.dragging = false;
      this.hover = null;
      return studio.changed();
    }
    const corner = this.handles.indexOf(target as HTMLButtonElement);
    if (corner >= 0 && studio.handles) {
      event.preventDefault();
      target.focus();
      const [x, y] = this.view.toStage(studio.handles[corner]);
      const offset: Point = [x - at[0], y - at[1]];
      const merge = `drag-${++this.gestures}`;
      this.gesture = { kind: "corner", index: corner, offset, merge, free: event.altKey, moved: false };
    } else if (this.vertices.includes(target as HTMLButtonElement) || this.dots.includes(target as HTMLButtonElement)) {
      event.preventDefault();
      const dot = this.dots.indexOf(target as HTMLButtonElement);
      const index = dot < 0 ? this.vertices.indexOf(target as HTMLButtonElement) : dot + 1;
      const merge = `vertex-${++this.gestures}`;
      if (dot >= 0) studio.splitEdge(dot, merge);
      this.placeVertices();
      this.vertices[index]?.focus();
      this.gesture = { kind: "vertex", index, merge };
    } else if (target === this.divider) this.gesture = { kind: "wipe" };
    else if (event.button === 0 && !event.shiftKey && (studio.isPlacing || studio.tool !== "corners")) {
      this.gesture = { kind: "place" };
      this.hover = this.view.toFrame(at);
    } else this.gesture = { kind: "pan", from: at, moved: false };
    studio.changed();
  }

  private move(event: PointerEvent): void {
    const at = this.at(event);
    const before = this.pointers.get(event.pointerId);
    if (!before || !this.gesture) {
      const onBadge = (event.target as HTMLElement).classList.contains("badge");
      if (event.pointerType === "mouse") this.hovered(onBadge ? null : this.view.toFrame(at));
      return;
    }
    this.pointers.set(event.pointerId, at);
    const { gesture, studio } = this;
    if (gesture.kind === "pinch") this.pinch(gesture);
    else if (gesture.kind === "pan") {
      gesture.moved ||= Math.hypot(at[0] - gesture.from[0], at[1] - gesture.from[1]) > CLICK;
      if (gesture.moved) this.view.pan(at[0] - before[0], at[1] - before[1]);
    } else if (gesture.kind === "place") this.hover = this.view.toFrame(at);
    else if (gesture.kind === "vertex") studio.moveVertex(gesture.index, this.view.toFrame(at), gesture.merge);
    else if (gesture.kind === "wipe") {
      const [x] = this.view.origin;
      studio.wipe = Math.max(0, Math.min(1, (at[0] - x) / (this.view.content[0] * this.view.scale)));
    } else {
      gesture.free = event.altKey;
      gesture.moved = true;
      studio.dragging = true;
      const to = this.view.toFrame([at[0] + gesture.offset[0], at[1] + gesture.offset[1]]);
      studio.moveCorner(gesture.index, to, gesture.merge);
      if (gesture.free) studio.ghost = null;
      else void studio.look(gesture.index);
    }
    studio.changed();
  }

  private up(event: PointerEvent): void {
    const at = this.at(event);
    const { gesture, studio } = this;
    this.pointers.delete(event.pointerId);
    if (this.pointers.size) return;
    this.gesture = null;
    if (gesture?.kind === "place") this.place(this.view.toFrame(at));
    if (gesture?.kind === "corner" && gesture.moved) {
      if (gesture.free) {
        studio.dragging = false;
        studio.nudge(gesture.index, 0, 0);
      } else void studio.release(gesture.index, gesture.merge);
    }
    if (event.pointerType !== "mouse") this.hover = null;
    studio.changed();
  }

  private cancel(event: PointerEvent): void {
    this.pointers.delete(event.pointerId);
    this.gesture = null;
    this.hover = null;
    this.studio.dragging = false;
    this.studio.changed();
  }

  private place(point: Point): void {
    const { studio } = this;
    const inside: Point = [
      Math.max(-0.5, Math.min(studio.video.width - 0.5, point[0])),
      Math.max(-0.5, Math.min(studio.video.height - 0.5, point[1])),
    ];
    if (studio.tool === "corners") return studio.place(inside);
    const [first] = studio.polygon;
    if (first && studio.polygon.length > 2) {
      const [a, b] = [this.view.toStage(first), this.view.toStage(inside)];
      if (Math.hypot(a[0] - b[0], a[1] - b[1]) < CLOSE) return studio.closePolygon();
    }
    studio.addVertex(inside);
  }

  private pinch(gesture: { distance: number; middle: Point }): void {
    const [a, b] = [...this.pointers.values()];
    const distance = Math.hypot(a[0] - b[0], a[1] - b[1]);
    const to = middle(a, b);
    this.view.pan(to[0] - gesture.middle[0], to[1] - gesture.middle[1]);
    this.view.zoomAt(to, distance / gesture.distance);
    [gesture.distance, gesture.middle] = [distance, to];
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    this.view.zoomAt(this.at(event), Math.exp(-event.deltaY * (event.ctrlKey ? 0.01 : 0.0015)));
    this.studio.changed();
  }

  private hovered(point: Point | null): void {
    this.hover = point;
    if (this.studio.isPlacing || this.studio.tool !== "corners") this.studio.changed();
  }

  private resized(): void {
    this.view.width = this.element.clientWidth;
    this.view.height = this.element.clientHeight;
    this.studio.sources.stageHeight = this.view.height * devicePixelRatio;
    this.studio.changed();
  }
}

/** How far an arrow key moves a corner, px; null for other keys. */
function arrow(event: KeyboardEvent): Point | null {
  const step = event.shiftKey ? 1 : 0.1;
  const ways: Record<string, Point> = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
  return ways[event.key] ?? null;
}

const middle = (a: Point, b: Point): Point => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];

/** A place in each quad, CSS px, far enough from the others': its middle where that is free. */
function apart(quads: Corners[]): Point[] {
  const taken: Point[] = [];
  const shares = [0.5, 0.25, 0.75, 0.12, 0.88];
  for (const quad of quads) {
    const m = unitToQuad(quad);
    const place = (u: number, v: number): Point => {
      const w = m[6] * u + m[7] * v + 1;
      return [(m[0] * u + m[1] * v + m[2]) / w, (m[3] * u + m[4] * v + m[5]) / w];
    };
    const places = shares.flatMap((v) => shares.map((u) => place(u, v)));
    taken.push(places.find(([x, y]) => taken.every((t) => Math.hypot(x - t[0], y - t[1]) > BADGE)) ?? places[0]);
  }
  return taken;
}

function copy(picture: ImageBitmap, canvas: HTMLCanvasElement): void {
  blank(canvas, picture.width, picture.height).drawImage(picture, 0, 0);
}
