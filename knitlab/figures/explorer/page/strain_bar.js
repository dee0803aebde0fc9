// The applied strain: a slider, and playing the test.

import { byId } from "explorer/elements";
import { percent } from "explorer/numbers";
import { anyOf } from "explorer/store";

const PLAYED_MS = 4000;
const SLOWEST_MS = 400;

/** Connect the slider and the button, and keep them up to date. */
export function strainBar(app) {
  const { store } = app;
  const [slider, play] = [byId("strain"), byId("play")];
  let timer = null;
  const stop = () => {
    clearInterval(timer);
    timer = null;
    play.textContent = "▶";
    play.setAttribute("aria-label", "Play the test");
  };
  slider.addEventListener("input", () => store.set({ strain: Number(slider.value) }));
  slider.addEventListener("pointerdown", stop);
  play.addEventListener("click", () => {
    if (timer) {
      stop();
      return;
    }
    const last = app.cube.strains.length - 1;
    if (store.state.strain >= last) store.set({ strain: 0 });
    play.textContent = "❚❚";
    play.setAttribute("aria-label", "Pause");
    timer = setInterval(
      () => {
        if (store.state.strain >= app.cube.strains.length - 1) stop();
        else store.set({ strain: store.state.strain + 1 });
      },
      Math.min(PLAYED_MS / (last + 1), SLOWEST_MS),
    );
  });
  store.show((state, changed) => {
    if (!anyOf(changed, "cube", "strain")) return;
    slider.max = app.cube.strains.length - 1;
    slider.value = state.strain;
    const shown = percent(app.cube.strains[state.strain]);
    byId("strain-value").textContent = shown;
    slider.setAttribute("aria-valuetext", shown);
  });
}
