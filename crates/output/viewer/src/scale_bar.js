// A bar of a round length in the corner of the map.

import { byElementId } from "./element.js";

/** Greatest length of the bar, pixels. */
const BAR_PIXELS = 140;

/** Shows the bar for a scale, pixels per metre. */
export function showBar(pixelsPerMetre) {
  const length = roundLength(BAR_PIXELS / pixelsPerMetre);
  byElementId("scale-bar").style.width = `${(length * pixelsPerMetre).toFixed(1)}px`;
  byElementId("scale-length").textContent = lengthText(length);
}

/** The greatest of 1, 2, 5, 10 … (or their tenths) that is not above a length. */
export function roundLength(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].find((part) => part * power <= most * (1 + 1e-9)) * power;
}

function lengthText(metres) {
  if (metres >= 0.999) return `${Math.round(metres)} m`;
  return metres >= 0.00999 ? `${Math.round(100 * metres)} cm` : `${Number((1000 * metres).toPrecision(1))} mm`;
}
