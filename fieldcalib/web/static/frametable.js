// A table of all frames that is sorted by any of its columns. Only the rows in view exist, so that 90 000 frames are no
// burden.

import { element, shownNumber } from "./dom.js";
import { VERDICTS, verdictOf, verdictShape } from "./verdict.js";

const ROW = 2.2; // rem
const SPARE = 6; // rows above and below those in view
const COLUMNS = [
  { name: "concern", words: "Verdict", largestFirst: true },
  { name: "id", words: "Frame" },
  { name: "reason", words: "Reason" },
  { name: "probability", words: "Right", title: "Probability that all of the field in view is right to a metre", show: (value) => (value === null ? "–" : `${shownNumber(100 * value, 0)} %`) },
  { name: "pan", words: "Pan", show: (value) => (value === null ? "–" : `${shownNumber(value, 1)}°`) },
  { name: "focal_length", words: "Zoom", title: "Focal length, pixels", show: (value) => shownNumber(value, 0) },
];
const LETTERS = new Intl.Collator("en", { numeric: true });

/** The table, in an element that it fills. Columns as of `api/frames`, and probability. */
export class FrameTable {
  constructor(root, { open }) {
    this.open = open;
    this.current = 0;
    this.sorting = { name: "concern", down: true };
    this.keeps = () => true;
    this.order = [];
    this.head = element("div", { class: "table-row table-head", role: "row" });
    this.space = element("div", { class: "table-space", role: "rowgroup" });
    this.body = element("div", { class: "table-body", tabindex: "0", "aria-label": "Frames" }, this.space);
    root.setAttribute("role", "table");
    root.append(element("div", { role: "rowgroup" }, this.head), this.body);
    this.body.addEventListener("scroll", () => this.draw());
    this.body.addEventListener("click", (event) => {
      const row = event.target.closest("[data-number]");
      if (row) this.open(Number(row.dataset.number));
    });
    new ResizeObserver(() => this.draw()).observe(this.body);
  }

  /** Show the columns of all frames; `pictured` has the ids of those with a picture. */
  show(frames, pictured) {
    this.frames = frames;
    this.pictured = pictured;
    this.sort();
  }

  /** Show only the frames, by their numbers, that a function keeps. */
  filter(keeps) {
    this.keeps = keeps;
    this.sort();
  }

  sortBy(name) {
    const { largestFirst = false } = COLUMNS.find((one) => one.name === name);
    this.sorting = { name, down: this.sorting.name === name ? !this.sorting.down : largestFirst };
    this.body.scrollTop = 0;
    this.sort();
  }

  sort() {
    const { name, down } = this.sorting;
    const column = this.frames[name];
    const missing = (value) => value === null || value === "";
    const compare = (a, b) => {
      const [one, other] = [column[a], column[b]];
      if (missing(one) || missing(other)) return missing(one) - missing(other); // last, whichever way
      const order = typeof one === "string" ? LETTERS.compare(one, other) : one - other;
      return down ? -order : order;
    };
    this.order = [...column.keys()].filter(this.keeps).sort((a, b) => compare(a, b) || a - b);
    this.place = new Map(this.order.map((number, row) => [number, row]));
    this.drawHead();
    this.draw();
  }

  drawHead() {
    const cells = COLUMNS.map(({ name, words, title = words }) => {
      const sorted = this.sorting.name === name ? (this.sorting.down ? "descending" : "ascending") : "none";
      const sign = { none: "", descending: " ↓", ascending: " ↑" }[sorted];
      return element(
        "div",
        { role: "columnheader", "aria-sort": sorted, class: `table-${name}` },
        element("button", { type: "button", title: `Sort by: ${title.toLowerCase()}`, text: words + sign, on: { click: () => this.sortBy(name) } }),
      );
    });
    this.head.replaceChildren(...cells);
  }

  get rowHeight() {
    return ROW * parseFloat(getComputedStyle(document.documentElement).fontSize);
  }

  draw() {
    if (!this.frames) return;
    const height = this.rowHeight;
    this.space.style.height = `${height * this.order.length}px`;
    const first = Math.max(0, Math.floor(this.body.scrollTop / height) - SPARE);
    const last = Math.min(this.order.length, Math.ceil((this.body.scrollTop + this.body.clientHeight) / height) + SPARE);
    const rows = this.order.slice(first, last).map((number, k) => this.row(number, first + k, height));
    if (!this.order.length) rows.push(element("p", { class: "dim table-empty", text: "No frame has one of the chosen verdicts." }));
    this.space.replaceChildren(...rows);
  }

  row(number, place, height) {
    const cells = COLUMNS.map(({ name, show }) => {
      if (name === "concern") return this.verdictCell(number);
      const text = show ? show(this.frames[name][number]) : this.frames[name][number];
      return element("div", { role: "cell", class: `table-${name}`, text });
    });
    const known = this.pictured.has(this.frames.id[number]) ? "" : " table-bare";
    const row = element("div", { role: "row", class: `table-row${known}`, "data-number": number, "aria-selected": String(number === this.current), "aria-rowindex": place + 2, title: this.frames.reason[number] }, ...cells);
    row.style.top = `${place * height}px`;
    row.style.height = `${height}px`;
    return row;
  }

  verdictCell(number) {
    const verdict = this.frames.verdict[number];
    const words = verdictOf(verdict in VERDICTS ? verdict : "").words;
    return element("div", { role: "cell", class: "table-concern" }, verdictShape(verdict), element("span", { class: "table-word", text: words }));
  }

  /** Mark the frame that is shown, and scroll to it. */
  setCurrent(number) {
    this.current = number;
    const place = this.place?.get(number);
    if (place !== undefined) {
      const [height, top, size] = [this.rowHeight, this.body.scrollTop, this.body.clientHeight];
      if (place * height < top || (place + 1) * height > top + size) this.body.scrollTop = (place + 0.5) * height - size / 2;
    }
    this.draw();
  }

  /** The frame so many rows further. */
  neighbour(step) {
    const place = this.place?.get(this.current);
    if (place === undefined) return this.order[0] ?? this.current;
    return this.order[Math.min(Math.max(place + step, 0), this.order.length - 1)];
  }
}
