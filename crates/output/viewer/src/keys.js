// Keys besides those of playback, and the help that lists them.

import { byElementId } from "./element.js";

/** Calls `actions[key]()` for keys that are typed outside of text fields; `actions` by the key's name, e.g. `Escape`. */
export function listenToKeys(actions) {
  const help = byElementId("help");
  byElementId("help-button").addEventListener("click", () => help.showModal());
  document.addEventListener("keydown", (event) => {
    const takesKeys = event.target.closest?.("input:not([type=checkbox], [type=range]), select, dialog");
    if (event.altKey || event.ctrlKey || event.metaKey || help.open) return;
    if (takesKeys && event.key !== "Escape") return;
    if (event.key === "?") return help.showModal();
    // A key that moves the focus to a text field must not be typed there.
    if (actions[event.key] && event.key.length === 1) event.preventDefault();
    actions[event.key]?.();
  });
}
