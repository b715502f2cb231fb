// The list of all frames: shape and colour of the verdict, name, reason; in order, or the worst first.

import { element } from "./dom.js";
import { FrameRows } from "./rows.js";
import { VERDICTS, verdictShape } from "./verdict.js";

/** The list, in an element that it fills. Columns as of `api/frames`: id, verdict, reason, concern, by_hand. */
export class FrameList {
  constructor(root, { open }) {
    this.worstFirst = false;
    this.shown = new Set(Object.keys(VERDICTS));
    this.counts = element("div", { class: "frame-counts", role: "group", "aria-label": "Verdicts shown" });
    this.sorting = element("select", { "aria-label": "Order of the frames", "data-tip": "Order of the frames", "data-keys": "Shift+W", on: { change: () => this.setWorstFirst(this.sorting.value === "worst") } },
      element("option", { value: "order", text: "In order" }),
      element("option", { value: "worst", text: "Worst first" }),
    );
    const space = element("div", { class: "frame-space" });
    this.list = element("div", { class: "frame-list", tabindex: "0", role: "listbox", "aria-label": "Frames" }, space);
    root.append(element("div", { class: "frame-head" }, this.sorting, this.counts), this.list);
    this.rows = new FrameRows(this.list, space, { height: 2.9, empty: "empty dim", draw: (number, place) => this.row(number, place), open });
  }

  /** Show the columns of all frames. */
  show(frames) {
    this.frames = frames;
    this.sort();
    this.drawCounts();
  }

  setWorstFirst(worst) {
    this.worstFirst = worst;
    this.sorting.value = worst ? "worst" : "order";
    this.sort();
    if (!worst) return this.rows.reveal();
    this.list.scrollTop = 0;
    return this.rows.draw();
  }

  sort() {
    const { verdict, concern } = this.frames;
    const known = (name) => (name in VERDICTS ? name : "");
    const order = [...verdict.keys()].filter((number) => this.shown.has(known(verdict[number])));
    if (this.worstFirst) order.sort((a, b) => concern[b] - concern[a] || a - b);
    this.rows.show(order);
  }

  drawCounts() {
    const buttons = Object.entries(VERDICTS).map(([name, { words }]) => {
      const count = this.frames.verdict.filter((one) => (one in VERDICTS ? one : "") === name).length;
      if (!count) return null;
      const toggle = () => {
        if (!this.shown.delete(name)) this.shown.add(name);
        this.sort();
        this.drawCounts();
      };
      const attributes = { type: "button", class: "frame-count", "aria-pressed": String(this.shown.has(name)), "data-tip": `Show or hide: ${words.toLowerCase()}`, "aria-label": `${words}: ${count}`, on: { click: toggle } };
      return element("button", attributes, verdictShape(name), count.toLocaleString("en"));
    });
    this.counts.replaceChildren(...buttons.filter(Boolean));
  }

  row(number, place) {
    const { id, verdict, reason, by_hand: byHand } = this.frames;
    const name = id[number] ?? String(number);
    return element(
      "div",
      {
        class: "frame-row",
        id: `frame-${number}`,
        role: "option",
        "aria-selected": String(number === this.rows.current),
        "aria-posinset": place + 1,
        "aria-setsize": this.rows.order.length,
        "data-number": number,
        title: name,
      },
      verdictShape(verdict[number]),
      element("span", { class: "frame-name", text: name }),
      byHand?.[number] ? element("span", { class: "frame-hand", text: "by hand" }) : null,
      element("span", { class: "frame-reason dim", text: reason[number] || (verdict[number] ? "" : "not calibrated yet") }),
    );
  }

  /** Mark the frame that is shown, and scroll to it. */
  setCurrent(number) {
    this.list.setAttribute("aria-activedescendant", `frame-${number}`);
    this.rows.setCurrent(number);
  }

  /** The frame so many places further in the list as it is sorted. */
  neighbour(step) {
    return this.rows.neighbour(step);
  }
}
