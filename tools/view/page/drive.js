/** Drives while something is held: a dead man's key, the pad, a gamepad's shoulder. Else it stops. */

const PERIOD_MS = 100;
const LATE_MS = 350; // a page that stood still so long lets go: what is held is pressed anew
const DEAD_ZONE = 0.15;
const WAYS = {
  KeyW: [1, 0],
  ArrowUp: [1, 0],
  KeyS: [-1, 0],
  ArrowDown: [-1, 0],
  KeyA: [0, 1],
  ArrowLeft: [0, 1],
  KeyD: [0, -1],
  ArrowRight: [0, -1],
};
const SHIFTS = ["ShiftLeft", "ShiftRight"],
  SHOULDERS = [4, 5, 6, 7];

export class Driver extends EventTarget {
  /** `send(message)`; `refusal()`: why it may not drive now, or "". Events: `change`. */
  constructor(send, refusal) {
    super();
    this.send = send;
    this.refusal = refusal;
    this.token = "";
    this.share = 0.3;
    this.is_armed = false;
    this.is_driving = false;
    this.keys = new Set(); // codes that are held
    this.pad = null; // [v, w] while the pad is held
    this.why_not = ""; // what the server said to the newest wish
    this.needs_release = false; // of the gamepad, after a stop that it did not make
    this.tick_ms = performance.now();
    setInterval(() => this.tick(), PERIOD_MS);
    this.listen();
  }

  listen() {
    addEventListener("keydown", (event) => this.pressed(event), true);
    addEventListener("keyup", (event) => this.released(event), true);
    for (const name of ["blur", "pagehide", "beforeunload"])
      addEventListener(name, () => this.letGo());
    document.addEventListener("visibilitychange", () => this.letGo());
    addEventListener("gamepaddisconnected", () => this.letGo());
  }

  arm(is_armed) {
    if (!is_armed) this.letGo();
    this.is_armed = is_armed;
    this.dispatchEvent(new Event("change"));
  }

  pressed(event) {
    if (!this.is_armed || isTyping(event.target)) return;
    if (event.ctrlKey || event.metaKey || event.altKey || event.code === "Escape") {
      this.letGo();
      return;
    }
    const is_way = event.code in WAYS;
    const is_dead_man =
      SHIFTS.includes(event.code) || (event.code === "Space" && !isButton(event.target));
    if (!is_way && !is_dead_man) return;
    if (!event.repeat) this.keys.add(event.code);
    if (is_way ? this.holdsDeadMan() : event.code === "Space") {
      event.preventDefault();
      event.stopPropagation();
    }
    this.tick();
  }

  released(event) {
    if (this.keys.delete(event.code)) this.tick();
  }

  holdsDeadMan() {
    return this.keys.has("Space") || SHIFTS.some((code) => this.keys.has(code));
  }

  /** Everything counts as let go, and the robot is told to stop. */
  letGo() {
    this.keys.clear();
    this.pad = null;
    this.needs_release = true;
    this.act(null);
    this.dispatchEvent(new Event("change"));
  }

  tick() {
    const now_ms = performance.now(),
      is_late = now_ms - this.tick_ms > LATE_MS;
    this.tick_ms = now_ms;
    if (is_late && this.is_driving) this.letGo();
    this.act(this.wish());
  }

  /** Shares of the allowed speeds, -1..1, or null while nothing is held. */
  wish() {
    const held = this.keyWish() ?? this.pad ?? this.gamepadWish();
    if (!this.is_armed || held === null || held.every((share) => share === 0)) return null;
    return held.map((share) => Math.min(1, Math.max(-1, share)) * this.share);
  }

  keyWish() {
    if (!this.holdsDeadMan()) return null;
    const ways = [...this.keys].filter((code) => code in WAYS).map((code) => WAYS[code]);
    return ways.length ? ways.reduce((sum, way) => [sum[0] + way[0], sum[1] + way[1]]) : null;
  }

  gamepadWish() {
    const pads = [...(navigator.getGamepads?.() ?? [])].filter((pad) => pad?.connected);
    const pad = pads.find(({ buttons }) => SHOULDERS.some((k) => buttons[k]?.pressed));
    if (!pad) this.needs_release = false;
    if (!pad || this.needs_release) return null;
    const [across, along] = [pad.axes[0] ?? 0, pad.axes[1] ?? 0].map((axis) =>
      Math.abs(axis) > DEAD_ZONE ? axis : 0,
    );
    return [0 - along, 0 - across];
  }

  act(wish) {
    const was_driving = this.is_driving;
    this.is_driving = wish !== null && this.refusal() === "";
    if (this.is_driving) {
      this.send({ type: "drive", token: this.token, v: wish[0], w: wish[1], dead_man: true });
    } else if (was_driving) {
      this.send({ type: "stop" });
    }
    if (this.is_driving && !was_driving) this.why_not = "";
    if (this.is_driving !== was_driving) this.dispatchEvent(new Event("change"));
  }
}

const isTyping = (target) => target.matches?.("input, select, textarea") ?? false;
const isButton = (target) => target.matches?.("button, a, summary") ?? false;

/** Makes an element a pad: held by a finger or the mouse, it gives a direction. */
export function makePad(element, knob, driver) {
  let held = null;
  const move = (event) => {
    const { left, top, width, height } = element.getBoundingClientRect(),
      reach = 0.38 * width;
    let x = event.clientX - left - width / 2,
      y = event.clientY - top - height / 2;
    const far = Math.max(1, Math.hypot(x, y) / reach);
    [x, y] = [x / far, y / far];
    knob.style.transform = `translate(${x}px, ${y}px)`;
    const shares = [-y / reach, -x / reach].map((share) =>
      Math.abs(share) > DEAD_ZONE ? share : 0,
    );
    driver.pad = shares;
  };
  const end = () => {
    if (held === null) return;
    held = null;
    element.classList.remove("held");
    knob.style.transform = "";
    driver.letGo();
  };
  element.addEventListener("pointerdown", (event) => {
    if (held !== null || !driver.is_armed || event.button !== 0) return;
    held = event.pointerId;
    element.setPointerCapture(held);
    element.classList.add("held");
    move(event);
    event.preventDefault();
  });
  element.addEventListener(
    "pointermove",
    (event) => event.pointerId === held && driver.pad && move(event),
  );
  for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
    element.addEventListener(name, (event) => event.pointerId === held && end());
  }
  element.addEventListener("contextmenu", (event) => event.preventDefault());
}
