// SPDX-License-Identifier: Apache-2.0
// Strip charts of the last 30 s with the paper's bounds (uPlot).

import uPlot from "./vendor/uPlot.esm.js";
import { FONT } from "./canvas2d.js";
import { named } from "./format.js";

const SHOWN_S = 30;
const DASH = [5, 4];
const error = (source, key) => (row) => row[source]?.error?.[key] ?? null;
const angle = (index) => (row, shown) => row[shown]?.euler[index] ?? null;

// A line: label, colour role, value of a row; optional dash. A chart: title, unit, lines, bound key.
const CHARTS = [
  { title: "altitude error", unit: "m", bound: "altitude_m", least: 0.5, lines: [
    ["truth", "truth", error("truth", "altitude_m")], ["nav", "nav", error("nav", "altitude_m")]] },
  { title: "v_z error", unit: "m/s", bound: "v_z_mps", least: 0.25, lines: [
    ["truth", "truth", error("truth", "v_z_mps")], ["nav", "nav", error("nav", "v_z_mps")]] },
  { title: "speed", unit: "m/s", bound: "v_x_mps", least: 0.4, lines: [
    ["v_x", "nav", (row, shown) => row[shown]?.error?.v_x_mps ?? null],
    ["v_y", "green", (row, shown) => row[shown]?.error?.v_y_mps ?? null]] },
  { title: "roll φ", unit: "deg", around: "attitude_deg", least: 2, lines: [
    ["φ", "nav", angle(0)], ["setpoint", "reference", (row) => row.set?.[0] ?? null, DASH]] },
  { title: "pitch θ", unit: "deg", around: "attitude_deg", least: 2, lines: [
    ["θ", "nav", angle(1)], ["setpoint", "reference", (row) => row.set?.[1] ?? null, DASH]] },
  { title: "actuators", unit: "", limit: 1, least: 0.1, lines: [
    ["lat", "nav", (row) => row.u?.[0] ?? null], ["lon", "truth", (row) => row.u?.[1] ?? null],
    ["ped", "green", (row) => row.u?.[2] ?? null], ["col", "purple", (row) => row.u?.[3] ?? null]] },
];

// Room beyond the outermost bound, so that its line is not on the edge.
const BEYOND = 1.08;

// Lowest and highest of the drawn lines and of the bounds (pairs), at least so far apart, with some air.
function span(data, least, bounds = []) {
  let [low, high] = [Infinity, -Infinity];
  for (const series of [...data.slice(1), ...bounds]) {
    for (const y of series) {
      if (y === null) continue;
      if (y < low) low = y;
      if (y > high) high = y;
    }
  }
  if (low > high) [low, high] = [-least, least];
  const lack = Math.max(0, 2 * least - (high - low)) / 2;
  const air = 0.06 * (high - low + 2 * lack);
  return [low - lack - air, high + lack + air];
}

class Chart {
  constructor(parent, spec) {
    this.spec = spec;
    const box = document.createElement("figure");
    box.className = "chart";
    this.head = document.createElement("p");
    const title = document.createElement("span");
    const name = document.createElement("b");
    name.append(named(spec.title));
    title.append(name, spec.unit ? ` ${spec.unit}` : "");
    this.head.append(title);
    for (const [label, role, , dash] of spec.lines) this.legend(label, role, dash);
    this.holder = document.createElement("div");
    this.holder.className = "plot";
    this.holder.setAttribute("role", "img");
    this.holder.setAttribute("aria-label", `${spec.title}, last ${SHOWN_S} seconds`);
    box.append(this.head, this.holder);
    parent.append(box);
    this.data = [[], ...spec.lines.map(() => [])];
    new ResizeObserver(() => this.resize()).observe(this.holder);
  }

  legend(label, role, dash) {
    const item = document.createElement("span");
    const key = document.createElement("i");
    key.style.borderColor = `var(--${role})`;
    if (dash) key.className = "dash";
    item.append(key, named(label));
    this.head.append(item);
  }

  build(colours) {
    this.colours = colours;
    this.plot?.destroy();
    const axis = { stroke: colours.soft, grid: { stroke: colours.grid, width: 1 }, ticks: { show: false }, font: FONT(10), gap: 3 };
    const options = {
      width: Math.max(60, this.holder.clientWidth), height: Math.max(50, this.holder.clientHeight),
      padding: [8, 6, 0, 0], legend: { show: false }, cursor: { show: false }, select: { show: false },
      scales: { x: { time: false, auto: false }, y: { range: () => this.range } },
      axes: [
        { ...axis, size: 16, space: 56, values: (_, splits) => splits.map((s) => `${s}`) },
        { ...axis, size: 36, space: 26, values: (_, splits) => splits.map((y) => String(+y.toFixed(3)).replace("-", "−")) },
      ],
      series: [{}, ...this.spec.lines.map(([label, role, , dash]) => ({
        label, stroke: colours[role], width: dash ? 1.2 : 1.5, dash, points: { show: false }, spanGaps: false,
      }))],
      hooks: { drawAxes: [(plot) => this.marks(plot)] },
    };
    this.range = [-this.spec.least, this.spec.least];
    this.plot = new uPlot(options, this.data, this.holder);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.holder;
    if (this.plot && width && height) this.plot.setSize({ width, height });
  }

  // Bounds and warnings, below the lines.
  marks(plot) {
    const { ctx: g, bbox } = plot;
    g.save();
    g.beginPath();
    g.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    g.clip();
    g.lineWidth = devicePixelRatio;
    g.strokeStyle = this.colours.muted;
    const zero = plot.valToPos(0, "y", true);
    g.beginPath();
    g.moveTo(bbox.left, zero);
    g.lineTo(bbox.left + bbox.width, zero);
    g.stroke();
    g.setLineDash([2 * devicePixelRatio, 3 * devicePixelRatio]);
    g.strokeStyle = this.colours.bad;
    for (const time of this.warnings ?? []) {
      const x = plot.valToPos(time, "x", true);
      g.beginPath();
      g.moveTo(x, bbox.top);
      g.lineTo(x, bbox.top + bbox.height);
      g.stroke();
    }
    g.setLineDash(DASH.map((x) => x * devicePixelRatio));
    g.lineWidth = 1.4 * devicePixelRatio;
    g.strokeStyle = this.colours.bound;
    const half = this.bound;
    if (half) {
      for (const side of [-half, half]) this.level(g, plot, (i) => side + (this.spec.around ? this.data[2][i] : 0));
    }
    g.restore();
  }

  level(g, plot, height) {
    const times = this.data[0];
    const points = this.spec.around ? times.map((_, i) => i).filter((i) => this.data[2][i] !== null) : [0];
    g.beginPath();
    for (const i of points) {
      const y = plot.valToPos(height(i), "y", true);
      if (this.spec.around) g.lineTo(plot.valToPos(times[i], "x", true), y);
      else {
        g.moveTo(plot.bbox.left, y);
        g.lineTo(plot.bbox.left + plot.bbox.width, y);
      }
    }
    g.stroke();
  }

  // Both bounds, as far as they are drawn: about zero, or about what was asked for.
  bounds() {
    const half = BEYOND * (this.bound ?? 0);
    if (!half || this.spec.limit) return [];
    if (!this.spec.around) return [[-half, half]];
    return this.data[2].filter((y) => y !== null).map((y) => [y - half, y + half]);
  }

  update(rows, shown, end, bounds, warnings) {
    const { spec } = this;
    this.data = [rows.map((row) => row.t), ...spec.lines.map(([, , value]) => rows.map((row) => value(row, shown)))];
    this.bound = spec.limit ?? bounds[spec.bound ?? spec.around];
    this.warnings = warnings;
    this.range = span(this.data, spec.least, this.bounds());
    const start = Math.max(0, end - SHOWN_S);
    this.plot.batch(() => {
      this.plot.setData(this.data, false);
      this.plot.setScale("x", { min: start, max: start + SHOWN_S });
      this.plot.setScale("y", { min: this.range[0], max: this.range[1] });
    });
  }
}

export class Charts {
  constructor(parent, theme) {
    this.charts = CHARTS.map((spec) => new Chart(parent, spec));
    this.turn = 0;
    theme.follow((colours) => {
      for (const chart of this.charts) chart.build(colours);
    });
  }

  // One chart a call: the work is spread evenly over the frames.
  update(flight, shown) {
    const end = flight.last?.t;
    if (!Number.isFinite(end)) return;
    const rows = flight.rows.filter((row) => row.t >= end - SHOWN_S);
    const warnings = flight.events.filter((e) => e.level > 0 && e.t >= end - SHOWN_S && e.t <= end).map((e) => e.t);
    this.charts[this.turn].update(rows, shown, end, flight.info?.bounds ?? {}, warnings);
    this.turn = (this.turn + 1) % this.charts.length;
  }
}
