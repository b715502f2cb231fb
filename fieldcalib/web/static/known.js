// The camera in numbers, each with a lock: estimated while open, held at what is typed or was found while locked.

import { changeIcon, drawIcon, element, shownNumber } from "./dom.js";

const RATIOS = [[16, 9], [4, 3], [3, 2], [21, 9], [1, 1], [9, 16]]; // shown in words; others as a number
const SAME_RATIO = 0.006; // sizes are whole pixels

/** The numbers, in an element that it fills. `know` takes the values of an edit. */
export class KnownValues {
  constructor(root, { know }) {
    this.know = know;
    this.rows = {};
    this.focal = this.numbers("Focal length", 1, { unit: "px", digits: 0, key: "focal_length", least: 1, found: (camera) => [camera.focal_length], sd: (sd) => [sd.focal_length] });
    this.position = this.numbers("Position", 3, { unit: "m", digits: 1, key: "position", names: ["x", "y", "z"], found: (camera) => camera.position, sd: (sd) => sd.position });
    this.size = this.numbers("Field size", 2, { unit: "m", digits: 2, key: "field_size", least: 1, names: ["length", "width"], found: (camera) => camera.field_size });
    this.middle = this.lockRow("Principal point", "principal_point");
    this.middle.words = element("span", { class: "value-words" });
    this.middle.node.append(element("span", { class: "row-label", text: "Principal point" }), this.middle.words, this.middle.lock);
    this.shape = this.numbers("Shown as", 1, { unit: "w:h", digits: 2, key: "aspect", least: 0.2, found: ({ aspect }) => [named(aspect)], parse: parseRatio, format: ratioWords, note: shapeWords });
    this.lens = element("select", { "aria-label": "Lens model", on: { change: () => this.know({ lens: this.lens.value }) } });
    this.lensWords = element("span", { class: "dim small value-words" });
    this.angles = element("div", { class: "angles" });
    root.append(
      this.angles,
      this.focal.node,
      this.position.node,
      this.size.node,
      this.middle.node,
      this.shape.node,
      element("div", { class: "known-row" }, element("span", { class: "row-label", text: "Lens" }), element("span", { class: "values" }, this.lens), this.lensWords),
      element("p", { class: "dim small", text: "A locked number is held; an open one is estimated. Type a number to lock it." }),
    );
  }

  lockRow(words, key) {
    const row = { key, locked: false, node: element("div", { class: "known-row" }) };
    row.lock = element("button", { type: "button", class: "lock", "aria-pressed": "false", on: { click: () => this.toggle(row) } }, drawIcon("open"));
    row.words = words;
    row.setLocked = (locked) => {
      row.locked = locked;
      row.node.classList.toggle("locked", locked);
      row.lock.setAttribute("aria-pressed", String(locked));
      row.lock.setAttribute("aria-label", `${words}: ${locked ? "held" : "estimated"}`);
      row.lock.dataset.tip = locked ? "Held: press to estimate it" : "Estimated: press to hold it";
      changeIcon(row.lock, locked ? "locked" : "open");
    };
    return row;
  }

  numbers(words, count, { unit, digits, key, names = [""], found, sd = null, least = -Infinity, parse = parseNumber, format = shownNumber, note = null }) {
    const row = Object.assign(this.lockRow(words, key), { digits, found, sd, parse, format, note });
    row.inputs = Array.from({ length: count }, (_, k) => {
      const name = names[k] ? `${words}, ${names[k]}` : words;
      const input = element("input", { type: "text", inputmode: "decimal", autocomplete: "off", "aria-label": `${name} (${unit})`, on: { change: () => this.typed(row, least) } });
      let before = ""; // a number that is typed as it stood there is no change for the browser, but holds it
      input.addEventListener("focus", () => (before = input.value));
      input.addEventListener("keydown", (event) => {
        if (event.key === "Enter") {
          const isSame = input.value === before;
          input.blur();
          if (isSame) this.typed(row, least);
        }
        if (event.key === "Escape") {
          this.fill(row, this.frame);
          input.blur();
        }
      });
      return input;
    });
    row.deviation = element("span", { class: "dim small deviation" });
    row.node.append(element("span", { class: "row-label", text: words }), element("span", { class: "values" }, row.inputs, element("span", { class: "dim", text: unit })), row.lock, row.deviation);
    return row;
  }

  typed(row, least) {
    const values = row.inputs.map(({ value }) => row.parse(value));
    const wrong = values.findIndex((value, k) => !row.inputs[k].value.trim() || !Number.isFinite(value) || value < least);
    row.inputs.forEach((input, k) => input.setAttribute("aria-invalid", String(k === wrong)));
    if (wrong < 0) this.know({ [row.key]: values.length === 1 ? values[0] : values });
  }

  toggle(row) {
    if (row === this.middle) return this.know({ principal_point: !row.locked });
    if (row.locked) return this.know({ [row.key]: null });
    const { camera } = this.frame;
    if (!camera) return row.inputs[0].focus(); // nothing was found that could be held: type it
    const values = row.found(camera).map((value) => Number(value.toFixed(row.digits + 3)));
    return this.know({ [row.key]: values.length === 1 ? values[0] : values });
  }

  fill(row, { camera, known }) {
    const held = known[row.key];
    const values = held === null || held === undefined ? (camera ? row.found(camera) : []) : [held].flat();
    row.setLocked(held !== null && held !== undefined);
    row.inputs.forEach((input, k) => {
      input.setAttribute("aria-invalid", "false");
      if (document.activeElement !== input) input.value = values.length ? row.format(values[k], row.digits) : "";
      input.placeholder = "–";
    });
    const deviations = camera?.sd && row.sd && !row.locked ? row.sd(camera.sd) : null;
    row.deviation.textContent = row.locked ? "held" : row.note && camera ? row.note(this.frame) : deviations ? `± ${deviations.map((value) => shownNumber(value, row.digits && row.digits + 1)).join(", ")}` : "";
  }

  /** Show the camera and the known values of a frame. */
  show(frame) {
    this.frame = frame;
    const { camera, known } = frame;
    for (const row of [this.focal, this.position, this.size, this.shape]) this.fill(row, frame);
    this.middle.setLocked(known.principal_point);
    this.middle.words.textContent = known.principal_point
      ? "the middle of the picture"
      : camera ? `${shownNumber(camera.principal_point[0], 1)}, ${shownNumber(camera.principal_point[1], 1)} px` : "–";
    if (this.lens.dataset.of !== frame.lenses.join()) {
      this.lens.replaceChildren(...frame.lenses.map((name) => element("option", { value: name, text: name })));
      this.lens.dataset.of = frame.lenses.join();
    }
    this.lens.value = known.lens;
    this.lensWords.textContent = camera?.dist.some(Boolean) ? `k1 ${shownNumber(camera.dist[0], 4)}${camera.dist[1] ? `, k2 ${shownNumber(camera.dist[1], 4)}` : ""}` : "";
    this.angles.replaceChildren(...["pan", "tilt", "roll"].map((name) => angle(name, camera)));
  }
}

function parseNumber(text) {
  return Number(text.replace("−", "-").replace(",", "."));
}

/** "16:9" or "1.78" as a number. */
function parseRatio(text) {
  const [width, height] = text.split(":").map(parseNumber);
  return height === undefined ? width : width / height;
}

function isNear(value, ratio) {
  return Math.abs(value / ratio - 1) < SAME_RATIO;
}

/** A ratio of the usual ones exactly, if it is near one. */
function named(value) {
  const near = RATIOS.find(([width, height]) => isNear(value, width / height));
  return near ? near[0] / near[1] : value;
}

function ratioWords(value, digits) {
  const near = RATIOS.find(([width, height]) => isNear(value, width / height));
  return near ? near.join(":") : shownNumber(value, digits);
}

function shapeWords({ width, height, camera }) {
  return isNear(camera.aspect, width / height) ? "as it is: pixels are square" : "its pixels are not square";
}

function angle(name, camera) {
  const deviation = camera?.sd?.[name];
  return element(
    "div",
    { class: "angle" },
    element("span", { class: "dim small", text: name }),
    element("span", { class: "angle-value", text: camera ? `${shownNumber(camera[name], 2)}°` : "–" }),
    element("span", { class: "dim small", text: Number.isFinite(deviation) ? `± ${shownNumber(deviation, 2)}` : "" }),
  );
}
