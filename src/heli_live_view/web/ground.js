// SPDX-License-Identifier: Apache-2.0
// The ground with its 1 m grid (bold every 10 m), sky, landing mark, wind streaks.

import * as THREE from "./vendor/three.module.min.js";

const VERTEX = `
varying vec3 place;
void main() {
  vec4 world = modelMatrix * vec4(position, 1.0);
  place = world.xyz;
  gl_Position = projectionMatrix * viewMatrix * world;
}`;
// Lines are as wide as a pixel wherever they are, and fade before they are closer than a few pixels.
const FRAGMENT = `
uniform vec3 ground, grid, haze;
uniform vec2 centre;
varying vec3 place;
float lines(vec2 p, float width) {
  vec2 size = fwidth(p);
  vec2 near = abs(fract(p - 0.5) - 0.5) / size;
  float fade = 1.0 - smoothstep(0.12, 0.5, max(size.x, size.y));
  return fade * (1.0 - min(min(near.x, near.y) / width, 1.0));
}
void main() {
  float far = length(place.xy - centre);
  float line = max(0.42 * lines(place.xy, 0.9), 0.85 * lines(0.1 * place.xy, 1.15));
  vec3 colour = mix(ground, grid, line);
  float mist = smoothstep(25.0, 190.0, far);
  gl_FragColor = vec4(mix(colour, haze, mist), 1.0);
}`;
const SKY_VERTEX = `
attribute vec3 tint;
varying vec3 shade;
void main() {
  shade = tint;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;
const SKY_FRAGMENT = `
varying vec3 shade;
void main() { gl_FragColor = vec4(shade, 1.0); }`;

// Ground and sky fill the picture: their colours are the screen's already, not converted pixel by pixel.
const onScreen = (colour) => new THREE.Color(colour).convertLinearToSRGB();


function ring(inner, outer, material) {
  const mesh = new THREE.Mesh(new THREE.RingGeometry(inner, outer, 48), material);
  mesh.position.z = 0.006;
  return mesh;
}

export class Ground {
  constructor(scene) {
    this.uniforms = {
      ground: { value: new THREE.Color() }, grid: { value: new THREE.Color() },
      haze: { value: new THREE.Color() }, centre: { value: new THREE.Vector2() },
    };
    const material = new THREE.ShaderMaterial({
      uniforms: this.uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT,
    });
    this.plane = new THREE.Mesh(new THREE.PlaneGeometry(900, 900), material);
    // After the aircraft, before the sky: what is hidden is not worth a pixel of software drawing.
    this.plane.renderOrder = 5;
    scene.add(this.plane);
    this.mark = new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.75 });
    scene.add(ring(1.92, 2.02, this.mark));
    for (const [x, y, w, h] of [[-0.55, 0, 0.16, 1.7], [0.55, 0, 0.16, 1.7], [0, 0, 1, 0.16]]) {
      const bar = new THREE.Mesh(new THREE.PlaneGeometry(w, h), this.mark);
      bar.position.set(x, y, 0.006);
      scene.add(bar);
    }
    this.sky = this.makeSky();
    scene.add(this.sky);
  }

  makeSky() {
    const geometry = new THREE.SphereGeometry(430, 24, 16).rotateX(Math.PI / 2);
    geometry.setAttribute("tint", new THREE.BufferAttribute(new Float32Array(geometry.attributes.position.count * 3), 3));
    const material = new THREE.ShaderMaterial({
      vertexShader: SKY_VERTEX, fragmentShader: SKY_FRAGMENT, side: THREE.BackSide, depthWrite: false,
    });
    const sky = new THREE.Mesh(geometry, material);
    sky.renderOrder = 10;
    return sky;
  }

  colour(colours) {
    const haze = onScreen(colours["scene-haze"]);
    const zenith = onScreen(colours["scene-sky"]);
    this.uniforms.ground.value.copy(onScreen(colours["scene-ground"]));
    this.uniforms.grid.value.copy(onScreen(colours["scene-grid"]));
    this.uniforms.haze.value.copy(haze);
    this.mark.color.set(colours["scene-grid"]);
    const { position, tint } = this.sky.geometry.attributes;
    const mixed = new THREE.Color();
    for (let i = 0; i < position.count; i += 1) {
      mixed.lerpColors(haze, zenith, Math.min(1, Math.max(0, position.getZ(i) / 190)));
      tint.setXYZ(i, mixed.r, mixed.g, mixed.b);
    }
    tint.needsUpdate = true;
  }

  follow(position, camera) {
    this.plane.position.set(Math.round(position.x), Math.round(position.y), 0);
    this.uniforms.centre.value.set(camera.x, camera.y);
    this.sky.position.copy(camera);
  }
}

// Short strokes that drift with the wind around the aircraft.
export class Streaks {
  constructor(scene, count = 70) {
    this.count = count;
    this.places = Array.from({ length: count }, (_, i) => {
      // Evenly spread without chance: three irrational steps.
      const spread = (k) => (((i + 1) * k) % 1) - 0.5;
      return new THREE.Vector3(16 * spread(0.7548776), 16 * spread(0.5698403), 9 * spread(0.4142136));
    });
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(count * 6), 3));
    this.material = new THREE.LineBasicMaterial({ transparent: true, opacity: 0.5 });
    this.lines = new THREE.LineSegments(geometry, this.material);
    this.lines.frustumCulled = false;
    this.lines.visible = false;
    this.still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    scene.add(this.lines);
  }

  update(centre, wind, dt) {
    this.lines.visible = Boolean(wind) && !this.still;
    if (!this.lines.visible) return;
    const step = new THREE.Vector3(...wind);
    const { position } = this.lines.geometry.attributes;
    const wrap = (x, half) => x - 2 * half * Math.floor((x + half) / (2 * half));
    for (let i = 0; i < this.count; i += 1) {
      const p = this.places[i].addScaledVector(step, dt);
      p.set(wrap(p.x, 8), wrap(p.y, 8), wrap(p.z, 4.5));
      const [x, y, z] = [centre.x + p.x, centre.y + p.y, Math.max(0.05, centre.z + p.z)];
      position.setXYZ(2 * i, x, y, z);
      position.setXYZ(2 * i + 1, x - 0.12 * step.x, y - 0.12 * step.y, z - 0.12 * step.z);
    }
    position.needsUpdate = true;
  }
}
