// Tabs: one of several panels, chosen by pointer or arrow keys.

import { element } from "./dom.js";

/** Tabs for panels by their ids: {id: words}. */
export class Tabs {
  constructor(root, panels) {
    this.tabs = Object.fromEntries(
      Object.entries(panels).map(([id, words]) => {
        const count = element("span", { class: "dim tab-count" });
        const tab = element("button", { type: "button", role: "tab", id: `tab-${id}`, "aria-controls": id, on: { click: () => this.show(id) } }, element("span", { text: words }), count);
        document.getElementById(id).setAttribute("aria-labelledby", tab.id);
        return [id, { tab, count }];
      }),
    );
    root.append(...Object.values(this.tabs).map(({ tab }) => tab));
    root.addEventListener("keydown", (event) => this.press(event));
    this.show(Object.keys(panels)[0]);
  }

  show(id) {
    for (const [name, { tab }] of Object.entries(this.tabs)) {
      tab.setAttribute("aria-selected", String(name === id));
      tab.tabIndex = name === id ? 0 : -1;
      document.getElementById(name).hidden = name !== id;
    }
  }

  setCount(id, count) {
    this.tabs[id].count.textContent = count ? String(count) : "";
  }

  press(event) {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const names = Object.keys(this.tabs);
    const now = names.findIndex((name) => this.tabs[name].tab.getAttribute("aria-selected") === "true");
    const name = names[(now + step + names.length) % names.length];
    this.show(name);
    this.tabs[name].tab.focus();
  }
}
