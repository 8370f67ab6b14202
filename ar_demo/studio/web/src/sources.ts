/** Where the pictures on the stage come from: frames, the same with the ads on, and the surface standing still. */

import type { ProjectApi } from "./api";
import type { Video } from "./model";
import { Pictures } from "./pictures";

const HEIGHTS = [360, 540, 720, 1080, 1440, 2160];

export class Sources {
  /** 1 forward, -1 backward: where more is fetched in advance. */
  direction = 1;
  private height = 540;
  private readonly pictures = new Map<string, { key: string; pictures: Pictures }>();

  constructor(
    private readonly api: ProjectApi,
    private readonly video: Video,
    private readonly loaded: (frame: number, error: string | null) => void,
  ) {}

  /** Pictures are asked for as high as the stage is, in steps. @param px of the screen. */
  set stageHeight(px: number) {
    this.height = Math.min(HEIGHTS.find((h) => h >= px) ?? 2160, this.video.height);
  }

  frames(): Pictures {
    const height = this.height;
    return this.source("frames", `${height}`, (i, near) => this.api.frame(i, height, near));
  }

  /** Frames with all their pixels, for the loupe and when the stage is zoomed in. */
  full(): Pictures {
    if (this.height === this.video.height) return this.frames();
    return this.source("full", "", (i, near) => this.api.frame(i, this.video.height, near));
  }

  composites(revision: number): Pictures {
    const height = this.height;
    return this.source("composites", `${height} ${revision}`, (i) => this.api.composite(i, height, revision));
  }

  steady(surface: number, track: string): Pictures {
    const height = Math.min(this.height, 720);
    return this.source("steady", `${height} ${surface} ${track}`, (i) => this.api.steady(surface, i, height, track));
  }

  /** This frame first, then as many that come next. */
  want(pictures: Pictures, frame: number, ahead: number): void {
    const next = Array.from({ length: ahead }, (_, i) => frame + (i + 1) * this.direction);
    pictures.want([frame, ...next.filter((i) => i >= 0 && i < this.video.frames)]);
  }

  private source(name: string, key: string, address: (index: number, near: number) => string): Pictures {
    const known = this.pictures.get(name);
    if (known?.key === key) return known.pictures;
    known?.pictures.close();
    const pictures = new Pictures(address, this.loaded);
    this.pictures.set(name, { key, pictures });
    return pictures;
  }
}
