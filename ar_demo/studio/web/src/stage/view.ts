/** How the picture lies on the stage: zoom and place. Frame px have their centres at integers. */

import type { Point } from "../model";

const MARGIN = 12; // CSS px around a picture that fits
const CLOSEST = 32; // CSS px for a frame px

export class StageView {
  /** CSS px of the stage. */
  width = 1;
  height = 1;
  /** Frame px of the picture. */
  content: [number, number] = [16, 9];
  private zoom = 1;
  /** The content's point, 0 to 1, that is in the stage's middle. */
  private middle: Point = [0.5, 0.5];

  /** CSS px for a frame px. */
  get scale(): number {
    return this.fitting * this.zoom;
  }

  get isZoomed(): boolean {
    return this.zoom > 1.001;
  }

  private get fitting(): number {
    const [w, h] = this.content;
    return Math.max(0.01, Math.min((this.width - 2 * MARGIN) / w, (this.height - 2 * MARGIN) / h));
  }

  /** Where the content's left upper edge is, CSS px. */
  get origin(): Point {
    const [w, h] = this.content;
    return [this.width / 2 - this.middle[0] * w * this.scale, this.height / 2 - this.middle[1] * h * this.scale];
  }

  toStage([x, y]: Point): Point {
    const [ox, oy] = this.origin;
    return [ox + (x + 0.5) * this.scale, oy + (y + 0.5) * this.scale];
  }

  toFrame([x, y]: Point): Point {
    const [ox, oy] = this.origin;
    return [(x - ox) / this.scale - 0.5, (y - oy) / this.scale - 0.5];
  }

  /** Zooms so that what is at a point of the stage stays there. */
  zoomAt(at: Point, factor: number): void {
    const before = this.toFrame(at);
    this.zoom = Math.max(1, Math.min(CLOSEST / this.fitting, this.zoom * factor));
    const after = this.toStage(before);
    this.pan(at[0] - after[0], at[1] - after[1]);
  }

  pan(dx: number, dy: number): void {
    const [w, h] = this.content;
    const place = (middle: number, by: number, size: number) =>
      Math.min(1, Math.max(0, middle - by / (size * this.scale)));
    this.middle = this.isZoomed ? [place(this.middle[0], dx, w), place(this.middle[1], dy, h)] : [0.5, 0.5];
  }

  fit(): void {
    this.zoom = 1;
    this.middle = [0.5, 0.5];
  }
}
