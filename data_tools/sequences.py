"""Frames of one camera, calibrated together and one by one, against their true cameras.

    python -m data_tools.sequences CAMERAS [--count N] [--matches] [--flies] [--paint METRES]

CAMERAS holds ``<name>.npz`` as for `data_tools.measured_cameras`. For each, N of 300 frames of a synthetic clip with
its zoom and lens are calibrated (`data_tools.synthetic.paths`), on a pitch whose lines are painted some centimetres
off. With `--matches` half of the frames have no labels, and static points tie each frame to others as
`fieldcalib.images.background.keyframe_tracking` does. With `--flies` the camera moves, and static points are on the
ground in front of the boards. Printed are, for each basis of frames, the median errors of focal length (percent),
centre and field in view (metres) and of the field in the image (pixels of 1280 columns), how often the 95 % regions
contain the truth (percent), and the mean error of the pitch's size (metres).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from data_tools.measured_cameras import camera_files, read_zoom
from data_tools.synthetic.clips import background_matches, background_points, labelled
from data_tools.synthetic.paths import SIZE, camera_path, flight, with_displaced_lines
from data_tools.truth import Compared, by_basis, compared
from fieldcalib._types import Array, IntArray
from fieldcalib.console.arguments import count, positive
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground import LEVEL
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.background.keyframe_tracking import BACK
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.sequence.background_matches import BEHIND_LINES
from fieldcalib.solve.sequence.sequence_problem import SHARED, SHARED_IN_MOTION
from fieldcalib.solve.sequence.sequence_solver import calibrate_sequence
from fieldcalib.solve.solver_options import paint_sigma

FRAMES = 300  # of a clip
KEY_EVERY = 3  # every third frame that is calibrated is a keyframe
EMPTY_SHARE = 0.5  # share of frames without labels, with matches
GROUND = 1e-6  # m: largest height of points on the ground
POINTS, MOST_MATCHES = 3000, 150  # of the background of a clip; in a pair of frames


def main(arguments: Sequence[str] | None = None) -> int:
    """Print lines of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cameras", type=Path, help="folder of <name>.npz")
    parser.add_argument("--count", type=count, default=20, help="frames of a clip that are calibrated (20)")
    parser.add_argument("--noise", type=positive, default=1.0, help="pixels (1)")
    parser.add_argument("--paint", type=float, help="metres by which lines lie elsewhere (a quarter of their width)")
    parser.add_argument("--matches", action="store_true", help="and every other frame without labels")
    parser.add_argument("--flies", action="store_true", help="along the side line, instead of standing on a tripod")
    parser.add_argument("--repeats", type=count, default=1, help="clips of each camera (1)")
    parser.add_argument("--seed", type=int, default=0)
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Measure and print; returns the exit code."""
    field = soccer()
    paint = paint_sigma(field) if options.paint is None else options.paint
    together: list[Compared] = []
    alone: list[Compared] = []
    sizes = []
    for number, path in enumerate(options.repeats * camera_files(options.cameras)):
        rng = np.random.default_rng(options.seed + number)
        centre = flight(rng, FRAMES) if options.flies else None
        times = np.arange(0, FRAMES, max(FRAMES // options.count, 1))[: options.count]
        every = camera_path(rng, FRAMES, read_zoom(path), centre=centre)
        cameras = [every[t] for t in times]
        lines = with_displaced_lines(field, rng, paint)
        empty = EMPTY_SHARE if options.matches else 0.0
        frames = [frame.pixels for frame in labelled(cameras, lines, rng, options.noise, empty_share=empty)]
        matches = None
        if options.matches:
            points = background_points(cameras, POINTS, rng)
            matches = tied(every, times, on_the_ground(points, field) if options.flies else points, rng)
        shared = SHARED_IN_MOTION if options.flies else SHARED
        clip: list[dict[str, Array]] = [{} for _ in every]  # the path of a moving camera is smooth in time
        for t, pixels in zip(times, frames, strict=True):
            clip[t] = pixels
        found = calibrate_sequence(field, clip, SIZE, shared=shared, matches=matches)
        together += [compared(found[t], every[t], field, str(found.basis[t])) for t in times if found[t].accepted]
        single = calibrate_batch(soccer(size_known=True).with_ground(LEVEL), frames, SIZE)
        alone += [compared(one, truth, field, "one by one") for one, truth in zip(single, cameras, strict=True) if one]
        if found.field is not None:
            sizes.append(np.abs([found.field.length - field.length, found.field.width - field.width]))
    for line in (*by_basis(together), *by_basis(alone)):
        print(line)
    print(json.dumps({"size_m": np.mean(sizes, axis=0).round(2).tolist()}))
    return 0


def tied(
    cameras: Sequence[Camera], times: IntArray, points: Array, rng: np.random.Generator
) -> dict[tuple[int, int], tuple[Array, Array]]:
    """Matches of static points between each frame of some times and the keyframe before it, and between keyframes."""
    keys = times[::KEY_EVERY].tolist()
    pairs = [(keys[k // KEY_EVERY], t) for k, t in enumerate(times.tolist()) if t not in keys]
    pairs += [(keys[k - back], keys[k]) for k in range(len(keys)) for back in BACK if k >= back]
    found: dict[tuple[int, int], tuple[Array, Array]] = {}
    for match in background_matches(cameras, pairs, points, rng):
        some = rng.permutation(len(match.xy_first))[:MOST_MATCHES]
        found[match.first, match.second] = match.xy_first[some], match.xy_second[some]
    return found


def on_the_ground(points: Array, field: Field) -> Array:
    """Those of the points (N, 3) that lie on a field, or in front of the boards around it."""
    half = np.array([field.length, field.width]) / 2.0 + BEHIND_LINES
    is_free = (np.abs(points[:, 2]) < GROUND) & np.all(np.abs(points[:, :2]) < half, axis=1)
    return np.asarray(points[is_free])


if __name__ == "__main__":
    raise SystemExit(main())
