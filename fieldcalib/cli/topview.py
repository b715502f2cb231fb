"""`fieldcalib topview`: the field of images or of a clip as seen from above, in one picture."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fieldcalib._progress import counted, progress_bar, say, show
from fieldcalib.cli.frame_cameras import IN_ORDER, Cameras, field_of
from fieldcalib.cli.players import PlayerOptions, PlayersOnMaps
from fieldcalib.console.arguments import add_cameras_and_out, add_inputs, add_most_bytes, positive
from fieldcalib.console.options import add_options, given
from fieldcalib.draw import draw_field, draw_players, mosaic, overhead_camera
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.files import named_in_errors
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.frame_range import Cut, Position
from fieldcalib.io.frame_source import files_read
from fieldcalib.io.image_files import Image, spread, write_image
from fieldcalib.io.output_folder import check_targets
from fieldcalib.io.videos import VideoReader

MOST_VIEWS = 31  # of a clip: players hide a place in some of them only
MOST_BYTES = 400e6  # of all views together, with four bytes per pixel
LINE_COLOUR = (96, 92, 90)  # colour of the markings where nothing is seen
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "The field as seen from above, from an image, or from many images of one field or a video: then the median of "
        "what they show at each place, from which most players are gone."
    )
    add_inputs(parser, "images, folders or zips of them, or one video; of one field")
    add_cameras_and_out(parser, "FILE", "the picture, e.g. PNG")
    parser.add_argument(
        "--metres-per-pixel",
        type=positive,
        metavar="M",
        help="of the picture, on the ground (0.1 for soccer, less for smaller fields)",
    )
    parser.add_argument(
        "--margin", type=positive, default=5.0, metavar="M", help="what is shown around the field, metres (5)"
    )
    parser.add_argument(
        "--players",
        type=Path,
        metavar="FILE",
        help="the table of project: draws the players where they are in the last of the frames",
    )
    add_options(parser, PlayerOptions)
    add_most_bytes(parser)


def run(options: argparse.Namespace) -> int:
    """Draw; returns the exit code."""
    if options.out.suffix.lower() not in PICTURES:
        raise ValueError(f"{options.out} is no picture: expected a name that ends with {', '.join(PICTURES)}")
    cameras = Cameras(options.cameras, IN_ORDER)
    own = [options.players] if options.players is not None else []
    check_targets([options.out], [*files_read(options.input), *cameras.files, *own], replaces=True)
    field = field_of(cameras)
    players = PlayersOnMaps(options.players, cameras, field, given(PlayerOptions, options))
    overhead = overhead_camera(field, options.metres_per_pixel, options.margin)
    width, height = overhead.image_size
    most = int(min(MOST_VIEWS, max(1.0, MOST_BYTES / (4 * width * height))))
    shown: list[str] = []
    picture, seen = mosaic(Views(options.input, cameras, most, options.most_bytes, shown), overhead, field)
    lines = draw_field(picture, overhead, field, colour=LINE_COLOUR, thickness=1)
    picture = np.where(seen[..., None], picture, lines)
    points, colours, trails = players.of(shown[-1])
    write_image(options.out, draw_players(picture, overhead, points, colours=colours, trails=trails))
    share = f"{100.0 * seen.mean():.0f} % of the picture seen"
    show(f"{options.out}: {width} x {height} pixels of {counted(len(shown), 'frame')}, {share}")
    if missing := players.missing(shown[-1]):
        say(missing)
    if players.legend:
        show(players.legend)
    return 0


@dataclass(frozen=True)
class Views:
    """At most `most` images with accepted cameras, evenly spread over the frames."""

    input: Sequence[Path]
    cameras: Cameras
    most: int
    most_bytes: float
    shown: list[str]
    """Gets the ids of the frames that are read."""

    def __iter__(self) -> Iterator[tuple[Image, Camera]]:
        """Images and their cameras."""
        return self._of_video() if VIDEOS.recognises(self.input[0]) else self._of_images()

    def _of_images(self) -> Iterator[tuple[Image, Camera]]:
        accepted = set(self.cameras.accepted)
        files = [file for file in IMAGES.find(self.input) if file.id in accepted]
        if not files:
            raise ValueError(f"no image that is given has an accepted camera in {self.cameras.path}")
        for file in (files[k] for k in spread(len(files), self.most)):
            with named_in_errors(file.path):
                yield IMAGES.read(file.read(self.most_bytes)), self.cameras.camera(file.id)
            self.shown.append(file.id)

    def _of_video(self) -> Iterator[tuple[Image, Camera]]:
        ids, accepted = self.cameras.of_video(self.input), set(self.cameras.accepted)
        numbers = [number for number in sorted(ids) if ids[number] in accepted]
        chosen = [numbers[k] for k in spread(len(numbers), self.most)]
        cut = Cut(Position(frame=chosen[0]), Position(frame=chosen[-1] + 1))
        with (
            VideoReader(self.input[0], cut=cut) as reader,
            progress_bar(unit="frame", total=len(reader.numbers)) as progress,
        ):
            for number, image in reader.numbered():
                progress.update()
                if number in chosen:
                    yield image, self.cameras.camera(ids[number])
                    self.shown.append(ids[number])
