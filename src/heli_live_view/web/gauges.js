// SPDX-License-Identifier: Apache-2.0
// Wind compass, comparison with the paper's bounds, actuator bars, the numbers of the top line.

import { Canvas2d, FONT, line } from "./canvas2d.js";
import { bearing, clock, fixed, named, put, signed, UNKNOWN, wrapped } from "./format.js";

const RAD = Math.PI / 180;
const NEAR_LIMIT = 0.95;
const BOUNDS = [
  ["altitude_m", "altitude", "m"], ["v_z_mps", "v_z", "m/s"], ["v_x_mps", "v_x", "m/s"],
  ["v_y_mps", "v_y", "m/s"], ["lateral_m", "lateral", "m"], ["longitudinal_m", "longitudinal", "m"],
];
const ACTUATORS = ["lateral", "longitudinal", "pedal", "collective"];

export class WindCompass {
  constructor(canvas, parts, theme) {
    this.surface = new Canvas2d(canvas);
    this.parts = parts;
    theme.follow((colours) => {
      this.colours = colours;
    });
  }

  draw(wind, psi) {
    const g = this.surface.begin();
    const radius = Math.min(this.surface.width, this.surface.height) / 2 - 2;
    g.translate(this.surface.width / 2, this.surface.height / 2);
    g.strokeStyle = this.colours.line;
    g.fillStyle = this.colours.wash;
    g.beginPath();
    g.arc(0, 0, radius, 0, 7);
    g.fill();
    g.stroke();
    g.fillStyle = this.colours.soft;
    g.strokeStyle = this.colours.muted;
    g.font = FONT(10, 600);
    g.textAlign = "center";
    g.textBaseline = "middle";
    ["N", "E", "S", "W"].forEach((name, i) => {
      const a = 90 * i * RAD;
      g.fillText(name, (radius - 9) * Math.sin(a), -(radius - 9) * Math.cos(a));
    });
    for (let a = 0; a < 360; a += 30) {
      if (a % 90 === 0) continue;
      const [s, c] = [Math.sin(a * RAD), -Math.cos(a * RAD)];
      line(g, (radius - 5) * s, (radius - 5) * c, (radius - 1) * s, (radius - 1) * c);
    }
    if (Number.isFinite(psi)) this.nose(g, psi);
    if (wind) this.arrow(g, wind, radius - 17);
  }

  // The aircraft from above, small, in its heading.
  nose(g, psi) {
    g.save();
    g.rotate(psi * RAD);
    g.strokeStyle = this.colours.muted;
    g.lineWidth = 2;
    g.beginPath();
    g.ellipse(0, -2, 4, 9, 0, 0, 7);
    g.moveTo(0, 7);
    g.lineTo(0, 17);
    g.moveTo(-3.5, 17);
    g.lineTo(3.5, 17);
    g.stroke();
    g.restore();
  }

  arrow(g, wind, reach) {
    const speed = Math.hypot(wind[0], wind[1]);
    if (speed < 0.05) return;
    const half = reach * Math.min(1, 0.35 + speed / 9);
    g.save();
    g.rotate(bearing(wind[0], wind[1]) * RAD);
    g.strokeStyle = g.fillStyle = this.colours.green;
    g.lineWidth = 3.5;
    line(g, 0, half, 0, -half + 9);
    g.beginPath();
    g.moveTo(0, -half);
    g.lineTo(-7, -half + 13);
    g.lineTo(7, -half + 13);
    g.fill();
    g.restore();
  }

  tell(wind, psi) {
    const { speed, from, nose, up } = this.parts;
    put(speed, wind ? fixed(Math.hypot(wind[0], wind[1]), 1, "m/s") : UNKNOWN);
    if (!wind) {
      put(from, "no wind known");
      put(nose, "");
      put(up, "");
      return;
    }
    const to = bearing(wind[0], wind[1]);
    const comesFrom = (to + 180) % 360;
    put(from, `from ${fixed(comesFrom, 0)}° to ${fixed(to, 0)}°`);
    const off = wrapped(comesFrom - psi);
    put(nose, Number.isFinite(psi) ? `${fixed(Math.abs(off), 0)}° ${off < 0 ? "left" : "right"} of the nose` : "");
    put(up, `vertical ${signed(wind[2], 1, "m/s")}`);
  }
}

export class BoundsTable {
  constructor(body) {
    this.rows = BOUNDS.map(([key, name, unit]) => {
      const row = body.insertRow();
      const head = document.createElement("th");
      head.scope = "row";
      head.append(named(name), `, ${unit}`);
      row.append(head);
      const cells = [1, 2, 3, 4, 5].map(() => row.insertCell());
      const meter = document.createElement("span");
      meter.className = "meter";
      meter.setAttribute("aria-hidden", "true");
      const [now, peak] = [document.createElement("i"), document.createElement("i")];
      peak.className = "peak";
      meter.append(now, peak);
      head.append(meter);
      return { key, row, cells, now, peak };
    });
  }

  update(state, flight, shown) {
    const errors = state?.[shown]?.error;
    const largest = flight.last?.largest;
    for (const { key, row, cells, now, peak } of this.rows) {
      const bound = flight.info?.bounds?.[key];
      const [whole, windows] = ["whole", "windows"].map((stretch) => largest?.[stretch]?.[shown]?.[key] ?? null);
      // Of positions only, and only of ground truth: what the control can be judged by.
      const less = ["windows", "whole"].map((stretch) => largest?.[stretch]?.truth_less_drift?.[key]);
      put(cells[0], signed(errors?.[key], 2));
      [whole, windows, shown === "truth" ? less[0] ?? less[1] ?? null : null].forEach((value, i) => {
        put(cells[1 + i], fixed(value, 2));
        cells[1 + i].dataset.in = String(!bound || value === null || value <= bound);
      });
      put(cells[4], fixed(bound, 2));
      row.dataset.in = String(!bound || !(Math.abs(errors?.[key]) > bound));
      const share = (value) => Math.min(1, Math.abs(value ?? 0) / (bound || Infinity));
      now.style.transform = `scaleX(${share(errors?.[key])})`;
      peak.style.transform = `translateX(${100 * (share(windows ?? whole) - 1)}%)`;
    }
  }
}

export class Actuators {
  constructor(parent) {
    this.rows = ACTUATORS.map((name) => {
      const row = document.createElement("div");
      const label = document.createElement("span");
      label.textContent = name;
      const bar = document.createElement("span");
      bar.className = "bar";
      bar.setAttribute("role", "meter");
      bar.setAttribute("aria-label", `actuator ${name}`);
      bar.setAttribute("aria-valuemin", "-1");
      bar.setAttribute("aria-valuemax", "1");
      const fill = document.createElement("i");
      bar.append(fill);
      const value = document.createElement("output");
      row.append(label, bar, value);
      parent.append(row);
      return { bar, fill, value };
    });
  }

  update(u) {
    this.rows.forEach(({ bar, fill, value }, i) => {
      const x = u?.[i];
      fill.style.transform = `scaleX(${Math.max(-1, Math.min(1, x ?? 0))})`;
      bar.dataset.near = String(Math.abs(x ?? 0) >= NEAR_LIMIT);
      bar.setAttribute("aria-valuenow", (x ?? 0).toFixed(2));
      put(value, signed(x, 3));
    });
  }
}

export class TopLine {
  constructor(parts) {
    this.parts = parts;
  }

  flight(info) {
    const { scenario, seed, duration_s: duration, realtime } = info.flight ?? {};
    const words = [info.aircraft?.name, scenario, seed === null || seed === undefined ? "" : `seed ${seed}`, duration ? `${duration} s` : "", realtime === false ? "lockstep" : ""];
    put(this.parts.name, words.filter(Boolean).join(" · ") || "live view");
  }

  update(state) {
    const { mode, time, rtf, gps } = this.parts;
    put(mode, state?.mode ?? UNKNOWN);
    put(time, clock(state?.t ?? NaN));
    const speed = state?.replay?.speed;
    put(this.parts.rtfName, speed ? "speed" : "real-time factor");
    put(rtf, speed ? `${speed}×` : fixed(state?.rtf, 2));
    put(gps, fixed(state?.gps?.age_s, 2, "s"));
  }
}
