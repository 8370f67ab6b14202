/** The keyboard: each key with what it does, which the help shows. */

import type { Player } from "./player";
import { STEPS, type Studio } from "./studio";

interface Zoomable {
  zoom(factor: number): void;
  fit(): void;
}

export const KEYS: [string, string][] = [
  ["← →", "a frame back, on; with Shift ten"],
  ["Home, End", "first, last frame"],
  ["Space, K", "play, stop"],
  ["J, L", "play backward, forward; again for faster"],
  [", .", "the keyframe before, after"],
  ["1 2 3 4", "mark, track, look, finish"],
  ["+ − 0", "zoom in, out, whole picture; also the wheel, or two fingers"],
  ["Ctrl Z, Ctrl Shift Z", "undo, redo"],
  ["Arrows on a corner", "move it by 0.1 px; with Shift by 1 px"],
  ["Alt while dragging", "no snapping"],
  ["Enter, Esc", "close a polygon, leave it"],
  ["Del on its corner", "remove that; Enter on a dot between two adds one"],
];

export function listen(studio: Studio, player: Player, stage: Zoomable, help: () => void): void {
  const jump = (direction: number) => {
    const surface = studio.surface;
    if (!surface) return;
    const all = [surface.start, ...surface.keyframes.map((k) => k.frame)].sort((a, b) => (a - b) * direction);
    const next = all.find((f) => (f - studio.frame) * direction > 0);
    if (next !== undefined) studio.seek(next);
  };
  const seek = (frame: number) => {
    player.stop();
    studio.following = false;
    studio.seek(frame);
  };
  const actions: Record<string, (event: KeyboardEvent) => void> = {
    ArrowLeft: (e) => seek(studio.frame - (e.shiftKey ? 10 : 1)),
    ArrowRight: (e) => seek(studio.frame + (e.shiftKey ? 10 : 1)),
    Home: () => seek(0),
    End: () => seek(studio.video.frames - 1),
    " ": () => player.toggle(),
    k: () => player.toggle(),
    j: () => player.push(-1),
    l: () => player.push(1),
    ",": () => jump(-1),
    ".": () => jump(1),
    "+": () => stage.zoom(1.5),
    "=": () => stage.zoom(1.5),
    "-": () => stage.zoom(1 / 1.5),
    "0": () => stage.fit(),
    "?": () => help(),
    Enter: () => studio.closePolygon(),
    Escape: () => {
      studio.placing = [];
      studio.use("corners");
    },
  };
  STEPS.forEach((step, i) => (actions[`${i + 1}`] = () => studio.go(step)));

  document.addEventListener("keydown", (event) => {
    const target = event.target as HTMLElement;
    if (document.querySelector("dialog[open]")) return;
    if (event.ctrlKey || event.metaKey) {
      const key = event.key.toLowerCase();
      if (target.matches("input[type=text], input[type=number]") || (key !== "z" && key !== "y")) return;
      event.preventDefault();
      if (key === "y" || event.shiftKey) studio.redo();
      else studio.undo();
      return;
    }
    const onRange = target.matches("input[type=range]") && !/^(Arrow|Home|End|Page)/.test(event.key);
    if (event.altKey || (target.matches("input, select, textarea") && !onRange)) return;
    if ((event.key === " " || event.key === "Enter") && target.closest("button, a, summary")) return;
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action(event);
  });
}
