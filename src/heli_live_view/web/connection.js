// SPDX-License-Identifier: Apache-2.0
// The WebSocket to the node: reads JSON, sends commands, comes back with growing pauses when it breaks.

const FIRST_PAUSE_S = 0.5;
const LONGEST_PAUSE_S = 8;

export class Connection {
  // on: {hello, state, event, answer} take a message each; on.change() when `open` or `retryAt` changes.
  constructor(url, on) {
    this.url = url;
    this.on = on;
    this.open = false;
    this.everOpen = false;
    this.attempt = 0;
    this.retryAt = null;
    this.longest = LONGEST_PAUSE_S;
    this.lastId = 0;
  }

  connect() {
    clearTimeout(this.timer);
    this.retryAt = null;
    const socket = new WebSocket(this.url);
    this.socket = socket;
    socket.addEventListener("open", () => {
      this.open = this.everOpen = true;
      this.attempt = 0;
      this.on.change();
    });
    socket.addEventListener("message", (event) => this.receive(event.data));
    socket.addEventListener("close", () => {
      if (socket === this.socket) this.lost();
    });
    this.on.change();
  }

  lost() {
    this.open = false;
    const pause = Math.min(this.longest, FIRST_PAUSE_S * 2 ** this.attempt);
    this.attempt += 1;
    this.retryAt = performance.now() + 1000 * pause;
    this.timer = setTimeout(() => this.connect(), 1000 * pause);
    this.on.change();
  }

  receive(text) {
    let message;
    try {
      message = JSON.parse(text);
    } catch {
      return; // A line that is not JSON says nothing about the flight.
    }
    const take = this.on[message?.type];
    if (take) take(message);
  }

  // Sends a command or the token; returns the number that its answer will carry, 0 if not connected.
  send(message) {
    if (!this.open) return 0;
    this.lastId += 1;
    this.socket.send(JSON.stringify({ id: this.lastId, ...message }));
    return this.lastId;
  }
}
