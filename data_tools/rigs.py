"""Whether the errors of several cameras of one field are as large as they say: places of cameras, and points in space.

    python -m data_tools.rigs labels [--rigs N] [--known]
    python -m data_tools.rigs pictures [--rigs N] [--known]

A rig has two to six cameras that look at one place of a pitch of any size for international matches, which is told with
`--known` only: `labels` puts them on both sides of it and labels markings as annotators do, `pictures` renders
what cameras on the main side see. `calibrate_rig` gives the cameras, and `triangulate` a point of which every camera
has a pixel, 2 px off. Of cameras and points, of all that are accepted and of those that are good, one line of JSON says
how many lie in the 95 % regions of their covariances, metres from the centre mark, and how far they are off in the
median.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from data_tools.random_frames import KEPT, LENS_SPREAD, NOISE_SPREAD, PRINCIPAL_POINT_SPREAD, ROLL_SIGMA, noisy_pixels
from data_tools.simulated import IMAGE_SIZE
from data_tools.synthetic.frames import filmed
from data_tools.synthetic.games import game_named
from data_tools.synthetic.surroundings import GroundView
from fieldcalib._types import Array
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.space_points import triangulate
from fieldcalib.console.arguments import SOCCER, count
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import RadialLens
from fieldcalib.problem.layout import CENTER
from fieldcalib.results.entry import Source, calibrate_rig

LENGTHS, WIDTHS = (100.0, 110.0), (64.0, 75.0)  # m: of international matches, law 1
FOCAL_LENGTHS = (500.0, 1500.0)  # px
PIXEL_SD = 2.0
REGION = 7.815  # 95 % of the squared distances of three coordinates, in standard deviations


def random_camera(C: Array, X: Array, rng: np.random.Generator) -> Camera:
    """A camera that looks at a point, with a lens and a principal point as in broadcasts."""
    x, y, z = X - C
    pan, tilt = np.arctan2(x, -y), np.pi / 2.0 - np.arctan2(z, np.hypot(x, y))
    lens, f = RadialLens(float(np.hypot(*IMAGE_SIZE) / 2.0)), rng.uniform(*FOCAL_LENGTHS)
    k = lens.to_opencv(lens.mean + (rng.normal(0.0, LENS_SPREAD), 0.0), f)
    middle = np.array(IMAGE_SIZE) / 2.0 + rng.normal(size=2) * PRINCIPAL_POINT_SPREAD * IMAGE_SIZE[0]
    roll = rng.normal(0.0, ROLL_SIGMA)
    return Camera.from_angles(pan, tilt, roll, f, C, IMAGE_SIZE, k=k, principal_point=middle)


def random_rig(rng: np.random.Generator, X: Array, sides: Sequence[int]) -> list[Camera]:
    """Two to six cameras that look near a point, from some sides of the field (1 is the main one)."""
    cameras = []
    for _ in range(rng.integers(2, 7)):
        C = np.array([rng.uniform(-40, 40), rng.uniform(50, 80) * rng.choice(sides), -rng.uniform(8, 25)])
        cameras.append(random_camera(C, X + rng.normal(0.0, 5.0, 3) * (1.0, 1.0, 0.0), rng))
    return cameras


def is_inside(off: Array, covariance: Array) -> bool:
    """Whether an error lies in the region of its covariance."""
    return bool(off @ np.linalg.solve(covariance, off) < REGION)


def sources_of(kind: str, cameras: Sequence[Camera], pitch: Field, rng: np.random.Generator) -> dict[str, Source]:
    """What `calibrate_rig` takes."""
    game = game_named(SOCCER)
    if kind == "labels":
        noise = float(np.exp(rng.normal(0.0, NOISE_SPREAD)))
        labels = [noisy_pixels(one, pitch, rng, noise, rng.uniform(*KEPT)) for one in cameras]
        return {f"{number}": one for number, one in enumerate(labels)}
    return {f"{number}": filmed(GroundView.of(one), pitch, rng, game)[0] for number, one in enumerate(cameras)}


def errors_of(
    kind: str, rigs: int, rng: np.random.Generator, *, known: bool = False
) -> Iterator[tuple[str, bool, float]]:
    """What was located, whether the truth is in its region, and by how many metres it is off."""
    for _ in range(rigs):
        X = np.array([rng.uniform(-45, 45), rng.uniform(-28, 28), -rng.uniform(0, 5)])
        pitch = soccer(rng.uniform(*LENGTHS), rng.uniform(*WIDTHS))
        cameras = random_rig(rng, X, (1, -1) if kind == "labels" else (1,))
        options = {"image_size": IMAGE_SIZE} if kind == "labels" else {}
        given = replace(pitch, size_known=True) if known else soccer()
        rig = calibrate_rig(sources_of(kind, cameras, pitch, rng), given, progress=False, **options)
        pairs = [(results[0], camera) for results, camera in zip(rig.values(), cameras, strict=True)]
        accepted = [(one, camera) for one, camera in pairs if one.accepted and one.knows_errors]  # not found by search
        good = [(one, camera) for one, camera in pairs if one.verdict == Verdict.GOOD]
        for name, some in (("accepted", accepted), ("good", good)):
            for one, camera in some:
                off = one.required_camera.C - camera.C
                is_in = is_inside(off, one.uncertainty.covariance[CENTER, CENTER])
                yield f"{name} cameras", is_in, float(np.linalg.norm(off))
            if len(some) > 1:
                xy = [camera.project(X) + rng.normal(0.0, PIXEL_SD, 2) for _, camera in some]
                try:
                    point = triangulate([one for one, _ in some], xy, pixel_sd=PIXEL_SD)
                except ValueError:  # rays that are nearly parallel
                    continue
                off = point.X - X
                yield f"points from {name} cameras", is_inside(off, point.covariance), float(np.linalg.norm(off))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print lines of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("labels", "pictures"))
    parser.add_argument("--rigs", type=count, default=300, help="how many (300)")
    parser.add_argument("--known", action="store_true", help="tell the size of the pitch")
    parser.add_argument("--seed", type=int, default=0)
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Measure and print; returns the exit code."""
    found = list(errors_of(options.what, options.rigs, np.random.default_rng(options.seed), known=options.known))
    for kind in sorted({one[0] for one in found}):
        inside, off = np.array([one[1:] for one in found if one[0] == kind]).T
        shares = {"in_region": round(float(np.mean(inside)), 3), "median_error_m": round(float(np.median(off)), 3)}
        print(json.dumps({"what": kind, "count": len(off)} | shares))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
