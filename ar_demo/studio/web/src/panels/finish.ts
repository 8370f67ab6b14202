/** Step 4: the file, and what makes it elsewhere. */

import { html, nothing } from "lit-html";
import { outputAddress } from "../api";
import { type Choice, failure, notes, select, typed } from "../controls";
import { icons } from "../icons";
import type { Rendering } from "../model";
import type { Studio } from "../studio";
import { bytes } from "../words";
import { progress } from "./track";

const LABELS: Record<string, Record<string, string>> = {
  audio: { source: "The video's", ad: "The ad's", mix: "Both, mixed", none: "None" },
  depth: { auto: "As is usual", source: "As the video has", "8": "8 bits", "10": "10 bits", "12": "12 bits" },
};

let copied = 0;

export function finish(studio: Studio) {
  const { project, task } = studio;
  const { rendering, choices } = project;
  const running = studio.isBusy && task?.kind === "render";
  const name = studio.outputName ?? project.output;
  const untracked = project.surfaces.some((s) => !s.track);
  const stale = project.surfaces.some((s) => s.track?.stale);
  const list = (field: string, any = ""): Choice[] => [
    ...(any ? [{ value: "", label: any }] : []),
    ...(choices[field] ?? []).map((value) => ({ value, label: LABELS[field]?.[value] ?? value })),
  ];
  const set = (change: (r: Rendering) => void) => studio.edit("", (doc) => change(doc.rendering));
  return html`
    ${studio.outputs.length && !running
      ? html`<div class="card">
          <h2>Ready</h2>
          <ul class="plain">
            ${studio.outputs.map((o) => html`<li><span class="grow">${o.name} <small>${bytes(o.bytes)}</small></span>
              <a class="button" href=${outputAddress(o.id)} download=${o.name}>${icons.save} Download</a></li>`)}
          </ul>
          <p class="hint">${studio.outputs.length > 1 ? "They lie" : "It lies"} beside the video as well.</p>
          ${notes("Notes on it", task?.kind === "render" && task.state === "done" ? task.warnings : [])}
        </div>`
      : nothing}
    <div class="card">
      <h2>Render the video</h2>
      ${running
        ? progress(task!, () => void studio.stop())
        : html`
            <div class="field"><label for="output-name">File name</label>
              ${typed({ id: "output-name", kind: "text" }, name, (text) => studio.nameOutput(text))}</div>
            ${select("Sound", rendering.audio, list("audio"), (v) => set((r) => (r.audio = v)))}
            <details><summary>Codec and quality</summary>
              ${choices.codec ? select("Codec", rendering.codec ?? "", list("codec", "The usual one"), (v) => set((r) => (r.codec = v || null))) : nothing}
              <div class="field"><label for="crf">Quality (CRF; lower is better)</label>
                ${typed({ id: "crf", min: 0, max: 63, placeholder: "usual" }, `${rendering.crf ?? ""}`, (text) => {
                  set((r) => (r.crf = text === "" ? null : parseFloat(text)));
                  return text;
                })}</div>
              ${select("Bits", `${rendering.depth}`, list("depth"), (v) => set((r) => (r.depth = v)))}
            </details>
            ${failure(studio.errors.save)} ${failure(studio.errors.finish)}
            ${stale ? html`<p class="note">A surface has changed since it was tracked. <button class="quiet" type="button" @click=${() => studio.go("track")}>Track it again</button></p>` : nothing}
            ${untracked
              ? html`<p class="note">A surface is not tracked yet. <button class="quiet" type="button" @click=${() => studio.go("track")}>Track it</button></p>`
              : nothing}
            ${studio.mayOverwrite
              ? html`<button class="primary wide" type="button" @click=${() => void studio.render(true)}>Replace ${name}</button>`
              : html`<button class="primary wide" type="button" ?disabled=${untracked || studio.isBusy} @click=${() => void studio.render()}>Render</button>`}
          `}
    </div>
    <div class="card">
      <h2>Or render elsewhere</h2>
      <p>All that you do here is kept in <strong>${project.job_file}</strong>, beside the video. This does the same on the command line:</p>
      <pre class="command" tabindex="0" role="region" aria-label="Command line">${project.command}</pre>
      <button class="quiet" type="button" @click=${() => void copy(studio)}>${icons.copy} ${copied > Date.now() ? "Copied" : "Copy the command"}</button>
    </div>
  `;
}

async function copy(studio: Studio): Promise<void> {
  try {
    await navigator.clipboard.writeText(studio.project.command);
    copied = Date.now() + 2000;
    setTimeout(() => studio.changed(), 2100);
    studio.changed();
  } catch {
    studio.fail("finish", "The browser does not let the command be copied: select it and press Ctrl C.");
  }
}
