// Filters: windows of variables that designs must lie in; the rest is faded on the map.

import { brush } from "explorer/brush";
import { byId, choice, element, refill } from "explorer/elements";
import { percent, withUnit } from "explorer/numbers";
import { anyOf } from "explorer/store";

const FIRST = ["poisson_ratio", "knit_cell_x", "reaction_force", "sensitivity"];
const SENSITIVITY = "poisson_ratio_sensitivity[";

/** Open windows at first: of Poisson's ratio, size, force and sensitivity, as far as there are any. */
export function firstFilters(cube) {
  const sensitivity = cube.variables.find(({ name }) => name.startsWith(SENSITIVITY));
  const names = [
    ...FIRST.filter((name) => cube.has(name)),
    ...(sensitivity ? [sensitivity.name] : []),
  ];
  return names.map((name) => ({ name, low: null, high: null }));
}

/** Whether a design lies in all windows at a strain; without a value it lies in none. */
export function passes(cube, filters, design, strain) {
  return filters.every(({ name, low, high }) => {
    if ((low === null && high === null) || !cube.has(name)) return true;
    const value = cube.value(name, design, strain);
    return value !== null && value >= (low ?? -Infinity) && value <= (high ?? Infinity);
  });
}

/** Draw the windows, and keep them up to date. */
export function filters(app) {
  app.store.show((state, changed) => {
    if (anyOf(changed, "cube", "filters", "strain", "design")) drawFilters(app);
  });
}

function drawFilters(app) {
  const { store, cube } = app;
  const { filters: windows, strain } = store.state;
  const replace = (name, entries) =>
    store.set({
      filters: windows.map((each) => (each.name === name ? { ...each, ...entries } : each)),
    });
  const rows = windows
    .filter(({ name }) => cube.has(name))
    .map((window) => {
      const variable = cube.variable(window.name);
      const at = variable.along_strain ? `, at ${percent(cube.strains[strain])}` : "";
      const edge = (which, label) =>
        element("input", {
          type: "number",
          step: "any",
          value: window[which] ?? "",
          placeholder: label,
          "aria-label": `${label} ${variable.long_name}`,
          onchange: ({ target }) =>
            replace(window.name, { [which]: target.value === "" ? null : Number(target.value) }),
        });
      return element(
        "div",
        { class: "filter", "data-variable": window.name },
        element("span", { class: "name" }, `${withUnit(variable)}${at}`),
        brush(app, window, (low, high) => replace(window.name, { low, high })),
        element(
          "div",
          { class: "edges" },
          edge("low", "from"),
          edge("high", "to"),
          element(
            "button",
            { onclick: () => replace(window.name, { low: null, high: null }) },
            "Clear",
          ),
        ),
      );
    });
  const free = cube.variableGroups.map(([heading, pairs]) => [
    heading,
    pairs.filter(([name]) => !windows.some((each) => each.name === name)),
  ]);
  const add = choice("Filter by another variable", [["", [["", "…"]]], ...free], "", (name) =>
    store.set({ filters: [...windows, { name, low: null, high: null }] }),
  );
  refill(byId("filters"), ...rows, add);
  const kept = cube.designs.filter((_, design) => app.passes(design)).length;
  byId("filter-count").textContent = `${kept} of ${cube.count} designs`;
}
