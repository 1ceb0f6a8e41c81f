// The map of another run in the place of this one's, to compare them.

import { byElementId, counted, counts, note } from "./element.js";
import { Run } from "./run.js";

/** What a run's file begins and ends with. */
const BEFORE = "var splatsegRun=";
const AFTER = ";";

/** Connects the controls. `mapOf()` may be missing. Returns the action of the key that changes the shown run. */
export function listenToComparison(mapOf) {
  const [file, choice] = [byElementId("other-file"), byElementId("other")];
  const show = () => mapOf()?.showOther(choice.value === "other");
  byElementId("compare").addEventListener("click", () => file.click());
  choice.addEventListener("change", show);
  file.addEventListener("change", async () => {
    if (!file.files.length || !mapOf()) return;
    try {
      const other = runOf(await file.files[0].text());
      mapOf().setOther(other);
      choice.lastElementChild.textContent = `${other.scene}: ${counted(other.objects.filter(counts).length, "object")}, ${counted(other.map.total, "Gaussian")}`;
      choice.hidden = false;
      choice.value = "other";
      show();
    } catch (error) {
      note("map-note", `${file.files[0].name} is not the viewer/run.js of a run with a map: ${error.message}`);
    }
    file.value = "";
  });
  return () => {
    if (choice.hidden) return;
    choice.value = choice.value === "other" ? "this" : "other";
    show();
  };
}

/** Reads a run's file. It is data: nothing in it is executed. */
function runOf(text) {
  const json = text.trim();
  if (!json.startsWith(BEFORE) || !json.endsWith(AFTER)) throw new Error(`it does not begin with "${BEFORE}"`);
  const run = new Run(JSON.parse(json.slice(BEFORE.length, -AFTER.length)));
  if (!run.map?.count) throw new Error("it has no map");
  return run;
}
