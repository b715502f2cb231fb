"""Whether places of players in clips are off by as much as they say.

    python -m data_tools.feet [--clips N] [--seed N]

A clip is that of `data_tools.synthetic --clip` on a pitch of any size for international matches, whose lines lie as the
law says, up to their errors of some centimetres: 30 of its frames, calibrated from their pictures. Players stand where
the lower edge of their boxes is, and boxes are exact, so that only the errors of cameras count. For each clip a line of
JSON says the median error, metres, and of x and of y from the centre mark on the shares within two standard deviations,
and the root mean square in standard deviations: errors of the players of a clip are alike, so that a share of few clips
says little.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence

import numpy as np

from data_tools.rigs import LENGTHS, WIDTHS
from data_tools.synthetic.film import LEAST_PATH, PAINTED, Scene, clip_frames, filmed
from data_tools.synthetic.paths import with_displaced_lines
from fieldcalib._types import Array
from fieldcalib.assess.estimate import CENTRE_MARK
from fieldcalib.assess.ground_points import locate_on_ground
from fieldcalib.console.arguments import count
from fieldcalib.console.program import run_command
from fieldcalib.fields.sports.soccer import soccer, with_painted_lines
from fieldcalib.io.boxes import foot_points
from fieldcalib.results.entry import calibrate

SIZES = 77  # seeds of sizes
SHOWN = range(0, LEAST_PATH, LEAST_PATH // 30)  # frames of the path


def errors_of(seed: int) -> tuple[Array, Array]:
    """Errors (N, 2) of the players of a clip on the ground, and their standard deviations."""
    frames = clip_frames(seed, LEAST_PATH)
    rng = np.random.default_rng((seed, SIZES))
    pitch = soccer(rng.uniform(*LENGTHS), rng.uniform(*WIDTHS))
    field = with_displaced_lines(with_painted_lines(pitch), np.random.default_rng((seed, PAINTED)))
    scene = Scene.random(field, seed, [frame.camera for frame in frames])
    results = calibrate([filmed(scene, frames, index) for index in SHOWN], clip=True, progress=False)
    off, sigma = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for number, index in enumerate(SHOWN):
        boxes = scene.boxes(index, frames[index].camera)
        if results[number].accepted and boxes:
            found = locate_on_ground(
                results[number], foot_points([*boxes.values()]), pixel_sd=0.0, relative_to=CENTRE_MARK
            )
            off.append(found.X[:, :2] - scene.positions[index, [*boxes]])
            sigma.append(found.standard_deviations)
    return np.concatenate(off), np.concatenate(sigma)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print lines of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=count, default=8, help="how many (8)")
    parser.add_argument("--seed", type=int, default=100)
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Measure and print; returns the exit code."""
    for seed in range(options.seed, options.seed + options.clips):
        off, sigma = errors_of(seed)
        if not len(off):
            print(json.dumps({"seed": seed, "players": 0}), flush=True)
            continue
        z = off / sigma
        of_z = {"within_two": np.mean(np.abs(z) < 2.0, axis=0), "rms": np.sqrt(np.mean(np.square(z), axis=0))}
        median = round(float(np.median(np.linalg.norm(off, axis=1))), 3)
        told = {name: values.round(3).tolist() for name, values in of_z.items()}
        print(json.dumps({"seed": seed, "players": len(off), "median_m": median, **told}), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
