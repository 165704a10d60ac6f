/** The socket: opens, tells what comes, and tries again with longer and longer waits. */

import { messageFromFrame, messageFromText } from "./wire.js";

const NEEDS_TOKEN = 4401; // a socket is closed with
const FIRST_WAIT_S = 0.5,
  LONGEST_WAIT_S = 10;

export class Link extends EventTarget {
  /** Events: `message` (detail: message), `change` (state, wait or reason is another). */
  constructor(url) {
    super();
    this.url = url;
    this.token = "";
    this.state = "connecting"; // connecting, open, waiting, refused
    this.lost_ms = performance.now(); // since when nothing is connected
    this.retry_ms = 0; // when it is tried again
    this.damaged = 0; // messages that could not be read
    this.wait_s = FIRST_WAIT_S;
    this.timer = 0;
    this.socket = null;
  }

  open() {
    clearTimeout(this.timer);
    if (this.socket) this.socket.onclose = null;
    this.socket?.close();
    const query = this.token ? `?token=${encodeURIComponent(this.token)}` : "";
    const socket = (this.socket = new WebSocket(this.url + query));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.opened();
    socket.onmessage = (event) => this.received(event.data);
    socket.onclose = (event) => this.closed(event.code);
    this.become("connecting");
  }

  send(message) {
    if (this.state !== "open") return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  opened() {
    this.wait_s = FIRST_WAIT_S;
    this.become("open");
  }

  received(data) {
    const message = typeof data === "string" ? messageFromText(data) : messageFromFrame(data);
    if (message === null) this.damaged += 1;
    else this.dispatchEvent(new CustomEvent("message", { detail: message }));
  }

  closed(code) {
    if (this.state === "open") this.lost_ms = performance.now();
    if (code === NEEDS_TOKEN) return this.become("refused");
    this.retry_ms = performance.now() + 1000 * this.wait_s;
    this.timer = setTimeout(() => this.open(), 1000 * this.wait_s);
    this.wait_s = Math.min(2 * this.wait_s, LONGEST_WAIT_S);
    return this.become("waiting");
  }

  become(state) {
    this.state = state;
    this.dispatchEvent(new Event("change"));
  }
}
