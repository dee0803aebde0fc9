// The sheet of a fabric at one strain: its faces, patch borders and electrodes in space.

const RIB = [86, 160, 211];
const GARTER = [240, 200, 120];
const PLAIN = [225, 225, 225];
export const KNITS = { R: ["rib", RIB], G: ["garter", GARTER], P: ["plain", PLAIN] };
export const ELECTRODES = [
  ["A", [170, 50, 0]],
  ["B", [90, 60, 200]],
];
const FABRIC = [205, 205, 205];

/** Node grid of a frame, periodic fabric repeated and closed: `{rows, columns, at(row, column)}`. */
export function sheetOf(shape, positions, frame, repeats) {
  const { rows, columns, periods } = shape;
  const place = positions[frame];
  if (!periods) {
    return { rows, columns, cellsY: rows - 1, cellsX: columns - 1, at: node(place, columns, 0, 0) };
  }
  const [lengthX, lengthY, shear = 0] = periods[frame];
  const at = (row, column) => {
    const [turnY, turnX] = [Math.floor(row / rows), Math.floor(column / columns)];
    const right = turnX * lengthX + turnY * shear;
    const read = node(place, columns, right, turnY * lengthY);
    return read(row - turnY * rows, column - turnX * columns);
  };
  return {
    rows: repeats * rows + 1,
    columns: repeats * columns + 1,
    cellsY: rows,
    cellsX: columns,
    at,
  };
}

function node(place, columns, right, up) {
  return (row, column) => {
    const k = 3 * (row * columns + column);
    return [place[k] + right, place[k + 1] + up, place[k + 2]];
  };
}

/**
 * What is drawn of a sheet: `faces` and `plates` (electrodes) with corners, normals and colours, and
 * `lines` along patch borders.
 */
export function sceneOf(shape, sheet, paint) {
  const faces = new Faces((sheet.rows - 1) * (sheet.columns - 1));
  const tint = paint.of === "height" ? byHeight(sheet, paint) : byPatch(shape, sheet, paint);
  for (let row = 0; row < sheet.rows - 1; row += 1) {
    for (let column = 0; column < sheet.columns - 1; column += 1) {
      const corners = [
        sheet.at(row, column),
        sheet.at(row, column + 1),
        sheet.at(row + 1, column + 1),
        sheet.at(row + 1, column),
      ];
      faces.add(corners, tint(row, column, corners));
    }
  }
  return { faces, plates: platesOf(shape, sheet), lines: bordersOf(shape, sheet) };
}

function byHeight(sheet, { colour }) {
  return (row, column, corners) => colour(corners.reduce((sum, corner) => sum + corner[2], 0) / 4);
}

function byPatch(shape, sheet, { of }) {
  if (of === "electrodes") return () => FABRIC;
  const patchOf = (borders, cell) => borders.findIndex((border) => border > cell) - 1;
  const rows = Array.from({ length: sheet.cellsY }, (_, cell) => patchOf(shape.row_borders, cell));
  const columns = Array.from({ length: sheet.cellsX }, (_, cell) =>
    patchOf(shape.column_borders, cell),
  );
  return (row, column) =>
    KNITS[shape.knit[rows[row % sheet.cellsY]][columns[column % sheet.cellsX]]][1];
}

function bordersOf(shape, sheet) {
  const lines = [];
  for (const row of repeated(shape.row_borders, sheet.cellsY, sheet.rows)) {
    for (let column = 0; column < sheet.columns - 1; column += 1) {
      lines.push(...sheet.at(row, column), ...sheet.at(row, column + 1));
    }
  }
  for (const column of repeated(shape.column_borders, sheet.cellsX, sheet.columns)) {
    for (let row = 0; row < sheet.rows - 1; row += 1) {
      lines.push(...sheet.at(row, column), ...sheet.at(row + 1, column));
    }
  }
  return new Float32Array(lines);
}

function repeated(borders, cells, count) {
  const found = new Set();
  for (let turn = 0; turn * cells < count; turn += 1) {
    for (const border of borders)
      if (border + turn * cells < count) found.add(border + turn * cells);
  }
  return found;
}

/** Middles of the patches with their letters, and of the electrodes with theirs. */
export function labelsOf(shape, sheet, paint) {
  const found = [];
  if (paint.of === "patches") {
    for (let row = 0; row < shape.knit.length; row += 1) {
      for (let column = 0; column < shape.knit[row].length; column += 1) {
        const middle = (borders, k) => Math.floor((borders[k] + borders[k + 1]) / 2);
        const at = sheet.at(middle(shape.row_borders, row), middle(shape.column_borders, column));
        found.push({ at, letter: shape.knit[row][column] });
      }
    }
  }
  (shape.electrodes?.strips ?? []).forEach((strips, which) => {
    const [left, right, bottom, top] = strips[0];
    const place = (low, high, count) => Math.floor((low + high) / 2) % count;
    const at = sheet.at(place(bottom, top, sheet.rows - 1), place(left, right, sheet.columns - 1));
    found.push({ at, letter: ELECTRODES[which][0] });
  });
  return found;
}

/** Electrodes as faces: on periodic fabric they go on along their direction, not across it. */
function platesOf(shape, sheet) {
  const plates = [];
  const { strips: electrodes = [], along } = shape.electrodes ?? {};
  electrodes.forEach((strips, which) => {
    for (const strip of strips) {
      for (const [row, column, bottom, top, left, right] of pieces(shape, sheet, strip, along)) {
        const inside = (u, v) => between(sheet, row, column, u, v);
        const corners = [
          inside(left, bottom),
          inside(right, bottom),
          inside(right, top),
          inside(left, top),
        ];
        plates.push([corners, ELECTRODES[which][1]]);
      }
    }
  });
  const faces = new Faces(plates.length);
  for (const [corners, colour] of plates) faces.add(corners, colour);
  return faces;
}

/** Parts of a strip within single grid cells: cell, and its part of that from 0 to 1. */
function pieces(shape, sheet, [left, right, bottom, top], along) {
  const found = [];
  const turnsX = shape.periods && along === "course" ? (sheet.columns - 1) / sheet.cellsX : 1;
  const turnsY = shape.periods && along === "wale" ? (sheet.rows - 1) / sheet.cellsY : 1;
  const split = (low, high, first, count) => {
    const parts = [];
    for (let cell = Math.floor(low); cell < high; cell += 1) {
      const part = [Math.max(low, cell) - cell, Math.min(high, cell + 1) - cell];
      const moved = (((cell + first) % count) + count) % count;
      if (part[1] > part[0]) parts.push([moved, ...part]);
    }
    return parts;
  };
  for (let turnY = 0; turnY < turnsY; turnY += 1) {
    for (let turnX = 0; turnX < turnsX; turnX += 1) {
      for (const [row, low, high] of split(bottom, top, turnY * sheet.cellsY, sheet.rows - 1)) {
        for (const [column, from, to] of split(
          left,
          right,
          turnX * sheet.cellsX,
          sheet.columns - 1,
        )) {
          found.push([row, column, low, high, from, to]);
        }
      }
    }
  }
  return found;
}

function between(sheet, row, column, u, v) {
  const [a, b] = [sheet.at(row, column), sheet.at(row, column + 1)];
  const [c, d] = [sheet.at(row + 1, column), sheet.at(row + 1, column + 1)];
  return [0, 1, 2].map(
    (k) => (1 - v) * ((1 - u) * a[k] + u * b[k]) + v * ((1 - u) * c[k] + u * d[k]),
  );
}

/** Quadrilaterals: four corners (12 numbers), a normal (3) and a colour (3, from 0 to 1) each. */
export class Faces {
  constructor(count) {
    this.count = 0;
    this.corners = new Float32Array(12 * count);
    this.normals = new Float32Array(3 * count);
    this.colours = new Float32Array(3 * count);
  }

  add(corners, colour) {
    const [a, b, c, d] = corners;
    corners.forEach((corner, k) => this.corners.set(corner, 12 * this.count + 3 * k));
    this.normals.set(unitNormal(a, b, c, d), 3 * this.count);
    this.colours.set(
      colour.map((channel) => channel / 255),
      3 * this.count,
    );
    this.count += 1;
  }
}

/** Unit normal of a quadrilateral: across its diagonals. */
function unitNormal(a, b, c, d) {
  const p = c.map((component, k) => component - a[k]);
  const q = d.map((component, k) => component - b[k]);
  const normal = [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
  const length = Math.hypot(...normal) || 1;
  return normal.map((component) => component / length);
}
