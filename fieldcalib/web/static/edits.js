// The edits of one frame: shown at once, sent one after the other; the state that the server answers with replaces what
// was shown. It has what is drawn; after the last edit the whole state is fetched, with the verdict on the camera. The
// page never waits: more edits may be made meanwhile.

import { get, isGone, post } from "./api.js";

const RETRY = 1000; // ms
const OPAQUE = new Set(["undo", "redo", "copy", "automatic"]); // edits whose result only the server knows

/** A frame's state as of the server, and edits that it has not answered yet. */
export class FrameEdits {
  constructor(state, { onchange, onrefused, onoffline }) {
    this.state = state;
    this.pending = [];
    this.listeners = { onchange, onrefused, onoffline };
  }

  get number() {
    return this.state.number;
  }

  /** The state with the edits that were not answered yet. */
  get shown() {
    return this.pending.reduce(applied, { ...this.state, pending: this.pending.length });
  }

  /** Whether marks have the numbers that they are shown with. */
  get isCertain() {
    const { automatic, marks } = this.state; // the first edit of a frame brings the labels of the network
    return !(this.pending.length && automatic && !marks.length) && !this.pending.some(({ body }) => OPAQUE.has(body.do));
  }

  /** Make an edit, {do, ...} as of api/frame/N/edit. False if it is about marks whose numbers are not known yet. */
  push(body) {
    if (("numbers" in body || "to" in body) && !this.isCertain) return false;
    const last = this.pending.at(-1);
    if (last && !last.sent && replaces(body, last.body)) last.body = body;
    else this.pending.push({ body, sent: false });
    this.send(); // first: the server works while the page draws
    this.listeners.onchange(this);
    return true;
  }

  async send() {
    if (this.sending) return;
    this.sending = true;
    while (this.pending.length || !this.state.judged) {
      const edit = this.pending[0];
      try {
        if (edit) await this.sendFirst(edit);
        else await this.fetchJudged();
      } catch (error) {
        if (isGone(error)) {
          this.listeners.onoffline();
          await new Promise((resolve) => setTimeout(resolve, RETRY));
          continue;
        }
        if (edit) this.pending = []; // later ones were made on what was refused
        this.state = error.body?.state ?? { ...this.state, judged: this.state.judged || !edit };
        this.listeners.onrefused(error, this);
      }
      this.listeners.onchange(this, true);
    }
    this.sending = false;
  }

  /** Send an edit; what is not known before the verdict stays as it was. */
  async sendFirst(edit) {
    edit.sent = true;
    const found = await post(`api/frame/${this.number}/edit`, { revision: this.state.revision, ...edit.body });
    this.state = { ...this.state, ...found };
    this.pending.shift();
  }

  async fetchJudged() {
    const { revision, milliseconds } = this.state;
    const found = await get(`api/frame/${this.number}`);
    if (found.revision === revision) found.milliseconds += milliseconds; // of the fit, which was done before
    if (!this.pending.length) this.state = found;
  }
}

/** Dragging the same marks again, before the first drag was sent: the last place counts. */
function replaces(body, before) {
  if (body.do !== "move" || before.do !== "move") return false;
  return Object.keys(body.to).join() === Object.keys(before.to).join();
}

/** A state with an edit, as far as the page knows its result. */
function applied(state, { body }) {
  const { marks } = state;
  switch (body.do) {
    case "mark":
      return { ...state, marks: [...marks, ...body.xy.map(([x, y]) => ({ label: body.label, x, y, suspect: false, error: null, fits: null, pending: true }))] };
    case "move":
      return { ...state, marks: marks.map((mark, number) => (number in body.to ? { ...mark, x: body.to[number][0], y: body.to[number][1], pending: true } : mark)) };
    case "relabel":
      return { ...state, marks: marks.map((mark, number) => (body.numbers.includes(number) ? { ...mark, label: body.label, suspect: false, left_out: false, pending: true } : mark)) };
    case "remove":
      return { ...state, marks: marks.filter((_, number) => !body.numbers.includes(number)) };
    case "clear":
      return { ...state, marks: [] };
    case "know":
      return { ...state, known: { ...state.known, ...body.values } };
    default:
      return state;
  }
}
