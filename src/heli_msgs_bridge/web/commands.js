// SPDX-License-Identifier: Apache-2.0
// Gust, mode and reference for those who hold the token; without permission there is nothing to press.

const ANSWER_LIMIT_MS = 6000;

export class Commands {
  // `send` takes a message and returns its number; `track` lets a point be picked.
  constructor(root, permission, send, track) {
    Object.assign(this, { root, permission, send, track, token: "", waiting: new Map() });
    this.answerText = root.querySelector("#answer");
    this.tokenField = root.querySelector("#token");
    this.pick = root.querySelector("#pick");
    this.reference = root.querySelector("#f-reference");
    this.on("#f-token", () => this.unlock());
    this.on("#f-gust", (form) => this.command("gust", Object.fromEntries(
      [...new FormData(form)].map(([name, value]) => [name, Number(value)]))));
    this.on("#f-mode", (_, button) => this.command("mode", { mode: button.value }));
    this.on("#f-reference", (form) => this.sendReference(form));
    this.pick.addEventListener("click", () => this.setPicking(!track.picking));
    root.addEventListener("keydown", (event) => event.key === "Escape" && this.setPicking(false));
    // A link from the terminal may carry the token behind the #, which no server sees.
    const given = new URLSearchParams(location.hash.slice(1)).get("token");
    if (given) {
      this.tokenField.value = given;
      history.replaceState(null, "", location.pathname + location.search);
    }
  }

  on(selector, act) {
    const form = this.root.querySelector(selector);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      act(form, event.submitter);
    });
  }

  permit(allowed) {
    this.root.hidden = !allowed;
    this.permission.textContent = allowed
      ? ""
      : "View only. Who starts the live view with --allow-commands can send gusts, modes and references from here.";
    if (allowed && this.tokenField.value && !this.token) this.unlock();
    if (!allowed) this.lock();
  }

  lock() {
    this.token = "";
    this.enable(false);
    this.setPicking(false);
  }

  enable(on) {
    for (const fieldset of this.root.querySelectorAll("fieldset")) fieldset.disabled = !on;
  }

  unlock() {
    const token = this.tokenField.value.trim();
    this.ask({ type: "auth", token }, "the token", (ok) => {
      this.token = ok ? token : "";
      this.enable(ok);
      if (ok) this.tokenField.value = "";
    });
  }

  command(name, args) {
    this.ask({ type: "command", token: this.token, name, args }, name, () => {});
  }

  ask(message, what, then) {
    const id = this.send(message);
    if (!id) {
      this.say(false, `${what}: not sent, there is no connection`);
      return;
    }
    this.say(null, `${what}: sent`);
    const timer = setTimeout(() => {
      if (this.waiting.delete(id)) this.say(false, `${what}: no answer`);
    }, ANSWER_LIMIT_MS);
    this.waiting.set(id, { then, timer });
  }

  answer({ id, ok, text }) {
    const asked = this.waiting.get(id);
    if (!asked) return;
    this.waiting.delete(id);
    clearTimeout(asked.timer);
    asked.then(ok);
    this.say(ok, text);
  }

  say(ok, text) {
    this.answerText.textContent = text;
    this.answerText.dataset.ok = ok === null ? "" : String(ok);
  }

  sendReference(form) {
    const value = (name) => Number(form.elements[name].value);
    this.setPicking(false);
    this.command("reference", { p: [value("e"), value("n"), value("u")], yaw_deg: value("yaw") });
  }

  setPicking(on) {
    this.track.setPicking(on);
    this.pick.setAttribute("aria-pressed", String(on));
  }

  picked(east, north) {
    this.reference.elements.e.value = east.toFixed(1);
    this.reference.elements.n.value = north.toFixed(1);
    this.say(null, `reference: ${east.toFixed(1)} m east, ${north.toFixed(1)} m north picked, not yet sent`);
  }

  // The form starts from the present reference, so that one field can be changed alone.
  suggest(ref) {
    if (this.suggested || !ref) return;
    this.suggested = true;
    const { e, n, u, yaw } = this.reference.elements;
    [e.value, n.value, u.value] = ref.p.map((x) => x.toFixed(1));
    yaw.value = Math.round(ref.yaw_deg);
  }
}
