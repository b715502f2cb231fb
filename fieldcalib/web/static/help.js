// The keyboard help, and tips with keys on what the pointer rests on.

import { button, element } from "./dom.js";

const NAMES = { ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓", Space: "Space", Escape: "Esc", PageUp: "Page ↑", PageDown: "Page ↓", Backspace: "⌫" };
const DELAY = 450; // ms

/** A dialog with all commands that have words, by group. */
export class Help {
  constructor(commands, extra) {
    const groups = new Map();
    for (const { group, words, keys } of [...commands, ...extra]) {
      if (words) groups.set(group, [...(groups.get(group) ?? []), { words, keys }]);
    }
    const close = button("Close", { keys: "Esc", press: () => this.dialog.close() });
    this.dialog = element(
      "dialog",
      { class: "help", "aria-label": "Keys" },
      element("div", { class: "help-head" }, element("h2", { text: "Keys" }), close),
      element("div", { class: "help-groups" }, [...groups].map(([group, rows]) => helpGroup(group, rows))),
    );
    this.dialog.addEventListener("click", (event) => event.target === this.dialog && this.dialog.close());
    document.body.append(this.dialog);
  }

  toggle() {
    if (this.dialog.open) this.dialog.close();
    else this.dialog.showModal();
  }
}

function helpGroup(group, rows) {
  return element(
    "section",
    {},
    element("h3", { text: group }),
    element("dl", {}, rows.flatMap(({ words, keys }) => [element("dt", {}, keys.map((key) => keyCaps(key))), element("dd", { text: words })])),
  );
}

/** "Ctrl+Z" as key caps. */
export function keyCaps(keys) {
  return element("span", { class: "keys" }, (keys === "+" ? ["+"] : keys.split("+")).map((key) => element("kbd", { text: NAMES[key] ?? key })));
}

/** Tips: what `data-tip` and `data-keys` of an element say, beside it. */
export function startTips() {
  const tip = element("div", { class: "tip", role: "tooltip", hidden: true });
  document.body.append(tip);
  let timer = null;
  const hide = () => {
    clearTimeout(timer);
    tip.hidden = true;
  };
  const show = (target) => {
    hide();
    timer = setTimeout(() => {
      if (!target.isConnected) return;
      tip.replaceChildren(element("span", { text: target.dataset.tip }), target.dataset.keys ? keyCaps(target.dataset.keys) : "");
      tip.hidden = false;
      const [box, own] = [target.getBoundingClientRect(), tip.getBoundingClientRect()];
      const below = box.bottom + 8 + own.height < window.innerHeight;
      tip.style.left = `${Math.min(Math.max(box.left + box.width / 2 - own.width / 2, 6), window.innerWidth - own.width - 6)}px`;
      tip.style.top = `${below ? box.bottom + 7 : box.top - own.height - 7}px`;
    }, DELAY);
  };
  const target = (event) => (event.target instanceof Element ? event.target.closest("[data-tip]") : null);
  document.addEventListener("pointerover", (event) => (target(event) ? show(target(event)) : hide()));
  document.addEventListener("focusin", (event) => (target(event)?.matches(":focus-visible") ? show(target(event)) : hide()));
  for (const event of ["pointerdown", "keydown", "focusout", "wheel"]) document.addEventListener(event, hide, { passive: true });
}
