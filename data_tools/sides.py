"""Pictures from the opposite side of a soccer pitch: is the turned camera an alternative, and what decides the side?

    python -m data_tools.sides [--frames N] [--seed S] [--size WxH]

The pictures are synthetic, of pitches of any legal size, by cameras opposite the main stand and behind the right
goal. A line of JSON for each of both and for each way to say where the camera is (nothing; the name of its stand as
prior; the side) has how many cameras are accepted and how many are good; how many of the good ones are right, are
right once they are turned by 180 degrees about the centre mark, and have a right camera among their alternatives; and
the median probability of the good ones.

A camera is right if it shows the points of the field in view, in the median, within 5 px of 1280 of where they are.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from data_tools.command_parser import add_made_frames
from data_tools.synthetic.cameras import BROADCAST, random_camera, random_field
from data_tools.synthetic.frames import SyntheticFrame, seen_by
from data_tools.synthetic.games import game_named
from data_tools.truth import UNIT, points_in_view
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import SOCCER, image_size
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import OPPOSITE, Field, turned_camera
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import BEHIND_LEFT_GOAL, BEHIND_RIGHT_GOAL, OPPOSITE_TRIBUNE, CameraDistribution
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.localize.network import SegmentationNetwork

SIZE = (960, 540)
RIGHT = 5.0  # px of `UNIT`
PLACES: Mapping[str, CameraDistribution] = {OPPOSITE_TRIBUNE.name: BROADCAST, BEHIND_RIGHT_GOAL.name: BEHIND_LEFT_GOAL}
"""Names of stands, and distributions whose cameras stand there once they are turned by 180 degrees."""


def frame_from(place: str, seed: int, size: tuple[int, int] = SIZE) -> SyntheticFrame:
    """A frame of a random game, of a camera at a place of `PLACES`.

    Examples
    --------
    >>> bool(frame_from("opposite tribune", 0, (96, 54)).camera.C[1] < -34.0)
    True
    """
    rng, game = np.random.default_rng((seed, list(PLACES).index(place))), game_named(SOCCER)
    field = random_field(rng)
    camera = turned_camera(random_camera(field, size, rng, {PLACES[place]: 1.0}))
    return seen_by(camera, field, rng, game)


def is_right(camera: Camera, truth: Camera, field: Field) -> bool:
    """Whether a camera shows the points of the field where the true one shows them."""
    xy, X = points_in_view(truth, field)
    off = np.linalg.norm(camera.project(X) - xy, axis=1) * UNIT / truth.image_size[0]
    return bool(np.median(np.nan_to_num(off, nan=np.inf)) < RIGHT)


def summary(found: Sequence[Calibration], frames: Sequence[SyntheticFrame]) -> dict[str, Any]:
    """Numbers of cameras, and how many of the good ones are right."""
    good = [(one, frame) for one, frame in zip(found, frames, strict=True) if one.verdict is Verdict.GOOD]
    counts = {"right": 0, "right once turned": 0, "right alternative": 0}
    for one, frame in good:
        assert frame.camera is not None
        camera, truth, field = one.required_camera, frame.camera, frame.field
        counts["right"] += is_right(camera, truth, field)
        counts["right once turned"] += is_right(turned_camera(camera), truth, field)
        counts["right alternative"] += any(is_right(other, truth, field) for other in one.alternatives)
    probability = [one.probability() for one, _ in good]
    median = round(float(np.median(probability)), 2) if good else None
    return {"accepted": sum(map(bool, found)), "good": len(good), **counts, "probability": median}


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line of JSON for each place and way."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_made_frames(parser, 40)
    parser.add_argument("--size", type=image_size, default=SIZE, metavar="WxH", help="({}x{})".format(*SIZE))
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Render, calibrate and print; returns the exit code."""
    network = SegmentationNetwork.load()
    for place in PLACES:
        seeds = range(options.seed, options.seed + options.frames)
        frames = [frame_from(place, seed, options.size) for seed in seeds]
        ways: dict[str, dict[str, Any]] = {"nothing": {}, "prior": {"prior": place}, "side": {"side": OPPOSITE}}
        for way, said in ways.items():
            found = calibrate_from_images(soccer(), [frame.image for frame in frames], network, **said)
            record = {"place": place, "said": way, "frames": len(frames), **summary(found, frames)}
            print(json.dumps(record), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
