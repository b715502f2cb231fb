// The list of all frames: shape and colour of the verdict, name, reason; in order, or the worst first. Only the rows in
// view exist, so that 90 000 frames are no burden.

import { element } from "./dom.js";
import { VERDICTS, verdictShape } from "./verdict.js";

const ROW = 2.9; // rem
const SPARE = 6; // rows above and below those in view

/** The list, in an element that it fills. Columns as of `api/frames`: id, verdict, reason, concern, by_hand. */
export class FrameList {
  constructor(root, { open }) {
    this.open = open;
    this.current = 0;
    this.worstFirst = false;
    this.shown = new Set(Object.keys(VERDICTS));
    this.order = [];
    this.counts = element("div", { class: "frame-counts", role: "group", "aria-label": "Verdicts shown" });
    this.sorting = element("select", { "aria-label": "Order of the frames", "data-tip": "Order of the frames", "data-keys": "Shift+W", on: { change: () => this.setWorstFirst(this.sorting.value === "worst") } },
      element("option", { value: "order", text: "In order" }),
      element("option", { value: "worst", text: "Worst first" }),
    );
    this.space = element("div", { class: "frame-space" });
    this.list = element("div", { class: "frame-list", tabindex: "0", role: "listbox", "aria-label": "Frames" }, this.space);
    root.append(element("div", { class: "frame-head" }, this.sorting, this.counts), this.list);
    this.list.addEventListener("scroll", () => this.draw());
    this.list.addEventListener("click", (event) => {
      const row = event.target.closest("[data-number]");
      if (row) this.open(Number(row.dataset.number));
    });
    new ResizeObserver(() => this.draw()).observe(this.list);
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
    if (!worst) return this.reveal();
    this.list.scrollTop = 0;
    return this.draw();
  }

  sort() {
    const { verdict, concern } = this.frames;
    const known = (name) => (name in VERDICTS ? name : "");
    this.order = [...verdict.keys()].filter((number) => this.shown.has(known(verdict[number])));
    if (this.worstFirst) this.order.sort((a, b) => concern[b] - concern[a] || a - b);
    this.place = new Map(this.order.map((number, row) => [number, row]));
    this.draw();
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

  get rowHeight() {
    return ROW * parseFloat(getComputedStyle(document.documentElement).fontSize);
  }

  draw() {
    if (!this.frames) return;
    const height = this.rowHeight;
    this.space.style.height = `${height * this.order.length}px`;
    const first = Math.max(0, Math.floor(this.list.scrollTop / height) - SPARE);
    const last = Math.min(this.order.length, Math.ceil((this.list.scrollTop + this.list.clientHeight) / height) + SPARE);
    const rows = this.order.slice(first, last).map((number, k) => this.row(number, first + k, height));
    if (!this.order.length) rows.push(element("p", { class: "empty dim", text: "No frame has one of the chosen verdicts." }));
    this.space.replaceChildren(...rows);
    this.list.setAttribute("aria-activedescendant", `frame-${this.current}`);
  }

  row(number, place, height) {
    const { id, verdict, reason, by_hand: byHand } = this.frames;
    const name = id[number] ?? String(number);
    const row = element(
      "div",
      {
        class: "frame-row",
        id: `frame-${number}`,
        role: "option",
        "aria-selected": String(number === this.current),
        "aria-posinset": place + 1,
        "aria-setsize": this.order.length,
        "data-number": number,
        title: name,
      },
      verdictShape(verdict[number]),
      element("span", { class: "frame-name", text: name }),
      byHand?.[number] ? element("span", { class: "frame-hand", text: "by hand" }) : null,
      element("span", { class: "frame-reason dim", text: reason[number] || (verdict[number] ? "" : "not calibrated yet") }),
    );
    row.style.top = `${place * height}px`;
    row.style.height = `${height}px`;
    return row;
  }

  /** Mark the frame that is shown, and scroll to it. */
  setCurrent(number) {
    this.current = number;
    this.reveal();
  }

  reveal() {
    const place = this.place?.get(this.current);
    if (place === undefined) return this.draw();
    const [height, top, size] = [this.rowHeight, this.list.scrollTop, this.list.clientHeight];
    if (place * height < top || (place + 1) * height > top + size) this.list.scrollTop = (place + 0.5) * height - size / 2;
    return this.draw();
  }

  /** The frame so many places further in the list as it is sorted. */
  neighbour(step) {
    const place = this.place?.get(this.current);
    if (place === undefined) return this.order[0] ?? this.current;
    return this.order[Math.min(Math.max(place + step, 0), this.order.length - 1)];
  }
}
