/** Which moment is shown: now, or one of the last minutes. */

import { setText, span } from "./words.js";
import { World } from "./world.js";

const STEP_S = 0.1,
  ANSWER_MS = 1000;
const by = (id) => document.getElementById(id);

export class Timeline extends EventTarget {
  /** Events: `change`. `world` is null while what is shown is live. `ask(t_s)`: of the server. */
  constructor(past, ask) {
    super();
    this.past = past;
    this.ask = ask;
    this.kept_s = null; // how far back the server's own history goes
    this.asked_ms = null; // when it was asked for a moment that this page has not
    this.world = null;
    this.t_s = null;
    this.index = -1; // of the newest entry shown
    this.played_ms = null; // when play went on last; null: it stands
    by("pause").addEventListener("click", () => (this.world ? this.goLive() : this.pause()));
    by("live").addEventListener("click", () => this.goLive());
    by("back").addEventListener("click", () => this.step(-1));
    by("forth").addEventListener("click", () => this.step(1));
    by("play").addEventListener("click", () => this.togglePlay());
    by("moment").addEventListener("input", () =>
      this.seek((this.past.end_s ?? 0) + Number(by("moment").value)),
    );
  }

  pause() {
    if (this.past.end_s !== null) this.seek(this.past.end_s);
  }

  goLive() {
    this.world = this.played_ms = null;
    this.dispatchEvent(new Event("change"));
  }

  /** To the state before the one shown, or after it. */
  step(way) {
    if (this.world === null) this.pause();
    if (this.world === null) return;
    this.played_ms = null;
    const from_s = this.world.state?.t_s ?? this.t_s,
      next_s = from_s + way * STEP_S;
    this.seek(this.past.has(next_s) ? this.past.neighbour(from_s, way) : next_s);
  }

  togglePlay() {
    if (this.world === null) return;
    this.played_ms = this.played_ms === null ? performance.now() : null;
    this.dispatchEvent(new Event("change"));
  }

  /** Goes on by the time that has passed; at its end it is live. */
  play() {
    if (this.played_ms === null) return;
    const now_ms = performance.now(),
      t_s = this.t_s + (now_ms - this.played_ms) / 1000;
    this.played_ms = now_ms;
    if (t_s >= this.past.end_s) this.goLive();
    else this.seek(t_s);
  }

  get begin_s() {
    const { begin_s } = this.past;
    return begin_s === null ? null : Math.min(begin_s, this.kept_s ?? Infinity);
  }

  seek(t_s) {
    if (this.begin_s === null) return;
    this.t_s = Math.min(Math.max(t_s, this.begin_s), this.past.end_s);
    if (this.past.has(this.t_s)) this.showOwn();
    else this.askServer();
    this.dispatchEvent(new Event("change"));
  }

  showOwn() {
    const index = this.past.after(this.t_s);
    if (this.world === null || index !== this.index) {
      this.world = new World();
      this.past.show(this.t_s, this.world);
    }
    this.index = index;
    this.world.t_s = this.t_s;
  }

  /** One question at a time; the answer asks again where the wish has moved on. */
  askServer() {
    const now_ms = performance.now();
    this.world ??= new World();
    this.index = -1;
    if (this.asked_ms !== null && now_ms - this.asked_ms < ANSWER_MS) return;
    this.asked_ms = now_ms;
    this.asked_s = this.t_s;
    this.ask(this.t_s);
  }

  /** A part of the server's answer: the state comes first. */
  take(message) {
    if (this.world === null || this.past.has(this.t_s)) return;
    if (message.type === "state") {
      this.asked_ms = null;
      this.world = new World();
    }
    this.world.apply(message);
    this.world.t_s = message.t_s;
    if (message.type === "state" && this.asked_s !== this.t_s) this.askServer();
    this.dispatchEvent(new Event("change"));
  }

  /** Slider and words; called now and then, for the ends move. */
  show() {
    const { past, world } = this,
      slider = by("moment"),
      is_past = world !== null;
    if (is_past && this.begin_s === null)
      this.goLive(); // another run has begun
    else if (is_past && this.t_s < this.begin_s) this.seek(this.begin_s);
    const long_s = past.end_s === null ? 0 : past.end_s - this.begin_s;
    const ago_s = is_past ? past.end_s - this.t_s : 0;
    Object.assign(slider, { min: -long_s.toFixed(1), max: 0, disabled: past.end_s === null });
    slider.value = -ago_s;
    const words = is_past ? `\u2212${span(ago_s)}` : "live";
    slider.setAttribute("aria-valuetext", is_past ? `${span(ago_s)} ago` : "live");
    setText(by("ago"), words);
    setText(by("pause"), is_past ? "Resume" : "Pause");
    setText(by("play"), this.played_ms === null ? "Play" : "Hold");
    by("pause").setAttribute("aria-pressed", is_past);
    by("play").setAttribute("aria-pressed", this.played_ms !== null);
    for (const id of ["play", "live"]) by(id).disabled = !is_past;
  }
}
