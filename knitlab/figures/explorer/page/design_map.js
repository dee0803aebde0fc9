// The design map: a cell for each design, coloured and labelled by a variable, or hatched by status.

import { colourScale } from "explorer/colours";
import { PERIODS } from "explorer/cube";
import { designCell } from "explorer/design_cell";
import { byId, choice, svgElement, lettering, onWidth, refill } from "explorer/elements";
import { mapLegend } from "explorer/map_legend";
import { hatchings } from "explorer/marks";
import { fixedDims, movedAlong, sliceOf } from "explorer/slice";
import { anyOf } from "explorer/store";

const LEFT = 46;
const BOTTOM = 40;
const [LOWEST_CELL, HIGHEST_CELL] = [68, 84];
const MOVES = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [1, 0], ArrowDown: [-1, 0] };

/** Draw the map of the shown cube, and keep it up to date. */
export function designMap(app) {
  const draw = () => drawMap(app);
  onWidth(byId("map"), draw);
  app.store.show((state, changed) => {
    if (anyOf(changed, "cube", "x", "y", "of", "design")) drawChoices(app);
    if (anyOf(changed, "cube", "x", "y", "of", "strain", "design", "pins", "filters")) draw();
  });
}

function drawChoices({ store, cube }) {
  const { state } = store;
  const axes = [["", cube.axes.map(({ name }) => [name, name === PERIODS ? "periods (P)" : name])]];
  const swapped = (axis, other) => (value) =>
    store.set(value === state[other] ? { [axis]: value, [other]: state[axis] } : { [axis]: value });
  refill(
    byId("map-choices"),
    choice("Colour", cube.variableGroups, state.of, (of) => store.set({ of })),
    choice("across", axes, state.x, swapped("x", "y")),
    choice("up", axes, state.y, swapped("y", "x")),
    ...fixedDims(cube, state).map(({ name, values }) =>
      choice(
        name,
        [["", values.map((value) => [value, String(value)])]],
        cube.coordinate(name, state.design),
        (value) => store.set({ design: movedAlong(cube, state.design, name, value) }),
      ),
    ),
  );
}

function drawMap(app) {
  const { store, cube, content } = app;
  const { state } = store;
  const slice = sliceOf(cube, state);
  const { columns, rows, cells } = slice;
  const width = Math.max(byId("map").clientWidth, 240);
  const cellWidth = (width - LEFT) / columns.length;
  const cellHeight = Math.min(Math.max(0.6 * cellWidth, LOWEST_CELL), HIGHEST_CELL);
  const height = rows.length * cellHeight + BOTTOM;
  const variable = cube.variable(state.of);
  const colour = colourScale(content.colours, cube.extentOf(state.of), variable.signed);
  const focused = Boolean(document.activeElement?.closest("#map [data-design]"));
  const pieces = [];
  for (const [place, design] of cells) {
    const [row, column] = place.split(",").map(Number);
    const [left, top] = [LEFT + column * cellWidth, (rows.length - 1 - row) * cellHeight];
    const box = { left, top, width: cellWidth, height: cellHeight };
    pieces.push(designCell(app, design, box, colour));
  }
  const axis = (name) => cube.axes.find((each) => each.name === name);
  const svg = svgElement(
    "svg",
    {
      viewBox: `0 0 ${width} ${height}`,
      width,
      height,
      role: "group",
      "aria-label": `Map of ${variable.long_name} over ${state.x} and ${state.y}`,
      onkeydown: (event) => moved(app, slice, event),
    },
    hatchings(),
    ...columns.map((label, column) =>
      lettering(LEFT + (column + 0.5) * cellWidth, height - BOTTOM + 15, String(label), "tick"),
    ),
    ...rows.map((label, row) =>
      lettering(LEFT - 8, (rows.length - 0.5 - row) * cellHeight + 4, String(label), "tick end"),
    ),
    lettering(LEFT + (width - LEFT) / 2, height - 6, axisName(axis(state.x)), "axis"),
    svgElement(
      "text",
      { class: "axis", transform: `translate(11 ${(height - BOTTOM) / 2}) rotate(-90)` },
      axisName(axis(state.y), (height - BOTTOM) / 6.5),
    ),
    ...pieces,
  );
  byId("map").replaceChildren(svg);
  if (focused) svg.querySelector(`[data-design="${state.design}"]`)?.focus();
  mapLegend(app, variable, colour, [...cells.values()]);
}

function axisName({ name, long_name: long }, room = Infinity) {
  const full = name === PERIODS ? `P: ${long}` : `${name}: ${long}`;
  return long && long !== name && full.length < room ? full : name;
}

function moved({ store, togglePin }, { rows, columns, cells }, event) {
  const here = [...cells].find(([, design]) => design === store.state.design);
  if (event.key === "p" || event.key === "P") togglePin(store.state.design);
  if (!here || !(event.key in MOVES)) return;
  event.preventDefault();
  const [up, right] = MOVES[event.key];
  let [row, column] = here[0].split(",").map(Number);
  do {
    [row, column] = [row + up, column + right];
    const design = cells.get([row, column].join());
    if (design !== undefined) {
      store.set({ design });
      return;
    }
  } while (row >= 0 && column >= 0 && row < rows.length && column < columns.length);
}
