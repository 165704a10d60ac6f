/** Numbers and states in words. */

export const CELL_WORDS = ["unknown", "free", "obstacle"];
export const MODES = ["booting", "running", "degraded", "fault", "replayed or simulated data"];
const MISSING = [
  "scanner",
  "attitude sensor",
  "wheel encoders or poses",
  "clock lock",
  "pose",
  "map",
  "pace",
];
const WARNINGS = {
  7: "drop-off ahead",
  8: "scanner window dirty",
  9: "attitude too steep",
  15: "stop asked",
};
export const POSE_VALID = 1 << 4,
  MAP_VALID = 1 << 5; // of the health bits

const known = (value) => typeof value === "number" && Number.isFinite(value);

/** A number with its unit; a dash where it is not known. */
export const number = (value, digits, unit = "") =>
  known(value) ? `${value.toFixed(digits).replace("-", "\u2212")}${unit && ` ${unit}`}` : "\u2013";

export const signed = (value, digits, unit = "") =>
  (known(value) && value >= 0 ? "+" : "") + number(value, digits, unit);

export const degrees = (rad, digits = 1) =>
  known(rad) ? `${signed((rad * 180) / Math.PI, digits)}\u00b0` : "\u2013";

export function age(age_s) {
  if (!known(age_s)) return "more than 1 s";
  return age_s < 1 ? `${Math.round(1000 * age_s)} ms` : span(age_s);
}

export function span(time_s) {
  if (!known(time_s)) return "\u2013";
  if (time_s < 60) return `${time_s.toFixed(time_s < 10 ? 1 : 0)} s`;
  return `${Math.floor(time_s / 60)} min ${Math.floor(time_s % 60)} s`;
}

export const capital = (text) => text[0].toUpperCase() + text.slice(1);

/** What the health bits say: what is missing, and warnings. */
export function healthWords(bits) {
  const missing = MISSING.filter((_, bit) => !((bits >> bit) & 1)).map((name) => `no ${name}`);
  const warnings = Object.keys(WARNINGS).filter((bit) => (bits >> bit) & 1);
  return [...missing, ...warnings.map((bit) => WARNINGS[bit])];
}

const ZONE_STATES = ["unknown", "clear", "slow", "stop"];

/** Of a stop zone's state, by number or word. */
export function zoneName(state) {
  const name = ZONE_STATES[state] ?? state;
  return ZONE_STATES.includes(name) ? name : "unknown";
}

/** Where a bearing points, counter-clockwise from ahead. */
export function bearingWords(rad) {
  if (!known(rad)) return "";
  const turned = Math.round((rad * 180) / Math.PI);
  if (Math.abs(turned) <= 8) return "ahead";
  if (Math.abs(turned) >= 172) return "behind";
  return `${Math.abs(turned)}\u00b0 ${turned > 0 ? "left" : "right"}`;
}

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Sets the sign (ok, note, warn, bad) and text of a chip. */
export function setChip(element, level, text) {
  element.dataset.level = level;
  element.hidden = text === "";
  setText(element.querySelector("span"), text);
}

/** Rows of a description list, changed only where they differ. */
export function setPairs(list, pairs) {
  while (list.children.length > 2 * pairs.length) list.lastChild.remove();
  while (list.children.length < 2 * pairs.length) {
    list.append(document.createElement("dt"), document.createElement("dd"));
  }
  pairs.forEach(([name, value], k) => {
    setText(list.children[2 * k], name);
    setText(list.children[2 * k + 1], value);
  });
}
