/** Step 3: how the ad looks on the surface; every change is seen at once. */

import { html, nothing } from "lit-html";
import { type Choice, failure, range, select, toggle } from "../controls";
import type { Surface } from "../model";
import type { Studio } from "../studio";

const LABELS: Record<string, Record<string, string>> = {
  fit: { stretch: "Stretched to the surface", contain: "Whole ad, with bars", cover: "Whole surface, ad cropped" },
  playback: { loop: "Again from the start", hold: "Its last picture stays", once: "It goes" },
  blend: { "soft-light": "Soft light" },
  lost: { hold: "Stays where it was", fade: "Fades out", hide: "Vanishes" },
  effect: { replace: "An ad", mosaic: "Mosaic", blur: "Blur", outline: "Outline" },
  grain: { auto: "As the video has", off: "None" },
  softness: { auto: "As the video's", off: "As sharp as it is" },
  first_light: { auto: "As in the marked frame", even: "Even" },
  surface_kind: { print: "A print: light falls on it", screen: "A screen: it shines and mirrors", cloth: "Cloth: its folds are shaded" },
};

const capital = (text: string) => text[0].toUpperCase() + text.slice(1).replaceAll("-", " ");

/** What an effect has no use for, with the values that say nothing. */
const IN_SCENE = { shutter: null, grain: "auto", softness: "auto", first_light: "auto", surface_kind: "print" } as const;
const OF_ADS = { fit: "stretch", playback: "loop", flat: false, ...IN_SCENE } as const;

export function look(studio: Studio, chooseAd: () => void) {
  const surface = studio.surface;
  if (!surface) return nothing;
  const choices = (name: string): Choice[] =>
    (studio.project.choices[name] ?? [surface[name as keyof Surface] as string]).map((value) => ({
      value,
      label: LABELS[name]?.[value] ?? capital(value),
    }));
  type Named = "fit" | "playback" | "blend" | "lost" | "grain" | "softness" | "first_light" | "surface_kind";
  const pick = (label: string, name: Named) =>
    select(label, surface[name], choices(name), (value) => studio.editSurface("", (s) => (s[name] = value)));
  const effect = (value: string) => {
    studio.editSurface("", (s) => {
      s.effect = value;
      if (value !== "replace") Object.assign(s, { ...OF_ADS, ad: null, ad_name: null });
      if (value === "outline") Object.assign(s, { inset: 0, radius: 0 });
    });
    if (value === "replace" && !surface.ad) chooseAd();
  };
  const replaces = surface.effect === "replace";
  return html`
    ${surface.track
      ? nothing
      : html`<p class="note">This surface is not tracked yet: the ad shows in frame ${surface.start} alone.
          <button class="quiet" type="button" @click=${() => studio.go("track")}>Track it</button></p>`}
    ${failure(studio.errors.save)}
    <div class="card">
      <h2>What is shown</h2>
      ${select("Kind", surface.effect, choices("effect"), effect)}
      ${replaces ? html`${pick("Fit", "fit")} ${pick("When a moving ad is over", "playback")}` : nothing}
    </div>
    <div class="card">
      <h2>How it lies there</h2>
      ${range("Opacity", surface.opacity, [0, 1, 0.01], (v) => studio.editSurface("opacity", (s) => (s.opacity = v)), `${Math.round(surface.opacity * 100)} %`)}
      ${pick("Mix with the surface", "blend")}
      ${range("Soft edge", surface.feather, [0, 20, 0.5], (v) => studio.editSurface("feather", (s) => (s.feather = v)), `${surface.feather} px`)}
      ${surface.effect === "outline"
        ? nothing
        : html`${range("Inset", surface.inset, [0, 60, 0.5], (v) => studio.editSurface("inset", (s) => (s.inset = v)), `${surface.inset} px`)}
            ${range("Round corners", surface.radius, [0, 120, 1], (v) => studio.editSurface("radius", (s) => (s.radius = v)), `${surface.radius} px`)}`}
      ${pick("While the surface is lost", "lost")}
    </div>
    ${replaces
      ? html`<div class="card">
          <h2>Part of the scene</h2>
          ${toggle(
            "Light, blur and what passes in front",
            !surface.flat,
            (is) => studio.editSurface("", (s) => Object.assign(s, { flat: !is, ...IN_SCENE })),
            surface.flat ? "The ad is laid on as it is, over everything." : "The ad is lit, blurred and hidden as the surface is.",
          )}
          ${surface.flat
            ? nothing
            : html`${pick("What the surface is", "surface_kind")} ${pick("Shadows and glare on it", "first_light")}
                ${pick("Sharpness", "softness")} ${pick("Grain", "grain")}
                ${toggle("Motion blur as the camera's", surface.shutter === null, (is) => studio.editSurface("", (s) => (s.shutter = is ? null : 180)))}
                ${surface.shutter === null
                  ? nothing
                  : range("Shutter", surface.shutter, [0, 360, 5], (v) => studio.editSurface("shutter", (s) => (s.shutter = v)), `${surface.shutter}°`)}`}
        </div>`
      : nothing}
    <div class="foot"><button class="primary wide" type="button" @click=${() => studio.go("finish")}>Next: finish</button></div>
  `;
}
