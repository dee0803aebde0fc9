// Node positions, unpacked as knitlab/explorer/positions.py packs them.

const unpacked = new WeakMap();

/** Positions of all frames of a shape: one Float32Array (row, column, component) for each, in mm. */
export function positionsOf(shape) {
  if (!unpacked.has(shape)) unpacked.set(shape, unpack(shape));
  return unpacked.get(shape);
}

async function unpack({ positions, origin, step, rows, columns, frames }) {
  const bytes = Uint8Array.from(atob(positions), (character) => character.charCodeAt(0));
  const inflated = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const split = new Uint8Array(await new Response(inflated).arrayBuffer());
  const count = split.length / 2;
  const nodes = rows * columns;
  let [level, slope] = [new Int32Array(3 * nodes), new Int32Array(3 * nodes)];
  return frames.map((_, frame) => {
    const place = new Float32Array(3 * nodes);
    for (let component = 0; component < 3; component += 1) {
      for (let node = 0; node < nodes; node += 1) {
        const k = component * nodes + node;
        const at = frame * 3 * nodes + k;
        const unsigned = split[at] | (split[count + at] << 8);
        slope[k] += (unsigned >>> 1) ^ -(unsigned & 1);
        level[k] += slope[k];
        place[3 * node + component] = origin[component] + step[component] * level[k];
      }
    }
    return place;
  });
}
