"""The demonstration: what the package does with a clip, on a rendered one whose true cameras and players are known.

It gives the commands that a user would give, and shows them; what they write lies in one folder. Cameras are found from
the pictures.
"""

from __future__ import annotations

import argparse
import filecmp
import shlex
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path

import numpy as np

from fieldcalib._progress import show
from fieldcalib._whole_files import whole_file
from fieldcalib.cli.commands import command_parser
from fieldcalib.console.arguments import folder_name
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.output_folder import output_folder
from fieldcalib.io.players import read_players
from fieldcalib.io.samples import PLAYERS, TRUTH, TrueFrame, read_cameras, read_positions, sample
from fieldcalib.metrics.cameras import camera_difference
from fieldcalib.results.collection import Results
from fieldcalib.results.entry import read
from fieldcalib.run_folder.results import MOTION, OVERLAY, REPORT

CAMERAS, PLACES, MAP = "cameras", "players_in_metres.csv", "map.mp4"
TRAIL = "15"  # frames
TITLES = ("focal length [%]", "position [m]", "pan [°]", "tilt [°]", "roll [°]", "worst point [px]")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "Take a rendered clip of a match with known cameras, find them from its pictures, print their errors, and "
        "write an overlay video, a report, the players in metres and a map with them. Needs no data and no download."
    )
    parser.add_argument("--out", required=True, type=folder_name, metavar="DIR", help="where all of it goes")


def run(options: argparse.Namespace) -> int:
    """Demonstrate; returns the exit code."""
    out: Path = options.out
    with output_folder(out):
        clip = _copied(sample("clip"), out)
        truths = read_cameras(clip.with_suffix(TRUTH))
        show(f"{clip}: {len(truths)} rendered frames of one camera; the truth is in {clip.stem}{TRUTH}, {PLAYERS}")
        cameras = out / CAMERAS
        if code := _command("run", clip, "--out", cameras, "--report", "--resume"):
            return code
        results = read(cameras)
        show(_table(results, truths))
        _command("project", out / PLAYERS, "--cameras", cameras, "--out", out / PLACES)
        show(_errors_of_players(out / PLACES, read_positions(out / PLAYERS)))
        _command("minimap", out / PLACES, "--cameras", cameras, "--out", out / MAP, "--trails", TRAIL)
    show(_what_next(out))
    return 0


def _copied(path: Path, out: Path) -> Path:
    """Copy the sample with its truth, each file whole; returns the clip.

    Raises
    ------
    FileExistsError
        If another file of that name is there.
    """
    for file in (path, path.with_suffix(TRUTH), path.with_name(PLAYERS)):
        copy = out / file.name
        if copy.exists() and not filecmp.cmp(file, copy, shallow=False):
            raise FileExistsError(f"{copy} is there already, and not that of the demo: give another folder")
        if not copy.exists():
            with file.open("rb") as source, whole_file(copy) as target:
                shutil.copyfileobj(source, target)
    return out / path.name


def _command(*arguments: str | Path) -> int:
    """Show a command and run it; returns its exit code."""
    given = list(map(str, arguments))
    show(f"\n$ fieldcalib {shlex.join(argument for argument in given if argument != '--resume')}")
    options = command_parser(given).parse_args(given)
    return int(options.run(options))


def _table(results: Results, truths: Sequence[TrueFrame]) -> str:
    """Errors of the cameras of each shot against the true ones, aligned: medians, and the largest distance."""
    field = soccer()
    errors = np.full((len(truths), len(TITLES)), np.nan)
    for id, camera in results.cameras.items():
        errors[int(id)] = astuple(camera_difference(camera, truths[int(id)].camera, field))
    lines = [
        "\nErrors against the true cameras, medians of each shot; the last column is the largest of all its frames",
        "",
        "  ".join(["shot", "frames", "cameras", *TITLES, "largest"]),
    ]
    shots = np.array([truth.shot for truth in truths])
    for shot in range(shots[-1] + 1):
        of_shot = errors[shots == shot]
        found = of_shot[np.isfinite(of_shot[:, 0])]
        values = [*np.median(found, axis=0), found[:, -1].max()] if len(found) else [np.nan] * (len(TITLES) + 1)
        cells = [f"{shot + 1:4d}", f"{len(of_shot):6d}", f"{len(found):7d}"]
        cells += [f"{value:{len(title)}.2f}" for value, title in zip(values, (*TITLES, "largest"), strict=True)]
        lines.append("  ".join(cells))
    return "\n".join(lines)


def _errors_of_players(path: Path, truth: Mapping[tuple[int, int], tuple[float, float]]) -> str:
    """How far the players in a table are from where they are, in words."""
    found = [
        np.subtract(player.X, truth[int(frame), int(player.track)])
        for frame, players in read_players(path).frames.items()
        for player in players
    ]
    distances = np.linalg.norm(np.reshape(found, (-1, 2)), axis=1)
    distances = distances[np.isfinite(distances)]
    if not len(distances):
        return "no player has a place in metres"
    median, most = np.quantile(distances, (0.5, 0.95))
    return (
        f"{len(distances)} places of players, from boxes that are 2 px off: off by {median:.2f} m in the median, "
        f"95 % by less than {most:.2f} m"
    )


def _what_next(out: Path) -> str:
    """Where to look, and what to try."""
    cameras = out / CAMERAS
    looks = (
        (cameras / OVERLAY, "the clip with the markings as calibrated, in magenta"),
        (out / MAP, "the map: what the camera sees, and the players with their trails"),
        (cameras / MOTION, "the cameras over time"),
        (cameras / REPORT, "a page with all of it, for any browser"),
        (out / PLACES, "the players in metres, with their uncertainty"),
    )
    tries = (
        (f"fieldcalib open {shlex.quote(str(cameras))}", "see and mend it in the browser (extra: web)"),
        (f"fieldcalib export {shlex.quote(str(cameras))} --format homography", "homographies from pixels to metres"),
        ("fieldcalib run YOUR_CLIP.mp4 --out results --report", "a clip of yours; of another sport: --field tennis"),
        ("python -c \"import fieldcalib; print(fieldcalib.calibrate(fieldcalib.sample('picture')))\"", "from Python"),
    )
    width = max(len(str(path)) for path, _ in looks)
    seen = "\n".join(f"  {path!s:{width}}  {what}" for path, what in looks)
    return f"\nLook at\n{seen}\n\nNext, try\n" + "\n".join(f"  {line}\n      {what}" for line, what in tries)
