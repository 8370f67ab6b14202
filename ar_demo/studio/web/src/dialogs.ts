/** Dialogs: which file, and which keys. */

import { html, nothing, render } from "lit-html";
import * as api from "./api";
import { failure } from "./controls";
import { icons } from "./icons";
import { KEYS } from "./keys";
import type { Entry, Listing } from "./model";
import { bytes } from "./words";

function dialog(title: string): { element: HTMLDialogElement; draw: (content: unknown) => void } {
  const element = document.createElement("dialog");
  document.body.append(element);
  element.setAttribute("aria-label", title);
  element.addEventListener("close", () => element.remove());
  element.addEventListener("click", (event) => {
    if (event.target === element) element.close(); // beside it
  });
  const draw = (content: unknown) =>
    render(
      html`<div class="sheet">
        <header><h2>${title}</h2>
          <button class="quiet square" type="button" aria-label="Close" @click=${() => element.close()}>${icons.close}</button></header>
        ${content}
      </div>`,
      element,
    );
  return { element, draw };
}

/** Lets a file be chosen among those that the server shows; ads can come from this computer too.
 * @returns null where none was chosen. */
export function chooseFile(title: string, kinds: string[]): Promise<(Entry & { kind: string }) | null> {
  return new Promise((resolve) => {
    const { element, draw } = dialog(title);
    let chosen: (Entry & { kind: string }) | null = null;
    const takes = kinds.includes("ad") ? "image/*,video/*" : kinds.includes("picture") ? "image/*" : "";
    let [listing, error, busy] = [null as Listing | null, "", false];
    const choose = (file: Entry, kind: string) => {
      chosen = { ...file, kind };
      element.close();
    };
    const enter = async (folder?: string) => {
      try {
        const lists = await Promise.all(kinds.map((kind) => api.files(kind, folder)));
        const files = lists.flatMap((list, i) => list.files.map((file) => ({ ...file, kind: kinds[i] })));
        listing = { ...lists[0], files };
        error = "";
      } catch (problem) {
        error = (problem as Error).message;
      }
      show();
    };
    const send = async (file: File | undefined) => {
      if (!file) return;
      [busy, error] = [true, ""];
      show();
      try {
        choose(await api.upload(file), "ad");
      } catch (problem) {
        [busy, error] = [false, (problem as Error).message];
        show();
      }
    };
    const drop = (event: DragEvent) => {
      event.preventDefault();
      void send(event.dataTransfer?.files[0]);
    };
    const show = () =>
      draw(html`
        ${takes
          ? html`<label class="drop" @dragover=${(e: Event) => e.preventDefault()} @drop=${drop}>
              <input class="unseen" type="file" accept=${takes} ?disabled=${busy}
                @change=${(e: Event) => void send((e.target as HTMLInputElement).files?.[0])} />
              ${icons.add}<span>${busy ? "Sending…" : `Choose a picture ${takes.includes("video") ? "or a video " : ""}of yours, or drop it here`}</span>
            </label>`
          : nothing}
        ${failure(error)}
        ${listing
          ? html`${listing.folder ? html`<p class="hint">In the folder ${listing.folder.name}</p>` : nothing}
              <ul class="files">
                ${listing.parent ? html`<li><button type="button" @click=${() => void enter(listing!.parent!.id)}>${icons.raise}<span>Folder above</span></button></li>` : nothing}
                ${listing.folders.map((f) => html`<li><button type="button" @click=${() => void enter(f.id)}>${icons.open}<span>${f.name}</span></button></li>`)}
                ${listing.files.map((f) => html`<li><button type="button" @click=${() => choose(f, f.kind ?? kinds[0])}>
                  ${takes ? html`<img src=${api.adPicture(f.id, 96)} alt="" width="56" height="42" loading="lazy" />` : nothing}
                  <span class="grow">${f.name}</span><small>${f.bytes ? bytes(f.bytes) : ""}</small></button></li>`)}
                ${listing.files.length ? nothing : html`<li class="hint">There is no such file in this folder.</li>`}
              </ul>`
          : nothing}
      `);
    element.addEventListener("close", () => resolve(chosen));
    show();
    element.showModal();
    void enter();
  });
}

export function help(): void {
  const { element, draw } = dialog("Keys");
  draw(html`<dl class="keys">${KEYS.map(([key, does]) => html`<div><dt>${key}</dt><dd>${does}</dd></div>`)}</dl>`);
  element.showModal();
}
