/** The ad, drawn into the quad in the browser while its corners are placed. */

import { adPicture } from "../api";
import { fitRegion, quadAspect, unitToQuad } from "../geometry";
import type { Corners, Surface } from "../model";
import type { StageView } from "./view";

const HEIGHT = 540; // px of the ad's picture

export class AdPicture {
  readonly element = document.createElement("img");
  private shown = "";

  constructor(ready: () => void) {
    this.element.className = "ad";
    this.element.alt = "";
    this.element.draggable = false;
    this.element.onload = ready;
  }

  hide(): void {
    this.element.hidden = true;
  }

  /** @param frame width and height of the frame, px. @param dim while a corner is dragged, to see what lies below. */
  show(surface: Surface, quad: Corners, frame: [number, number], view: StageView, dim: boolean): void {
    const image = this.element;
    const address = surface.ad && surface.effect === "replace" ? adPicture(surface.ad, HEIGHT) : "";
    if (address !== this.shown) {
      this.shown = address;
      if (address) image.src = address;
    }
    image.hidden = !address || !image.complete || !image.naturalWidth;
    if (image.hidden) return;
    const [w, h] = [image.naturalWidth, image.naturalHeight];
    const [left, top, right, bottom] = fitRegion(surface.fit, w / h, quadAspect(quad, ...frame));
    const m = unitToQuad(quad.map((p) => view.toStage(p)));
    // px of the picture to the part of the ad that covers the surface, then to the stage; CSS writes columns
    const [a, b, c, d] = [1 / (w * (right - left)), 1 / (h * (bottom - top)), -left / (right - left), -top / (bottom - top)];
    const column = (i: number) => [m[i * 3] * a, m[i * 3 + 1] * b, m[i * 3] * c + m[i * 3 + 1] * d + m[i * 3 + 2]];
    const [x, y, z] = [column(0), column(1), column(2)];
    const matrix = [x[0], y[0], 0, z[0], x[1], y[1], 0, z[1], 0, 0, 1, 0, x[2], y[2], 0, z[2]];
    image.style.transform = `matrix3d(${matrix.join(",")})`;
    const inset = [top * h, (1 - right) * w, (1 - bottom) * h, left * w].map((px) => `${Math.max(0, px)}px`);
    image.style.clipPath = `inset(${inset.join(" ")})`;
    image.style.opacity = `${surface.opacity * (dim ? 0.55 : 1)}`;
    image.style.mixBlendMode = surface.blend === "add" ? "plus-lighter" : surface.blend;
  }
}
