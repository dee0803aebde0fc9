// Where the page starts: its content, its state, and its views.

import { appearance } from "explorer/appearance";
import { PIN_MARKS } from "explorer/colours";
import { Cube } from "explorer/cube";
import { curves } from "explorer/curves";
import { designMap } from "explorer/design_map";
import { designTable } from "explorer/design_table";
import { byId, element } from "explorer/elements";
import { filters, passes } from "explorer/filters";
import { firstView, link, viewOf } from "explorer/link";
import { pins } from "explorer/pins";
import { report } from "explorer/report";
import { shapeView } from "explorer/shape_view";
import { Store } from "explorer/store";
import { strainBar } from "explorer/strain_bar";

function start() {
  const content = JSON.parse(byId("content").textContent);
  const cubes = content.cubes.map((each) => new Cube(each));
  const store = new Store(viewOf(location.hash, cubes));
  const app = {
    content,
    cubes,
    store,
    get cube() {
      return cubes[store.state.cube];
    },
    passes: (design) => passes(app.cube, store.state.filters, design, store.state.strain),
    pinKey: (design, cube = app.cube) => `${cubes.indexOf(cube)}:${cube.key(design)}`,
    togglePin(design, cube = app.cube) {
      const key = app.pinKey(design, cube);
      const { pins: before } = store.state;
      if (before.includes(key)) store.set({ pins: before.filter((each) => each !== key) });
      else if (before.length < PIN_MARKS.length) store.set({ pins: [...before, key] });
    },
    /** Show another view wholly, as a link gives it. */
    show: (view) => store.set(view),
  };
  cubeChoice(app);
  appearance(app);
  strainBar(app);
  designMap(app);
  curves(app);
  shapeView(app);
  pins(app);
  filters(app);
  designTable(app);
  report(app);
  link(app);
  store.tell(true);
}

function cubeChoice({ store, cubes }) {
  const select = byId("cube");
  select.append(...cubes.map(({ name, title }, k) => element("option", { value: k, title }, name)));
  byId("cube-choice").hidden = cubes.length < 2;
  select.addEventListener("change", () => {
    const { pins: kept, theme, tab } = store.state;
    store.set({ ...firstView(cubes, Number(select.value)), pins: kept, theme, tab });
  });
  store.show((state) => {
    select.value = state.cube;
    byId("model").textContent = `Model: ${cubes[state.cube].model}`;
  });
}

try {
  start();
  byId("trouble").hidden = true;
} catch (error) {
  byId("trouble").textContent = `This page cannot be shown: ${error.message}`;
  throw error;
}
