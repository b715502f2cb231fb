// The pointer over the picture, and that of the keyboard: set marks by a click or along a stroke, drag, select, rubber band, zoom and pan.

const STROKE = 7; // CSS pixels that a press may move and still be a click
const SPACING = 70; // CSS pixels between the marks of a stroke
const MOST = 6; // marks of a stroke
const RING = 13; // CSS pixels around the place of the next mark

/** Pointer handling over a `Picture`. `actions` does what the person means; see app.js. */
export class Pointing {
  constructor(picture, actions) {
    this.picture = picture;
    this.actions = actions;
    this.gesture = null;
    this.at = null; // where the pointer is, in the box
    this.cursor = null; // where that of the keyboard is, in the picture
    const canvas = picture.lines;
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.release(event));
    canvas.addEventListener("pointercancel", () => this.cancel());
    canvas.addEventListener("pointerleave", () => this.leave());
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    picture.drawings.push((context) => this.draw(context));
  }

  place(event) {
    const box = this.picture.lines.getBoundingClientRect();
    return { x: event.clientX - box.left, y: event.clientY - box.top };
  }

  press(event) {
    if (!this.picture.frame) return;
    this.picture.lines.setPointerCapture(event.pointerId);
    this.picture.lines.focus({ preventScroll: true });
    this.setCursor(null);
    this.begin(event, this.place(event));
  }

  begin(event, at) {
    this.gesture = { ...this.beginning(event, at), from: at, last: at, moved: false };
  }

  /** What a press begins. */
  beginning(event, at) {
    const { actions, picture } = this;
    if (event.button !== 0) return { kind: "pan" };
    if (actions.tool !== "mark") return { kind: "measure", path: [picture.view.toPicture(at)] };
    const number = this.markAt(at);
    if (number >= 0) {
      if (event.shiftKey) actions.select(toggled(picture.selected, number));
      else if (!picture.selected.has(number)) actions.select([number]);
      return { kind: "drag", marks: actions.marks };
    }
    if (event.shiftKey) return { kind: "band", before: [...picture.selected] };
    const label = actions.chosen ?? this.nextAt(at);
    if (label && picture.view.isInside(picture.view.toPicture(at))) return { kind: "stroke", label, path: [at] };
    return { kind: "pan", clears: true };
  }

  /** The mark under the pointer; while a marking is chosen, of that one, so that marks can be set where lines cross. */
  markAt(at) {
    const { actions, picture } = this;
    return actions.tool === "mark" && picture.layers.marks ? picture.markAt(at, actions.chosen) : -1;
  }

  nextAt(at) {
    const { frame, view, unit, layers } = this.picture;
    if (!frame.next || !layers.marks) return null;
    const { x, y } = view.toBox(frame.next.x, frame.next.y);
    return Math.hypot(x - at.x, y - at.y) < RING * unit ? frame.next.label : null;
  }

  move(event) {
    this.moveTo(this.place(event));
  }

  moveTo(at) {
    this.at = at;
    const { gesture, picture } = this;
    if (!gesture) return this.hover(at);
    gesture.moved ||= Math.hypot(at.x - gesture.from.x, at.y - gesture.from.y) > (gesture.kind === "pan" ? 2 : STROKE / 2);
    if (gesture.kind === "pan" && gesture.moved) {
      picture.view.pan(at.x - gesture.last.x, at.y - gesture.last.y);
      picture.moved();
    } else if (gesture.kind === "drag" && gesture.moved) {
      this.actions.preview(this.dragged(gesture, at));
    } else if (gesture.kind === "stroke") {
      gesture.path.push(at);
      picture.drawLines();
    } else if (gesture.kind === "band") {
      this.actions.select([...new Set([...gesture.before, ...this.inBand(gesture.from, at)])]);
    } else if (gesture.kind === "measure") {
      gesture.path[1] = picture.view.toPicture(at);
      this.actions.measuring(gesture.path, gesture.moved);
    }
    gesture.last = at;
    return undefined;
  }

  release(event) {
    if (this.gesture) this.end(this.place(event), this.actions.snap !== event.altKey);
  }

  end(at, snap) {
    const { gesture } = this;
    this.gesture = null;
    if (gesture.kind === "drag" && gesture.moved) this.actions.moveMarks(this.dragged(gesture, at), snap);
    else if (gesture.kind === "stroke") this.actions.addMarks(gesture.label, this.marksOfStroke([...gesture.path, at]), snap);
    else if (gesture.kind === "pan" && gesture.clears && !gesture.moved) this.clickBeside(at);
    else if (gesture.kind === "measure") this.actions.measure(gesture.path, gesture.moved);
    this.picture.drawLines();
    this.hover(at);
  }

  /** A click on no mark, with no marking chosen: the marking under it becomes the chosen one. */
  clickBeside(at) {
    this.actions.select([]);
    const label = this.picture.curveAt(at);
    const xy = this.picture.view.toPicture(at);
    if (label) this.actions.choose(label);
    else if (this.picture.view.isInside(xy)) this.actions.ask(xy);
  }

  cancel() {
    if (this.gesture?.kind === "drag") this.actions.preview(null);
    if (!this.gesture) this.setCursor(null);
    this.gesture = null;
    this.picture.drawLines();
  }

  // The pointer of the keyboard

  setCursor(place) {
    const changes = Boolean(place) !== Boolean(this.cursor);
    this.cursor = place;
    if (changes) this.actions.pointed();
  }

  /** Begin the pointer of the keyboard where the next mark would help, or in the middle of the view; do there what a click does. */
  enter() {
    const { picture, actions, gesture } = this;
    const { frame, view } = picture;
    if (!frame || !picture.base) return;
    if (!this.cursor) {
      const { next } = frame;
      this.setCursor(next && (actions.chosen ?? next.label) === next.label ? next : view);
      picture.lines.focus({ preventScroll: true });
      this.moveCursor(0, 0);
      return;
    }
    const at = view.toBox(this.cursor.x, this.cursor.y);
    if (!gesture) this.begin({ button: 0 }, at);
    if (gesture || actions.tool !== "ruler") this.end(at, actions.snap); // a ruler has a beginning and an end
  }

  /** Move it by CSS pixels; what leaves the view is followed. */
  moveCursor(dx, dy) {
    const { view } = this.picture;
    const { width, height } = view.picture;
    const x = Math.min(Math.max(this.cursor.x + dx / view.zoom, 0), width - 1);
    const y = Math.min(Math.max(this.cursor.y + dy / view.zoom, 0), height - 1);
    this.cursor = { x, y };
    this.picture.lines.dataset.cursor = `${x},${y}`; // for who waits for it
    const seen = view.toBox(x, y);
    if (seen.x < 0 || seen.y < 0 || seen.x > view.box.width || seen.y > view.box.height) {
      view.centre(x, y);
      this.picture.moved();
    }
    this.moveTo(view.toBox(x, y));
    this.picture.drawLines();
  }

  leave() {
    this.at = null;
    this.actions.hover(null);
    this.picture.drawLines();
  }

  dragged({ from, marks }, at) {
    const { zoom } = this.picture.view;
    const [dx, dy] = [(at.x - from.x) / zoom, (at.y - from.y) / zoom];
    return Object.fromEntries([...this.picture.selected].map((number) => [number, [marks[number].x + dx, marks[number].y + dy]]));
  }

  inBand(a, b) {
    const inside = (value, one, two) => value >= Math.min(one, two) && value <= Math.max(one, two);
    const found = [];
    this.picture.frame.marks.forEach((mark, number) => {
      const { x, y } = this.picture.view.toBox(mark.x, mark.y);
      if (inside(x, a.x, b.x) && inside(y, a.y, b.y)) found.push(number);
    });
    return found;
  }

  /** Places evenly along a stroke; one for a click. */
  marksOfStroke(path) {
    const { view, unit } = this.picture;
    const steps = path.slice(1).map((point, k) => Math.hypot(point.x - path[k].x, point.y - path[k].y));
    const total = steps.reduce((sum, step) => sum + step, 0);
    const chord = Math.hypot(path.at(-1).x - path[0].x, path.at(-1).y - path[0].y);
    const count = chord < STROKE * unit ? 1 : Math.min(MOST, Math.max(2, 1 + Math.round(total / (SPACING * unit))));
    const places = count === 1 ? [path[0]] : Array.from({ length: count }, (_, k) => alongPath(path, steps, (total * k) / (count - 1)));
    return places.map((point) => view.toPicture(point)).filter((point) => view.isInside(point)).map(({ x, y }) => [x, y]);
  }

  hover(at) {
    const { picture, actions } = this;
    if (!picture.frame) return;
    const number = this.markAt(at);
    const next = number < 0 && actions.tool === "mark" ? this.nextAt(at) : null;
    const label = number < 0 ? picture.curveAt(at) : null;
    picture.lines.style.cursor = actions.tool !== "mark" || (actions.chosen && number < 0) ? "crosshair" : number >= 0 || label || next ? "pointer" : "grab";
    actions.hover({ number, label, next, at: picture.view.toPicture(at) });
    this.words = actions.tool === "mark" ? this.wordsFor(number, label, next) : null; // metres stand there
    picture.drawLines();
  }

  wordsFor(number, label, next) {
    const { frame } = this.picture;
    if (number >= 0) {
      const mark = frame.marks[number];
      const off = Number.isFinite(mark.error) ? `, ${mark.error.toFixed(1)} px off` : "";
      return mark.suspect ? `${mark.label}?${mark.fits ? ` Fits ${mark.fits}` : " The others contradict it"}${off}` : mark.label + (mark.left_out ? ", left out as stray" : "") + off;
    }
    if (next) return `A mark here helps most: ${next}, −${Math.round(100 * frame.next.gain)} % error`;
    return label;
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    const speed = event.ctrlKey ? 0.01 : 0.0012;
    this.picture.view.zoomBy(Math.exp(-event.deltaY * lines * speed), this.place(event));
    this.picture.moved();
  }

  draw(context) {
    const { gesture, picture } = this;
    const unit = picture.unit;
    if (this.cursor) drawCross(context, unit, picture.view.toBox(this.cursor.x, this.cursor.y));
    context.strokeStyle = picture.colour("--accent");
    if (gesture?.kind === "band") {
      context.setLineDash([4 * unit, 3 * unit]);
      context.lineWidth = 1.25 * unit;
      context.strokeRect(gesture.from.x, gesture.from.y, gesture.last.x - gesture.from.x, gesture.last.y - gesture.from.y);
      context.setLineDash([]);
    } else if (gesture?.kind === "stroke" && gesture.path.length > 1) {
      context.lineWidth = 2 * unit;
      context.beginPath();
      gesture.path.forEach(({ x, y }, k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.stroke();
    } else if (!gesture && this.at && this.words) {
      picture.drawText(context, this.words, this.at.x, this.at.y);
    }
  }
}

/** Cross hairs around a place of the box. */
function drawCross(context, unit, { x, y }) {
  for (const [stroke, width] of [["rgba(8, 12, 16, 0.75)", 4], ["#fff", 1.75]]) {
    context.strokeStyle = stroke;
    context.lineWidth = width * unit;
    context.beginPath();
    for (const [across, down] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(x + 5 * unit * across, y + 5 * unit * down);
      context.lineTo(x + 18 * unit * across, y + 18 * unit * down);
    }
    context.stroke();
  }
}

function toggled(selected, number) {
  return selected.has(number) ? [...selected].filter((one) => one !== number) : [...selected, number];
}

function alongPath(path, steps, distance) {
  let left = distance;
  for (let k = 0; k < steps.length; k++) {
    if (steps[k] >= left && steps[k] > 0) {
      const share = left / steps[k];
      return { x: path[k].x + share * (path[k + 1].x - path[k].x), y: path[k].y + share * (path[k + 1].y - path[k].y) };
    }
    left -= steps[k];
  }
  return path.at(-1);
}
