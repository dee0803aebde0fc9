// Drawing a scene on a plain canvas, from the farthest face to the nearest: where there is no WebGL,
// and for small pictures.

import { lightOn } from "explorer/camera";

const LIFT = 0.01;

/** A renderer on a canvas. */
export function painter(canvas) {
  const pen = canvas.getContext("2d");
  return {
    name: "canvas",
    draw(scene, camera, ink) {
      pen.clearRect(0, 0, canvas.width, canvas.height);
      const pieces = [
        ...facesOf(scene.faces, camera, 0),
        ...facesOf(scene.plates, camera, LIFT * camera.box.radius),
        ...linesOf(scene.lines, camera, LIFT * camera.box.radius),
      ];
      pieces.sort((one, other) => one.depth - other.depth);
      const dark = `rgb(${ink.map((channel) => Math.round(255 * channel)).join(" ")})`;
      for (const { points, colour } of pieces) {
        pen.beginPath();
        points.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
        pen.strokeStyle = colour ?? dark;
        pen.lineWidth = colour ? 0.6 : 1.2;
        if (colour) {
          pen.closePath();
          pen.fillStyle = colour;
          pen.fill();
        }
        pen.stroke();
      }
    },
  };
}

function* facesOf({ count, corners, normals, colours }, camera, lift) {
  for (let face = 0; face < count; face += 1) {
    const points = [0, 3, 6, 9].map((k) => {
      const at = 12 * face + k;
      return camera.project(corners[at], corners[at + 1], corners[at + 2]);
    });
    const light = lightOn(normals.subarray(3 * face, 3 * face + 3), camera.axes);
    const channels = [0, 1, 2].map((k) => Math.round(255 * light * colours[3 * face + k]));
    const depth = points.reduce((sum, point) => sum + point[2], 0) / 4 + lift;
    yield { points, depth, colour: `rgb(${channels.join(" ")})` };
  }
}

function* linesOf(lines, camera, lift) {
  for (let k = 0; k < lines.length; k += 6) {
    const points = [0, 3].map((end) =>
      camera.project(lines[k + end], lines[k + end + 1], lines[k + end + 2]),
    );
    yield { points, depth: (points[0][2] + points[1][2]) / 2 + lift, colour: null };
  }
}
