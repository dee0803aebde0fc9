// The table of the designs that lie in all windows, sorted by a column.

import { byId, element, refill } from "explorer/elements";
import { fixed, percent, withUnit } from "explorer/numbers";
import { anyOf } from "explorer/store";

const COLUMNS = [
  "poisson_ratio_min",
  "applied_strain_at_min",
  "poisson_ratio",
  "reaction_force",
  "knit_cell_x",
  "knit_cell_y",
  "sensitivity",
  "self_intersections",
];
const SIGNS = { ok: "", "not converged": "▨ ", failed: "✕ ", pending: "… " };

/** Draw the table, and keep it up to date. */
export function designTable(app) {
  app.store.show((state, changed) => {
    if (anyOf(changed, "cube", "design", "strain", "of", "pins", "filters", "sort")) drawTable(app);
  });
}

function drawTable(app) {
  const { store, cube, content } = app;
  const { state } = store;
  const labels = cube.axes.map((axis) => ({
    id: axis.name,
    heading: axis.name === "periods" ? "P" : axis.name,
    value: (design) => cube.coordinate(axis.name, design),
  }));
  const names = [...new Set([state.of, ...COLUMNS])].filter(
    (name) => cube.has(name) && !labels.some(({ id }) => id === name),
  );
  const values = names.map((name) => {
    const variable = cube.variable(name);
    const at = variable.along_strain ? ` at ${percent(cube.strains[state.strain])}` : "";
    return {
      id: name,
      heading: `${withUnit(variable)}${at}`,
      value: (design) => cube.value(name, design, state.strain),
    };
  });
  const columns = [...labels, ...values];
  const descending = state.sort.startsWith("-");
  const sorted = columns.find(({ id }) => id === state.sort.replace("-", "")) ?? columns[0];
  const rows = cube.designs.map((_, design) => design).filter((design) => app.passes(design));
  rows.sort((one, other) => compared(sorted.value(one), sorted.value(other), descending));
  const heading = ({ id, heading: words }) =>
    element(
      "th",
      {
        scope: "col",
        "aria-sort": id === sorted.id ? (descending ? "descending" : "ascending") : null,
      },
      element(
        "button",
        { onclick: () => store.set({ sort: state.sort === id ? `-${id}` : id }) },
        words,
        id === sorted.id ? (descending ? " ▼" : " ▲") : "",
      ),
    );
  const body = rows.map((design) => {
    const pinned = state.pins.includes(app.pinKey(design));
    const status = cube.statusOf(design, content.statuses);
    return element(
      "tr",
      {
        class: design === state.design ? "selected" : null,
        "data-design": design,
        onclick: () => store.set({ design }),
      },
      element(
        "td",
        {},
        element(
          "button",
          {
            "aria-pressed": String(pinned),
            "aria-label": `Pin ${cube.label(design)}`,
            onclick: (event) => {
              event.stopPropagation();
              app.togglePin(design);
            },
          },
          pinned ? "Unpin" : "Pin",
        ),
      ),
      ...labels.map(({ value }) =>
        element(
          "td",
          {},
          element(
            "button",
            { class: "plain", onclick: () => store.set({ design }) },
            String(value(design)),
          ),
        ),
      ),
      element("td", { class: "word" }, `${SIGNS[status]}${status}`),
      ...values.map(({ value }) => element("td", {}, fixed(value(design)))),
    );
  });
  refill(
    byId("designs"),
    element(
      "thead",
      {},
      element(
        "tr",
        {},
        element("th", {}, ""),
        ...labels.map(heading),
        element("th", { scope: "col" }, "status"),
        ...values.map(heading),
      ),
    ),
    element("tbody", {}, ...body),
  );
}

function compared(one, other, descending) {
  if (one === null || other === null) return (one === null) - (other === null);
  const order = typeof one === "string" ? one.localeCompare(other) : one - other;
  return descending ? -order : order;
}
