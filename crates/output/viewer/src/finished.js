// The page of a finished run. Connects its parts: they share the shown frame and the selected object.

import { ChangeList } from "./change_list.js";
import { Clock } from "./clock.js";
import { ComparedIds } from "./compared_ids.js";
import { listenToComparison } from "./comparison.js";
import { listenToDownloads } from "./downloads.js";
import { Edits } from "./edits.js";
import { byElementId, counted, counts, nameOf, note } from "./element.js";
import { FrameIds } from "./frame_ids.js";
import { listenToKeys } from "./keys.js";
import { LabelForm } from "./label_form.js";
import { Link, stateOf } from "./link.js";
import { listenToControls } from "./map_controls.js";
import { MapView } from "./map_view.js";
import { Merging } from "./merging.js";
import { ObjectInfo } from "./object_info.js";
import { ObjectList } from "./object_list.js";
import { Picture } from "./picture.js";
import { PlanView } from "./plan_view.js";
import { Timeline } from "./timeline.js";
import { Tracks } from "./tracks.js";
import { Visibility } from "./visibility.js";

/** Colour of what is no object of the run. */
const UNKNOWN = [128, 128, 128];

/** Shows a run. */
export function showRun(run) {
  const root = document.documentElement;
  let selected = 0;
  /** True if the current frame shows the selected object, according to the run's data. */
  const isSeen = (object, frame) => object.seen.some(([first, last]) => first <= frame && frame <= last);
  const pick = (id, seek) => (merging.isOn ? id && merging.toggle(id) : select(id, seek));
  const toggle = (id) => pick(id === selected && !merging.isOn ? 0 : id, "seek");

  const edits = new Edits(run);
  const map = mapView(run, { pick, moved: () => link.change() });
  const plan = run.plan && map && new PlanView(run, {
    pick,
    turned: (on) => {
      controls.stopMeasuring();
      map.cover(on);
      link.change();
    },
  });
  const list = new ObjectList(run.objects, { pick: toggle, filter: (isFound) => tracks.show(isFound) });
  const changes = run.changes && new ChangeList(run, { go: goToChange });
  const info = new ObjectInfo(run, {
    goTo: show,
    center: map && ((id) => map.center(id)),
    isolate: () => visibility.toggleIsolated(),
    hide: () => visibility.toggleHidden(),
    merge: () => merging.turn(selected),
  });
  const labels = new LabelForm();
  const merging = new Merging({
    nameOf: (id) => nameOf(id, run.byId.get(id)),
    merge: (ids) => change(() => edits.merge(ids)),
    changed: (ids) => {
      list.showChosen(ids);
      picture.mark(ids.size ? ids : [selected]);
    },
  });
  const visibility = new Visibility((isShown) => {
    map?.showObjects(isShown);
    plan?.showObjects(isShown);
    list.showDrawn(isShown);
    showDrawn();
    link.change();
  });
  const frameIds = new FrameIds(run.framesPerChunk, run.remapped);
  const picture = new Picture({
    nameOf: (id) => compared?.nameOf(id) ?? nameOf(id, run.byId.get(id)),
    onPick: (id) => pick(run.byId.has(id) ? id : 0),
    onIds: (ids) => {
      list.showFrame(ids);
      root.dataset.frame = String(timeline.frame);
    },
    onOpacity: () => link.change(),
    onError: (text) => note("video-note", text),
  });
  const compared = window.splatsegComparison && new ComparedIds(window.splatsegComparison, run, () => show(timeline.frame));
  const clock = new Clock(run.frameCount, run.stamps);
  const tracks = new Tracks(run, clock, { seek: (frame) => frame !== timeline.frame && show(frame), pick: toggle });
  const timeline = new Timeline(run, clock, { show, preload: (frame) => picture.preload(shown(frame)) });
  const link = new Link(state);

  /** A frame as the picture shows it. */
  function shown(frame) {
    const name = encodeURIComponent(run.names[frame]);
    return {
      camera: run.cameraOf(frame),
      // The run's overlays know neither merged objects nor other ids.
      url: run.into.size || (compared && compared.shown !== "own") ? null : `overlay/${name}.jpg`,
      plain: `pictures/${name}.jpg`,
      text: `frame ${run.names[frame]} with its objects`,
      ids: () => idsOf(frame),
      colorOf: (id) => run.byId.get(id)?.color ?? compared?.colorOf(id) ?? UNKNOWN,
      textOf: (id) => compared?.nameOf(id) ?? String(id),
      line: compared?.line,
    };
  }

  /** The ids of a frame's pixels, after the changes by hand, or those that they are compared with. */
  async function idsOf(frame) {
    const found = await frameIds.of(frame);
    const own = run.into.size ? { ...found, ids: found.ids.map((id) => run.into.get(id) ?? id) } : found;
    return compared ? compared.of(frame, own, run.into) : own;
  }

  /** Shows a frame. */
  function show(frame) {
    byElementId("video-note").hidden = true;
    timeline.showFrame(frame);
    tracks.showFrame(frame);
    map?.showFrame(frame);
    plan?.showFrame(frame);
    link.change();
    return picture.show(shown(frame));
  }

  /** Selects an object, 0 for none. With `seek`, goes to the object's best frame unless the current one shows it. */
  function select(id, seek) {
    selected = id;
    const object = run.byId.get(id) ?? null;
    root.dataset.object = String(id);
    list.mark(id);
    info.show(id);
    labels.select(id, object);
    tracks.mark(id);
    picture.mark([id]);
    map?.mark(id);
    plan?.mark(id);
    visibility.select(id);
    showDrawn();
    link.change();
    if (seek && object?.seen.length && !isSeen(object, timeline.frame)) {
      timeline.pause();
      show(object.best);
    }
  }

  /** Changes objects by hand. */
  function change(edit) {
    const before = run.into;
    edit();
    showEdits();
    if (before.size || run.into.size) show(timeline.frame);
  }

  /** Shows the objects as they are after the changes by hand. */
  function showEdits() {
    run.edit(edits);
    describe(run);
    map?.mergeObjects(run.into);
    plan?.mergeObjects();
    list.update(run.objects);
    tracks.update(run.objects);
    visibility.hide([...visibility.hidden].filter((id) => run.byId.has(id)));
    const { last } = edits;
    byElementId("undo").hidden = last === null;
    byElementId("undo").title = `Takes back the ${last} (z)`;
    byElementId("kept-edits").hidden = !edits.hasOthers;
    select(run.into.get(selected) ?? selected);
  }

  function showDrawn() {
    info.showDrawn(visibility.isolated, visibility.hidden.has(selected));
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

  function undo() {
    if (edits.last) change(() => edits.undo());
  }

  /** What the page shows, for its link. */
  function state() {
    const view = map?.view?.map((number) => Number(number.toFixed(3))).join(",");
    return {
      frame: timeline.frame,
      object: selected || null,
      view: view ?? null,
      colors: byElementId("colors").value === "true" ? "true" : null,
      cut: byElementId("cut").checked ? null : 0,
      height: byElementId("ceiling").value === "100" ? null : byElementId("ceiling").value,
      overlay: picture.opacity === 100 ? null : picture.opacity,
      hide: visibility.hidden.size ? [...visibility.hidden].join(",") : null,
      alone: visibility.isolated ? 1 : null,
      plan: plan?.isOn ? 1 : null,
      ids: compared && compared.shown !== "own" ? compared.shown : null,
      edits: edits.text && encodeURIComponent(edits.text),
    };
  }

  /** `index.html#frame=12&object=7` opens at the 13th frame with object 7 selected; `state` has all names. */
  async function follow() {
    const wanted = stateOf(location.hash);
    const change = (id, property, value) => {
      byElementId(id)[property] = value;
      byElementId(id).dispatchEvent(new Event(id === "ceiling" ? "input" : "change"));
    };
    change("colors", "value", wanted.text("colors") === "true" ? "true" : "object");
    change("cut", "checked", wanted.number("cut") !== 0);
    change("ceiling", "value", String(wanted.number("height") ?? 100));
    picture.opacity = Math.max(0, Math.min(wanted.number("overlay") ?? 100, 100));
    const view = wanted.numbers("view");
    if (map && view?.length === 6) map.view = view;
    if (Boolean(wanted.number("plan")) !== Boolean(plan?.isOn)) plan?.turn(!plan.isOn);
    if (compared && (wanted.text("ids") ?? "own") !== compared.shown) compared.shown = wanted.text("ids");
    edits.read(wanted.text("edits"));
    showEdits();
    const frame = Math.max(0, Math.floor(wanted.number("frame") ?? 0));
    await show(Math.min(frame, Math.max(0, run.frameCount - 1)));
    select(run.byId.has(wanted.number("object")) ? wanted.number("object") : 0);
    visibility.hide((wanted.numbers("hide") ?? []).filter((id) => run.byId.has(id)));
    if (Boolean(wanted.number("alone") && selected) !== visibility.isolated) visibility.toggleIsolated();
    root.dataset.ready = "yes";
  }

  // For the browser's console: `splatsegPage.select(7)`.
  window.splatsegPage = { run, edits, map, plan, show, select, changes, clock };
  describe(run);
  const controls = listenToControls(() => map, showTime, () => link.change());
  listenToKeys({
    c: listenToComparison(() => map),
    m: () => plan?.isOn || controls.m(),
    p: () => plan?.turn(!plan.isOn),
    r: controls.r,
    o: () => picture.toggleOverlay(),
    i: () => visibility.toggleIsolated(),
    h: () => visibility.toggleHidden(),
    n: () => labels.focus(),
    u: () => merging.turn(selected),
    x: () => compared?.turn(),
    z: undo,
    Escape: () => merging.stop() || controls.stopMeasuring() || select(0),
  });
  byElementId("undo").addEventListener("click", undo);
  byElementId("kept-edits").addEventListener("click", () => change(() => edits.showOthers()));
  labels.savedBy((id, label) => {
    change(() => edits.rename(id, label));
    labels.say("saved");
  });
  listenToDownloads(run, () => map, edits);
  window.addEventListener("hashchange", follow);
  follow();
}

/** Writes what a run is into the header. */
function describe(run) {
  document.title = `${run.scene} – splatseg`;
  byElementId("scene").textContent = run.scene;
  const facts = [counted(run.frameCount, "frame"), counted(run.objects.filter(counts).length, "object")];
  if (run.map) facts.push(counted(run.map.total, "Gaussian"));
  byElementId("facts").textContent = `${facts.join(", ")} · splatseg ${run.version}`;
}

/** Creates the 3D view; if that fails, shows the reason and returns null. */
function mapView(run, actions) {
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
    return new MapView(run, actions);
  } catch (error) {
    return flat(`The map cannot be shown in 3D: ${error.message}`);
  }
}
