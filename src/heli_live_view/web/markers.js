// SPDX-License-Identifier: Apache-2.0
// What stands around the aircraft: trail, altitude line, reference with its pole and the paper's bounds, wind.

import * as THREE from "./vendor/three.module.min.js";
import { referenceHeading } from "./flight.js";
import { put } from "./format.js";

const TRAIL_POINTS = 480;
const TRAIL_S = 30;

// Words at a point in space, as an element over the canvas: sharp at any resolution of the picture.
export class Label {
  constructor(layer, className = "") {
    this.element = document.createElement("span");
    this.element.className = `label ${className}`;
    layer.append(this.element);
    this.point = new THREE.Vector3();
    this.visible = false;
    layer.labels = [...(layer.labels ?? []), this];
  }

  set(text, x, y, z, left = false) {
    put(this.element, text);
    this.point.set(x, y, z);
    this.left = left;
    this.visible = true;
  }

  project(camera, width, height) {
    const p = this.projected.copy(this.point).project(camera);
    const shown = this.visible && p.z < 1 && Math.abs(p.x) < 1.02 && Math.abs(p.y) < 1.02;
    this.element.hidden = !shown;
    if (!shown) return;
    const [x, y] = [(0.5 + 0.5 * p.x) * width, (0.5 - 0.5 * p.y) * height];
    const left = this.left || x > width - 92;
    this.element.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(${left ? "calc(-100% - 9px)" : "9px"}, -50%)`;
  }

  projected = new THREE.Vector3();
}

// A ribbon of constant height along the last 30 s, fading towards the past, and its line on the ground.
export class Trail {
  constructor(scene) {
    this.ribbon = this.mesh(TRAIL_POINTS * 2, new THREE.MeshBasicMaterial({
      vertexColors: true, transparent: true, side: THREE.DoubleSide, depthWrite: false,
    }), THREE.Mesh);
    const index = [];
    for (let i = 0; i < TRAIL_POINTS - 1; i += 1) {
      const k = 2 * i;
      index.push(k, k + 1, k + 2, k + 2, k + 1, k + 3);
    }
    this.ribbon.geometry.setIndex(index);
    this.line = this.mesh(TRAIL_POINTS, new THREE.LineBasicMaterial({
      vertexColors: true, transparent: true, depthWrite: false,
    }), THREE.Line);
    scene.add(this.ribbon, this.line);
    this.colour = new THREE.Color();
  }

  mesh(points, material, Kind) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points * 3), 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(points * 4), 4));
    const made = new Kind(geometry, material);
    made.frustumCulled = false;
    return made;
  }

  update(rows, source, now_s, head, colour, size) {
    this.colour.set(colour);
    const { r, g, b } = this.colour;
    const kept = rows.filter((row) => row[source] && row.t > now_s - TRAIL_S && row.t <= now_s);
    const points = kept.map((row) => ({ p: row[source].p, age: (now_s - row.t) / TRAIL_S }));
    if (head) points.push({ p: head, age: 0 });
    const used = points.slice(-TRAIL_POINTS);
    const [rp, rc] = [this.ribbon.geometry.attributes.position, this.ribbon.geometry.attributes.color];
    const [lp, lc] = [this.line.geometry.attributes.position, this.line.geometry.attributes.color];
    used.forEach(({ p, age }, i) => {
      const [x, y, z] = p;
      const alpha = 0.85 * (1 - age);
      rp.setXYZ(2 * i, x, y, z - 0.045 * size);
      rp.setXYZ(2 * i + 1, x, y, z + 0.045 * size);
      rc.setXYZW(2 * i, r, g, b, alpha);
      rc.setXYZW(2 * i + 1, r, g, b, alpha);
      lp.setXYZ(i, x, y, 0.02);
      lc.setXYZW(i, r, g, b, 0.6 * alpha);
    });
    this.ribbon.geometry.setDrawRange(0, Math.max(0, 6 * (used.length - 1)));
    this.line.geometry.setDrawRange(0, used.length);
    for (const attribute of [rp, rc, lp, lc]) attribute.needsUpdate = true;
  }
}

// Thin straight line between two points.
export class Stroke {
  constructor(scene, dashed = false) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(6), 3));
    this.material = dashed
      ? new THREE.LineDashedMaterial({ dashSize: 0.25, gapSize: 0.2 })
      : new THREE.LineBasicMaterial();
    this.line = new THREE.Line(geometry, this.material);
    this.line.frustumCulled = false;
    this.dashed = dashed;
    scene.add(this.line);
  }

  set(a, b) {
    const { position } = this.line.geometry.attributes;
    position.setXYZ(0, ...a);
    position.setXYZ(1, ...b);
    position.needsUpdate = true;
    if (this.dashed) this.line.computeLineDistances();
  }
}

// Reference: a pole with a tick each metre, a number each five, and the paper's bounds as a box of edges.
export class Reference {
  constructor(scene, layer) {
    this.group = new THREE.Group();
    scene.add(this.group);
    this.poleMaterial = new THREE.LineBasicMaterial({ transparent: true, opacity: 0.85 });
    this.boxMaterial = new THREE.LineBasicMaterial();
    this.pole = new THREE.LineSegments(new THREE.BufferGeometry(), this.poleMaterial);
    this.pole.frustumCulled = false;
    this.box = new THREE.LineSegments(new THREE.EdgesGeometry(new THREE.BoxGeometry(1, 1, 1)), this.boxMaterial);
    this.cross = new THREE.Mesh(new THREE.OctahedronGeometry(0.11), new THREE.MeshBasicMaterial());
    this.group.add(this.pole, this.box, this.cross);
    this.labels = [5, 10, 15, 20, 25, 30].map((metres) => {
      const label = new Label(layer);
      label.metres = metres;
      return label;
    });
  }

  update(ref, bounds, colours, numbersLeft) {
    this.group.visible = Boolean(ref);
    for (const label of this.labels) label.visible = false;
    if (!ref) return;
    const [e, n, u] = ref.p;
    const top = Math.max(1, Math.round(u));
    if (top !== this.top) this.rebuildPole(top);
    this.pole.position.set(e, n, 0);
    this.cross.position.set(e, n, u);
    this.box.position.set(e, n, u);
    this.box.rotation.z = -referenceHeading(ref);
    this.box.visible = Boolean(bounds?.altitude_m && bounds.lateral_m && bounds.longitudinal_m);
    if (this.box.visible) this.box.scale.set(2 * bounds.lateral_m, 2 * bounds.longitudinal_m, 2 * bounds.altitude_m);
    this.poleMaterial.color.set(colours.soft);
    this.boxMaterial.color.set(colours.bound);
    this.cross.material.color.set(colours.reference);
    for (const label of this.labels) {
      if (label.metres < u - 1.5) label.set(`${label.metres} m`, e, n, label.metres, numbersLeft);
    }
  }

  rebuildPole(top) {
    this.top = top;
    const points = [0, 0, 0, 0, 0, top];
    for (let z = 1; z <= top; z += 1) {
      const half = z % 5 ? 0.1 : 0.28;
      points.push(-half, 0, z, half, 0, z, 0, -half, z, 0, half, z);
    }
    this.pole.geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
  }
}

// The wind blows along the arrow, towards the aircraft; half a metre of arrow per m/s.
export class WindArrow {
  constructor(scene, layer) {
    this.group = new THREE.Group();
    this.material = new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.9 });
    this.shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.05, 0.05, 1, 10), this.material);
    this.head = new THREE.Mesh(new THREE.ConeGeometry(0.17, 0.45, 14), this.material);
    this.group.add(this.shaft, this.head);
    scene.add(this.group);
    this.label = new Label(layer, "wind-label");
  }

  update(position, wind, colours, size) {
    const speed = wind ? Math.hypot(...wind) : 0;
    this.group.visible = this.label.visible = speed > 0.05;
    if (!this.group.visible) return;
    const along = new THREE.Vector3(...wind).normalize();
    const length = 0.5 * speed;
    const tip = new THREE.Vector3(...position).addScaledVector(along, -1.15 * size);
    this.group.position.copy(tip);
    this.group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along);
    this.head.position.y = -0.225;
    this.shaft.scale.y = Math.max(0.05, length - 0.4);
    this.shaft.position.y = -0.4 - 0.5 * this.shaft.scale.y;
    this.material.color.set(colours.green);
    const tail = tip.clone().addScaledVector(along, -length);
    this.label.set(`wind ${speed.toFixed(1)} m/s`, tail.x, tail.y, tail.z);
  }
}
