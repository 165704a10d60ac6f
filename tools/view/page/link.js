/** The socket: opens, tells what comes, and tries again with longer and longer waits. */

import { messageFromFrame, messageFromText } from "./wire.js";

const FIRST_WAIT_S = 0.5, LONGEST_WAIT_S = 10;

export class Link extends EventTarget {
  /** Events: `message` (detail: message), `change` (state, wait or reason is another). */
  constructor(url) {
    super();
    this.url = url;
    this.state = "connecting"; // connecting, open, waiting
    this.lost_ms = performance.now(); // since when nothing is connected
    this.opened_ms = null;
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
    const socket = (this.socket = new WebSocket(this.url));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.opened();
    socket.onmessage = (event) => this.received(event.data);
    socket.onclose = () => this.closed();
    this.become("connecting");
  }

  send(message) {
    if (this.state !== "open") return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  opened() {
    this.opened_ms = performance.now();
    this.wait_s = FIRST_WAIT_S;
    this.become("open");
  }

  received(data) {
    const message = typeof data === "string" ? messageFromText(data) : messageFromFrame(data);
    if (message === null) this.damaged += 1;
    else this.dispatchEvent(new CustomEvent("message", { detail: message }));
  }

  closed() {
    if (this.state === "open") this.lost_ms = performance.now();
    this.retry_ms = performance.now() + 1000 * this.wait_s;
    this.timer = setTimeout(() => this.open(), 1000 * this.wait_s);
    this.wait_s = Math.min(2 * this.wait_s, LONGEST_WAIT_S);
    this.become("waiting");
  }

  become(state) {
    this.state = state;
    this.dispatchEvent(new Event("change"));
  }
}
