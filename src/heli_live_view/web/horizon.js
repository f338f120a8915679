// SPDX-License-Identifier: Apache-2.0
// Artificial horizon with bank scale, heading tape, ground speed, altitude and vertical speed.

import { Canvas2d, FONT, line } from "./canvas2d.js";
import { fixed, signed, wrapped } from "./format.js";

const PITCH_PX_PER_DEG = 7;
const RAD = Math.PI / 180;
const TAPE = 50;
const RISE = 36;
const POINTS = { 0: "N", 45: "NE", 90: "E", 135: "SE", 180: "S", 225: "SW", 270: "W", 315: "NW" };

export class Horizon {
  constructor(canvas, theme) {
    this.surface = new Canvas2d(canvas);
    this.canvas = canvas;
    theme.follow((colours) => {
      this.colours = colours;
    });
  }

  draw(body, ref, setpoint) {
    const g = this.surface.begin();
    const { width, height } = this.surface;
    const attitude = { x: TAPE + 6, y: 0, w: width - 2 * TAPE - RISE - 16, h: height - 40 };
    if (!body || attitude.w < 60) {
      g.fillStyle = this.colours.soft;
      g.font = FONT(12);
      g.textAlign = "center";
      g.fillText("no attitude known", width / 2, height / 2);
      return;
    }
    const [phi, theta, psi] = body.euler_deg;
    this.ball(g, attitude, phi, theta, setpoint);
    this.headingTape(g, { ...attitude, y: attitude.h + 8, h: 32 }, psi, setpoint?.[2] ?? ref?.yaw_deg);
    const speed = Math.hypot(body.v_enu[0], body.v_enu[1]);
    this.tape(g, { x: 0, y: 0, w: TAPE, h: attitude.h }, speed, { step: 0.5, px: 68, unit: "m/s", label: "speed", left: true });
    const right = { x: attitude.x + attitude.w + 6, y: 0, w: TAPE, h: attitude.h };
    this.tape(g, right, body.p[2], { step: 1, px: 30, unit: "m", label: "alt", bug: ref?.p[2] });
    this.rise(g, { x: right.x + right.w + 4, y: 0, w: RISE, h: attitude.h }, body.v_enu[2], ref?.v?.[2]);
  }

  ball(g, box, phi, theta, setpoint) {
    const [cx, cy] = [box.x + box.w / 2, box.y + box.h / 2];
    g.save();
    g.beginPath();
    g.roundRect(box.x, box.y, box.w, box.h, 6);
    g.clip();
    g.translate(cx, cy);
    g.rotate(-phi * RAD);
    g.translate(0, theta * PITCH_PX_PER_DEG);
    this.skyAndEarth(g);
    this.ladder(g);
    g.restore();
    g.save();
    g.beginPath();
    g.roundRect(box.x, box.y, box.w, box.h, 6);
    g.clip();
    this.bankScale(g, cx, cy, Math.min(box.w, box.h) * 0.43, phi, setpoint?.[0]);
    this.symbol(g, cx, cy, setpoint, theta);
    g.restore();
    g.fillStyle = "#fff";
    g.font = FONT(11, 600);
    g.textAlign = "left";
    g.textBaseline = "alphabetic";
    g.fillText(`φ ${signed(phi, 1)}°`, box.x + 7, box.y + box.h - 7);
    g.textAlign = "right";
    g.fillText(`θ ${signed(theta, 1)}°`, box.x + box.w - 7, box.y + box.h - 7);
  }

  skyAndEarth(g) {
    const reach = 900;
    const sky = g.createLinearGradient(0, -260, 0, 0);
    sky.addColorStop(0, this.colours["sky-hi"]);
    sky.addColorStop(1, this.colours["sky-lo"]);
    g.fillStyle = sky;
    g.fillRect(-reach, -reach, 2 * reach, reach);
    const earth = g.createLinearGradient(0, 0, 0, 260);
    earth.addColorStop(0, this.colours["earth-hi"]);
    earth.addColorStop(1, this.colours["earth-lo"]);
    g.fillStyle = earth;
    g.fillRect(-reach, 0, 2 * reach, reach);
    g.strokeStyle = "#fff";
    g.lineWidth = 1.6;
    line(g, -reach, 0, reach, 0);
  }

  ladder(g) {
    g.lineWidth = 1.2;
    g.fillStyle = g.strokeStyle = "rgba(255,255,255,.88)";
    g.font = FONT(10);
    g.textBaseline = "middle";
    for (let degrees = -60; degrees <= 60; degrees += 2.5) {
      if (degrees === 0) continue;
      const y = -degrees * PITCH_PX_PER_DEG;
      const half = degrees % 10 === 0 ? 34 : degrees % 5 === 0 ? 20 : 8;
      line(g, -half, y, half, y);
      if (degrees % 10) continue;
      g.textAlign = "right";
      g.fillText(Math.abs(degrees), -half - 4, y);
      g.textAlign = "left";
      g.fillText(Math.abs(degrees), half + 4, y);
    }
  }

  bankScale(g, cx, cy, radius, phi, wanted) {
    g.save();
    g.translate(cx, cy);
    g.strokeStyle = g.fillStyle = "rgba(255,255,255,.92)";
    g.lineWidth = 1.4;
    g.beginPath();
    g.arc(0, 0, radius, -150 * RAD, -30 * RAD);
    g.stroke();
    for (const mark of [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60]) {
      g.save();
      g.rotate(mark * RAD);
      line(g, 0, -radius, 0, -radius - (mark % 30 ? 5 : 9));
      g.restore();
    }
    const pointer = (angle, fill) => {
      g.save();
      g.rotate(-angle * RAD);
      g.beginPath();
      g.moveTo(0, -radius + 2);
      g.lineTo(-6, -radius + 12);
      g.lineTo(6, -radius + 12);
      g.closePath();
      if (fill) g.fill();
      else g.stroke();
      g.restore();
    };
    if (Number.isFinite(wanted)) pointer(wanted, false);
    pointer(phi, true);
    g.restore();
  }

  // The fixed aircraft, and the commanded pitch as an open mark.
  symbol(g, cx, cy, setpoint, theta) {
    for (const [colour, width] of [["rgba(0,0,0,.55)", 5.5], ["#ffd24a", 3]]) {
      g.strokeStyle = colour;
      g.lineWidth = width;
      line(g, cx - 52, cy, cx - 24, cy);
      line(g, cx - 24, cy, cx - 24, cy + 8);
      line(g, cx + 52, cy, cx + 24, cy);
      line(g, cx + 24, cy, cx + 24, cy + 8);
      line(g, cx - 2, cy, cx + 2, cy);
    }
    if (!setpoint) return;
    const y = cy + (theta - setpoint[1]) * PITCH_PX_PER_DEG;
    g.strokeStyle = "#fff";
    g.lineWidth = 1.6;
    g.beginPath();
    g.arc(cx, y, 6, 0, 7);
    g.stroke();
  }

  window(g, x, y, w, text) {
    g.fillStyle = this.colours.ink;
    g.beginPath();
    g.roundRect(x, y - 11, w, 22, 3);
    g.fill();
    g.fillStyle = this.colours.paper;
    g.font = FONT(13, 600);
    g.textAlign = "center";
    g.textBaseline = "middle";
    g.fillText(text, x + w / 2, y + 0.5);
  }

  tape(g, box, value, { step, px, unit, label, bug, left }) {
    g.save();
    g.beginPath();
    g.roundRect(box.x, box.y, box.w, box.h, 4);
    g.clip();
    g.fillStyle = this.colours.wash;
    g.fillRect(box.x, box.y, box.w, box.h);
    const cy = box.y + box.h / 2;
    const edge = left ? box.x + box.w : box.x;
    const inward = left ? -1 : 1;
    g.strokeStyle = this.colours.muted;
    g.fillStyle = this.colours.soft;
    g.font = FONT(10.5);
    g.textAlign = left ? "right" : "left";
    g.textBaseline = "middle";
    const reach = Math.ceil(box.h / 2 / px) + 1;
    const middle = Math.round(value / step);
    for (let k = middle - reach; k <= middle + reach; k += 1) {
      const y = cy - (k * step - value) * (px / step);
      if (left && k < 0) continue;
      line(g, edge, y, edge + 6 * inward, y);
      line(g, edge, y + px / 2, edge + 3 * inward, y + px / 2);
      g.fillText(step < 1 ? (k * step).toFixed(1) : k * step, edge + 10 * inward, y);
    }
    if (Number.isFinite(bug)) {
      const y = Math.min(box.y + box.h - 4, Math.max(box.y + 4, cy - (bug - value) * (px / step)));
      g.strokeStyle = this.colours.bound;
      g.lineWidth = 3;
      line(g, edge, y, edge + 26 * inward, y);
      g.lineWidth = 1;
    }
    this.window(g, box.x + 1, cy, box.w - 2, value.toFixed(2));
    g.fillStyle = this.colours.wash;
    g.fillRect(box.x, box.y, box.w, 16);
    g.fillStyle = this.colours.soft;
    g.font = FONT(9);
    g.textAlign = "center";
    g.fillText(label ? `${label} ${unit}` : unit, box.x + box.w / 2, box.y + 8);
    g.restore();
  }

  rise(g, box, value, wanted) {
    const [cy, full] = [box.y + box.h / 2, 3];
    const at = (v) => cy - (Math.max(-full, Math.min(full, v)) / full) * (box.h / 2 - 18);
    g.fillStyle = this.colours.wash;
    g.beginPath();
    g.roundRect(box.x, box.y, box.w, box.h, 4);
    g.fill();
    g.strokeStyle = this.colours.muted;
    g.fillStyle = this.colours.soft;
    g.font = FONT(9.5);
    g.textBaseline = "middle";
    for (let v = -3; v <= 3; v += 1) {
      line(g, box.x, at(v), box.x + 5, at(v));
      g.textAlign = "left";
      g.fillText(Math.abs(v), box.x + 8, at(v));
    }
    if (Number.isFinite(wanted)) {
      g.strokeStyle = this.colours.bound;
      g.lineWidth = 3;
      line(g, box.x, at(wanted), box.x + 15, at(wanted));
    }
    g.fillStyle = this.colours.accent;
    g.fillRect(box.x + 18, Math.min(cy, at(value)), 8, Math.max(1.5, Math.abs(at(value) - cy)));
    g.fillStyle = this.colours.soft;
    g.textAlign = "center";
    g.fillText("↑ m/s", box.x + box.w / 2, box.y + 8);
    g.fillStyle = this.colours.ink;
    g.font = FONT(10.5, 600);
    g.fillText(signed(value, 2), box.x + box.w / 2, box.y + box.h - 8);
    g.lineWidth = 1;
  }

  headingTape(g, box, psi, wanted) {
    g.save();
    g.beginPath();
    g.roundRect(box.x, box.y, box.w, box.h, 4);
    g.clip();
    g.fillStyle = this.colours.wash;
    g.fillRect(box.x, box.y, box.w, box.h);
    const cx = box.x + box.w / 2;
    const px = 2.6;
    g.strokeStyle = this.colours.muted;
    g.fillStyle = this.colours.soft;
    g.font = FONT(10.5);
    g.textAlign = "center";
    g.textBaseline = "middle";
    const first = Math.ceil((psi - box.w / 2 / px) / 5) * 5;
    for (let mark = first; mark <= psi + box.w / 2 / px; mark += 5) {
      const x = cx + (mark - psi) * px;
      const round = ((mark % 360) + 360) % 360;
      line(g, x, box.y, x, box.y + (round % 15 ? 3 : 6));
      if (round % 15 === 0) g.fillText(POINTS[round] ?? round, x, box.y + 14);
    }
    if (Number.isFinite(wanted)) {
      const x = cx + wrapped(wanted - psi) * px;
      g.strokeStyle = this.colours.bound;
      g.lineWidth = 3;
      line(g, x, box.y, x, box.y + 10);
      g.lineWidth = 1;
    }
    this.window(g, cx - 22, box.y + 20, 44, `${fixed(((Math.round(psi) % 360) + 360) % 360, 0).padStart(3, "0")}°`);
    g.restore();
  }
}
