// SPDX-License-Identifier: Apache-2.0
// A small helicopter of primitives, in FLU axes (x forward, y left, z up), unit: the rotor's radius.

import * as THREE from "./vendor/three.module.min.js";

export const TILT_FACTOR = 5;
const SPIN_TURNS_PER_S = 1.3;

function part(parent, geometry, material, position = [0, 0, 0], rotation = [0, 0, 0], scale = [1, 1, 1]) {
  const mesh = new THREE.Mesh(geometry, material);
  mesh.position.set(...position);
  mesh.rotation.set(...rotation);
  mesh.scale.set(...scale);
  parent.add(mesh);
  return mesh;
}

// A tube from one point to another.
function tube(parent, material, from, to, radius, radiusTo = radius) {
  const a = new THREE.Vector3(...from);
  const b = new THREE.Vector3(...to);
  const mesh = part(parent, new THREE.CylinderGeometry(radiusTo, radius, a.distanceTo(b), 8), material);
  mesh.position.copy(a).lerp(b, 0.5);
  mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), b.sub(a).normalize());
  return mesh;
}

// A flat plate of an outline in the x-z plane.
function plate(parent, material, outline, thickness) {
  const shape = new THREE.Shape(outline.map(([x, z]) => new THREE.Vector2(x, z)));
  const geometry = new THREE.ExtrudeGeometry(shape, { depth: thickness, bevelEnabled: false });
  geometry.translate(0, 0, -thickness / 2).rotateX(Math.PI / 2);
  return part(parent, geometry, material);
}

function fuselage(parent, m) {
  const ball = new THREE.SphereGeometry(1, 20, 13);
  part(parent, ball, m.body, [0.12, 0, -0.3], [0, 0, 0], [0.5, 0.185, 0.235]);
  part(parent, ball, m.body, [-0.12, 0, -0.2], [0, 0.1, 0], [0.4, 0.15, 0.17]);
  part(parent, ball, m.glass, [0.32, 0, -0.265], [0, 0.18, 0], [0.31, 0.165, 0.19]);
  part(parent, ball, m.accent, [0.1, 0, -0.39], [0, 0, 0], [0.44, 0.172, 0.12]);
  tube(parent, m.body, [-0.3, 0, -0.19], [-1.2, 0, -0.13], 0.075, 0.034);
  tube(parent, m.dark, [0, 0, -0.1], [0, 0, 0.02], 0.03, 0.022);
  plate(parent, m.accent, [[-1.07, -0.14], [-1.22, 0.16], [-1.33, 0.16], [-1.24, -0.14], [-1.3, -0.32], [-1.22, -0.32]], 0.018);
  part(parent, new THREE.BoxGeometry(0.13, 0.46, 0.014), m.accent, [-0.93, 0, -0.14]);
  for (const side of [-1, 1]) {
    const y = 0.24 * side;
    tube(parent, m.dark, [0.46, y, -0.62], [-0.36, y, -0.62], 0.017);
    tube(parent, m.dark, [0.46, y, -0.62], [0.56, y, -0.57], 0.017);
    tube(parent, m.dark, [0.26, 0.08 * side, -0.46], [0.28, y, -0.62], 0.015);
    tube(parent, m.dark, [-0.18, 0.07 * side, -0.36], [-0.2, y, -0.62], 0.015);
  }
}

// Triangles of several geometries, numbered through.
function indexOf(pieces) {
  let first = 0;
  return pieces.flatMap((piece) => {
    const { count } = piece.attributes.position;
    const index = piece.index ? [...piece.index.array] : [...Array(count).keys()];
    const moved = index.map((i) => i + first);
    first += count;
    return moved;
  });
}

// One mesh for each material below `parent`: a dozen things to draw instead of forty.
function merged(parent) {
  parent.updateMatrixWorld(true);
  const inverse = parent.matrixWorld.clone().invert();
  const byMaterial = new Map();
  parent.traverse((node) => {
    if (!node.isMesh) return;
    const geometry = node.geometry.clone();
    geometry.applyMatrix4(inverse.clone().multiply(node.matrixWorld));
    byMaterial.set(node.material, [...(byMaterial.get(node.material) ?? []), geometry]);
  });
  const group = new THREE.Group();
  for (const [material, pieces] of byMaterial) {
    const geometry = new THREE.BufferGeometry();
    for (const name of ["position", "normal"]) {
      const values = pieces.flatMap((piece) => [...piece.attributes[name].array]);
      geometry.setAttribute(name, new THREE.Float32BufferAttribute(values, 3));
    }
    geometry.setIndex(indexOf(pieces));
    group.add(new THREE.Mesh(geometry, material));
  }
  return group;
}

function makeDisc(m) {
  const disc = new THREE.Group();
  part(disc, new THREE.CircleGeometry(1, 56), m.disc);
  part(disc, new THREE.RingGeometry(0.985, 1.005, 56), m.rim);
  return merged(disc);
}

function makeBlades(m) {
  const blades = new THREE.Group();
  for (const side of [-1, 1]) {
    part(blades, new THREE.BoxGeometry(0.88, 0.075, 0.012), m.dark, [0.56 * side, 0, 0.005]);
    part(blades, new THREE.BoxGeometry(0.1, 0.078, 0.013), m.tip, [0.95 * side, 0, 0.005]);
    part(blades, new THREE.BoxGeometry(0.06, 0.13, 0.012), m.dark, [0, 0.32 * side, 0.05]);
  }
  part(blades, new THREE.CylinderGeometry(0.045, 0.045, 0.06, 12), m.dark, [0, 0, 0], [Math.PI / 2, 0, 0]);
  tube(blades, m.dark, [0, -0.3, 0.05], [0, 0.3, 0.05], 0.011);
  return merged(blades);
}

function makeTail(m) {
  const tail = new THREE.Group();
  part(tail, new THREE.CircleGeometry(0.18, 28), m.disc, [0, 0, 0], [Math.PI / 2, 0, 0]);
  part(tail, new THREE.BoxGeometry(0.36, 0.008, 0.03), m.dark);
  const group = merged(tail);
  group.position.set(-1.22, 0.06, -0.1);
  return group;
}

export class Helicopter {
  constructor(radius, shadowMaterials) {
    this.group = new THREE.Group();
    this.group.name = "helicopter";
    const lit = (options) => new THREE.MeshPhongMaterial({ shininess: 60, specular: 0x333333, ...options });
    const m = {
      body: lit({}), accent: lit({}), dark: lit({ color: 0x30373c }),
      tip: lit({ color: 0xe69f00 }), glass: lit({ color: 0x1d3a4d, shininess: 140, specular: 0xaaccdd }),
      disc: new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.2, side: THREE.DoubleSide, depthWrite: false }),
      rim: new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.75, side: THREE.DoubleSide }),
    };
    this.materials = m;
    const frame = new THREE.Group();
    frame.scale.setScalar(radius);
    this.group.add(frame);
    const hull = new THREE.Group();
    fuselage(hull, m);
    this.disc = makeDisc(m);
    this.disc.position.z = 0.03;
    this.blades = makeBlades(m);
    this.disc.add(this.blades);
    this.tail = makeTail(m);
    frame.add(merged(hull), this.disc, this.tail);
    this.still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.shadow = this.makeShadow(shadowMaterials);
  }

  // The same shapes, flattened on the ground by `dropShadow`: dark, straight below.
  makeShadow(materials) {
    const shadow = this.group.clone();
    shadow.name = "shadow";
    shadow.traverse((node) => {
      if (!node.isMesh) return;
      const isDisc = node.material === this.materials.disc || node.material === this.materials.rim;
      node.material = isDisc ? materials.disc : materials.body;
    });
    shadow.matrixAutoUpdate = false;
    [, this.shadowDisc] = shadow.children[0].children;
    this.shadowBlades = this.shadowDisc.children.at(-1);
    return shadow;
  }

  colour(colours) {
    this.materials.body.color.set(colours["scene-body"]);
    this.materials.accent.color.set(colours.accent);
    this.materials.disc.color.set(colours.accent);
    this.materials.rim.color.set(colours.accent);
  }

  // Pose (ENU, FLU -> ENU), the disc's flapping in deg, seconds since the last frame.
  update(body, rotor, dt, size) {
    this.group.position.set(...body.p);
    this.group.quaternion.set(...body.q);
    this.group.scale.setScalar(size);
    // Positive a_s lifts the front of the disc, positive b_s lowers its right side.
    const rad = (TILT_FACTOR * Math.PI) / 180;
    this.disc.rotation.set(rad * (rotor?.b_s_deg ?? 0), -rad * (rotor?.a_s_deg ?? 0), 0);
    if (!this.still) {
      this.blades.rotation.z -= 2 * Math.PI * SPIN_TURNS_PER_S * dt;
      this.tail.rotation.y += 2 * Math.PI * 2.1 * dt;
    }
    this.group.updateMatrixWorld(true);
    this.dropShadow();
  }

  dropShadow() {
    const flatten = new THREE.Matrix4().makeScale(1, 1, 0.0004);
    flatten.setPosition(0, 0, 0.012);
    this.shadow.matrix.copy(flatten).multiply(this.group.matrix);
    this.shadowDisc.rotation.copy(this.disc.rotation);
    this.shadowBlades.rotation.copy(this.blades.rotation);
    this.shadow.matrixWorldNeedsUpdate = true;
  }
}
