/** The surfaces' tracks: as the server has them, and pose by pose while they are made. */

import type { ProjectApi } from "./api";
import type { Corners, Surface, Track } from "./model";

const BETWEEN = 20; // frames: not every pose is told while tracking is quick

const blank = (frames: number): Track => ({
  first: 0,
  last: frames - 1,
  reference_frame: 0,
  corners: Array<Corners | null>(frames).fill(null),
  states: " ".repeat(frames),
  confidence: Array<number>(frames).fill(NaN),
  deviation: Array<number | null>(frames).fill(null),
  cuts: [],
  keyframes: [],
  warnings: [],
});

export class Tracks {
  private readonly known = new Map<number, { id: string | null; track: Track | null }>();
  private lastFrame = NaN;
  /** Grows with every change. */
  version = 0;

  constructor(
    private readonly api: ProjectApi,
    private readonly changed: () => void,
  ) {}

  of(surface: Surface): Track | null {
    return this.known.get(surface.key)?.track ?? null;
  }

  /** Fetches those that are not here yet. */
  load(surfaces: Surface[]): void {
    surfaces.forEach((surface, index) => {
      const id = surface.track?.id ?? null;
      const known = this.known.get(surface.key);
      if (id === (known?.id ?? null)) return;
      this.known.set(surface.key, { id, track: id ? (known?.track ?? null) : null });
      if (id) void this.fetch(surface, index);
      this.version++;
    });
  }

  /** Fetches all, when tracking has ended. */
  async reload(surfaces: Surface[]): Promise<void> {
    await Promise.all(
      surfaces.map((surface, index) => {
        if (surface.track) return this.fetch(surface, index);
        this.known.set(surface.key, { id: null, track: null });
        this.version++;
        return undefined;
      }),
    );
  }

  /** A pose that was just measured. */
  pose(surface: Surface, frames: number, frame: number, state: string, corners: Corners | null): void {
    const entry = this.known.get(surface.key) ?? { id: null, track: null };
    this.known.set(surface.key, entry);
    const track = (entry.track ??= blank(frames));
    track.corners[frame] = corners;
    const near = Math.abs(frame - this.lastFrame) <= BETWEEN;
    const [first, last] = near ? [Math.min(frame, this.lastFrame), Math.max(frame, this.lastFrame)] : [frame, frame];
    track.states = track.states.slice(0, first) + (state[0] ?? " ").repeat(last - first + 1) + track.states.slice(last + 1);
    for (let i = first; i <= last; i++) [track.confidence[i], track.deviation[i]] = [NaN, null]; // known at the end
    this.lastFrame = frame;
    this.version++;
  }

  private async fetch(surface: Surface, index: number): Promise<void> {
    const id = surface.track?.id ?? null;
    const track = await this.api.track(index).catch(() => null);
    this.known.set(surface.key, { id, track });
    this.version++;
    this.changed();
  }
}
