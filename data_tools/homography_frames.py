"""Synthetic frames with homographies, from cameras similar to given ones: training data of `baselines.jiang`.

    python -m data_tools.homography_frames OUT --like HOMOGRAPHIES --count 10000

writes ``<seed>.jpg``, squashed to 256x256, and ``<seed>.homographyMatrix`` in the format of WC14. HOMOGRAPHIES is a
folder of such files. Each frame has the camera of one of them, turned, zoomed and moved a little.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np

from data_tools.synthetic.frames import SIZE, seen_by
from data_tools.synthetic.games import game_named
from fieldcalib._whole_files import write_bytes, write_text
from fieldcalib.console.arguments import SOCCER, count
from fieldcalib.console.program import run_command
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import ALIGNMENTS
from fieldcalib.io.formats import HOMOGRAPHIES
from fieldcalib.solve.from_homography import closed_form

SQUASHED = (256, 256)
QUALITY = 95  # of the JPEG
ANGLES = np.radians([4.0, 1.2, 0.4])  # standard deviations of pan, tilt and roll
LOG_FOCAL_LENGTH = 0.12
CENTRE = (2.0, 4.0, 1.5)  # m
LOWEST = -5.0  # m: z of the lowest camera


def cameras_like(homographies: Path) -> list[Camera]:
    """The cameras of a folder of homographies; those without a real focal length are left out."""
    matrices = [HOMOGRAPHIES.read(file.read(), image_size=SIZE) for file in HOMOGRAPHIES.find([homographies])]
    return [camera for camera in (closed_form(H, SIZE) for H in matrices) if camera is not None]


def perturbed(camera: Camera, rng: np.random.Generator) -> Camera:
    """The camera, turned, zoomed and moved a little.

    Examples
    --------
    >>> camera = Camera.from_angles(0.1, 1.35, 0.0, 1200.0, (0.0, 80.0, -15.0), SIZE)
    >>> perturbed(camera, np.random.default_rng(0)).image_size
    (512, 288)
    """
    pan, tilt, roll = camera.angles + rng.normal(size=3) * ANGLES
    C = camera.C + rng.normal(size=3) * CENTRE
    C[2] = min(C[2], LOWEST)
    f = camera.focal_length * np.exp(rng.normal(0.0, LOG_FOCAL_LENGTH))
    return Camera.from_angles(pan, tilt, roll, f, C, camera.image_size)


def write_frame(folder: Path, cameras: Sequence[Camera], seed: int) -> None:
    """Write the frame of a seed and its homography."""
    rng = np.random.default_rng(seed)
    camera = perturbed(cameras[int(rng.integers(len(cameras)))], rng)
    made = seen_by(camera, soccer(*ALIGNMENTS["wc14"].template), rng, game_named(SOCCER))
    squashed = cv2.resize(made.image, SQUASHED, interpolation=cv2.INTER_AREA)
    write_text(
        folder / HOMOGRAPHIES.file_name(f"{seed:07d}"), HOMOGRAPHIES.write(camera.pinhole_homography, image_size=SIZE)
    )
    encoded = cv2.imencode(".jpg", squashed, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
    write_bytes(folder / f"{seed:07d}.jpg", encoded.tobytes())


def _run(options: argparse.Namespace) -> int:
    cameras = cameras_like(options.like)
    if not cameras:
        raise ValueError(f"expected <id>.homographyMatrix files of cameras in {options.like}, found none")
    options.out.mkdir(parents=True, exist_ok=True)
    present = {path.stem for path in options.out.glob("*.jpg")}
    seeds = [seed for seed in range(options.count) if f"{seed:07d}" not in present]
    with get_context("spawn").Pool(options.processes, initializer=cv2.setNumThreads, initargs=(1,)) as pool:
        for _ in pool.imap_unordered(partial(write_frame, options.out, cameras), seeds, chunksize=8):
            pass
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the frames; existing ones are kept."""
    parser = argparse.ArgumentParser(prog="python -m data_tools.homography_frames", description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="folder of the frames")
    parser.add_argument("--like", type=Path, required=True, metavar="DIR", help="homographies that cameras are like")
    parser.add_argument("--count", type=count, default=10000, help="(10000)")
    parser.add_argument("--processes", type=count, default=1, help="(1)")
    parser.set_defaults(run=_run)
    return run_command(parser.parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
