// SPDX-License-Identifier: Apache-2.0
// A 2-D canvas that is as sharp as the screen, in CSS pixels.

const MOST_PIXELS_PER_PIXEL = 2;

export class Canvas2d {
  constructor(canvas) {
    this.canvas = canvas;
    this.g = canvas.getContext("2d");
    new ResizeObserver(() => this.fit()).observe(canvas);
    this.fit();
  }

  fit() {
    const scale = Math.min(devicePixelRatio || 1, MOST_PIXELS_PER_PIXEL);
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    this.canvas.width = Math.max(1, Math.round(this.width * scale));
    this.canvas.height = Math.max(1, Math.round(this.height * scale));
    this.scale = scale;
    this.stale = true;
  }

  // Clears and returns the context.
  begin() {
    this.g.setTransform(this.scale, 0, 0, this.scale, 0, 0);
    this.g.clearRect(0, 0, this.width, this.height);
    this.stale = false;
    return this.g;
  }
}

export const FONT = (px, weight = 400) => `${weight} ${px}px system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif`;

export function line(g, x0, y0, x1, y1) {
  g.beginPath();
  g.moveTo(x0, y0);
  g.lineTo(x1, y1);
  g.stroke();
}
