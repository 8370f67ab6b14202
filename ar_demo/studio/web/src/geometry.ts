/** Quads and homographies of the plane. */

import type { Corners, Point } from "./model";

export const CORNER_NAMES = ["top left", "top right", "bottom right", "bottom left"];

export const centroid = (points: Corners): Point => [
  points.reduce((sum, p) => sum + p[0], 0) / points.length,
  points.reduce((sum, p) => sum + p[1], 0) / points.length,
];

const cross = (o: Point, a: Point, b: Point) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);

/** Whether four corners make a convex quad, in either direction. */
export function isConvex(quad: Corners): boolean {
  const turns = quad.map((p, i) => cross(p, quad[(i + 1) % 4], quad[(i + 2) % 4]));
  return turns.every((t) => t > 1) || turns.every((t) => t < -1);
}

/** Four points clockwise as seen, beginning with the first: whatever order they were clicked in. */
export function clockwise(quad: Corners): Corners {
  const [x, y] = centroid(quad);
  const angle = (p: Point) => Math.atan2(p[1] - y, p[0] - x);
  const from = angle(quad[0]);
  const turn = (p: Point) => (angle(p) - from + 4 * Math.PI) % (2 * Math.PI);
  return [quad[0], ...quad.slice(1).sort((a, b) => turn(a) - turn(b))];
}

/** Distance of a point from a line from a to b, px. */
export function distanceToSegment(p: Point, a: Point, b: Point): number {
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
  const along = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / (dx * dx + dy * dy || 1);
  const t = Math.min(1, Math.max(0, along));
  return Math.hypot(p[0] - a[0] - t * dx, p[1] - a[1] - t * dy);
}

/** The homography from the unit square to a quad, row by row (Heckbert, "Fundamentals of Texture Mapping and Image
 * Warping", 1989). */
export function unitToQuad(quad: Corners): number[] {
  const [[x0, y0], [x1, y1], [x2, y2], [x3, y3]] = quad;
  const [sx, sy] = [x0 - x1 + x2 - x3, y0 - y1 + y2 - y3];
  const [dx1, dy1, dx2, dy2] = [x1 - x2, y1 - y2, x3 - x2, y3 - y2];
  const det = dx1 * dy2 - dx2 * dy1 || 1e-9;
  const g = (sx * dy2 - dx2 * sy) / det;
  const h = (dx1 * sy - sx * dy1) / det;
  return [x1 - x0 + g * x1, x3 - x0 + h * x3, x0, y1 - y0 + g * y1, y3 - y0 + h * y3, y0, g, h, 1];
}

/** Focal lengths in frame widths, as the renderer takes them: shortest, longest, and a phone's. */
const FOCAL = { shortest: 0.5, longest: 2.5, common: 0.9 };

/** Width / height of the rectangle that a quad shows in a frame of this size, as the renderer takes it. */
export function quadAspect(quad: Corners, width: number, height: number): number {
  const unit = Math.max(width, height);
  const centred = quad.map(([x, y]): Point => [(x - (width - 1) / 2) / unit, (y - (height - 1) / 2) / unit]);
  const m = unitToQuad(centred);
  const [hx, hy] = [
    [m[0], m[3], m[6]],
    [m[1], m[4], m[7]],
  ];
  const converging = hx[2] * hy[2];
  const squared = converging ? -(hx[0] * hy[0] + hx[1] * hy[1]) / converging : 0;
  const known = squared > FOCAL.shortest ** 2 && squared < FOCAL.longest ** 2;
  const focal = known ? Math.sqrt(squared) : FOCAL.common;
  return Math.hypot(hx[0] / focal, hx[1] / focal, hx[2]) / Math.hypot(hy[0] / focal, hy[1] / focal, hy[2]);
}

/** The part of an ad that covers the surface: left, top, right, bottom in ads; beyond 0 to 1 there are bars. */
export function fitRegion(fit: string, adAspect: number, surfaceAspect: number): [number, number, number, number] {
  const ratio = surfaceAspect / adAspect;
  let [width, height] = [1, 1];
  if (fit === "contain") [width, height] = [Math.max(ratio, 1), Math.max(1 / ratio, 1)];
  if (fit === "cover") [width, height] = [Math.min(ratio, 1), Math.min(1 / ratio, 1)];
  return [0.5 - width / 2, 0.5 - height / 2, 0.5 + width / 2, 0.5 + height / 2];
}
