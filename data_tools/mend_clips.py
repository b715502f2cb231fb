"""How many frames of rendered clips a person has to mend until all cameras are right.

    python -m data_tools.mend_clips FOLDER --seeds 4

Clips of several cameras are rendered into the folder, unless they are there, with their true cameras beside them. For
each seed the labels of a third of the keyframes of a clip are spoiled: some labels are exchanged with those of the
other side or of a neighbour, in other keyframes all are moved by 40 px in one direction. Then one frame after the other
is mended, by clicks on the six longest markings, 2 px off, which snap to paint; after each the clip is solved again,
until every frame has a camera and no marking in view is more than 3 px beside its paint.

The frame that the editor proposes next is mended if its camera is wrong. Else the person, who sees which frames are
wrong, mends the one with most markings in the longest stretch of them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data_tools.random_frames import mislabelled
from data_tools.synthetic.film import CAMERAS, CLIP_SIZE, LEAST_PATH, PAINTED, Scene, write_clip
from data_tools.synthetic.paths import camera_path, with_displaced_lines
from fieldcalib._types import Array
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.result import Calibration
from fieldcalib.editor.clip import FirstPass, Proposal, first_pass, next_frame, solve, window_around
from fieldcalib.editor.edit import Marks
from fieldcalib.editor.fitting import included_network, mark_errors
from fieldcalib.editor.frame import FrameEditor
from fieldcalib.editor.frame_states import Row
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.clip.keyframes import KeyframeLabels, are_consistent
from fieldcalib.io.frame_source import FrameSource, VideoFrames
from fieldcalib.io.samples import TrueFrame, read_cameras
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.solve.from_segments import calibrate_from_segments

SHARE = 1.0 / 3.0  # of the keyframes
SHIFT = 40.0  # px of labels that are moved
LARGEST = 3.0  # px of an error
MOST = 5  # frames that are mended
CLICKED, CLICK = 6, 2.0  # markings, and px that a click is off
BORDER = 8.0  # px
SPACING = 1.0  # m between the points of a marking whose errors are measured


@dataclass(frozen=True)
class Filmed:
    """A clip to be rendered: a camera on a tripod, which pans, tilts and zooms."""

    seed: int
    pan_range: tuple[float, float] = (-15.0, 15.0)
    """Degrees."""
    centre: tuple[float, float, float] | None = None
    """Metres; drawn if it is None."""
    field_size: tuple[float, float] = (105.0, 68.0)

    @property
    def field(self) -> Field:
        """The field, with lines that are painted some centimetres off."""
        return with_displaced_lines(soccer(*self.field_size), np.random.default_rng((self.seed, PAINTED)))

    def write(self, path: Path) -> None:
        """Render the clip, and write its cameras beside it."""
        rng = np.random.default_rng((self.seed, CAMERAS))
        low, high = np.radians(self.pan_range).tolist()
        cameras = camera_path(rng, LEAST_PATH, pan_range=(low, high), centre=self.centre, image_size=CLIP_SIZE)
        scene = Scene.random(self.field, self.seed, cameras)
        write_clip(path, scene, [TrueFrame(camera, 0, 0) for camera in cameras])


CLIPS = {
    "main": Filmed(1),
    "end": Filmed(2, (8.0, 30.0), (0.0, 70.0, -14.0)),
    "wide": Filmed(3, (-30.0, 30.0), (4.0, 85.0, -20.0), (100.0, 64.0)),
    "side": Filmed(4, (-25.0, 5.0), (-14.0, 63.0, -12.0), (110.0, 72.0)),
}
"""By name: around the middle; one end; far away and high, a small pitch; low and beside the middle, a large one."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print a line for each clip and seed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of the rendered clips")
    parser.add_argument("--clips", nargs="+", choices=list(CLIPS), default=list(CLIPS), metavar="NAME")
    parser.add_argument("--seeds", type=int, default=4, metavar="N", help="how often labels are spoiled (4)")
    options = parser.parse_args(arguments)
    for name in options.clips:
        path = options.folder / f"{name}.mp4"
        if not path.exists():
            options.folder.mkdir(parents=True, exist_ok=True)
            CLIPS[name].write(path)
        frames, network = VideoFrames(path), included_network()
        first = first_pass(frames, window_around(len(frames), []), soccer(), network, {}, _silent)
        truth = [one.camera for one in read_cameras(path.with_suffix(".jsonl"))]
        for seed in range(options.seeds):
            errors = mended(frames, first, truth, CLIPS[name].field, seed)
            said = ", ".join(f"{one:.1f}" for one in errors)
            number = f"{len(errors) - 1} frames mended" if errors[-1] <= LARGEST else f"not right with {MOST} frames"
            print(f"{name}, seed {seed}: {number}; largest error {said} px", flush=True)


def mended(frames: FrameSource, first: FirstPass, truth: Sequence[Camera], field: Field, seed: int) -> list[float]:
    """The largest error after no, one, two ... frames were mended, pixels."""
    rng = np.random.default_rng(seed)
    spoiled = with_spoiled_labels(first, soccer(), rng)
    anchors: dict[int, Calibration] = {}
    found: list[float] = []
    while True:
        solved = solve(frames, spoiled, anchors, None, lambda number: None, _silent)
        errors = errors_of(solved, truth, field)
        found.append(float(np.max(errors)))
        if found[-1] <= LARGEST or len(anchors) == MOST:
            return found
        number = to_mend(frames, solved, errors)
        anchors[number] = labelled(frames, number, truth[number], field, rng).calibration


def to_mend(frames: FrameSource, solved: Proposal, errors: Array) -> int:
    """The frame that is mended next."""
    network, field = included_network(), soccer()
    rows = [Row.of(one, by_hand=n in solved.anchors) for n, one in solved.calibrations.items()]
    proposed = next_frame(frames, rows, field, network)
    if proposed is not None and errors[proposed] > LARGEST:
        return proposed
    seen = [
        row._replace(verdict=str(Verdict.REJECT if error > LARGEST else Verdict.GOOD), concern=1.0)
        for row, error in zip(rows, errors.tolist(), strict=True)
    ]
    chosen = next_frame(frames, seen, field, network)
    return int(np.argmax(errors)) if chosen is None else chosen


def errors_of(solved: Proposal, truth: Sequence[Camera], field: Field) -> Array:
    """Largest distance of the markings in view of each frame from where its camera projects them, pixels.

    The markings are where they are painted, some centimetres off. Infinite without a camera.
    """
    return np.array([_error(truth[n], one, field) for n, one in solved.calibrations.items()])


def _error(truth: Camera, found: Calibration, field: Field) -> float:
    if found.camera is None or found.field is None:
        return np.inf
    (errors,) = mark_errors(found.field, Marks.of(markings_in_view(truth, field)), [found.camera])
    return float(np.max(errors, initial=0.0))


def markings_in_view(camera: Camera, field: Field) -> Pixels:
    """Pixels of the markings of the field, goals among them, every metre."""
    size = np.array(camera.image_size)
    seen = {}
    for label, segment in field.markings.items():
        xy = camera.project(segment.sample(SPACING))
        with np.errstate(invalid="ignore"):
            xy = xy[np.all((xy >= 0.0) & (xy < size), axis=1)]
        if len(xy) and label not in field.half_labels:
            seen[label] = xy
    return seen


def with_spoiled_labels(first: FirstPass, field: Field, rng: np.random.Generator) -> FirstPass:
    """Spoil the labels of a third of the keyframes."""
    labels = dict(first.keyframes.labels)
    for k, t in enumerate(rng.permutation(sorted(labels))[: round(SHARE * len(labels))].tolist()):
        pixels = _spoiled(labels[t].labels.by_label(0), field, rng, is_moved=bool(k % 2))
        found = calibrate_from_segments(field, pixels, first.keyframes.shots.image_size)
        if found.solved is None:
            del labels[t]
        else:  # as `fieldcalib.images.clip.keyframes.labels_of` does
            evaluation = found.solved.alone.evaluation
            labels[t] = KeyframeLabels(found.solved.pixels, found.accepted, are_consistent(evaluation))
    return replace(first, keyframes=replace(first.keyframes, labels=labels))


def _spoiled(pixels: Mapping[str, Array], field: Field, rng: np.random.Generator, *, is_moved: bool) -> Pixels:
    if is_moved:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        move = SHIFT * np.array([np.cos(angle), np.sin(angle)])
        return {label: xy + move for label, xy in pixels.items()}
    exchanged, _ = mislabelled(dict(pixels), field, max(len(pixels) // 2, 1), rng)
    return exchanged


def labelled(frames: FrameSource, number: int, truth: Camera, field: Field, rng: np.random.Generator) -> FrameEditor:
    """A frame that is labelled from nothing, by clicks on both ends of the markings that are longest in view."""
    editor = FrameEditor.of(frames.image(number), field)
    ends = dict(_ends(truth, field))
    longest = sorted(ends, key=lambda label: -float(np.linalg.norm(np.diff(ends[label][[0, -1]], axis=0))))
    for label in longest[:CLICKED]:
        editor = editor.mark(label, ends[label] + rng.normal(0.0, CLICK, ends[label].shape))
    return editor


def _ends(camera: Camera, field: Field) -> Iterable[tuple[str, Array]]:
    """Ends of the lines in view, and five places of the arcs."""
    size = np.array(camera.image_size)
    for label, segment in field.markings.items():
        if label in field.half_labels or np.any(segment.sample()[:, 2]):
            continue
        xy = camera.project(segment.sample(0.5))
        xy = xy[np.all((xy > BORDER) & (xy < size - BORDER), axis=1)]
        if len(xy) > 1:
            yield label, xy[np.linspace(0, len(xy) - 1, 2 if segment.is_straight else 5).round().astype(int)]


def _silent(done: int, count: int, stage: str) -> None:
    pass


if __name__ == "__main__":
    main()
