// SPDX-License-Identifier: Apache-2.0
// A question before something dangerous: a modal dialog, Escape and Enter both mean no unless "yes" has the focus.

export class Ask {
  constructor(dialog) {
    this.dialog = dialog;
    const part = (name) => dialog.querySelector(`[data-part=${name}]`);
    [this.title, this.text, this.yes, this.no] = ["title", "text", "yes", "no"].map(part);
    this.yes.addEventListener("click", () => dialog.close("yes"));
    this.no.addEventListener("click", () => dialog.close());
    dialog.addEventListener("close", () => this.end(dialog.returnValue === "yes"));
  }

  // Calls then(true) for yes, then(false) for no, Escape and withdraw(); a second question ends the first with no.
  put({ title, text, yes }, then) {
    this.withdraw();
    [this.title.textContent, this.text.textContent, this.yes.textContent] = [title, text, yes];
    this.then = then;
    this.dialog.returnValue = "";
    this.dialog.showModal();
  }

  // What was asked cannot be done any more.
  withdraw() {
    if (!this.dialog.open) return;
    this.dialog.close();
    this.end(false);
  }

  end(agreed) {
    const then = this.then;
    this.then = null;
    then?.(agreed);
  }
}
