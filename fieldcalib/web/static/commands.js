// What keys do, with the words of the help.

/** Commands of the page, {keys, words, group, run}. */
export function commandsOf(app) {
  const zoom = (change) => () => app.zoom(change);
  const nudge = (key, dx, dy) => [
    { keys: [`Ctrl+${key}`], group: "", run: () => app.nudge(dx, dy) },
    { keys: [`Ctrl+Shift+${key}`], group: "", run: () => app.nudge(dx / 10, dy / 10) },
  ];
  const arrow = (key, dx, dy) => [
    { keys: [key], group: "", run: () => app.arrow(10 * dx, 10 * dy) },
    { keys: [`Shift+${key}`], group: "", run: () => app.arrow(dx, dy) },
  ];
  return [
    { keys: ["Ctrl+Z"], words: "Undo", group: "Labels", run: () => app.edit({ do: "undo" }) },
    { keys: ["Ctrl+Shift+Z", "Ctrl+Y"], words: "Redo", group: "Labels", run: () => app.edit({ do: "redo" }) },
    { keys: ["Delete", "Backspace"], words: "Remove the selected marks", group: "Labels", run: () => app.remove() },
    { keys: ["Ctrl+A"], words: "Select all marks", group: "Labels", run: () => app.edits && app.select(app.edits.shown.marks.keys()) },
    { keys: ["Shift+L"], words: "Another label for them", group: "Labels", run: () => app.selection.labels.focus() },
    { keys: ["Shift+N"], words: "The mark that helps most", group: "Labels", run: () => app.goToNext() },
    { keys: ["Shift+C"], words: "Copy labels of the previous frame", group: "Labels", run: () => app.copyLabels() },
    { keys: ["Shift+A"], words: "Find labels automatically", group: "Labels", run: () => app.edit({ do: "automatic" }) },
    { keys: ["Shift+S"], words: "Snap to paint, or not", group: "Labels", run: () => app.setSnap(!app.snap) },
    { keys: ["Enter"], words: "A pointer that arrow keys move; again: click there", group: "Tools", run: () => app.pointing.enter() },
    { keys: ["Escape"], words: "Let go: selection, marking, tool", group: "Labels", run: () => app.escape() },
    { keys: ["Ctrl+S"], words: "Save", group: "Labels", run: () => app.save() },
    { keys: ["1"], words: "Mark and select", group: "Tools", run: () => app.setTool("mark") },
    { keys: ["2"], words: "Foot: metres on the ground", group: "Tools", run: () => app.setTool("foot") },
    { keys: ["3"], words: "Ruler", group: "Tools", run: () => app.setTool("ruler") },
    { keys: ["4"], words: "Offside line", group: "Tools", run: () => app.setTool("offside") },
    { keys: ["+", "="], words: "Closer", group: "Picture", run: zoom((view, at) => view.zoomBy(1.25, at)) },
    { keys: ["-"], words: "Farther", group: "Picture", run: zoom((view, at) => view.zoomBy(0.8, at)) },
    { keys: ["0"], words: "Whole picture", group: "Picture", run: zoom((view) => view.fit()) },
    { keys: ["9"], words: "100 %: pixels", group: "Picture", run: zoom((view, at) => view.zoomTo(1, at)) },
    { keys: ["Shift+M"], words: "Show or hide the markings", group: "Picture", run: () => app.toggleLayer("markings") },
    { keys: ["Shift+P"], words: "Show or hide the marks", group: "Picture", run: () => app.toggleLayer("marks") },
    { keys: ["Shift+H"], words: "Horizon", group: "Picture", run: () => app.toggleLayer("horizon") },
    { keys: ["Shift+E"], words: "Error map", group: "Picture", run: () => app.toggleHeat() },
    ...arrow("ArrowLeft", -1, 0),
    ...arrow("ArrowRight", 1, 0),
    ...arrow("ArrowUp", 0, -1),
    ...arrow("ArrowDown", 0, 1),
    { keys: ["PageUp"], words: "Ten frames back", group: "Frames", run: () => app.step(-10) },
    { keys: ["PageDown"], words: "Ten frames on", group: "Frames", run: () => app.step(10) },
    { keys: ["Home"], words: "First frame", group: "Frames", run: () => app.step(-Infinity) },
    { keys: ["End"], words: "Last frame", group: "Frames", run: () => app.step(Infinity) },
    { keys: [","], words: "Previous frame in doubt", group: "Frames", run: () => app.stepInDoubt(-1) },
    { keys: ["."], words: "Next frame in doubt", group: "Frames", run: () => app.stepInDoubt(1) },
    { keys: ["Shift+W"], words: "Worst frames first, or in order", group: "Frames", run: () => app.list.setWorstFirst(!app.list.worstFirst) },
    { keys: ["Space"], words: "Play, pause", group: "Frames", run: () => app.play() },
    { keys: ["Shift+K"], words: "A shot begins here, or not", group: "Frames", run: () => app.toggleCut() },
    { keys: ["?"], words: "This help", group: "Frames", run: () => app.help.toggle() },
    ...nudge("ArrowLeft", -1, 0),
    ...nudge("ArrowRight", 1, 0),
    ...nudge("ArrowUp", 0, -1),
    ...nudge("ArrowDown", 0, 1),
  ];
}

/** What the pointer does, and keys with a range. */
export const EXTRA_HELP = [
  { keys: ["a–z"], words: "Choose a marking by the letters on the map", group: "Labels" },
  { keys: ["Ctrl+arrows"], words: "Move the selected marks by 1 px; with Shift 0.1 px", group: "Labels" },
  { keys: ["Alt"], words: "While clicking: the other way about snapping", group: "Labels" },
  { keys: ["arrows"], words: "After Enter: move the pointer; with Shift by single pixels", group: "Tools" },
  { keys: ["ArrowLeft", "ArrowRight"], words: "Previous, next frame", group: "Frames" },
  { keys: ["drag"], words: "With a marking chosen: marks along the stroke", group: "Pointer" },
  { keys: ["drag"], words: "A mark: move all that are selected", group: "Pointer" },
  { keys: ["Shift+drag"], words: "Select with a rubber band", group: "Pointer" },
  { keys: ["wheel"], words: "Closer or farther at the pointer", group: "Pointer" },
  { keys: ["right drag"], words: "Move the picture", group: "Pointer" },
];
