/** What is known of one cell: under the cursor, or pinned; asks the server why it is so. */

import { CELL_WORDS, age, degrees, number, setPairs, setText, signed } from "./words.js";

const ASK_EVERY_MS = 150,
  REFRESH_MS = 1000;

export class Readout {
  constructor(element, ask) {
    this.element = element;
    this.ask = ask;
    this.hovered = null; // {i, j}
    this.pinned = null;
    this.answer = null; // newest `cell` message
    this.asked = { key: "", ms: -Infinity };
  }

  get cell() {
    return this.pinned ?? this.hovered;
  }

  /** A click on a cell pins it; on the pinned one lets it go. */
  pin(cell) {
    const same = this.pinned && cell && cell.i === this.pinned.i && cell.j === this.pinned.j;
    this.pinned = same ? null : cell;
  }

  /** Asks for what is shown: at once when it is another cell, then once a second. */
  tick(now_ms, is_past) {
    const { cell, asked } = this;
    if (cell === null || is_past) return;
    const key = `${cell.i},${cell.j}`;
    if (now_ms - asked.ms < (key === asked.key ? REFRESH_MS : ASK_EVERY_MS)) return;
    this.asked = { key, ms: now_ms };
    this.ask({ type: "cell", i: cell.i, j: cell.j });
  }

  show(world, hello, { is_past, is_stale }) {
    const { cell, element } = this,
      window = world.window;
    element.hidden = cell === null || window === null;
    if (element.hidden) return;
    const state = world.cell(cell.i, cell.j),
      answer = is_past ? null : this.answerFor(cell);
    const told = state === null ? "outside of the window" : CELL_WORDS[state];
    element.dataset.state = state === null || is_stale ? "none" : told;
    setText(
      element.querySelector("#cell-title"),
      `Cell ${cell.i}, ${cell.j}${this.pinned ? " \u00b7 pinned" : ""}`,
    );
    element.querySelector("#unpin").hidden = this.pinned === null;
    const x_m = (cell.i + 0.5) * window.cell_m,
      y_m = (cell.j + 0.5) * window.cell_m;
    const pairs = [
      ["place", `x ${signed(x_m, 2)}  y ${signed(y_m, 2, "m")}`],
      ["class", is_stale && state !== null ? `${told}, as last told` : told],
      ...this.values(world, cell, answer, hello),
    ];
    setPairs(element.querySelector("dl"), pairs);
    setText(element.querySelector("#cell-why"), this.why(answer, is_past));
  }

  answerFor({ i, j }) {
    const { answer } = this;
    return answer && answer.i === i && answer.j === j ? answer : null;
  }

  values(world, { i, j }, answer, hello) {
    const height = answer?.height_m ?? world.value("height", i, j);
    const variance = answer?.variance_m2 ?? world.value("variance", i, j);
    const sigma = variance >= 0 ? ` \u00b1 ${number(Math.sqrt(variance), 3)}` : "";
    const pairs = [
      ["height", Number.isFinite(height) ? `${signed(height, 3)}${sigma} m` : "\u2013"],
    ];
    const slope = answer?.slope_rad ?? world.value("slope", i, j);
    if (Number.isFinite(slope)) pairs.push(["slope", degrees(slope)]);
    const age_s = answer?.age_s ?? world.value("age", i, j);
    if (Number.isFinite(age_s)) pairs.push(["age", age(age_s)]);
    for (const { name, unit, label } of hello?.layers ?? []) {
      const value = world.value(name, i, j);
      if (SHOWN_ABOVE.has(name) || !Number.isFinite(value)) continue;
      pairs.push([label ?? name, number(value, 3, unit)]);
    }
    return pairs;
  }

  why(answer, is_past) {
    if (is_past)
      return "Why it was so is not kept on this page: mapod why tells it of a recording.";
    if (!answer) return "";
    const { cause, text = "" } = answer;
    const is_said = typeof cause !== "string" || text.includes(cause); // a code says nothing
    return (is_said ? [text] : [cause, text]).filter(Boolean).join(": ");
  }
}

const SHOWN_ABOVE = new Set(["state", "height", "variance", "slope", "age", "cause"]);
