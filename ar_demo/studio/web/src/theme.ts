/** Dark and light: the system's, until it is switched. */

const KEY = "studio-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");

export const isDark = () => (localStorage.getItem(KEY) ?? (dark.matches ? "dark" : "light")) === "dark";

function apply(): void {
  document.documentElement.dataset.theme = isDark() ? "dark" : "light";
}

export function switchTheme(): void {
  localStorage.setItem(KEY, isDark() ? "light" : "dark");
  apply();
}

/** Applies it, and again when the system's changes. */
export function followTheme(changed: () => void): void {
  apply();
  dark.addEventListener("change", () => {
    apply();
    changed();
  });
}

/** A colour of the style sheet, for drawing on a canvas. */
export const colour = (name: string) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
