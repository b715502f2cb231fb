// The page: fetches the project, shows a frame, and passes on what the person does.

import { Offline, Refused, get, isGone, post } from "./api.js";
import { buildBars } from "./bars.js";
import { ClipBar, proposed } from "./clip.js";
import { commandsOf, EXTRA_HELP } from "./commands.js";
import { changeIcon, counted, element } from "./dom.js";
import { FrameEdits } from "./edits.js";
import { FieldMap, heatScale } from "./fieldmap.js";
import { FrameList } from "./frames.js";
import { Help, startTips } from "./help.js";
import { Keys } from "./keys.js";
import { KnownValues } from "./known.js";
import { MarkList, SelectionBar } from "./marks.js";
import { Measurements } from "./measure.js";
import { Notices } from "./notices.js";
import { CURVES, Picture } from "./picture.js";
import { FrameLoader, Player } from "./player.js";
import { Timeline } from "./plots.js";
import { Pointing } from "./pointing.js";
import { Tabs } from "./tabs.js";
import { VerdictCard } from "./verdict.js";

const POLL = 3000; // ms between questions whether something changed elsewhere
const MANY = 5000; // frames whose table is not fetched for every change
const SLOW = 160; // ms after which waiting is shown

const at = (id) => document.getElementById(id);

class App {
  constructor() {
    this.tool = "mark";
    this.snap = true;
    this.chosen = null;
    this.heat = false;
    this.current = -1;
    this.unsent = new Map(); // edits by frame
    this.notices = new Notices(at("notices"));
    this.picture = new Picture(at("stage"));
    this.loader = new FrameLoader(this.picture);
    this.player = new Player(this.loader, { show: (number, found) => this.presentPlayed(number, found), onchange: (playing) => this.playingChanged(playing), onerror: (error) => this.complain(error) });
    this.verdict = new VerdictCard(at("verdict"), { here: "Here" });
    this.map = new FieldMap(at("map"), { choose: (label) => this.choose(label === this.chosen ? null : label) });
    this.map.onhover = (label) => this.emphasize(label);
    this.list = new FrameList(at("frames"), { open: (number) => this.open(number) });
    this.timeline = new Timeline(at("timeline"), { open: (number) => this.open(number), moveCut: (from, to) => this.changeCuts(this.cuts.map((one) => (one === from ? to : one))) });
    this.clip = new ClipBar(at("clip-bar"), {
      onchanges: (changes) => this.showChanges(changes),
      onkept: () => this.changedElsewhere(true),
      onerror: (error) => this.complain(error),
      open: (number) => this.open(number),
      oncuts: (cuts) => this.showCuts(cuts),
    });
    this.marks = new MarkList(at("marks"), { select: (numbers) => this.select(numbers), choose: (label) => this.choose(label), remove: (numbers) => this.edit({ do: "remove", numbers }) });
    this.selection = new SelectionBar(at("selection"), { relabel: (label) => this.relabel(label), remove: () => this.remove(), clear: () => this.select([]) });
    this.known = new KnownValues(at("known"), { know: (values) => this.edit({ do: "know", values }) });
    this.measured = new Measurements(at("measured"), this.picture, { onchange: (places) => this.map.showPlaces(places), onerror: (error) => this.complain(error) });
    this.pointing = new Pointing(this.picture, this.pointingActions());
    this.picture.onview = (view) => this.showZoom(view);
    this.commands = commandsOf(this);
    this.help = new Help(this.commands, EXTRA_HELP);
    this.keys = new Keys(this.commands, { choose: (label) => this.choose(label), typed: (letters) => this.showTyped(letters) });
    this.tabs = new Tabs(at("tabs"), { marks: "Marks", known: "Camera", measured: "Measured" });
    buildBars(this);
    this.setTool("mark");
    this.showZoom(this.picture.view);
    startTips();
    window.addEventListener("beforeunload", (event) => this.waiting && event.preventDefault());
  }

  // Beginning

  async start() {
    const first = Math.max(Number.parseInt(location.hash.slice(1), 10) || 0, 0);
    const opening = this.open(first);
    try {
      const [project, field, frames] = await Promise.all([get("api/project"), get("api/field"), get("api/frames")]);
      this.showProject(project);
      this.field = field;
      this.labels = field.segments.map(({ label }) => label);
      this.map.draw(field);
      this.showHeat();
      this.keys.setField(field);
      this.showFrames(frames);
      if (this.isClip) this.clip.poll().catch((error) => this.complain(error));
      this.loaded();
      await opening;
      if (this.current < 0 && first >= project.count) await this.open(0);
      if (this.edits) this.render(true);
    } catch (error) {
      this.complain(error);
      this.showEmpty("The page could not be loaded.", error.message);
    }
    this.loaded();
    setInterval(() => this.poll(), POLL);
  }

  loaded() {
    at("page").classList.remove("loading");
    at("page").removeAttribute("aria-busy");
  }

  get isClip() {
    return this.project?.kind === "clip";
  }

  get count() {
    return this.project?.count ?? Infinity;
  }

  showProject(project) {
    if (this.project && project.field !== this.project.field) location.reload(); // changed in another window
    this.project = project;
    this.cuts = project.cuts;
    this.notices.refused(project.refused);
    at("title").textContent = project.title;
    at("page").classList.toggle("single", project.count <= 1);
    at("clip").hidden = !this.isClip;
    at("frames").hidden = project.count <= 1;
    this.showSaved();
  }

  showFrames(frames) {
    this.frames = frames;
    this.list.show(frames);
    this.list.setCurrent(this.wanted);
    this.timeline.show(frames, { rate: this.project.rate, cuts: this.cuts });
    this.timeline.setCurrent(this.wanted);
    this.clip.setAnchors(frames.by_hand.filter(Boolean).length);
  }

  // Frames

  /** Show a frame. While one is fetched, only the last of those that are asked for meanwhile is fetched next. */
  async open(number) {
    if (this.player.playing) this.player.stop();
    this.wanted = Math.max(0, Math.min(number, this.count - 1));
    if (this.frames) {
      this.list.setCurrent(this.wanted);
      this.timeline.setCurrent(this.wanted);
    }
    if (this.opening) return;
    this.opening = true;
    const slow = setTimeout(() => this.showWaiting(), SLOW);
    while (this.wanted !== this.current) {
      const asked = this.wanted;
      try {
        const found = await this.loader.frame(asked, { fresh: true });
        if (asked === this.wanted) this.present(asked, found);
      } catch (error) {
        if (asked !== this.wanted) continue;
        this.wanted = this.current;
        if (this.current >= 0) this.complain(error);
        else this.showEmpty("This frame could not be loaded.", error.message);
        break;
      }
    }
    clearTimeout(slow);
    at("busy").classList.remove("shown");
    this.opening = false;
  }

  showWaiting() {
    at("busy").classList.add("shown");
    if (this.current < 0) this.showEmpty("One moment", "The first frame is read and its camera found. After an installation the solver is compiled first, which takes up to a minute.");
  }

  present(number, { state, loaded, failure }) {
    this.current = number;
    history.replaceState(null, "", `#${number}`);
    const kept = this.unsent.get(number);
    this.edits = kept?.pending.length ? kept : this.editsOf(state);
    this.select([], false);
    this.picture.proposed = this.picture.errors = [];
    this.measured.setFrame(number);
    if (failure) this.showEmpty("No picture here.", failure);
    else at("stage-empty").hidden = true;
    if (loaded) this.picture.show(loaded, this.edits.shown);
    else this.picture.clear();
    this.render(true);
    this.fetchProposed();
    if (state.judged && this.frames && this.frames.verdict[number] !== state.verdict) this.pollSoon();
  }

  /** A frame while the clip plays: the picture, its verdict, where it is. */
  presentPlayed(number, { state, loaded, failure }) {
    this.current = this.wanted = number;
    this.edits = this.unsent.get(number)?.pending.length ? this.unsent.get(number) : this.editsOf(state);
    this.picture.selected = new Set();
    this.picture.proposed = this.picture.errors = [];
    if (loaded) this.picture.show(loaded, state);
    at("stage-empty").hidden = !failure;
    if (failure) this.showEmpty("No picture here.", failure);
    this.list.setCurrent(number);
    this.timeline.setCurrent(number);
    this.verdict.show(state);
    this.map.show(state);
    this.showName(state);
  }

  playingChanged(playing) {
    const words = playing ? "Pause" : "Play";
    changeIcon(this.playButton, playing ? "pause" : "play");
    this.playButton.querySelector("span").textContent = words;
    this.playButton.dataset.tip = words;
    this.playButton.setAttribute("aria-label", words);
    if (!playing && this.edits) {
      history.replaceState(null, "", `#${this.current}`);
      this.measured.setFrame(this.current);
      this.render(true);
    }
  }

  play() {
    if (this.isClip) this.player.toggle(this.current, this.count, this.project.rate ?? 25);
  }

  /** An arrow key: moves the pointer of the keyboard, if there is one, by CSS pixels; else to another frame. */
  arrow(dx, dy) {
    if (this.pointing.cursor) this.pointing.moveCursor(dx, dy);
    else this.step(Math.sign(dx + dy));
  }

  step(places) {
    this.open(this.list.neighbour(places));
  }

  /** The next or previous frame that is not good. */
  stepInDoubt(direction) {
    const { verdict } = this.frames;
    for (let number = this.current + direction; number >= 0 && number < verdict.length; number += direction) {
      if (verdict[number] !== "good") return this.open(number);
    }
    return this.notices.say(direction > 0 ? "No frame in doubt after this one." : "No frame in doubt before this one.");
  }

  // Edits

  editsOf(state) {
    const edits = new FrameEdits(state, {
      onchange: (of, answered) => this.edited(of, answered),
      onrefused: (error, of) => this.refused(error, of),
      onoffline: () => this.notices.offline(this.waiting),
    });
    this.unsent.set(state.number, edits);
    for (const [number, one] of this.unsent) if (!one.pending.length && one !== edits) this.unsent.delete(number);
    return edits;
  }

  get waiting() {
    return [...this.unsent.values()].reduce((sum, { pending }) => sum + pending.length, 0);
  }

  edit(body) {
    if (!this.edits || this.edits.state.problem) return false;
    if (this.player.playing) this.player.stop();
    if (["remove", "undo", "redo", "clear", "automatic", "copy"].includes(body.do)) this.picture.selected = new Set();
    return this.edits.push(body);
  }

  edited(edits, answered) {
    const { judged } = edits.state;
    if (edits === this.edits && answered && !judged) this.picture.update(edits.shown); // the rest comes with the verdict
    else if (edits === this.edits) this.render(answered);
    if (!answered) return this.showSaved();
    this.notices.offline(null);
    this.loader.forget();
    if (!judged) return undefined;
    this.patch(edits.state);
    this.pollSoon();
    return this.showSaved();
  }

  refused(error, edits) {
    if (edits === this.edits) this.select([], false);
    if (error.status === 409) this.notices.say("This frame was changed in another window. It was loaded again, without your last change.", "warn");
    else this.complain(error);
  }

  /** Take a frame's new state over into the table of all frames. */
  patch(state) {
    if (!this.frames) return;
    const { number, camera } = state;
    const row = { verdict: state.verdict, reason: state.reason || state.message, by_hand: state.by_hand, basis: state.basis };
    for (const column of ["pan", "tilt", "roll", "focal_length"]) row[column] = camera ? camera[column] : null;
    for (const [column, value] of Object.entries(row)) if (this.frames[column]) this.frames[column][number] = value;
    this.list.rows.draw();
    this.list.drawCounts();
    this.timeline.prepare();
    this.clip.setAnchors(this.frames.by_hand.filter(Boolean).length);
  }

  pointingActions() {
    const app = this;
    return {
      get tool() { return app.tool; },
      get chosen() { return app.chosen; },
      get snap() { return app.snap; },
      get marks() { return app.edits.shown.marks; },
      select: (numbers) => app.select(numbers),
      choose: (label) => app.choose(label),
      ask: (xy) => app.ask(xy),
      hover: (over) => app.hovered(over),
      preview: (to) => app.preview(to),
      addMarks: (label, xy, snap) => app.addMarks(label, xy, snap),
      moveMarks: (to, snap) => app.moveMarks(to, snap),
      measuring: (path, moved) => app.tool === "ruler" && app.measured.drawing(path, moved),
      measure: (path, moved) => app.measure(path, moved),
      pointed: () => app.showChosen(),
    };
  }

  addMarks(label, xy, snap) {
    if (!xy.length) return;
    if (!this.chosen) this.choose(label);
    this.select([], false);
    this.edit({ do: "mark", label, xy, snap });
  }

  moveMarks(to, snap) {
    if (!this.edit({ do: "move", to, snap })) this.preview(null);
  }

  /** Marks where they would be, while they are dragged. */
  preview(to) {
    const { shown } = this.edits;
    const marks = to ? shown.marks.map((mark, number) => (number in to ? { ...mark, x: to[number][0], y: to[number][1], pending: true } : mark)) : shown.marks;
    this.picture.update({ ...shown, marks });
  }

  /** Move the selected marks by pixels. */
  nudge(dx, dy) {
    const { marks } = this.edits.shown;
    const to = Object.fromEntries([...this.picture.selected].filter((number) => number in marks).map((number) => [number, [marks[number].x + dx, marks[number].y + dy]]));
    if (Object.keys(to).length) this.moveMarks(to, false);
  }

  relabel(label) {
    this.edit({ do: "relabel", numbers: [...this.picture.selected], label });
  }

  remove() {
    if (this.picture.selected.size) this.edit({ do: "remove", numbers: [...this.picture.selected] });
  }

  copyLabels() {
    if (this.current > 0) this.edit({ do: "copy", from: this.current - 1 });
  }

  select(numbers, draw = true) {
    this.picture.selected = new Set(numbers);
    if (draw && this.edits) this.render();
  }

  // Choosing and tools

  choose(label) {
    this.chosen = label;
    this.map.setChosen(label);
    this.emphasize(null);
    if (label) this.setTool("mark");
    this.showChosen();
    if (this.edits) this.marks.show(this.edits.shown, this.picture.selected, this.chosen);
  }

  /** A click in the picture while no marking is chosen: say how one is, and which it may be. */
  async ask({ x, y }) {
    const likely = this.edits.state.camera ? await get(`api/frame/${this.current}/likely`, { query: { x, y } }).catch(() => null) : null;
    const keys = new Map(this.field.segments.map(({ label, key }) => [label, key]));
    const some = (likely?.labels ?? []).slice(0, 2).map((label) => `${label} (${keys.get(label)?.toUpperCase()})`);
    this.notices.say(`Which marking is this? Click it on the map or type its letters${some.length ? `: ${some.join(" or ")} here?` : "."}`);
  }

  emphasize(label) {
    this.picture.emphasized = label ?? this.chosen;
    this.picture.drawLines();
  }

  hovered(over) {
    const mark = over?.number >= 0 ? this.picture.frame?.marks[over.number] : null;
    this.map.hover(mark?.label ?? over?.label ?? over?.next ?? null);
  }

  setTool(tool) {
    this.tool = tool;
    for (const [name, one] of Object.entries(this.toolButtons)) one.setAttribute("aria-pressed", String(name === tool));
    if (tool !== "mark") {
      this.tabs.show("measured");
      if (this.chosen) this.choose(null);
    }
    at("stage").dataset.tool = tool;
    this.picture.measuring = tool !== "mark";
    this.picture.drawLines();
    this.showChosen();
  }

  measure(path, moved) {
    if (!this.edits?.state.camera) return this.notices.say("Metres need a camera: label this frame first.");
    if (this.tool === "ruler" && !moved) return this.measured.drawing(path, false);
    return this.measured.add(this.tool, path);
  }

  setSnap(on) {
    this.snap = on;
    this.toggles.snap.setAttribute("aria-pressed", String(on));
  }

  toggleLayer(name) {
    this.picture.layers[name] = !this.picture.layers[name];
    this.toggles[name]?.setAttribute("aria-pressed", String(this.picture.layers[name]));
    this.picture.drawLines();
    this.showLegend();
  }

  async toggleHeat() {
    this.heat = !this.heat;
    this.toggles.heat.setAttribute("aria-pressed", String(this.heat));
    await this.showHeat();
  }

  /** Colour the map and the picture by how far the ground shifts if clicks are 2 px off. */
  async showHeat() {
    const number = this.current;
    const errors = this.heat ? await get(`api/frame/${number}/errors`).catch(() => null) : null;
    if (number !== this.current) return;
    const range = this.map.showErrors(errors);
    this.picture.errors = range?.cells ?? [];
    this.picture.drawLines();
    const nothing = element("p", { class: "dim small", text: "Without a camera there is no error map." });
    at("heat-scale").replaceChildren(range ? heatScale(range) : this.heat ? nothing : this.sportChoice());
  }

  /** The sport, which can be changed as long as no frame is labelled, and the size of its field. */
  sportChoice() {
    const { name, length, width } = this.field;
    const sports = [...new Set([name, ...this.project.sports])].sort();
    const choice = element("select", { "aria-label": "Sport", "data-tip": "Choose another sport", on: { change: () => this.changeSport(choice.value) } }, sports.map((value) => element("option", { value, text: value })));
    choice.value = name;
    return element("div", { class: "sport dim small" }, choice, `${length} × ${width} m`);
  }

  async changeSport(name) {
    try {
      await post("api/v1/field", { name });
      location.reload();
    } catch (error) {
      this.showHeat();
      this.complain(error);
    }
  }

  goToNext() {
    const next = this.edits?.shown.next;
    if (!next) return this.notices.say("No advice: label some markings first.");
    if (!this.picture.view.fitted) {
      this.picture.view.centre(next.x, next.y);
      this.picture.moved();
    }
    return this.choose(next.label);
  }

  /** One step back from what is going on. */
  escape() {
    if (this.pointing.gesture || this.pointing.cursor) this.pointing.cancel();
    else if (this.picture.selected.size) this.select([]);
    else if (this.chosen) this.choose(null);
    else if (this.tool !== "mark") this.setTool("mark");
    else this.measured.clear();
  }

  zoom(change) {
    const { cursor } = this.pointing;
    change(this.picture.view, cursor ? this.picture.view.toBox(cursor.x, cursor.y) : undefined);
    this.picture.moved();
  }

  // Saving

  async save() {
    if (!this.project?.can_save) return this.notices.say("There is no folder of results to save into: run fieldcalib open with one.", "warn");
    try {
      const answer = await post("api/save");
      this.notices.say(savedWords(answer), Object.keys(answer.failed).length ? "warn" : "good");
      await this.poll();
      if (this.isClip) await this.clip.poll();
    } catch (error) {
      this.complain(error);
    }
    return undefined;
  }

  async saveLabels(format) {
    try {
      const { file, history: kept } = await post("api/save_labels", { format });
      this.notices.say(`Labels written: ${file}.${keptWords(kept)}`, "good");
    } catch (error) {
      this.complain(error);
    }
  }

  showSaved() {
    const unsaved = Math.max(this.project?.unsaved ?? 0, this.waiting ? 1 : 0);
    const words = unsaved ? `Save ${counted(unsaved, "frame")}` : this.project?.has_results ? "Saved" : "Save";
    this.saveButton.querySelector("span").textContent = words;
    this.saveButton.setAttribute("aria-label", words);
    this.saveButton.classList.toggle("primary", unsaved > 0);
    document.title = `${unsaved ? "• " : ""}${this.project?.title ?? "fieldcalib"}`;
  }

  // What changes elsewhere

  pollSoon() {
    clearTimeout(this.asking);
    this.asking = setTimeout(() => this.poll(), 300);
  }

  async poll() {
    try {
      const project = await get("api/project");
      if (!this.waiting) this.notices.offline(null);
      const changed = project.version !== this.frames?.version;
      this.showProject(project);
      if (changed && !this.player.playing) await this.changedElsewhere(false);
    } catch (error) {
      if (isGone(error)) this.notices.offline(this.waiting);
      else this.complain(error);
    }
  }

  /** Fetch the table and the frame that is shown again. */
  async changedElsewhere(all) {
    const now = performance.now();
    if (all || this.count <= MANY || now - (this.fetched ?? 0) > 10 * POLL) {
      this.fetched = now;
      this.showFrames(await get("api/frames"));
    }
    const { edits } = this;
    if (!edits || edits.pending.length || this.player.playing) return;
    const state = await get(`api/frame/${this.current}`);
    if (edits !== this.edits || edits.pending.length || state.number !== this.current) return;
    if (state.revision < edits.state.revision) return; // it was edited, and that answered, meanwhile
    const isFound = state.automatic && state.message !== edits.state.message; // a camera that was searched for
    if (!all && state.revision === edits.state.revision && !isFound) return;
    this.loader.forget();
    this.edits = this.editsOf(state);
    this.picture.selected = new Set();
    this.render(true);
    this.fetchProposed();
  }

  complain(error) {
    if (error instanceof Offline) this.notices.offline(this.waiting);
    else if (error.name !== "AbortError") this.notices.say(error.message, "warn");
    if (!(error instanceof Offline || error instanceof Refused)) console.error(error);
  }

  // Clips

  showChanges(changes) {
    this.timeline.setChanges(changes);
    this.fetchProposed();
  }

  async fetchProposed() {
    const number = this.current;
    const found = this.clip.changes?.frames.includes(number) ? await proposed(number).catch(() => null) : null;
    if (number !== this.current) return;
    this.picture.proposed = found?.curves ?? [];
    this.picture.drawLines();
    this.showLegend();
  }

  changeCuts(cuts) {
    return this.clip.changeCuts([...new Set([0, ...cuts])].sort((a, b) => a - b));
  }

  /** Begin a shot at this frame, or join it to the one before. */
  toggleCut() {
    if (!this.isClip || this.current <= 0) return;
    const has = this.cuts.includes(this.current);
    this.changeCuts(has ? this.cuts.filter((one) => one !== this.current) : [...this.cuts, this.current]);
  }

  showCuts(cuts) {
    this.cuts = this.project.cuts = cuts;
    this.timeline.show(this.frames, { rate: this.project.rate, cuts });
    this.showCutHere();
  }

  // Drawing

  render(answered = false) {
    const frame = this.edits.shown;
    this.picture.update(frame);
    this.map.show(frame);
    this.marks.show(frame, this.picture.selected, this.chosen);
    this.selection.show(frame, this.picture.selected, this.labels ?? []);
    this.editButtons.undo.disabled = !frame.can_undo && !frame.pending;
    this.editButtons.redo.disabled = !frame.can_redo;
    this.editButtons.copy.disabled = this.current <= 0;
    this.showTyped("");
    if (!answered) return;
    this.verdict.show(frame);
    this.known.show(frame);
    this.tabs.setCount("marks", frame.marks.length);
    this.showName(frame);
    this.showLegend();
    this.measured.renew(`${frame.number} ${frame.revision}`);
    if (this.heat) this.showHeat();
  }

  showName(frame) {
    const place = this.count > 1 && Number.isFinite(this.count) ? `${(frame.number + 1).toLocaleString("en")} of ${this.count.toLocaleString("en")}` : "";
    at("frame-name").textContent = [frame.id, place].filter(Boolean).join(" · ");
    this.showCutHere();
  }

  showCutHere() {
    this.clipButtons.cut.setAttribute("aria-pressed", String(Boolean(this.current > 0 && this.cuts?.includes(this.current))));
  }

  showChosen() {
    const words = { foot: "Click where a player stands", ruler: "Drag between two places on the ground", offside: "Click the foot of a player" }[this.tool];
    const found = this.field?.segments.find(({ label }) => label === this.chosen);
    const parts = this.chosen ? [element("b", { text: this.chosen }), found?.key ? element("kbd", { text: found.key.toUpperCase() }) : "", element("span", { class: "dim", text: this.pointing.cursor ? "" : "click along it (by keys: Enter)" })] : words ? [element("span", { text: words })] : [];
    if (this.pointing.cursor) parts.push(element("span", { class: "dim", text: "arrow keys move the pointer, Enter clicks" }));
    at("chosen").replaceChildren(...parts);
    at("chosen").classList.toggle("shown", parts.length > 0);
  }

  showTyped(letters) {
    if (!letters) return this.showChosen();
    at("chosen").replaceChildren(element("kbd", { text: letters.toUpperCase() }), element("span", { class: "dim", text: "…" }));
    at("chosen").classList.add("shown");
    return undefined;
  }

  showLegend() {
    const states = new Set(this.picture.layers.markings ? this.edits?.shown.curves.map(({ state }) => state) : []);
    const rows = Object.entries(CURVES).filter(([state]) => states.has(state)).map(([state, { words }]) => element("span", { class: `legend-row legend-${state}` }, element("i", { "aria-hidden": "true" }), words));
    if (this.picture.proposed.length) rows.push(element("span", { class: "legend-row legend-proposed" }, element("i", { "aria-hidden": "true" }), "solved again"));
    at("legend").replaceChildren(...rows);
  }

  showZoom(view) {
    if (this.zoomWords) this.zoomWords.textContent = `${Math.round(100 * view.scale)} %`;
  }

  showEmpty(title, words) {
    at("stage-empty").hidden = false;
    at("stage-empty").replaceChildren(element("strong", { text: title }), element("p", { class: "dim", text: words }));
  }
}

/** What a save has written: nothing, cameras that were found by themselves, or what a person changed. */
function savedWords({ saved, by_hand: byHand, folder, history: kept, failed }) {
  const ids = Object.keys(failed);
  const left = ids.length ? ` Not saved: ${ids.length > 3 ? counted(ids.length, "frame") : ids.join(", ")} (${failed[ids[0]]}).` : "";
  if (!saved) return left ? left.trim() : "Nothing to save: nothing has changed since it was saved.";
  const rest = `${keptWords(kept)}${left}`;
  if (!byHand) return `Nothing was changed by hand. Saved what was found by itself in ${counted(saved, "frame")}, in ${folder}.${rest}`;
  const others = saved > byHand ? `, and what was found by itself in ${saved - byHand} more` : "";
  return `Saved ${counted(byHand, "frame")}${others} in ${folder}.${rest}`;
}

/** Where the files are that a save has replaced. */
function keptWords(kept) {
  return kept ? ` What it replaced is in ${kept}.` : "";
}

new App().start();
