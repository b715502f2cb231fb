// The part of a picture that is on the screen. The middle of the first pixel is (0, 0), as everywhere in fieldcalib.

const LARGEST = 64; // screen pixels for one of the picture

/** Scale and place of a picture in a box of CSS pixels. `scale` counts screen pixels for one of the picture: 1 is 100 %. */
export class View {
  constructor() {
    this.picture = { width: 1, height: 1 };
    this.box = { width: 1, height: 1 };
    this.ratio = 1; // screen pixels for a CSS pixel
    this.scale = 1;
    this.x = 0; // the picture's place in the middle of the box
    this.y = 0;
    this.fitted = true;
  }

  /** CSS pixels for one of the picture. */
  get zoom() {
    return this.scale / this.ratio;
  }

  get fitting() {
    return this.ratio * Math.min(this.box.width / this.picture.width, this.box.height / this.picture.height);
  }

  /** Take over the size of the box; what was fitted stays fitted. */
  resize(width, height, ratio) {
    this.box = { width: Math.max(width, 1), height: Math.max(height, 1) };
    this.scale *= ratio / this.ratio;
    this.ratio = ratio;
    if (this.fitted) this.fit();
    else this.keepInside();
  }

  /** Another picture: the same size keeps its place, so that frames of a clip can be compared. */
  setPicture(width, height) {
    if (width === this.picture.width && height === this.picture.height) return;
    this.picture = { width, height };
    this.fit();
  }

  fit() {
    this.scale = this.fitting;
    this.x = (this.picture.width - 1) / 2;
    this.y = (this.picture.height - 1) / 2;
    this.fitted = true;
  }

  /** Scale by a factor, or to a scale, with a point of the box at its place. */
  zoomBy(factor, at = { x: this.box.width / 2, y: this.box.height / 2 }) {
    this.zoomTo(this.scale * factor, at);
  }

  zoomTo(scale, at = { x: this.box.width / 2, y: this.box.height / 2 }) {
    const before = this.toPicture(at);
    this.scale = Math.min(Math.max(scale, Math.min(this.fitting, 1)), LARGEST);
    this.fitted = this.scale <= this.fitting * 1.0001;
    if (this.fitted) return this.fit();
    const after = this.toPicture(at);
    this.x += before.x - after.x;
    this.y += before.y - after.y;
    return this.keepInside();
  }

  /** Move by CSS pixels. */
  pan(dx, dy) {
    this.x -= dx / this.zoom;
    this.y -= dy / this.zoom;
    this.keepInside();
  }

  centre(x, y) {
    this.x = x;
    this.y = y;
    this.keepInside();
  }

  keepInside() {
    for (const [axis, size] of [["x", "width"], ["y", "height"]]) {
      const half = this.box[size] / this.zoom / 2;
      const [low, high] = [half - 0.5, this.picture[size] - 0.5 - half];
      this[axis] = low > high ? (this.picture[size] - 1) / 2 : Math.min(Math.max(this[axis], low), high);
    }
  }

  /** From the picture to CSS pixels of the box. */
  toBox(x, y) {
    return { x: (x - this.x) * this.zoom + this.box.width / 2, y: (y - this.y) * this.zoom + this.box.height / 2 };
  }

  /** From CSS pixels of the box to the picture. */
  toPicture({ x, y }) {
    return { x: (x - this.box.width / 2) / this.zoom + this.x, y: (y - this.box.height / 2) / this.zoom + this.y };
  }

  isInside({ x, y }) {
    return x >= -0.5 && y >= -0.5 && x <= this.picture.width - 0.5 && y <= this.picture.height - 0.5;
  }

  /** The whole pixels of the picture in view, with a margin as a share of them. */
  visible(margin = 0) {
    const half = { x: (this.box.width / this.zoom) * (0.5 + margin), y: (this.box.height / this.zoom) * (0.5 + margin) };
    const left = Math.max(0, Math.floor(this.x + 0.5 - half.x));
    const top = Math.max(0, Math.floor(this.y + 0.5 - half.y));
    const right = Math.min(this.picture.width, Math.ceil(this.x + 0.5 + half.x));
    const bottom = Math.min(this.picture.height, Math.ceil(this.y + 0.5 + half.y));
    return { x: left, y: top, w: Math.max(right - left, 1), h: Math.max(bottom - top, 1) };
  }
}
