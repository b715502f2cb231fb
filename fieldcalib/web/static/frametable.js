// A table of all frames that is sorted by any of its columns.

import { element, shownNumber } from "./dom.js";
import { FrameRows } from "./rows.js";
import { VERDICTS, verdictOf, verdictShape } from "./verdict.js";

const COLUMNS = [
  { name: "concern", words: "Verdict", largestFirst: true },
  { name: "id", words: "Frame" },
  { name: "reason", words: "Reason" },
  { name: "probability", words: "Sure", title: "Probability that all of the field in view is right to a metre", show: (value) => (value === null ? "–" : `${shownNumber(100 * value, 0)} %`) },
  { name: "pan", words: "Pan", show: (value) => (value === null ? "–" : `${shownNumber(value, 1)}°`) },
  { name: "focal_length", words: "Zoom", title: "Focal length, pixels", show: (value) => shownNumber(value, 0) },
];
const LETTERS = new Intl.Collator("en", { numeric: true });

/** The table, in an element that it fills. Columns as of `api/frames`, and probability. */
export class FrameTable {
  constructor(root, { open }) {
    this.sorting = { name: "concern", down: true };
    this.keeps = () => true;
    this.head = element("div", { class: "table-row table-head", role: "row" });
    const space = element("div", { class: "table-space", role: "presentation" });
    this.body = element("div", { class: "table-body", role: "rowgroup", tabindex: "0", "aria-label": "Frames" }, space);
    root.setAttribute("role", "table");
    root.append(element("div", { role: "rowgroup" }, this.head), this.body);
    this.rows = new FrameRows(this.body, space, { height: 2.2, empty: "dim table-empty", draw: (number, place) => this.row(number, place), open });
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
    this.drawHead();
    this.rows.show([...column.keys()].filter(this.keeps).sort((a, b) => compare(a, b) || a - b));
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

  row(number, place) {
    const cells = COLUMNS.map(({ name, show }) => {
      if (name === "concern") return this.verdictCell(number);
      const text = show ? show(this.frames[name][number]) : this.frames[name][number];
      return element("div", { role: "cell", class: `table-${name}`, text });
    });
    const known = this.pictured.has(this.frames.id[number]) ? "" : " table-bare";
    return element("div", { role: "row", class: `table-row${known}`, "data-number": number, "aria-selected": String(number === this.rows.current), "aria-rowindex": place + 2, title: this.frames.reason[number] }, ...cells);
  }

  verdictCell(number) {
    const verdict = this.frames.verdict[number];
    const words = verdictOf(verdict in VERDICTS ? verdict : "").words;
    return element("div", { role: "cell", class: "table-concern" }, verdictShape(verdict), element("span", { class: "table-word", text: words }));
  }
}
