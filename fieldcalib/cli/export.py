"""`fieldcalib export`: the cameras of a run in the formats of other tools."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from inspect import signature
from pathlib import Path
from typing import Any

from fieldcalib._progress import counted, say, show
from fieldcalib._whole_files import remove_temporaries, write_bytes
from fieldcalib.assess.findings import Finding, Verdict, What
from fieldcalib.console.arguments import folder_name, positive
from fieldcalib.console.options import add_options, given, option
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground_homography import field_homography
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.exports.blender import blender_error, blender_files
from fieldcalib.io.exports.colmap import colmap_files
from fieldcalib.io.exports.frames import IMAGE_NAMES, FrameCameras, with_cameras
from fieldcalib.io.exports.freed import freed_error, freed_files
from fieldcalib.io.exports.homography import homography_files
from fieldcalib.io.exports.nerfstudio import nerfstudio_files
from fieldcalib.io.exports.opencv import opencv_files
from fieldcalib.io.exports.rerun import rerun_files
from fieldcalib.io.exports.soccernet import gamestate_files, soccernet_files, tvcalib_files
from fieldcalib.io.exports.table import table_files
from fieldcalib.io.exports.toml import toml_files
from fieldcalib.io.output_folder import check_targets, output_folder
from fieldcalib.io.results import LINES, SOLVER, TABLE
from fieldcalib.results.collection import Results
from fieldcalib.results.entry import read
from fieldcalib.run_folder.record import has_finding
from fieldcalib.solve.from_homography import on_level_ground

FORMATS: Mapping[str, Callable[..., dict[str, bytes]]] = {
    "opencv": opencv_files,
    "colmap": colmap_files,
    "nerfstudio": nerfstudio_files,
    "blender": blender_files,
    "freed": freed_files,
    "soccernet": soccernet_files,
    "tvcalib": tvcalib_files,
    "gsr": gamestate_files,
    "csv": table_files,
    "homography": homography_files,
    "rerun": rerun_files,
    "toml": toml_files,
}
# What formats cannot hold, and a function that says by how many pixels the image moves without it.
LOST: Mapping[str, tuple[str, Callable[[Camera], float]]] = {
    "blender": ("Blender's camera has no lens distortion", blender_error),
    "homography": (
        "a homography has no lens (from_raw_rms_px says what that costs from_raw; from_undistorted is exact for the "
        "pictures of `fieldcalib undistort`, on level ground)",
        lambda camera: camera.lens_shift,
    ),
    "freed": ("FreeD has neither lens distortion nor principal point", freed_error),
}


@dataclass(frozen=True)
class FormatOptions:
    """Options that are keywords of the functions of some formats."""

    image_names: str | None = option(
        f"of colmap and nerfstudio: names of the images, with <id> in it ({IMAGE_NAMES})", metavar="NAME"
    )
    fps: float | None = option("of blender: frames per second (those of the clip, or 25)", type=positive, metavar="N")
    sensor_width: float | None = option(
        "of blender and freed: width of the sensor, to which the focal length in mm refers (36)",
        type=positive,
        metavar="MM",
    )
    sequence: str | None = option(
        "of gsr: prefix of image ids, the digit of the split and the number of the video, as 3116", metavar="DIGITS"
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = "Write the cameras that calibrate or run found in the format of another tool."
    parser.add_argument("folder", type=Path, metavar="DIR", help="what calibrate or run wrote")
    parser.add_argument("--format", required=True, choices=FORMATS, help="what to write: a tool, or homography")
    parser.add_argument("--out", type=folder_name, metavar="PATH", help="folder for the files (DIR/FORMAT)")
    parser.add_argument("--overwrite", action="store_true", help="replace files that are there")
    parser.add_argument("--frames", nargs="+", metavar="ID", help="these only (all)")
    parser.add_argument(
        "--keep-rejected", action="store_true", help='also cameras whose verdict is "reject"; else these are gaps'
    )
    add_options(parser, FormatOptions)


def run(options: argparse.Namespace) -> int:
    """Export; returns the exit code."""
    function = FORMATS[options.format]
    keywords = _keywords(options.format, given(FormatOptions, options))
    results = read(options.folder)
    if "fps" in signature(function).parameters and results.frames_per_second:
        keywords.setdefault("fps", results.frames_per_second)
    lines = {line["id"]: line for line in results.frames.mains()}
    frames = _frames(results, lines, options)
    if options.format in ("soccernet", "tvcalib", "gsr"):  # programs that read these take every field to be level
        frames = {id: camera and on_level_ground(camera, results[id].field) for id, camera in frames.items()}
    if "about" in signature(function).parameters:
        keywords["about"] = lines
    if "fields" in signature(function).parameters:
        keywords["fields"] = {id: results[id].field for id, camera in frames.items() if camera is not None}
    try:
        files = function(frames, **keywords)
    except ValueError as error:
        raise ValueError(f"{options.folder}: {error}") from error
    base = options.folder if options.folder.is_dir() else options.folder.parent
    out = options.out or base / options.format
    _write(files, out, [base / name for name in (LINES, SOLVER, TABLE)], overwrite=options.overwrite)
    _say(frames, out, options.format)
    if options.format == "homography":
        _say_of_ground(frames, keywords["fields"])
    unknown = [id for id in with_cameras(frames) if has_finding(lines[id], What.GROUND_ONLY)]
    if unknown and options.format != "homography":
        say(f"{counted(len(unknown), 'camera')}, the first of frame {unknown[0]}: {Finding(What.GROUND_ONLY)}")
    return 0


def _keywords(format: str, options: FormatOptions) -> dict[str, Any]:
    """The options that are given; a ValueError if one does not apply to the format."""
    found = {name: value for name, value in asdict(options).items() if value is not None}
    for name in found:
        takers = [other for other, function in FORMATS.items() if name in signature(function).parameters]
        if format not in takers:
            raise ValueError(f"--{name.replace('_', '-')} is of {' and '.join(takers)}, not of {format}")
    return found


def _frames(results: Results, lines: dict[str, Mapping[str, Any]], options: argparse.Namespace) -> FrameCameras:
    """The frames that are asked for, with the cameras that may be used."""
    ids = list(lines) if options.frames is None else list(dict.fromkeys(options.frames))
    unknown = [id for id in ids if id not in lines]
    if unknown:
        known = f", its frames are {next(iter(lines))} to {next(reversed(lines))}" if lines else ", it has none"
        raise ValueError(f"{options.folder} has no frame {', '.join(unknown)}{known}")
    cameras = {id: results.cameras.get(id) for id in ids}
    rejected = [id for id in ids if cameras[id] is not None and lines[id].get("verdict") == Verdict.REJECT]
    if rejected and not options.keep_rejected:
        cameras |= dict.fromkeys(rejected)
        say(
            f'{counted(len(rejected), "camera")} left out, whose verdict is "{Verdict.REJECT}"; '
            f"--keep-rejected exports them too"
        )
    return cameras


def _write(files: Mapping[str, bytes], out: Path, reads: Iterable[Path], *, overwrite: bool) -> None:
    for name in files:
        if Path(name).name != name:
            raise ValueError(f"{name!r} is no name of a file: rename the frame, or choose a format with one file")
    with output_folder(out):
        remove_temporaries(out)
        remedy = "give --overwrite to replace it, or another --out"
        check_targets([out / name for name in files], reads, replaces=overwrite, remedy=remedy)
        for name, content in files.items():
            write_bytes(out / name, content)


def _say(frames: FrameCameras, out: Path, format: str) -> None:
    cameras = with_cameras(frames)
    show(f"{counted(len(cameras), 'camera')} of {counted(len(frames), 'frame')} in {out}")
    if format == "toml" and len(cameras) > 1:
        say("the file is of cameras of one rig: if the pictures are of several moments or fields, choose by --frames")
    if format in LOST:
        what, error = LOST[format]
        shifts = [error(camera) for camera in cameras.values()]
        worst, at = max(zip(shifts, cameras, strict=True))
        if worst > 0.0:
            say(f"{what}: without it the image moves by up to {worst:.1f} px (frame {at})")


def _say_of_ground(frames: FrameCameras, fields: Mapping[str, Field]) -> None:
    raised = {id: camera for id, camera in with_cameras(frames).items() if not fields[id].terrain.is_level}
    off = {id: field_homography(camera, fields[id]).largest_m for id, camera in raised.items()}
    if off:
        worst = max(off, key=lambda id: off[id])
        say(f"a homography is level, the ground is not: from_raw is up to {off[worst]:.1f} m off (frame {worst})")
