// One chart of a variable against the applied strain.

import { svgElement } from "explorer/elements";
import { mark } from "explorer/marks";
import { number, percent, withUnit } from "explorer/numbers";
import { extent, linear, ticks, widened } from "explorer/scale";
import { sliceOf } from "explorer/slice";

const HEIGHT = 190;
const [LEFT, RIGHT, TOP, BOTTOM] = [60, 10, 8, 34];
const MARKED = 40;

/** Chart of the shown designs; pressing or dragging in it sets the strain. */
export function chart({ store, cube, passes }, variable, shown, width) {
  const own = shown.filter((each) => each.cube.has(variable.name));
  const others = [...sliceOf(cube, store.state).cells.values()].filter(
    (design) => passes(design) && !own.some((each) => each.cube === cube && each.design === design),
  );
  const x = linear(widened(extent(cube.strains), 0.02), [LEFT, width - RIGHT]);
  const y = linear(widened(rangeOf(cube, variable.name, own, others)), [HEIGHT - BOTTOM, TOP]);
  const strain = cube.strains[store.state.strain];
  const seek = (event) => {
    const place = event.offsetX * (width / event.currentTarget.clientWidth || 1);
    const distances = cube.strains.map((each) => Math.abs(x(each) - place));
    store.set({ strain: distances.indexOf(Math.min(...distances)) });
  };
  return svgElement(
    "svg",
    {
      class: "chart",
      viewBox: `0 0 ${width} ${HEIGHT}`,
      width,
      height: HEIGHT,
      role: "img",
      "data-variable": variable.name,
      "aria-label": `${withUnit(variable)} against applied strain, of ${own.map(({ name }) => name).join("; ")}`,
      onpointerdown: seek,
      onpointermove: (event) => event.buttons && seek(event),
    },
    ...frame(cube, variable, x, y, width),
    ...others.map((design) =>
      svgElement("path", { class: "other", d: path(points(cube, variable.name, design, x, y)) }),
    ),
    svgElement("path", { class: "now", d: `M${x(strain)} ${TOP}V${HEIGHT - BOTTOM}` }),
    ...own.flatMap((each) => curve(each, variable.name, x, y)),
  );
}

function rangeOf(cube, name, own, others) {
  const values = others.flatMap((design) => cube.curve(name, design));
  for (const each of own) {
    each.cube.strains.forEach((_, strain) => {
      values.push(each.cube.value(name, each.design, strain));
      values.push(...(each.cube.band(name, each.design, strain) ?? []));
    });
  }
  return extent(values);
}

function frame(cube, variable, x, y, width) {
  const [low, high] = [y.invert(HEIGHT - BOTTOM), y.invert(TOP)];
  const strains = ticks([x.invert(LEFT), x.invert(width - RIGHT)], width / 80);
  const floor = HEIGHT - BOTTOM;
  return [
    ...ticks([low, high], 4).flatMap((value) => [
      svgElement("path", {
        class: value === 0 ? "zero" : "grid",
        d: `M${LEFT} ${y(value)}H${width - RIGHT}`,
      }),
      svgElement("text", { class: "tick end", x: LEFT - 6, y: y(value) + 4 }, number(value)),
    ]),
    ...strains.map((value) =>
      svgElement("text", { class: "tick", x: x(value), y: floor + 14 }, percent(value)),
    ),
    svgElement("text", { class: "axis", x: (LEFT + width) / 2, y: HEIGHT - 5 }, "applied strain"),
    svgElement(
      "text",
      { class: "axis", transform: `translate(11 ${floor / 2 + 4}) rotate(-90)` },
      variable.units === "1" ? shortened(variable.long_name) : withUnit(variable).slice(-30),
    ),
  ];
}

function shortened(name) {
  return name.length > 26 ? `${name.slice(0, 25)}…` : name;
}

function points(cube, name, design, x, y) {
  return cube.strains.map((strain, k) => {
    const value = cube.value(name, design, k);
    return value === null
      ? null
      : { x: x(strain), y: y(value), snapped: cube.snapped(design, k), k };
  });
}

/** Line through points, with a gap where one is missing or the fabric snapped on the way to it. */
function path(places) {
  let drawing = false;
  return places
    .map((place) => {
      if (place === null) {
        drawing = false;
        return "";
      }
      const step = drawing && !place.snapped ? "L" : "M";
      drawing = true;
      return `${step}${place.x.toFixed(1)} ${place.y.toFixed(1)}`;
    })
    .join("");
}

function curve({ cube, design, look, selected, status }, name, x, y) {
  const places = points(cube, name, design, x, y);
  const present = places.filter((place) => place !== null);
  const unfinished = status === "not converged" && present.length;
  return [
    svgElement("path", { class: "band", fill: look.colour, d: bandPath(cube, name, design, x, y) }),
    svgElement("path", {
      class: selected ? "line selected" : "line",
      stroke: look.colour,
      "stroke-dasharray": look.dash,
      d: path(places),
      "data-key": cube.key(design),
    }),
    ...(present.length <= MARKED ? present : present.filter((_, k) => k % 3 === 0)).map((place) =>
      mark(look.mark, place.x, place.y, look.colour, {
        hollow: cube.foldedThrough(design, place.k),
        size: 0.75,
      }),
    ),
    ...(unfinished
      ? [mark("cross", present.at(-1).x, present.at(-1).y, look.colour, { size: 1.5 })]
      : []),
  ];
}

function bandPath(cube, name, design, x, y) {
  const pieces = [];
  let piece = [];
  cube.strains.forEach((strain, k) => {
    const edges = cube.band(name, design, k);
    if (edges) piece.push([x(strain), y(edges[0]), y(edges[1])]);
    if ((!edges || k === cube.strains.length - 1) && piece.length) {
      pieces.push(piece);
      piece = [];
    }
  });
  return pieces
    .map((each) => {
      const up = each.map(([a, low]) => `${a.toFixed(1)} ${low.toFixed(1)}`);
      const down = each.map(([a, , high]) => `${a.toFixed(1)} ${high.toFixed(1)}`).reverse();
      return `M${[...up, ...down].join("L")}Z`;
    })
    .join("");
}
