"""Cameras of filmed synthetic clips, calibrated from the pictures alone, against the true ones.

    python -m data_tools.filmed CLIP...

Each CLIP has its cameras beside it, as `python -m data_tools.synthetic --clip CLIP` makes both. It is calibrated as it
is, and with the lines of every third second withheld, so that the cameras of that second rest on matches. Printed are,
for each basis of frames, the median errors of focal length (percent), centre and field in view (metres) and of the
field in the image (pixels of 1280 columns), and how often the 95 % regions contain the truth (percent); over all clips
the number of frames without an accepted camera and the mean error of the pitch's size (metres).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from data_tools.clips import Clip, withhold_frames
from data_tools.truth import by_basis, compared
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.console.program import run_command
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.samples import read_cameras
from fieldcalib.io.videos import VideoReader


def main(arguments: Sequence[str] | None = None) -> int:
    """Print lines of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", nargs="+", type=Path)
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Measure and print; returns the exit code."""
    whole: list[tuple[VideoCalibration, list[Camera]]] = []
    withheld: list[tuple[VideoCalibration, list[Camera]]] = []
    for path in options.clips:
        clip, cameras = Clip(path), [frame.camera for frame in read_cameras(path.with_suffix(".jsonl"))]
        with VideoReader(path) as video:
            is_third = np.arange(len(cameras)) // round(video.frames_per_second) % 3 == 2
        whole.append((clip.calibrated(), cameras))
        withheld.append((clip.calibrated(withhold_frames(is_third)), cameras))
    for lines, clips in (("all", whole), ("every third second withheld", withheld)):
        print(json.dumps({"lines": lines, **_clip_values(clips)}))
        frames = [
            compared(one, truth, soccer(), str(basis))
            for found, cameras in clips
            for one, truth, basis in zip(found, cameras, found.basis, strict=True)
            if one.accepted
        ]
        for line in by_basis(frames):
            print(line)
    return 0


def _clip_values(clips: Sequence[tuple[VideoCalibration, list[Camera]]]) -> dict[str, object]:
    """Values of whole clips."""
    true = soccer()
    sizes = [
        (abs(tripod.field.length - true.length), abs(tripod.field.width - true.width))
        for found, _ in clips
        for tripod in found.tripods
        if tripod.field is not None
    ]
    lost = sum(not one.accepted for found, _ in clips for one in found)
    return {"clips": len(clips), "lost": lost, "size_m": np.mean(sizes, axis=0).round(2).tolist() if sizes else None}


if __name__ == "__main__":
    raise SystemExit(main())
