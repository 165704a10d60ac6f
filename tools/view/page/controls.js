/** Buttons, keys and the map's pointer: what each of them does to the page. */

import { listenTo, mapKeys, reliefKeys, slideBy, turnBy } from "./stage.js";
import { setChip, setText, span } from "./words.js";

const ZOOM_STEP = 1.4;
const by = (id) => document.getElementById(id);

export function listenToButtons(page) {
  const { driver, view, readout } = page;
  const acts = {
    "to-relief": () => toRelief(page),
    follow: () => (view.is_following = !view.is_following),
    up: () => (view.is_heading_up = !view.is_heading_up),
    "zoom-in": () => zoom(page, ZOOM_STEP),
    "zoom-out": () => zoom(page, 1 / ZOOM_STEP),
    fit: () => fit(page),
    picture: () => page.save(),
    flight: () => page.link.send({ type: "flight", token: driver.token }),
    unpin: () => readout.pin(null),
    arm: () => arm(page),
  };
  for (const [id, act] of Object.entries(acts)) {
    by(id).addEventListener("click", () => {
      act();
      page.changed();
    });
  }
  by("banner")
    .querySelector("button")
    .addEventListener("click", () => page.retryNow());
  by("token-form").addEventListener("submit", (event) => {
    event.preventDefault();
    page.useToken(by("token").value.trim());
    by("token").value = "";
  });
  by("share").addEventListener("input", () => {
    driver.share = Number(by("share").value) / 100;
    setText(by("share-words"), `${by("share").value} %`);
  });
  by("steep").addEventListener("input", () => {
    setText(by("steep-words"), `${by("steep").value}\u00d7`);
    page.changed();
  });
  for (const box of document.querySelectorAll("[data-show]"))
    box.addEventListener("change", () => page.changed());
  addEventListener("keydown", (event) => shortcut(event));
}

const SHORTCUTS = {
  r: "to-relief",
  f: "follow",
  u: "up",
  0: "fit",
  p: "picture",
  k: "pause",
  j: "back",
  l: "forth",
};

function shortcut(event) {
  const { target, key } = event;
  if (
    event.ctrlKey ||
    event.metaKey ||
    event.altKey ||
    event.shiftKey ||
    target.matches("input, select, textarea")
  )
    return;
  if (key in SHORTCUTS) by(SHORTCUTS[key]).click();
}

function toRelief(page) {
  page.is_relief = !page.is_relief;
  page.readout.hovered = null;
  if (page.is_relief) Object.assign(page.camera, { x_m: page.view.x_m, y_m: page.view.y_m });
  page.askForLayers();
}

function zoom(page, factor) {
  if (page.is_relief) page.camera.zoom(factor);
  else page.view.zoom(factor);
}

function fit({ view, camera, shown, is_relief }) {
  if (!shown.window) return;
  const { size, cell_m } = shown.window;
  if (is_relief) camera.away_m = 1.25 * size * cell_m;
  else view.fit(shown.window);
}

/** Who takes the wheel looks at the present, and has the pad in front of them. */
function arm({ driver, timeline }) {
  if (!driver.is_armed) timeline.goLive();
  driver.arm(!driver.is_armed);
  if (driver.is_armed) {
    by("pad").hidden = false;
    by("pad").focus();
  }
}

export function listenToStage(page) {
  const { view, camera, readout } = page;
  const cellAt = (x, y) => {
    const cell_m = page.shown.window?.cell_m,
      [x_m, y_m] = view.place(x, y);
    return cell_m ? { i: Math.floor(x_m / cell_m), j: Math.floor(y_m / cell_m) } : null;
  };
  const hover = (x, y) => {
    readout.hovered = x === null ? null : cellAt(x, y);
    readout.tick(performance.now(), page.timeline.world !== null);
    page.changed();
  };
  const pin = (x, y) => {
    readout.pin(cellAt(x, y));
    hover(x, y);
  };
  const pinMiddle = () => pin(view.width / 2, view.height / 2);
  const changed =
    (act) =>
    (...values) => {
      act(...values);
      page.changed();
    };
  const keys = mapKeys(view, { pinMiddle, unpin: () => readout.pin(null) });
  listenTo(by("map"), {
    drag: changed((dx, dy) => view.pan(dx, dy)),
    zoom: changed((factor, x, y) => view.zoom(factor, x, y)),
    hover,
    click: pin,
    key: changed((event) => keys(event) && hover(view.width / 2, view.height / 2)),
  });
  listenTo(by("relief"), {
    drag: changed((dx, dy, is_slide) => dragRelief(page, dx, dy, is_slide)),
    zoom: changed((factor) => camera.zoom(factor)),
    hover: () => {},
    click: () => {},
    key: changed(reliefKeys(camera)),
  });
  for (const id of ["map", "relief"]) {
    for (const name of ["focus", "blur"]) by(id).addEventListener(name, () => page.changed());
  }
}

function dragRelief({ camera, view }, dx, dy, is_slide) {
  if (!is_slide) return turnBy(camera, dx, dy);
  view.is_following = false;
  return slideBy(camera, dx, dy, by("relief").clientHeight);
}

export function showTools({ is_relief, view }) {
  by("to-relief").setAttribute("aria-pressed", is_relief);
  setText(by("to-relief"), is_relief ? "Map" : "Relief");
  by("follow").setAttribute("aria-pressed", view.is_following);
  setText(by("up"), view.is_heading_up ? "Robot up" : "Map up");
  by("up").hidden = is_relief;
  by("map").hidden = is_relief;
  by("relief").hidden = !is_relief;
}

/** The chip, the banner over the map, and what is called out. */
export function showCondition(condition, timeline, link) {
  const root = document.documentElement,
    banner = by("banner"),
    is_past = timeline.world !== null;
  root.dataset.condition = condition.key;
  root.dataset.past = is_past;
  root.dataset.stale = condition.stale;
  setChip(
    by("condition"),
    is_past ? "warn" : condition.level,
    is_past ? "Paused" : condition.title,
  );
  const ago_s = is_past ? timeline.past.end_s - timeline.t_s : 0;
  const { title, text, level } = is_past ? paused(condition, ago_s) : condition;
  banner.hidden = !is_past && condition.level === "ok";
  banner.dataset.level = level;
  setText(banner.querySelector("strong"), title);
  setText(banner.querySelector("span"), text);
  banner.querySelector("button").hidden = is_past || link.state !== "waiting";
  const alarm = is_past
    ? "Paused: this is the past"
    : level === "bad"
      ? title
      : condition.key === "live"
        ? "Live"
        : "";
  setText(by("alarm"), alarm);
}

function paused(condition, ago_s) {
  const then =
    condition.key === "live" ? "" : ` Then: ${condition.title.toLowerCase()}. ${condition.text}`;
  return { title: "Paused", text: `What you see is ${span(ago_s)} old.${then}`, level: "warn" };
}
