/** Step 2: through the whole video, and where a hand has to help. */

import { html, nothing } from "lit-html";
import { failure, notes, range, toggle } from "../controls";
import { icons } from "../icons";
import type { Surface, Task, Track } from "../model";
import type { Studio } from "../studio";
import { clock, counted, doubtful, stageInWords } from "../words";

export function progress(task: Task, stop: () => void) {
  const { stage, done, total } = task;
  const share = total ? Math.min(1, done / total) : null;
  return html`<div class="progress" role="group" aria-label="Progress">
    <p><strong>${stageInWords(stage)}</strong> <span>${total ? `${done} of ${total}` : done || ""}</span></p>
    <progress aria-label=${stageInWords(stage)} max="1" .value=${share ?? 0}></progress>
    <button class="quiet" type="button" @click=${stop}>Stop</button>
  </div>`;
}

export function track(studio: Studio) {
  const surface = studio.surface;
  if (!surface) return nothing;
  const running = studio.isBusy && studio.task?.kind === "track";
  const known = studio.tracks.of(surface);
  const all = studio.project.surfaces;
  const markable = all.every((s) => s.quad && (s.ad || s.effect !== "replace"));
  const untracked = all.some((s) => !s.track || s.track.stale);
  return html`
    <div class="card">
      ${running
        ? html`<h2>Tracking</h2>
            ${progress(studio.task!, () => void studio.stop())}
            ${toggle("Follow in the picture", studio.following, (is) => {
              studio.following = is;
              studio.changed();
            })}`
        : surface.track && known
          ? summary(studio, surface, known)
          : studio.project.can_go_on
            ? html`<h2>Stopped</h2><p>What was tracked is kept: tracking goes on from there, unless a surface is changed.</p>`
            : html`<h2>Not tracked yet</h2>
              <p>${markable ? "The surface is followed through the whole video." : "First mark the surface, in step 1."}</p>`}
      ${failure(studio.errors.track)}
    </div>
    ${running ? nothing : html`${keyframes(studio, surface)} ${options(studio)}`}
    ${running
      ? nothing
      : html`<div class="foot">
          ${untracked
            ? html`<button class="primary wide" type="button" ?disabled=${!markable || studio.isBusy} @click=${() => void studio.track()}>
                ${studio.project.can_go_on ? "Go on tracking" : surface.track ? "Track again" : "Track"}
              </button>`
            : html`<button class="primary wide" type="button" @click=${() => studio.go("look")}>Next: look at it</button>`}
        </div>`}
  `;
}

function summary(studio: Studio, surface: Surface, track: Track) {
  const { tracked = 0, held = 0, lost = 0 } = surface.track!.counts;
  const bad = doubtful(track);
  const all = tracked + held + lost;
  const others = [held ? `${held} held` : "", lost ? `${lost} lost` : ""].filter(Boolean).join(", ");
  return html`<h2>${surface.track!.stale ? "Changed since it was tracked" : `Tracked in ${tracked} of ${counted(all, "frame")}`}</h2>
    ${surface.track!.stale
      ? html`<p>What is shown is the old track: track again.</p>`
      : html`<p>${others ? `The rest: ${others}.` : "It was seen well in all of them."}</p>`}
    ${bad.length
      ? html`<h3>Worth a look</h3>
          <p class="hint">Where the outline is off there, drag its corners: that frame becomes a keyframe, and what is next to it is tracked again.</p>
          <ul class="chips">
            ${bad.map((b) => html`<li><button type="button" class="chip ${b.why}" @click=${() => studio.seek(Math.floor((b.first + b.last) / 2))}>
              ${b.first === b.last ? b.first : `${b.first}–${b.last}`} <span>${b.why}</span></button></li>`)}
          </ul>`
      : nothing}
    ${notes(`${counted(track.warnings.length, "note")} of the tracker`, track.warnings)}`;
}

function keyframes(studio: Studio, surface: Surface) {
  if (!surface.keyframes.length) return nothing;
  return html`<div class="card">
    <h2>Keyframes</h2>
    <ul class="plain">
      ${surface.keyframes.map((k) => html`<li>
        <button class="quiet" type="button" @click=${() => studio.seek(k.frame)}>Frame ${k.frame}</button>
        <span>${clock(studio.video.times[k.frame] ?? 0)}</span>
        <button class="quiet square" type="button" aria-label="Remove the keyframe of frame ${k.frame}"
          @click=${() => studio.removeKeyframe(k.frame)}>${icons.remove}</button>
      </li>`)}
    </ul>
  </div>`;
}

function options(studio: Studio) {
  const { tracking, video } = studio.project;
  const [begin, end] = part(tracking.time);
  const set = (first: string, last: string) =>
    studio.edit("", (doc) => (doc.tracking.time = first || last ? `${first}..${last}` : null));
  return html`<details class="card" ?open=${!!tracking.time}>
    <summary>Which part, how smooth</summary>
    <p class="hint">${tracking.time ? `From ${begin || "the first frame"} to ${end || "the last frame"}; the rest stays as it is.` : `All ${counted(video.frames, "frame")}.`}</p>
    <div class="row">
      <button class="quiet" type="button" @click=${() => set(`${studio.frame}`, end)}>Begin at frame ${studio.frame}</button>
      <button class="quiet" type="button" @click=${() => set(begin, `${studio.frame}`)}>End at frame ${studio.frame}</button>
      ${tracking.time ? html`<button class="quiet" type="button" @click=${() => set("", "")}>Whole video</button>` : nothing}
    </div>
    ${range("Smoothing", tracking.smooth, [0, 4, 0.1], (v) => studio.edit("smooth", (doc) => (doc.tracking.smooth = v)), tracking.smooth.toFixed(1))}
  </details>`;
}

function part(time: string | null): [string, string] {
  const [begin = "", end = ""] = time?.split("..") ?? [];
  return [begin, end];
}
