// The timeline of a clip: the verdict of every frame, pan, tilt and zoom over time, cuts, and what a new solution changes.

import { element, shownNumber } from "./dom.js";
import { VERDICTS, paintVerdict } from "./verdict.js";

// what is plotted; `least` is the smallest range of values that fills a row, so that noise looks like noise
const ROWS = [
  { column: "pan", words: "pan", unit: "°", digits: 1, least: () => 1 },
  { column: "tilt", words: "tilt", unit: "°", digits: 1, least: () => 1 },
  { column: "focal_length", words: "zoom", unit: " px", digits: 0, least: (f) => 0.05 * f },
];
const WORST = ["good", "", "check", "reject"]; // of several frames in one column of pixels the last one is shown
const HEIGHTS = { good: 0.34, "": 0.5, check: 0.67, reject: 1 }; // of the bar: told without colours too
const GRAB = 6; // CSS pixels beside a cut that still drag it

/** The timeline, in an element that it fills. Columns as of `api/frames`. */
export class Timeline {
  constructor(root, { open, moveCut = null }) {
    this.root = root;
    this.open = open;
    this.moveCut = moveCut;
    this.current = 0;
    this.cuts = [];
    this.changes = null;
    this.canvas = element("canvas", { class: "timeline", role: "slider", tabindex: "0", "aria-label": "Frame", "aria-valuemin": "0" });
    root.append(this.canvas);
    new ResizeObserver(() => this.measure()).observe(root);
    this.canvas.addEventListener("pointerdown", (event) => this.press(event));
    this.canvas.addEventListener("pointermove", (event) => this.move(event));
    this.canvas.addEventListener("pointerup", () => this.release());
    this.canvas.addEventListener("pointercancel", () => (this.dragged = null));
    this.canvas.addEventListener("pointerleave", () => this.hover(null));
    this.measure();
  }

  /** Show the columns of all frames, and the first frames of shots. */
  show(frames, { rate = null, cuts = [] } = {}) {
    this.frames = frames;
    this.rate = rate;
    this.cuts = cuts;
    this.canvas.dataset.cuts = cuts.join(" ");
    this.canvas.setAttribute("aria-valuemax", String(Math.max(frames.verdict.length - 1, 0)));
    this.prepare();
  }

  setCurrent(number) {
    this.current = number;
    this.canvas.setAttribute("aria-valuenow", String(number));
    this.canvas.setAttribute("aria-valuetext", `frame ${number}${this.rate ? `, ${time(number, this.rate)}` : ""}`);
    this.draw();
  }

  /** Show how far a new solution moves the picture in each frame: {frames, pixels}. */
  setChanges(changes) {
    this.changes = changes;
    this.prepare();
  }

  measure() {
    const ratio = window.devicePixelRatio || 1;
    [this.width, this.height, this.ratio] = [this.root.clientWidth, this.root.clientHeight, ratio];
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    this.unit = parseFloat(getComputedStyle(document.documentElement).fontSize) / 14;
    this.prepare();
  }

  get left() {
    return 74 * this.unit;
  }

  get plotWidth() {
    return Math.max(this.width - this.left - 12 * this.unit, 1);
  }

  /** The number of columns of pixels is bounded, so each keeps the range of its frames: drawn often, made once. */
  prepare() {
    if (!this.frames || !this.width) return;
    const count = this.frames.verdict.length;
    const bins = Math.max(1, Math.min(count, Math.floor(this.plotWidth)));
    const bin = (number) => Math.min(bins - 1, Math.floor((number * bins) / count));
    this.bins = bins;
    this.worst = new Array(bins).fill("good");
    this.hand = new Set();
    this.frames.verdict.forEach((verdict, number) => {
      const known = verdict in VERDICTS ? verdict : "";
      const k = bin(number);
      if (WORST.indexOf(known) > WORST.indexOf(this.worst[k])) this.worst[k] = known;
      if (this.frames.by_hand?.[number]) this.hand.add(k);
    });
    this.ranges = ROWS.map(({ column, least }) => rangesOf(this.frames[column] ?? [], bins, bin, least));
    this.moved = new Array(bins).fill(0);
    this.changes?.frames.forEach((number, k) => {
      this.moved[bin(number)] = Math.max(this.moved[bin(number)], this.changes.pixels[k] ?? 0);
    });
    this.draw();
  }

  x(number) {
    return this.left + ((number + 0.5) / Math.max(this.frames.verdict.length, 1)) * this.plotWidth;
  }

  draw() {
    if (!this.frames || !this.ranges) return;
    const context = this.canvas.getContext("2d");
    const style = getComputedStyle(this.root);
    const colour = (name) => style.getPropertyValue(name).trim();
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    context.font = `${11 * this.unit}px ${style.fontFamily}`;
    context.textBaseline = "middle";
    const strip = 22 * this.unit;
    const axis = 15 * this.unit;
    this.drawVerdicts(context, colour, strip);
    const rowHeight = (this.height - strip - axis) / ROWS.length;
    this.ranges.forEach((ranges, k) => this.drawRow(context, colour, ROWS[k], ranges, strip + k * rowHeight, rowHeight));
    this.drawTimes(context, colour, this.height - axis / 2);
    this.drawCuts(context, colour, this.height - axis);
    this.drawCurrent(context, colour, strip);
  }

  drawVerdicts(context, colour, height) {
    const width = this.plotWidth / this.bins;
    const inner = height - 6 * this.unit;
    this.worst.forEach((verdict, k) => {
      const tall = inner * HEIGHTS[verdict];
      context.fillStyle = colour(VERDICTS[verdict].colour);
      const gap = width > 5 ? 1 : 0;
      context.fillRect(this.left + k * width, 3 * this.unit + inner - tall, width - gap, tall);
      if (this.hand.has(k)) {
        context.fillStyle = colour("--accent");
        const middle = this.left + (k + 0.5) * width;
        context.beginPath();
        context.moveTo(middle - 4 * this.unit, 0);
        context.lineTo(middle + 4 * this.unit, 0);
        context.lineTo(middle, 5 * this.unit);
        context.fill();
      }
      if (this.moved[k] > 0) {
        context.fillStyle = colour("--accent");
        context.fillRect(this.left + k * width, height - 2 * this.unit, Math.max(width, 1), 2 * this.unit);
      }
    });
    context.fillStyle = colour("--dim");
    context.textAlign = "left";
    context.fillText("verdict", 10 * this.unit, height / 2);
  }

  drawRow(context, colour, { column, words, unit, digits }, { low, high, bounds }, top, height) {
    const inner = height - 8 * this.unit;
    const y = (value) => top + 4 * this.unit + inner * (1 - (value - bounds[0]) / Math.max(bounds[1] - bounds[0], 1e-9));
    const width = this.plotWidth / this.bins;
    context.strokeStyle = colour("--rule");
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(this.left, top + 0.5);
    context.lineTo(this.left + this.plotWidth, top + 0.5);
    context.stroke();
    context.strokeStyle = colour("--curve");
    context.lineWidth = 1.5 * this.unit;
    context.lineJoin = "round";
    context.beginPath();
    let before = false;
    low.forEach((value, k) => {
      const known = Number.isFinite(value);
      const middle = this.left + (k + 0.5) * width;
      if (known) {
        if (before) context.lineTo(middle, y(value));
        else context.moveTo(middle - 0.5, y(value));
        context.lineTo(middle + 0.5, y(high[k]));
      }
      before = known;
    });
    context.stroke();
    const value = this.frames[column]?.[this.current];
    context.textAlign = "left";
    context.fillStyle = colour("--dim");
    context.fillText(words, 10 * this.unit, top + height / 2 - 7 * this.unit);
    context.fillStyle = colour("--text");
    context.fillText(Number.isFinite(value) ? shownNumber(value, digits) + unit : "–", 10 * this.unit, top + height / 2 + 7 * this.unit);
  }

  drawTimes(context, colour, y) {
    const count = this.frames.verdict.length;
    context.fillStyle = colour("--dim");
    const most = Math.max(2, Math.floor(this.plotWidth / (90 * this.unit)));
    const step = niceStep(count / most, this.rate);
    for (let number = 0; number < count; number += step) {
      context.textAlign = number === 0 ? "left" : "center";
      if (this.x(number) > this.left + this.plotWidth - 20 * this.unit) break;
      context.fillText(this.rate ? time(number, this.rate) : String(number), number ? this.x(number) : this.left, y);
    }
  }

  drawCuts(context, colour, bottom) {
    context.strokeStyle = colour("--text");
    context.lineWidth = 1.25 * this.unit;
    context.setLineDash([3 * this.unit, 3 * this.unit]);
    for (const start of this.cuts) {
      if (start === 0) continue;
      const x = this.x((this.dragged?.start === start ? this.dragged.to : start) - 0.5);
      context.beginPath();
      context.moveTo(x, 0);
      context.lineTo(x, bottom);
      context.stroke();
    }
    context.setLineDash([]);
  }

  drawCurrent(context, colour, strip) {
    const x = this.x(this.current);
    context.strokeStyle = colour("--accent");
    context.lineWidth = 1.5 * this.unit;
    context.beginPath();
    context.moveTo(x, strip);
    context.lineTo(x, this.height - 15 * this.unit);
    context.stroke();
    const verdict = this.frames.verdict[this.current] in VERDICTS ? this.frames.verdict[this.current] : "";
    context.fillStyle = colour("--panel");
    context.beginPath();
    context.arc(x, strip / 2, 9.5 * this.unit, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
    paintVerdict(context, verdict, x, strip / 2, 11 * this.unit, colour(VERDICTS[verdict].colour));
  }

  numberAt(event) {
    const share = (event.clientX - this.canvas.getBoundingClientRect().left - this.left) / this.plotWidth;
    return Math.min(Math.max(Math.floor(share * this.frames.verdict.length), 0), this.frames.verdict.length - 1);
  }

  cutAt(event) {
    const x = event.clientX - this.canvas.getBoundingClientRect().left;
    return this.moveCut ? this.cuts.find((start) => start > 0 && Math.abs(this.x(start - 0.5) - x) < GRAB * this.unit) : undefined;
  }

  press(event) {
    if (!this.frames || event.button !== 0) return;
    this.canvas.setPointerCapture(event.pointerId);
    const start = this.cutAt(event);
    this.dragged = start === undefined ? { seeking: true } : { start, to: start };
    if (this.dragged.seeking) this.open(this.numberAt(event));
  }

  move(event) {
    if (!this.frames) return;
    if (this.dragged?.seeking) this.open(this.numberAt(event));
    else if (this.dragged) {
      this.dragged.to = Math.max(1, this.numberAt(event));
      this.draw();
    } else this.hover(event);
  }

  hover(event) {
    this.canvas.style.cursor = event && this.cutAt(event) !== undefined ? "ew-resize" : "pointer";
  }

  release() {
    const dragged = this.dragged;
    this.dragged = null;
    if (dragged && !dragged.seeking && dragged.to !== dragged.start) this.moveCut(dragged.start, dragged.to);
  }
}

function rangesOf(column, bins, bin, least) {
  const low = new Array(bins).fill(NaN);
  const high = new Array(bins).fill(NaN);
  let bounds = [Infinity, -Infinity];
  column.forEach((value, number) => {
    if (!Number.isFinite(value)) return;
    const k = bin(number);
    low[k] = Number.isNaN(low[k]) ? value : Math.min(low[k], value);
    high[k] = Number.isNaN(high[k]) ? value : Math.max(high[k], value);
    bounds = [Math.min(bounds[0], value), Math.max(bounds[1], value)];
  });
  if (bounds[0] > bounds[1]) return { low, high, bounds: [0, 1] };
  const middle = (bounds[0] + bounds[1]) / 2;
  const half = Math.max(bounds[1] - bounds[0], least(middle)) / 2;
  return { low, high, bounds: [middle - half, middle + half] };
}

/** Hours, minutes and seconds of a frame. */
export function time(number, rate) {
  const seconds = Math.floor(number / rate);
  const [hours, minutes, rest] = [Math.floor(seconds / 3600), Math.floor(seconds / 60) % 60, seconds % 60];
  const two = (value) => String(value).padStart(2, "0");
  return hours ? `${hours}:${two(minutes)}:${two(rest)}` : `${minutes}:${two(rest)}`;
}

function niceStep(least, rate) {
  const unit = rate ?? 1;
  const steps = rate ? [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800] : [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 20000];
  return Math.max(1, Math.round(unit * (steps.find((step) => step * unit >= least) ?? steps.at(-1))));
}
