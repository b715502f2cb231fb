"""Smaller pitches under the labels of soccer: which are told by the width of their lines, and is any right picture?

    python -m data_tools.smaller_pitches rendered [--frames N] [--seed S]
    python -m data_tools.smaller_pitches clips [--clips N] [--frames N] [--seed S]
    python -m data_tools.smaller_pitches real FOLDER

A pitch whose markings have another scale, seen from nearer, gives the same picture as a soccer pitch, but its lines are
as wide as elsewhere, 8 to 12 cm here, and so look wider than they should. `rendered` takes single frames of synthetic
clips at 1920x1080 and paints them as on pitches of the shares `SHARES`; `clips` takes whole clips so; `real` takes the
pictures of a folder, which are of full-sized pitches. A line of JSON for each share has the number of pictures (of
frames, for clips), of good cameras, and of pictures whose lines are too wide, and the quantiles of the widths where
they can be measured, in units of the projected width.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from data_tools.command_parser import add_made_frames, parser_of
from data_tools.pictures_in_pictures import SUFFIXES
from data_tools.synthetic.film import PAINTED, Scene, clip_frames, filmed
from data_tools.synthetic.paths import with_displaced_lines
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.paint_in_view import TOO_WIDE, paint_width
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import count
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.images.clip.from_video import calibrate_video
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.io.image_files import Image, parse_image
from fieldcalib.localize.network import SegmentationNetwork

SHARES = (1.0, 0.8, 0.7, 0.6)
SIZE = (1920, 1080)
QUANTILES = (0.0, 0.5, 1.0)


def painted_as_on(field: Field, share: float) -> Field:
    """The field with lines as wide as they look on one of a share of its size.

    Examples
    --------
    >>> round(painted_as_on(soccer(), 0.6).lines.width, 3)
    0.2
    """
    return replace(field, lines=replace(field.lines, width=field.lines.width / share))


def summary(share: float, found: Sequence[Calibration]) -> dict[str, object]:
    """The counts of a line."""
    widths = [width for one in found if (width := paint_width(one.markings))]
    return {
        "share": share,
        "count": len(found),
        "good": sum(one.verdict is Verdict.GOOD for one in found),
        "too wide": sum(paint_width(one.markings) > TOO_WIDE for one in found),
        "measured": len(widths),
        "widths": np.round(np.quantile(widths, QUANTILES), 2).tolist() if widths else [],
    }


def calibrated(images: Iterable[Image]) -> list[Calibration]:
    """The calibrations of pictures, which are made one by one."""
    network = SegmentationNetwork.load()
    return [calibrate_from_images(soccer(), [image], network, estimate_size=False)[0] for image in images]


def frames(seed: int, share: float, number: int) -> list[Image]:
    """The first frames of a synthetic clip of a pitch of a share of the usual size."""
    field = painted_as_on(with_displaced_lines(soccer(), np.random.default_rng((seed, PAINTED))), share)
    true = clip_frames(seed, max(number, 2), image_size=SIZE)  # motion blurs from each to the next
    scene = Scene.random(field, seed, [one.camera for one in true])
    return [filmed(scene, true, index) for index in range(number)]


def rendered(options: argparse.Namespace) -> int:
    """Measure frames of synthetic clips."""
    seeds = range(options.seed, options.seed + options.frames)
    for share in SHARES:
        print(json.dumps(summary(share, calibrated(frames(seed, share, 1)[0] for seed in seeds))), flush=True)
    return 0


def clips(options: argparse.Namespace) -> int:
    """Measure synthetic clips."""
    seeds = range(options.seed, options.seed + options.clips)
    for share in SHARES:
        found = [one for seed in seeds for one in calibrate_video(soccer(), frames(seed, share, options.frames))]
        print(json.dumps(summary(share, found)), flush=True)
    return 0


def real(options: argparse.Namespace) -> int:
    """Measure the pictures of a folder."""
    paths = sorted(path for path in options.folder.iterdir() if path.suffix in SUFFIXES)
    print(json.dumps(summary(1.0, calibrated(parse_image(path.read_bytes()) for path in paths))))
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line of JSON for each share."""
    functions: dict[str, Callable[[argparse.Namespace], int]] = {one.__name__: one for one in (rendered, clips, real)}
    parser, commands = parser_of(__doc__, functions)
    for name, command in commands.items():
        command.set_defaults(run=functions[name])
    add_made_frames(commands["rendered"], 30)
    add_made_frames(commands["clips"], 30)
    commands["clips"].add_argument("--clips", type=count, default=5, help="(5)")
    commands["real"].add_argument("folder", type=Path, help="pictures of soccer")
    return run_command(parser.parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
