// SPDX-License-Identifier: Apache-2.0
// Where the view is taken from: chase, orbit, top, close; turned by mouse, finger and keys.

import * as THREE from "./vendor/three.module.min.js";

const FIELD_DEG = 58;
const VIEWS = ["chase", "orbit", "top", "close"];

export class View {
  constructor(canvas, buttons) {
    this.camera = new THREE.PerspectiveCamera(FIELD_DEG, 1, 0.1, 1000);
    this.camera.up.set(0, 0, 1);
    this.canvas = canvas;
    this.buttons = buttons;
    this.pointers = new Map();
    this.azimuth = 0;
    this.elevation = 0.35;
    this.zoom = 1;
    this.choose("chase");
    for (const button of buttons) button.addEventListener("click", () => this.choose(button.dataset.camera));
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    }
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("dblclick", () => this.choose(this.mode));
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  choose(mode) {
    this.mode = mode;
    this.zoom = 1;
    this.snap = true;
    if (mode === "orbit") Object.assign(this, { azimuth: -2.1, elevation: 0.42 });
    if (mode === "close") Object.assign(this, { azimuth: null, elevation: 0.28 });
    for (const button of this.buttons) {
      button.setAttribute("aria-pressed", String(button.dataset.camera === mode));
    }
  }

  // A turn by hand: from chase it goes over into orbit, where it stands.
  turn(dAzimuth, dElevation) {
    if (this.mode === "top") return;
    if (this.mode === "chase") {
      const [azimuth, elevation] = [this.usedAzimuth, this.usedElevation];
      this.choose("orbit");
      Object.assign(this, { azimuth, elevation });
    }
    this.azimuth = (this.azimuth ?? this.usedAzimuth) + dAzimuth;
    this.elevation = Math.min(1.5, Math.max(-0.1, this.elevation + dElevation));
  }

  magnify(factor) {
    this.zoom = Math.min(6, Math.max(0.15, this.zoom * factor));
  }

  press(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      const span = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
      this.magnify(span(before) / span(now));
    } else this.turn(-0.008 * (now[0] - before[0]), 0.008 * (now[1] - before[1]));
    this.pointers.set(event.pointerId, now);
  }

  wheel(event) {
    // A page that scrolls keeps its wheel until the view has been chosen by a click or Tab.
    if (document.activeElement !== this.canvas && document.documentElement.scrollHeight > innerHeight + 1) return;
    event.preventDefault();
    this.magnify(Math.exp(0.0012 * event.deltaY));
  }

  key(event) {
    const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.08], ArrowDown: [0, -0.08] }[event.key];
    const view = VIEWS[Number(event.key) - 1];
    if (turn) this.turn(...turn);
    else if (view) this.choose(view);
    else if (event.key === "+" || event.key === "=") this.magnify(0.85);
    else if (event.key === "-") this.magnify(1.18);
    else if (event.key === "f" || event.key === "F") this.choose(this.mode);
    else return;
    event.preventDefault();
  }

  // Angles under which the aircraft and its shadow both fit: the higher, the farther away.
  fitted(height, aspect) {
    // On a phone the buttons take more of the picture.
    const share = this.canvas.clientHeight < 400 ? 0.62 : 0.72;
    const field = (FIELD_DEG * Math.PI) / 180;
    const apart = share * field;
    const up = 0.14;
    const tangent = Math.tan(Math.atan(up) + apart);
    const distance = Math.max(4.6, height / (tangent - up), height * 0.5);
    return distance * Math.max(1, 0.9 / aspect);
  }

  // `lead`: how far the reference is above the aircraft, m; it is to be in the picture, too.
  update(position, lead, heading, dt, size) {
    const focus = new THREE.Vector3(...position);
    const height = Math.max(0, focus.z + lead);
    const ease = this.snap ? 1 : 1 - Math.exp(-2.5 * dt);
    this.snap = false;
    this.heading = this.heading === undefined ? heading : this.heading + ease * Math.atan2(Math.sin(heading - this.heading), Math.cos(heading - this.heading));
    this.height = this.height === undefined ? height : this.height + ease * (height - this.height);
    const { camera } = this;
    if (this.mode === "top") {
      camera.up.set(0, 1, 0);
      camera.position.set(focus.x, focus.y, focus.z + 7.5 * this.zoom);
      camera.lookAt(focus);
      return;
    }
    camera.up.set(0, 0, 1);
    if (this.mode === "close") {
      const azimuth = this.azimuth ?? Math.PI / 2 - this.heading + Math.PI + 0.8;
      this.place(focus, azimuth, this.elevation, 2.3 * size * this.zoom);
      camera.lookAt(focus.x, focus.y, focus.z - 0.1 * size);
      return;
    }
    const far = this.fitted(this.height, camera.aspect) * this.zoom;
    const chase = this.mode === "chase";
    // ENU angle of the tail, and a little to its side: fin, disc and fuselage are all seen.
    const azimuth = chase ? Math.PI / 2 - this.heading + Math.PI + 0.62 : this.azimuth;
    const elevation = chase ? Math.atan(0.14) : this.elevation;
    const top = new THREE.Vector3(focus.x, focus.y, this.height);
    this.place(top, azimuth, elevation, far);
    // Half way between the aircraft, or its reference above it, and its shadow.
    const down = (z) => Math.atan2(camera.position.z - z, Math.hypot(camera.position.x - focus.x, camera.position.y - focus.y));
    const pitch = 0.5 * (down(top.z) + down(0));
    camera.lookAt(
      camera.position.x - Math.cos(pitch) * Math.cos(azimuth),
      camera.position.y - Math.cos(pitch) * Math.sin(azimuth),
      camera.position.z - Math.sin(pitch),
    );
  }

  place(focus, azimuth, elevation, far) {
    this.usedAzimuth = azimuth;
    this.usedElevation = elevation;
    const flat = far * Math.cos(elevation);
    this.camera.position.set(
      focus.x + flat * Math.cos(azimuth), focus.y + flat * Math.sin(azimuth),
      Math.max(0.4, focus.z + far * Math.sin(elevation)),
    );
  }
}
