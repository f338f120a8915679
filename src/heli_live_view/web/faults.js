// SPDX-License-Identifier: Apache-2.0
// The form of a fault (what, kind, numbers, duration) and the list of those that act, as the plant tells them.

import { put } from "./format.js";

const NAMES = {
  gps: "GPS", gps_velocity: "GPS velocity", imu: "IMU", accel: "accelerometer", gyro: "gyro", mag: "magnetometer", baro: "barometer", rotor_speed: "rotor speed",
  delta_lat: "lateral cyclic", delta_lon: "longitudinal cyclic", delta_ped: "pedal", delta_col: "collective", wind: "wind", engine: "engine",
};

export const nameOf = (what) => NAMES[what] ?? what;
const named = (line) => line.replace(/^\S+/, nameOf).replaceAll("_", " ");

function fill(select, values, name = (value) => value) {
  const before = select.value;
  select.replaceChildren(...values.map((value) => new Option(name(value), value)));
  if (values.includes(before)) select.value = before;
}

export class FaultForm {
  constructor(form, list, clear) {
    Object.assign(this, { form, list, clear, forms: {}, shown: null });
    this.unit = form.querySelector("#fault-unit");
    form.elements.what.addEventListener("change", () => this.choose());
    form.elements.kind.addEventListener("change", () => this.suggest());
    form.elements.value.addEventListener("input", () => this.judge());
  }

  // Takes the table of the greeting: per what and kind an example, its unit, whether it may be left out.
  offer(forms) {
    this.forms = forms ?? {};
    fill(this.form.elements.what, Object.keys(this.forms), nameOf);
    this.choose();
  }

  get kind() {
    return this.forms[this.form.elements.what.value]?.[this.form.elements.kind.value];
  }

  choose() {
    const kinds = Object.keys(this.forms[this.form.elements.what.value] ?? {});
    fill(this.form.elements.kind, kinds, (kind) => kind.replaceAll("_", " "));
    this.suggest();
  }

  // The numbers of the kind as an example; where none are needed there is nothing to write.
  suggest() {
    const { value, duration_s: length } = this.form.elements;
    const kind = this.kind;
    const needs = Boolean(kind?.example.length);
    value.value = needs && !kind.optional ? kind.example.join(", ") : "";
    value.placeholder = needs ? kind.example.join(", ") : "none";
    value.disabled = !needs;
    length.required = this.form.elements.kind.value === "gust";
    put(this.unit, needs ? kind.unit : "value");
    this.judge();
  }

  numbers() {
    const words = this.form.elements.value.value.split(/[\s,;]+/).filter(Boolean);
    return words.map(Number);
  }

  judge() {
    const field = this.form.elements.value;
    const [numbers, wanted] = [this.numbers(), this.kind?.example.length ?? 0];
    const left = this.kind?.optional && !numbers.length;
    const right = left || (numbers.length === wanted && numbers.every(Number.isFinite));
    field.setCustomValidity(right ? "" : `${wanted} ${wanted === 1 ? "number" : "numbers, between commas"}`);
  }

  args() {
    const { what, kind, duration_s: length } = this.form.elements;
    const args = { what: what.value, kind: kind.value };
    const numbers = this.numbers();
    if (numbers.length) args.value = numbers;
    if (length.value) args.duration_s = Number(length.value);
    return args;
  }

  // What acts or is to come; nothing to clear where there is nothing.
  update(faults) {
    const lines = faults ?? [];
    const key = lines.join("\n");
    this.clear.disabled = !lines.length;
    if (key === this.shown) return;
    this.shown = key;
    const items = (lines.length ? lines.map(named) : ["none"]).map((line) => {
      const item = document.createElement("li");
      item.textContent = line;
      return item;
    });
    if (!lines.length) items[0].className = "soft";
    this.list.replaceChildren(...items);
  }
}
