// Tabs, light and dark.

import { byId } from "explorer/elements";
import { anyOf } from "explorer/store";

const TABS = ["explore", "report"];

/** Connect the tabs and the button for light and dark, and keep them up to date. */
export function appearance({ store }) {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const shown = () => store.state.theme || (dark.matches ? "dark" : "light");
  const paint = () => {
    document.documentElement.dataset.theme = shown();
    byId("theme").textContent = shown() === "dark" ? "Light" : "Dark";
  };
  dark.addEventListener("change", () => {
    paint();
    store.tell(true);
  });
  byId("theme").addEventListener("click", () =>
    store.set({ theme: shown() === "dark" ? "light" : "dark" }),
  );
  for (const name of TABS) {
    byId(`tab-${name}`).addEventListener("click", () => store.set({ tab: name }));
    byId(`tab-${name}`).addEventListener("keydown", (event) => {
      if (!["ArrowLeft", "ArrowRight"].includes(event.key)) return;
      const other = TABS[1 - TABS.indexOf(name)];
      store.set({ tab: other });
      byId(`tab-${other}`).focus();
    });
  }
  store.show((state, changed) => {
    if (anyOf(changed, "theme")) paint();
    if (!anyOf(changed, "tab")) return;
    for (const name of TABS) {
      const chosen = name === state.tab;
      byId(name).hidden = !chosen;
      byId(`tab-${name}`).setAttribute("aria-selected", String(chosen));
      byId(`tab-${name}`).tabIndex = chosen ? 0 : -1;
    }
  });
}
