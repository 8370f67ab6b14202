/** The whole video in a strip: thumbnails, states, confidence and deviation, cuts, keyframes, and where we are. */

import type { ProjectApi } from "./api";
import { blank } from "./canvas";
import type { Track } from "./model";
import { Pictures } from "./pictures";
import type { Studio } from "./studio";
import { colour } from "./theme";
import { frameInWords } from "./words";

const THUMBS = 40; // CSS px, heights of the rows
const STATES = 9;
const CURVES = 36;
const GAP = 3;
const RENEW_MS = 1500; // after which thumbnails of frames nearby are asked for again
const DEVIATION = 8; // px of deviation at the top of its curve

export class TimeLine {
  readonly element = document.createElement("div");
  private readonly canvas = document.createElement("canvas");
  private readonly thumbnails: Pictures;
  /** All but the playhead, which alone moves while one scrubs. */
  private readonly still = document.createElement("canvas");
  private width = 0;
  private drawn = "";
  private renewing = 0;

  constructor(
    private readonly studio: Studio,
    api: ProjectApi,
  ) {
    this.element.className = "timeline";
    this.element.tabIndex = 0;
    this.element.setAttribute("role", "slider");
    this.element.setAttribute("aria-label", "Frame");
    this.element.append(this.canvas);
    this.thumbnails = new Pictures(
      (i) => api.roughly(i, 2 * THUMBS),
      () => {
        this.drawn = "";
        this.draw();
      },
      1,
      true,
    );
    const scrub = (event: PointerEvent) => {
      if (!(event.buttons & 1)) return;
      const box = this.canvas.getBoundingClientRect();
      studio.following = false;
      studio.seek(Math.floor(((event.clientX - box.left) / box.width) * studio.video.frames));
    };
    this.element.addEventListener("pointerdown", (event) => {
      this.element.setPointerCapture(event.pointerId);
      scrub(event);
    });
    this.element.addEventListener("pointermove", scrub);
    new ResizeObserver(() => {
      this.width = this.element.clientWidth;
      this.drawn = "";
      this.draw();
    }).observe(this.element);
  }

  update(): void {
    const { video, frame, surface, tracks } = this.studio;
    const track = surface ? tracks.of(surface) : null;
    this.element.setAttribute("aria-valuemin", "0");
    this.element.setAttribute("aria-valuemax", `${video.frames - 1}`);
    this.element.setAttribute("aria-valuenow", `${frame}`);
    this.element.setAttribute("aria-valuetext", frameInWords(video, frame, track));
    this.draw();
  }

  /** Colours changed. */
  repaint(): void {
    this.drawn = "";
    this.draw();
  }

  private x = (frame: number) => (frame / this.studio.video.frames) * this.width;

  private draw(): void {
    const { studio, canvas, width } = this;
    const { surface, tracks } = studio;
    if (!width) return;
    const ratio = devicePixelRatio;
    const size = [width * ratio, (THUMBS + STATES + CURVES + 2 * GAP) * ratio] as const;
    const keyframes = surface?.keyframes.map((k) => k.frame).join() ?? "";
    const state = [surface?.key, surface?.start, !!surface?.quad, keyframes, tracks.version].join(" ");
    if (this.drawn !== state) {
      this.drawn = state;
      const context = blank(this.still, ...size);
      context.scale(ratio, ratio);
      this.drawStill(context);
    }
    const context = blank(canvas, ...size);
    context.drawImage(this.still, 0, 0);
    context.scale(ratio, ratio);
    this.playhead(context);
  }

  private drawStill(context: CanvasRenderingContext2D): void {
    const { surface, tracks } = this.studio;
    this.strip(context);
    const track = surface ? tracks.of(surface) : null;
    if (track) {
      this.states(context, track, THUMBS + GAP);
      this.curves(context, track, THUMBS + STATES + 2 * GAP);
      for (const cut of track.cuts) this.line(context, this.x(cut), colour("text"), [2, 3]);
    } else {
      context.fillStyle = colour("line");
      context.fillRect(0, THUMBS + GAP, this.width, STATES);
    }
    if (surface?.quad) this.diamond(context, surface.start, colour("accent"), true);
    for (const { frame } of surface?.keyframes ?? []) this.diamond(context, frame, colour("key"), false);
  }

  private strip(context: CanvasRenderingContext2D): void {
    const { video } = this.studio;
    const wide = Math.max(24, (THUMBS * video.width) / video.height);
    const count = Math.ceil(this.width / wide);
    const wanted: number[] = [];
    const rough: number[] = [];
    const span = video.frames / count;
    context.save();
    context.beginPath();
    context.roundRect(0, 0, this.width, THUMBS, 4);
    context.clip();
    context.fillStyle = colour("stage");
    context.fillRect(0, 0, this.width, THUMBS);
    for (let i = 0; i < count; i++) {
      const frame = Math.min(video.frames - 1, Math.floor((((i + 0.5) * wide) / this.width) * video.frames));
      const picture = this.thumbnails.get(frame);
      if (picture) context.drawImage(picture, i * wide, 0, wide, THUMBS);
      else wanted.push(frame);
      if (picture && Math.abs(this.thumbnails.actual(frame) - frame) > span / 2) rough.push(frame);
    }
    context.restore();
    if (wanted.length) this.thumbnails.want(wanted);
    clearTimeout(this.renewing);
    if (rough.length) this.renewing = window.setTimeout(() => this.thumbnails.renew(rough), RENEW_MS);
  }

  private states(context: CanvasRenderingContext2D, track: Track, top: number): void {
    context.fillStyle = colour("line");
    context.fillRect(0, top, this.width, STATES);
    // Heights tell states apart as well as colours do.
    const look = { t: ["tracked", 1], h: ["held", 0.6], l: ["lost", 0.3] } as const;
    for (let first = 0; first < track.states.length; ) {
      const letter = track.states[first] as keyof typeof look;
      let end = first + 1;
      while (end < track.states.length && track.states[end] === letter) end++;
      if (look[letter]) {
        const [name, share] = look[letter];
        context.fillStyle = colour(name);
        context.fillRect(this.x(first), top + STATES * (1 - share), Math.max(1, this.x(end) - this.x(first)), STATES * share);
      }
      first = end;
    }
  }

  private curves(context: CanvasRenderingContext2D, track: Track, top: number): void {
    context.fillStyle = colour("sunken");
    context.fillRect(0, top, this.width, CURVES);
    const y = (share: number) => top + 2 + (CURVES - 4) * (1 - Math.max(0, Math.min(1, share)));
    this.curve(context, track.deviation.map((d) => (d === null ? null : y(d / DEVIATION))), colour("deviation"), [3, 2]);
    this.curve(context, track.confidence.map((c) => (Number.isFinite(c) ? y(c) : null)), colour("confidence"), []);
  }

  /** A line through the values of frames, with gaps; with many frames the worst of each pixel's. */
  private curve(context: CanvasRenderingContext2D, heights: (number | null)[], style: string, dash: number[]): void {
    context.beginPath();
    let open = false;
    heights.forEach((height, i) => {
      if (height === null) open = false;
      else {
        context[open ? "lineTo" : "moveTo"](this.x(i + 0.5), height);
        open = true;
      }
    });
    context.setLineDash(dash);
    context.strokeStyle = style;
    context.lineWidth = 1.25;
    context.stroke();
    context.setLineDash([]);
  }

  private line(context: CanvasRenderingContext2D, x: number, style: string, dash: number[]): void {
    context.beginPath();
    context.setLineDash(dash);
    context.moveTo(x, 0);
    context.lineTo(x, THUMBS + STATES + CURVES + 2 * GAP);
    context.strokeStyle = style;
    context.lineWidth = 1.5;
    context.stroke();
    context.setLineDash([]);
  }

  /** A keyframe; the frame that the surface is marked in is one as well, and is filled. */
  private diamond(context: CanvasRenderingContext2D, frame: number, style: string, filled: boolean): void {
    const x = Math.max(6, Math.min(this.width - 6, this.x(frame + 0.5)));
    context.save();
    context.translate(x, THUMBS + GAP + STATES / 2);
    context.rotate(Math.PI / 4);
    context.fillStyle = filled ? style : colour("panel");
    context.strokeStyle = filled ? colour("panel") : style;
    context.lineWidth = 2;
    context.fillRect(-5, -5, 10, 10);
    context.strokeRect(-5, -5, 10, 10);
    context.restore();
  }

  private playhead(context: CanvasRenderingContext2D): void {
    const x = this.x(this.studio.frame + 0.5);
    this.line(context, x, colour("text"), []);
    context.fillStyle = colour("text");
    context.beginPath();
    context.moveTo(x - 5, 0);
    context.lineTo(x + 5, 0);
    context.lineTo(x, 7);
    context.fill();
  }
}
