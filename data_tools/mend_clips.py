"""How many frames of a rendered clip a person has to mend until all cameras are right.

    python -m data_tools.mend_clips CLIP.mp4 ...

Beside each clip lie its true cameras (`data_tools.synthetic`). The labels of a third of its keyframes are spoiled: some
labels are exchanged with those of the other side or of a neighbour, in other keyframes all are moved by 40 px in one
direction. Then the frame with the largest error is mended, by clicks on six markings that are 2 px off and snap to
paint, and the clip is solved again, until no point of the ground in view is off by more than 3 px.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from data_tools.random_frames import mislabelled
from data_tools.synthetic.film import read_cameras
from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.editor.clip import FirstPass, Proposal, first_pass, largest_move, solve, window_around
from fieldcalib.editor.fitting import included_network
from fieldcalib.editor.frame import FrameEditor
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.clip_keyframes import KeyframeLabels, are_consistent
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.run_folder.numbered_frames import NumberedFrames, NumberedVideo
from fieldcalib.solve.from_segments import calibrate_from_segments

SHARE = 1.0 / 3.0  # of the keyframes
SHIFT = 40.0  # px of labels that are moved
LARGEST = 3.0  # px of an error
MOST = 8  # frames that are mended
CLICKED, CLICK = 6, 2.0  # markings, and px that a click is off
BORDER = 8.0  # px


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print a line for each clip."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip", nargs="+", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    for path in options.clip:
        errors = mended(path, options.seed)
        said = ", ".join(f"{one:.1f}" for one in errors)
        print(f"{path.stem}: {len(errors) - 1} frames mended; largest error {said} px", flush=True)


def mended(path: Path, seed: int) -> list[float]:
    """The largest error after no, one, two ... frames were mended, pixels."""
    frames, field, network = NumberedVideo(path), soccer(), included_network()
    truth = [one.camera for one in read_cameras(path.with_suffix(".jsonl"))]
    rng = np.random.default_rng(seed)
    first = first_pass(frames, window_around(len(frames), []), field, network, {}, _silent)
    spoiled = with_spoiled_labels(first, field, rng)
    anchors: dict[int, Calibration] = {}
    found: list[float] = []
    while True:
        solved = solve(frames, spoiled, anchors, None, lambda number: None, network, _silent)
        errors = errors_of(solved, truth)
        found.append(float(np.nanmax(errors)))
        if found[-1] <= LARGEST or len(anchors) == MOST:
            return found
        worst = int(np.nanargmax(np.where(np.isin(np.arange(len(errors)), list(anchors)), -1.0, errors)))
        anchors[worst] = labelled(frames, worst, truth[worst], field, rng).calibration


def errors_of(solved: Proposal, truth: Sequence[Camera]) -> Array:
    """Largest error of the ground in view of each frame, pixels; NaN without a camera."""
    return np.array([largest_move(truth[n], one.camera) for n, one in solved.calibrations.items()])


def with_spoiled_labels(first: FirstPass, field: Field, rng: np.random.Generator) -> FirstPass:
    """Spoil the labels of a third of the keyframes."""
    labels = dict(first.keyframes.labels)
    for k, t in enumerate(rng.permutation(sorted(labels))[: round(SHARE * len(labels))].tolist()):
        pixels = _spoiled(labels[t].labels.by_label(0), field, rng, is_moved=bool(k % 2))
        found = calibrate_from_segments(field, pixels, first.keyframes.shots.image_size)
        if found.solved is None:
            del labels[t]
        else:  # as `fieldcalib.images.clip_keyframes.labels_of` does
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


def labelled(frames: NumberedFrames, number: int, truth: Camera, field: Field, rng: np.random.Generator) -> FrameEditor:
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
