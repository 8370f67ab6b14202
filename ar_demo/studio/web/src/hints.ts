/** The line above the picture: what to do next, or what went wrong, with a button where one helps. */

import { html, nothing } from "lit-html";
import { CORNER_NAMES } from "./geometry";
import type { Corners } from "./model";
import type { Studio } from "./studio";

interface Hint {
  text: string;
  actions?: [string, () => void][];
}

function next(studio: Studio): Hint {
  const { surface, frame, step } = studio;
  if (studio.message) return { text: studio.message };
  if (!surface) return { text: "" };
  if (studio.tool !== "corners") {
    const what = studio.tool === "region" ? "the region that is tracked" : "what shall be left out";
    return { text: `Click the corners of ${what}; click the first one again, or press Enter, to close it.` };
  }
  if (studio.vertices) {
    const text = "Drag the corners; a small dot between two makes another one, Delete removes one.";
    return { text, actions: [["Done", () => studio.editShape(null)]] };
  }
  if (studio.isBusy && studio.task?.kind === "track") return { text: "Tracking: the outline shows what was found." };
  if (studio.isBusy && studio.task?.kind === "find") return { text: "Looking for the surface in the whole video." };
  if (studio.isPlacing) {
    const n = studio.placing.length;
    const whose = surface.ad ? "the ad's" : "the surface's";
    const undo: [string, () => void][] = n ? [["Start over", () => {
      studio.placing = [];
      studio.changed();
    }]] : [];
    const or = !n && studio.shownProposals.length ? ", or take a rectangle by its number" : "";
    return { text: `Click ${whose} ${CORNER_NAMES[n]} corner${or}.`, actions: undo };
  }
  if (step === "mark") {
    if (frame === surface.start) return { text: "Drag the corners until they fit; the loupe shows single pixels." };
    return {
      text: `The corners are marked in frame ${surface.start}.`,
      actions: [
        ["Go there", () => studio.seek(surface.start)],
        ["Mark them here instead", () => studio.markHere()],
      ],
    };
  }
  if (step === "track") return ofTrack(studio);
  if (step === "look") return { text: viewHint(studio) };
  return { text: studio.view === "composite" ? "This is what will be written: play it." : viewHint(studio) };
}

function ofTrack(studio: Studio): Hint {
  const { surface, frame } = studio;
  const track = surface && studio.tracks.of(surface);
  if (!surface || !track) return { text: "" };
  if (studio.view !== "frame") return { text: viewHint(studio) };
  if (frame === surface.start) return { text: "Here the surface was marked. Play, or click the time line, to check the others." };
  const keyframe = surface.keyframes.find((k) => k.frame === frame);
  if (keyframe) return { text: `A keyframe: these corners were given by hand.${surface.track?.stale ? "" : beside(keyframe.corners, track.corners[frame])}` };
  if (!studio.handles)
    return { text: "The surface is lost in this frame.", actions: [["Mark it here", () => studio.keyframeHere()]] };
  return { text: "Is the outline off here? Drag its corners: that makes a keyframe." };
}

/** How far the track passes from a keyframe, which is a measurement among others. */
function beside(given: Corners, found: Corners | null): string {
  const px = found ? Math.max(...given.map(([x, y], i) => Math.hypot(x - found[i][0], y - found[i][1]))) : 0;
  return px > 0.5 ? ` The track passes ${px.toFixed(1)} px beside them (dashed): what was measured is surer.` : "";
}

function viewHint(studio: Studio): string {
  if (studio.view === "wipe") return "Left of the line the video, right of it the result: drag the line, or play.";
  if (studio.view === "steady") return "The surface stands still: what moves inside it is error.";
  return "";
}

export function hint(studio: Studio) {
  const error = studio.connected ? studio.errors.picture : "The server does not answer; what was saved is safe. Trying again…";
  const { text, actions = [] } = next(studio);
  return html`<div class="hintbar">
    ${error
      ? html`<p class="failure" role="alert">${error}</p>`
      : html`<p role="status">${text}</p>
          ${actions.length ? actions.map(([label, act]) => html`<button class="quiet" type="button" @click=${act}>${label}</button>`) : nothing}`}
  </div>`;
}
