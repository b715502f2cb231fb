// The marks of a frame as a list, and the bar for those that are selected: another label, remove.

import { get } from "./api.js";
import { button, counted, element, shownNumber } from "./dom.js";

/** The list of marks by label, in an element that it fills. */
export class MarkList {
  constructor(root, { select, choose, remove }) {
    this.root = root;
    this.actions = { select, choose, remove };
    root.setAttribute("aria-label", "Marks");
  }

  show(frame, selected, chosen) {
    const groups = new Map();
    frame.marks.forEach((mark, number) => groups.set(mark.label, [...(groups.get(mark.label) ?? []), { ...mark, number }]));
    if (!groups.size) {
      this.root.replaceChildren(
        element("div", { class: "empty" },
          element("p", { text: "No marks yet." }),
          element("p", { class: "dim", text: "Choose a marking on the map or by its key, then click along it in the picture. Seven clicks on three or four markings are enough for a good camera of most pictures." }),
          frame.gets_marks ? element("p", { class: "dim", text: "With the first one the marks that the network finds appear here too, with less weight: remove those that are wrong." }) : null,
        ),
      );
      return;
    }
    const rows = [...groups].map(([label, marks]) => this.row(label, marks, selected, chosen));
    this.root.replaceChildren(element("p", { class: "dim small", text: "Right: how far the farthest mark lies from its marking. The rms of the verdict is of the paint that the camera was fitted to." }), ...rows);
  }

  row(label, marks, selected, chosen) {
    const numbers = marks.map(({ number }) => number);
    const suspect = marks.find((mark) => mark.suspect);
    const errors = marks.map(({ error }) => error).filter(Number.isFinite);
    const leftOut = marks.filter((mark) => mark.left_out).length;
    const off = errors.length ? `${shownNumber(Math.max(...errors), 1)} px` : "";
    const isSelected = numbers.every((number) => selected.has(number));
    const choose = element(
      "button",
      { type: "button", class: "mark-name", "aria-pressed": String(isSelected), "data-tip": "Select these marks; twice: choose the marking", on: { click: (event) => (event.detail === 2 ? this.actions.choose(label) : this.actions.select(numbers)) } },
      element("span", { class: `mark-dot${suspect ? " suspect" : leftOut === marks.length ? " left-out" : ""}` }),
      element("span", { class: "mark-label", text: label }),
      element("span", { class: "dim", text: `× ${marks.length}` }),
      element("span", { class: `push ${suspect ? "warn" : "dim"}`, text: off }),
    );
    const remove = button(`Remove ${label}`, { icon: "remove", kind: "quiet", shown: false, press: () => this.actions.remove(numbers) });
    return element(
      "div",
      { class: `mark-row${label === chosen ? " chosen" : ""}` },
      choose,
      remove,
      suspect ? element("p", { class: "warn small", text: suspect.fits ? `In doubt: it fits ${suspect.fits}.` : "In doubt: the other labels contradict it." }) : null,
      leftOut ? element("p", { class: "dim small", text: `Left out of the camera as stray${leftOut < marks.length ? `: ${leftOut} of ${marks.length}` : ""}.` }) : null,
    );
  }
}

/** The bar over the picture for the selected marks. */
export class SelectionBar {
  constructor(root, { relabel, remove, clear }) {
    this.root = root;
    this.words = element("span");
    this.labels = element("select", { "aria-label": "Label of the selected marks", "data-tip": "Another label, the likely ones first", "data-keys": "Shift+L", on: { change: () => relabel(this.labels.value) } });
    root.append(
      this.words,
      this.labels,
      button("Remove", { icon: "remove", keys: "Delete", press: remove }),
      button("Deselect", { icon: "clear", keys: "Esc", kind: "quiet", shown: false, press: clear }),
    );
  }

  /** Show the selected marks of a frame, and ask for their likely labels. */
  async show(frame, selected, labels) {
    const numbers = [...selected].filter((number) => number < frame.marks.length);
    this.root.classList.toggle("shown", numbers.length > 0);
    this.root.toggleAttribute("inert", numbers.length === 0);
    const key = `${frame.number} ${frame.revision} ${numbers.join()} ${numbers.map((number) => frame.marks[number].label).join()}`;
    if (!numbers.length || key === this.key) {
      if (!numbers.length) this.key = null;
      return;
    }
    this.key = key;
    const names = new Set(numbers.map((number) => frame.marks[number].label));
    const now = names.size === 1 ? [...names][0] : "";
    this.words.textContent = counted(numbers.length, "mark");
    this.fill(labels, now);
    const { x, y } = frame.marks[numbers[0]];
    try {
      const likely = await get(`api/frame/${frame.number}/likely`, { query: { x, y } });
      if (this.key === key) this.fill(likely.labels, now, Boolean(frame.camera));
    } catch {
      // the labels stay in the order of the field
    }
  }

  fill(labels, now, sorted = false) {
    const options = labels.map((label, rank) =>
      element("option", { value: label, text: sorted && rank === 0 ? `${label} (likely)` : label, selected: label === now }),
    );
    if (!now) options.unshift(element("option", { value: "", text: "Several labels", selected: true, disabled: true }));
    else if (!labels.includes(now)) options.unshift(element("option", { value: now, text: now, selected: true }));
    this.labels.replaceChildren(...options);
    this.labels.value = now;
  }
}
