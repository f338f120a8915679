// SPDX-License-Identifier: Apache-2.0
// Light or dark: the system's choice, or the button's. Canvases ask here for the colours of style.css.

const ROLES = [
  "page", "paper", "ink", "soft", "line", "wash", "accent", "nav", "truth", "reference", "bound",
  "green", "purple", "muted", "grid", "good", "warn", "bad", "sky-hi", "sky-lo", "earth-hi",
  "earth-lo", "scene-sky", "scene-haze", "scene-ground", "scene-grid", "scene-shadow", "scene-body",
];

function resolved() {
  // A custom property is not resolved when it is read; the colour of an element is.
  const probe = document.createElement("span");
  document.body.append(probe);
  const found = {};
  for (const role of ROLES) {
    probe.style.color = `var(--${role})`;
    found[role] = getComputedStyle(probe).color;
  }
  probe.remove();
  return found;
}

export class Theme {
  constructor(button) {
    this.listeners = [];
    this.system = matchMedia("(prefers-color-scheme: dark)");
    this.system.addEventListener("change", () => this.refresh());
    button.addEventListener("click", () => {
      document.documentElement.dataset.theme = this.dark ? "light" : "dark";
      this.refresh();
    });
    this.button = button;
    this.refresh();
  }

  get dark() {
    const chosen = document.documentElement.dataset.theme;
    return chosen ? chosen === "dark" : this.system.matches;
  }

  refresh() {
    this.colours = resolved();
    this.button.textContent = this.dark ? "Light" : "Dark";
    this.button.setAttribute("aria-label", `Switch to ${this.dark ? "light" : "dark"} colours`);
    for (const listener of this.listeners) listener(this.colours);
  }

  // Calls back at once and at every change.
  follow(listener) {
    this.listeners.push(listener);
    listener(this.colours);
  }
}
