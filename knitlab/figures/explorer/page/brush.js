// A brush: a line with a tick for every design, on which dragging marks a window.

import { svgElement } from "explorer/elements";
import { number } from "explorer/numbers";
import { linear, widened } from "explorer/scale";

const [WIDTH, HEIGHT, SIDE] = [300, 40, 10];
const LINE = 14;
const SHORTEST = 3;

/** Brush of a window; `set(low, high)` is called when a drag ends, with nulls for a plain click. */
export function brush({ store, cube }, { name, low, high }, set) {
  const [least, most] = cube.extentOf(name);
  const x = linear(widened([least, most], 0.02), [SIDE, WIDTH - SIDE]);
  const values = cube.designs.map((_, design) => cube.value(name, design, store.state.strain));
  const marked = svgElement("rect", { class: "window", y: 3, height: 22 });
  const show = (from, to) => {
    marked.setAttribute("x", Math.max(Math.min(from, to), 0));
    marked.setAttribute("width", Math.abs(to - from));
  };
  if (low !== null || high !== null)
    show(low === null ? 0 : x(low), high === null ? WIDTH : x(high));
  let start = null;
  const place = (event) => {
    const { left, width } = svg.getBoundingClientRect();
    return Math.min(Math.max(((event.clientX - left) * WIDTH) / width, 0), WIDTH);
  };
  const svg = svgElement(
    "svg",
    {
      class: "brush",
      viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
      "aria-hidden": true,
      onpointerdown: (event) => {
        start = place(event);
        svg.setPointerCapture(event.pointerId);
      },
      onpointermove: (event) => start !== null && show(start, place(event)),
      onpointerup: (event) => {
        const end = place(event);
        const long = Math.abs(end - start) >= SHORTEST;
        const edges = [start, end].map((each) => Number(x.invert(each).toPrecision(4)));
        start = null;
        if (long) set(Math.min(...edges), Math.max(...edges));
        else set(null, null);
      },
    },
    svgElement("path", { class: "tick-line", d: `M${SIDE} ${LINE}H${WIDTH - SIDE}` }),
    marked,
    ...values
      .filter((value) => value !== null)
      .map((value) => svgElement("circle", { class: "dot", cx: x(value), cy: LINE, r: 4 })),
    svgElement("text", { class: "tick start", x: 2, y: HEIGHT - 2 }, number(least)),
    svgElement("text", { class: "tick end", x: WIDTH - 2, y: HEIGHT - 2 }, number(most)),
  );
  return svg;
}
