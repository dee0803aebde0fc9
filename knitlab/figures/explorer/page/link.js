// The view as the part of a link behind #, so that a link restores it.

import { FIRST_TURN, turned } from "explorer/camera";
import { byId } from "explorer/elements";
import { defaultAxes } from "explorer/slice";
import { firstFilters } from "explorer/filters";
import { PIN_MARKS } from "explorer/colours";

const WAIT_MS = 150;
const COPIED_MS = 1500;

/** The view of a cube at first: its most auxetic state, or that of its first curve. */
export function firstView(cubes, index) {
  const cube = cubes[index];
  const along = cube.variables.filter((variable) => variable.along_strain).map(({ name }) => name);
  const first = (...names) => names.find((name) => cube.has(name));
  const upper = first("poisson_ratio", "row_force", "capacitance") ?? along[0];
  const lower = first("capacitance", "reaction_force", "zigzag_force") ?? along[1] ?? along[0];
  const of = upper ?? cube.variables[0].name;
  const [design, strain] = cube.lowest(of);
  return {
    cube: index,
    tab: "explore",
    theme: "",
    design,
    strain,
    of,
    ...defaultAxes(cube),
    upper,
    lower: cube.has("reaction_force") ? "reaction_force" : lower,
    pins: [],
    filters: firstFilters(cube),
    sort: cube.has("poisson_ratio_min") ? "poisson_ratio_min" : of,
    paint: "patches",
    repeats: "2",
    turn: FIRST_TURN,
  };
}

/** The view that a link names; what it does not name, or names wrongly, is as at first. */
export function viewOf(hash, cubes) {
  const stated = new URLSearchParams(hash.replace(/^#/, ""));
  const named = cubes.findIndex(({ name }) => name === stated.get("cube"));
  const index = named < 0 ? 0 : named;
  const cube = cubes[index];
  const view = firstView(cubes, index);
  const take = (name, valid, read = (text) => text) => {
    const text = stated.get(name);
    if (text !== null && valid(text)) view[name] = read(text);
  };
  const isAxis = (name) => cube.axes.some((axis) => axis.name === name);
  const isCurve = (name) => cube.variable(name)?.along_strain;
  take(
    "design",
    (text) => cube.find(text) !== null,
    (text) => cube.find(text),
  );
  take(
    "strain",
    (text) => text && Number.isFinite(Number(text)),
    (text) => nearest(cube.strains, Number(text)),
  );
  take("of", (name) => cube.has(name));
  take("x", isAxis);
  take("y", isAxis);
  take("upper", isCurve);
  take("lower", isCurve);
  take("pins", Boolean, (text) =>
    text
      .split(";")
      .filter((key) => isPin(key, cubes))
      .slice(0, PIN_MARKS.length),
  );
  take("filters", Boolean, (text) =>
    text
      .split(";")
      .map(windowOf)
      .filter(({ name }) => cube.has(name)),
  );
  take("sort", (name) => isAxis(name.replace("-", "")) || cube.has(name.replace("-", "")));
  take("paint", (name) => ["patches", "height", "electrodes"].includes(name));
  take("repeats", (text) => ["1", "2", "3"].includes(text));
  take("tab", (name) => ["explore", "report"].includes(name));
  take("theme", (name) => ["light", "dark"].includes(name));
  take("turn", (text) => text.split(",").every((part) => Number.isFinite(Number(part))), turnOf);
  return view;
}

/** The part of a link behind # that names a view; what is as at first is left out. */
export function hashOf(state, cubes) {
  const cube = cubes[state.cube];
  const first = firstView(cubes, state.cube);
  const written = {
    design: cube.key(state.design),
    strain: cube.strains[state.strain],
    pins: state.pins.join(";"),
    filters: state.filters
      .map(({ name, low, high }) => `${name}:${low ?? ""}:${high ?? ""}`)
      .join(";"),
    turn: [state.turn.azimuth, state.turn.elevation, state.turn.zoom].join(),
  };
  const stated = new URLSearchParams();
  if (state.cube) stated.set("cube", cube.name);
  for (const [name, value] of Object.entries(state)) {
    const asAtFirst = JSON.stringify(value) === JSON.stringify(first[name]);
    // The design and the strain are always named, so that a link says what it shows.
    if (name === "cube" || (asAtFirst && !["design", "strain"].includes(name))) continue;
    stated.set(name, written[name] ?? value);
  }
  return `#${stated}`;
}

/** Write the view into the address, follow links to other views, and copy the link when asked. */
export function link(app) {
  const { store, cubes } = app;
  let timer = null;
  const write = () => {
    clearTimeout(timer);
    timer = null;
    history.replaceState(null, "", hashOf(store.state, cubes));
  };
  store.show(() => {
    timer ??= setTimeout(write, WAIT_MS);
  });
  addEventListener("hashchange", () => app.show(viewOf(location.hash, cubes)));
  byId("copy").addEventListener("click", async () => {
    write();
    const button = byId("copy");
    try {
      await navigator.clipboard.writeText(location.href);
      button.textContent = "Copied";
    } catch {
      button.textContent = "Copy it from the address bar";
    }
    setTimeout(() => {
      button.textContent = "Copy link";
    }, COPIED_MS);
  });
}

function nearest(values, wanted) {
  const distances = values.map((value) => Math.abs(value - wanted));
  return distances.indexOf(Math.min(...distances));
}

function isPin(key, cubes) {
  const [index, ...labels] = key.split(":");
  return (cubes[Number(index)]?.find(labels.join(":")) ?? null) !== null;
}

function windowOf(text) {
  const parts = text.split(":");
  const [low, high] = parts.slice(-2).map((part) => (part === "" ? null : Number(part)));
  return { name: parts.slice(0, -2).join(":"), low, high };
}

function turnOf(text) {
  const [azimuth, elevation, zoom] = text.split(",").map(Number);
  return turned({ azimuth, elevation, zoom: zoom || 1 }, 0, 0);
}
