// The controls above the map.

import { byElementId } from "./element.js";

/** Connects the controls to `mapOf()`, which may be missing; `showTime` is called with `before` or `after`. */
export function listenToControls(mapOf, showTime) {
  const onChange = (id, act) => byElementId(id).addEventListener("change", (event) => act(event.target));
  onChange("colors", ({ value }) => mapOf()?.showColors(value));
  onChange("time", ({ value }) => showTime(value));
  onChange("boxes", ({ checked }) => mapOf()?.showChanges(checked));
  onChange("path", ({ checked }) => mapOf()?.showPath(checked));
  onChange("follow", ({ checked }) => mapOf()?.follow(checked));
  byElementId("reset").addEventListener("click", () => {
    byElementId("follow").checked = false;
    mapOf()?.follow(false);
    mapOf()?.reset();
  });
  byElementId("view").addEventListener("pointerdown", () => (byElementId("map-hint").hidden = true), { once: true });
}
