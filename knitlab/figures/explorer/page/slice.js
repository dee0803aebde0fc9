// The slice of a cube that a map shows: two axes, and the selected design's labels along the rest.

import { PERIODS } from "explorer/cube";

const SPARSE = 0.6;

/** Axes that show most: stripe numbers, by periods if many of these numbers have no design. */
export function defaultAxes(cube) {
  const varied = cube.dims.filter(({ values }) => values.length > 1).map(({ name }) => name);
  if (varied.includes("n_stripe") && varied.includes("n_subunit")) {
    const size = (name) => cube.dims.find((dim) => dim.name === name).values.length;
    const others = cube.dims.filter(({ name }) => !["n_stripe", "n_subunit"].includes(name));
    const slices = others.reduce((product, { values }) => product * values.length, 1);
    const filled = cube.count / (size("n_stripe") * size("n_subunit") * slices);
    const x = filled < SPARSE && cube.has(PERIODS) ? PERIODS : "n_subunit";
    return { x, y: "n_stripe" };
  }
  const names = [...varied, ...cube.dims.map(({ name }) => name)];
  const [y, x] = [...new Set(names)];
  return { x: x ?? y, y };
}

/** The dimensions along which the slice has one value: that of the selected design. */
export function fixedDims(cube, { x, y }) {
  const shown = new Set([x, y]);
  if (shown.has(PERIODS)) shown.add(shown.has("n_subunit") ? "n_stripe" : "n_subunit");
  return cube.dims.filter(({ name, values }) => !shown.has(name) && values.length > 1);
}

/** Columns, rows (from below) and the design of every cell, by `row,column`. */
export function sliceOf(cube, state) {
  const { x, y, design } = state;
  const fixed = fixedDims(cube, state);
  const within = cube.designs
    .map((_, each) => each)
    .filter((each) =>
      fixed.every(({ name }) => cube.coordinate(name, each) === cube.coordinate(name, design)),
    );
  const columns = labelsAlong(cube, x, within);
  const rows = labelsAlong(cube, y, within);
  const cells = new Map();
  for (const each of within) {
    const place = [
      rows.indexOf(cube.coordinate(y, each)),
      columns.indexOf(cube.coordinate(x, each)),
    ];
    cells.set(place.join(), each);
  }
  return { columns, rows, cells };
}

/** The design that is nearest to one, with another value along a fixed dimension. */
export function movedAlong(cube, design, name, value) {
  const others = cube.dims.filter((dim) => dim.name !== name);
  const same = (each) =>
    others.filter((dim) => cube.coordinate(dim.name, each) === cube.coordinate(dim.name, design));
  const there = cube.designs
    .map((_, each) => each)
    .filter((each) => String(cube.coordinate(name, each)) === value);
  there.sort((one, other) => same(other).length - same(one).length);
  return there[0] ?? design;
}

function labelsAlong(cube, axis, designs) {
  const present = new Set(designs.map((design) => cube.coordinate(axis, design)));
  const order = axis === PERIODS ? [...present].sort((a, b) => a - b) : null;
  return order ?? cube.dims.find(({ name }) => name === axis).values.filter((v) => present.has(v));
}
