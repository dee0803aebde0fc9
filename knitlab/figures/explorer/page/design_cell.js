// One cell of the map: the colour and the value of a design, or a hatching that says why it has none.

import { PIN_COLOURS, PIN_MARKS, css, inkOn } from "explorer/colours";
import { PERIODS, STATUS } from "explorer/cube";
import { svgElement, lettering } from "explorer/elements";
import { hatching, mark, throughSign } from "explorer/marks";
import { fixed, number, unit } from "explorer/numbers";

const GAP = 3;
const [NARROWEST_TEXT, NARROWEST_LEVEL, NARROWEST_NAME] = [16, 36, 88];

/** The cell of a design in a box `{left, top, width, height}`; `colour` gives that of a value. */
export function designCell(app, design, box, colour) {
  const { store, cube } = app;
  const { state } = store;
  const look = lookOf(app, design, colour);
  const selected = design === state.design;
  const inset = look.kept ? GAP / 2 : Math.min(box.width, box.height) / 4;
  const rectangle = (attributes) =>
    svgElement("rect", {
      x: box.left + inset,
      y: box.top + inset,
      width: Math.max(box.width - 2 * inset, 1),
      height: Math.max(box.height - 2 * inset, 1),
      rx: 3,
      ...attributes,
    });
  const notes = look.notes.join(", ");
  const value = `${number(look.value)}${unit(cube.variable(state.of).units)}`;
  return svgElement(
    "g",
    {
      class: `cell${selected ? " selected" : ""}${look.kept ? "" : " out"}`,
      "data-design": design,
      role: "button",
      tabindex: selected ? 0 : -1,
      "aria-pressed": String(selected),
      "aria-label": `${cube.label(design)}: ${value}, ${notes}`,
      onclick: () => store.set({ design }),
    },
    svgElement("title", {}, `${cube.label(design)}\n${notes}`),
    rectangle({ fill: look.tint ? css(look.tint) : "var(--panel)" }),
    look.tint ? null : rectangle({ fill: hatching(look.status) }),
    ...(look.kept && box.width >= NARROWEST_TEXT ? letteringOf(app, design, box, look) : []),
    look.kept && look.through ? throughBadge(box.left + 15, box.top + 12) : null,
    look.pin < 0
      ? null
      : pinBadge(box.left + box.width - inset - 11, box.top + inset + 11, look.pin),
    rectangle({ class: "frame", fill: "none" }),
  );
}

/** The stripe number that is on no axis, where the map is by periods; null elsewhere. */
export function missingDim(cube, { x, y }) {
  if (![x, y].includes(PERIODS)) return null;
  const missing = ({ name }) => name.startsWith("n_") && ![x, y].includes(name);
  return cube.dims.find(missing)?.name ?? null;
}

/** What a cell shows: its value, status, tint, whether filters keep it, and notes in words. */
function lookOf(app, design, colour) {
  const { store, cube, content } = app;
  const { of, strain, pins } = store.state;
  const value = cube.value(of, design, strain);
  const status = cube.statusOf(design, content.statuses);
  const shown = value !== null && cube.designs[design].status !== STATUS.failed;
  const kept = app.passes(design);
  const through = cube.foldedThrough(design, strain);
  return {
    value,
    status,
    kept,
    through,
    tint: shown ? colour(value) : null,
    pin: pins.indexOf(app.pinKey(design)),
    notes: [
      status,
      ...(through ? ["passes through itself"] : []),
      ...(kept ? [] : ["filtered out"]),
    ],
  };
}

/** The value above the label that the axes do not give; only the value, upright, in a narrow cell. */
function letteringOf({ store, cube }, design, { left, top, width, height }, look) {
  const { tint, status, value } = look;
  const words = tint ? fixed(value) : status === "ok" ? "no value" : status;
  const ink = tint ? inkOn(tint) : "var(--ink)";
  const kind = (name) => (tint ? name : `${name} halo`);
  const [x, y] = [left + width / 2, top + height / 2];
  if (width < NARROWEST_LEVEL) {
    const transform = `translate(${x + 5} ${top + height - 7}) rotate(-90)`;
    return [svgElement("text", { class: `${kind("value")} start`, fill: ink, transform }, words)];
  }
  const dim = missingDim(cube, store.state);
  const label = dim ? String(cube.coordinate(dim, design)) : "";
  const named = dim && width >= NARROWEST_NAME ? `${dim} ${label}` : label;
  return [
    lettering(x, y + (named ? 3 : 5), words, kind("value"), ink),
    named ? lettering(x, y + 19, named, kind("extra"), ink) : null,
    tint && status === "not converged"
      ? lettering(left + width - 12, top + height - 9, "×", "value", ink)
      : null,
  ];
}

function throughBadge(x, y) {
  return svgElement(
    "g",
    {},
    svgElement("rect", { class: "badge", x: x - 9, y: y - 7, width: 18, height: 14, rx: 3 }),
    throughSign(x, y),
  );
}

function pinBadge(x, y, pin) {
  return svgElement(
    "g",
    {},
    svgElement("circle", { class: "badge", cx: x, cy: y, r: 8 }),
    mark(PIN_MARKS[pin], x, y, PIN_COLOURS[pin]),
  );
}
