// The controls above the map.

import { byElementId } from "./element.js";

/**
 * Connects the controls to `mapOf()`, which may be missing; `showTime` is called with `before` or `after`, `changed` after
 * every change. Returns the actions of keys.
 */
export function listenToControls(mapOf, showTime, changed = () => {}) {
  const onChange = (id, act, event = "change") => byElementId(id).addEventListener(event, ({ target }) => {
    act(target);
    changed();
  });
  const measure = (on) => {
    if (!mapOf()) return;
    mapOf().measure.turn(on);
    byElementId("stage").classList.toggle("measuring", on);
  };
  onChange("colors", ({ value }) => mapOf()?.showColors(value));
  onChange("time", ({ value }) => showTime(value));
  onChange("boxes", ({ checked }) => mapOf()?.showChanges(checked));
  onChange("cut", ({ checked }) => mapOf()?.cutWalls(checked));
  onChange("ceiling", ({ value }) => mapOf()?.cutAbove(Number(value) / 100), "input");
  onChange("path", ({ checked }) => mapOf()?.showPath(checked));
  onChange("follow", ({ checked }) => mapOf()?.follow(checked));
  byElementId("reset").addEventListener("click", () => {
    byElementId("follow").checked = false;
    mapOf()?.follow(false);
    mapOf()?.reset();
    changed();
  });
  byElementId("measure").addEventListener("click", () => measure(!mapOf()?.measure.isOn));
  byElementId("view").addEventListener("pointerdown", () => (byElementId("map-hint").hidden = true), { once: true });
  return {
    m: () => measure(!mapOf()?.measure.isOn),
    r: () => byElementId("reset").click(),
    /** Stops measuring; false if nothing was measured. */
    stopMeasuring: () => {
      const isOn = Boolean(mapOf()?.measure.isOn);
      if (isOn) measure(false);
      return isOn;
    },
  };
}
