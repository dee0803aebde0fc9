// Linear scales and their ticks.

const STEPS = [1, 2, 2.5, 5, 10];

/** Map numbers of `domain` to `range`; `invert` maps back. */
export function linear([low, high], [start, end]) {
  const factor = (end - start) / (high - low || 1);
  const scale = (value) => start + (value - low) * factor;
  scale.invert = (place) => low + (place - start) / factor;
  return scale;
}

/** About `count` round numbers within a domain. */
export function ticks([low, high], count = 5) {
  const rough = (high - low || 1) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = STEPS.map((each) => each * power).find((each) => each >= rough);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) {
    found.push(Number((k * step).toPrecision(10)));
  }
  return found;
}

/** Smallest and largest of the numbers, nulls left out; `[0, 1]` if there is none. */
export function extent(values) {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values) {
    if (value === null || value === undefined) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return low <= high ? [low, high] : [0, 1];
}

/** A domain with some room at both ends. */
export function widened([low, high], part = 0.06) {
  const room = (high - low) * part || Math.abs(low) * part || 0.5;
  return [low - room, high + room];
}
