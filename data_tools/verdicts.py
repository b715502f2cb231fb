"""Verdicts on wrong cameras.

    python -m data_tools.verdicts ANNOTATIONS --size WxH [--frames N]

Frames that must not be trusted: labels of two frames in one, labels of the other side, random pixels, and synthetic
cameras in unusual places (2 px noise). One line of JSON for each kind says how many frames there are, how many of their
cameras are wrong (off by more than 1 m somewhere in view, or without a true camera), and how many of the wrong ones are
rejected, to be checked, and good. The last line is for the unchanged annotated frames.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from data_tools.annotated_frames import read_frames
from data_tools.probability import largest_true_error
from data_tools.random_frames import noisy_pixels
from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import add_size, count
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.solve.batch import calibrate_batch

WRONG = 1.0  # m
NOISE, KEPT = 2.0, 0.9  # px, share of the markings in view that is labelled
LEAST_LABELS = 4
SIZE = (960, 540)
BARREL = (-0.25, 0.05)


def mixtures(frames: Sequence[Pixels], number: int, rng: np.random.Generator) -> list[tuple[Pixels, tuple[int, int]]]:
    """Frames with half of the labels of each of two frames, and the indices of these."""
    found: list[tuple[Pixels, tuple[int, int]]] = []
    while len(found) < number:
        a, b = rng.choice(len(frames), 2, replace=False).tolist()
        halves = [
            {
                label: frames[t][label]
                for label in rng.permutation(list(frames[t]))[: (len(frames[t]) + 1) // 2].tolist()
            }
            for t in (a, b)
        ]
        found.append(({**halves[0], **halves[1]}, (a, b)))
    return found


def under_labels_of_other_side(frame: Pixels, field: Field) -> Pixels:
    """The pixels under the labels of the other side: left and right swapped, top and bottom as they are."""

    def other(label: str) -> str:
        swapped = label.replace("left", "LEFT").replace("right", "left").replace("LEFT", "right")
        return swapped if swapped in field else label

    return {other(label): xy for label, xy in frame.items()}


def random_pixels(field: Field, number: int, rng: np.random.Generator) -> list[Pixels]:
    """Frames of random pixels under random labels."""
    labels = [label for label in field.markings if label not in field.half_labels]
    frames = []
    for _ in range(number):
        chosen = rng.choice(len(labels), rng.integers(4, 10), replace=False)
        frames.append({labels[i]: rng.uniform((0.0, 0.0), SIZE, (rng.integers(2, 5), 2)) for i in chosen})
    return frames


def _aimed(C: tuple[float, float, float], f: float, rng: np.random.Generator, k: tuple[float, float]) -> Camera:
    """A camera that looks at a random place of the middle of the field."""
    return _looking_at(rng.uniform((-35.0, -20.0), (35.0, 20.0)), C, f, k)


def _looking_at(place: Array, C: tuple[float, float, float], f: float, k: tuple[float, float]) -> Camera:
    x, y, z = np.array([*place, 0.0]) - C
    return Camera.from_angles(np.arctan2(x, -y), np.arctan2(np.hypot(x, y), z), 0.0, f, C, SIZE, k=k)


def on_the_field(rng: np.random.Generator) -> Camera:
    """A camera two metres high on the field."""
    x, y = rng.uniform((-45.0, -30.0), (45.0, 30.0))
    return _aimed((x, y, -2.0), rng.uniform(600.0, 1500.0), rng, (0.0, 0.0))


def low_behind_the_goal(rng: np.random.Generator) -> Camera:
    """A camera behind a goal, one to three metres high."""
    x, y, z = rng.uniform((54.0, -15.0, -3.0), (62.0, 15.0, -1.0))
    return _aimed((float(rng.choice((-1.0, 1.0))) * x, y, z), rng.uniform(600.0, 2000.0), rng, (0.0, 0.0))


def strong_barrel(rng: np.random.Generator) -> Camera:
    """A wide camera on the main stand with a strong barrel distortion."""
    x, y, z = rng.uniform((-16.0, 45.0, -25.0), (16.0, 80.0, -10.0))
    return _aimed((x, y, z), rng.uniform(500.0, 900.0), rng, BARREL)


def very_long_lens(rng: np.random.Generator) -> Camera:
    """A camera on the main stand with a focal length of 20 000 px, which shows enough lines only at a goal."""
    x, y, z = rng.uniform((-16.0, 60.0, -30.0), (16.0, 100.0, -10.0))
    place = rng.choice((-1.0, 1.0)) * rng.uniform((48.0, -6.0), (52.5, 6.0))
    return _looking_at(place, (x, y, z), 20_000.0, (0.0, 0.0))


def synthetic(
    make: Callable[[np.random.Generator], Camera], field: Field, number: int, rng: np.random.Generator
) -> list[tuple[Pixels, Camera]]:
    """Frames, with enough labels, of cameras of one kind."""
    found: list[tuple[Pixels, Camera]] = []
    for _ in range(400 * number):  # through a long lens few places show enough labels
        if len(found) == number:
            break
        camera = make(rng)
        pixels = noisy_pixels(camera, field, rng, NOISE, KEPT)
        if len(pixels) >= LEAST_LABELS:
            found.append((pixels, camera))
    return found


def row(kind: str, found: Sequence[Calibration], truths: Sequence[Sequence[Camera]], field: Field) -> dict[str, object]:
    """Counts of the verdicts on wrong cameras."""
    verdicts: Counter[str] = Counter()
    for calibration, true_ones in zip(found, truths, strict=True):
        camera = calibration.camera
        if camera is None or not any(largest_true_error(camera, truth, field) <= WRONG for truth in true_ones):
            verdicts[str(calibration.verdict)] += 1
    return {"frames": kind, "count": len(found), "wrong": verdicts.total(), "of_wrong": dict(verdicts)}


def run(options: argparse.Namespace) -> int:
    """Calibrate and print; returns the exit code."""
    rng, field = np.random.default_rng(options.seed), soccer()
    frames = list(read_frames([options.annotations], field, options.size).values())
    real = calibrate_batch(field, frames, options.size)
    cameras = [calibration.uncertainty.camera for calibration in real]

    mixed = mixtures(frames, options.frames, rng)
    found = calibrate_batch(field, [pixels for pixels, _ in mixed], options.size)
    print(json.dumps(row("two frames in one", found, [[cameras[a], cameras[b]] for _, (a, b) in mixed], field)))
    found = calibrate_batch(field, [under_labels_of_other_side(frame, field) for frame in frames], options.size)
    print(json.dumps(row("left for right", found, [[camera] for camera in cameras], field)))
    found = calibrate_batch(field, random_pixels(field, options.frames, rng), SIZE)
    print(json.dumps(row("random pixels", found, [[]] * len(found), field)))
    for make in (on_the_field, low_behind_the_goal, strong_barrel, very_long_lens):
        pairs = synthetic(make, field, options.frames // 10, rng)
        found = calibrate_batch(field, [pixels for pixels, _ in pairs], SIZE)
        print(json.dumps(row(make.__name__.replace("_", " "), found, [[truth] for _, truth in pairs], field)))
    print(json.dumps({"frames": "as annotated", "count": len(real), "verdicts": Counter(str(c.verdict) for c in real)}))
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line of JSON for each kind of frames."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("annotations", type=Path, help="folder or zip of <id>.json")
    add_size(parser, "of the images", required=True)
    parser.add_argument("--frames", type=count, default=1000, help="of a kind; a tenth of the synthetic ones (1000)")
    parser.add_argument("--seed", type=int, default=0)
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
