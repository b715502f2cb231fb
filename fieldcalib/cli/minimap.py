"""`fieldcalib minimap`: a map of each frame, with what its camera sees and with players, as pictures or as a video."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from fieldcalib._progress import counted, show
from fieldcalib.cli.frame_cameras import IN_ORDER, Cameras, field_of
from fieldcalib.cli.players import PlayerOptions, PlayersOnMaps
from fieldcalib.console.arguments import add_cameras_and_out, image_size, positive
from fieldcalib.console.options import add_options, given
from fieldcalib.draw import draw_minimap
from fieldcalib.io.decoders import DEFAULT_RATE
from fieldcalib.io.files import can_name_files
from fieldcalib.io.image_files import Image, write_image
from fieldcalib.io.output_folder import INTERRUPTED, check_targets
from fieldcalib.io.videos import VideoWriter

PICTURE, VIDEO = ".png", ".mp4"
SIZE = (672, 456)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "Maps of the field, one for each frame: the ground that the camera sees, its position, and players with their "
        "trails."
    )
    parser.add_argument(
        "players", nargs="?", type=Path, metavar="PLAYERS", help="the table that project wrote (none: views alone)"
    )
    written = f"a video ({VIDEO}), a picture of a single frame ({PICTURE}), or a folder for minimap_<id>{PICTURE}"
    add_cameras_and_out(parser, "PATH", written)
    add_options(parser, PlayerOptions)
    parser.add_argument(
        "--size", type=image_size, default=SIZE, metavar="WxH", help=f"of the maps, pixels ({SIZE[0]}x{SIZE[1]})"
    )
    parser.add_argument(
        "--frames-per-second", type=positive, default=DEFAULT_RATE, metavar="R", help=f"of the video ({DEFAULT_RATE:g})"
    )


def run(options: argparse.Namespace) -> int:
    """Draw; returns the exit code."""
    suffix = options.out.suffix.lower()
    if suffix not in (PICTURE, VIDEO, "") and not options.out.is_dir():
        raise ValueError(f"{options.out}: expected a name that ends with {VIDEO} or {PICTURE}, or a folder")
    cameras = Cameras(options.cameras, IN_ORDER)
    field = field_of(cameras)
    players = PlayersOnMaps(options.players, cameras, field, given(PlayerOptions, options))
    ids = players.ids
    if suffix == PICTURE and len(ids) > 1:
        raise ValueError(f"{options.out} is one picture, and there are {len(ids)} frames: give a folder or {VIDEO}")

    is_file = suffix in (PICTURE, VIDEO)
    unnamed = next((id for id in ids if not can_name_files(id)), None)
    if not is_file and unnamed is not None:
        raise ValueError(f"frame {unnamed!r} cannot name a file: give a video ({VIDEO})")
    pictures = {id: options.out if is_file else options.out / f"minimap_{id}{PICTURE}" for id in ids}
    own = [options.players] if options.players is not None else []
    check_targets(dict.fromkeys(pictures.values()), [*cameras.files, *own], replaces=is_file, remedy=INTERRUPTED)

    def maps() -> Iterator[tuple[str, Image]]:
        for id in ids:
            found = cameras.of(id)
            camera = found.camera if found is not None and found.accepted else None
            points, colours, trails = players.of(id)
            yield id, draw_minimap(camera, field, size=options.size, points=points, colours=colours, trails=trails)

    if suffix == VIDEO:
        with VideoWriter(options.out, options.frames_per_second) as video:
            for _, picture in maps():
                video.write(picture)
    else:
        if suffix != PICTURE:
            options.out.mkdir(parents=True, exist_ok=True)
        for id, picture in maps():
            write_image(pictures[id], picture)
    show(f"{options.out}: {counted(len(ids), 'map')} of {options.size[0]} x {options.size[1]} pixels")
    if players.legend:
        show(players.legend)
    return 0
