/** The list of surfaces: which is being worked on, what lies on it, and what over what. */

import { html, nothing } from "lit-html";
import { adPicture } from "../api";
import { icons } from "../icons";
import type { Surface } from "../model";
import type { Studio } from "../studio";

function status(surface: Surface): string {
  if (!surface.quad && !surface.track) return "not marked yet";
  if (!surface.track) return "marked, not tracked yet";
  if (surface.track.stale) return "changed since it was tracked";
  const { tracked = 0 } = surface.track.counts;
  const all = Object.values(surface.track.counts).reduce((a, b) => a + b, 0);
  return `${tracked} of ${all} frames tracked`;
}

const called = (surface: Surface) =>
  surface.effect !== "replace" ? `Effect: ${surface.effect}` : (surface.ad_name ?? "No ad yet");

export function surfaces(studio: Studio, chooseAd: () => void) {
  const all = studio.project.surfaces;
  return html`<section class="surfaces" aria-label="Surfaces">
    <ol>
      ${all.map((surface, i) => {
        const selected = i === studio.selected;
        const thumb = surface.ad && surface.effect === "replace" ? adPicture(surface.ad, 96) : null;
        return html`<li class=${selected ? "selected" : ""}>
          <button class="pick" type="button" aria-pressed=${selected} @click=${() => studio.select(i)}>
            ${thumb ? html`<img src=${thumb} alt="" width="48" height="36" />` : html`<span class="nothumb">${i + 1}</span>`}
            <span class="names"><strong>${called(surface)}</strong><span>${status(surface)}</span></span>
          </button>
          ${selected
            ? html`<span class="tools">
                ${surface.effect === "replace"
                  ? html`<button class="quiet" type="button" @click=${chooseAd}>${surface.ad ? "Other ad…" : "Choose an ad…"}</button>`
                  : nothing}
                ${i < all.length - 1
                  ? html`<button class="quiet square" type="button" title="Lay over the next" aria-label="Lay surface ${i + 1} over the next"
                      @click=${() => studio.raiseSurface(i)}>${icons.raise}</button>`
                  : nothing}
                ${all.length > 1
                  ? html`<button class="quiet square" type="button" title="Remove" aria-label="Remove surface ${i + 1}"
                      @click=${() => studio.removeSurface(i)}>${icons.remove}</button>`
                  : nothing}
              </span>`
            : nothing}
        </li>`;
      })}
    </ol>
    <button class="quiet" type="button" @click=${() => studio.addSurface()}>${icons.add} Another surface</button>
  </section>`;
}
