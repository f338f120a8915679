// SPDX-License-Identifier: Apache-2.0
// The 3-D view: puts aircraft, shadow and surroundings together and keeps to the machine's strength.

import * as THREE from "./vendor/three.module.min.js";
import { View } from "./camera.js";
import { fixed, put, signed } from "./format.js";
import { Ground, Streaks } from "./ground.js";
import { Helicopter, TILT_FACTOR } from "./helicopter.js";
import { Label, Reference, Stroke, Trail, WindArrow } from "./markers.js";

// The aircraft is drawn larger than it is, so that it can be seen from where its shadow is also seen.
const DRAWN_SIZE = 2.5;
const [SLOW_MS, EASY_MS] = [42, 36];
const PIXEL_RATIOS = [1, 0.8, 0.6];
const [PATIENCE_FRAMES, LONGEST_PATIENCE] = [240, 7200];

// Software drawing: start modestly, nobody notices; a fan that howls, everybody does.
function isSoftware(renderer) {
  const gl = renderer.getContext();
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

export class Scene3d {
  constructor(canvas, parts, theme, wish) {
    this.canvas = canvas;
    this.parts = parts;
    this.view = new View(canvas, parts.buttons);
    this.renderer = this.makeRenderer(wish);
    if (!this.renderer) return;
    this.scene = new THREE.Scene();
    this.sun = new THREE.DirectionalLight(0xffffff, 2.1);
    this.sun.position.set(-3, -5, 8);
    this.sky = new THREE.HemisphereLight(0xffffff, 0x777777, 1.5);
    this.sky.position.set(0, 0, 1);
    this.scene.add(this.sun, this.sky);
    this.ground = new Ground(this.scene);
    // The disc lets light through, the fuselage does not.
    const halfLight = { transparent: true, opacity: 0.4, depthWrite: false };
    this.shadowMaterials = {
      body: new THREE.MeshBasicMaterial(),
      disc: new THREE.MeshBasicMaterial(halfLight),
    };
    this.reference = new Reference(this.scene, parts.labels);
    this.trail = new Trail(this.scene);
    this.drop = new Stroke(this.scene, true);
    this.wind = new WindArrow(this.scene, parts.labels);
    this.streaks = new Streaks(this.scene);
    this.altitude = new Label(parts.labels, "altitude-label");
    this.other = new THREE.Mesh(new THREE.SphereGeometry(0.1, 14, 10), new THREE.MeshBasicMaterial());
    this.scene.add(this.other);
    this.setRadius(0.7);
    theme.follow((colours) => this.colour(colours));
    new ResizeObserver(() => this.fit()).observe(canvas);
    this.fit();
  }

  makeRenderer(wish) {
    const gentle = { canvas: this.canvas, powerPreference: "low-power", antialias: wish === "high" };
    try {
      let renderer = new THREE.WebGLRenderer(gentle);
      this.software = isSoftware(renderer);
      this.best = wish === "high" ? Math.min(devicePixelRatio, 2) : Math.min(devicePixelRatio, this.software ? 1 : 2);
      this.level = this.lowest = wish === "low" ? PIXEL_RATIOS.length - 1 : 0;
      this.adapts = wish !== "high";
      return renderer;
    } catch {
      this.parts.fallback.hidden = false;
      this.canvas.hidden = true;
      return null;
    }
  }

  setRadius(radius) {
    if (!this.renderer || radius === this.radius) return;
    this.radius = radius;
    if (this.helicopter) this.scene.remove(this.helicopter.group, this.helicopter.shadow);
    this.helicopter = new Helicopter(radius, this.shadowMaterials);
    this.scene.add(this.helicopter.group, this.helicopter.shadow);
    if (this.colours) this.helicopter.colour(this.colours);
  }

  colour(colours) {
    this.colours = colours;
    this.ground.colour(colours);
    this.helicopter.colour(colours);
    for (const material of Object.values(this.shadowMaterials)) material.color.set(colours["scene-shadow"]);
    this.streaks.material.color.set(colours.green);
    this.drop.material.color.set(colours.soft);
    this.scene.background = new THREE.Color(colours["scene-haze"]);
  }

  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(this.best * PIXEL_RATIOS[this.level]);
    this.renderer.setSize(width, height, false);
    this.view.camera.aspect = width / height;
    this.view.camera.updateProjectionMatrix();
  }

  // Fewer pixels when frames come late for a while, more after a long good while; who had to turn
  // back waits longer before the next attempt.
  adapt(frameMs) {
    if (!this.renderer || !this.adapts) return;
    this.lateness = 0.96 * (this.lateness ?? frameMs) + 0.04 * Math.min(frameMs, 150);
    this.since = (this.since ?? 0) + 1;
    this.patience ??= PATIENCE_FRAMES;
    const late = this.lateness > SLOW_MS && this.since > 60 && this.level < PIXEL_RATIOS.length - 1;
    const easy = this.lateness < EASY_MS && this.since > this.patience && this.level > this.lowest;
    if (!late && !easy) return;
    if (late && this.rose) this.patience = Math.min(LONGEST_PATIENCE, 3 * this.patience);
    this.rose = easy;
    this.level += late ? 1 : -1;
    this.since = 0;
    this.fit();
  }

  get size() {
    return this.view.mode === "close" ? 1 : DRAWN_SIZE;
  }

  draw(state, flight, source, dt) {
    if (!this.renderer || !state) return;
    const body = state[source];
    if (body) this.pose(state, body, flight, source, dt);
    this.renderer.render(this.scene, this.view.camera);
    const { clientWidth: width, clientHeight: height } = this.canvas;
    for (const label of this.parts.labels.labels) label.project(this.view.camera, width, height);
    this.drawn = Boolean(body);
  }

  pose(state, body, flight, source, dt) {
    const { colours, size } = this;
    const rotor = source === "truth" ? (state.rotor_truth ?? state.rotor) : (state.rotor ?? state.rotor_truth);
    this.helicopter.update(body, rotor, dt, size);
    const [e, n, u] = body.p;
    const poleRight = this.poleOnTheRight(state, body);
    this.drop.set([e, n, u - 0.6 * size * this.radius], [e, n, 0.02]);
    this.altitude.set(`${u.toFixed(1)} m`, e, n, 0.44 * u, poleRight);
    this.reference.update(state.ref, flight.info?.bounds, colours, !poleRight);
    this.trail.update(flight.rows, source, state.t, body.p, colours[source], size);
    this.wind.update(body.p, state.wind_enu, colours, size * this.radius);
    this.streaks.update(this.helicopter.group.position, state.wind_enu, dt);
    const other = source === "truth" ? "nav" : "truth";
    this.other.visible = Boolean(state[other]);
    if (this.other.visible) {
      this.other.position.set(...state[other].p);
      this.other.material.color.set(colours[other]);
    }
    const lead = state.ref ? Math.min(8, Math.max(0, state.ref.p[2] - u)) : 0;
    this.view.update(body.p, lead, (body.euler_deg[2] * Math.PI) / 180, dt, size * this.radius * 1.4);
    this.ground.follow(this.helicopter.group.position, this.view.camera.position);
  }

  // The altitude stands on the side of its line where the pole's numbers are not.
  poleOnTheRight(state, body) {
    if (!state.ref) return true;
    const x = (p) => new THREE.Vector3(p[0], p[1], 0).project(this.view.camera).x;
    return x(state.ref.p) > x(body.p) - 0.02;
  }

  // Words beside the picture, a few times a second.
  tell(state, source) {
    const body = state?.[source];
    const { altitude, distance, rotor, note } = this.parts;
    put(altitude, fixed(body?.p[2], 2, "m"));
    const to = body && state.ref ? Math.hypot(...body.p.map((x, i) => x - state.ref.p[i])) : null;
    put(distance, fixed(to, 2, "m"));
    const tilt = state?.rotor_truth ?? state?.rotor;
    put(rotor, tilt ? `${signed(tilt.a_s_deg, 2)}°, ${signed(tilt.b_s_deg, 2)}°` : "–");
    const times = this.size === 1 ? "true size" : `aircraft drawn ×${DRAWN_SIZE}`;
    const ball = state?.[source === "truth" ? "nav" : "truth"] ? ` · ball: ${source === "truth" ? "navigation" : "truth"}` : "";
    put(note, `grid 1 m, bold 10 m · ${times} · disc tilt ×${TILT_FACTOR}${ball}`);
  }

  // Where aircraft and shadow are on the canvas, CSS pixels; for tests and for the curious.
  projected() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const on = (object) => {
      const p = new THREE.Vector3().setFromMatrixPosition(object.matrixWorld).project(this.view.camera);
      return { x: (0.5 + 0.5 * p.x) * width, y: (0.5 - 0.5 * p.y) * height, inFront: p.z < 1 };
    };
    return { width, height, helicopter: on(this.helicopter.group), shadow: on(this.helicopter.shadow) };
  }

  // Draws once more and reads the picture: how many colours, and how light it is around a point.
  pixels(x, y, half = 12) {
    this.renderer.render(this.scene, this.view.camera);
    const gl = this.renderer.getContext();
    const [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
    const all = new Uint8Array(4 * w * h);
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, all);
    const ratio = w / this.canvas.clientWidth;
    const found = new Set();
    let [sum, count] = [0, 0];
    for (let i = 0; i < w * h; i += 1) {
      const [r, g, b] = [all[4 * i], all[4 * i + 1], all[4 * i + 2]];
      found.add((r << 16) | (g << 8) | b);
      const [px, py] = [i % w, h - 1 - Math.floor(i / w)];
      if (Math.abs(px - x * ratio) < half * ratio && Math.abs(py - y * ratio) < half * ratio) {
        sum += (r + g + b) / 3;
        count += 1;
      }
    }
    return { colours: found.size, lightness: sum / count };
  }
}
