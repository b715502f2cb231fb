"""The probability that a camera is right on pitches of any size, seen from one end or both, level and crowned.

    python -m data_tools.pitches pictures [--frames N]
    python -m data_tools.pitches clips [--clips N]

60 % of the pitches have 105 x 68 m, 30 % a size for international matches and 10 % any legal size up to 115 m; a third
is crowned by up to 0.5 m, half of these as a parabola, the others as a roof.
`pictures` renders them from random stands and calibrates the images (`calibrate_from_images`). `clips` draws panning
cameras, half of them over one end alone, and the labels of their frames; half of the frames have no labels and are tied
to others by static points. The frames are calibrated together, with the pitch's size (`calibrate_sequence`).

The frames of each kind are ordered by their probability and divided into bins of 500. For tolerances of 0.5 and 1 m,
the mean probability and the share of right cameras of each bin are printed, in percent, and the mean and the largest
gap between the two. A camera is right if its error is within the tolerance at all points in view, relative to the
markings in view. Of clips the errors of the crown are printed too, where it was estimated: their median, and the share
within 1.96 standard deviations.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from data_tools.crown import crowned, crowned_ground
from data_tools.probability import TOLERANCES, largest_true_error
from data_tools.sequences import EMPTY_SHARE, POINTS, tied
from data_tools.synthetic.cameras import random_camera
from data_tools.synthetic.clips import background_points, labelled
from data_tools.synthetic.frames import filmed
from data_tools.synthetic.games import Game, game_named
from data_tools.synthetic.paths import camera_path, with_displaced_lines
from data_tools.synthetic.surroundings import GroundView
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import SOCCER, count
from fieldcalib.console.program import run_command
from fieldcalib.draw.ground import rays
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import DEVIATIONS
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.io.image_files import IMAGES_AT_ONCE, Image
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.solve.sequence.sequence_solver import calibrate_sequence

SIZE = (960, 540)
# Ranges of length and width, m: the usual size, those of international matches, and others that law 1 allows
SIZES = ((105.0, 105.0), (68.0, 68.0)), ((100.0, 110.0), (64.0, 75.0)), ((90.0, 115.0), (45.0, 90.0))
SHARES = (0.6, 0.3, 0.1)
CROWNED_SHARE, HIGHEST = 1.0 / 3.0, 0.5  # of the pitches, and metres
PATH, FRAMES = 300, 20  # frames of a clip; how many of them are calibrated
ONE_END, BOTH_ENDS = (-0.75, -0.35), (-0.6, 0.6)  # radians of pan
BIN = 500


class Rise(NamedTuple):
    """The crown of a pitch."""

    height: float
    """Metres; 0 of level ground."""
    roof: bool
    """Whether it is a roof and not a parabola."""


class Judged(NamedTuple):
    """A calibration, and its largest error over the points in view, metres."""

    kind: str
    found: Calibration
    error: float
    crown_off: tuple[float, float] | None = None
    """Error of the estimated crown of its clip, and that in standard deviations; None where none was estimated."""


def random_pitch(rng: np.random.Generator) -> tuple[Field, Rise]:
    """Draw a pitch and its crown.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> pitches = [random_pitch(rng) for _ in range(1000)]
    >>> float(round(np.mean([field.length == 105.0 for field, _ in pitches]), 1))
    0.6
    >>> max(rise.height for _, rise in pitches) < 0.5
    True
    """
    length, width = SIZES[rng.choice(len(SIZES), p=SHARES)]
    height = rng.uniform(0.0, HIGHEST) if rng.random() < CROWNED_SHARE else 0.0
    return soccer(rng.uniform(*length), rng.uniform(*width)), Rise(height, bool(rng.random() < 0.5))


def judgements(
    found: Calibration,
    truth: Camera,
    pitch: Field,
    rise: Rise,
    kind: str,
    crown_off: tuple[float, float] | None = None,
) -> Iterator[Judged]:
    """Judge a calibration: one entry if it has a probability and the field is in view, otherwise none."""
    if found.camera is None or not found.has_probability or found.field is None:
        return
    error = largest_true_error(found.camera, truth, found.field, pitch, crown=rise.height, roof=rise.roof)
    if not np.isnan([error, found.probability()]).any():
        yield Judged(kind + (", crowned" if rise.height else ", level"), found, error, crown_off)


def judge_pictures(frames: int, rng: np.random.Generator) -> Iterator[Judged]:
    """Render pictures and calibrate each by itself."""
    network, game = SegmentationNetwork.load(), game_named(SOCCER)
    left = frames
    while left:
        shown = [_picture(game, rng) for _ in range(min(left, IMAGES_AT_ONCE))]
        left -= len(shown)
        calibrations = calibrate_from_images(soccer(), [image for image, *_ in shown], network)
        for found, (_, camera, pitch, rise) in zip(calibrations, shown, strict=True):
            yield from judgements(found, camera, pitch, rise, "pictures")


def _picture(game: Game, rng: np.random.Generator) -> tuple[Image, Camera, Field, Rise]:
    pitch, rise = random_pitch(rng)
    camera = random_camera(pitch, SIZE, rng, game.stands)
    ray = rays(camera)
    view = GroundView(camera, ray, crowned_ground(camera, ray, pitch, rise.height, roof=rise.roof))
    image, _ = filmed(view, pitch, rng, game)
    return image, camera, pitch, rise


def judge_clips(clips: int, rng: np.random.Generator) -> Iterator[Judged]:
    """Draw labelled clips and calibrate the frames of each together."""
    for number in range(clips):
        pitch, rise = random_pitch(rng)
        ends = ONE_END if number % 2 else BOTH_ENDS
        cameras = camera_path(rng, PATH, pan_range=ends, image_size=SIZE)[:: PATH // FRAMES]
        lines = with_displaced_lines(pitch, rng)
        shown = crowned(lines, rise.height, roof=rise.roof) if rise.height else lines
        frames = labelled(cameras, shown, rng, empty_share=EMPTY_SHARE)
        matches = tied(cameras, np.arange(len(cameras)), background_points(cameras, POINTS, rng), rng)
        pixels = [one.pixels for one in frames]
        found = calibrate_sequence(soccer(), pixels, SIZE, matches=matches, trust_labels=True)  # no label is wrong
        kind = "clips, one end" if number % 2 else "clips, both ends"
        height, sigma = found.shared.get("crown", (0.0, 0.0))
        crown_off = (height - rise.height, (height - rise.height) / sigma) if height else None
        for one, camera in zip(found, cameras, strict=True):
            yield from judgements(one, camera, pitch, rise, kind, crown_off)


def reliability_of_bins(found: Sequence[Judged], metres: float) -> dict[str, object]:
    """Mean probability and share of right cameras of each bin, and the gaps between the two, percent."""
    p = np.array([one.found.probability(metres) for one in found])
    right = np.array([one.error < metres for one in found])
    order = np.argsort(p, kind="stable")
    bins = np.array_split(order, max(len(order) // BIN, 1))
    rows = np.array([[100.0 * np.mean(p[some]), 100.0 * np.mean(right[some])] for some in bins])
    gaps = np.abs(rows[:, 0] - rows[:, 1])
    of_bins = rows.round(1).tolist()
    return {
        "metres": metres,
        "probability_right": of_bins,
        "gap": [round(float(f(gaps)), 1) for f in (np.mean, np.max)],
    }


def crown_errors(found: Sequence[Judged]) -> dict[str, object]:
    """Errors of the crowns that were estimated, each clip once."""
    off = np.array(sorted({one.crown_off for one in found if one.crown_off is not None})).reshape(-1, 2)
    if not len(off):
        return {"crowns": 0}
    metres, deviations = np.abs(off).T
    inside = round(float(np.mean(deviations < DEVIATIONS)), 3)
    return {"crowns": len(off), "median_error_m": round(float(np.median(metres)), 3), "inside_95": inside}


def main(arguments: Sequence[str] | None = None) -> int:
    """Print lines of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("pictures", "clips"))
    parser.add_argument("--frames", type=count, default=3000, help="pictures (3000)")
    parser.add_argument("--clips", type=count, default=300, help="clips, of 20 frames each (300)")
    parser.add_argument("--seed", type=int, default=0)
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Measure and print; returns the exit code."""
    rng = np.random.default_rng(options.seed)
    found = list(judge_pictures(options.frames, rng) if options.what == "pictures" else judge_clips(options.clips, rng))
    for kind in ("", *sorted({one.kind for one in found})):
        some = [one for one in found if one.kind.startswith(kind)]
        good = [one for one in some if one.found.verdict == Verdict.GOOD]
        wrong = sum(one.error > max(TOLERANCES) for one in good)
        kind = kind or options.what
        print(json.dumps({"kind": kind, "frames": len(some), "good": len(good), "good_and_wrong": wrong}))
        for metres in TOLERANCES:
            print(json.dumps(reliability_of_bins(some, metres)))
        print(json.dumps(crown_errors(some)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
