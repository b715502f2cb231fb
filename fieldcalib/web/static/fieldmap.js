// The map of the field from above, y down, with its goals seen from the field: choose a marking, see the part in view.

import { element, svgElement, shownNumber } from "./dom.js";

const HINT = "Click a marking, or type its letters. Point at it for its name.";
const NEAR = 11; // CSS pixels from a marking or a point that still are a click on it
const KEY_PLACES = [0.5, 0.32, 0.68, 0.18, 0.82, 0.42, 0.58]; // along a marking, where its key may be written
const KEY_PLACES_ROUND = [0.25, 0.75, ...KEY_PLACES]; // of a circle, whose halves have their keys at their middles
const GOAL_SHARE = 0.24; // of the width of the map, for each goal below it
// cividis: for colour-blind people, from small errors to large ones
const HEAT = [[0, 34, 78], [33, 62, 108], [87, 93, 109], [123, 122, 119], [165, 156, 116], [211, 193, 100], [254, 232, 56]];

/** The map, in an element as wide as it may be. */
export class FieldMap {
  constructor(root, { choose = null } = {}) {
    this.root = root;
    this.choose = choose;
    this.onhover = () => {};
    this.svg = svgElement("svg", { class: "fieldmap", role: choose ? "group" : "img", "aria-label": "Map of the field" });
    this.caption = element("div", { class: "map-caption dim small", "aria-live": "polite" });
    root.append(this.svg, this.caption);
    this.heat = svgElement("g", { class: "map-heat" });
    this.views = svgElement("polygon", { class: "map-view" });
    this.inside = svgElement("svg", {}, this.views); // what is outside of the map is cut off
    this.lines = svgElement("g");
    this.keys = svgElement("g", { class: "map-keys", "aria-hidden": "true" });
    this.places = svgElement("g", { class: "map-places" });
    this.chosen = null;
    this.hovered = null;
    this.parts = new Map();
    this.svg.addEventListener("pointermove", (event) => this.hover(this.labelAt(event)));
    this.svg.addEventListener("pointerleave", () => this.hover(null));
    if (choose) this.svg.addEventListener("click", (event) => choose(this.labelAt(event)));
  }

  /** Draw a field: {name, length, width, margin, segments: [{label, key, kind, points, group}]}. */
  draw(field) {
    this.field = field;
    const { length, width } = field;
    const margin = Math.max(0.06 * length, Math.min(field.margin ?? 0, 0.1 * length));
    this.unit = length / 105; // sizes in metres on a field of soccer's length
    const goals = goalsOf(field.segments);
    const [w, h] = [length + 2 * margin, width + 2 * margin];
    const goalHeight = goals.length ? 0.13 * w : 0;
    this.svg.setAttribute("viewBox", `${-w / 2} ${-h / 2} ${w} ${h + goalHeight}`);
    const ground = svgElement("rect", { class: "map-ground", x: -w / 2, y: -h / 2, width: w, height: h, rx: 1.5 * this.unit });
    for (const group of [this.heat, this.lines, this.keys, this.places]) group.replaceChildren();
    for (const [name, value] of Object.entries({ x: -w / 2, y: -h / 2, width: w, height: h, viewBox: `${-w / 2} ${-h / 2} ${w} ${h}` })) this.inside.setAttribute(name, value);
    this.svg.replaceChildren(ground, this.heat, this.inside, this.lines, this.keys, this.places);
    this.parts.clear();
    const onGround = field.segments.filter(({ group }) => group !== "goal").map((one) => [one, one.points.map(([x, y]) => [x, y])]);
    goals.forEach((goal, number) => this.placeGoal(goal, number, goals.length, { w, h, goalHeight }).forEach((one) => onGround.push(one)));
    for (const [segment, points] of onGround) this.addSegment(segment, points);
    this.writeKeys();
    this.caption.textContent = this.choose ? HINT : "";
  }

  /** Segments of a goal with their places below the map. */
  placeGoal({ side, segments }, number, count, { w, h, goalHeight }) {
    const across = (point) => (side < 0 ? -point[1] : point[1]); // as seen from the middle of the field
    const all = segments.flatMap(({ points }) => points);
    const [low, high] = [Math.min(...all.map(across)), Math.max(...all.map(across))];
    const top = Math.max(...all.map((point) => -point[2]), 0.1);
    const scale = Math.min((GOAL_SHARE * w) / Math.max(high - low, 0.1), (0.62 * goalHeight) / top);
    const middle = count === 1 ? 0 : side < 0 ? -w / 4 : side > 0 ? w / 4 : 0;
    const bottom = h / 2 + 0.86 * goalHeight;
    const half = (scale * (high - low)) / 2;
    this.lines.append(svgElement("line", { class: "map-turf", x1: middle - 1.5 * half, x2: middle + 1.5 * half, y1: bottom, y2: bottom }));
    return segments.map((one) => [
      one,
      one.points.map((point) => [middle + scale * (across(point) - (low + high) / 2), bottom + scale * point[2]]),
    ]);
  }

  addSegment(segment, points) {
    const isPoint = segment.kind === "point" || points.length === 1;
    const shape = isPoint
      ? svgElement("circle", { cx: points[0][0], cy: points[0][1], r: 0.75 * this.unit, class: "map-point" })
      : svgElement("path", { d: `M${points.map((point) => point.join(" ")).join("L")}`, class: "map-line" });
    const name = segment.key ? `${segment.label}, key ${segment.key.toUpperCase()}` : segment.label;
    const part = svgElement("g", { class: "map-segment", "data-label": segment.label }, shape);
    if (this.choose) {
      part.setAttribute("aria-label", name);
      part.setAttribute("role", "button");
      part.setAttribute("tabindex", this.parts.size ? "-1" : "0"); // one stop of Tab; arrow keys go on from there
      part.setAttribute("aria-pressed", "false");
      part.addEventListener("focus", () => this.hover(segment.label));
      part.addEventListener("blur", () => this.hover(null));
      part.addEventListener("keydown", (event) => this.press(event, segment.label));
    }
    this.lines.append(part);
    this.parts.set(segment.label, { segment, points, part, isPoint });
  }

  press(event, label) {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step && event.key !== "Enter" && event.key !== " ") return undefined;
    event.preventDefault();
    event.stopPropagation();
    if (!step) return this.choose(label);
    const labels = [...this.parts.keys()];
    const next = labels[(labels.indexOf(label) + step + labels.length) % labels.length];
    this.parts.get(label).part.setAttribute("tabindex", "-1");
    this.parts.get(next).part.setAttribute("tabindex", "0");
    return this.parts.get(next).part.focus();
  }

  /** Write the keys beside their markings, where they cover no other key. */
  writeKeys() {
    const size = 4.4 * this.unit;
    const taken = [];
    const free = ({ x, y }) => taken.every((one) => Math.abs(one.x - x) > 1.75 * size || Math.abs(one.y - y) > 1.15 * size);
    for (const { segment, points, part, isPoint } of this.parts.values()) {
      if (!segment.key || isPoint) continue;
      const [[x0, y0], [x1, y1]] = [points[0], points.at(-1)];
      const isRound = points.length > 2 && Math.hypot(x1 - x0, y1 - y0) < this.unit;
      const places = (isRound ? KEY_PLACES_ROUND : KEY_PLACES).map((share) => along(points, share));
      const place = places.find(free);
      if (!place) continue; // its key is in its name, shown on hover
      taken.push(place);
      part.key = svgElement(
        "g",
        { class: "map-key" },
        svgElement("rect", { x: place.x - 0.78 * size, y: place.y - 0.56 * size, width: 1.56 * size, height: 1.12 * size, rx: 0.25 * size }),
        svgElement("text", { x: place.x, y: place.y + 0.34 * size, "font-size": size, "text-anchor": "middle", text: segment.key.toUpperCase() }),
      );
      this.keys.append(part.key);
    }
  }

  /** Show the state of a frame: which markings have marks or doubts, and the part of the field in view. */
  show(frame) {
    const marked = new Map();
    for (const mark of frame?.marks ?? []) marked.set(mark.label, marked.get(mark.label) || mark.suspect);
    const states = new Map((frame?.curves ?? []).map(({ label, state }) => [label, state]));
    for (const [label, { part }] of this.parts) {
      part.classList.toggle("marked", marked.has(label));
      part.classList.toggle("suspect", Boolean(marked.get(label)));
      part.classList.toggle("beside", states.get(label) === "beside");
      part.classList.toggle("next", frame?.next?.label === label);
      part.key?.classList.toggle("marked", marked.has(label));
    }
    this.views.setAttribute("points", (frame?.view ?? []).map(([x, y]) => `${x},${y}`).join(" "));
  }

  /** Show which marking is chosen. */
  setChosen(label) {
    this.chosen = label;
    for (const [name, { part }] of this.parts) {
      part.classList.toggle("chosen", name === label);
      part.key?.classList.toggle("chosen", name === label);
      if (this.choose) part.setAttribute("aria-pressed", String(name === label));
    }
    this.describe();
  }

  hover(label) {
    if (label === this.hovered) return;
    this.parts.get(this.hovered)?.part.classList.remove("hovered");
    this.hovered = label;
    this.parts.get(label)?.part.classList.add("hovered");
    this.svg.style.cursor = label && this.choose ? "pointer" : "";
    this.describe();
    this.onhover(label);
  }

  describe() {
    const found = this.parts.get(this.hovered ?? this.chosen);
    if (found) {
      const { label, key } = found.segment;
      this.caption.replaceChildren(element("b", { text: label }), key ? element("kbd", { text: key.toUpperCase() }) : "");
    } else if (this.choose) {
      this.caption.textContent = HINT;
    }
  }

  labelAt(event) {
    const matrix = this.svg.getScreenCTM();
    if (!matrix) return null;
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
    const reach = NEAR / matrix.a;
    let [found, least] = [null, Infinity];
    for (const [label, { points, isPoint }] of this.parts) {
      const distance = isPoint ? Math.hypot(points[0][0] - at.x, points[0][1] - at.y) : fromLine(at, points);
      // a point lies on a marking, so it needs a closer click; of markings on each other the shorter one is meant
      if (distance > (isPoint ? 0.4 : 1) * reach) continue;
      const rank = distance + (isPoint ? -0.4 * reach : 0.002 * length(points));
      if (rank < least) [found, least] = [label, rank];
    }
    return found;
  }

  /** Colour the field by errors {x, y, metres: rows of y} or, without them, not. */
  showErrors(errors) {
    this.heat.replaceChildren();
    if (!errors?.metres) return null;
    const known = errors.metres.flat().filter((value) => Number.isFinite(value) && value > 0).sort((a, b) => a - b);
    if (!known.length) return null;
    const [low, high] = [known[0], Math.max(known[Math.floor(0.97 * (known.length - 1))], 1.2 * known[0])];
    const colourOf = (value) => heatColour(Math.min(Math.max(Math.log(value / low) / Math.log(high / low), 0), 1));
    const [dx, dy] = [errors.x[1] - errors.x[0], errors.y[1] - errors.y[0]];
    errors.metres.forEach((row, j) =>
      row.forEach((value, i) => {
        if (!Number.isFinite(value) || value === null) return;
        const cell = svgElement("rect", { x: errors.x[i] - dx / 2, y: errors.y[j] - dy / 2, width: 1.02 * dx, height: 1.02 * dy });
        cell.style.fill = colourOf(value);
        this.heat.append(cell);
      }),
    );
    return { low, high, cells: cellsOf(errors, colourOf) };
  }

  /** Show places on the ground: [{x, y, words}]. */
  showPlaces(places) {
    const size = 1.1 * this.unit;
    this.places.replaceChildren(
      ...places.map(({ x, y, words }) =>
        svgElement("g", {}, svgElement("title", { text: words }), svgElement("circle", { cx: x, cy: y, r: size })),
      ),
    );
  }
}

/** The quadrilaterals between places of an error map that are in the picture, {points, colour}. */
function cellsOf({ metres, pixels }, colourOf) {
  const corners = [[0, 0], [0, 1], [1, 1], [1, 0]];
  const at = (grid, j, i) => corners.map(([down, right]) => grid[j + down]?.[i + right] ?? null);
  return metres.flatMap((row, j) => row.flatMap((_, i) => {
    const points = at(pixels, j, i);
    const value = at(metres, j, i).find(Number.isFinite);
    return value !== undefined && points.every((xy) => xy?.every(Number.isFinite)) ? [{ points, colour: colourOf(value) }] : [];
  }));
}

/** The colour for a share of the range of errors. */
export function heatColour(share) {
  const at = share * (HEAT.length - 1);
  const [low, high] = [HEAT[Math.floor(at)], HEAT[Math.min(Math.floor(at) + 1, HEAT.length - 1)]];
  return `rgb(${low.map((value, k) => Math.round(value + (at % 1) * (high[k] - value))).join(" ")})`;
}

/** The scale of an error map: its colours between two numbers. */
export function heatScale({ low, high }) {
  const bar = element("span", { class: "heat-bar", "aria-hidden": "true" });
  bar.style.background = `linear-gradient(to right, ${HEAT.map((one) => `rgb(${one.join(" ")})`).join(", ")})`;
  const digits = low < 0.095 ? 2 : 1;
  return element("div", { class: "heat-scale small dim" }, `${shownNumber(low, digits)} m`, bar, `${shownNumber(high, digits)} m`);
}

function goalsOf(segments) {
  const goals = new Map();
  for (const segment of segments.filter(({ group }) => group === "goal")) {
    const mean = segment.points.reduce((sum, [x]) => sum + x, 0) / segment.points.length;
    const side = Math.abs(mean) < 0.5 ? 0 : Math.sign(mean);
    if (!goals.has(side)) goals.set(side, { side, segments: [] });
    goals.get(side).segments.push(segment);
  }
  return [...goals.values()].sort((a, b) => a.side - b.side);
}

function length(points) {
  return points.slice(1).reduce((sum, [x, y], k) => sum + Math.hypot(x - points[k][0], y - points[k][1]), 0);
}

function along(points, share) {
  let left = share * length(points);
  for (let k = 1; k < points.length; k++) {
    const [[x0, y0], [x1, y1]] = [points[k - 1], points[k]];
    const step = Math.hypot(x1 - x0, y1 - y0);
    if (step >= left && step > 0) return { x: x0 + ((x1 - x0) * left) / step, y: y0 + ((y1 - y0) * left) / step };
    left -= step;
  }
  return { x: points.at(-1)[0], y: points.at(-1)[1] };
}

function fromLine(at, points) {
  let least = Infinity;
  for (let k = 1; k < points.length; k++) {
    const [[x0, y0], [x1, y1]] = [points[k - 1], points[k]];
    const [dx, dy] = [x1 - x0, y1 - y0];
    const share = Math.min(Math.max(((at.x - x0) * dx + (at.y - y0) * dy) / Math.max(dx * dx + dy * dy, 1e-9), 0), 1);
    least = Math.min(least, Math.hypot(x0 + share * dx - at.x, y0 + share * dy - at.y));
  }
  return least;
}
