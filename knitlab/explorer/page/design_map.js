// The design map: a cell for each design, coloured and labelled by a variable, or hatched by status.

import { colourBar } from "explorer/colour_bar";
import { PIN_COLOURS, PIN_MARKS, colourScale, css, inkOn } from "explorer/colours";
import { PERIODS, STATUS } from "explorer/cube";
import { byId, choice, drawn, element, onWidth, refill } from "explorer/elements";
import { hatching, hatchings, mark, throughSign } from "explorer/marks";
import { fixed, number, percent, unit, withUnit } from "explorer/numbers";
import { fixedDims, movedAlong, sliceOf } from "explorer/slice";
import { anyOf } from "explorer/store";

const LEFT = 46;
const BOTTOM = 40;
const GAP = 3;
const [LOWEST_CELL, HIGHEST_CELL] = [58, 84];
const [NARROWEST_TEXT, NARROWEST_NAME] = [34, 88];
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

/** The variables that a map or an axis can show, as groups of choices. */
export function variableGroups(cube, along = [true, false]) {
  const headings = { true: "at the applied strain", false: "of the design" };
  return along.map((each) => [
    headings[each],
    cube.variables
      .filter((variable) => variable.along_strain === each)
      .map((variable) => [variable.name, variable.long_name]),
  ]);
}

function drawChoices({ store, cube }) {
  const { state } = store;
  const axes = [["", cube.axes.map(({ name }) => [name, name === PERIODS ? "periods (P)" : name])]];
  const swapped = (axis, other) => (value) =>
    store.set(value === state[other] ? { [axis]: value, [other]: state[axis] } : { [axis]: value });
  refill(
    byId("map-choices"),
    choice("Colour", variableGroups(cube), state.of, (of) => store.set({ of })),
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
  const colour = colourScale(content.colours, cube.extentOf(state.of));
  const focused = document.activeElement?.closest?.("#map [data-design]") !== null;
  const pieces = [];
  for (const [place, design] of cells) {
    const [row, column] = place.split(",").map(Number);
    const box = [LEFT + column * cellWidth, (rows.length - 1 - row) * cellHeight];
    pieces.push(cellOf(app, design, box, [cellWidth, cellHeight], colour));
  }
  const axis = (name) => cube.axes.find((each) => each.name === name);
  const svg = drawn(
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
      text(LEFT + (column + 0.5) * cellWidth, height - BOTTOM + 15, String(label), "tick"),
    ),
    ...rows.map((label, row) =>
      text(LEFT - 8, (rows.length - 0.5 - row) * cellHeight + 4, String(label), "tick end"),
    ),
    text(LEFT + (width - LEFT) / 2, height - 6, axisName(axis(state.x)), "axis"),
    drawn(
      "text",
      { class: "axis", transform: `translate(11 ${(height - BOTTOM) / 2}) rotate(-90)` },
      axisName(axis(state.y), (height - BOTTOM) / 6.5),
    ),
    ...pieces,
  );
  byId("map").replaceChildren(svg);
  if (focused) svg.querySelector(`[data-design="${state.design}"]`)?.focus();
  drawLegend(app, variable, colour, [...cells.values()]);
}

function axisName({ name, long_name: long }, room = Infinity) {
  const full = name === PERIODS ? `P: ${long}` : `${name}: ${long}`;
  return long && long !== name && full.length < room ? full : name;
}

function cellOf(app, design, [left, top], [width, height], colour) {
  const { store, cube, content } = app;
  const { state } = store;
  const value = cube.value(state.of, design, state.strain);
  const status = cube.statusOf(design, content.statuses);
  const shown = value !== null && cube.designs[design].status !== STATUS.failed;
  const tint = shown ? colour(value) : null;
  const kept = app.passes(design);
  const inset = kept ? GAP / 2 : Math.min(width, height) / 4;
  const rectangle = (attributes) =>
    drawn("rect", {
      x: left + inset,
      y: top + inset,
      width: Math.max(width - 2 * inset, 1),
      height: Math.max(height - 2 * inset, 1),
      rx: 3,
      ...attributes,
    });
  const middle = left + width / 2;
  const ink = shown ? inkOn(tint) : "var(--ink)";
  const through = cube.foldedThrough(design, state.strain);
  const pin = state.pins.indexOf(app.pinKey(design));
  const dim = missingDim(cube, state);
  const label = dim ? cube.coordinate(dim, design) : "";
  const extra = dim && width >= NARROWEST_NAME ? `${dim} ${label}` : String(label);
  const words = shown ? fixed(value) : status === "ok" ? "no value" : status;
  const fits = width >= NARROWEST_TEXT && kept;
  const notes = [status, ...(through ? ["passes through itself"] : []), ...(kept ? [] : ["filtered out"])];
  return drawn(
    "g",
    {
      class: `cell${design === state.design ? " selected" : ""}${kept ? "" : " out"}`,
      "data-design": design,
      role: "button",
      tabindex: design === state.design ? 0 : -1,
      "aria-pressed": String(design === state.design),
      "aria-label": `${cube.label(design)}: ${number(value)}${unit(cube.variable(state.of).units)}, ${notes.join(", ")}`,
      onclick: () => store.set({ design }),
    },
    drawn("title", {}, `${cube.label(design)}\n${notes.join(", ")}`),
    rectangle({ fill: shown ? css(tint) : "var(--panel)" }),
    shown ? null : rectangle({ fill: hatching(status), class: "hatched" }),
    fits
      ? text(middle, top + height / 2 + (extra ? 3 : 5), words, shown ? "value" : "value halo", ink)
      : null,
    fits && extra ? text(middle, top + height / 2 + 19, extra, shown ? "extra" : "extra halo", ink) : null,
    shown && status === "not converged" && fits
      ? text(left + width - 12, top + height - 9, "×", "value", ink)
      : null,
    through && kept ? throughBadge(left + 15, top + 12) : null,
    pin >= 0 ? pinBadge(left + width - inset - 11, top + inset + 11, pin) : null,
    rectangle({ class: "frame", fill: "none" }),
  );
}

/** The stripe number that is on no axis, where the map is by periods; null elsewhere. */
function missingDim(cube, { x, y }) {
  if (![x, y].includes(PERIODS)) return null;
  return cube.dims.find(({ name }) => name.startsWith("n_") && ![x, y].includes(name))?.name ?? null;
}

function throughBadge(x, y) {
  return drawn("g", {}, drawn("rect", { class: "badge", x: x - 9, y: y - 7, width: 18, height: 14, rx: 3 }), throughSign(x, y));
}

function pinBadge(x, y, pin) {
  return drawn("g", {}, drawn("circle", { class: "badge", cx: x, cy: y, r: 8 }), mark(PIN_MARKS[pin], x, y, PIN_COLOURS[pin]));
}

function text(x, y, words, kind, fill = null) {
  return drawn("text", { class: kind, x, y, fill }, words);
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

function drawLegend({ store, cube, content }, variable, colour, designs) {
  const { strain } = store.state;
  const dim = missingDim(cube, store.state);
  const statuses = new Set(designs.map((design) => cube.statusOf(design, content.statuses)));
  statuses.delete("ok");
  const through = designs.some((design) => cube.foldedThrough(design, strain));
  const where = variable.along_strain ? ` at ${percent(cube.strains[strain])} strain` : "";
  const key = (...signs) =>
    drawn("svg", { width: 22, height: 16, "aria-hidden": true }, ...signs);
  byId("map-legend").replaceChildren(
    element("p", {}, element("b", {}, withUnit(variable)), `${where}. `, sentence(variable.description)),
    colourBar(cube.extentOf(variable.name), colour, variable),
    element(
      "ul",
      {},
      ...[...statuses].map((status) =>
        element(
          "li",
          {},
          key(drawn("rect", { x: 1, y: 1, width: 20, height: 14, fill: hatching(status), class: "frame" })),
          status,
        ),
      ),
      through ? element("li", {}, key(throughSign(11, 8)), "passes through itself at this strain") : null,
      dim ? element("li", {}, `small: ${dim}`) : null,
      element("li", {}, "blank: no such design"),
    ),
  );
}

function sentence(description) {
  return description ? `${description[0].toUpperCase()}${description.slice(1)}.` : "";
}
