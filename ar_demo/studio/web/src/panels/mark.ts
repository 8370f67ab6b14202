/** Step 1: where the surface is, and what of it is tracked. */

import { html, nothing } from "lit-html";
import { failure, notes, toggle, typed } from "../controls";
import { chooseFile } from "../dialogs";
import { CORNER_NAMES } from "../geometry";
import { icons } from "../icons";
import type { Point, Surface } from "../model";
import type { Studio } from "../studio";
import { progress } from "./track";

export function mark(studio: Studio, chooseAd: () => void) {
  const surface = studio.surface;
  if (!surface) return nothing;
  const needsAd = !surface.ad && surface.effect === "replace";
  const ready = studio.project.surfaces.every((s) => s.quad && (s.ad || s.effect !== "replace"));
  return html`
    ${needsAd
      ? html`<div class="card">
          <h2>What shall be shown?</h2>
          <p>A picture or a video that is laid on the surface.</p>
          <button class="primary" type="button" @click=${chooseAd}>Choose an ad…</button>
        </div>`
      : nothing}
    ${failure(studio.errors.ad)}
    <div class="card">${surface.quad ? marked(studio, surface) : unmarked(studio)}</div>
    ${surface.quad ? regions(studio, surface) : nothing} ${notes("Notes on the video", studio.video.warnings)}
    <div class="foot">
      ${failure(studio.errors.track)}
      <button class="primary wide" type="button" ?disabled=${!ready || studio.isBusy} @click=${() => void studio.track()}>
        ${studio.project.surfaces.length > 1 ? "Track the surfaces" : "Track the surface"}
      </button>
      ${ready ? nothing : html`<p class="hint">${blocker(studio)}</p>`}
    </div>
  `;
}

function blocker(studio: Studio): string {
  const all = studio.project.surfaces;
  const lacking = all.findIndex((s) => !s.quad);
  const which = all.length > 1 ? `surface ${(lacking >= 0 ? lacking : all.findIndex((s) => !s.ad)) + 1}` : "the surface";
  return lacking >= 0 ? `First mark the corners of ${which}.` : `First choose an ad for ${which}.`;
}

function unmarked(studio: Studio) {
  const found = studio.shownProposals.length;
  const { task } = studio;
  if (studio.isBusy && task?.kind === "find")
    return html`<h2>Where is the surface?</h2>${progress(task, () => void studio.stop())}`;
  return html`<h2>Where is the surface?</h2>
    <p>
      Click its four corners in the picture, beginning with the one where the ad's top left shall
      be${found ? ", or take one of the dashed rectangles by its number" : ""}.
    </p>
    <p class="hint">Choose a frame in which all of it is seen well: it need not be the first.</p>
    ${toggle("Snap to edges", studio.snapping, (is) => {
      studio.snapping = is;
      studio.changed();
    })}
    ${failure(studio.errors.find)}
    ${studio.found.length
      ? html`<button class="quiet" type="button" @click=${() => studio.takeFound()}>Take it where it was found</button>`
      : nothing}
    <div class="row">
      <button class="quiet" type="button" ?disabled=${studio.isBusy} @click=${() => void findBy(studio)}
        title="A picture of what the surface shows: it is looked for in the whole video">Find it by a picture…</button>
      <button class="quiet" type="button" @click=${() => studio.markMiddle()}>Begin with a rectangle in the middle</button>
    </div>`;
}

async function findBy(studio: Studio): Promise<void> {
  const file = await chooseFile("Choose a picture of what the surface shows", ["picture"]);
  if (file) await studio.find(file.id);
}

function marked(studio: Studio, surface: Surface) {
  const here = studio.frame === surface.start;
  const place = (i: number, axis: 0 | 1, text: string) => {
    const value = parseFloat(text);
    if (!Number.isFinite(value)) return;
    studio.editSurface(`type-${i}-${axis}`, (s) => {
      const corner: Point = [...s.quad![i]];
      corner[axis] = value;
      s.quad![i] = corner;
    });
    return value.toFixed(1);
  };
  const number = (i: number, axis: 0 | 1) =>
    typed({ label: `${CORNER_NAMES[i]}, ${"xy"[axis]}`, step: "0.1" }, surface.quad![i][axis].toFixed(1), (text) => place(i, axis, text));
  return html`<h2>Marked in frame ${surface.start}</h2>
    ${here
      ? html`<p>Drag the corners, or press arrow keys on one. The ad shows which way up it will be.</p>`
      : html`<p><button class="quiet" type="button" @click=${() => studio.seek(surface.start)}>Go to frame ${surface.start}</button></p>`}
    <table class="corners">
      <thead><tr><th scope="col">Corner</th><th scope="col">x, px</th><th scope="col">y, px</th></tr></thead>
      <tbody>${CORNER_NAMES.map((name, i) => html`<tr><th scope="row">${name}</th><td>${number(i, 0)}</td><td>${number(i, 1)}</td></tr>`)}</tbody>
    </table>
    ${toggle("Snap to edges", studio.snapping, (is) => {
      studio.snapping = is;
      studio.changed();
    })}
    <div class="row">
      <button class="quiet" type="button" @click=${() => studio.turn()}>${icons.turn} Turn the ad</button>
      <button class="quiet" type="button" @click=${() => studio.unmark()}>Mark anew</button>
    </div>`;
}

function regions(studio: Studio, surface: Surface) {
  const drawing = studio.tool !== "corners";
  const drop = (change: (s: Surface) => void) => () => {
    studio.editShape(null);
    studio.editSurface("", change);
  };
  return html`<details class="card" ?open=${drawing || !!surface.region || surface.exclude.length > 0}>
    <summary>What is tracked</summary>
    <p class="hint">
      The surface itself, and what lies around it on the same plane. Draw a region where more or less of it should
      count, or leave out what moves or shines.
    </p>
    ${drawing
      ? html`<div class="row">
          <button class="primary" type="button" ?disabled=${studio.polygon.length < 3} @click=${() => studio.closePolygon()}>Close it</button>
          <button class="quiet" type="button" @click=${() => studio.use("corners")}>Cancel</button>
        </div>`
      : html`<div class="row">
          <button class="quiet" type="button" @click=${() => studio.use("region")}>Draw a region</button>
          <button class="quiet" type="button" @click=${() => studio.use("exclude")}>Leave something out</button>
        </div>`}
    <ul class="plain">
      ${surface.region
        ? html`<li>Region of ${surface.region.length} corners ${edit(studio, -1)}
            <button class="quiet" type="button" @click=${drop((s) => (s.region = null))}>Remove</button></li>`
        : nothing}
      ${surface.exclude.map((polygon, i) => html`<li>Left out: ${polygon.length} corners
        ${edit(studio, i)}
        <button class="quiet" type="button" @click=${drop((s) => s.exclude.splice(i, 1))}>Remove</button></li>`)}
    </ul>
  </details>`;
}

function edit(studio: Studio, shape: number) {
  const is = studio.shape === shape;
  return html`<button class="quiet" type="button" aria-pressed=${is} @click=${() => studio.editShape(is ? null : shape)}>
    ${is ? "Done" : "Edit"}</button>`;
}
