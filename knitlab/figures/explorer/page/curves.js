// Curves along the applied strain: the selected design and the pinned ones, with their bands.

import { chart } from "explorer/chart";
import { PIN_COLOURS, PIN_DASHES, PIN_MARKS } from "explorer/colours";
import { byId, choice, svgElement, element, onWidth, refill } from "explorer/elements";
import { mark } from "explorer/marks";
import { number, percent, unit } from "explorer/numbers";
import { anyOf } from "explorer/store";

const SELECTED = { colour: "var(--ink)", mark: "circle", dash: "" };

/** Draw both charts, and keep them up to date. */
export function curves(app) {
  const draw = () => drawCurves(app);
  onWidth(byId("curves"), draw);
  app.store.show((state, changed) => {
    if (anyOf(changed, "cube", "x", "y", "design", "strain", "pins", "filters", "upper", "lower"))
      draw();
  });
}

/** The designs that are drawn with their looks: the selected one, then the pinned ones. */
export function shownDesigns({ store, cube, content, cubes }) {
  const { design, pins } = store.state;
  const pinned = pins.map((key, k) => {
    const [index, ...labels] = key.split(":");
    const of = cubes[Number(index)];
    return {
      cube: of,
      design: of.find(labels.join(":")),
      pin: k,
      look: { colour: PIN_COLOURS[k], mark: PIN_MARKS[k], dash: PIN_DASHES[k] },
    };
  });
  const own = pinned.find((each) => each.cube === cube && each.design === design);
  return (own ? pinned : [{ cube, design, pin: null, look: SELECTED }, ...pinned]).map((each) => ({
    ...each,
    name: (cubes.length > 1 ? `${each.cube.name}: ` : "") + each.cube.label(each.design),
    status: each.cube.statusOf(each.design, content.statuses),
    selected: each.cube === cube && each.design === design,
  }));
}

/** The strain of a cube that is nearest to one of another cube; null outside its test. */
export function nearestStrain(cube, strain) {
  const distances = cube.strains.map((each) => Math.abs(each - strain));
  const nearest = distances.indexOf(Math.min(...distances));
  const gap = cube.strains.length > 1 ? cube.strains[1] - cube.strains[0] : Infinity;
  return distances[nearest] <= Math.abs(gap) / 2 + 1e-9 ? nearest : null;
}

function drawCurves(app) {
  const { store, cube } = app;
  const { state } = store;
  const shown = shownDesigns(app);
  const along = cube.variables.filter((variable) => variable.along_strain);
  const groups = [["", along.map(({ name, long_name: long }) => [name, long])]];
  const panels = ["upper", "lower"].flatMap((which) => {
    const variable = cube.variable(state[which]);
    if (!variable) return [];
    return [
      choice(`:${which} curve`, groups, variable.name, (name) => store.set({ [which]: name })),
      chart(app, variable, shown, byId("curves").clientWidth),
    ];
  });
  refill(byId("curves"), ...panels);
  drawReadings(app, shown);
  drawLegend(shown);
}

function drawReadings(app, shown) {
  const { state } = app.store;
  const strain = app.cube.strains[state.strain];
  const names = [...new Set([state.upper, state.lower])];
  const lines = shown.map((each) => {
    const place = nearestStrain(each.cube, strain);
    const through = place !== null && each.cube.foldedThrough(each.design, place);
    const notes = [
      ...(each.status === "ok" ? [] : [each.status]),
      ...(through ? ["passes through itself"] : []),
    ];
    const pin = each.pin === null ? "Pin" : "Unpin";
    return element(
      "li",
      { class: each.selected ? "selected" : null },
      element("b", {}, sign(each.look), each.name),
      element(
        "button",
        {
          "aria-label": `${pin} ${each.name}`,
          onclick: () => app.togglePin(each.design, each.cube),
        },
        pin,
      ),
      element(
        "span",
        { class: "values" },
        `At ${percent(strain)}: `,
        ...names
          .filter((name) => each.cube.has(name))
          .map((name, k) => `${k ? "; " : ""}${reading(each, name, place)}`),
        notes.length ? element("em", {}, ` – ${notes.join(", ")}`) : null,
      ),
    );
  });
  refill(byId("readings"), ...lines);
}

function reading({ cube, design }, name, strain) {
  const variable = cube.variable(name);
  const value = strain === null ? null : cube.value(name, design, strain);
  if (value === null) return `no ${variable.long_name}`;
  const band = cube.band(name, design, strain);
  const range = band ? ` (${number(band[0])} to ${number(band[1])})` : "";
  return `${variable.long_name} ${number(value)}${unit(variable.units)}${range}`;
}

/** Line and mark of a design, for lists. */
export function sign({ colour, mark: shape, dash }) {
  return svgElement(
    "svg",
    { width: 34, height: 14, "aria-hidden": true, class: "sign" },
    svgElement("path", { d: "M2 7H32", stroke: colour, "stroke-width": 2, "stroke-dasharray": dash }),
    mark(shape, 17, 7, colour),
  );
}

function drawLegend(shown) {
  const banded = shown.some(({ cube }) =>
    cube.variables.some(({ band }) => Object.keys(band).length),
  );
  const key = (...signs) => svgElement("svg", { width: 26, height: 14, "aria-hidden": true }, ...signs);
  const ink = "var(--ink)";
  byId("curve-legend").replaceChildren(
    element(
      "ul",
      {},
      banded
        ? element(
            "li",
            {},
            key(svgElement("rect", { x: 1, y: 2, width: 24, height: 10, class: "band", fill: ink })),
            "band: spread over slightly different fabrics, or two standard errors of a measurement",
          )
        : null,
      element(
        "li",
        {},
        key(mark("circle", 13, 7, ink, { hollow: true })),
        "hollow: passes through itself",
      ),
      element("li", {}, key(mark("cross", 13, 7, ink)), "last state that was reached"),
      element(
        "li",
        {},
        key(svgElement("path", { d: "M1 11L10 9M16 5L25 3", stroke: ink, "stroke-width": 2 })),
        "gap: the fabric snapped",
      ),
      element(
        "li",
        {},
        key(svgElement("path", { d: "M1 11L25 3", class: "other" })),
        "the other designs of the map",
      ),
    ),
  );
}
