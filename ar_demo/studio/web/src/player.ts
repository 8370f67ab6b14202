/** Plays frames one after another, none left out: a frame stays until the next one's picture is here. */

import type { Studio } from "./studio";

const FASTEST = 8;
const AROUND = 1; // s before and after, where only what is near is played in a loop

export class Player {
  private pace = 0;
  private due = 0;
  private range: [number, number] = [0, 0];
  private drawn = -1;

  constructor(private readonly studio: Studio) {}

  /** Frames of the video for a frame's time: negative backward, 0 stands. */
  get speed(): number {
    return this.pace;
  }

  set speed(speed: number) {
    this.pace = speed;
    this.studio.isPlaying = speed !== 0;
  }

  /** K and space. */
  toggle(): void {
    if (this.speed) this.stop();
    else this.start(1);
  }

  stop(): void {
    this.speed = 0;
    this.studio.changed();
  }

  /** J and L: again for twice the speed. */
  push(direction: 1 | -1): void {
    this.start(Math.sign(this.speed) === direction ? Math.min(FASTEST, Math.abs(this.speed) * 2) * direction : direction);
  }

  /** The stage has a new picture. */
  shown(frame: number): void {
    this.drawn = frame;
  }

  private start(speed: number): void {
    const stood = !this.speed;
    this.speed = speed;
    if (!stood) return this.studio.changed();
    this.range = this.within();
    this.drawn = this.studio.frame;
    this.due = performance.now();
    this.studio.following = false;
    requestAnimationFrame(this.tick);
    this.studio.changed();
  }

  /** First and last frame that are played. */
  private within(): [number, number] {
    const { video, frame, looping, surface, tracks, step } = this.studio;
    const track = surface && tracks.of(surface);
    let [first, last] = step !== "mark" && track ? [track.first, track.last] : [0, video.frames - 1];
    if (looping) {
      const at = video.times[frame] ?? 0;
      const near = video.times.flatMap((t, i) => (Math.abs(t - at) <= AROUND ? [i] : []));
      [first, last] = [Math.max(first, near[0]), Math.min(last, near.at(-1)!)];
    }
    return last > first && frame >= first && frame <= last ? [first, last] : [0, video.frames - 1];
  }

  private readonly tick = (now: number): void => {
    if (!this.speed) return;
    requestAnimationFrame(this.tick);
    const { studio } = this;
    if (now < this.due || this.drawn !== studio.frame) return;
    const [first, last] = this.range;
    const step = Math.sign(this.speed) * Math.max(1, Math.floor(Math.abs(this.speed) / 2));
    let next = studio.frame + step;
    if (next > last) next = first;
    if (next < first) next = last;
    const pace = Math.abs(step) / studio.video.rate / Math.abs(this.speed);
    this.due = Math.max(now - 50, this.due + 1000 * pace);
    studio.seek(next);
    studio.sources.direction = Math.sign(this.speed);
  };
}
