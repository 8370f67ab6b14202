/** Form controls that all panels use: each with its label, changed at once. */

import { html, nothing, type TemplateResult } from "lit-html";
import { live } from "lit-html/directives/live.js";

export interface Choice {
  value: string;
  label: string;
}

const id = (label: string) => `f-${label.toLowerCase().replace(/[^a-z]+/g, "-")}`;

export function select(label: string, value: string, choices: Choice[], change: (value: string) => void): TemplateResult {
  return html`<div class="field">
    <label for=${id(label)}>${label}</label>
    <select id=${id(label)} @change=${(e: Event) => change((e.target as HTMLSelectElement).value)}>
      ${choices.map((c) => html`<option value=${c.value} ?selected=${c.value === value} .selected=${live(c.value === value)}>${c.label}</option>`)}
    </select>
  </div>`;
}

export function range(
  label: string,
  value: number,
  [min, max, step]: [number, number, number],
  change: (value: number) => void,
  shown = `${value}`,
): TemplateResult {
  return html`<div class="field">
    <label for=${id(label)}>${label}</label>
    <div class="range">
      <input id=${id(label)} type="range" min=${min} max=${max} step=${step} .value=${live(`${value}`)}
        @input=${(e: Event) => change(Number((e.target as HTMLInputElement).value))} />
      <output for=${id(label)}>${shown}</output>
    </div>
  </div>`;
}

/** A field to type into. What is being typed stays when the page is drawn again, so the value is set when it changes,
 * and when something was typed.
 * @param change takes what was typed; what it returns, or else what was there, is shown. */
export function typed(
  attributes: { id?: string; label?: string; kind?: "number" | "text"; min?: number; max?: number; step?: string; placeholder?: string },
  value: string,
  change: (text: string) => string | void,
): TemplateResult {
  const { id, label, kind = "number", min, max, step, placeholder } = attributes;
  return html`<input id=${id ?? nothing} aria-label=${label ?? nothing} type=${kind} min=${min ?? nothing} max=${max ?? nothing}
    step=${step ?? nothing} placeholder=${placeholder ?? nothing} spellcheck="false" .value=${value}
    @change=${(event: Event) => {
      const input = event.target as HTMLInputElement;
      input.value = change(input.value) ?? value;
    }} />`;
}

export function toggle(label: string, value: boolean, change: (value: boolean) => void, hint = ""): TemplateResult {
  return html`<div class="toggle">
    <label>
      <input type="checkbox" role="switch" .checked=${live(value)}
        @change=${(e: Event) => change((e.target as HTMLInputElement).checked)} />
      <span>${label}</span>
    </label>
    ${hint ? html`<p class="hint">${hint}</p>` : nothing}
  </div>`;
}

/** What the server has to say beside, folded away. */
export function notes(title: string, texts: string[]): TemplateResult | typeof nothing {
  if (!texts.length) return nothing;
  return html`<details>
    <summary>${title}</summary>
    <ul class="notes">${texts.map((text) => html`<li>${text}</li>`)}</ul>
  </details>`;
}

export const failure = (text: string | undefined) => (text ? html`<p class="failure" role="alert">${text}</p>` : nothing);
