// Messages: short ones that go by themselves, and a banner while the server does not answer.

import { button, element } from "./dom.js";

const STAY = 6000; // ms

/** Messages at the edge of the page. */
export class Notices {
  constructor(root) {
    this.root = root;
    this.banner = element("div", { class: "banner", role: "alert", hidden: true });
    this.refusal = element("div", { class: "banner refusal", role: "alert", hidden: true });
    document.body.append(this.banner, this.refusal);
  }

  /** Say something; `kind` is "", "good" or "warn". */
  say(words, kind = "") {
    for (const one of this.root.children) if (one.dataset.words === words) one.remove();
    const node = element("div", { class: `notice ${kind}`, "data-words": words }, element("span", { text: words }));
    node.append(button("Close", { icon: "clear", kind: "quiet", shown: false, press: () => node.remove() }));
    this.root.append(node);
    setTimeout(() => node.remove(), kind === "warn" ? 2 * STAY : STAY);
  }

  /** Why changes are refused, or "" where they are not. */
  refused(words) {
    this.refusal.hidden = !words;
    if (words && this.refusal.dataset.words !== words) {
      this.refusal.replaceChildren(element("strong", { text: "Changes here are refused:" }), element("span", { text: ` ${words}.` }));
    }
    this.refusal.dataset.words = words;
  }

  /** The server does not answer, with so many edits that it has not seen; null: it does again. */
  offline(waiting) {
    this.banner.hidden = waiting === null;
    if (waiting === null) return;
    const kept = "Every change that it answered is kept: start fieldcalib open again, and open the address that it prints.";
    const edits = waiting ? ` ${waiting === 1 ? "One change is" : `${waiting} changes are`} not stored yet.` : "";
    this.banner.replaceChildren(element("strong", { text: "The server does not answer." }), element("span", { text: ` ${kept}${edits}` }));
  }
}
