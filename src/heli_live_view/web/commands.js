// SPDX-License-Identifier: Apache-2.0
// Gust, mode, reference and faults for those who hold the token; without permission there is nothing to press.
// What each will do stands beside it; what is dangerous is asked first; after the end nothing can be sent.

import { Ask } from "./ask.js";
import { ofFault, ofGust, ofMode, ofReference } from "./consequences.js";
import { FaultForm } from "./faults.js";
import { put } from "./format.js";

const ANSWER_LIMIT_MS = 6000;
const LOCKED = "Locked. The token stands where the live view was started.";
const LOCKSTEP = "This flight is in lockstep, faster or slower than the clock: it cannot be commanded.";
const FIELDS = ["e", "n", "u", "yaw"];

const shown = (value, decimals) => (Number(value.toFixed(decimals)) + 0).toFixed(decimals);

export class Commands {
  // `send` takes a message and returns its number; `track` lets a point be picked.
  constructor(root, permission, dialog, send, track) {
    Object.assign(this, { root, permission, send, track, token: "", waiting: new Map(), info: null, state: null });
    this.why = LOCKED;
    const part = (name) => root.querySelector(`#${name}`);
    [this.answerText, this.tokenField, this.pick, this.follow] = ["answer", "token", "pick", "follow"].map(part);
    [this.gust, this.mode, this.reference, this.fault] = ["f-gust", "f-mode", "f-reference", "f-fault"].map(part);
    [this.tells, this.faults] = [{}, new FaultForm(this.fault, part("faults"), root.querySelector("#f-clear button"))];
    for (const name of ["gust", "mode", "reference", "fault"]) this.tells[name] = part(`tells-${name}`);
    this.unlockButton = root.querySelector("#f-token button");
    this.question = new Ask(dialog);
    this.edited = false;
    this.on(part("f-token"), () => this.unlock());
    this.on(this.gust, () => this.command("gust", this.gustArgs(), ofGust(this.gustArgs(), this.state)));
    this.on(this.mode, (button) => this.command("mode", { mode: button.value }, ofMode(button.value, this.state)));
    this.on(this.reference, () => this.sendReference());
    this.on(this.fault, () => this.command("fault", this.faults.args(), ofFault(this.faults.args(), this.state)));
    this.on(part("f-clear"), () => this.command("clear_faults", {}, {}));
    this.reference.addEventListener("input", () => this.setEdited(true));
    this.follow.addEventListener("click", () => this.setEdited(false));
    this.pick.addEventListener("click", () => this.setPicking(!track.picking));
    root.addEventListener("keydown", (event) => event.key === "Escape" && this.setPicking(false));
    // A link from the terminal may carry the token behind the #, which no server sees.
    const given = new URLSearchParams(location.hash.slice(1)).get("token");
    if (given) {
      this.tokenField.value = given;
      history.replaceState(null, "", location.pathname + location.search);
    }
  }

  on(form, act) {
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      act(event.submitter);
    });
  }

  // Takes the greeting: whether there are commands at all, and their limits.
  permit(info) {
    const allowed = Boolean(info.commands);
    this.info = info;
    this.root.hidden = !allowed;
    const record = "A record: its flight is over, so no gust, mode, reference or fault can be sent.";
    this.permission.textContent = allowed
      ? ""
      : info.replay ? record : "View only. Who starts the live view with --allow-commands can send gusts, modes, references and faults from here.";
    this.faults.offer(info.faults);
    this.gust.elements.amplitude_mps.max = info.limits.gust_mps;
    this.gust.elements.duration_s.max = info.limits.gust_s;
    this.reference.elements.u.min = info.limits.altitude_min_m;
    this.reference.elements.u.max = info.limits.altitude_max_m;
    if (allowed && this.tokenField.value && !this.token) this.unlock();
    if (!allowed) this.lock();
  }

  lock() {
    this.token = "";
    this.setPicking(false);
  }

  unlock() {
    const token = this.tokenField.value.trim();
    this.ask({ type: "auth", token }, "the token", (ok) => {
      this.token = ok ? token : "";
      if (ok) this.tokenField.value = "";
    });
  }

  // Eight times a second: the newest state, and why nothing can be sent now (empty: it can).
  update(state, flight, open) {
    this.state = state;
    this.unlockButton.disabled = !open || Boolean(flight.end);
    this.setBlocked(this.obstacle(state, flight, open));
    this.faults.update(state?.faults);
    if (!this.info?.commands) return;
    this.suggest(state?.ref);
    this.tell();
  }

  obstacle(state, flight, open) {
    if (flight.end) return "The flight has ended: nothing can be commanded any more.";
    if (!open) return "No connection: nothing can be sent.";
    if (!this.token) return LOCKED;
    if (this.info?.flight?.realtime === false) return LOCKSTEP;
    return state ? "" : "The flight has not begun.";
  }

  setBlocked(why) {
    for (const fieldset of this.root.querySelectorAll("fieldset")) fieldset.disabled = Boolean(why);
    const present = this.state?.mode;
    for (const button of this.mode.elements.mode) {
      button.disabled = button.value === present;
      button.setAttribute("aria-pressed", String(button.value === present));
    }
    if (why === this.why) return;
    const before = this.why;
    this.why = why;
    if (why) {
      this.question.withdraw();
      this.setPicking(false);
      this.say(null, why);
    } else if (this.answerText.textContent === before) this.say(null, "Commands are allowed.");
  }

  tell() {
    put(this.tells.gust, this.gust.checkValidity() ? ofGust(this.gustArgs(), this.state).text : "");
    put(this.tells.mode, ofMode(this.state?.mode === "attitude" ? "hover" : "attitude", this.state).text);
    put(this.tells.fault, this.fault.checkValidity() ? ofFault(this.faults.args(), this.state).text : "");
    const usable = this.reference.checkValidity();
    put(this.tells.reference, usable ? ofReference(this.target(), this.state?.ref, this.info.limits).text : "");
  }

  gustArgs() {
    const { amplitude_mps: peak, from_deg: from, duration_s: length } = this.gust.elements;
    return { amplitude_mps: Number(peak.value), from_deg: Number(from.value), duration_s: Number(length.value) };
  }

  // Sends a command; a dangerous one only after a yes.
  command(name, args, { danger }, sent = () => {}) {
    const go = () => this.ask({ type: "command", token: this.token, name, args }, name, sent, Boolean(danger));
    if (!danger) {
      go();
      return;
    }
    this.say(null, `${name}: not yet sent`);
    this.question.put(danger, (agreed) => (agreed && !this.why ? go() : this.say(null, this.why || `${name}: not sent`)));
  }

  ask(message, what, then, danger = false) {
    const id = this.send(message);
    if (!id) {
      this.say(false, `${what}: not sent, there is no connection`);
      return;
    }
    this.say(null, `${what}: sent`);
    const timer = setTimeout(() => {
      if (this.waiting.delete(id)) this.say(false, `${what}: no answer`);
    }, ANSWER_LIMIT_MS);
    this.waiting.set(id, { then, timer, danger });
  }

  answer({ id, ok, text }) {
    const asked = this.waiting.get(id);
    if (!asked) return;
    this.waiting.delete(id);
    clearTimeout(asked.timer);
    asked.then(ok);
    this.say(ok && asked.danger ? "danger" : ok, text);
  }

  // ok: true done, false refused, "danger" done and dangerous, null nothing of the kind.
  say(ok, text) {
    put(this.answerText, text);
    this.answerText.dataset.ok = ok === null ? "" : String(ok);
  }

  target() {
    const [e, n, u, yaw] = FIELDS.map((name) => Number(this.reference.elements[name].value));
    return { p: [e, n, u], yaw_deg: yaw };
  }

  sendReference() {
    this.setPicking(false);
    const target = this.target();
    const what = ofReference(target, this.state?.ref, this.info.limits);
    this.command("reference", target, what, (ok) => ok && this.setEdited(false));
  }

  setPicking(on) {
    this.track.setPicking(on);
    this.pick.setAttribute("aria-pressed", String(on));
  }

  picked(east, north) {
    this.setEdited(true);
    this.reference.elements.e.value = shown(east, 1);
    this.reference.elements.n.value = shown(north, 1);
    this.say(null, `reference: ${shown(east, 1)} m east, ${shown(north, 1)} m north picked, not yet sent`);
  }

  setEdited(on) {
    this.edited = on;
    this.follow.hidden = !on;
  }

  // The form shows the present reference until somebody writes into it, so that one field can be changed alone.
  suggest(ref) {
    const held = this.reference.contains(document.activeElement) && document.activeElement.matches("input");
    if (this.edited || held || !ref) return;
    const { e, n, u, yaw } = this.reference.elements;
    [e, n, u].forEach((field, i) => {
      field.value = shown(ref.p[i], 1);
    });
    yaw.value = shown(ref.yaw_deg, 0);
  }
}
