// Marks that do not need colour: of pins, of states, and hatchings of designs without a value.

import { svgElement } from "explorer/elements";

const SHAPES = {
  circle: "M-4 0a4 4 0 1 0 8 0a4 4 0 1 0 -8 0Z",
  square: "M-3.6 -3.6H3.6V3.6H-3.6Z",
  triangle: "M0 -4.6L4.4 3.4H-4.4Z",
  diamond: "M0 -5L4.4 0L0 5L-4.4 0Z",
  down: "M0 4.6L4.4 -3.4H-4.4Z",
  star: "M0 -5L1.5 -1.6L5 -1.2L2.4 1.3L3.1 4.8L0 3L-3.1 4.8L-2.4 1.3L-5 -1.2L-1.5 -1.6Z",
  cross: "M-4 -4L4 4M4 -4L-4 4",
};

/** A mark at a place; hollow if the fabric passes through itself there. */
export function mark(shape, x, y, colour, { hollow = false, size = 1 } = {}) {
  return svgElement("path", {
    d: SHAPES[shape],
    transform: `translate(${x.toFixed(1)} ${y.toFixed(1)}) scale(${size})`,
    fill: shape === "cross" ? "none" : hollow ? "var(--panel)" : colour,
    stroke: colour,
    "stroke-width": shape === "cross" ? 2 : 1.4,
  });
}

const HATCHINGS = {
  pending: { d: "M2 2h.01M6 6h.01", width: 1.6, round: true },
  "not converged": { d: "M-2 2L2 -2M0 8L8 0M6 10L10 6", width: 1 },
  failed: { d: "M0 8L8 0M0 0L8 8", width: 1 },
};

/** Definitions of the hatchings, to be put into every drawing that uses them. */
export function hatchings() {
  const patterns = Object.entries(HATCHINGS).map(([status, { d, width, round }]) =>
    svgElement(
      "pattern",
      { id: hatchingId(status), width: 8, height: 8, patternUnits: "userSpaceOnUse" },
      svgElement("path", {
        d,
        stroke: "var(--ink)",
        "stroke-width": width,
        "stroke-linecap": round ? "round" : "butt",
        fill: "none",
      }),
    ),
  );
  return svgElement("defs", {}, ...patterns);
}

/** Fill of a status; designs that are ok have none. */
export function hatching(status) {
  return status in HATCHINGS ? `url(#${hatchingId(status)})` : "none";
}

/** Sign of a state in which the fabric passes through itself: two sheets that cross. */
export function throughSign(x, y, size = 1) {
  return svgElement("path", {
    class: "through",
    d: "M-6 -4C0 -4 0 4 6 4M-6 4C0 4 0 -4 6 -4",
    transform: `translate(${x} ${y}) scale(${size})`,
  });
}

function hatchingId(status) {
  return `hatching-${status.replace(" ", "-")}`;
}
