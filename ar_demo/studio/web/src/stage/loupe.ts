/** Eightfold view of the frame's own pixels around a point. */

import type { Corners, Point } from "../model";
import { colour } from "../theme";

const TIMES = 8;
const SIZE = 184; // CSS px

export class Loupe {
  readonly element = document.createElement("canvas");

  constructor() {
    this.element.className = "loupe";
    this.element.setAttribute("aria-hidden", "true");
    this.element.hidden = true;
  }

  hide(): void {
    this.element.hidden = true;
  }

  /** @param picture of the frame, maybe smaller than it. @param width of the frame, px. @param at in the frame, px.
   * @param left whether the stage's left corner is free. */
  show(picture: CanvasImageSource & { width: number }, width: number, at: Point, quad: Corners, left: boolean): void {
    const ratio = devicePixelRatio;
    const canvas = this.element;
    canvas.hidden = false;
    canvas.classList.toggle("right", !left);
    canvas.width = canvas.height = Math.round(SIZE * ratio);
    const context = canvas.getContext("2d")!;
    const [half, scale] = [canvas.width / 2, TIMES * ratio];
    const toLoupe = ([x, y]: Point): Point => [half + (x - at[0]) * scale, half + (y - at[1]) * scale];
    context.fillStyle = colour("stage");
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.imageSmoothingEnabled = false;
    const share = width / picture.width; // frame px for a px of the picture
    const [x, y] = toLoupe([-0.5, -0.5]);
    context.setTransform(scale * share, 0, 0, scale * share, x, y);
    context.drawImage(picture, 0, 0);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.lineWidth = 1.5 * ratio;
    if (quad.length > 1) {
      context.strokeStyle = colour("mark");
      context.beginPath();
      quad.forEach((p, i) => context[i ? "lineTo" : "moveTo"](...toLoupe(p)));
      if (quad.length === 4) context.closePath();
      context.stroke();
    }
    for (const [width, style] of [[3, "#000a"], [1, "#fff"]] as const) {
      context.lineWidth = width * ratio;
      context.strokeStyle = style;
      context.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        context.moveTo(half + dx * 6 * ratio, half + dy * 6 * ratio);
        context.lineTo(half + dx * 26 * ratio, half + dy * 26 * ratio);
      }
      context.stroke();
    }
    context.font = `${12 * ratio}px ${colour("numbers")}`;
    const text = `${at[0].toFixed(1)}, ${at[1].toFixed(1)}`;
    const wide = context.measureText(text).width + 12 * ratio;
    context.fillStyle = "#000b";
    context.fillRect(half - wide / 2, canvas.height - 24 * ratio, wide, 18 * ratio);
    context.fillStyle = "#fff";
    context.textAlign = "center";
    context.fillText(text, half, canvas.height - 11 * ratio);
  }
}
