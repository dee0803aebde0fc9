// The colour bar of a map: it spans the data, and marks zero.

import { css } from "explorer/colours";
import { svgElement } from "explorer/elements";
import { number, withUnit } from "explorer/numbers";
import { linear, ticks } from "explorer/scale";

const [WIDTH, HEIGHT, SIDE] = [260, 12, 14];
const PARTS = 52;

/** Bar of the colours of a variable between its smallest and largest value. */
export function colourBar([low, high], colour, variable) {
  const x = linear([low, high], [SIDE, WIDTH - SIDE]);
  const part = (WIDTH - 2 * SIDE) / PARTS;
  const blocks = Array.from({ length: PARTS }, (_, k) =>
    svgElement("rect", {
      x: SIDE + k * part,
      y: 0,
      width: part + 0.5,
      height: HEIGHT,
      fill: css(colour(x.invert(SIDE + (k + 0.5) * part))),
    }),
  );
  const labels = low === high ? [low] : ticks([low, high], 4);
  return svgElement(
    "svg",
    {
      class: "colour-bar",
      viewBox: `0 0 ${WIDTH} ${HEIGHT + 18}`,
      width: WIDTH,
      role: "img",
      "aria-label": `${withUnit(variable)}: colours from ${number(low)} to ${number(high)}`,
    },
    ...blocks,
    ...labels.flatMap((value) => [
      svgElement("path", { d: `M${x(value)} ${HEIGHT}v4`, class: "tick-line" }),
      svgElement("text", { x: x(value), y: HEIGHT + 15, class: "tick" }, number(value)),
    ]),
  );
}
