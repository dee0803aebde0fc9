// Drawing a scene with WebGL.

const FACES = {
  vertex: `
    attribute vec3 place, normal, colour;
    uniform mat4 matrix;
    uniform mat3 turn;
    uniform float lift;
    varying vec3 shade;
    void main() {
      gl_Position = matrix * vec4(place, 1.0) - vec4(0.0, 0.0, lift, 0.0);
      vec3 seen = turn * normal;
      float light = sign(seen.z) * dot(seen, normalize(vec3(-0.45, 0.55, 0.7)));
      shade = colour * (0.5 + 0.5 * max(light, 0.0));
    }`,
  fragment:
    "precision mediump float; varying vec3 shade; void main() { gl_FragColor = vec4(shade, 1.0); }",
};
const LINES = {
  vertex: `
    attribute vec3 place;
    uniform mat4 matrix;
    uniform float lift;
    void main() { gl_Position = matrix * vec4(place, 1.0) - vec4(0.0, 0.0, lift, 0.0); }`,
  fragment:
    "precision mediump float; uniform vec3 ink; void main() { gl_FragColor = vec4(ink, 1.0); }",
};
const CORNERS = [0, 1, 2, 0, 2, 3];
const [PLATE_LIFT, LINE_LIFT] = [0.004, 0.006];

/** A renderer on a canvas, or null where there is no WebGL. */
export function webglRenderer(canvas) {
  const gl = canvas.getContext("webgl", { antialias: true, alpha: true });
  if (!gl) return null;
  const faces = program(gl, FACES);
  const lines = program(gl, LINES);
  let loaded = null;
  const load = (scene) => {
    for (const set of loaded?.sets ?? []) set.buffers.forEach((buffer) => gl.deleteBuffer(buffer));
    loaded = {
      scene,
      sets: [
        quads(gl, scene.faces),
        quads(gl, scene.plates),
        { buffers: [filled(gl, scene.lines)], count: scene.lines.length / 3 },
      ],
    };
  };
  return {
    name: "webgl",
    draw(scene, camera, ink) {
      if (loaded?.scene !== scene) load(scene);
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.enable(gl.DEPTH_TEST);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      const [fabric, plates, borders] = loaded.sets;
      drawFaces(gl, faces, fabric, camera, 0);
      drawFaces(gl, faces, plates, camera, PLATE_LIFT);
      gl.useProgram(lines);
      gl.uniformMatrix4fv(gl.getUniformLocation(lines, "matrix"), false, camera.matrix);
      gl.uniform1f(gl.getUniformLocation(lines, "lift"), LINE_LIFT);
      gl.uniform3fv(gl.getUniformLocation(lines, "ink"), ink);
      point(gl, lines, "place", borders.buffers[0]);
      gl.drawArrays(gl.LINES, 0, borders.count);
    },
  };
}

function drawFaces(gl, used, { buffers, count }, camera, lift) {
  if (!count) return;
  gl.useProgram(used);
  gl.uniformMatrix4fv(gl.getUniformLocation(used, "matrix"), false, camera.matrix);
  const turn = [0, 1, 2].flatMap((column) => camera.axes.map((axis) => axis[column]));
  gl.uniformMatrix3fv(gl.getUniformLocation(used, "turn"), false, turn);
  gl.uniform1f(gl.getUniformLocation(used, "lift"), lift);
  ["place", "normal", "colour"].forEach((name, k) => point(gl, used, name, buffers[k]));
  gl.drawArrays(gl.TRIANGLES, 0, count);
}

/** Buffers of places, normals and colours of two triangles for each face. */
function quads(gl, { count, corners, normals, colours }) {
  const places = new Float32Array(18 * count);
  const repeated = [normals, colours].map((values) => {
    const many = new Float32Array(18 * count);
    for (let k = 0; k < 6 * count; k += 1) {
      const face = 3 * Math.floor(k / 6);
      many.set(values.subarray(face, face + 3), 3 * k);
    }
    return many;
  });
  for (let face = 0; face < count; face += 1) {
    CORNERS.forEach((corner, k) => {
      const from = 12 * face + 3 * corner;
      places.set(corners.subarray(from, from + 3), 18 * face + 3 * k);
    });
  }
  return { buffers: [places, ...repeated].map((values) => filled(gl, values)), count: 6 * count };
}

function filled(gl, values) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
  return buffer;
}

function point(gl, used, name, buffer) {
  const place = gl.getAttribLocation(used, name);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.enableVertexAttribArray(place);
  gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
}

function program(gl, { vertex, fragment }) {
  const made = gl.createProgram();
  for (const [kind, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return made;
}
