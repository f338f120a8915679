// SPDX-License-Identifier: Apache-2.0
// What is known of the flight: the newest state, the last minute, and the pose at the moment that is drawn.

import { wrapped } from "./format.js";

export const KEPT_S = 60;
const ROW_STEP_S = 1 / 15;
const STALE_MS = 1500;

const lerp = (a, b, f) => a + (b - a) * f;
const lerps = (a, b, f) => (a && b ? a.map((x, i) => lerp(x, b[i], f)) : (b ?? a));
const lerpEach = (a, b, f) =>
  a && b ? Object.fromEntries(Object.entries(b).map(([key, y]) => [key, lerp(a[key] ?? y, y, f)])) : (b ?? null);

// Quaternions of neighbouring states are close: linear, on the same side, normalised.
function turned(a, b, f) {
  const side = a.reduce((sum, x, i) => sum + x * b[i], 0) < 0 ? -1 : 1;
  const q = a.map((x, i) => lerp(x, side * b[i], f));
  const norm = Math.hypot(...q) || 1;
  return q.map((x) => x / norm);
}

function between(a, b, f) {
  if (!a || !b) return b ?? a ?? null;
  return {
    p: lerps(a.p, b.p, f),
    q: turned(a.q, b.q, f),
    v_enu: lerps(a.v_enu, b.v_enu, f),
    v_body: b.v_body,
    rates_dps: b.rates_dps,
    euler_deg: a.euler_deg.map((x, i) => x + f * wrapped(b.euler_deg[i] - x)),
    error: lerpEach(a.error, b.error, f),
  };
}

function rotorBetween(a, b, f) {
  if (!a || !b) return b ?? a ?? null;
  return { a_s_deg: lerp(a.a_s_deg, b.a_s_deg, f), b_s_deg: lerp(a.b_s_deg, b.b_s_deg, f) };
}

// Compass heading of the reference, rad.
export function referenceHeading(ref) {
  return (ref.yaw_deg * Math.PI) / 180;
}

export class Flight {
  constructor() {
    this.info = null;
    this.source = "truth";
    this.clear();
  }

  clear() {
    this.recent = [];
    this.rows = [];
    this.events = [];
    this.last = null;
    this.arrived = this.advanced = -Infinity;
    this.playout = null;
    this.generation = (this.generation ?? 0) + 1;
  }

  hello(message) {
    const other = JSON.stringify(message.flight) !== JSON.stringify(this.info?.flight);
    this.info = message;
    const history = message.history ?? [];
    const behind = this.last && !(history.at(-1)?.t >= this.last.t - 1);
    if (other || behind || message.replay) this.clear();
    for (const row of history) if (!this.last || row.t > this.last.t) this.remember(row);
    if (message.events) this.events = [...message.events];
  }

  event(message) {
    this.events.push(message);
    if (this.events.length > 200) this.events.shift();
  }

  state(message) {
    this.arrived = performance.now();
    if (message.t === null) {
      this.waiting = message; // The clock has not started: nothing can be drawn on a time axis.
      return;
    }
    if (message.replay) {
      this.wind(message);
      return;
    }
    // Time that runs backwards is another flight.
    if (this.last && message.t < this.last.t - 1e-6) this.clear();
    if (!this.last || message.t > this.last.t) this.advanced = this.arrived;
    this.remember(message);
    this.recent.push({ at: this.arrived, state: message });
    if (this.recent.length > 40) this.recent.shift();
  }

  // A state of a replay brings the rows since the last one; after a jump, those before it.
  wind(message) {
    if (message.replay.anew) {
      [this.rows, this.recent, this.playout] = [[], [], null];
    }
    for (const row of message.past) this.keep(row);
    this.last = message;
    this.recent.push({ at: this.arrived, state: message });
    if (this.recent.length > 40) this.recent.shift();
  }

  remember(state) {
    this.last = state;
    const newest = this.rows.at(-1);
    if (!newest || state.t - newest.t >= ROW_STEP_S - 1e-6) this.keep(state);
  }

  keep(state) {
    const of = (body) => body && { p: body.p, euler: body.euler_deg, error: body.error };
    this.rows.push({
      t: state.t, truth: of(state.truth), nav: of(state.nav), set: state.setpoint_deg, u: state.u,
    });
    while (this.rows.length && this.rows[0].t < state.t - KEPT_S) this.rows.shift();
  }

  // Whether the time of a record stands: then nothing lies between states.
  get stands() {
    return this.last?.replay?.runs === false;
  }

  // How the flight ended: { kind, text }, or null while it goes on.
  get end() {
    return this.last?.end ?? null;
  }

  // Milliseconds without a message, and without a step of the simulation's clock.
  get silentMs() {
    return performance.now() - this.arrived;
  }

  get standingMs() {
    return performance.now() - this.advanced;
  }

  get stale() {
    return !this.last?.replay && this.standingMs > STALE_MS;
  }

  // The source that is shown: the chosen one, the other where there is none.
  shown(state = this.last) {
    if (!state) return this.source;
    const other = this.source === "truth" ? "nav" : "truth";
    return state[this.source] || !state[other] ? this.source : other;
  }

  // Flight seconds per second on this machine, out of the newest arrivals.
  pace() {
    const [first, last] = [this.recent[0], this.recent.at(-1)];
    if (!first || last.at - first.at < 100) return this.last?.replay?.speed || this.last?.rtf || 1;
    return (1000 * (last.state.t - first.state.t)) / (last.at - first.at);
  }

  // State at the moment to draw: a little behind the newest, so that there is something to go between.
  sample(now) {
    if (!this.recent.length) return this.last;
    const pace = this.pace();
    const newest = this.recent.at(-1);
    if (this.stands) return this.at(newest.state.t);
    const lag = 2.2 / (this.info?.state_hz || 30);
    const target = newest.state.t + pace * ((now - newest.at) / 1000 - lag);
    const dt = Math.max(0, now - (this.sampledAt ?? now)) / 1000;
    this.sampledAt = now;
    const behind = target - (this.playout ?? -Infinity) - pace * dt;
    if (Math.abs(behind) > 0.4 * Math.max(pace, 0.1)) this.playout = target;
    else this.playout += pace * dt + 0.1 * behind;
    this.playout = Math.min(this.playout, newest.state.t);
    return this.at(this.playout);
  }

  at(t) {
    const states = this.recent;
    let i = states.length - 1;
    while (i > 0 && states[i - 1].state.t >= t) i -= 1;
    const b = states[i].state;
    const a = states[Math.max(0, i - 1)].state;
    const span = b.t - a.t;
    const f = span > 0 ? Math.min(1, Math.max(0, (t - a.t) / span)) : 1;
    return {
      ...b,
      t,
      truth: b.truth && between(a.truth, b.truth, f),
      nav: b.nav && between(a.nav, b.nav, f),
      rotor: b.rotor && rotorBetween(a.rotor, b.rotor, f),
      rotor_truth: b.rotor_truth && rotorBetween(a.rotor_truth, b.rotor_truth, f),
      ref: b.ref && { ...b.ref, p: a.ref ? lerps(a.ref.p, b.ref.p, f) : b.ref.p },
    };
  }
}
