"""`fieldcalib undistort`: pictures or a video without the distortion of the lens, where homographies are exact."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from fieldcalib._progress import counted, say, show
from fieldcalib.cli.frame_cameras import IN_ORDER, Cameras
from fieldcalib.console.arguments import add_cameras_and_out, add_inputs, add_most_bytes
from fieldcalib.io.files import named_in_errors
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.frame_range import Cut, Position
from fieldcalib.io.frame_source import files_read
from fieldcalib.io.image_files import write_image
from fieldcalib.io.output_folder import INTERRUPTED, check_targets
from fieldcalib.io.videos import VideoReader, VideoWriter

PICTURE, VIDEO = ".png", ".mp4"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "Pictures or a video without the distortion of the lens: the homographies from undistorted pixels that "
        "`export --format homography` writes are exact for them, on level ground."
    )
    add_inputs(parser, "images, folders or zips of them, or one video")
    written = f"a folder for <id>{PICTURE}; of one picture a picture, of a video a video ({VIDEO})"
    add_cameras_and_out(parser, "PATH", written)
    add_most_bytes(parser)


def run(options: argparse.Namespace) -> int:
    """Write the pictures; returns the exit code."""
    cameras = Cameras(options.cameras, IN_ORDER)
    if VIDEOS.recognises(options.input[0]):
        done, left, loss = _video(options.input, cameras, options.out)
        rest = f", {counted(left, 'frame')} without an accepted camera left as they are" if left else ""
    else:
        done, left = _pictures(options.input, cameras, options.out, options.most_bytes)
        loss = ""
        rest = f", {counted(left, 'image')} without an accepted camera left out" if left else ""
    show(f"{options.out}: {counted(done, 'frame')} without distortion{rest}")
    if loss:
        say(loss)
    return 1 if loss else 0


def _pictures(inputs: Sequence[Path], cameras: Cameras, out: Path, most_bytes: float) -> tuple[int, int]:
    """Write the pictures that have a camera; counts them, and the others."""
    accepted, files = set(cameras.accepted), IMAGES.find(inputs)
    if out.suffix and len(files) > 1:
        raise ValueError(f"{out}: expected a folder, for {len(files)} pictures are written as <id>{PICTURE}")
    chosen = [file for file in files if file.id in accepted]
    if not chosen:
        raise ValueError(f"no image that is given has an accepted camera in {cameras.path}")
    targets = {out if out.suffix else out / f"{file.id}{PICTURE}": file for file in chosen}
    check_targets(targets, files_read(inputs), remedy=INTERRUPTED)
    next(iter(targets)).parent.mkdir(parents=True, exist_ok=True)
    for path, file in targets.items():
        with named_in_errors(file.path):
            image = IMAGES.read(file.read(most_bytes))
            write_image(path, cameras.camera(file.id).undistort(image))
    return len(chosen), len(files) - len(chosen)


def _video(inputs: Sequence[Path], cameras: Cameras, out: Path) -> tuple[int, int, str]:
    """Write the video; counts the frames with a camera, and the others; and the message about those that are lost."""
    ids, accepted = cameras.of_video(inputs), set(cameras.accepted)
    if out.suffix.lower() != VIDEO:
        raise ValueError(f"{out}: expected a name that ends with {VIDEO}, for the input is a video")
    check_targets([out], inputs)
    steps = [after - before for before, after in pairwise(sorted(ids))]  # longer ones pass frames without a result
    cut = Cut(Position(frame=min(ids)), Position(frame=max(ids) + 1), min(steps, default=1))
    done = left = 0
    with VideoReader(inputs[0], cut=cut) as reader, VideoWriter(out, reader.frames_per_second) as video:
        for number, image in reader.numbered():
            if ids.get(number) in accepted:
                image, done = cameras.camera(ids[number]).undistort(image), done + 1
            else:
                left += 1
            video.write(image)
        loss = reader.loss()
    return done, left, loss
