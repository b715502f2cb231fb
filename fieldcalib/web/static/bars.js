// The bars above the page and above the picture: buttons, with their keys.

import { address } from "./api.js";
import { button, drawIcon, element } from "./dom.js";

const place = (id) => document.getElementById(id);

/** Make the bars of the page; the buttons that change later become properties of the app. */
export function buildBars(app) {
  const labels = element("select", { "aria-label": "Write labels as a file", "data-tip": "Write the labels as a file", class: "menu" },
    element("option", { value: "", text: "Labels…" }),
    ...[["soccernet", "SoccerNet JSON"], ["cvat", "CVAT XML"], ["labelme", "labelme JSON"], ["coco", "COCO JSON"]].map(([value, text]) => element("option", { value, text })),
  );
  labels.addEventListener("change", () => {
    app.saveLabels(labels.value);
    labels.value = "";
  });
  app.saveButton = button("Saved", { icon: "save", keys: "Ctrl+S", press: () => app.save() });
  app.editButtons = {
    undo: button("Undo", { icon: "undo", keys: "Ctrl+Z", word: "Undo", press: () => app.edit({ do: "undo" }) }),
    redo: button("Redo", { icon: "redo", keys: "Ctrl+Shift+Z", word: "Redo", press: () => app.edit({ do: "redo" }) }),
    automatic: button("Find labels automatically", { icon: "automatic", keys: "Shift+A", word: "Find labels", press: () => app.edit({ do: "automatic" }) }),
    copy: button("Copy labels of the previous frame", { icon: "copy", keys: "Shift+C", word: "Copy labels", press: () => app.copyLabels() }),
    next: button("Next mark: the one that helps most", { icon: "next", keys: "Shift+N", word: "Next mark", press: () => app.goToNext() }),
    clear: button("Remove all marks", { icon: "remove", word: "Remove all", press: () => app.edit({ do: "clear" }) }),
  };
  place("top-edit").append(...Object.values(app.editButtons));
  place("top-save").append(app.saveButton, labels);
  place("top-help").append(button("Keys", { icon: "help", keys: "?", word: "Keys", press: () => app.help.toggle() }));
  buildTools(app);
  app.playButton = button("Play", { icon: "play", keys: "Space", word: "Play", press: () => app.play() });
  app.clipButtons = { cut: button("Cut: a shot begins here", { icon: "cut", keys: "Shift+K", word: "Cut", press: () => app.toggleCut() }) };
  place("transport").append(app.playButton, app.clipButtons.cut);
}

function buildTools(app) {
  const tool = (name, word, words, keys) => button(words, { icon: name, keys, word, press: () => app.setTool(name) });
  app.toolButtons = { mark: tool("mark", "Mark", "Mark and select", "1"), foot: tool("foot", "Foot", "Foot: metres on the ground", "2"), ruler: tool("ruler", "Ruler", "Ruler", "3"), offside: tool("offside", "Offside", "Offside line", "4") };
  const toggle = (name, word, words, keys, press, on) => {
    const one = button(words, { icon: name, keys, word, press });
    one.setAttribute("aria-pressed", String(on));
    return one;
  };
  app.toggles = {
    snap: toggle("snap", "Snap", "Snap to paint (Alt: the other way)", "Shift+S", () => app.setSnap(!app.snap), true),
    markings: toggle("markings", "Markings", "Projected markings", "Shift+M", () => app.toggleLayer("markings"), true),
    horizon: toggle("horizon", "Horizon", "Horizon", "Shift+H", () => app.toggleLayer("horizon"), false),
    heat: toggle("heat", "Error map", "Error map: shift of the ground if clicks are 2 px off", "Shift+E", () => app.toggleHeat(), false),
  };
  app.zoomWords = element("output", { class: "zoom-words", "aria-label": "Zoom" });
  const picture = element("a", { class: "button worded", "data-tip": "Save the picture with its markings", "aria-label": "Save the picture with its markings", download: "", href: "#" });
  picture.append(drawIcon("download"), element("span", { text: "Picture" }));
  picture.addEventListener("click", () => {
    picture.href = address(`api/frame/${app.current}/overlay.png`);
    picture.download = `overlay-${app.current}.png`;
  });
  place("tools").append(
    element("div", { class: "group", role: "group", "aria-label": "Tool" }, Object.values(app.toolButtons)),
    element("div", { class: "group", role: "group", "aria-label": "Shown" }, Object.values(app.toggles)),
    element("div", { class: "group push", role: "group", "aria-label": "Zoom" },
      picture,
      button("Farther", { icon: "farther", keys: "-", shown: false, press: () => app.zoom((view) => view.zoomBy(0.8)) }),
      app.zoomWords,
      button("Closer", { icon: "closer", keys: "+", shown: false, press: () => app.zoom((view) => view.zoomBy(1.25)) }),
      button("Whole picture", { icon: "fit", keys: "0", word: "Whole", press: () => app.zoom((view) => view.fit()) }),
      button("100 %: pixels", { icon: "pixels", keys: "9", word: "100 %", press: () => app.zoom((view) => view.zoomTo(1)) }),
    ),
  );
    }
