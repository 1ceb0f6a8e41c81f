// The page of a run that goes on. Its data come through a websocket, as `page_messages.rs` writes them.

import { byElementId, counted, counts, nameOf, note } from "./element.js";
import { decode } from "./frame_ids.js";
import { listenToDownloads } from "./downloads.js";
import { listenToKeys } from "./keys.js";
import { LabelForm } from "./label_form.js";
import { LiveClock } from "./live_clock.js";
import { LiveCrops } from "./live_crops.js";
import { LiveDetail } from "./live_detail.js";
import { LiveRun } from "./live_run.js";
import { LiveStatus } from "./live_status.js";
import { listenToControls } from "./map_controls.js";
import { MapView } from "./map_view.js";
import { Merging } from "./merging.js";
import { ObjectInfo } from "./object_info.js";
import { ObjectList } from "./object_list.js";
import { Picture } from "./picture.js";
import { PlanView } from "./plan_view.js";
import { Tracks } from "./tracks.js";
import { Visibility } from "./visibility.js";
import { Words } from "./words.js";

/** Answer to each message. The server sends no more than three without one. */
const SHOWN = "shown";
/** First and longest pause before another attempt to connect, milliseconds. */
const PAUSES_MS = [500, 5000];
/** The server sends something every second. After this time without, the connection is taken to be lost. */
const SILENCE_MS = 6000;
/** Decoding a picture may take this long, milliseconds. */
const PICTURE_MS = 1000;
/** The server's code for a session that has ended. */
const ENDED = 1000;
/** Said of a request while there is no connection. */
const NOT_SENT = "not sent: there is no connection";
/** Colour of objects that are in a frame, but not in the list yet. */
const NOT_LISTED = [128, 128, 128];

class LivePage {
  #run = new LiveRun();
  #status = new LiveStatus();
  #map = null;
  #plan = null;
  #controls;
  #selected = 0;
  #url = null;
  #socket = null;
  /** Lines about the run, and about the newest frame. */
  #notes = [];
  #lines = [];
  #crops = new LiveCrops();
  #list = new ObjectList([], { pick: (id) => this.#toggle(id), filter: (isFound) => this.#tracks.show(isFound) });
  #clock = new LiveClock();
  #tracks = new Tracks({ objects: [] }, this.#clock, { seek: () => {}, pick: (id) => this.#toggle(id) });
  /** Which objects map and plan draw. */
  #isShown = () => true;
  #words = new Words((ids) => this.#list.showFound(ids));
  #labels = new LabelForm();
  #detail = new LiveDetail();
  #visibility = new Visibility((isShown) => {
    this.#map?.showObjects(isShown);
    this.#plan?.showObjects(isShown);
    this.#isShown = isShown;
    this.#list.showDrawn(isShown);
    this.#showDrawn();
  });
  #merging = new Merging({
    nameOf: (id) => nameOf(id, this.#run.byId.get(id)),
    merge: (ids) => this.#ask?.({ ask: "merge", ids }) === false && note("map-note", NOT_SENT),
    changed: (ids) => {
      this.#list.showChosen(ids);
      this.#picture.mark(ids.size ? ids : [this.#selected]);
    },
  });
  /** Sends a request; null if the program answers none. */
  #ask = null;
  #info = new ObjectInfo(this.#run, {
    center: (id) => this.#map?.center(id),
    isolate: () => this.#visibility.toggleIsolated(),
    hide: () => this.#visibility.toggleHidden(),
    merge: () => this.#turnMerging(),
  });
  #picture = new Picture({
    nameOf: (id) => nameOf(id, this.#run.byId.get(id)),
    onPick: (id) => this.#pick(id),
    onIds: (ids) => this.#list.showFrame(ids),
    onError: () => {},
  });

  constructor() {
    document.documentElement.classList.add("live");
    byElementId("map-hint").textContent = "The map appears here as it grows";
    this.#controls = listenToControls(() => this.#map, () => {});
    listenToKeys({
      m: () => this.#plan?.isOn || this.#controls.m(),
      p: () => this.#plan?.turn(!this.#plan.isOn),
      r: this.#controls.r,
      o: () => this.#picture.toggleOverlay(),
      i: () => this.#visibility.toggleIsolated(),
      h: () => this.#visibility.toggleHidden(),
      n: () => this.#labels.focus(),
      u: () => this.#turnMerging(),
      Escape: () => this.#merging.stop() || this.#controls.stopMeasuring() || this.#select(0),
    });
    listenToDownloads(this.#run, () => this.#map);
    this.#connect(PAUSES_MS[0]);
    // For the browser's console and tests.
    window.splatsegPage = { run: this.#run, map: () => this.#map, plan: () => this.#plan, select: (id) => this.#select(id) };
  }

  #connect(pause) {
    const url = new URL(`live${location.search}`, location.href);
    url.protocol = url.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    let next = pause;
    let silence = 0;
    const listen = () => {
      clearTimeout(silence);
      silence = setTimeout(() => socket.close(), SILENCE_MS);
    };
    listen();
    socket.addEventListener("open", () => {
      next = PAUSES_MS[0];
      this.#status.connect();
    });
    // One after the other: a later picture must not overtake an earlier one.
    let work = Promise.resolve();
    socket.addEventListener("message", ({ data }) => {
      listen();
      work = work.then(() => this.#receive(data)).catch((error) => note("video-note", error.message));
      work.then(() => socket.readyState === WebSocket.OPEN && socket.send(SHOWN));
    });
    socket.addEventListener("close", ({ code }) => {
      clearTimeout(silence);
      // What has come is still shown first.
      if (code === ENDED) return work.then(() => this.#end());
      this.#status.lose();
      setTimeout(() => this.#connect(Math.min(2 * next, PAUSES_MS[1])), next);
    });
  }

  #receive(data) {
    if (typeof data !== "string") return this.#showFrame(data);
    const message = JSON.parse(data);
    const show = { hello: () => this.#greet(message), status: () => this.#showStatus(message) };
    show.found = () => this.#words.showFound(message);
    show.named = () => this.#labels.say(message.error ?? "saved");
    show.merged = () => this.#showMerged(message);
    show.detail = () => this.#showDetail(message);
    show.objects = () => this.#showObjects(message);
    show.map = () => this.#showMap(message);
    show.plan = () => this.#showPlan(message);
    return show[message.kind]?.();
  }

  #greet(message) {
    // Another run: nothing of the earlier one holds.
    if (this.#run.session && this.#run.session !== message.session) return location.reload();
    this.#run.greet(message);
    const ask = (request) => {
      const isOpen = this.#socket.readyState === WebSocket.OPEN;
      if (isOpen) this.#socket.send(JSON.stringify(request));
      return isOpen;
    };
    this.#answerBy(message.answers ? ask : null);
    document.title = `${message.scene || "live"} – splatseg`;
    byElementId("scene").textContent = message.scene || "splatseg";
    byElementId("facts").textContent = `splatseg ${message.version}`;
    this.#map?.updatePath();
  }

  /** Requests are sent with `ask`, which tells whether there was a connection; null if nobody answers them. */
  #answerBy(ask) {
    this.#ask = ask;
    this.#info.canMerge = Boolean(ask);
    this.#words.answeredBy(ask);
    this.#detail.answeredBy(ask);
    this.#labels.savedBy(ask && ((id, label) => this.#labels.say(ask({ ask: "name", id, label }) ? "" : NOT_SENT)));
  }

  /** The session has ended: what was shown stays, and nobody answers any more. */
  #end() {
    this.#status.end();
    this.#merging.stop();
    this.#answerBy(null);
    this.#select(this.#selected);
  }

  #showStatus({ rate, notes }) {
    this.#status.setRate(rate);
    this.#notes = notes;
    this.#showLines();
  }

  #showLines() {
    const lines = [...this.#notes, ...this.#lines];
    byElementId("video-note").hidden = lines.length === 0;
    byElementId("video-note").textContent = lines.join("\n");
  }

  /** A frame's bytes: the length of its JSON, the JSON, a JPEG file, the ids. */
  async #showFrame(bytes) {
    const length = new DataView(bytes).getUint32(0, true);
    const frame = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
    const jpeg = new Blob([new Uint8Array(bytes, 4 + length, frame.jpeg)], { type: "image/jpeg" });
    const { width, height } = frame;
    const found = decode(new Uint8Array(bytes, 4 + length + frame.jpeg), width, height);
    const ids = { width, height, ids: found.map((id) => this.#run.into.get(id) ?? id) };
    const url = URL.createObjectURL(jpeg);
    const image = Object.assign(new Image(), { src: url });
    // Decoded first, so that the picture does not flicker. Browsers put that off while the page is hidden.
    if (!document.hidden) await Promise.race([image.decode(), new Promise((resolve) => setTimeout(resolve, PICTURE_MS))]);
    this.#run.addFrame(frame);
    const text = `frame ${frame.name} with its objects`;
    const colorOf = (id) => this.#run.byId.get(id)?.color ?? NOT_LISTED;
    await this.#picture.show({ camera: frame.camera, url: null, plain: url, text, ids: async () => ids, colorOf });
    if (image.complete && this.#crops.add(image, ids)) this.#listObjects();
    if (this.#url) URL.revokeObjectURL(this.#url);
    this.#url = url;
    this.#status.setFrame(frame);
    this.#map?.updatePath();
    this.#map?.showFrame(frame.number);
    this.#plan?.showFrame(frame.number);
    this.#detail.show(frame.detail);
    this.#lines = frame.lines;
    this.#showLines();
    document.documentElement.dataset.frame = String(frame.number);
  }

  #showObjects(message) {
    this.#run.setObjects(message.objects, message.frames);
    this.#status.setObjects(this.#run.objects.filter(counts).length);
    const rows = this.#run.rows();
    for (const { seen } of rows) this.#clock.reach(seen.at(-1)?.[1] ?? 0);
    this.#tracks.showFrame(this.#clock.now);
    this.#tracks.update(rows);
    this.#listObjects();
    if (!this.#selected) return;
    // One that is still there only has other facts.
    if (this.#run.byId.has(this.#selected)) this.#info.show(this.#selected);
    else this.#select(0);
    this.#showDrawn();
  }

  /** Objects were merged, or could not be. */
  #showMerged(message) {
    if (message.error) return note("map-note", message.error);
    this.#run.merge(message);
    this.#showObjects({ objects: this.#run.objects });
    this.#map?.mergeObjects(this.#run.into);
    this.#plan?.mergeObjects();
    this.#select(message.into);
  }

  /** Later frames are segmented otherwise, or cannot be. */
  #showDetail({ error }) {
    this.#detail.answered();
    if (error) note("video-note", error);
  }

  /** Lists the objects with their crops. */
  #listObjects() {
    for (const object of this.#run.objects) object.crop = this.#crops.of(object.id);
    this.#list.update(this.#run.objects);
  }

  #showMap({ map, up, origin }) {
    this.#run.map = map;
    this.#run.origin = origin;
    this.#run.up = up;
    if (map.count === 0) return;
    if (this.#map) this.#map.replaceMap(map);
    else this.#createMap();
    byElementId("facts").textContent = `${counted(map.total, "Gaussian")} · splatseg ${this.#run.version}`;
    document.documentElement.dataset.gaussians = String(map.total);
  }

  /** There is a newer plan of the rooms, or none any more. */
  #showPlan({ plan }) {
    this.#run.plan = plan;
    if (this.#plan) this.#plan.update();
    else this.#createPlan();
    document.documentElement.dataset.rooms = String(plan?.rooms.length ?? 0);
  }

  /** The plan takes the place of the map, so it needs one. */
  #createPlan() {
    if (!this.#run.plan || !this.#map) return;
    this.#plan = new PlanView(this.#run, {
      pick: (id) => this.#pick(id),
      turned: (on) => {
        this.#controls.stopMeasuring();
        this.#map.cover(on);
      },
    });
    this.#plan.showObjects(this.#isShown);
    this.#plan.mark(this.#selected);
  }

  #createMap() {
    try {
      this.#map = new MapView(this.#run, { pick: (id) => this.#pick(id) });
      this.#map.mergeObjects(this.#run.into);
      this.#map.mark(this.#selected);
      byElementId("map-hint").textContent = "Drag to orbit, scroll to zoom, click an object";
      if (this.#run.cameraOf()) this.#map.showFrame(0);
      this.#createPlan();
    } catch (error) {
      byElementId("map").parentElement.classList.add("flat");
      note("map-note", `The map cannot be shown in 3D: ${error.message}`);
    }
  }

  #turnMerging() {
    if (this.#ask) this.#merging.turn(this.#selected);
  }

  #showDrawn() {
    this.#info.showDrawn(this.#visibility.isolated, this.#visibility.hidden.has(this.#selected));
  }

  /** Selects an object, or chooses it to be merged. */
  #pick(id) {
    if (!this.#merging.isOn) this.#select(id);
    else if (id) this.#merging.toggle(id);
  }

  /** As `pick`, but an object that is selected is so no longer. */
  #toggle(id) {
    this.#pick(id === this.#selected && !this.#merging.isOn ? 0 : id);
  }

  /** Selects an object, 0 for none. */
  #select(id) {
    this.#selected = id;
    document.documentElement.dataset.object = String(id);
    this.#list.mark(id);
    this.#info.show(id);
    this.#labels.select(id, this.#run.byId.get(id));
    this.#tracks.mark(id);
    if (!this.#merging.isOn) this.#picture.mark([id]);
    this.#map?.mark(id);
    this.#plan?.mark(id);
    this.#visibility.select(id);
    this.#showDrawn();
  }
}

/** Watches the run of the server that this page comes from. */
export function watch() {
  new LivePage();
}
