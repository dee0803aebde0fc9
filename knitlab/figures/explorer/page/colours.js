// Colours of values: one map for numbers, another one centred at zero for those that can be negative.

import { linear } from "explorer/scale";

/** Pins: colours of Okabe and Ito in an order that alternates dark and light. */
export const PIN_COLOURS = ["#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00"];
/** Shapes of their marks and dashes of their lines, which tell them apart without colour. */
export const PIN_MARKS = ["circle", "square", "triangle", "diamond", "down", "star"];
export const PIN_DASHES = ["", "7 3", "2 3", "9 3 2 3", "12 4", "4 2"];

/** Function that gives the colour of a value within a range; about zero if that can be negative. */
export function colourScale(maps, [low, high], canBeNegative = false) {
  const signed = canBeNegative || low < 0;
  const largest = Math.max(Math.abs(low), Math.abs(high));
  const domain = signed ? [-largest, largest] : [low, high];
  const colours = (signed ? maps.signed : maps.sequence).map(channels);
  const place = linear(domain, [0, colours.length - 1]);
  const scale = (value) => {
    const exact = low === high ? (colours.length - 1) / 2 : place(value);
    const first = Math.min(Math.max(Math.floor(exact), 0), colours.length - 2);
    const part = Math.min(Math.max(exact - first, 0), 1);
    return colours[first].map((one, k) => one + (colours[first + 1][k] - one) * part);
  };
  return scale;
}

/** `rgb()` of channels from 0 to 255. */
export function css(colour) {
  return `rgb(${colour.map(Math.round).join(" ")})`;
}

/** Ink that is legible on a colour. */
export function inkOn([red, green, blue]) {
  return 0.299 * red + 0.587 * green + 0.114 * blue < 135 ? "#fff" : "#111";
}

/** Channels from 0 to 255 of `#rrggbb`. */
export function channels(hex) {
  return [1, 3, 5].map((start) => parseInt(hex.slice(start, start + 2), 16));
}
