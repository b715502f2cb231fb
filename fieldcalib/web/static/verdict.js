// The verdict on a camera, by a shape, a colour and a word; the reason and what would help, in words.

import { button, counted, element, shownNumber, svgElement } from "./dom.js";

/** Words and colours (custom properties of style.css) by verdict; "" has no camera or was not looked at yet. */
export const VERDICTS = {
  good: { words: "Good", means: "use the camera", colour: "--good", shape: "M8 2a6 6 0 1 0 .01 0z" },
  check: { words: "Check", means: "look at the frame", colour: "--check", shape: "M8 1.8 15 14H1z" },
  reject: { words: "Reject", means: "do not use the camera", colour: "--reject", shape: "M3.6 1.6 8 6l4.4-4.4 2 2L10 8l4.4 4.4-2 2L8 10l-4.4 4.4-2-2L6 8 1.6 3.6z" },
  "": { words: "No camera", means: "", colour: "--none", shape: "M8 2.2a5.8 5.8 0 1 0 .01 0zm0 2a3.8 3.8 0 1 1-.01 0z" },
};

/** What is known of a verdict that a file may name otherwise. */
export function verdictOf(name) {
  return VERDICTS[name] ?? VERDICTS[""];
}

/** The shape of a verdict: a disc, a triangle, a cross, a ring. */
export function verdictShape(name) {
  const { words, shape } = verdictOf(name);
  return svgElement(
    "svg",
    { viewBox: "0 0 16 16", class: `shape verdict-${name in VERDICTS && name ? name : "none"}`, role: "img", "aria-label": words },
    svgElement("path", { d: shape }),
  );
}

/** Draw the shape of a verdict on a canvas. */
export function paintVerdict(context, name, x, y, size, colour) {
  context.save();
  context.translate(x - size / 2, y - size / 2);
  context.scale(size / 16, size / 16);
  context.fillStyle = colour;
  context.fill(new Path2D(verdictOf(name).shape), "evenodd");
  context.restore();
}

/** The card that says whether a camera can be used, why, and what would help: of one height, or of a larger one on request where that cuts the words. */
export class VerdictCard {
  constructor(root, { here = "" } = {}) {
    this.root = root;
    this.here = here; // how the words begin that say how the remedy is followed
    this.number = null;
    this.words = element("div", { class: "verdict-words", role: "status", "aria-label": "Verdict on the camera" });
    this.more = button("More", { kind: "verdict-more small", press: () => this.open(!this.isOpen) });
    root.replaceChildren(this.words, this.more);
    this.resizing = new ResizeObserver(() => this.measure());
    this.resizing.observe(this.words);
  }

  /** Show the verdict of a frame: verdict, reason, remedy, message, basis, probability, by_hand, milliseconds. */
  show(frame) {
    const begins = frame.by_hand && frame.marks?.length === 0 ? { words: "Begin", means: "label three or four markings" } : null;
    const goesOn = frame.more ? { words: "Go on", means: `${counted(frame.more, "more marking")} for a camera` } : begins;
    const name = frame.problem || goesOn ? "" : frame.verdict;
    const { words, means } = goesOn ?? verdictOf(name);
    const rows = [
      element(
        "div",
        { class: "verdict-title" },
        verdictShape(name),
        element("strong", { text: words }),
        means ? element("span", { class: "dim", text: frame.camera === null && !goesOn ? "there is no camera" : means }) : null,
      ),
    ];
    if (frame.remedy && name !== "good" && !goesOn) rows.push(element("p", { class: "verdict-remedy", text: sentence(frame.remedy) }));
    if (frame.here && name !== "good" && !goesOn) rows.push(element("p", { class: "verdict-remedy verdict-here", text: `${this.here}: ${frame.here}.` }));
    const reason = frame.problem ? `${frame.problem}.` : goesOn ? "" : sentence(frame.reason || frame.message);
    if (reason) rows.push(element("p", { class: "verdict-reason", text: reason }));
    const leftOut = leftOutWords(frame);
    if (leftOut) rows.push(element("p", { class: "verdict-left-out", text: leftOut }));
    const facts = basisWords(goesOn ? { ...frame, probability: null } : frame);
    if (facts) rows.push(element("p", { class: "dim small", text: facts }));
    this.words.replaceChildren(...rows);
    this.root.dataset.verdict = name;
    if (frame.number !== this.number) this.words.scrollTop = 0;
    this.number = frame.number;
    this.measure();
  }

  get isOpen() {
    return this.root.classList.contains("open");
  }

  /** Let the card be as high as its words, or of the usual height: it stays so for other frames, and nothing below it jumps. */
  open(isOpen) {
    this.root.classList.toggle("open", isOpen);
    this.more.setAttribute("aria-expanded", String(isOpen));
    const words = isOpen ? "Less" : "More";
    this.more.querySelector("span").textContent = words;
    this.more.setAttribute("aria-label", `${words} of the verdict`);
    this.more.dataset.tip = isOpen ? "Make the verdict as high as before" : "Show all of the verdict";
    this.measure();
  }

  /** Say where words are cut. */
  measure() {
    const isCut = this.words.scrollHeight > this.words.clientHeight + 1;
    this.words.tabIndex = isCut ? 0 : -1; // arrow keys scroll it
    this.more.hidden = !isCut && !this.isOpen;
  }
}

function likelihood({ metres, value }) {
  const percent = value > 0.999 ? "more than 99.9" : shownNumber(100 * value, value > 0.99 ? 1 : 0);
  return `${percent} % sure within ${shownNumber(metres, Number.isInteger(metres) ? 0 : 1)} m`;
}

function basisWords(frame) {
  const suspects = new Set((frame.marks ?? []).filter((mark) => mark.suspect).map((mark) => mark.label)).size;
  const facts = frame.probability ? [`${frame.verdict === "good" ? "" : "by its labels alone "}${likelihood(frame.probability)}`] : [];
  if (frame.camera === null) return "";
  if (frame.by_hand) facts.push(frame.basis || "labelled by hand");
  else if (frame.automatic) facts.push("found automatically");
  else if (frame.basis) facts.push(frame.basis);
  if (suspects) facts.push(`${counted(suspects, "label")} in doubt`);
  return sentence(facts.join(", "));
}

/** Which labels of the network the camera does not follow; they have no part in the rms that its reason says. */
function leftOutWords(frame) {
  const labels = new Map();
  for (const mark of frame.marks ?? []) {
    const seen = labels.get(mark.label) ?? { count: 0, left: 0, error: 0 };
    const left = mark.left_out ? 1 : 0;
    labels.set(mark.label, { count: seen.count + 1, left: seen.left + left, error: Math.max(seen.error, left * (mark.error ?? 0)) });
  }
  const said = [...labels]
    .filter(([, { left }]) => left)
    .map(([label, { count, left, error }]) => `${label} (${left < count ? `${left} of ${counted(count, "mark")}, ` : ""}${shownNumber(error, 0)} px off)`);
  return said.length ? `Left out of the camera as stray: ${said.join(", ")}. The rms is of the pixels that it was fitted to.` : "";
}

/** Words as a sentence: a capital letter first, a full stop last. */
export function sentence(words) {
  const text = String(words).trim();
  return text ? text[0].toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? "" : ".") : "";
}
