/** Icons, 20 px, drawn in the text's colour; decoration beside a label. */

import { svg, html } from "lit-html";

const icon = (path: unknown) =>
  html`<svg class="icon" viewBox="0 0 20 20" width="20" height="20" aria-hidden="true" focusable="false">${path}</svg>`;
const stroke = (d: string) => icon(svg`<path d=${d} fill="none" stroke="currentColor" stroke-width="1.6"
  stroke-linecap="round" stroke-linejoin="round" />`);
const fill = (d: string) => icon(svg`<path d=${d} fill="currentColor" />`);

export const icons = {
  undo: stroke("M7 5 3.5 8.5 7 12M4 8.5h7.5a4 4 0 0 1 0 8H8"),
  redo: stroke("M13 5l3.5 3.5L13 12M16 8.5H8.5a4 4 0 0 0 0 8H12"),
  play: fill("M6 4.2v11.6a.6.6 0 0 0 .9.5l9-5.8a.6.6 0 0 0 0-1l-9-5.8a.6.6 0 0 0-.9.5z"),
  pause: fill("M5.5 4h3v12h-3zM11.5 4h3v12h-3z"),
  first: fill("M4 4h2v12H4zM16 4.6v10.8L7.5 10z"),
  last: fill("M14 4h2v12h-2zM4 4.6v10.8L12.5 10z"),
  back: stroke("M12.5 4.5 7 10l5.5 5.5"),
  on: stroke("M7.5 4.5 13 10l-5.5 5.5"),
  loop: stroke("M4 9a5 5 0 0 1 5-5h6M12.5 1.5 15 4l-2.5 2.5M16 11a5 5 0 0 1-5 5H5M7.5 18.5 5 16l2.5-2.5"),
  sun: stroke("M10 6.5a3.5 3.5 0 1 0 0 7 3.5 3.5 0 0 0 0-7zM10 2v1.5M10 16.5V18M2 10h1.5M16.5 10H18M4.3 4.3l1 1M14.7 14.7l1 1M15.7 4.3l-1 1M5.3 14.7l-1 1"),
  moon: stroke("M16 11.5A6.5 6.5 0 0 1 8.5 4a6.5 6.5 0 1 0 7.5 7.5z"),
  help: stroke("M10 2.5a7.5 7.5 0 1 0 0 15 7.5 7.5 0 0 0 0-15zM7.8 7.8a2.3 2.3 0 1 1 3.4 2c-.8.4-1.2.900-1.2 1.7M10 14v.1"),
  open: stroke("M2.5 15.5v-11h5l1.5 2h8.5v9z"),
  remove: stroke("M4 5.5h12M8 5.5V3.5h4v2M5.5 5.5l.7 11h7.6l.7-11"),
  raise: stroke("M10 16V5M5.5 9.5 10 5l4.5 4.5"),
  add: stroke("M10 4v12M4 10h12"),
  close: stroke("M5 5l10 10M15 5 5 15"),
  check: stroke("M4.5 10.5 8.5 14.5 15.5 6"),
  copy: stroke("M7 7V3.5h9.5V13H13M3.5 7H13v9.5H3.5z"),
  save: stroke("M10 3v9.5M6 9l4 4 4-4M4 16.5h12"),
  turn: stroke("M15.5 7A6.5 6.5 0 1 0 16.5 11M16 3v4.5h-4.5"),
  fit: stroke("M3.5 7V3.5H7M13 3.5h3.5V7M16.5 13v3.5H13M7 16.5H3.5V13"),
  zoomIn: stroke("M9 3.5a5.5 5.5 0 1 0 0 11 5.5 5.5 0 0 0 0-11zM13 13l4 4M9 6.5v5M6.5 9h5"),
  zoomOut: stroke("M9 3.5a5.5 5.5 0 1 0 0 11 5.5 5.5 0 0 0 0-11zM13 13l4 4M6.5 9h5"),
};
