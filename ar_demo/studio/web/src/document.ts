/** The project as it is edited: history, and saving to the server, which writes the job file at once. */

import { ApiError, ProjectApi } from "./api";
import type { Doc, Project, Surface, TrackRef } from "./model";

const MERGE_MS = 1000; // edits of the same thing that follow each other so closely are undone in one
const SAVE_MS = 120;
const HISTORY = 200;

interface Step {
  doc: Doc;
  /** Where it was edited, to show what undo does. */
  frame: number;
  surface: number;
  merge: string;
  at: number;
}

let keys = 0;

export const newSurface = (defaults: Partial<Surface> = {}): Surface => ({
  key: ++keys,
  ad: null,
  ad_name: null,
  quad: null,
  start: 0,
  snap: false,
  region: null,
  exclude: [],
  keyframes: [],
  fit: "stretch",
  playback: "loop",
  blend: "normal",
  opacity: 1,
  feather: 0,
  lost: "fade",
  effect: "replace",
  flat: false,
  shutter: null,
  grain: "auto",
  inset: 0,
  radius: 0,
  softness: "auto",
  first_light: "auto",
  surface_kind: "print",
  track: null,
  ...defaults,
});

export class Document {
  readonly api: ProjectApi;
  /** What could not be saved, with the field it belongs to. */
  error: ApiError | null = null;
  private past: Step[] = [];
  private future: Step[] = [];
  private readonly tracks = new Map<number, TrackRef | null>();
  private unsaved = false;
  private timer = 0;
  private saving: Promise<void> | null = null;
  private newest: number;

  /** @param changed is called after every change. @param replaced when another tab's changes took the place of ours. */
  constructor(
    public project: Project,
    private readonly changed: () => void,
    private readonly replaced: () => void,
  ) {
    this.api = new ProjectApi(project.id);
    this.newest = project.revision;
    this.adopt(project, []);
  }

  get canUndo(): boolean {
    return this.past.length > 0;
  }

  get canRedo(): boolean {
    return this.future.length > 0;
  }

  get isSaved(): boolean {
    return !this.unsaved && !this.saving && !this.error;
  }

  /** Changes a copy of the document, which then takes its place. */
  edit(frame: number, surface: number, merge: string, change: (doc: Doc) => void): void {
    const last = this.past.at(-1);
    const now = Date.now();
    if (merge && last?.merge === merge && now - last.at < MERGE_MS && !this.future.length) last.at = now;
    else this.past.push({ doc: this.copy(), frame, surface, merge, at: now });
    this.past.splice(0, this.past.length - HISTORY);
    this.future = [];
    const doc = this.copy();
    change(doc);
    this.put(doc);
  }

  undo = () => this.travel(this.past, this.future);
  redo = () => this.travel(this.future, this.past);

  /** What was saved last is on disk when this resolves; whether all could be saved. */
  async settled(): Promise<boolean> {
    clearTimeout(this.timer);
    await this.save();
    return !this.error;
  }

  /** Another tab, or a task, changed the project. */
  async heard(revision: number): Promise<void> {
    this.newest = Math.max(this.newest, revision);
    if (this.saving || this.unsaved || this.newest <= this.project.revision) return;
    await this.reload();
  }

  /** Takes the project as the server has it; a new track is no edit, other changes end the history. */
  async reload(): Promise<void> {
    await this.settled();
    const before = JSON.stringify(this.bare());
    const project = await this.api.read();
    if (this.unsaved || this.saving) return; // the answer to what is being saved tells more
    const keys = this.project.surfaces.map((s) => s.key);
    this.adopt(project, project.surfaces.length === keys.length ? keys : []);
    if (JSON.stringify(this.bare()) !== before) this.forget();
    this.changed();
  }

  private forget(): void {
    this.past = [];
    this.future = [];
    this.replaced();
  }

  private travel(from: Step[], to: Step[]): { frame: number; surface: number } | null {
    const step = from.pop();
    if (!step) return null;
    to.push({ ...step, doc: this.copy(), merge: "" });
    for (const surface of step.doc.surfaces) surface.track = this.tracks.get(surface.key) ?? surface.track;
    this.put(step.doc);
    return step;
  }

  private put(doc: Doc): void {
    Object.assign(this.project, doc);
    this.unsaved = true;
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.save(), SAVE_MS);
    this.changed();
  }

  private save(): Promise<void> {
    if (!this.unsaved && !this.saving) return Promise.resolve();
    this.saving ??= this.sendAll().finally(() => {
      this.saving = null;
      this.changed();
      if (!this.error) void this.heard(this.newest);
    });
    return this.saving;
  }

  private async sendAll(): Promise<void> {
    while (this.unsaved) {
      this.unsaved = false;
      const sent = this.copy();
      try {
        const answer = await this.api.save(this.project.revision, sent);
        this.error = null;
        this.take(answer, sent);
      } catch (problem) {
        const error = problem as ApiError;
        const current = (error.body?.project ?? error.body) as Project | undefined;
        if (error.status === 409 && typeof current?.revision === "number") {
          this.adopt(current, []);
          this.unsaved = false;
          this.forget();
        } else {
          this.error = error;
          return;
        }
      }
    }
  }

  /** An answer to what was sent; where there are newer edits only what the server makes itself is taken. */
  private take(answer: Project, sent: Doc): void {
    const keys = sent.surfaces.map((s) => s.key);
    if (!this.unsaved) return this.adopt(answer, keys);
    const { revision, command, job_file, can_go_on } = answer;
    Object.assign(this.project, { revision, command, job_file, can_go_on });
    this.newest = Math.max(this.newest, revision);
    answer.surfaces.forEach((surface, i) => this.tracks.set(keys[i], surface.track));
    for (const surface of this.project.surfaces) surface.track = this.tracks.get(surface.key) ?? surface.track;
  }

  private adopt(project: Project, known: number[]): void {
    if (!project.surfaces.length) project.surfaces.push(newSurface()); // there is one to begin with
    project.surfaces.forEach((surface, i) => {
      surface.key = known[i] ?? ++keys;
      this.tracks.set(surface.key, surface.track);
    });
    this.project = project;
    this.newest = Math.max(this.newest, project.revision);
  }

  private copy(): Doc {
    const { surfaces, tracking, rendering } = this.project;
    return structuredClone({ surfaces, tracking, rendering });
  }

  /** What is edited, without what the server or this page adds. */
  private bare(): unknown {
    const doc = this.copy();
    return { ...doc, surfaces: doc.surfaces.map(({ key: _, track: __, ...surface }) => surface) };
  }
}
