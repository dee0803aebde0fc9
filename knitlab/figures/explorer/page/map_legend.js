// The legend of the map: what its colours, hatchings and signs mean.

import { colourBar } from "explorer/colour_bar";
import { missingDim } from "explorer/design_cell";
import { byId, svgElement, element } from "explorer/elements";
import { hatching, throughSign } from "explorer/marks";
import { percent, withUnit } from "explorer/numbers";

const LONGEST_NOTE = 100;

/** Draw the legend of a variable on the map of some designs. */
export function mapLegend({ store, cube, content }, variable, colour, designs) {
  const { strain } = store.state;
  const dim = missingDim(cube, store.state);
  const statuses = new Set(designs.map((design) => cube.statusOf(design, content.statuses)));
  statuses.delete("ok");
  const through = designs.some((design) => cube.foldedThrough(design, strain));
  const where = variable.along_strain ? ` at ${percent(cube.strains[strain])} strain` : "";
  const said = sentence(variable.description);
  const short = said.length < LONGEST_NOTE;
  const key = (...signs) => svgElement("svg", { width: 22, height: 16, "aria-hidden": true }, ...signs);
  byId("map-legend").replaceChildren(
    element("p", {}, element("b", {}, withUnit(variable)), `${where}. `, short ? said : ""),
    short ? "" : element("details", {}, element("summary", {}, "What this is"), said),
    colourBar(cube.extentOf(variable.name), colour, variable),
    element(
      "ul",
      {},
      ...[...statuses].map((status) =>
        element(
          "li",
          {},
          key(
            svgElement("rect", {
              x: 1,
              y: 1,
              width: 20,
              height: 14,
              fill: hatching(status),
              class: "frame",
            }),
          ),
          status,
        ),
      ),
      through
        ? element("li", {}, key(throughSign(11, 8)), "passes through itself at this strain")
        : null,
      dim ? element("li", {}, `small: ${dim}`) : null,
      element("li", {}, "blank: no such design"),
    ),
  );
}

function sentence(description) {
  return description ? `${description[0].toUpperCase()}${description.slice(1)}.` : "";
}
