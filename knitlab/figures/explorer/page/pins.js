// Pinned designs, side by side: shape, values at the applied strain, sizes.

import { boxOf, cameraOf } from "explorer/camera";
import { nearestStrain, shownDesigns, sign } from "explorer/curves";
import { byId, element, refill } from "explorer/elements";
import { number, percent, unit } from "explorer/numbers";
import { painter } from "explorer/painter";
import { positionsOf } from "explorer/positions";
import { sceneOf, sheetOf } from "explorer/sheet";
import { anyOf } from "explorer/store";

const SIZES = ["poisson_ratio_min", "knit_cell_x", "knit_cell_y", "sensitivity"];
const [WIDTH, HEIGHT] = [320, 240];
const INK = [0.12, 0.12, 0.14];

/** Draw the cards of the pinned designs, and keep them up to date. */
export function pins(app) {
  app.store.show((state, changed) => {
    if (anyOf(changed, "pins", "strain", "cube", "upper", "lower")) drawCards(app);
    else if (anyOf(changed, "turn")) app.cards?.forEach((card) => card.draw());
  });
}

function drawCards(app) {
  const { store, cube, cubes } = app;
  const { state } = store;
  const pinned = shownDesigns(app).filter(({ pin }) => pin !== null);
  byId("pin-panel").hidden = !pinned.length;
  app.cards = [];
  const cards = pinned.map((each) => {
    const strain = nearestStrain(each.cube, cube.strains[state.strain]);
    const canvas = element("canvas", {
      width: WIDTH,
      height: HEIGHT,
      role: "img",
      "aria-label": `Shape of ${each.name}`,
    });
    const message = element("p", { class: "note" });
    const card = { draw: () => drawShape(app, each, strain, canvas, message) };
    app.cards.push(card);
    card.draw();
    const names = [...new Set([state.upper, state.lower, ...SIZES])].filter((name) =>
      each.cube.has(name),
    );
    const show = () => store.set({ cube: cubes.indexOf(each.cube), design: each.design });
    return element(
      "article",
      { class: "card", "data-key": each.cube.key(each.design) },
      element("h3", {}, sign(each.look), each.name),
      canvas,
      message,
      element(
        "dl",
        {},
        ...names.flatMap((name) => {
          const variable = each.cube.variable(name);
          const at =
            variable.along_strain && strain !== null
              ? ` at ${percent(each.cube.strains[strain])}`
              : "";
          const value =
            strain === null && variable.along_strain
              ? null
              : each.cube.value(name, each.design, strain);
          const text = value === null ? "–" : `${number(value)}${unit(variable.units)}`;
          return [element("dt", {}, `${variable.long_name}${at}`), element("dd", {}, text)];
        }),
      ),
      element("button", { onclick: show }, "Show"),
      element("button", { onclick: () => app.togglePin(each.design, each.cube) }, "Unpin"),
    );
  });
  refill(byId("pins"), ...cards);
}

async function drawShape({ store }, { cube, design, status }, strain, canvas, message) {
  const { shape, why_no_shape: why } = cube.designs[design];
  const frame = shape ? shape.frames.indexOf(strain) : -1;
  canvas.hidden = frame < 0;
  message.textContent = frame >= 0 ? "" : shape ? "No state at this strain." : `${status}. ${why}`;
  message.hidden = frame >= 0;
  if (frame < 0) return;
  const positions = await positionsOf(shape);
  const sheets = shape.frames.map((_, each) => sheetOf(shape, positions, each, 1));
  const turn = { ...store.state.turn, zoom: 1 };
  const camera = cameraOf(turn, boxOf([sheets[0], sheets.at(-1), sheets[frame]]), WIDTH, HEIGHT);
  painter(canvas).draw(sceneOf(shape, sheets[frame], { of: "patches" }), camera, INK);
}
