// Light or dark: what the person chose, else what the system prefers.

import { recalled, remember } from "./memory.js";

export const BACKGROUNDS = { dark: "#101216", black: "#000000", white: "#ffffff", gray: "#808080" };
const PREFERRED = matchMedia("(prefers-color-scheme: light)");

const isLight = () => (recalled("theme", "") || (PREFERRED.matches ? "light" : "dark")) === "light";

/** The background that pictures stand on where nobody chose one. */
export const firstBackground = () => isLight() ? BACKGROUNDS.white : BACKGROUNDS.dark;

/** Paint the page; `changed(before)` hears the background that belonged to the theme before. */
export function followTheme(changed) {
  let before = firstBackground();
  const paint = () => {
    document.documentElement.dataset.theme = isLight() ? "light" : "dark";
    if (before !== firstBackground()) changed(before);
    before = firstBackground();
  };
  PREFERRED.addEventListener("change", paint);
  paint();
  return () => {
    remember("theme", isLight() ? "dark" : "light");
    paint();
  };
}
