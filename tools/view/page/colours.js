/** Colours: those of the page's style sheet for the map, and ramps for layers of numbers. */

import { FREE, OBSTACLE } from "./wire.js";

const STEPS = 256;
const LEAST_SIGNED = 0.2; // metres: noise of the floor is not to be coloured
const NAMES = [
  "outside",
  "unknown",
  "hatch",
  "free",
  "obstacle",
  "stale-free",
  "stale-obstacle",
  "edge",
  "grid",
  "robot",
  "robot-edge",
  "path",
  "object",
  "ahead",
  "scan",
  "clear",
  "slow",
  "stop",
  "cursor",
  "ink",
  "grid-ink",
  "panel",
];

/** The style sheet's `--map-...` as CSS colours, by name without dashes. */
export function mapColours() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(`--map-${name}`).trim();
  const colours = Object.fromEntries(NAMES.map((name) => [name.replace("-", "_"), of(name)]));
  colours.is_dark = style.colorScheme.includes("dark") && !style.colorScheme.includes("light");
  return colours;
}

/** A CSS colour #rrggbb as a pixel of an ImageData, little-endian ABGR. */
export function pixelOf(css) {
  const rgb = Number.parseInt(css.slice(1), 16);
  return (0xff000000 | ((rgb & 0xff) << 16) | (rgb & 0xff00) | (rgb >> 16)) >>> 0;
}

/** OKLCH (lightness 0..1, chroma, hue in degrees) to [r, g, b] of 0..255.
 *
 * Source: Bjorn Ottosson, "A perceptual color space for image processing", 2020. */
export function rgbFromOklch(lightness, chroma, hue_deg) {
  const hue = (hue_deg * Math.PI) / 180,
    a = chroma * Math.cos(hue),
    b = chroma * Math.sin(hue);
  const l = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (lightness - 0.0894841775 * a - 1.291485548 * b) ** 3;
  return [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
    -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
  ].map((linear) => {
    const light = Math.min(1, Math.max(0, linear));
    const gamma = light <= 0.0031308 ? 12.92 * light : 1.055 * light ** (1 / 2.4) - 0.055;
    return Math.round(255 * gamma);
  });
}

const ONE_WAY = [
  [0.3, 0.1, 285],
  [0.47, 0.11, 250],
  [0.64, 0.1, 200],
  [0.8, 0.12, 150],
  [0.95, 0.12, 105],
];
const TWO_WAYS_LIGHT = [
  [0.42, 0.13, 45],
  [0.72, 0.13, 65],
  [0.94, 0.02, 95],
  [0.7, 0.1, 235],
  [0.38, 0.13, 265],
];
const TWO_WAYS_DARK = [
  [0.84, 0.14, 75],
  [0.6, 0.13, 55],
  [0.36, 0.02, 260],
  [0.62, 0.11, 240],
  [0.9, 0.07, 220],
];

/** A ramp of 256 colours (r, g, b): each half told apart by lightness alone. */
export function ramp(is_signed, is_dark) {
  const stops = is_signed ? (is_dark ? TWO_WAYS_DARK : TWO_WAYS_LIGHT) : ONE_WAY;
  const colours = new Uint8Array(3 * STEPS);
  for (let k = 0; k < STEPS; k += 1) {
    const at = (k / (STEPS - 1)) * (stops.length - 1),
      n = Math.min(Math.floor(at), stops.length - 2);
    const mixed = stops[n].map((from, part) => from + (stops[n + 1][part] - from) * (at - n));
    colours.set(rgbFromOklch(...mixed), 3 * k);
  }
  return colours;
}

const CODES = [
  [0.8, 0.02, 95],
  [0.62, 0.12, 250],
  [0.78, 0.13, 75],
  [0.5, 0.12, 300],
  [0.72, 0.1, 190],
  [0.42, 0.1, 30],
  [0.88, 0.1, 105],
  [0.35, 0.06, 255],
];

/** A colour for a code; codes beyond the table begin it again, darker. */
export function codeColour(code) {
  const [lightness, chroma, hue] = CODES[code % CODES.length];
  return rgbFromOklch(lightness - 0.12 * Math.floor(code / CODES.length), chroma, hue);
}

/** The range that colours a layer: without outliers, rounded so that it seldom changes. */
export function rangeOf(values, is_signed) {
  const sample = [];
  const every = Math.max(1, Math.floor(values.length / 8000));
  for (let k = 0; k < values.length; k += every)
    if (!Number.isNaN(values[k])) sample.push(values[k]);
  if (sample.length === 0)
    return { low: is_signed ? -LEAST_SIGNED : 0, high: is_signed ? LEAST_SIGNED : 1 };
  sample.sort((a, b) => a - b);
  const high = rounded(sample[Math.floor(0.99 * (sample.length - 1))]);
  const low = sample[Math.floor(0.01 * sample.length)];
  if (is_signed)
    return { low: -rounded(Math.max(LEAST_SIGNED, -low)), high: Math.max(LEAST_SIGNED, high) };
  return { low: 0, high: high > 0 ? high : 1 };
}

/** Up to 1, 1.5, 2, 3, 5 or 7 of a power of ten. */
function rounded(value) {
  if (!(value > 0)) return 0;
  const ten = 10 ** Math.floor(Math.log10(value));
  return ten * [1, 1.5, 2, 3, 5, 7, 10].find((step) => step * ten >= value * 0.999);
}

/** Where in a ramp a value lies, 0..255; with a signed range, 0 lies in the middle. */
export function rampIndex(value, { low, high }) {
  const share =
    low < 0 ? 0.5 + 0.5 * (value < 0 ? -value / low : value / high) : (value - low) / (high - low);
  return Math.round(255 * Math.min(1, Math.max(0, share)));
}

/** Pixels of cell states by a table of three; unknown is transparent: the hatch behind it shows. */
export function statePixels(colours, is_stale) {
  const table = new Uint32Array(256);
  table[FREE] = pixelOf(is_stale ? colours.stale_free : colours.free);
  table[OBSTACLE] = pixelOf(is_stale ? colours.stale_obstacle : colours.obstacle);
  return table;
}
