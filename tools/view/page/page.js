/** The page: takes what arrives, draws it, and sends what a person wants. Everything is made here. */

import { Camera } from "./camera.js";
import { conditionOf } from "./condition.js";
import { listenToButtons, listenToStage, showCondition, showTools } from "./controls.js";
import { Driver, makePad } from "./drive.js";
import { Layers } from "./legend.js";
import { Link } from "./link.js";
import { MapCanvas } from "./map.js";
import { showVectors } from "./outlines.js";
import { showDriver, showGraphs, showInputs, showLink, showWay } from "./panels.js";
import { Past } from "./past.js";
import { Path } from "./path.js";
import { savePicture } from "./picture.js";
import { Readout } from "./readout.js";
import { Relief } from "./relief.js";
import { Theme, listenToTabs } from "./theme.js";
import { Timeline } from "./timeline.js";
import { View } from "./view.js";
import { number, setText, span } from "./words.js";
import { World } from "./world.js";

const FIRST_M = 13; // shown at first
const SLOW_MS = 250,
  GRAPHS_MS = 1000;
const by = (id) => document.getElementById(id);

class Page {
  constructor() {
    this.link = new Link(`${location.origin.replace(/^http/, "ws")}/ws`);
    this.live = new World();
    this.past = new Past();
    this.path = new Path();
    this.hello = null;
    this.heard_ms = null; // when the newest state came
    this.is_relief = false;
    this.is_dirty = true;
    this.view = new View();
    this.camera = new Camera();
    this.condition = null;
    this.theme = new Theme();
    this.layers = new Layers(by("layer-list"), by("legend"));
    this.timeline = new Timeline(this.past, (t_s) => this.link.send({ type: "history", t_s }));
    this.readout = new Readout(by("readout"), (message) => this.link.send(message));
    this.driver = new Driver(
      (message) => this.sendDrive(message),
      () => this.refusal(),
    );
    this.map = new MapCanvas(by("map"), this.view);
    this.relief = new Relief(by("relief"), this.camera);
    this.listen();
    this.begin();
  }

  get shown() {
    return this.timeline.world ?? this.live;
  }

  listen() {
    const { driver, timeline, layers, theme } = this;
    this.link.addEventListener("message", ({ detail }) => this.take(detail));
    this.link.addEventListener("change", () => this.linkChanged());
    for (const part of [driver, timeline, layers, theme]) {
      for (const name of ["change", "choice"]) part.addEventListener(name, () => this.changed());
    }
    timeline.addEventListener(
      "change",
      () => timeline.world && driver.is_armed && driver.arm(false),
    );
    layers.addEventListener("choice", () => this.askForLayers());
    document.addEventListener("visibilitychange", () => document.hidden || this.retryNow());
    addEventListener("resize", () => this.changed());
    listenToButtons(this);
    listenToStage(this);
    listenToTabs();
    makePad(by("pad"), by("knob"), driver);
  }

  begin() {
    const token = new URLSearchParams(location.hash.slice(1)).get("token");
    if (token) history.replaceState(null, "", location.pathname + location.search); // not to be seen or shared
    this.driver.token = this.link.token = token ?? "";
    this.link.open();
    setInterval(() => this.tick(), SLOW_MS);
    setInterval(() => this.drawGraphs(), GRAPHS_MS);
    const frame = () => {
      requestAnimationFrame(frame);
      this.timeline.play();
      if (this.is_dirty) this.draw();
    };
    frame();
  }

  useToken(token) {
    this.driver.token = this.link.token = token;
    if (this.link.state === "open") this.link.send({ type: "auth", token });
    else this.link.open();
    this.changed();
  }

  retryNow() {
    if (this.link.state === "waiting") this.link.open();
  }

  take(message) {
    if (message.type === "hello") return this.takeHello(message);
    if (message.type === "cell") this.readout.answer = message;
    else if (message.type === "error") this.takeError(message.text);
    else if (message.type === "flight")
      this.notice(message.text || "The last 30 s are being kept.");
    else if (message.type === "auth") this.takeAuth(message.ok);
    else if (message.history === true) this.timeline.take(message);
    else if (this.live.apply(message)) this.takeLive(message);
    return this.changed(); // messages of other types are of a later version: not for this page
  }

  takeLive(message) {
    if (message.type === "state") {
      this.heard_ms = performance.now();
      this.path.add(message);
      this.timeline.kept_s = message.history?.from_s ?? null;
    }
    if (message.type === "window" && !this.view.has_fitted)
      this.view.fit(this.live.window, FIRST_M);
    this.past.record(message, this.live);
  }

  takeError(text) {
    if (this.driver.is_armed) this.driver.why_not = text; // until it is let go and held anew
    this.notice(text);
  }

  takeAuth(is_right) {
    if (is_right) return;
    this.driver.token = this.link.token = "";
    this.notice("That is not the token of this server.");
  }

  /** With the time of the picture that the person drives by. */
  sendDrive(message) {
    const is_wish = message.type === "drive";
    this.link.send(is_wish ? { ...message, t_s: this.live.state.t_s } : message);
  }

  takeHello(hello) {
    this.hello = hello;
    this.layers.offer(hello.layers ?? []);
    setText(by("link-url"), hello.link ?? "");
    by("flight").hidden = !hello.flight;
    this.askForLayers();
  }

  linkChanged() {
    if (this.link.state === "open") {
      this.past.cut();
      this.live = new World(); // nothing of before is current
      this.heard_ms = performance.now();
    } else if (this.driver.is_driving) this.driver.letGo();
    this.changed();
  }

  askForLayers() {
    this.link.send({ type: "layers", names: this.layers.wanted(this.is_relief) });
    this.changed();
  }

  /** Why a person may not drive from here now; "" if they may. */
  refusal() {
    const { hello, condition } = this,
      drive = hello?.drive;
    if (this.link.state !== "open") return "there is no connection";
    if (this.timeline.world) return "this is the past: go live first";
    if (condition?.stale) return `the picture is not current (${condition.title.toLowerCase()})`;
    if (drive && !drive.allowed) return drive.why ?? "it is not allowed";
    return this.driver.token ? "" : "no token: type it below";
  }

  changed() {
    this.is_dirty = true;
  }

  /** What changes by time alone: ages, waits, staleness. */
  tick() {
    const { readout, timeline } = this;
    readout.tick(performance.now(), timeline.world !== null);
    this.changed();
  }

  draw() {
    this.is_dirty = false;
    const { theme, layers, timeline, driver, readout } = this,
      world = this.shown,
      is_past = timeline.world !== null;
    this.condition = conditionOf({
      link: this.link,
      world,
      heard_ms: this.heard_ms,
      now_ms: performance.now(),
      is_past,
    });
    const { stale: is_stale } = this.condition,
      { colours } = theme;
    const look = { colours, is_stale, key: theme.key };
    this.view.follow(world.state?.pose);
    const layer = layers.of(world);
    const scene = {
      world,
      look,
      layer,
      scale: layers.scale,
      shows: this.shows,
      robot: this.hello?.robot ?? null,
      path: this.path.until(is_past ? timeline.t_s : Infinity),
      steep: Number(by("steep").value),
      pinned: readout.pinned,
      is_focused: by("map").matches(":focus-visible"),
    };
    this.drawStage(scene, world);
    layers.show(layer, look);
    timeline.show();
    showCondition(this.condition, timeline, this.link);
    const may = this.hello?.drive?.allowed !== false;
    showWay(world.state, is_stale, may);
    showInputs(world.state, is_stale);
    showVectors(world, is_stale);
    showLink(world.state, this.link.damaged);
    showDriver(driver, this.live.state, this.refusal(), may);
    readout.show(world, this.hello, { is_past, is_stale });
  }

  drawStage(scene, world) {
    const { map, relief, camera } = this;
    showTools(this); // a canvas that is hidden has no size
    if (this.is_relief && this.view.is_following && world.state?.pose) {
      [camera.x_m, camera.y_m] = [world.state.pose.x, world.state.pose.y];
    }
    const words = this.is_relief ? relief.draw(scene) : map.draw(scene);
    by("veil").hidden = !words;
    if (words) setText(by("veil"), words);
    this.shownTo(world);
  }

  /** The map in words, for those who do not see it. */
  shownTo({ window, state }) {
    if (!window) return setText(by("map-words"), "No map.");
    const counts = [0, 0, 0];
    if (performance.now() - (this.counted_ms ?? -Infinity) < GRAPHS_MS) return undefined;
    this.counted_ms = performance.now();
    for (const cell of window.cells) counts[cell] += 1;
    const m2 = counts.map((n) => number(n * window.cell_m ** 2, 1));
    const robot = state?.pose
      ? ` Robot at x ${number(state.pose.x, 1)}, y ${number(state.pose.y, 1)} m.`
      : "";
    return setText(
      by("map-words"),
      `${m2[1]} m\u00b2 free, ${m2[2]} m\u00b2 obstacles, ${m2[0]} m\u00b2 unknown.${robot}`,
    );
  }

  get shows() {
    const boxes = document.querySelectorAll("[data-show]");
    return Object.fromEntries([...boxes].map((box) => [box.dataset.show, box.checked]));
  }

  drawGraphs() {
    if (!document.hidden) showGraphs(this.past, this.shown.t_s, this.theme.colours);
  }

  notice(text) {
    const notice = by("notice");
    setText(notice, text);
    notice.hidden = false;
    clearTimeout(this.notice_timer);
    this.notice_timer = setTimeout(() => (notice.hidden = true), 6000);
  }

  async save() {
    const world = this.shown,
      pose = world.state?.pose;
    const where = pose ? `x ${number(pose.x, 2)} y ${number(pose.y, 2)} m` : "no pose";
    const when = this.timeline.world ? `${span(this.live.t_s - world.t_s)} before ` : "";
    this.draw(); // a relief is read right after it is drawn
    const lines = [
      `mapod ${this.hello?.version ?? ""}  ${when}${new Date().toLocaleString()}`,
      `${this.condition.title}  ${where}  ${this.layers.chosen}  ${this.hello?.link ?? ""}`,
    ];
    const canvas = by(this.is_relief ? "relief" : "map");
    this.notice(`Saved as ${await savePicture(canvas, lines, this.theme.colours)}`);
  }
}

window.mapod = new Page(); // to be asked from the console, and by tests
