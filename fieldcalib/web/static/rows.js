// Rows of frames in an element that scrolls. Only the rows in view exist, so that 90 000 frames are no burden.

import { element } from "./dom.js";

const SPARE = 6; // rows above and below those in view

/** The rows, in the order of `show`. `draw(number, place)` makes one, whose height is `height` rem. */
export class FrameRows {
  constructor(body, space, { height, empty, draw, open }) {
    this.body = body;
    this.space = space;
    this.rem = height;
    this.empty = empty;
    this.drawRow = draw;
    this.current = 0;
    this.order = null;
    this.place = new Map();
    body.addEventListener("scroll", () => this.draw());
    body.addEventListener("click", (event) => {
      const row = event.target.closest("[data-number]");
      if (row) open(Number(row.dataset.number));
    });
    new ResizeObserver(() => this.draw()).observe(body);
  }

  /** Show the frames of these numbers. */
  show(order) {
    this.order = order;
    this.place = new Map(order.map((number, row) => [number, row]));
    this.draw();
  }

  get height() {
    return this.rem * parseFloat(getComputedStyle(document.documentElement).fontSize);
  }

  draw() {
    if (!this.order) return;
    const height = this.height;
    this.space.style.height = `${height * this.order.length}px`;
    const first = Math.max(0, Math.floor(this.body.scrollTop / height) - SPARE);
    const last = Math.min(this.order.length, Math.ceil((this.body.scrollTop + this.body.clientHeight) / height) + SPARE);
    const rows = this.order.slice(first, last).map((number, k) => {
      const row = this.drawRow(number, first + k);
      row.style.top = `${(first + k) * height}px`;
      row.style.height = `${height}px`;
      return row;
    });
    if (!this.order.length) rows.push(element("p", { class: this.empty, text: "No frame has one of the chosen verdicts." }));
    this.space.replaceChildren(...rows);
  }

  /** Mark the frame that is shown, and scroll to it. */
  setCurrent(number) {
    this.current = number;
    this.reveal();
  }

  reveal() {
    const place = this.place.get(this.current);
    if (place !== undefined) {
      const [height, top, size] = [this.height, this.body.scrollTop, this.body.clientHeight];
      if (place * height < top || (place + 1) * height > top + size) this.body.scrollTop = (place + 0.5) * height - size / 2;
    }
    this.draw();
  }

  /** The frame so many rows further. */
  neighbour(step) {
    const place = this.place.get(this.current);
    if (place === undefined) return this.first;
    return this.order[Math.min(Math.max(place + step, 0), this.order.length - 1)];
  }

  /** The frame of the first row; the current one without rows. */
  get first() {
    return this.order?.[0] ?? this.current;
  }
}
