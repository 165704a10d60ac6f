/** Which layer is shown, and what its colours mean. */

import { codeColour, ramp, rangeOf } from "./colours.js";
import { capital, number } from "./words.js";

const STATE = { name: "state", unit: "", label: "Obstacles" };
const SIGNED = new Set(["height", "z"]); // 0 is the middle of their colours

export class Layers extends EventTarget {
  /** Events: `choice`. */
  constructor(list, legend) {
    super();
    this.list = list;
    this.legend = legend;
    this.chosen = "state";
    this.known = [STATE];
    this.scale = null; // {low, high, is_codes} of the chosen layer
    this.key = "";
    this.offer([]);
  }

  /** What the server has; the obstacle map is always there. */
  offer(layers) {
    this.known = [STATE, ...layers.filter(({ name }) => name !== "state")];
    if (!this.known.some(({ name }) => name === this.chosen)) this.chosen = "state";
    const rows = this.known.map(({ name, label, unit }) => {
      const row = document.createElement("label"),
        input = document.createElement("input");
      Object.assign(input, {
        type: "radio",
        name: "layer",
        value: name,
        checked: name === this.chosen,
      });
      input.addEventListener("change", () => this.choose(name));
      row.append(input, capital(label ?? name));
      if (unit) row.append(Object.assign(document.createElement("small"), { textContent: unit }));
      return row;
    });
    this.list.replaceChildren(this.list.querySelector("legend"), ...rows);
    this.key = "";
  }

  choose(name) {
    this.chosen = name;
    this.key = "";
    this.dispatchEvent(new Event("choice"));
  }

  /** Names that the server is to send. */
  wanted(is_relief) {
    const names = [
      ...(this.chosen === "state" ? [] : [this.chosen]),
      ...(is_relief ? ["height"] : []),
    ];
    return [...new Set(names)];
  }

  /** The chosen layer of a world, with the scale of its colours; null: the obstacle map. */
  of(world) {
    const layer = this.chosen === "state" ? null : (world.layers.get(this.chosen) ?? null);
    if (layer === null) {
      this.scale = null;
      return null;
    }
    const key = `${layer.name} ${layer.t_s}`;
    if (this.scale?.key !== key) {
      const about = this.known.find(({ name }) => name === layer.name);
      const is_codes = Boolean(about?.words) || layer.name === "cause";
      const [low, high] = is_codes ? [0, 255] : (about?.range ?? []);
      const range =
        low === undefined ? rangeOf(layer.values, SIGNED.has(layer.name)) : { low, high };
      this.scale = { ...range, is_codes, key, about };
    }
    return layer;
  }

  show(layer, look) {
    const { scale } = this;
    const codes = scale?.is_codes ? codesOf(layer) : [];
    const key = [
      this.chosen,
      layer !== null,
      scale?.low,
      scale?.high,
      look.key,
      look.is_stale,
      codes,
    ].join();
    if (key === this.key) return;
    this.key = key;
    const rows =
      this.chosen === "state"
        ? stateRows(look)
        : layer === null
          ? [waiting()]
          : scale.is_codes
            ? codeRows(codes, scale.about?.words)
            : [bar(scale, look), marks(scale, scale.about?.unit ?? "")];
    const unknown = this.chosen === "state" ? [] : [swatch("", "not known", "hatched")];
    this.legend.replaceChildren(...rows, ...unknown);
  }
}

function stateRows({ colours, is_stale }) {
  if (is_stale) {
    return [
      swatch(colours.stale_free, "was free, not trusted now"),
      swatch(colours.stale_obstacle, "was an obstacle"),
      swatch("", "unknown", "hatched"),
    ];
  }
  return [
    swatch(colours.free, "free: seen, and free now"),
    swatch(colours.obstacle, "obstacle, step or drop"),
    swatch("", "unknown: not seen, or not trusted", "hatched"),
    swatch("", "object: dashed if it was moved, with an arrow if it moves; a wall is filled", "outline"),
    swatch(colours.scan, "scan line", "dots"),
  ];
}

function codesOf({ values }) {
  const codes = new Set();
  for (const value of values) if (!Number.isNaN(value)) codes.add(value & 255);
  return [...codes].sort((a, b) => a - b);
}

function codeRows(codes, words = []) {
  return codes.map((code) =>
    swatch(`rgb(${codeColour(code).join()})`, words[code] ?? `code ${code}`),
  );
}

function swatch(colour, words, kind = "") {
  const row = document.createElement("p"),
    box = document.createElement("i");
  row.className = "swatch";
  box.className = kind;
  if (colour) box.style.backgroundColor = colour;
  row.append(box, words);
  return row;
}

function waiting() {
  return Object.assign(document.createElement("p"), {
    className: "quiet",
    textContent: "Waiting for this layer.",
  });
}

function bar(scale, look) {
  const canvas = Object.assign(document.createElement("canvas"), {
    width: 256,
    height: 1,
    className: "ramp",
  });
  const colours = ramp(scale.low < 0, look.colours.is_dark),
    context = canvas.getContext("2d");
  for (let k = 0; k < 256; k += 1) {
    context.fillStyle = `rgb(${colours.subarray(3 * k, 3 * k + 3).join()})`;
    context.fillRect(k, 0, 1, 1);
  }
  return canvas;
}

function marks({ low, high }, unit) {
  const row = Object.assign(document.createElement("p"), { className: "marks" });
  const middle = low < 0 ? 0 : (low + high) / 2;
  row.append(
    ...[low, middle, high].map((value) =>
      Object.assign(document.createElement("span"), {
        textContent: number(value, digitsOf(high - low), unit),
      }),
    ),
  );
  return row;
}

function digitsOf(range) {
  return Math.max(0, Math.min(6, 2 - Math.floor(Math.log10(range))));
}
