// A picture with what is known of it drawn over it: projected markings, marks, the horizon, the mark that would help most.
//
// Two canvases: pixels below, drawings above. Needs no server: a source says where pixels come from,
//   {width, height, whole(width) -> address, crop({x, y, w, h}, width) -> address | null}

import { element } from "./dom.js";
import { View } from "./view.js";

const WIDTHS = [640, 960, 1280, 1920, 2560, 3840, 5120]; // of the whole picture: few, so that they are cached
const CROPS = 6; // kept
const SHARP = 3; // screen pixels for one of the picture from which single pixels are shown
const HIT = 10; // CSS pixels from a mark that still are a click on it
const SETTLED = 90; // ms without a movement of the view, before a crop is fetched

/** Colours, widths and dashes of projected markings by their state, and what the state means. */
export const CURVES = {
  paint: { words: "on paint", colour: "--good", dash: [] },
  beside: { words: "beside paint", colour: "--reject", dash: [9, 5] },
  unseen: { words: "no paint seen", colour: "--faint", dash: [2, 5] },
  plain: { words: "projected", colour: "--plain", dash: [] },
};

/** Fetch and decode an image. */
export async function loadImage(address) {
  const image = new Image();
  image.src = address;
  await image.decode();
  return image;
}

/** The picture, in an element that it fills. */
export class Picture {
  constructor(root) {
    this.root = root;
    this.view = new View();
    this.layers = { markings: true, horizon: false, marks: true };
    this.measuring = false; // then marks are hidden
    this.texts = []; // places of the texts that are drawn
    this.errors = []; // quadrilaterals of the ground, coloured by how far it may be off
    this.proposed = []; // curves of another camera, drawn over those of the frame
    this.drawings = []; // functions of (context, picture) that draw on top
    this.pixels = element("canvas", { class: "picture-pixels", "aria-hidden": "true" });
    this.lines = element("canvas", { class: "picture-lines", tabindex: "0", role: "application", "aria-label": "Picture with the projected field; Enter puts a pointer on it that arrow keys move" });
    root.append(this.pixels, this.lines);
    this.frame = null;
    this.source = null;
    this.base = null;
    this.crops = [];
    this.selected = new Set();
    this.emphasized = null; // a label
    this.onview = () => {};
    this.resizing = new ResizeObserver(() => this.measure());
    this.resizing.observe(root);
    this.measure();
  }

  measure() {
    const { clientWidth: width, clientHeight: height } = this.root;
    const ratio = window.devicePixelRatio || 1;
    for (const canvas of [this.pixels, this.lines]) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    this.view.resize(width, height, ratio);
    this.colours = this.scaleOfText = null;
    this.moved();
  }

  /** Fetch the whole picture of a source at the size of the screen. */
  async load(source) {
    const wanted = Math.min(this.view.box.width, (this.view.box.height * source.width) / source.height) * this.view.ratio;
    const width = WIDTHS.find((one) => one >= wanted) ?? WIDTHS.at(-1);
    return { source, image: await loadImage(source.whole(Math.min(width, source.width))) };
  }

  /** Show what `load` fetched, with the state of its frame. */
  show({ source, image }, frame) {
    const same = this.source && this.source.key === source.key;
    this.source = source;
    this.base = image;
    if (!same) this.crops = [];
    this.view.setPicture(source.width, source.height);
    this.frame = frame;
    this.moved();
  }

  /** Show another state of the same frame. */
  update(frame) {
    this.frame = frame;
    this.drawLines();
  }

  clear() {
    this.source = this.base = this.frame = null;
    this.crops = [];
    for (const name of ["frame", "revision"]) delete this.lines.dataset[name];
    this.draw();
  }

  /** Redraw after the view changed, and fetch pixels where those at hand are too coarse. */
  moved() {
    this.draw();
    this.onview(this.view);
    clearTimeout(this.settling);
    this.settling = setTimeout(() => this.sharpen(), SETTLED);
  }

  async sharpen() {
    const { view, source } = this;
    if (!source || !this.base || !source.crop) return;
    const detail = Math.min(view.scale, 1);
    if (this.base.naturalWidth >= 0.95 * source.width * detail) return;
    const seen = view.visible();
    if (this.crops.some((crop) => crop.detail >= 0.95 * detail && contains(crop.part, seen))) return;
    const part = view.visible(0.2);
    try {
      const image = await loadImage(source.crop(part, Math.ceil(part.w * detail)));
      if (this.source !== source) return;
      this.crops = [...this.crops.slice(1 - CROPS), { part, image, detail }];
      this.drawPixels();
    } catch {
      // the whole picture stays: coarse, and not wrong
    }
  }

  draw() {
    this.drawPixels();
    this.drawLines();
  }

  drawPixels() {
    const context = this.pixels.getContext("2d", { alpha: false });
    const { view } = this;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = this.colour("--stage");
    context.fillRect(0, 0, this.pixels.width, this.pixels.height);
    if (!this.base) return;
    context.setTransform(view.ratio, 0, 0, view.ratio, 0, 0);
    context.imageSmoothingEnabled = view.scale < SHARP;
    context.imageSmoothingQuality = "high";
    this.paint(context, this.base, { x: 0, y: 0, w: this.source.width, h: this.source.height });
    for (const { image, part } of this.crops) this.paint(context, image, part);
    this.pixels.dataset.crops = this.crops.length;
  }

  paint(context, image, { x, y, w, h }) {
    const corner = this.view.toBox(x - 0.5, y - 0.5);
    context.drawImage(image, corner.x, corner.y, w * this.view.zoom, h * this.view.zoom);
  }

  drawLines() {
    const context = this.lines.getContext("2d");
    context.setTransform(this.view.ratio, 0, 0, this.view.ratio, 0, 0);
    context.clearRect(0, 0, this.view.box.width, this.view.box.height);
    context.lineJoin = context.lineCap = "round";
    if (this.frame && this.base) {
      context.save();
      context.beginPath(); // markings end with the picture
      const corner = this.view.toBox(-0.5, -0.5);
      context.rect(corner.x, corner.y, this.source.width * this.view.zoom, this.source.height * this.view.zoom);
      context.clip();
      this.drawErrors(context);
      if (this.layers.horizon && this.frame.horizon) this.drawCurve(context, this.frame.horizon, { colour: "--accent", dash: [12, 6] });
      if (this.layers.markings) this.drawMarkings(context);
      for (const { points } of this.proposed) this.drawCurve(context, points, { colour: "--accent", dash: [6, 4], width: 1.5 });
      context.restore();
      const shows = this.layers.marks && !this.measuring; // marks and numbers of metres would cover one another
      if (shows) this.drawMarks(context);
      if (shows && this.frame.next) this.drawNext(context);
      this.texts = [];
      for (const draw of this.drawings) draw(context, this);
      const { dataset } = this.lines; // what is on the screen, for who waits for it
      dataset.frame = this.frame.number;
      dataset.revision = this.frame.revision;
      dataset.pending = this.frame.pending ?? 0;
      dataset.judged = this.frame.judged;
      dataset.view = [this.view.x, this.view.y, this.view.zoom].join();
    }
  }

  drawErrors(context) {
    context.globalAlpha = 0.5;
    for (const { points, colour } of this.errors) {
      context.beginPath();
      for (const { x, y } of points.map(([x, y]) => this.view.toBox(x, y))) context.lineTo(x, y);
      context.fillStyle = colour;
      context.fill();
    }
    context.globalAlpha = 1;
  }

  drawMarkings(context) {
    for (const curve of this.frame.curves) {
      if (curve.label !== this.emphasized) this.drawCurve(context, curve.points, CURVES[curve.state] ?? CURVES.plain);
    }
    for (const curve of this.frame.curves) {
      if (curve.label === this.emphasized) this.drawCurve(context, curve.points, { colour: "--accent", dash: [], width: 3 });
    }
  }

  /** Draw a polyline of the picture, dark below so that it is seen on grass and on snow. */
  drawCurve(context, points, { colour, dash = [], width = 1.75 }) {
    if (points.length < 2) return;
    context.beginPath();
    points.forEach(([x, y], number) => {
      const place = this.view.toBox(x, y);
      if (number) context.lineTo(place.x, place.y);
      else context.moveTo(place.x, place.y);
    });
    const unit = this.unit;
    context.setLineDash([]);
    context.strokeStyle = "rgba(8, 12, 16, 0.42)";
    context.lineWidth = (width + 1.75) * unit;
    context.stroke();
    context.setLineDash(dash.map((part) => part * unit));
    context.strokeStyle = this.colour(colour);
    context.lineWidth = width * unit;
    context.stroke();
    context.setLineDash([]);
  }

  drawMarks(context) {
    this.frame.marks.forEach((mark, number) => {
      const { x, y } = this.view.toBox(mark.x, mark.y);
      const selected = this.selected.has(number);
      const colour = mark.suspect ? "--reject" : selected || mark.label === this.emphasized ? "--accent" : "--mark";
      this.drawMark(context, x, y, { colour, selected, suspect: mark.suspect, leftOut: mark.left_out, pending: mark.pending, faint: mark.by_hand === false });
    });
  }

  drawMark(context, x, y, { colour, selected = false, suspect = false, leftOut = false, pending = false, faint = false }) {
    const unit = this.unit;
    const outline = new Path2D();
    if (suspect) {
      outline.moveTo(x, y - 8 * unit);
      outline.lineTo(x + 7 * unit, y + 5 * unit);
      outline.lineTo(x - 7 * unit, y + 5 * unit);
      outline.closePath();
    } else if (leftOut) {
      const arm = 4.5 * unit;
      outline.moveTo(x - arm, y - arm);
      outline.lineTo(x + arm, y + arm);
      outline.moveTo(x - arm, y + arm);
      outline.lineTo(x + arm, y - arm);
    } else {
      outline.arc(x, y, (faint ? 4 : 5.5) * unit, 0, 2 * Math.PI);
    }
    context.globalAlpha = faint && !selected && !suspect ? 0.7 : 1;
    if (selected) {
      context.fillStyle = "rgba(110, 168, 254, 0.35)";
      context.beginPath();
      context.arc(x, y, 11 * unit, 0, 2 * Math.PI);
      context.fill();
    }
    context.strokeStyle = "rgba(8, 12, 16, 0.75)";
    context.lineWidth = 3.75 * unit;
    context.stroke(outline);
    context.strokeStyle = context.fillStyle = this.colour(colour);
    context.lineWidth = 1.75 * unit;
    context.setLineDash(pending ? [2.5 * unit, 2.5 * unit] : []);
    context.stroke(outline);
    context.setLineDash([]);
    context.beginPath();
    context.arc(x, y, 1.25 * unit, 0, 2 * Math.PI);
    context.fill();
    context.globalAlpha = 1;
  }

  drawNext(context) {
    const { x, y } = this.view.toBox(this.frame.next.x, this.frame.next.y);
    const unit = this.unit;
    for (const [colour, width] of [["rgba(8, 12, 16, 0.6)", 4], [this.colour("--accent"), 2]]) {
      context.strokeStyle = colour;
      context.lineWidth = width * unit;
      context.setLineDash([4 * unit, 4 * unit]);
      context.beginPath();
      context.arc(x, y, 12 * unit, 0, 2 * Math.PI);
      context.stroke();
    }
    context.setLineDash([]);
  }

  /** Text on a dark ground near a place of the box, if that is in view. */
  drawText(context, words, x, y) {
    const unit = this.unit;
    if (x < 0 || y < 0 || x > this.view.box.width || y > this.view.box.height) return;
    context.font = `${12 * unit}px ${getComputedStyle(this.root).fontFamily}`;
    const width = context.measureText(words).width + 12 * unit;
    const left = Math.min(Math.max(x + 12 * unit, 4), this.view.box.width - width - 4);
    let top = Math.min(Math.max(y - 30 * unit, 4), this.view.box.height - 26 * unit);
    const covers = (text) => left < text.left + text.width && text.left < left + width && Math.abs(text.top - top) < 23 * unit;
    for (let text = this.texts.find(covers); text; text = this.texts.find(covers)) top = text.top + 24 * unit; // below it
    this.texts.push({ left, top, width });
    context.fillStyle = "rgba(13, 17, 22, 0.88)";
    context.beginPath();
    context.roundRect(left, top, width, 22 * unit, 4 * unit);
    context.fill();
    context.fillStyle = this.colour("--text");
    context.textBaseline = "middle";
    context.fillText(words, left + 6 * unit, top + 11.5 * unit);
  }

  /** Sizes grow with the text of the page. */
  get unit() {
    return this.scaleOfText ?? (this.scaleOfText = parseFloat(getComputedStyle(document.documentElement).fontSize) / 14);
  }

  colour(name) {
    this.colours ??= getComputedStyle(this.root);
    return this.colours.getPropertyValue(name).trim() || "#fff";
  }

  /** The number of the mark at a place of the box, of one label if it is given, or -1. */
  markAt(place, label = null) {
    let [found, least] = [-1, HIT * this.unit];
    (this.frame?.marks ?? []).forEach((mark, number) => {
      if (label !== null && mark.label !== label) return;
      const { x, y } = this.view.toBox(mark.x, mark.y);
      const distance = Math.hypot(x - place.x, y - place.y);
      if (distance <= least) [found, least] = [number, distance];
    });
    return found;
  }

  /** The label of the projected marking at a place of the box, or null. */
  curveAt(place) {
    let [found, least] = [null, 6 * this.unit];
    for (const { label, points } of this.layers.markings ? (this.frame?.curves ?? []) : []) {
      for (let k = 1; k < points.length; k++) {
        const distance = fromSegment(place, this.view.toBox(...points[k - 1]), this.view.toBox(...points[k]));
        if (distance < least) [found, least] = [label, distance];
      }
    }
    return found;
  }
}

function contains(outer, inner) {
  return outer.x <= inner.x && outer.y <= inner.y && outer.x + outer.w >= inner.x + inner.w && outer.y + outer.h >= inner.y + inner.h;
}

function fromSegment(point, a, b) {
  const [dx, dy] = [b.x - a.x, b.y - a.y];
  const share = Math.min(Math.max(((point.x - a.x) * dx + (point.y - a.y) * dy) / Math.max(dx * dx + dy * dy, 1e-9), 0), 1);
  return Math.hypot(a.x + share * dx - point.x, a.y + share * dy - point.y);
}
