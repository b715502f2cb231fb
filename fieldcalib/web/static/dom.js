// Elements made from data: text goes in as text, never as HTML.

/** An element with attributes, listeners ({on: {click: ...}}), text or children; null children are left out. */
export function element(tag, attributes = {}, ...children) {
  return filled(document.createElement(tag), attributes, children);
}

/** The same for SVG. */
export function svgElement(tag, attributes = {}, ...children) {
  return filled(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

function filled(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "on") {
      for (const [event, listener] of Object.entries(value)) node.addEventListener(event, listener);
    } else if (name === "text") {
      node.textContent = value;
    } else if (value === true) {
      node.setAttribute(name, "");
    } else if (value !== false && value !== null && value !== undefined) {
      node.setAttribute(name, String(value));
    }
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return node;
}

/** A button with a name for screen readers, a tip with its key, and perhaps an icon; `word`, a part of its name, stands below the icon. */
export function button(words, { icon = null, keys = "", press, kind = "", shown = true, word = "" } = {}) {
  return element(
    "button",
    { type: "button", class: `button ${kind}${word ? " worded" : ""}`, "aria-label": words, "data-tip": words, "data-keys": keys, on: { click: press } },
    icon ? drawIcon(icon) : null,
    shown || word || !icon ? element("span", { text: word || words }) : null,
  );
}

const ICONS = {
  undo: "M9 5 4 10l5 5M4 10h10a6 6 0 0 1 0 12h-3",
  redo: "M15 5l5 5-5 5M20 10H10a6 6 0 0 0 0 12h3",
  save: "M5 4h11l4 4v12H4V5a1 1 0 0 1 1-1zM8 4v5h7V4M8 20v-6h8v6",
  mark: "M12 3v6M12 15v6M3 12h6M15 12h6M12 11.9v.2",
  foot: "M12 4a2 2 0 1 0 .01 0M12 9v7M8 12h8M7 20a5 2 0 1 0 10 0a5 2 0 1 0-10 0",
  ruler: "M3 16 16 3l5 5L8 21zM7 12l2 2M10 9l3 3M13 6l2 2",
  offside: "M7 3v18M7 4h11l-3 4 3 4H7",
  snap: "M6 4v8a6 6 0 0 0 12 0V4h-4v8a2 2 0 0 1-4 0V4zM6 8h4M14 8h4",
  markings: "M3 6h18v13H3zM12 6v13M12 12.5m-3 0a3 3 0 1 0 6 0a3 3 0 1 0-6 0",
  horizon: "M3 15h18M6 15a6 6 0 0 1 12 0M12 4v2M4 8l1.5 1.5M20 8l-1.5 1.5",
  fit: "M4 9V4h5M15 4h5v5M20 15v5h-5M9 20H4v-5",
  pixels: "M4 4h16v16H4zM4 12h16M12 4v16",
  closer: "M12 5v14M5 12h14",
  farther: "M5 12h14",
  help: "M9 9a3 3 0 1 1 4.5 2.6c-1 .6-1.5 1.2-1.5 2.4M12 18v.3",
  play: "M7 4v16l13-8z",
  pause: "M7 4h3v16H7zM14 4h3v16h-3z",
  locked: "M6 11h12v9H6zM8.5 11V8a3.5 3.5 0 0 1 7 0v3",
  open: "M6 11h12v9H6zM8.5 11V7a3.5 3.5 0 0 1 6.8-1.2",
  remove: "M5 7h14M10 7V4h4v3M7 7l1 13h8l1-13M10.5 11v6M13.5 11v6",
  copy: "M9 9h11v11H9zM5 15H4V4h11v1",
  automatic: "M12 3l2 6 6 2-6 2-2 6-2-6-6-2 6-2zM19 16v5M16.5 18.5h5",
  next: "M12 12m-3 0a3 3 0 1 0 6 0a3 3 0 1 0-6 0M12 2v4M12 18v4M2 12h4M18 12h4",
  cut: "M6 6m-2.5 0a2.5 2.5 0 1 0 5 0a2.5 2.5 0 1 0-5 0M6 18m-2.5 0a2.5 2.5 0 1 0 5 0a2.5 2.5 0 1 0-5 0M8 7.5 20 18M8 16.5 20 6",
  join: "M3 12h6M15 12h6M6 8v8M18 8v8M9 12h6",
  heat: "M4 20V10M9 20V4M14 20v-8M19 20V7",
  clear: "M5 5l14 14M19 5 5 19",
  download: "M12 4v11M7 11l5 5 5-5M4 20h16",
  solve: "M4 12a8 8 0 0 1 14-5l2 2M20 4v5h-5M20 12a8 8 0 0 1-14 5l-2-2M4 20v-5h5",
};

/** A drawn icon in the colour of the text. */
export function drawIcon(name) {
  return svgElement("svg", { viewBox: "0 0 24 24", class: "icon", "aria-hidden": "true" }, svgElement("path", { d: ICONS[name] }));
}

/** Replace an icon in a button. */
export function changeIcon(of, name) {
  of.querySelector(".icon path").setAttribute("d", ICONS[name]);
}

/** A number for people: so many digits after the point; a dash where there is none. */
export function shownNumber(value, digits = 1) {
  return value === null || value === undefined || !Number.isFinite(value) ? "–" : value.toFixed(digits).replace("-", "−");
}

/** Metres: centimetres matter below ten. */
export function shownMetres(value) {
  return `${shownNumber(value, Math.abs(value) < 10 ? 2 : 1)} m`;
}

/** A count with its noun. */
export function counted(count, noun) {
  return `${count.toLocaleString("en")} ${noun}${count === 1 ? "" : "s"}`;
}
