// SPDX-License-Identifier: Apache-2.0
// A record on the same page: slider, events on it, play and pause, speed, keys. Where it is, the server knows.

import { fixed, put } from "./format.js";

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16];
const [STEP_S, LEAP_S, TICK_S] = [1, 10, 0.01];
// Just behind an event "the one before" still means the one before that.
const AT_EVENT_S = 0.4;
const NEAR_S = 0.005;
const ANSWER_MS = 1000;

const minusLike = ["-", "−", "_"];
const plusLike = ["+", "="];

// Whether a key belongs to what has the focus: words are written, a camera turned, a list scrolled.
function isTaken(event) {
  const { target, key } = event;
  if (event.defaultPrevented || document.querySelector("dialog[open]")) return true;
  if ((event.ctrlKey || event.metaKey || event.altKey) && !event.getModifierState("AltGraph")) return true;
  if (!(target instanceof Element)) return false;
  if (target.matches("input[type=range]")) return false;
  if (target.matches("input[type=radio]")) return key.startsWith("Arrow") || key === " ";
  if (target.matches("input, select, textarea")) return true;
  if (target.matches("button, a, summary")) return key === " " || key === "Enter";
  return target.closest(".log") !== null && (key === "Home" || key === "End");
}

export class Replay {
  constructor(byId, flight, send) {
    Object.assign(this, { flight, send, shown: false, info: null, pending: 0, next: null, held: false, told: -2 });
    // What was asked and is not answered: a connection that breaks meanwhile takes it with it.
    Object.assign(this, { wishes: {}, asked: 0 });
    this.root = byId("replay");
    for (const name of ["play", "before", "next", "speed", "time", "event", "notes", "report", "marks", "at", "keys"]) {
      this[`${name}Part`] = byId(`replay-${name}`);
    }
    this.list = byId("events");
    this.speedPart.append(...SPEEDS.map((speed) => new Option(`${speed}×`, String(speed), speed === 1, speed === 1)));
    this.playPart.addEventListener("click", () => this.toggle());
    this.beforePart.addEventListener("click", () => this.toEvent(-1));
    this.nextPart.addEventListener("click", () => this.toEvent(1));
    this.speedPart.addEventListener("change", () => this.ask({ speed: Number(this.speedPart.value) }));
    this.atPart.addEventListener("pointerdown", () => {
      this.held = true;
    });
    for (const name of ["pointerup", "pointercancel", "blur"]) {
      this.atPart.addEventListener(name, () => {
        this.held = false;
      });
    }
    this.atPart.addEventListener("input", () => this.seek(Number(this.atPart.value)));
    // The list has the room that nodes and alarms leave it: what was last stays in view.
    new ResizeObserver(() => this.shown && this.scrollTo(this.list.children[Math.max(0, this.told)])).observe(this.list);
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("hashchange", () => this.byAddress());
  }

  // --- what the server says ----------------------------------------------------------------------

  hello(message) {
    const { replay = null } = message;
    this.shown = Boolean(replay);
    this.root.hidden = this.keysPart.hidden = !this.shown;
    this.tellReport(this.reportPart, this.shown, replay);
    if (!replay) return;
    const before = this.info && this.at;
    this.info = replay;
    if (this.next !== null) this.wishes.at = this.next;
    [this.pending, this.next] = [0, null];
    [this.atPart.min, this.atPart.max] = [replay.from_s, replay.to_s];
    this.drawMarks(message.events);
    this.tellNotes(replay.notes);
    const speed = Number(this.speedPart.value);
    if (Number.isFinite(before)) this.ask({ at: before, run: this.runs, speed, ...this.wishes });
    else if (!this.byAddress() && !replay.at_end && !matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.ask({ run: true });
    }
  }

  state({ replay, t }) {
    if (!replay) return;
    [this.runs, this.at] = [replay.runs, t];
    if (replay.wish !== null && replay.wish >= this.pending) this.pending = 0;
    if (replay.wish !== null && replay.wish >= this.asked) this.wishes = {};
    if (!this.pending && this.next !== null) {
      const at = this.next;
      this.next = null;
      this.seek(at);
    }
    if (!this.held && !this.pending) this.atPart.value = t;
    if (document.activeElement !== this.speedPart && !("speed" in this.wishes)) this.speedPart.value = String(replay.speed);
    this.tell();
    if (this.runs) clearTimeout(this.naming);
    else if (t !== this.named) this.nameTime(t);
  }

  // --- what the user wants -----------------------------------------------------------------------

  ask(wish) {
    const id = this.send({ type: "replay", ...wish });
    this.asked = id || this.asked;
    Object.assign(this.wishes, wish);
    if ("at" in wish) [this.pending, this.askedAt] = [id, performance.now()];
  }

  // One seek at a time is under way; of those that come meanwhile only the last is sent.
  seek(at) {
    const { from_s: from, to_s: to } = this.info;
    const wanted = Math.min(to, Math.max(from, at));
    this.atPart.value = wanted;
    if (this.pending && performance.now() - this.askedAt < ANSWER_MS) this.next = wanted;
    else this.ask({ at: wanted });
  }

  jump(t) {
    if (this.shown) this.seek(t);
  }

  // From where the last seek leads, if one is under way.
  get present() {
    return "at" in this.wishes || this.next !== null ? Number(this.atPart.value) : (this.at ?? this.info.from_s);
  }

  toggle() {
    this.ask({ run: !this.runs });
  }

  toEvent(way) {
    const now = this.present;
    const times = this.flight.events.map((event) => event.t);
    const grace = this.runs ? AT_EVENT_S : NEAR_S;
    const found = way > 0 ? times.find((t) => t > now + NEAR_S) : times.findLast((t) => t < now - grace);
    this.seek(found ?? (way > 0 ? this.info.to_s : this.info.from_s));
  }

  faster(steps) {
    const i = SPEEDS.indexOf(Number(this.speedPart.value));
    const speed = SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, i + steps))];
    this.speedPart.value = String(speed);
    this.ask({ speed });
  }

  key(event) {
    if (!this.shown || isTaken(event)) return;
    const { key, shiftKey } = event;
    const step = shiftKey ? LEAP_S : STEP_S;
    const tick = (way) => {
      if (this.runs) this.ask({ run: false });
      this.seek(Math.round((this.present + way * TICK_S) / TICK_S) * TICK_S);
    };
    const acts = {
      " ": () => this.toggle(), k: () => this.toggle(),
      ArrowLeft: () => this.seek(this.present - step), ArrowRight: () => this.seek(this.present + step),
      ",": () => tick(-1), ".": () => tick(1),
      p: () => this.toEvent(-1), "[": () => this.toEvent(-1), n: () => this.toEvent(1), "]": () => this.toEvent(1),
      Home: () => this.seek(this.info.from_s), End: () => this.seek(this.info.to_s),
    };
    for (const name of minusLike) acts[name] = () => this.faster(-1);
    for (const name of plusLike) acts[name] = () => this.faster(1);
    if (!acts[key]) return;
    event.preventDefault();
    acts[key]();
  }

  // The address may name a time: #t=12.5.
  byAddress() {
    const given = new URLSearchParams(location.hash.slice(1)).get("t");
    const at = given === null || given === "" ? NaN : Number(given);
    if (!this.shown || !Number.isFinite(at)) return false;
    if (at !== this.named) this.ask({ at, run: false });
    return true;
  }

  // Standing, the address names the time: it can be kept, reloaded, sent to somebody. Not while a slider
  // is drawn: browsers let an address change so and so many times only.
  nameTime(t) {
    this.named = t;
    clearTimeout(this.naming);
    this.naming = setTimeout(() => {
      history.replaceState(null, "", `${location.pathname}${location.search}#t=${t}`);
    }, 400);
  }

  // --- what is shown -----------------------------------------------------------------------------

  tell() {
    const { to_s: to } = this.info;
    put(this.playPart, this.runs ? "Pause" : "Play");
    this.playPart.dataset.runs = String(this.runs);
    const text = `${fixed(this.at, 2, "s")} of ${fixed(to, 2, "s")}`;
    put(this.timePart, text);
    this.atPart.setAttribute("aria-valuetext", text);
    const { events } = this.flight;
    const i = events.findLastIndex((event) => event.t <= this.at + NEAR_S);
    if (i === this.told && this.list.children.length === this.listed) return;
    [this.told, this.listed] = [i, this.list.children.length];
    const last = events[i];
    put(this.eventPart, last ? `${fixed(last.t, 1, "s")} ${last.source}: ${last.text}` : "");
    this.tellList(i);
  }

  // The event that was last stands out in the list, and those to come are pale.
  tellList(i) {
    [...this.list.children].forEach((item, k) => {
      item.dataset.future = String(k > i);
      if (k === i) item.setAttribute("aria-current", "true");
      else item.removeAttribute("aria-current");
    });
    this.scrollTo(this.list.children[Math.max(0, i)]);
  }

  scrollTo(item) {
    if (!item) return;
    const [top, bottom] = [item.offsetTop - this.list.offsetTop, item.offsetTop - this.list.offsetTop + item.offsetHeight];
    const { scrollTop, clientHeight } = this.list;
    if (top < scrollTop || bottom > scrollTop + clientHeight) this.list.scrollTop = top - clientHeight / 2;
  }

  drawMarks(events) {
    const { from_s: from, to_s: to } = this.info;
    const marks = events.filter((event) => event.kind !== "health" || event.level > 0).map((event) => {
      const mark = document.createElement("button");
      mark.type = "button";
      mark.tabIndex = -1;
      mark.dataset.kind = event.kind;
      mark.dataset.level = String(event.level);
      mark.title = `${fixed(event.t, 1, "s")} ${event.source}: ${event.text}`;
      const share = Math.min(1, Math.max(0, (event.t - from) / Math.max(1e-9, to - from)));
      mark.style.left = `calc(8px + ${share.toFixed(5)} * (100% - 16px))`;
      mark.addEventListener("click", () => this.seek(event.t));
      return mark;
    });
    this.marksPart.replaceChildren(...marks);
  }

  tellNotes(notes) {
    this.notesPart.hidden = !notes.length;
    put(this.notesPart.querySelector("summary"), notes.length === 1 ? "1 note" : `${notes.length} notes`);
    this.notesPart.querySelector("ul").replaceChildren(...notes.map((note) => {
      const item = document.createElement("li");
      item.textContent = note;
      return item;
    }));
  }

  tellReport(link, wanted, replay = this.info) {
    const address = wanted && this.shown ? replay?.report : null;
    link.hidden = !address;
    if (address && link.getAttribute("href") !== address) link.setAttribute("href", address);
  }

  // As the live page's: state of the chip, its text, sentence of the banner, its countdown.
  situation({ open, retryAt }, ends) {
    const pause = retryAt === null ? "Trying now." : `Next try in ${Math.max(0, Math.ceil((retryAt - performance.now()) / 1000))} s.`;
    if (!open) return ["offline", "no connection", "The replay's server has ended. What is shown stays.", pause];
    const { end } = this.flight;
    if (end) {
      const [word, sentence] = ends[end.kind];
      const told = this.info.ended || `${sentence(fixed(this.at, 1, "s"))}${end.kind === "over" ? "" : ` ${end.text}`}`;
      return [end.kind, word, told, ""];
    }
    if (this.at >= this.info.to_s) return ["replay", "record ends", `The record ends here, before the flight does. ${this.info.ended}`, ""];
    return ["replay", this.runs ? "replay" : "replay, paused", "", ""];
  }
}
