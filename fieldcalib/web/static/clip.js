// A clip around frames mended by hand: solve it again, see what changes, keep or discard it; cuts.

import { get, post } from "./api.js";
import { button, counted, element, shownNumber } from "./dom.js";

const POLL = 400; // ms

/** The bar of a clip above its timeline. */
export class ClipBar {
  constructor(root, { onchanges, onkept, onerror, open, oncuts }) {
    this.root = root;
    this.listeners = { onchanges, onkept, onerror, open, oncuts };
    this.state = "none";
    this.words = element("span", { class: "clip-words", role: "status" });
    this.progress = element("progress", { max: "1", value: "0", "aria-label": "Solving the clip" });
    this.buttons = {
      solve: button("Solve the clip again", { icon: "solve", keys: "", press: () => this.act("solve") }),
      next: button("Next frame to mend", { press: () => this.showNext() }),
      draw: button("Draw overlay.mp4 again", { press: () => this.act("draw") }),
      undo_keep: button("Undo Keep", { icon: "undo", press: () => this.act("undo_keep") }),
      cancel: button("Cancel", { press: () => this.act("cancel") }),
      worst: button("Largest change", { press: () => this.showLargest() }),
      keep: button("Keep", { kind: "primary", press: () => this.act("keep") }),
      discard: button("Discard", { press: () => this.act("discard") }),
    };
    root.append(this.words, this.progress, ...Object.values(this.buttons));
    this.draw({ state: "none" });
  }

  /** How many frames are held by hand, and whether that changed since the clip was solved. */
  setAnchors(count) {
    this.anchors = count;
    if (this.state === "none" || this.state === "failed") this.draw({ state: this.state, error: this.error });
  }

  async act(what) {
    if (what === "solve" || what === "draw") this.draw({ state: "running", done: 0, total: 0, stage: "" });
    try {
      await post(`api/clip/${what}`);
      if (what === "keep" || what === "undo_keep") this.listeners.onkept();
      await this.poll();
    } catch (error) {
      this.listeners.onerror(error);
      await this.poll().catch(() => {});
    }
  }

  /** Ask how far it is, again and again while it runs. */
  async poll() {
    clearTimeout(this.timer);
    const job = await get("api/clip/job");
    this.draw(job);
    if (job.state === "running") this.timer = setTimeout(() => this.poll().catch(this.listeners.onerror), POLL);
  }

  draw(job) {
    const before = this.state;
    this.state = job.state;
    this.error = job.error;
    this.toDraw = job.to_draw ?? this.toDraw;
    this.canUndoKeep = job.can_undo_keep ?? this.canUndoKeep;
    this.changes = job.state === "ready" ? job.changes : null;
    const shown = {
      solve: job.state === "none" || job.state === "failed",
      next: job.state === "none" || job.state === "failed",
      draw: (job.state === "none" || job.state === "failed") && Boolean(this.toDraw?.length),
      undo_keep: (job.state === "none" || job.state === "failed") && Boolean(this.canUndoKeep),
      cancel: job.state === "running",
      worst: job.state === "ready" && Boolean(job.changes?.frames.length),
      keep: job.state === "ready",
      discard: job.state === "ready",
    };
    for (const [name, one] of Object.entries(this.buttons)) one.hidden = !shown[name];
    this.buttons.solve.disabled = !this.anchors;
    this.progress.hidden = job.state !== "running";
    if (job.total) this.progress.value = job.done / job.total;
    else this.progress.removeAttribute("value");
    this.words.textContent = this.sentence(job);
    this.words.classList.toggle("warn", job.state === "failed");
    if (before !== job.state) this.listeners.onchanges(this.changes);
  }

  sentence({ state, done, total, stage, error, changes }) {
    if (state === "running") return [stage || "Solving the clip", total ? `${done} of ${total}` : ""].filter(Boolean).join(", ");
    if (state === "failed") return error || "The clip could not be solved.";
    if (state === "ready") {
      const { frames, pixels, good, contradicted } = changes;
      if (!frames.length) return "Solved again: no frame changes.";
      const moved = `${counted(frames.length, "frame")} would change, by up to ${shownNumber(Math.max(...pixels.map((one) => one ?? 0)), 1)} px; ${good[1]} would be good, ${good[0]} are`;
      const told = Object.entries(contradicted).map(([id, what]) => ` The labels of ${id} contradict the clip, ${what}: that frame keeps its own camera.`);
      return `Solved again: ${moved}.${told.join("")}`;
    }
    return this.anchors ? `${counted(this.anchors, "frame")} mended by hand ${this.anchors === 1 ? "holds" : "hold"} the clip.` : "Mend a frame, and the clip can be solved again around it.";
  }

  /** Go to the frame whose labels would help most. */
  async showNext() {
    try {
      const { number } = await get("api/clip/next");
      if (number === null) this.words.textContent = "All frames are good.";
      else this.listeners.open(number);
    } catch (error) {
      this.listeners.onerror(error);
    }
  }

  showLargest() {
    const { frames, pixels } = this.changes;
    const largest = pixels.reduce((best, one, k) => ((one ?? Infinity) > (pixels[best] ?? Infinity) ? k : best), 0);
    this.listeners.open(frames[largest]);
  }

  /** Move the first frame of a shot, or begin or end a shot at a frame; answers with the cuts. */
  async changeCuts(cuts) {
    try {
      await post("api/clip/cuts", { cuts });
      this.listeners.oncuts(cuts);
    } catch (error) {
      this.listeners.onerror(error);
    }
  }
}

/** The curves and the camera that a new solution gives a frame. */
export function proposed(number) {
  return get(`api/clip/proposed/${number}`);
}
