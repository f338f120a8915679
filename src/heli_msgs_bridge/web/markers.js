// SPDX-License-Identifier: Apache-2.0
// What stands around the aircraft: trail, altitude line, reference with its pole and the paper's bounds, wind.

import * as THREE from "./vendor/three.module.min.js";
import { referenceHeading } from "./flight.js";

const TRAIL_POINTS = 480;
const TRAIL_S = 30;
const WIDE = 384;

// Text that keeps its size on the screen; `draw` again when text or colour change.
export class Label {
  constructor(scene, height = 0.036, align = "left") {
    this.align = align;
    this.canvas = document.createElement("canvas");
    this.canvas.width = WIDE;
    this.canvas.height = 64;
    this.texture = new THREE.CanvasTexture(this.canvas);
    this.texture.colorSpace = THREE.SRGBColorSpace;
    this.texture.generateMipmaps = false;
    this.texture.minFilter = THREE.LinearFilter;
    const material = new THREE.SpriteMaterial({
      map: this.texture, sizeAttenuation: false, depthTest: false, transparent: true,
    });
    this.sprite = new THREE.Sprite(material);
    this.sprite.center.set(align === "left" ? 0 : 1, 0.5);
    this.sprite.scale.set((WIDE / 64) * height, height, 1);
    this.sprite.renderOrder = 5;
    scene.add(this.sprite);
  }

  draw(text, colour, halo) {
    const key = `${text}|${colour}|${halo}`;
    if (key === this.key) return;
    this.key = key;
    const g = this.canvas.getContext("2d");
    g.clearRect(0, 0, WIDE, 64);
    g.textAlign = this.align;
    const x = this.align === "left" ? 14 : WIDE - 14;
    g.font = "600 40px system-ui, sans-serif";
    g.textBaseline = "middle";
    g.lineWidth = 9;
    g.lineJoin = "round";
    g.strokeStyle = halo;
    g.fillStyle = colour;
    g.strokeText(text, x, 33);
    g.fillText(text, x, 33);
    this.texture.needsUpdate = true;
  }
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
  constructor(scene) {
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
      const label = new Label(this.group, 0.03);
      label.metres = metres;
      return label;
    });
  }

  update(ref, bounds, colours) {
    this.group.visible = Boolean(ref);
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
      label.sprite.visible = label.metres < u - 1.5;
      label.sprite.position.set(e, n, label.metres);
      label.draw(`${label.metres} m`, colours.soft, colours.paper);
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
  constructor(scene) {
    this.group = new THREE.Group();
    this.material = new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.9 });
    this.shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.05, 0.05, 1, 10), this.material);
    this.head = new THREE.Mesh(new THREE.ConeGeometry(0.17, 0.45, 14), this.material);
    this.group.add(this.shaft, this.head);
    scene.add(this.group);
    this.label = new Label(scene, 0.034);
  }

  update(position, wind, colours, size) {
    const speed = wind ? Math.hypot(...wind) : 0;
    this.group.visible = this.label.sprite.visible = speed > 0.05;
    if (!this.group.visible) return;
    const along = new THREE.Vector3(...wind).normalize();
    const length = 0.5 * speed;
    const tip = new THREE.Vector3(...position).addScaledVector(along, -1.15 * size);
    this.group.position.copy(tip);
    this.group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along);
    this.head.position.y = -0.225;
    this.shaft.scale.y = Math.max(0.05, length - 0.4);
    this.shaft.position.y = -0.4 - 0.5 * this.shaft.scale.y;
    this.label.sprite.position.copy(tip).addScaledVector(along, -length);
    this.material.color.set(colours.green);
    this.label.draw(`wind ${speed.toFixed(1)} m/s`, colours.green, colours.paper);
  }
}
