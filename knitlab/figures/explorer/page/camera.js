// The camera: parallel projection from a direction on a sphere, in millimetres a pixel.

const STEEPEST = 90;
/** Corners may leave the picture: seen from most sides, a sheet is smaller than its diagonal. */
const FILL = 1.2;
export const FIRST_TURN = { azimuth: -30, elevation: 45, zoom: 1 };

/** A turn after dragging by some degrees, and zooming by a factor. */
export function turned({ azimuth, elevation, zoom }, right, up, factor = 1) {
  const wrapped = ((((azimuth + right + 180) % 360) + 360) % 360) - 180;
  return {
    azimuth: Math.round(10 * wrapped) / 10,
    elevation: Math.round(10 * Math.min(Math.max(elevation + up, -STEEPEST), STEEPEST)) / 10,
    zoom: Math.round(100 * Math.min(Math.max(zoom * factor, 0.3), 12)) / 100,
  };
}

/** Rows of the rotation: rightwards, upwards and towards the eye. */
export function axesOf({ azimuth, elevation }) {
  const [a, e] = [(azimuth * Math.PI) / 180, (elevation * Math.PI) / 180];
  const [ca, sa, ce, se] = [Math.cos(a), Math.sin(a), Math.cos(e), Math.sin(e)];
  return [
    [ca, -sa, 0],
    [sa * se, ca * se, ce],
    [-sa * ce, -ca * ce, se],
  ];
}

/** Camera on a box `{middle, radius}` for a picture of some size in pixels. */
export function cameraOf(turn, box, width, height) {
  const axes = axesOf(turn);
  const scale = (FILL * turn.zoom * Math.min(width, height)) / 2 / box.radius;
  const project = (x, y, z) => {
    const moved = [x - box.middle[0], y - box.middle[1], z - box.middle[2]];
    const [right, up, near] = axes.map(
      (axis) => axis[0] * moved[0] + axis[1] * moved[1] + axis[2] * moved[2],
    );
    return [width / 2 + scale * right, height / 2 - scale * up, near];
  };
  return {
    axes,
    scale,
    width,
    height,
    project,
    box,
    matrix: matrixOf(axes, scale, box, width, height),
  };
}

/** Column-major matrix from millimetres to the cube that WebGL draws. */
function matrixOf(axes, scale, { middle, radius }, width, height) {
  const factors = [(2 * scale) / width, (2 * scale) / height, -1 / (2 * radius)];
  const matrix = new Float32Array(16);
  axes.forEach((axis, row) => {
    axis.forEach((component, column) => {
      matrix[4 * column + row] = factors[row] * component;
    });
    matrix[12 + row] =
      -factors[row] * axis.reduce((sum, component, k) => sum + component * middle[k], 0);
  });
  matrix[15] = 1;
  return matrix;
}

/** Middle and radius of a sphere around sheets. */
export function boxOf(sheets) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (const sheet of sheets) {
    for (let row = 0; row < sheet.rows; row += 1) {
      for (let column = 0; column < sheet.columns; column += 1) {
        sheet.at(row, column).forEach((value, k) => {
          low[k] = Math.min(low[k], value);
          high[k] = Math.max(high[k], value);
        });
      }
    }
  }
  const middle = low.map((value, k) => (value + high[k]) / 2);
  const radius = 0.5 * Math.hypot(...low.map((value, k) => high[k] - value)) || 1;
  return { middle, radius: 1.04 * radius, low, high };
}

/** Light on a face: from above the left shoulder, the same on both of its sides. */
export function lightOn(normal, axes) {
  const seen = axes.map((axis) => axis[0] * normal[0] + axis[1] * normal[1] + axis[2] * normal[2]);
  const length = Math.hypot(-0.45, 0.55, 0.7);
  const facing = seen[2] < 0 ? -1 : 1;
  const light = (facing * (-0.45 * seen[0] + 0.55 * seen[1] + 0.7 * seen[2])) / length;
  return 0.5 + 0.5 * Math.max(light, 0);
}
