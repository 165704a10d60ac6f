/** The panels beside the map: way, inputs, link. Shows what a state says, as text first. */

import { SHOWN_S, drawGraph } from "./graphs.js";
import {
  MODES,
  age,
  bearingWords,
  capital,
  degrees,
  healthWords,
  number,
  setChip,
  setPairs,
  setText,
  signed,
  zoneName,
} from "./words.js";

const ADVICE_LEVELS = { go: "ok", slow: "warn", stop: "bad" };
const ZONE_LEVELS = { clear: "ok", slow: "warn", stop: "bad", unknown: "bad" };
const MODE_LEVELS = ["note", "ok", "warn", "bad", "warn"];
const BAR_M = 5; // a bar of the stop zone that is full
const AGE_GRAPH_S = 0.1,
  LATENCY_GRAPH_MS = 20; // graphs are at least so high

const by = (id) => document.getElementById(id);

/** What mapod advises. `may`: whether it moves the robot, or only looks on while others do. */
export function showWay(state, is_stale, may) {
  const [word, why] = is_stale || !state ? ["stop", "the picture is not current"] : adviceOf(state);
  const advice = by("advice");
  advice.dataset.level = ADVICE_LEVELS[word] ?? "bad";
  setText(advice.querySelector("strong"), word.toUpperCase());
  const looks_on = may || is_stale ? "" : "Advice: mapod only looks on. ";
  setText(advice.querySelector("span"), looks_on + (why ?? ""));
  showZone(is_stale ? null : state?.zone);
  const pose = state?.pose;
  setPairs(by("pose"), [
    ["position", pose ? `x ${signed(pose.x, 2)}  y ${signed(pose.y, 2, "m")}` : "no pose"],
    ["heading", degrees(pose?.yaw)],
    ["tilt", pose ? `pitch ${degrees(pose.pitch)}  roll ${degrees(pose.roll)}` : "\u2013"],
    ["speed", pose ? `${signed(pose.v, 2, "m/s")}  ${degrees(pose.w, 0)}/s` : "\u2013"],
  ]);
}

/** The stricter of what the link advises and what the stop zone says. */
function adviceOf({ advice, zone }) {
  const words = Object.keys(ADVICE_LEVELS); // from mild to strict
  const by_zone = zone ? ({ clear: "go", slow: "slow" }[zoneName(zone.state)] ?? "stop") : "go";
  if (words.indexOf(by_zone) <= words.indexOf(advice[0])) return advice;
  return [by_zone, (zone.text ?? "").replace(/^[a-z]+: /, "")];
}

function showZone(zone) {
  const element = by("zone");
  if (element.children.length === 0)
    element.append(...["ahead", "behind"].map(zoneBar), document.createElement("p"));
  const [ahead, behind, words] = element.children,
    name = zone ? zoneName(zone.state) : "unknown";
  element.dataset.level = ZONE_LEVELS[name];
  fillBar(ahead, zone?.free_ahead_m, zone?.allowed_ahead_mps);
  fillBar(behind, zone?.free_behind_m, zone?.allowed_behind_mps);
  const near = zone?.nearest_m ?? null;
  const nearest =
    near === null
      ? ""
      : ` Nearest obstacle ${number(near, 2, "m")}, ${bearingWords(zone.bearing_rad)}.`;
  setText(words, zone ? `Stop zone: ${zone.text || name}.${nearest}` : "Stop zone: not known.");
}

function zoneBar(name) {
  const row = document.createElement("div");
  row.className = "zone-bar";
  row.innerHTML = "<span></span><meter></meter><b></b><small></small>";
  row.querySelector("span").textContent = name;
  Object.assign(row.querySelector("meter"), { min: 0, max: BAR_M, ariaLabel: `free ${name}` });
  return row;
}

function fillBar(row, free_m, allowed_mps) {
  row.querySelector("meter").value = Math.min(free_m ?? 0, BAR_M);
  setText(row.querySelector("b"), number(free_m, 2, "m"));
  setText(row.querySelector("small"), `${number(allowed_mps, 2)} m/s`);
}

export function showInputs(state, is_stale) {
  const inputs = state?.inputs ?? [];
  rows(
    by("input-list"),
    inputs.map(({ name }) => name),
  );
  inputs.forEach((input, k) => {
    const row = by("input-list").children[k];
    const level = !input.ok ? "bad" : is_stale ? "note" : "ok";
    row.dataset.level = level;
    row.classList.toggle("short", !Number.isFinite(input.age_s) && input.ok);
    setText(
      row.querySelector(".value"),
      Number.isFinite(input.age_s) ? age(input.age_s) : input.ok ? "ok" : "\u2013",
    );
    setText(row.querySelector("small"), input.text ?? "");
  });
  const words = state ? healthWords(state.health_bits) : [];
  const health = words.length ? `${capital(words.join(", "))}.` : "All well.";
  setText(by("health-words"), state ? (is_stale ? `As last told: ${health}` : health) : "");
  by("health-words").dataset.level = words.length ? "bad" : "ok";
  setChip(
    by("mode"),
    state ? (MODE_LEVELS[state.mode] ?? "bad") : "note",
    state ? (state.mode_name ?? MODES[state.mode] ?? "") : "",
  );
}

export function showLink(state, damaged) {
  const rates = state?.rates ?? {},
    latency = state?.latency_ms,
    link = state?.link ?? {};
  const values = [
    ["map", number(rates.map_hz, 1, "Hz")],
    ["pose", number(rates.pose_hz, 1, "Hz")],
    ["scan", number(rates.scan_hz, 1, "Hz")],
    ["bytes", number(rates.bytes_s / 1000, 1, "kB/s")],
    ["latency", latency ? `${number(latency.p50, 1)} / ${number(latency.p99, 1)} ms` : "\u2013"],
  ];
  rows(
    by("link-list"),
    values.map(([name]) => name),
  );
  values.forEach(([, value], k) =>
    setText(by("link-list").children[k].querySelector(".value"), value),
  );
  setText(
    by("link-list").children[4].querySelector("small"),
    latency ? "median and, dashed, 99 of 100" : "",
  );
  const more = [
    link.text,
    link.lost ? `${link.lost} frames lost` : "",
    damaged ? `${damaged} messages not understood` : "",
  ];
  setText(by("link-words"), more.filter(Boolean).join(" \u00b7 "));
}

/** A list's rows, by name: sign, name, value, graph, small words. */
function rows(list, names) {
  if ([...list.children].map((row) => row.dataset.name).join("|") === names.join("|")) return;
  list.replaceChildren(
    ...names.map((name) => {
      const row = document.createElement("li");
      row.innerHTML =
        "<i class='sign' aria-hidden='true'></i><span></span><b class='value'></b><canvas class='graph' aria-hidden='true'></canvas><small></small>";
      row.dataset.name = name;
      row.querySelector("span").textContent = name;
      return row;
    }),
  );
}

/** All graphs, of the states of the last minutes before a time. */
export function showGraphs(past, end_s, colours) {
  if (end_s === null) return;
  const states = [...past.states(end_s - SHOWN_S, end_s)];
  const every = Math.max(1, Math.floor(states.length / 360)),
    some = states.filter((_, k) => k % every === 0);
  const times_s = some.map((state) => state.t_s);
  const graph = (row, most, ...lines) =>
    drawGraph(row.querySelector("canvas"), times_s, end_s, lines, most, colours);
  for (const row of by("input-list").children) {
    const ages = some.map(
      (state) => state.inputs?.find(({ name }) => name === row.dataset.name)?.age_s ?? NaN,
    );
    row.querySelector("canvas").hidden = !ages.some(Number.isFinite);
    graph(row, AGE_GRAPH_S, { values: ages, colour: colours.path });
  }
  const of = (pick) => some.map((state) => pick(state) ?? NaN);
  const picks = [
    ({ rates }) => rates?.map_hz,
    ({ rates }) => rates?.pose_hz,
    ({ rates }) => rates?.scan_hz,
    ({ rates }) => rates?.bytes_s,
  ];
  picks.forEach(
    (pick, k) =>
      by("link-list").children[k] &&
      graph(by("link-list").children[k], 1, { values: of(pick), colour: colours.path }),
  );
  const latency = by("link-list").children[4];
  if (latency) {
    graph(
      latency,
      LATENCY_GRAPH_MS,
      { values: of(({ latency_ms }) => latency_ms?.p50), colour: colours.path },
      { values: of(({ latency_ms }) => latency_ms?.p99), colour: colours.path, is_dashed: true },
    );
  }
}

/** Who drives, and why not. `may`: whether the robot lets anybody. */
export function showDriver(driver, state, refusal, may) {
  const told = state?.driving ?? {},
    mine = driver.is_driving;
  const speed = (told.v ?? null) === null ? "" : ` ${signed(told.v, 2, "m/s")}`;
  const who = told.by
    ? told.by === "you"
      ? `You drive${speed}`
      : `${capital(told.by)} drives${speed}`
    : mine
      ? "You ask to drive"
      : "Nobody drives";
  const held = mine || driver.is_armed;
  const why = refusal || (held && (driver.why_not || told.why_not)) || "";
  const words = by("who");
  words.dataset.level = why ? (held ? "bad" : "note") : told.by === "you" ? "warn" : "ok";
  setText(words, why ? `${held ? "Not driving" : `${who}. You cannot`}: ${why}.` : `${who}.`);
  setChip(
    by("driver"),
    why && held ? "bad" : told.by === "you" ? "warn" : told.by ? "note" : "ok",
    why && held ? `Not driving: ${why}` : who,
  );
  const arm = by("arm");
  arm.setAttribute("aria-pressed", driver.is_armed);
  arm.disabled = !may && !driver.is_armed;
  setText(arm, driver.is_armed ? "Let go of the wheel" : "Take the wheel");
  by("pad").hidden = !driver.is_armed;
  by("drive").classList.toggle("armed", driver.is_armed);
  by("pad").classList.toggle("driving", mine);
  by("token-form").hidden = driver.token !== "" && !/token/i.test(why);
  by("drive").classList.toggle("no-token", driver.token === "");
}
