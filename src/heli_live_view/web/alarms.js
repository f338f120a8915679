// SPDX-License-Identifier: Apache-2.0
// Nodes, alarms and the timeline of events. What nodes say is text, never markup.

import { fixed } from "./format.js";

const MARKS = ["●", "▲", "✖", "✖"];
const WORDS = ["ok", "warning", "error", "gone"];
const LINES = 120;

function span(text, attributes = {}) {
  const made = document.createElement("span");
  made.textContent = text;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

function mark(level, quiet = false) {
  const shape = quiet ? "○" : (MARKS[level] ?? MARKS[2]);
  const made = span(shape, { class: "mark", role: "img", "aria-label": WORDS[level] ?? "error" });
  made.dataset.level = quiet ? "" : String(level);
  return made;
}

export class Alarms {
  // jump(time) is for events of a record.
  constructor({ nodes, alarms, events }, jump) {
    Object.assign(this, { nodes, alarms, events, jump, told: "", shown: "", listed: -1 });
  }

  update(state, flight) {
    this.updateNodes(state?.nodes ?? {});
    this.updateAlarms(state?.alarms ?? []);
    this.updateEvents(flight);
  }

  updateNodes(nodes) {
    const key = JSON.stringify(nodes);
    if (key === this.shown || key === "{}") return;
    this.shown = key;
    const items = Object.entries(nodes).map(([name, { state, level, message }]) => {
      const item = document.createElement("li");
      item.title = message || state;
      item.append(mark(level, level === 0 && state !== "active"), span(name), span(state));
      if (level > 0 && message) {
        item.className = "told";
        item.append(span(message));
      }
      return item;
    });
    this.nodes.replaceChildren(...items);
  }

  // Rewritten only when it changes, so that a screen reader says each alarm once.
  updateAlarms(alarms) {
    const key = JSON.stringify(alarms);
    if (key === this.told) return;
    this.told = key;
    const items = alarms.map(({ level, source, text }) => {
      const item = document.createElement("li");
      item.dataset.level = String(level);
      item.append(mark(level), ` ${source}: ${text}`);
      return item;
    });
    if (!items.length) {
      const none = document.createElement("li");
      none.className = "soft";
      none.textContent = "none";
      items.push(none);
    }
    this.alarms.replaceChildren(...items);
  }

  updateEvents(flight) {
    const { events } = flight;
    const key = `${flight.generation}:${events.length}:${events.at(-1)?.t}:${events.at(-1)?.text}`;
    if (key === this.listed) return;
    this.listed = key;
    const recorded = Boolean(flight.info?.replay);
    this.events.setAttribute("aria-label", recorded ? "Events of the flight" : "Events, newest first");
    const lines = recorded ? events : events.slice(-LINES).reverse();
    const items = lines.map(({ t, level, source, text }) => {
      const item = document.createElement("li");
      const time = document.createElement(recorded ? "button" : "time");
      time.textContent = fixed(t, 1, t === null ? "" : "s");
      if (recorded) {
        time.type = "button";
        time.setAttribute("aria-label", `Go to ${fixed(t, 2)} s: ${source} ${text}`);
        time.addEventListener("click", () => this.jump(t));
      }
      const words = span("");
      const who = document.createElement("b");
      who.textContent = source;
      words.append(who, ` ${text}`);
      item.append(time, mark(level), words);
      return item;
    });
    if (items.length) this.events.replaceChildren(...items);
  }
}
