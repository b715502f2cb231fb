// Keys: letters choose markings, digits choose tools, Shift with a letter does something else. The help is made of these.

const PAUSE = 700; // ms after which letters of a key are no longer taken together

/** Listens to keys. `commands`: [{keys: ["Ctrl+Z"], words, group, run}]. */
export class Keys {
  constructor(commands, { choose, typed }) {
    this.commands = new Map(commands.flatMap((command) => command.keys.map((key) => [key, command])));
    this.choose = choose;
    this.typed = typed;
    this.byKey = new Map();
    this.letters = "";
    document.addEventListener("keydown", (event) => this.press(event));
  }

  /** The markings' keys. */
  setField(field) {
    this.byKey = new Map(field.segments.filter(({ key }) => key).map(({ key, label }) => [key.toLowerCase(), label]));
  }

  press(event) {
    if (event.defaultPrevented || document.querySelector("dialog[open]")) return;
    if (isText(event.target) && !(event.ctrlKey && event.key.toLowerCase() === "s")) return;
    const name = nameOf(event);
    if ((name === "Space" || name === "Enter") && event.target.closest("button, a, select, summary, [role=button]")) return;
    if (event.target instanceof HTMLSelectElement && (name.length === 1 || name.startsWith("Arrow"))) return;
    if (/^Arrow(Up|Down)$/.test(name) && event.target.closest("#verdict")) return; // they scroll it
    const command = this.commands.get(name);
    if (command) {
      event.preventDefault();
      command.run();
    } else if (/^[a-z]$/.test(name) && !event.repeat) {
      event.preventDefault();
      this.letter(name);
    }
  }

  letter(letter) {
    clearTimeout(this.timer);
    const known = [...this.byKey.keys()];
    this.letters += letter;
    if (!known.some((key) => key.startsWith(this.letters))) this.letters = known.some((key) => key.startsWith(letter)) ? letter : "";
    const label = this.byKey.get(this.letters);
    const longer = known.some((key) => key !== this.letters && key.startsWith(this.letters));
    this.typed(this.letters);
    if (label && !longer) return this.end(label);
    this.timer = setTimeout(() => this.end(label), PAUSE);
    return undefined;
  }

  end(label) {
    this.letters = "";
    this.typed("");
    if (label) this.choose(label);
  }
}

function isText(target) {
  return target instanceof HTMLInputElement || target instanceof HTMLTextAreaElement;
}

/** "Ctrl+Shift+Z", "Shift+S", "ArrowLeft", "Space", "a": Command counts as Ctrl; Shift is named with letters and arrows. */
function nameOf(event) {
  const key = event.key === " " ? "Space" : event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const isNamed = key.length > 1 || /^[a-z]$/.test(key);
  return [event.ctrlKey || event.metaKey ? "Ctrl" : "", event.shiftKey && isNamed ? "Shift" : "", key.length === 1 && (event.ctrlKey || event.metaKey || (event.shiftKey && isNamed)) ? key.toUpperCase() : key].filter(Boolean).join("+");
}
