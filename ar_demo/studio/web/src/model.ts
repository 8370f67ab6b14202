/** What the server says and is told: the JSON of its HTTP interface. Coordinates are px of the full frame, pixel
 * centres at integers; corners are top left, top right, bottom right, bottom left of the ad. */

export type Point = [number, number];
/** Four of them are a quad, three or more a polygon. */
export type Corners = Point[];

export interface Entry {
  id: string;
  name: string;
  kind?: string;
  bytes?: number;
}

/** A folder; null where only files that were named can be opened. */
export interface Listing {
  folder: Entry | null;
  parent: Entry | null;
  folders: Entry[];
  files: Entry[];
}

export interface Keyframe {
  frame: number;
  corners: Corners;
}

/** A track that the server has; `stale` where the surface has changed since. */
export interface TrackRef {
  id: string;
  counts: Record<string, number>;
  reference_frame: number;
  stale: boolean;
}

export interface Surface {
  /** Names the surface in this page alone, so that undo finds its track again. */
  key: number;
  ad: string | null;
  ad_name: string | null;
  quad: Corners | null;
  start: number;
  snap: boolean;
  region: Corners | null;
  exclude: Corners[];
  keyframes: Keyframe[];
  fit: string;
  playback: string;
  blend: string;
  opacity: number;
  feather: number;
  lost: string;
  effect: string;
  flat: boolean;
  shutter: number | null;
  grain: string;
  inset: number;
  radius: number;
  softness: string;
  first_light: string;
  surface_kind: string;
  track: TrackRef | null;
}

export interface Tracking {
  /** Two frames or times, as "250..500" or "10s..20s"; null for the whole video. */
  time: string | null;
  smooth: number;
}

export interface Rendering {
  audio: string;
  codec: string | null;
  crf: number | null;
  depth: string;
}

/** What is edited, saved and undone. */
export interface Doc {
  surfaces: Surface[];
  tracking: Tracking;
  rendering: Rendering;
}

export interface Video {
  file: string;
  name: string;
  width: number;
  height: number;
  frames: number;
  rate: number;
  /** Seconds of each frame from the first. */
  times: number[];
  /** What is wrong with the file. */
  warnings: string[];
}

export interface Task {
  id: string;
  kind: "find" | "track" | "render";
  state: "running" | "done" | "stopped" | "failed";
  stage: string;
  done: number;
  total: number | null;
  error: string | null;
  warnings: string[];
  output: string | null;
  /** Where a surface was found by its picture: each copy of it. */
  found: Pick<Surface, "quad" | "start" | "keyframes">[];
}

export interface Project extends Doc {
  id: string;
  name: string;
  revision: number;
  video: Video;
  choices: Record<string, string[]>;
  command: string;
  /** The name that the output gets, until another is typed. */
  output: string;
  job_file: string;
  task: Task | null;
  /** Whether tracking was stopped, and goes on where it was. */
  can_go_on: boolean;
}

/** A surface through the video; arrays have an entry for each frame. */
export interface Track {
  first: number;
  last: number;
  reference_frame: number;
  corners: (Corners | null)[];
  /** A letter for each frame: t tracked, h held, l lost. */
  states: string;
  confidence: number[];
  /** Standard deviation of the corners, px; null where it is unknown. */
  deviation: (number | null)[];
  cuts: number[];
  keyframes: number[];
  warnings: string[];
}

export interface Proposal {
  corners: Corners;
  score: number;
}

export interface Output {
  id: string;
  name: string;
  bytes: number;
}

export type ServerEvent =
  | ({ type: "task" } & Task)
  | { type: "pose"; surface: number; frame: number; state: string; corners?: Corners }
  | { type: "project"; revision: number };
