// Metres in the picture: a foot on the ground, a distance, an offside line. What was measured follows the camera.

import { address, get } from "./api.js";
import { button, element, shownMetres, shownNumber } from "./dom.js";

/** Measurements of the frame that is shown; draws over the picture, and lists them in an element. */
export class Measurements {
  constructor(root, picture, { onchange, onerror }) {
    this.root = root;
    this.picture = picture;
    this.listeners = { onchange, onerror };
    this.items = [];
    this.line = null; // of the ruler while it is drawn
    picture.drawings.push((context) => this.draw(context));
    this.list();
  }

  /** Another frame: what was measured belongs to the one before. */
  setFrame(number) {
    if (number === this.number) return;
    this.number = number;
    this.items = [];
    this.list();
  }

  /** Another camera: measure again at the same pixels. */
  async renew(revision) {
    if (revision === this.revision) return;
    this.revision = revision;
    await Promise.all(this.items.map((item) => this.ask(item)));
    this.list();
  }

  /** Show a ruler that is being drawn. */
  drawing(path, moved) {
    this.line = moved ? path : null;
    this.picture.drawLines();
  }

  /** Measure with a tool at pixels of the picture: one for a foot and an offside line, two for a ruler. */
  async add(tool, path) {
    this.line = null;
    if (tool === "ruler" && path.length < 2) return;
    const item = { tool, path: tool === "ruler" ? path.slice(0, 2) : [path.at(-1)], result: null };
    if (tool === "offside") this.items = this.items.filter((one) => one.tool !== "offside"); // one line, as on television
    this.items.push(item);
    this.list();
    await this.ask(item);
    this.list();
  }

  async ask(item) {
    const [{ x, y }, end] = item.path;
    const query = item.tool === "ruler" ? { x1: x, y1: y, x2: end.x, y2: end.y } : { x, y };
    const paths = { foot: "ground", ruler: "distance", offside: "offside" };
    try {
      item.result = await get(`api/frame/${this.number}/${paths[item.tool]}`, { query });
    } catch (error) {
      item.result = null;
      this.listeners.onerror(error);
    }
  }

  remove(item) {
    this.items = this.items.filter((one) => one !== item);
    this.list();
  }

  clear() {
    if (!this.items.length) return false;
    this.items = [];
    this.list();
    return true;
  }

  list() {
    const rows = this.items.map((item) =>
      element(
        "div",
        { class: "measure-row" },
        element("span", { class: "measure-kind dim small", text: { foot: "Foot", ruler: "Distance", offside: "Offside line" }[item.tool] }),
        element("span", { class: "measure-value", text: wordsOf(item) }),
        item.tool === "offside" && item.result ? element("a", { class: "button", href: address(`api/frame/${this.number}/offside.png`, item.path[0]), download: `offside-${this.number}.png`, "data-tip": "The picture with the line" }, "Save picture") : null,
        button("Remove", { icon: "clear", kind: "quiet", shown: false, press: () => this.remove(item) }),
      ),
    );
    if (!rows.length) {
      rows.push(
        element("div", { class: "empty" },
          element("p", { text: "Nothing measured yet." }),
          element("p", { class: "dim", text: "Foot (2): click where a player stands. Ruler (3): drag between two places. Offside (4): click a foot." }),
        ),
      );
    }
    this.root.replaceChildren(...rows);
    this.picture.drawLines();
    this.listeners.onchange(this.places());
  }

  /** Places on the ground, for the map. */
  places() {
    return this.items.filter(({ tool, result }) => tool === "foot" && result?.X).map((item) => ({ x: item.result.X[0], y: item.result.X[1], words: wordsOf(item) }));
  }

  draw(context) {
    const { picture } = this;
    if (this.line) picture.drawCurve(context, this.line.map(({ x, y }) => [x, y]), { colour: "--accent" });
    for (const item of this.items) {
      const { x, y } = picture.view.toBox(item.path[0].x, item.path[0].y);
      const words = item.result ? wordsOf(item) : "";
      if (item.tool === "ruler") {
        const ends = item.path.map((end) => picture.view.toBox(end.x, end.y));
        picture.drawCurve(context, item.path.map((end) => [end.x, end.y]), { colour: "--accent", width: 2 });
        for (const end of ends) picture.drawMark(context, end.x, end.y, { colour: "--accent" });
        if (words) picture.drawText(context, words, (ends[0].x + ends[1].x) / 2, (ends[0].y + ends[1].y) / 2);
      } else {
        if (item.tool === "offside" && item.result) picture.drawCurve(context, item.result.line, { colour: "--check", width: 2.5 });
        picture.drawMark(context, x, y, { colour: item.tool === "offside" ? "--check" : "--accent" });
        if (words) picture.drawText(context, words, x, y);
      }
    }
  }
}

function wordsOf({ tool, result }) {
  if (!result) return "…";
  if (tool === "ruler") return `${shownMetres(result.metres)} ± ${shownNumber(result.sd, 2)}`;
  if (tool === "offside") return result.X === null ? "above the ground" : `${shownMetres(result.to_end)} from the ${result.end}`;
  if (!result.X) return "above the ground";
  return `${shownNumber(result.X[0], 2)}, ${shownNumber(result.X[1], 2)} m ± ${shownNumber(result.rms, 2)}`;
}
