/** The last minutes of what arrived, to step back through. Bounded in time and in bytes. */

import { bytesOf } from "./wire.js";
import { World } from "./world.js";

const KEPT_S = 300;
const KEPT_BYTES = 96e6;
const KEY_EVERY_S = 5; // a whole snapshot so often: a step back replays at most this much
const GAP_S = 1.5; // without a message, nothing is known of the time between
const LAYER_EVERY_S = 5; // layers are big and change slowly

export class Past {
  constructor() {
    this.forget();
  }

  forget() {
    this.entries = []; // {t_s, bytes, message} or {t_s, bytes, key}, oldest first
    this.bytes = 0;
    this.key_s = -Infinity;
    this.layer_s = new Map(); // name -> when one was kept last
  }

  get begin_s() {
    return this.entries.length ? this.entries[0].t_s : null;
  }

  get end_s() {
    return this.entries.length ? this.entries[this.entries.length - 1].t_s : null;
  }

  /** A message that has just been applied to the live world. */
  record(message, world) {
    if (this.end_s !== null && message.t_s < this.end_s - 1) this.forget(); // another run
    if (world.window && message.t_s - this.key_s >= KEY_EVERY_S) {
      this.key_s = message.t_s;
      this.entries.push(keyOf(world));
      this.bytes += this.entries[this.entries.length - 1].bytes;
    }
    if (message.type === "layer") {
      if (message.t_s - (this.layer_s.get(message.name) ?? -Infinity) < LAYER_EVERY_S) return;
      this.layer_s.set(message.name, message.t_s);
    }
    const entry = { t_s: message.t_s, bytes: bytesOf(message), message };
    this.entries.push(entry);
    this.bytes += entry.bytes;
    this.drop();
  }

  /** Throws away what is too old or too much, up to a snapshot. */
  drop() {
    const isOver = () =>
      this.bytes > KEPT_BYTES || this.end_s - this.entries[0].t_s > KEPT_S + KEY_EVERY_S;
    while (this.entries.length > 1 && isOver()) {
      let n = 1;
      while (n < this.entries.length && !this.entries[n].key) n += 1;
      for (const gone of this.entries.splice(0, n)) this.bytes -= gone.bytes;
    }
  }

  /** A connection begins with nothing: what was before is not of its picture. */
  cut() {
    if (this.entries.length)
      this.entries.push({ t_s: this.end_s, bytes: 2000, key: new World().snapshot() });
    this.key_s = -Infinity;
  }

  /** Whether this page was there at t_s. */
  has(t_s) {
    const entry = this.entries[this.after(t_s) - 1];
    return entry !== undefined && t_s - entry.t_s < GAP_S;
  }

  /** The world as it was at t_s, into `world`. */
  show(t_s, world) {
    const end = this.after(t_s);
    let from = end - 1;
    while (from > 0 && !this.entries[from].key) from -= 1;
    world.restore(this.entries[from]?.key ?? new World().snapshot());
    for (let k = Math.max(from, 0); k < end; k += 1) {
      if (this.entries[k].message) world.apply(this.entries[k].message);
    }
    world.t_s = t_s;
  }

  /** Index of the first entry later than t_s. */
  after(t_s) {
    let low = 0,
      high = this.entries.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.entries[middle].t_s <= t_s) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** The state that comes next after t_s, or before it. */
  neighbour(t_s, way) {
    let k = way > 0 ? this.after(t_s + 1e-6) : this.after(t_s - 1e-6) - 1;
    while (this.entries[k] && this.entries[k].message?.type !== "state") k += way;
    return this.entries[k]?.t_s ?? t_s;
  }

  /** States from a time to another, for graphs and the path. */
  *states(from_s, to_s) {
    for (let k = this.after(from_s); k < this.entries.length; k += 1) {
      const { t_s, message } = this.entries[k];
      if (t_s > to_s) return;
      if (message?.type === "state") yield message;
    }
  }
}

function keyOf(world) {
  const key = world.snapshot();
  return { t_s: world.t_s, bytes: 2000 + key.window.cells.byteLength, key };
}
