// SPDX-License-Identifier: Apache-2.0
// The horizontal track over a 1 m grid, north up, with the reference, the paper's bounds and 3 sigma.

import { Canvas2d, FONT, line } from "./canvas2d.js";
import { put } from "./format.js";
import { referenceHeading } from "./flight.js";

const SHOWN_S = 30;
const REACHES_M = [1.5, 2, 3, 5, 8, 12, 20, 35, 60, 100];

export class Track {
  // onPick takes (east, north) of a click while picking.
  constructor(canvas, scaleText, theme, onPick) {
    this.surface = new Canvas2d(canvas);
    this.canvas = canvas;
    this.scaleText = scaleText;
    this.reach = REACHES_M[1];
    this.centre = [0, 0];
    this.picking = false;
    theme.follow((colours) => {
      this.colours = colours;
    });
    canvas.addEventListener("click", (event) => {
      if (!this.picking) return;
      const box = canvas.getBoundingClientRect();
      onPick(...this.place(event.clientX - box.left, event.clientY - box.top));
    });
  }

  setPicking(on) {
    this.picking = on;
    this.canvas.dataset.pick = String(on);
  }

  get scale() {
    return (0.5 * Math.min(this.surface.width, this.surface.height)) / this.reach;
  }

  at(e, n) {
    const { width, height } = this.surface;
    return [width / 2 + (e - this.centre[0]) * this.scale, height / 2 - (n - this.centre[1]) * this.scale];
  }

  place(x, y) {
    const { width, height } = this.surface;
    return [this.centre[0] + (x - width / 2) / this.scale, this.centre[1] - (y - height / 2) / this.scale];
  }

  // Smallest reach that shows aircraft and bounds around the reference; a little reluctant to shrink.
  choose(state, rows, shown, bounds) {
    this.centre = state.ref ? state.ref.p.slice(0, 2) : (state[shown]?.p.slice(0, 2) ?? this.centre);
    const far = (p) => Math.max(Math.abs(p[0] - this.centre[0]), Math.abs(p[1] - this.centre[1]));
    let need = 1.25 * Math.max(bounds.lateral_m ?? 1, bounds.longitudinal_m ?? 1);
    for (const row of rows) if (row[shown]) need = Math.max(need, 1.12 * far(row[shown].p));
    for (const source of ["truth", "nav"]) if (state[source]) need = Math.max(need, 1.12 * far(state[source].p));
    const wanted = REACHES_M.find((reach) => reach >= need) ?? Math.ceil(need);
    if (wanted > this.reach || need < 0.8 * wanted) this.reach = wanted;
  }

  draw(state, flight, shown) {
    const g = this.surface.begin();
    if (!state) return;
    const bounds = flight.info?.bounds ?? {};
    const rows = flight.rows.filter((row) => row.t > state.t - SHOWN_S && row.t <= state.t);
    this.choose(state, rows, shown, bounds);
    this.grid(g);
    if (state.ref) this.bounds(g, state.ref, bounds);
    const other = shown === "truth" ? "nav" : "truth";
    this.path(g, rows, other, 0.35);
    this.path(g, rows, shown, 1);
    if (state.nav && state.sigma_p) this.ellipse(g, state.nav.p, state.sigma_p);
    if (state[other]) this.dot(g, state[other].p, this.colours[other]);
    if (state[shown]) this.aircraft(g, state[shown], this.colours[shown]);
  }

  grid(g) {
    const { width, height } = this.surface;
    const step = this.reach > 12 ? 10 : this.reach > 5 ? 2 : 1;
    put(this.scaleText, `${step} m grid, last ${SHOWN_S} s, ellipse 3σ`);
    const [west, north] = this.place(0, 0);
    const [east, south] = this.place(width, height);
    g.strokeStyle = this.colours.line;
    g.lineWidth = 1;
    g.fillStyle = this.colours.soft;
    g.font = FONT(10);
    g.textBaseline = "alphabetic";
    g.textAlign = "center";
    for (let e = Math.ceil(west / step) * step; e <= east; e += step) {
      const [x] = this.at(e, 0);
      line(g, x, 0, x, height - 14);
      if (x > 10 && x < width - 6) g.fillText(`${e}`.replace("-", "−"), x, height - 3);
    }
    g.textAlign = "left";
    for (let n = Math.ceil(south / step) * step; n <= north; n += step) {
      const [, y] = this.at(0, n);
      if (y > height - 16) continue;
      line(g, 18, y, width, y);
      g.fillText(`${n}`.replace("-", "−"), 1, y + 3.5);
    }
    g.textAlign = "right";
    g.fillText("N ↑", width - 4, 12);
  }

  bounds(g, ref, bounds) {
    const [x, y] = this.at(ref.p[0], ref.p[1]);
    g.save();
    g.translate(x, y);
    g.rotate(referenceHeading(ref));
    g.strokeStyle = this.colours.bound;
    g.lineWidth = 1.6;
    if (bounds.lateral_m && bounds.longitudinal_m) {
      const [w, h] = [bounds.lateral_m * this.scale, bounds.longitudinal_m * this.scale];
      g.setLineDash([6, 4]);
      g.strokeRect(-w, -h, 2 * w, 2 * h);
      g.setLineDash([]);
    }
    g.strokeStyle = this.colours.reference;
    line(g, -9, 0, 9, 0);
    line(g, 0, -9, 0, 9);
    g.restore();
  }

  path(g, rows, source, strength) {
    const points = rows.filter((row) => row[source]);
    g.strokeStyle = this.colours[source];
    g.lineWidth = strength < 1 ? 1.2 : 2;
    // Eight pieces, the older the paler.
    const pieces = 8;
    for (let k = 0; k < pieces; k += 1) {
      const from = Math.floor((k * points.length) / pieces);
      const to = Math.min(points.length, Math.floor(((k + 1) * points.length) / pieces) + 1);
      if (to - from < 2) continue;
      g.globalAlpha = strength * (0.2 + (0.8 * (k + 1)) / pieces);
      g.beginPath();
      for (let i = from; i < to; i += 1) g.lineTo(...this.at(...points[i][source].p));
      g.stroke();
    }
    g.globalAlpha = 1;
  }

  ellipse(g, p, sigma) {
    g.strokeStyle = g.fillStyle = this.colours.nav;
    g.beginPath();
    g.ellipse(...this.at(p[0], p[1]), 3 * sigma[0] * this.scale, 3 * sigma[1] * this.scale, 0, 0, 7);
    g.globalAlpha = 0.07;
    g.fill();
    g.globalAlpha = 0.5;
    g.lineWidth = 1;
    g.stroke();
    g.globalAlpha = 1;
  }

  dot(g, p, colour) {
    g.fillStyle = colour;
    g.beginPath();
    g.arc(...this.at(p[0], p[1]), 3.5, 0, 7);
    g.fill();
  }

  aircraft(g, body, colour) {
    const [x, y] = this.at(body.p[0], body.p[1]);
    g.save();
    g.translate(x, y);
    g.rotate((body.euler_deg[2] * Math.PI) / 180);
    g.strokeStyle = this.colours.paper;
    g.fillStyle = colour;
    g.lineWidth = 1.5;
    g.beginPath();
    g.moveTo(0, -12);
    g.lineTo(7, 8);
    g.lineTo(0, 4);
    g.lineTo(-7, 8);
    g.closePath();
    g.fill();
    g.stroke();
    g.restore();
  }
}
