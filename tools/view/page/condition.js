/** What is to be thought of the picture: one condition at a time, the strictest first. */

import { MAP_VALID, span } from "./words.js";

const SILENT_S = 1; // without a state, what is shown is not current
const FAULT = 3,
  BOOTING = 0,
  REPLAYED = 4;

/** {key, level, title, text, stale}: level ok, note, warn or bad; stale: the map is greyed out.
 *
 * `about`: {link, world, heard_ms, now_ms, is_past}. */
export function conditionOf(about) {
  return (about.is_past ? null : ofSocket(about)) ?? ofState(about.world, about.is_past);
}

function ofSocket({ link, world, heard_ms, now_ms }) {
  const since_s = (now_ms - link.lost_ms) / 1000,
    wait_s = Math.max(0, link.retry_ms - now_ms) / 1000;
  if (link.state === "refused") {
    return bad(
      "token",
      "Token needed",
      "This server shows its map with its token alone: type it into panel Drive.",
    );
  }
  if (link.state !== "open") {
    if (heard_ms === null && link.state === "connecting" && since_s < 3) {
      return { key: "connecting", level: "note", title: "Connecting", text: "", stale: true };
    }
    const next = link.state === "waiting" ? `Next try in ${wait_s.toFixed(0)} s.` : "Trying now.";
    const what = heard_ms === null ? "No connection" : "Connection lost";
    return bad("lost", what, `For ${span(since_s)}. ${next}`);
  }
  if (world.state === null || heard_ms === null) {
    return {
      key: "waiting",
      level: "note",
      title: "Connected",
      text: "Waiting for the first state.",
      stale: true,
    };
  }
  const silent_s = (now_ms - heard_ms) / 1000;
  if (silent_s > SILENT_S)
    return bad("silent", "Not current", `Nothing heard for ${span(silent_s)}.`);
  return null;
}

function ofState({ state, window }, is_past) {
  const blank = { key: "nothing", level: "note", title: "No map yet", stale: true };
  if (state === null) return { ...blank, text: is_past ? "Nothing was known then." : "" };
  const { link, mode, health_bits } = state;
  if (link?.stale && !link.blank) {
    const old = Number.isFinite(link.age_s) ? ` What is shown is ${span(link.age_s)} old.` : "";
    return bad("stale", "Stale", words(link.text, "Poses or maps do not arrive in time.") + old);
  }
  if (window === null || link?.blank)
    return { ...blank, text: words(link?.text, "The robot has sent none.") };
  if (mode === FAULT) return bad("fault", "Fault", words(faultOf(state), "An input is lost."));
  if (!(health_bits & MAP_VALID))
    return bad("untrusted", "Map not valid", "mapod does not trust it now.");
  if (mode === BOOTING)
    return { key: "booting", level: "note", title: "Starting", text: "", stale: false };
  if (link?.suspect) {
    return {
      key: "suspect",
      level: "warn",
      title: "Repairing",
      text: "A lost frame is not repaired yet.",
      stale: false,
    };
  }
  if (mode === REPLAYED) {
    return {
      key: "replay",
      level: "warn",
      title: "Replay",
      text: "Replayed or simulated data: not this robot now.",
      stale: false,
    };
  }
  return { key: "live", level: "ok", title: "Live", text: "", stale: false };
}

const bad = (key, title, text) => ({ key, level: "bad", title, text, stale: true });

/** As one sentence, without a word in capitals before it. */
function words(text, otherwise) {
  const said = (text || otherwise).replace(/^[A-Z]+: /, "");
  return `${said[0].toUpperCase()}${said.slice(1)}${said.endsWith(".") ? "" : "."}`;
}

function faultOf(state) {
  const out = (state.inputs ?? []).filter((input) => !input.ok);
  return out.map(({ name, text }) => (text ? `${name}: ${text}` : `no ${name}`)).join("; ");
}
