// SPDX-License-Identifier: Apache-2.0
// What a command will do, said before it is sent; for a dangerous one also what it puts at risk.
//
// Each function gives { text, danger }: danger is null, or { title, text, yes } for the question that is asked first.

import { nameOf } from "./faults.js";
import { wrapped } from "./format.js";

// A 1-cosine gust from there on pushes the simulated hover a decimetre away (10 m/s for 5 s: 0.09 m).
const STRONG_GUST_MPS = 10;
// Below it the drift of a standalone receiver (1.5 m upright, one sigma) reaches the ground.
const LOW_M = 5;
const POINTS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"];
// Longer than this an IMU that stops or lies is no gap any more that the navigation bridges.
const BRIDGED_S = 0.2;
const STILL_M = 0.05;
const STILL_DEG = 0.5;

const metres = (value) => `${value.toFixed(1)} m`;
const compass = (degrees) => POINTS[Math.round((((degrees % 360) + 360) % 360) / 45) % 8];

function altitudeOf(state) {
  const body = state?.nav ?? state?.truth;
  return body ? body.p[2] : null;
}

// `args` as sent: amplitude_mps, from_deg, duration_s.
export function ofGust({ amplitude_mps: peak, from_deg: from, duration_s: length }, state) {
  const text = `Wind from the ${compass(from)} rises by ${peak} m/s and falls again within ${length} s.`;
  const yes = "Send the gust";
  if (state?.mode === "attitude") {
    return { text, danger: { title: "A gust while nothing holds the position?", yes, text: `${text} Position and altitude are not held now: the helicopter is carried away with it.` } };
  }
  if (peak < STRONG_GUST_MPS) return { text, danger: null };
  return { text, danger: { title: "Send a strong gust?", yes, text: `${text} Gusts of ${STRONG_GUST_MPS} m/s and more bank the helicopter and push it a decimetre off its place.` } };
}

export function ofMode(mode, state) {
  if (mode === "hover") {
    return { text: "Hover: position and altitude are held again; the reference comes back slowly from where the helicopter is.", danger: null };
  }
  const height = altitudeOf(state);
  const now = height === null ? "" : ` It is ${metres(height)} high now.`;
  const text = "Attitude: only roll, pitch and heading are held, nothing holds position and altitude.";
  return {
    text,
    danger: {
      title: "Give up position and altitude hold?", yes: "Give up the hold",
      text: `${text}${now} The helicopter drifts with the wind and sinks or climbs, until Hover is sent or it hits the ground.`,
    },
  };
}

// `target` as sent: p (east, north, up), yaw_deg; `ref` is the present reference, `limits` the speeds of the move.
export function ofReference({ p, yaw_deg: yaw }, ref, limits) {
  if (!ref) return { text: "The reference moves there, and the helicopter with it.", danger: null };
  const [east, north, up] = p.map((x, i) => x - ref.p[i]);
  const [away, turn] = [Math.hypot(east, north), wrapped(yaw - ref.yaw_deg)];
  const parts = [];
  if (away >= STILL_M) parts.push(`${metres(away)} to the ${compass((Math.atan2(east, north) * 180) / Math.PI)}`);
  if (Math.abs(up) >= STILL_M) parts.push(`${metres(Math.abs(up))} ${up > 0 ? "up" : "down"}`);
  if (Math.abs(turn) >= STILL_DEG) parts.push(`${Math.abs(turn).toFixed(0)}° to the ${turn > 0 ? "right" : "left"}`);
  const seconds = Math.max(away / limits.speed_mps, Math.abs(up) / limits.climb_mps, Math.abs(turn) / limits.turn_dps);
  const way = parts.length ? `The reference moves ${parts.join(", ")} in ${Math.max(1, Math.ceil(seconds))} s, then stands.` : "The reference stays where it is.";
  const text = `${way} It takes the place of the scenario's.`;
  if (p[2] >= LOW_M) return { text, danger: null };
  return {
    text,
    danger: {
      title: `Fly down to ${metres(p[2])}?`, yes: `Fly at ${metres(p[2])}`,
      text: `${text} So low the error of the navigated altitude can bring the helicopter to the ground.`,
    },
  };
}

const INERTIAL = ["imu", "accel", "gyro"];

function feltAs(what, kind) {
  if (what === "wind") return "The helicopter is pushed and banks against it.";
  if (what.startsWith("delta_")) return "The servo no longer does what the attitude loop asks.";
  if (INERTIAL.includes(what)) return "Attitude and position are known worse, or wrongly.";
  if (what.startsWith("gps")) return "The place is held by what the other sensors say; lost for long, it lands by itself.";
  return kind === "loss" ? "It is flown without." : "What contradicts the other sensors is refused.";
}

// `args` as sent: what, kind, value or none, duration_s or none.
export function ofFault({ what, kind, value, duration_s: length }, state) {
  const [lasts, name] = [length === undefined ? "until it is cleared" : `for ${length} s`, nameOf(what)];
  const words = `${name.charAt(0).toUpperCase()}${name.slice(1)}: ${kind.replaceAll("_", " ")}, from now on, ${lasts}.`;
  const text = `${words} ${feltAs(what, kind)}`;
  const yes = "Inject it";
  if (what === "wind") {
    const peak = Math.hypot(...(value ?? []));
    if (peak >= STRONG_GUST_MPS || state?.mode === "attitude") return { text, danger: { title: "Send a strong gust?", yes, text } };
    return { text, danger: null };
  }
  const inertial = INERTIAL.includes(what) && !(length <= BRIDGED_S);
  if (!what.startsWith("delta_") && !inertial) return { text, danger: null };
  return { text, danger: { title: `Break the ${name}?`, yes, text: `${text} The helicopter may be lost.` } };
}
