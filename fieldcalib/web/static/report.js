// The report of a run: a table of all frames, the picture and the map of the chosen one, plots over time of a clip.
//
// It reads two elements of its file: "report" (see fieldcalib/web/report.py) and "pictures", JPEGs in base64 by frame id.

import { counted, element, shownNumber } from "./dom.js";
import { FieldMap } from "./fieldmap.js";
import { FrameTable } from "./frametable.js";
import { CURVES, Picture } from "./picture.js";
import { Timeline } from "./plots.js";
import { VERDICTS, VerdictCard, sentence, verdictOf, verdictShape } from "./verdict.js";

const WHEEL = 1.0015; // factor of the zoom for a step of the wheel

/** The report, drawn into the body of its file. */
class Report {
  constructor(report, pictures) {
    this.report = report;
    this.pictures = pictures;
    this.frames = Object.fromEntries(Object.entries(report.frames).map(([name, column]) => [name, decoded(column)]));
    this.hidden = new Set(); // verdicts
    this.group = null; // the number of a reason
    this.current = 0;
    this.parts = this.build();
    this.card = new VerdictCard(this.parts.card, { here: "How" });
    this.map = new FieldMap(this.parts.map);
    this.map.draw({ ...report.field, segments: report.field.segments.filter(({ kind }) => kind !== "point").map((one) => ({ ...one, key: "" })) });
    this.picture = new Picture(this.parts.stage);
    this.letMove(this.picture);
    this.table = new FrameTable(this.parts.table, { open: (number) => this.open(number) });
    if (report.plots) {
      this.timeline = new Timeline(this.parts.timeline, { open: (number) => this.open(number) });
      this.timeline.show(this.frames, { rate: report.rate, cuts: report.cuts });
    }
    this.table.show(this.frames, new Set(Object.keys(report.states)));
    this.filter();
    this.open(this.table.rows.first);
    document.addEventListener("keydown", (event) => this.press(event));
  }

  build() {
    const part = (name, label, ...children) => element("section", { class: `card report-${name}`, "aria-label": label }, ...children);
    const parts = {
      counts: element("div", { class: "report-counts", role: "group", "aria-label": "Verdicts shown" }),
      reasons: element("div", { class: "report-reasons", role: "group", "aria-label": "Reasons" }),
      table: element("div", { class: "report-table" }),
      stage: element("div", { class: "report-stage" }),
      none: element("p", { class: "report-none", hidden: true }),
      legend: element("div", { class: "report-legend small", "aria-label": "Legend" }, legend()),
      name: element("h2", { class: "report-name" }),
      card: element("section", { class: "card verdict report-verdict" }),
      numbers: element("dl", { class: "report-numbers small" }),
      map: element("section", { class: "card map report-map", "aria-label": "Map of the field with the view" }),
      timeline: element("div", { class: "report-timeline" }),
      about: this.about(),
    };
    const open = element("button", { type: "button", class: "button", text: "About this run", on: { click: () => parts.about.showModal() } });
    document.body.className = `report${this.report.plots ? " report-clip" : ""}`;
    parts.stage.append(parts.none, parts.legend);
    document.body.append(
      element(
        "header",
        { class: "report-top" },
        element("span", { class: "brand" }, element("span", { class: "brand-mark", "aria-hidden": "true" }), "fieldcalib"),
        element("h1", { class: "title", text: this.report.title }),
        parts.counts,
        open,
      ),
      element("div", { class: "report-left" }, part("list", "Frames", parts.reasons, parts.table)),
      element(
        "main",
        { class: "report-right" },
        parts.stage,
        element("div", { class: "report-below" }, element("div", { class: "report-facts" }, parts.name, parts.card, parts.numbers), parts.map),
      ),
      this.report.plots ? parts.timeline : "",
      parts.about,
    );
    return parts;
  }

  /** What the run was, and what is in this file. */
  about() {
    const { about, count, states } = this.report;
    const { frames } = this;
    const dialog = element("dialog", { class: "report-about", "aria-label": "About this run" });
    const table = (values) =>
      element("dl", {}, ...Object.entries(values).flatMap(([name, value]) => [element("dt", { text: name.replaceAll("_", " ") }), element("dd", { text: words(value) })]));
    const { options = {}, notes = [], ...rest } = about;
    const shown = Object.keys(states).length;
    const inFile = [
      frames.id.length < count ? `The table has ${counted(frames.id.length, "frame")} of ${count.toLocaleString("en")}: those to look at first, and others spread over all.` : `The table has all ${counted(count, "frame")}.`,
      shown < count ? `${counted(shown, "frame")} ${shown === 1 ? "has" : "have"} a picture: the worst ones, and others spread over all.` : "Every frame has a picture.",
      "The file is kept below 20 MB, so pictures are smaller than the frames, and of long runs only some frames have one. `fieldcalib open` on the folder of results shows all of them in full, and lets you mend them.",
    ];
    dialog.append(
      element("h2", { text: "About this run" }),
      table(rest),
      ...notes.map((note) => element("p", { text: sentence(note) })),
      element("h3", { text: "In this file" }),
      ...inFile.map((text) => element("p", { text })),
      element("h3", { text: "Options" }),
      table(options),
      element("form", { method: "dialog" }, element("button", { class: "button", text: "Close" })),
    );
    dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
    return dialog;
  }

  /** Show the frames of some verdicts, or of one reason. */
  filter() {
    const { verdict, group } = this.frames;
    const known = (name) => (name in VERDICTS ? name : "");
    this.table.filter((number) => (this.group === null ? !this.hidden.has(known(verdict[number])) : group[number] === this.group));
    this.drawCounts(known);
    this.drawReasons();
  }

  drawCounts(known) {
    const buttons = Object.entries(VERDICTS).map(([name, { words: title }]) => {
      const count = this.frames.verdict.filter((one) => known(one) === name).length;
      if (!count) return null;
      const toggle = () => {
        this.group = null;
        if (!this.hidden.delete(name)) this.hidden.add(name);
        this.filter();
      };
      return element(
        "button",
        { type: "button", class: "report-count", "aria-pressed": String(!this.hidden.has(name)), title: `Show or hide: ${title.toLowerCase()}`, on: { click: toggle } },
        verdictShape(name),
        element("b", { text: count.toLocaleString("en") }),
        element("span", { class: "dim", text: title.toLowerCase() }),
      );
    });
    this.parts.counts.replaceChildren(...buttons.filter(Boolean));
  }

  drawReasons() {
    const rows = this.report.reasons.map(({ verdict, words: text, remedy, how, count }, number) => {
      const choose = () => {
        this.group = this.group === number ? null : number;
        this.filter();
        if (this.group !== null && this.frames.group[this.current] !== number) this.open(this.table.rows.first);
      };
      return element(
        "button",
        { type: "button", class: "report-reason", "aria-pressed": String(this.group === number), title: "Show only these frames", on: { click: choose } },
        verdictShape(verdict),
        element("b", { class: "report-many", text: count.toLocaleString("en") }),
        element("span", {}, element("span", { class: "report-why", text: sentence(text) }), element("span", { class: "dim", text: ` ${sentence(remedy)}` }), element("span", { class: "report-how small", text: how })),
      );
    });
    const none = element("p", { class: "dim", text: this.allGood() });
    this.parts.reasons.replaceChildren(...(rows.length ? rows : [none]));
  }

  /** What is said where no frame has a reason to be looked at: the least sure one is named with its probability. */
  allGood() {
    const { id, probability } = this.frames;
    const known = probability.flatMap((value, number) => (value === null ? [] : [number]));
    if (!known.length) return "All frames are good.";
    const least = known.reduce((a, b) => (probability[b] < probability[a] ? b : a));
    const sure = `${Math.floor(100 * probability[least])} %`;
    return known.length === 1
      ? `The frame is good: ${sure} sure within 1 m.`
      : `All frames are good. The least sure one is ${id[least]}, ${sure} within 1 m.`;
  }

  /** Show a frame. */
  async open(number) {
    if (!this.frames.id.length) return;
    this.current = number;
    const frame = this.frameOf(number);
    this.table.rows.setCurrent(number);
    this.timeline?.setCurrent(number);
    this.card.show(frame);
    this.map.show(frame);
    this.parts.name.replaceChildren(frame.id, " ", element("span", { class: "dim small", text: frame.basis }));
    this.parts.numbers.replaceChildren(...numbersOf(frame));
    await this.showPicture(frame);
  }

  async showPicture(frame) {
    const jpeg = this.pictures[frame.id];
    this.parts.none.hidden = Boolean(jpeg);
    this.parts.legend.hidden = !jpeg || !frame.curves.length;
    if (!jpeg) {
      this.picture.clear();
      this.parts.none.textContent = frame.status === "broken file" ? sentence(frame.reason) : "This file has no picture of this frame.";
      return;
    }
    const { width, height } = frame;
    const loaded = await this.picture.load({ key: frame.id, width, height, whole: () => `data:image/jpeg;base64,${jpeg}`, crop: null });
    if (this.current === frame.number) this.picture.show(loaded, frame);
  }

  /** What is known of a frame: as of `api/frame`, of frames without a picture only what the table has. */
  frameOf(number) {
    const of = (name) => this.frames[name][number];
    const flat = of("view") ?? [];
    const view = flat.flatMap((value, k) => (k % 2 ? [] : [[value, flat[k + 1]]]));
    const probability = of("probability") === null ? null : { metres: 1, value: of("probability") };
    const group = this.report.reasons[of("group")];
    const row = { id: of("id"), verdict: of("verdict"), reason: of("reason"), remedy: group?.remedy ?? "", here: group?.how ?? "", basis: of("basis"), view, probability, curves: [], horizon: null };
    return { ...row, pan: of("pan"), tilt: of("tilt"), roll: of("roll"), focal_length: of("focal_length"), ...this.report.states[of("id")], number, revision: 0, marks: [], next: null };
  }

  letMove({ lines, view }) {
    let from = null;
    const place = ({ clientX, clientY }) => {
      const box = lines.getBoundingClientRect();
      return { x: clientX - box.left, y: clientY - box.top };
    };
    const moved = () => this.picture.moved();
    lines.addEventListener("wheel", (event) => {
      event.preventDefault();
      view.zoomBy(WHEEL ** -event.deltaY, place(event));
      moved();
    }, { passive: false });
    lines.addEventListener("pointerdown", (event) => {
      from = place(event);
      lines.setPointerCapture(event.pointerId);
    });
    lines.addEventListener("pointermove", (event) => {
      if (!from) return;
      const to = place(event);
      view.pan(to.x - from.x, to.y - from.y);
      from = to;
      moved();
    });
    for (const end of ["pointerup", "pointercancel"]) lines.addEventListener(end, () => (from = null));
    lines.addEventListener("dblclick", () => {
      view.fit();
      moved();
    });
  }

  press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || this.parts.about.open) return;
    const steps = { ArrowDown: 1, ArrowUp: -1, PageDown: 10, PageUp: -10 };
    if (event.key in steps) this.open(this.table.rows.neighbour(steps[event.key]));
    else if (this.timeline && event.key === "ArrowRight") this.open(Math.min(this.current + 1, this.frames.id.length - 1));
    else if (this.timeline && event.key === "ArrowLeft") this.open(Math.max(this.current - 1, 0));
    else if (event.key === "m") {
      this.picture.layers.markings = !this.picture.layers.markings;
      this.picture.drawLines();
    } else return;
    event.preventDefault();
  }
}

function legend() {
  return Object.entries(CURVES).map(([name, { words: text }]) => element("span", { class: `report-key report-key-${name}`, text }));
}

function numbersOf(frame) {
  const camera = frame.camera ?? {};
  const sd = camera.sd ?? {};
  const value = (name, digits, unit) => {
    const number = camera[name] ?? frame[name];
    const error = Number.isFinite(sd[name]) ? ` ± ${shownNumber(sd[name], digits)}` : "";
    return `${shownNumber(number, digits)}${error}${unit}`;
  };
  const rows = [
    ["pan", value("pan", 2, "°")],
    ["tilt", value("tilt", 2, "°")],
    ["roll", value("roll", 2, "°")],
    ["focal length", value("focal_length", 0, " px")],
    ["position", camera.position ? `${camera.position.map((one) => shownNumber(one, 1)).join(", ")} m` : "–"],
    ["field", camera.field_size ? `${camera.field_size.map((one) => shownNumber(one, 1)).join(" × ")} m` : "–"],
  ];
  if (!Number.isFinite(camera.pan ?? frame.pan)) return [];
  return rows.flatMap(([name, text]) => [element("dt", { text: name }), element("dd", { text })]);
}

/** A value of the options or the summary, in words. */
function words(value) {
  if (value === null || value === undefined || value === "") return "–";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value === "number") return Number.isInteger(value) ? value.toLocaleString("en") : shownNumber(value, 1);
  if (Array.isArray(value)) return value.map(words).join(", ") || "–";
  if (typeof value === "object") return Object.entries(value).map(([name, one]) => `${name.replaceAll("_", " ")} ${words(one)}`).join(", ") || "–";
  return String(value);
}

/** A column: as it is, or of few texts, and the number of its text for each row. */
function decoded(column) {
  return Array.isArray(column) ? column : column.rows.map((number) => column.texts[number]);
}

function dataOf(id) {
  return JSON.parse(document.getElementById(id).textContent);
}

new Report(dataOf("report"), dataOf("pictures"));
