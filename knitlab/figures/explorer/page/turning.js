// Turning and zooming by mouse, touch, wheel and keys.

const DEGREES_PER_PIXEL = 0.45;
const DEGREES_PER_KEY = 10;
const KEYS = {
  ArrowLeft: [-DEGREES_PER_KEY, 0],
  ArrowRight: [DEGREES_PER_KEY, 0],
  ArrowUp: [0, DEGREES_PER_KEY],
  ArrowDown: [0, -DEGREES_PER_KEY],
};
const ZOOM_KEYS = { "+": 1.25, "=": 1.25, "-": 0.8 };

/** Call `turn(right, up, factor)` in degrees and as a factor; the wheel zooms where it has focus. */
export function listenToTurns(canvas, turn) {
  const fingers = new Map();
  const distance = () => {
    const [one, other] = [...fingers.values()];
    return Math.hypot(one.x - other.x, one.y - other.y);
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const apart = fingers.size === 2 ? distance() : 0;
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (apart) turn(0, 0, distance() / apart);
    else {
      const [right, down] = [event.clientX - before.x, event.clientY - before.y];
      turn(right * DEGREES_PER_PIXEL, down * DEGREES_PER_PIXEL, 1);
    }
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  }
  canvas.addEventListener(
    "wheel",
    (event) => {
      if (!event.ctrlKey && document.activeElement !== canvas) return;
      event.preventDefault();
      turn(0, 0, Math.exp(-0.0015 * event.deltaY));
    },
    { passive: false },
  );
  canvas.addEventListener("keydown", (event) => {
    if (event.key in KEYS) turn(...KEYS[event.key], 1);
    else if (event.key in ZOOM_KEYS) turn(0, 0, ZOOM_KEYS[event.key]);
    else return;
    event.preventDefault();
  });
}
