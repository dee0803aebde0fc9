// The report of the run behind a cube: what ran, how long, what failed, by which code, figures.

import { STATUS } from "explorer/cube";
import { byId, element } from "explorer/elements";
import { number } from "explorer/numbers";
import { anyOf } from "explorer/store";

/** Draw the report of the shown cube, and keep it up to date. */
export function report(app) {
  app.store.show((state, changed) => {
    if (anyOf(changed, "cube")) byId("report").replaceChildren(...sections(app));
  });
}

function sections(app) {
  const { cube } = app;
  const { facts, settings, provenance } = cube.run;
  return [
    panel("What ran", pairs(facts.filter(([, value]) => value))),
    panel("What failed", failures(app)),
    panel("Code and libraries", pairs(provenance)),
    panel("Designs", designs(app)),
    panel(
      "Settings that all designs share",
      element(
        "details",
        {},
        element("summary", {}, `${settings.length} settings`),
        pairs(settings),
      ),
    ),
    panel("Figures", figures(cube)),
  ];
}

function panel(title, ...children) {
  return element("section", { class: "panel" }, element("h2", {}, title), ...children);
}

function pairs(entries) {
  return element(
    "dl",
    { class: "facts" },
    ...entries.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]),
  );
}

function failures({ cube, content }) {
  const bad = cube.designs
    .map((each, design) => [each, design])
    .filter(([{ status }]) => status !== STATUS.ok);
  const through = cube.designs
    .map((_, design) => design)
    .filter((design) => cube.strains.some((_, strain) => cube.foldedThrough(design, strain)));
  const lines = bad.map(([each, design]) =>
    element(
      "li",
      {},
      element("b", {}, cube.label(design)),
      `: ${content.statuses[each.status]}${each.reason ? `: ${each.reason}` : ""}`,
    ),
  );
  return element(
    "div",
    {},
    lines.length ? element("ul", {}, ...lines) : element("p", {}, "Every design is ok."),
    element(
      "p",
      {},
      through.length
        ? `Passes through itself at some strain: ${through.map((design) => cube.label(design)).join("; ")}.`
        : "No state passes through itself, as far as that was measured.",
    ),
  );
}

function designs({ cube, content, store }) {
  const columns = [
    ["design", (design) => cube.label(design)],
    ["status", (design) => cube.statusOf(design, content.statuses)],
    ["case", (design) => cube.designs[design].case_id],
    ["time of its batch [s]", (design) => number(cube.designs[design].seconds)],
    ["steps of the solver", (design) => number(total(cube, "iterations", design), 6)],
    ["largest residual force [N]", (design) => number(largest(cube, "residual_force", design), 2)],
    ["strains at which it snapped", (design) => number(total(cube, "snapped", design))],
  ];
  return element(
    "div",
    { class: "scroll" },
    element(
      "table",
      {},
      element("thead", {}, element("tr", {}, ...columns.map(([name]) => element("th", {}, name)))),
      element(
        "tbody",
        {},
        ...cube.designs.map((_, design) =>
          element(
            "tr",
            { onclick: () => store.set({ design, tab: "explore" }) },
            ...columns.map(([, value], k) =>
              element("td", { class: k < 3 ? "word" : null }, value(design)),
            ),
          ),
        ),
      ),
    ),
  );
}

function present(cube, name, design) {
  return cube.has(name) ? cube.curve(name, design).filter((value) => value !== null) : [];
}

function total(cube, name, design) {
  const values = present(cube, name, design);
  return values.length ? values.reduce((sum, value) => sum + value, 0) : null;
}

function largest(cube, name, design) {
  const values = present(cube, name, design);
  return values.length ? Math.max(...values) : null;
}

function figures({ figures: { shown, left_out: more } }) {
  if (!shown.length) return element("p", {}, "No figure was drawn into the results folder.");
  return element(
    "div",
    { class: "figures" },
    ...shown.map(({ name, source }) =>
      element(
        "figure",
        {},
        element("img", { src: source, alt: `Figure ${name}`, loading: "lazy" }),
        element("figcaption", {}, name),
      ),
    ),
    more ? element("p", {}, `${more} more are in the results folder.`) : null,
  );
}
