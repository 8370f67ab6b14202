/** Numbers in words. */

import type { Track, Video } from "./model";

export const counted = (n: number, noun: string) => `${n} ${noun}${n === 1 ? "" : "s"}`;

export function clock(seconds: number): string {
  const minutes = Math.floor(seconds / 60);
  return `${minutes}:${(seconds - 60 * minutes).toFixed(2).padStart(5, "0")}`;
}

export function bytes(n: number): string {
  return n < 1e6 ? `${Math.max(1, Math.round(n / 1e3))} kB` : `${(n / 1e6).toFixed(1)} MB`;
}

export const stateName = (letter: string | undefined) =>
  ({ t: "tracked", h: "held", l: "lost" })[letter ?? ""] ?? "not tracked";

const STAGES: Record<string, string> = {
  find: "Looking for the surface",
  track: "Following the surface",
  "track back": "Following it backward",
  check: "Checking what contradicts itself",
  "check back": "Checking it backward",
  "look again": "Collecting what was seen best",
  render: "Drawing and writing",
};

/** What the server is doing, for people. */
export function stageInWords(stage: string): string {
  if (!stage) return "Beginning";
  const again = stage.startsWith("again: ");
  const name = again ? stage.slice(7) : stage;
  return (STAGES[name] ?? name) + (again ? ", once more" : "");
}

/** What a reader of the time line hears of a frame. */
export function frameInWords(video: Video, frame: number, track: Track | null): string {
  const place = `frame ${frame} of ${video.frames - 1}, ${clock(video.times[frame] ?? 0)}`;
  if (!track || frame < track.first || frame > track.last) return place;
  return `${place}, ${stateName(track.states[frame])}, confidence ${(track.confidence[frame] ?? 0).toFixed(2)}`;
}

/** Stretches of frames that are worth a look: first and last frame, and why. */
export function doubtful(track: Track): { first: number; last: number; why: string }[] {
  const UNSURE = 3; // px of deviation
  const found: { first: number; last: number; why: string }[] = [];
  for (let i = track.first; i <= track.last; i++) {
    const deviation = track.deviation[i];
    const why =
      track.states[i] === "l"
        ? "lost"
        : track.states[i] === "h"
          ? "held"
          : deviation !== null && deviation > UNSURE
            ? "unsure"
            : null;
    const last = found.at(-1);
    if (!why) continue;
    if (last && last.last === i - 1 && last.why === why) last.last = i;
    else found.push({ first: i, last: i, why });
  }
  return found.sort((a, b) => b.last - b.first - (a.last - a.first)).slice(0, 8);
}
