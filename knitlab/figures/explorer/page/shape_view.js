// The shape of the selected design at the applied strain, which turns.

import { FIRST_TURN, boxOf, cameraOf, turned } from "explorer/camera";
import { colourScale } from "explorer/colours";
import { STATUS } from "explorer/cube";
import { byId, choice, svgElement, element, onWidth, refill } from "explorer/elements";
import { number, percent } from "explorer/numbers";
import { painter } from "explorer/painter";
import { positionsOf } from "explorer/positions";
import { colourBar } from "explorer/colour_bar";
import { ELECTRODES, KNITS, labelsOf, sceneOf, sheetOf } from "explorer/sheet";
import { anyOf } from "explorer/store";
import { listenToTurns } from "explorer/turning";
import { webglRenderer } from "explorer/webgl";

const PAINTS = [
  ["patches", "patches"],
  ["height", "height z"],
  ["electrodes", "electrodes"],
];
const HEIGHT = { long_name: "height z", units: "mm" };
const INKS = { light: [0.12, 0.12, 0.14], dark: [0.02, 0.02, 0.03] };
const SHARPEST = 2;

/** Draw the shape, and keep it up to date. */
export function shapeView(app) {
  const view = new ShapeView(app);
  onWidth(byId("stage"), () => view.paint());
  app.store.show((state, changed) => {
    if (anyOf(changed, "cube", "design", "paint", "repeats")) view.drawChoices();
    if (anyOf(changed, "cube", "design", "strain", "paint", "repeats")) view.load();
    else if (anyOf(changed, "turn", "theme")) view.paint();
  });
}

class ShapeView {
  constructor(app) {
    this.app = app;
    this.canvas = element("canvas", { id: "shape", tabindex: 0, role: "img" });
    this.labels = element("canvas", { class: "labels", "aria-hidden": true });
    this.message = element("p", { class: "message", role: "status" });
    this.banner = element("p", { class: "banner" });
    byId("stage").append(this.canvas, this.labels, this.banner, this.message);
    this.renderer = webglRenderer(this.canvas) ?? painter(this.canvas);
    byId("stage").dataset.renderer = this.renderer.name;
    listenToTurns(this.canvas, (right, up, factor) =>
      app.store.set({ turn: turned(app.store.state.turn, right, up, factor) }),
    );
    this.canvas.addEventListener("keydown", (event) => {
      if (event.key === "0" || event.key === "Home") this.reset();
    });
    this.boxes = new WeakMap();
  }

  get shape() {
    const { store, cube } = this.app;
    return cube.designs[store.state.design].shape;
  }

  reset() {
    this.app.store.set({ turn: FIRST_TURN });
  }

  drawChoices() {
    const { store } = this.app;
    const { state } = store;
    const { shape } = this;
    const zoom = (factor) => () => store.set({ turn: turned(state.turn, 0, 0, factor) });
    const paints = PAINTS.filter(([name]) => name !== "electrodes" || shape?.electrodes);
    const cells = ["1", "2", "3"].map((count) => [count, `${count} × ${count}`]);
    refill(
      byId("shape-choices"),
      choice("Colour", [["", paints]], this.paintOf(), (paint) => store.set({ paint })),
      ...(shape?.periods
        ? [choice("Repeats", [["", cells]], state.repeats, (repeats) => store.set({ repeats }))]
        : []),
      element("button", { onclick: zoom(1.25), "aria-label": "Larger" }, "+"),
      element("button", { onclick: zoom(0.8), "aria-label": "Smaller" }, "−"),
      element("button", { onclick: () => this.reset() }, "Reset view"),
    );
  }

  paintOf() {
    const { paint } = this.app.store.state;
    return paint === "electrodes" && !this.shape?.electrodes ? "patches" : paint;
  }

  /** Build the scene of the present design and strain; positions are unpacked when first needed. */
  async load() {
    const { store, cube } = this.app;
    const { shape } = this;
    const { design, strain, repeats } = store.state;
    const frame = shape ? shape.frames.indexOf(strain) : -1;
    this.describe(frame);
    if (frame < 0) {
      this.scene = null;
      this.paint();
      return;
    }
    const positions = await positionsOf(shape);
    // Meanwhile something else may have been chosen.
    if (shape !== this.shape || strain !== store.state.strain) return;
    const sheet = (which) => sheetOf(shape, positions, which, Number(repeats));
    this.box = this.boxOf(shape, repeats, sheet);
    const shown = sheet(frame);
    const paint = this.paintWith(this.box);
    this.scene = sceneOf(shape, shown, paint);
    this.letters = labelsOf(shape, shown, paint);
    this.drawLegend(paint);
    this.paint();
    Object.assign(byId("stage").dataset, {
      design: cube.key(design),
      strain: cube.strains[strain],
    });
  }

  boxOf(shape, repeats, sheet) {
    if (!this.boxes.has(shape)) this.boxes.set(shape, new Map());
    const known = this.boxes.get(shape);
    if (!known.has(repeats))
      known.set(repeats, boxOf(shape.frames.map((_, frame) => sheet(frame))));
    return known.get(repeats);
  }

  paintWith({ low, high }) {
    const of = this.paintOf();
    if (of !== "height") return { of };
    const range = [low[2], high[2]];
    const colours = this.app.content.colours.sequence;
    return { of, range, colour: colourScale({ sequence: colours, signed: colours }, range) };
  }

  /** Say what is shown, or why nothing is. */
  describe(frame) {
    const { store, cube, content } = this.app;
    const { design, strain } = store.state;
    const each = cube.designs[design];
    const at = percent(cube.strains[strain]);
    const through = cube.value("self_intersections", design, strain) ?? 0;
    const said = [];
    if (frame < 0) {
      if (each.status === STATUS.failed)
        said.push(`This case failed${each.reason ? `: ${each.reason}` : ""}.`);
      else if (each.status === STATUS.pending) said.push("This case has not been run yet.");
      else if (each.shape) said.push(missingFrame(at, each.shape.frames, cube.strains));
      if (!each.shape && each.status !== STATUS.pending) said.push(each.why_no_shape);
    }
    this.message.textContent = said.join(" ");
    this.message.hidden = !said.length;
    const warned = frame >= 0 && through > 0;
    this.banner.textContent = warned
      ? `The fabric passes through itself here, at ${number(through)} pairs of grid cells: not a shape that cloth can take.`
      : "";
    this.banner.hidden = !warned;
    byId("stage").classList.toggle("through", warned);
    byId("stage").classList.toggle("failed", each.status === STATUS.failed);
    this.canvas.setAttribute(
      "aria-label",
      frame < 0
        ? "No shape"
        : `Shape of ${cube.label(design)} at ${at}. Arrow keys turn it, + and − zoom.`,
    );
    byId("shape-title").textContent = `3 · Its shape at ${at}`;
    if (frame < 0) byId("shape-legend").replaceChildren();
    Object.assign(byId("stage").dataset, { design: "", strain: "" });
    byId("stage").title = cube.statusOf(design, content.statuses);
  }

  paint() {
    const ratio = Math.min(globalThis.devicePixelRatio || 1, SHARPEST);
    const { clientWidth, clientHeight } = byId("stage");
    const [width, height] = [Math.round(clientWidth * ratio), Math.round(clientHeight * ratio)];
    if (!width || !height) return;
    for (const canvas of [this.canvas, this.labels]) Object.assign(canvas, { width, height });
    if (!this.scene) return;
    const camera = cameraOf(this.app.store.state.turn, this.box, width, height);
    this.renderer.draw(this.scene, camera, INKS.light);
    drawLetters(this.labels, camera, this.letters, ratio);
    drawScaleBar(this.labels, camera, ratio);
  }

  drawLegend({ of, range, colour }) {
    const { shape } = this;
    const square = ([red, green, blue]) =>
      svgElement(
        "svg",
        { width: 16, height: 14, "aria-hidden": true },
        svgElement("rect", {
          x: 1,
          y: 1,
          width: 14,
          height: 12,
          class: "frame",
          fill: `rgb(${red} ${green} ${blue})`,
        }),
      );
    const knits = [...new Set(shape.knit.join(""))].map((letter) => [letter, ...KNITS[letter]]);
    const entries = [
      ...(of === "patches"
        ? knits.map(([letter, name, tint]) => [tint, `${letter}: ${name}`])
        : []),
      ...(shape.electrodes
        ? ELECTRODES.map(([name, tint]) => [tint, `${name}: electrode ${name}`])
        : []),
    ];
    const error = Math.max(...shape.error);
    byId("shape-legend").replaceChildren(
      element("ul", {}, ...entries.map(([tint, words]) => element("li", {}, square(tint), words))),
      ...(of === "height" ? [colourBar(range, colour, HEIGHT)] : []),
      element(
        "p",
        {},
        `Lines are patch borders. Lengths are in ${shape.unit}. `,
        `Positions are off by ${number(error, 2)} mm at most, as this page stores them in 12 bits.`,
        shape.note ? ` Shown: ${shape.note}.` : "",
        this.renderer.name === "canvas"
          ? " This browser has no WebGL: the shape is drawn more slowly."
          : "",
      ),
    );
  }
}

/** Why there is no shape at a strain: the test ended before it, or its file keeps some shapes only. */
function missingFrame(at, frames, strains) {
  const listed = frames.map((frame) => percent(strains[frame]));
  const gapless = frames.every((frame, k) => frame === k);
  return gapless
    ? `The test ended at ${listed.at(-1)}, so that there is no state at ${at}.`
    : `There is no shape at ${at}; its case file has those at ${listed.join(", ")}.`;
}

function inkOf(canvas) {
  const style = getComputedStyle(canvas);
  return { ink: style.getPropertyValue("--ink"), ground: style.getPropertyValue("--panel") };
}

function drawLetters(canvas, camera, letters, ratio) {
  const pen = canvas.getContext("2d");
  const { ink, ground } = inkOf(canvas);
  pen.font = `600 ${13 * ratio}px sans-serif`;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.lineWidth = 3 * ratio;
  for (const { at, letter } of letters) {
    const [x, y] = camera.project(...at);
    pen.strokeStyle = ground;
    pen.strokeText(letter, x, y);
    pen.fillStyle = ink;
    pen.fillText(letter, x, y);
  }
}

function drawScaleBar(canvas, camera, ratio) {
  const pen = canvas.getContext("2d");
  const room = camera.width / 4 / camera.scale;
  const power = 10 ** Math.floor(Math.log10(room));
  const length = [5, 2, 1].map((each) => each * power).find((each) => each <= room);
  const [left, bottom] = [12 * ratio, canvas.height - 12 * ratio];
  const { ink } = inkOf(canvas);
  pen.strokeStyle = ink;
  pen.fillStyle = ink;
  pen.lineWidth = 2 * ratio;
  pen.beginPath();
  pen.moveTo(left, bottom - 4 * ratio);
  pen.lineTo(left, bottom);
  pen.lineTo(left + length * camera.scale, bottom);
  pen.lineTo(left + length * camera.scale, bottom - 4 * ratio);
  pen.stroke();
  pen.font = `${11 * ratio}px sans-serif`;
  pen.textAlign = "left";
  pen.textBaseline = "alphabetic";
  pen.fillText(`${number(length)} mm`, left, bottom - 8 * ratio);
}
