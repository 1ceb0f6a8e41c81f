// The page of a finished run. Connects its parts: they share the shown frame and the selected object.

import { ChangeList } from "./change_list.js";
import { byElementId, counted, nameOf, note } from "./element.js";
import { FrameIds } from "./frame_ids.js";
import { MapView } from "./map_view.js";
import { ObjectInfo } from "./object_info.js";
import { ObjectList } from "./object_list.js";
import { listenToControls } from "./map_controls.js";
import { Picture } from "./picture.js";
import { Timeline } from "./timeline.js";

/** Shows a run. */
export function showRun(run) {
  const root = document.documentElement;
  let selected = 0;
  /** True if the current frame shows the selected object, according to the run's data. */
  const isSeen = (object, frame) => object.seen.some(([first, last]) => first <= frame && frame <= last);

  function describeRun() {
    document.title = `${run.scene} – splatseg`;
    byElementId("scene").textContent = run.scene;
    const facts = [counted(run.frameCount, "frame"), counted(run.objects.length, "object")];
    if (run.map) facts.push(counted(run.map.total, "Gaussian"));
    byElementId("facts").textContent = `${facts.join(", ")} · splatseg ${run.version}`;
  }

  /** Creates the 3D view; if that fails, shows the reason and returns null. */
  function mapView() {
    const flat = (text) => {
      byElementId("map").parentElement.classList.add("flat");
      note("map-note", text);
      return null;
    };
    if (!run.map) return flat("This method keeps no map, so there is nothing to show in 3D.");
    if (run.map.count === 0) return flat("The map is empty, so there is nothing to show in 3D.");
    if (run.map.count < run.map.total) {
      const shown = run.map.count.toLocaleString("en");
      note("map-note", `${shown} of ${counted(run.map.total, "Gaussian")} are drawn, enlarged to fill the gaps.`);
    }
    try {
      return new MapView(run, select);
    } catch (error) {
      return flat(`The map cannot be shown in 3D: ${error.message}`);
    }
  }

  const map = mapView();
  const list = new ObjectList(run.objects, (id) => select(id === selected ? 0 : id, "seek"));
  const changes = run.changes && new ChangeList(run, { go: goToChange });
  const info = new ObjectInfo(run, { goTo: show, center: map ? (id) => map.center(id) : null });
  const frameIds = new FrameIds(run.framesPerChunk, run.remapped);
  const picture = new Picture({
    nameOf: (id) => nameOf(id, run.byId.get(id)),
    onPick: select,
    onIds: (ids) => {
      list.showFrame(ids);
      root.dataset.frame = String(timeline.frame);
    },
    onError: (text) => note("video-note", text),
  });
  const timeline = new Timeline(run, { show, preload: (frame) => picture.preload(shown(frame)), clear: () => select(0) });

  /** A frame as the picture shows it. */
  function shown(frame) {
    return {
      camera: run.cameraOf(frame),
      url: `overlay/${encodeURIComponent(run.names[frame])}.jpg`,
      text: `frame ${run.names[frame]} with its objects`,
      ids: () => frameIds.of(frame),
    };
  }

  /** Shows a frame. */
  function show(frame) {
    byElementId("video-note").hidden = true;
    timeline.showFrame(frame);
    map?.showFrame(frame);
    return picture.show(shown(frame));
  }

  /** Selects an object, 0 for none. With `seek`, goes to the object's best frame unless the current one shows it. */
  function select(id, seek) {
    selected = id;
    const object = run.byId.get(id) ?? null;
    root.dataset.object = String(id);
    list.mark(id);
    info.show(id);
    timeline.mark(object);
    picture.mark(id);
    map?.mark(id);
    if (seek && object?.seen.length && !isSeen(object, timeline.frame)) {
      timeline.pause();
      show(object.best);
    }
  }

  /** Shows a change: what is gone in the map before, the rest in the map as it is now. */
  function goToChange({ before, after }) {
    showTime(after ? "after" : "before");
    select(after && run.byId.has(after.id) ? after.id : 0, "seek");
    map?.centerOn((after ?? before).box);
  }

  function showTime(time) {
    byElementId("time").value = time;
    map?.showTime(time);
  }

  /** `index.html#frame=12&object=7` opens at the 13th frame with object 7 selected. */
  async function follow() {
    const wanted = (name) => Number(new RegExp(`${name}=(\\d+)`).exec(location.hash)?.[1] ?? 0);
    await show(Math.min(wanted("frame"), Math.max(0, run.frameCount - 1)));
    select(run.byId.has(wanted("object")) ? wanted("object") : 0);
    root.dataset.ready = "yes";
  }

  // For the browser's console: `splatsegPage.select(7)`.
  window.splatsegPage = { run, map, show, select, changes };
  describeRun();
  listenToControls(() => map, showTime);
  window.addEventListener("hashchange", follow);
  follow();
}
