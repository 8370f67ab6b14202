/** The page's state and what can be done with it; what is drawn comes from here. */

import { ApiError, sentence } from "./api";
import { Document, newSurface } from "./document";
import { clockwise, isConvex } from "./geometry";
import type { Corners, Doc, Output, Point, Project, Proposal, ServerEvent, Surface, Task } from "./model";
import { Sources } from "./sources";
import { Tracks } from "./tracks";

export const STEPS = ["mark", "track", "look", "finish"] as const;
export type Step = (typeof STEPS)[number];
export type View = "frame" | "composite" | "wipe" | "steady";
export type Tool = "corners" | "region" | "exclude";
/** Where an error is shown: beside what caused it. */
export type Place = "picture" | "ad" | "find" | "track" | "finish" | "save";

const PLACES = { find: "find", track: "track", render: "finish" } as const;

const RETRACK_MS = 700; // after the last change of a keyframe

const SHOWN = 6; // likely rectangles at most, so that the picture is still seen

const hundredths = ([x, y]: Point): Point => [Math.round(x * 100) / 100, Math.round(y * 100) / 100];

export class Studio {
  readonly doc: Document;
  readonly tracks: Tracks;
  readonly sources: Sources;

  frame = 0;
  selected = 0;
  step: Step = "mark";
  view: View = "frame";
  tool: Tool = "corners";
  /** Share of the width that shows the video as it was. */
  wipe = 0.5;
  snapping = true;
  /** Whether the picture follows the frame that is tracked. */
  following = true;
  /** Whether playing goes round two seconds about where it began. */
  looping = false;
  isPlaying = false;
  corner: number | null = null;
  dragging = false;
  /** Where the dragged corner would snap to. */
  ghost: Point | null = null;
  /** Corners that are clicked, up to the fourth; those of a polygon, up to its end. */
  placing: Corners = [];
  /** The polygon whose corners are edited: its number among those that are left out, -1 for the region. */
  shape: number | null = null;
  polygon: Corners = [];
  proposals: Proposal[] = [];
  proposalsOf = -1;
  hot: number | null = null;
  task: Task | null;
  outputs: Output[] = [];
  connected = true;
  errors: Partial<Record<Place, string>> = {};
  /** The output's name where it was typed, and whether it may take the place of a file that is there. */
  outputName: string | null = null;
  mayOverwrite = false;
  message = "";

  /** Where tracking was begun from, to go back to. */
  private cameFrom: number | null = null;
  private readonly watchers: (() => void)[] = [];
  private pending = false;
  private retrackTimer = 0;
  private proposalTimer = 0;
  private snapInFlight = false;

  constructor(project: Project) {
    this.doc = new Document(
      project,
      () => this.documentChanged(),
      () => this.say("The project was changed in another tab: this is its newest state."),
    );
    this.tracks = new Tracks(this.doc.api, () => this.changed());
    this.sources = new Sources(this.doc.api, project.video, (frame, error) => {
      if (frame === this.frame) {
        if (error) this.errors.picture = error;
        else delete this.errors.picture;
      }
      this.changed();
    });
    this.task = project.task;
    this.frame = this.surface?.start ?? 0;
    if (project.surfaces.length && project.surfaces.every((s) => s.track && !s.track.stale)) this.go("track");
    this.doc.api.listen(
      (event) => this.hear(event),
      (is) => {
        if (is) void this.doc.reload().catch(() => undefined); // what was told before the connection was made
        this.connected = is;
        this.changed();
      },
    );
    this.tracks.load(project.surfaces);
    void this.readOutputs();
    this.propose();
  }

  get project(): Project {
    return this.doc.project;
  }

  get video() {
    return this.project.video;
  }

  get surface(): Surface | undefined {
    return this.project.surfaces[this.selected];
  }

  get isBusy(): boolean {
    return this.task?.state === "running";
  }

  /** Calls back at most once for each repaint of the screen. */
  watch(callback: () => void): void {
    this.watchers.push(callback);
  }

  changed(): void {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => {
      this.pending = false;
      for (const callback of this.watchers) callback();
    });
  }

  say(message: string): void {
    this.message = message;
    this.changed();
  }

  fail(place: Place, error: unknown): void {
    this.errors[place] = error instanceof Error ? error.message : String(error);
    this.changed();
  }

  clear(place: Place): void {
    delete this.errors[place];
    this.changed();
  }

  // Where we are

  seek(frame: number): void {
    const to = Math.max(0, Math.min(this.video.frames - 1, Math.round(frame)));
    if (to === this.frame) return;
    this.sources.direction = Math.sign(to - this.frame) || 1;
    this.frame = to;
    delete this.errors.picture;
    this.ghost = null;
    this.message = "";
    this.propose();
    this.changed();
  }

  select(surface: number): void {
    this.selected = surface;
    this.corner = null;
    this.placing = [];
    this.polygon = [];
    this.shape = null;
    this.tool = "corners";
    if (this.step === "mark" && this.surface?.quad) this.seek(this.surface.start);
    this.propose();
    this.changed();
  }

  go(step: Step): void {
    this.step = step;
    this.shape = null;
    this.polygon = [];
    this.placing = [];
    this.tool = "corners";
    this.message = "";
    this.view = step === "look" ? "wipe" : step === "finish" ? "composite" : "frame";
    if (step === "mark" && this.surface?.quad) this.seek(this.surface.start);
    if (step === "finish") void this.readOutputs();
    this.propose();
    this.changed();
  }

  show(view: View): void {
    this.view = view;
    delete this.errors.picture;
    this.changed();
  }

  // What is edited

  edit(merge: string, change: (doc: Doc) => void): void {
    this.message = "";
    this.doc.edit(this.frame, this.selected, merge, change);
  }

  editSurface(merge: string, change: (surface: Surface) => void): void {
    const index = this.selected;
    this.edit(merge && `${merge}-${index}`, (doc) => change(doc.surfaces[index]));
  }

  undo(): void {
    this.after(this.doc.undo());
  }

  redo(): void {
    this.after(this.doc.redo());
  }

  private after(step: { frame: number; surface: number } | null): void {
    if (!step) return;
    this.placing = [];
    this.selected = Math.min(step.surface, this.project.surfaces.length - 1);
    this.seek(step.frame);
    this.propose();
  }

  private documentChanged(): void {
    this.selected = Math.max(0, Math.min(this.selected, this.project.surfaces.length - 1));
    this.tracks?.load(this.project.surfaces);
    if (this.doc?.error) this.errors.save = this.doc.error.message;
    else delete this.errors.save;
    this.changed();
  }

  addSurface(): void {
    const last = this.project.surfaces.at(-1);
    this.edit("", (doc) => doc.surfaces.push(newSurface({ ad: last?.ad, ad_name: last?.ad_name, start: this.frame })));
    this.step = "mark";
    this.view = "frame";
    this.select(this.project.surfaces.length - 1);
  }

  removeSurface(index: number): void {
    this.edit("", (doc) => doc.surfaces.splice(index, 1));
    if (!this.project.surfaces.length) return this.addSurface();
    this.select(Math.min(this.selected, this.project.surfaces.length - 1));
  }

  /** Brings a surface before the one that follows it in the list. */
  raiseSurface(index: number): void {
    this.edit("", (doc) => doc.surfaces.splice(index, 2, doc.surfaces[index + 1], doc.surfaces[index]));
    this.select(index + 1);
  }

  /** Whether corners can be dragged in this frame: the surface's own, or those of a keyframe to be. */
  get handles(): Corners | null {
    const surface = this.surface;
    if (!surface?.quad || this.view !== "frame" || this.tool !== "corners" || this.vertices) return null;
    if (this.step === "look" || this.step === "finish" || this.isBusy) return null;
    if (this.frame === surface.start) return surface.quad;
    if (this.step === "mark") return null;
    const keyframe = surface.keyframes.find((k) => k.frame === this.frame);
    if (keyframe) return keyframe.corners;
    return this.tracks.of(surface)?.corners[this.frame] ?? null;
  }

  /** Whether a click marks the next corner. */
  get isPlacing(): boolean {
    const isLooking = this.isBusy && this.task?.kind === "find";
    return this.step === "mark" && this.view === "frame" && !!this.surface && !this.surface.quad && !isLooking;
  }

  /** Puts corners into this frame: of the surface where it is marked, else of a keyframe. */
  setCorners(corners: Corners, merge: string): void {
    const frame = this.frame;
    const rounded = corners.map(hundredths);
    this.editSurface(merge && `${merge}-${frame}`, (surface) => {
      if (frame === surface.start) {
        surface.quad = rounded;
        return;
      }
      surface.keyframes = [...surface.keyframes.filter((k) => k.frame !== frame), { frame, corners: rounded }].sort(
        (a, b) => a.frame - b.frame,
      );
    });
  }

  moveCorner(index: number, to: Point, merge: string): void {
    const corners = this.handles?.map((p): Point => [...p]);
    if (!corners) return;
    corners[index] = to;
    this.setCorners(corners, merge);
  }

  /** Asks where the tracker would put a corner that is dragged, one question at a time. */
  async look(index: number): Promise<void> {
    const corners = this.handles;
    if (this.snapInFlight || !this.snapping || !corners || !isConvex(corners)) return;
    this.snapInFlight = true;
    try {
      const { corners: snapped, moved } = await this.doc.api.snap(this.frame, corners);
      if (this.dragging) this.ghost = moved[index] > 0.05 ? snapped[index] : null;
    } catch {
      this.ghost = null; // no edges are no error
    }
    this.snapInFlight = false;
    this.changed();
  }

  /** After a corner was let go: it snaps, and in a keyframe what is next to it is tracked again. */
  async release(index: number, merge: string): Promise<void> {
    const [frame, corners] = [this.frame, this.handles];
    this.dragging = false;
    this.ghost = null;
    if (corners && !isConvex(corners)) {
      this.say("These corners cross: drag them apart.");
      return;
    }
    if (corners && this.snapping) {
      const snapped = await this.doc.api.snap(frame, corners).catch(() => null);
      const moved = snapped?.moved[index] ?? 0;
      if (snapped && moved > 0.05 && this.frame === frame && this.handles && !this.dragging) {
        this.moveCorner(index, snapped.corners[index], merge);
        this.say(`Snapped to the edge, by ${moved.toFixed(1)} px. Hold Alt while dragging to place it freely.`);
      }
    }
    this.retrackSoon();
    this.changed();
  }

  /** Corners by click: the fourth makes the surface. */
  place(point: Point): void {
    this.placing = [...this.placing, point];
    if (this.placing.length === 4) {
      const quad = clockwise(this.placing);
      this.placing = [];
      if (!isConvex(quad)) this.say("These four points make no rectangle, even a tilted one: click its corners again.");
      else void this.mark(quad);
    }
    this.changed();
  }

  /** Marks the surface in this frame. */
  async mark(quad: Corners, snap = this.snapping): Promise<void> {
    const frame = this.frame;
    this.placing = [];
    this.hot = null;
    const merge = `mark-${Date.now()}`;
    this.editSurface(merge, (surface) => {
      surface.start = frame;
      surface.quad = quad.map(hundredths);
    });
    const marked = this.surface?.key;
    const snapped = snap && (await this.doc.api.snap(frame, quad).catch(() => null));
    if (snapped && this.surface?.key === marked && this.surface?.start === frame)
      this.editSurface(merge, (surface) => (surface.quad = snapped.corners.map(hundredths)));
  }

  /** For those who do not point: a rectangle in the middle, to be moved by keys. */
  markMiddle(): void {
    const { width: w, height: h } = this.video;
    const quad: Corners = [
      [w * 0.3, h * 0.3],
      [w * 0.7, h * 0.3],
      [w * 0.7, h * 0.7],
      [w * 0.3, h * 0.7],
    ];
    void this.mark(quad, false);
  }

  /** Marks the surface in this frame rather than in the one where it was. */
  markHere(): void {
    const frame = this.frame;
    const there = this.surface && this.tracks.of(this.surface)?.corners[frame];
    this.editSurface("", (surface) => {
      surface.start = frame;
      surface.quad = there ?? surface.quad;
      surface.keyframes = surface.keyframes.filter((k) => k.frame !== frame);
    });
  }

  /** A keyframe where the surface was lost, from the nearest frame where it is known. */
  keyframeHere(): void {
    const surface = this.surface;
    const track = surface && this.tracks.of(surface);
    if (!surface?.quad || !track) return;
    const known = track.corners
      .map((corners, i) => ({ corners, far: Math.abs(i - this.frame) }))
      .filter((k) => k.corners)
      .sort((a, b) => a.far - b.far)[0];
    this.setCorners(known?.corners ?? surface.quad, "");
  }

  removeKeyframe(frame: number): void {
    this.editSurface("", (surface) => (surface.keyframes = surface.keyframes.filter((k) => k.frame !== frame)));
    this.retrackSoon();
  }

  /** Turns the ad by a quarter, clockwise. */
  turn(): void {
    const surface = this.surface;
    if (!surface?.quad) return;
    const turned = (c: Corners): Corners => [...c.slice(1), c[0]];
    this.editSurface("", (s) => {
      s.quad = s.quad && turned(s.quad);
      s.keyframes = s.keyframes.map((k) => ({ ...k, corners: turned(k.corners) }));
    });
  }

  unmark(): void {
    this.editSurface("", (surface) => {
      surface.quad = null;
      surface.keyframes = [];
      surface.track = null;
    });
    this.corner = null;
    this.propose();
  }

  nudge(index: number, dx: number, dy: number): void {
    const from = this.handles?.[index];
    if (!from) return;
    this.moveCorner(index, [from[0] + dx, from[1] + dy], `nudge-${index}`);
    this.retrackSoon();
  }

  // Regions

  addVertex(point: Point): void {
    this.polygon = [...this.polygon, point];
    this.changed();
  }

  closePolygon(): void {
    const points = this.polygon.map(([x, y]): Point => [Math.round(x * 10) / 10, Math.round(y * 10) / 10]);
    if (points.length < 3) return;
    const tool = this.tool;
    this.polygon = [];
    this.editSurface("", (surface) => {
      if (tool === "region") surface.region = points;
      else surface.exclude = [...surface.exclude, points];
    });
    this.use("corners");
    this.editShape(tool === "region" ? -1 : this.surface!.exclude.length - 1);
  }

  /** Lets a polygon's corners be moved, added and removed; null ends that. */
  editShape(shape: number | null): void {
    this.shape = shape;
    this.view = "frame";
    if (shape !== null && this.surface) this.seek(this.surface.start);
    this.changed();
  }

  /** The corners of the polygon that is edited. */
  get vertices(): Corners | null {
    const { shape, surface } = this;
    if (shape === null || !surface || this.step !== "mark" || this.view !== "frame") return null;
    if (this.frame !== surface.start || this.tool !== "corners") return null;
    return (shape < 0 ? surface.region : surface.exclude[shape]) ?? null;
  }

  private setVertices(points: Corners, merge: string): void {
    const shape = this.shape!;
    this.editSurface(merge, (surface) => {
      if (shape < 0) surface.region = points;
      else surface.exclude[shape] = points;
    });
  }

  moveVertex(index: number, to: Point, merge: string): void {
    const points = this.vertices?.map((p, i) => (i === index ? hundredths(to) : p));
    if (points) this.setVertices(points, merge);
  }

  /** A new corner in the middle between one and the next. */
  splitEdge(index: number, merge = ""): void {
    const points = this.vertices;
    if (!points) return;
    const [a, b] = [points[index], points[(index + 1) % points.length]];
    const middle = hundredths([(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
    this.setVertices([...points.slice(0, index + 1), middle, ...points.slice(index + 1)], merge);
  }

  removeVertex(index: number): void {
    const points = this.vertices;
    if (!points) return;
    if (points.length === 3) return this.say("A polygon has three corners at least: remove all of it in the panel.");
    this.setVertices(points.filter((_, i) => i !== index), "");
  }

  use(tool: Tool): void {
    this.tool = tool;
    this.polygon = [];
    this.shape = null;
    this.view = "frame";
    if (tool !== "corners" && this.surface) this.seek(this.surface.start);
    this.changed();
  }

  // Likely rectangles

  private propose(): void {
    clearTimeout(this.proposalTimer);
    if (!this.isPlacing || this.isPlaying) return;
    if (this.proposalsOf !== this.frame) this.proposals = [];
    const frame = this.frame;
    this.proposalTimer = window.setTimeout(async () => {
      if (this.proposalsOf === frame && this.proposals.length) return;
      const found = await this.doc.api.proposals(frame).catch((error: ApiError) => (error.status === 503 ? null : { proposals: [] }));
      if (this.frame !== frame) return;
      if (!found) return this.propose(); // the frame is not decoded yet
      this.proposals = found.proposals.filter((p) => isConvex(p.corners)).slice(0, SHOWN);
      this.proposalsOf = frame;
      this.changed();
    }, 600);
  }

  get shownProposals(): Proposal[] {
    return this.isPlacing && !this.placing.length && this.proposalsOf === this.frame ? this.proposals : [];
  }

  // Work of the server

  private retrackSoon(): void {
    clearTimeout(this.retrackTimer);
    const surface = this.surface;
    if (!surface?.track || this.frame === surface.start) return;
    this.retrackTimer = window.setTimeout(() => {
      if (!this.dragging && this.surface?.track && !this.isBusy) void this.track();
    }, RETRACK_MS);
  }

  /** Looks for the surface by a picture of it. */
  async find(picture: string): Promise<void> {
    this.clear("find");
    if (!(await this.doc.settled())) return;
    try {
      this.setTask(await this.doc.api.startFinding(picture));
    } catch (error) {
      this.fail("find", error);
    }
  }

  /** Where the surface was found last, while it is not marked. */
  get found(): Task["found"] {
    return this.task?.kind === "find" && this.task.state === "done" && !this.surface?.quad ? this.task.found : [];
  }

  /** Marks the surface where it was found, and others of its kind for its copies. */
  takeFound(): void {
    const { found, surface, selected } = this;
    if (!found.length || !surface) return;
    const [first, ...copies] = found;
    this.edit("", (doc) => {
      Object.assign(doc.surfaces[selected], first);
      const { track: _, key: __, ...like } = surface;
      doc.surfaces.splice(selected + 1, 0, ...copies.map((copy) => newSurface({ ...like, ...copy })));
    });
    this.placing = [];
    this.seek(first.start);
    const more = copies.length ? `, and ${copies.length} more` : "";
    this.say(`Found in frame ${first.start}${more}: check the corners.`);
  }

  async track(): Promise<void> {
    this.clear("track");
    if (!(await this.doc.settled())) return;
    this.following = true;
    this.cameFrom = this.frame;
    try {
      this.setTask(await this.doc.api.startTracking());
      if (this.step === "mark") this.go("track");
    } catch (error) {
      if (error instanceof ApiError && error.field?.endsWith(".ad")) this.fail("ad", error);
      else this.fail("track", error);
    }
  }

  /** @returns the name that it gets. */
  nameOutput(name: string): string {
    this.outputName = name.trim() || null;
    this.mayOverwrite = false;
    this.clear("finish");
    return this.outputName ?? this.project.output;
  }

  async render(overwrite = false): Promise<void> {
    const name = this.outputName ?? this.project.output; // it may have been typed just before
    this.clear("finish");
    this.mayOverwrite = false;
    if (!(await this.doc.settled())) return;
    try {
      this.setTask(await this.doc.api.startRendering(name, overwrite));
    } catch (error) {
      this.mayOverwrite = error instanceof ApiError && error.status === 409 && error.field === "name";
      this.fail("finish", error);
    }
  }

  async stop(): Promise<void> {
    await this.doc.api.stop().catch((error) => this.fail(PLACES[this.task?.kind ?? "track"], error));
  }

  private async readOutputs(): Promise<void> {
    this.outputs = await this.doc.api.outputs().catch(() => this.outputs);
    this.changed();
  }

  private hear(event: ServerEvent): void {
    if (event.type === "task") this.setTask(event);
    else if (event.type === "project") void this.doc.heard(event.revision);
    else {
      const surface = this.project.surfaces[event.surface];
      if (!surface) return;
      this.tracks.pose(surface, this.video.frames, event.frame, event.state, event.corners ?? null);
      if (this.following && this.isBusy && this.view === "frame") {
        this.frame = event.frame;
        this.sources.direction = 1;
      }
      this.changed();
    }
  }

  private setTask(task: Task): void {
    const wasRunning = this.isBusy && this.task?.id === task.id;
    if (this.task?.id === task.id && !this.isBusy && task.state === "running") return; // came late
    this.task = task;
    if (task.state !== "running" && (wasRunning || task.state === "failed")) void this.ended(task);
    this.changed();
  }

  private async ended(task: Task): Promise<void> {
    if (task.state === "failed") this.fail(PLACES[task.kind], sentence(task.error ?? "it failed"));
    await this.doc.reload().catch(() => undefined);
    if (task.kind === "track") {
      if (!this.project.can_go_on) await this.tracks.reload(this.project.surfaces); // what was found so far stays
      if (this.following && this.cameFrom !== null) this.seek(this.cameFrom);
      this.cameFrom = null;
    }
    if (task.kind === "render") await this.readOutputs();
    if (task.kind === "find" && task.state === "done" && this.step === "mark") this.takeFound();
    if (task.state === "stopped") this.say(this.project.can_go_on && task.kind === "track" ? "Stopped: it can go on from here." : "Stopped: nothing was changed.");
    this.changed();
  }
}
