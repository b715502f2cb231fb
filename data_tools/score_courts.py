"""Cameras that are searched for in pictures of courts (`fieldcalib.images.search.court_search`), against what is true.

    python -m data_tools.score_courts clips FOLDER [--field NAME]
    python -m data_tools.score_courts frames --field NAME [--frames N] [--seed N] [--least-view SHARE] [--nominal]
    python -m data_tools.score_courts basketball FILE [--first N] [--every N]
    python -m data_tools.score_courts rinks FOLDER
    python -m data_tools.score_courts halls FOLDER
    python -m data_tools.score_courts pictures FOLDER --field NAME
    python -m data_tools.score_courts nonsense --field NAME [--frames N]
    python -m data_tools.score_courts fit FILE...

All but the last print a line of JSON with the number of pictures; how many have a right camera in the first place, an
accepted right one, an accepted right one that is good, an accepted wrong one, a wrong one that is good; and the median
of the processor time, seconds. A camera is right too if it says that it may stand where the true one does
(`FoundCourt.moved`). With --evidence FILE they add a line for each picture to a file, from which `fit` prints the
coefficients of `CourtEvidence.odds`.

`clips`: the frames of `data_tools.court_truth`, whose clips are in FOLDER; with --field all of them under that field,
where it is not their own, so that any camera is wrong.

`frames`: synthetic frames of the field (`data_tools.synthetic`), 960x540. A camera is right if the points of the field
in view lie within 5 px of 1280 columns in the median. With --least-view, frames that show at least that share of the
field's area, with square pixels, as overviews of broadcasts do; without it, close views of a corner are among them.
The size of a field that varies is the true one, with --nominal the usual one, from which the true one is to be found.

`basketball`: rendered views of measured cameras of basketball games, in FILE as for `data_tools.undeclared`.

`rinks`: frames of hockey with points (`data_tools.rink_points`) in FOLDER, each searched by itself.

`halls`: pictures of a hall whose cameras were measured (`data_tools.hall_points`) in FOLDER; the line has how far each
first camera stands from there too, metres.

`pictures`, `nonsense`: pictures that do not show the field, or no field at all; any camera is wrong.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from data_tools import hall_points, rink_points
from data_tools.command_parser import add_made_frames, parser_of
from data_tools.court_truth import LIMITS, court_frames, distances
from data_tools.nonsense import nonsense
from data_tools.synthetic import SyntheticFrame, frame
from data_tools.synthetic.cameras import random_camera
from data_tools.synthetic.frames import seen_by
from data_tools.synthetic.games import game_named
from data_tools.undeclared import BASKETBALL, basketball_cameras
from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.findings import Verdict
from fieldcalib.console.arguments import count
from fieldcalib.console.program import run_command
from fieldcalib.fields.catalogue import field_named
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.search.court_search import CourtEvidence, FoundCourt, find_courts
from fieldcalib.io.image_files import Image, parse_image
from fieldcalib.io.videos import VideoReader

SIZE = (960, 540)
RIGHT = 5.0, np.inf  # px of 1280 columns: largest median and other distance of a right camera of a synthetic frame
SAME = 12.0  # px: median distance up to which a camera is the right one of those that were searched, if not exact
SQUARE = 0.01  # largest difference of the pixels' sides
PICTURES = (".jpg", ".jpeg", ".png")
WEAK = 0.3  # standard deviation of the coefficients' prior is 1 over its root: evidence that separates has no limit


@dataclass(frozen=True, eq=False)
class Case:
    """A picture, and the test of a camera."""

    name: str
    field: Field
    """That is searched for."""
    image: Image
    distances: Callable[[Camera], Array]
    """Distances (N,) of a camera's points from the true ones, pixels of 1280 columns."""
    right: tuple[float, float] = RIGHT
    """Largest distances of a right camera, in the median and at all."""
    metres: Callable[[Camera], float] | None = None
    """Distance of a camera from where the true one was measured, if it was."""

    def is_right(self, found: FoundCourt) -> bool:
        """Whether a camera that was found is right, or one of those further along the field that it may be."""
        return any(np.median(off) <= self.right[0] and np.max(off) <= self.right[1] for off in self._distances(found))

    def is_same(self, found: FoundCourt) -> bool:
        """Whether it is the right one of those that were searched."""
        return any(np.median(off) <= SAME for off in self._distances(found))

    def _distances(self, found: FoundCourt) -> list[Array]:
        return [self.distances(camera) for camera in (found.calibration.required_camera, *found.moved)]


def nowhere(camera: Camera) -> Array:
    """Distances of a camera of a picture that does not show its field."""
    return np.array([np.inf])


def of_clips(options: argparse.Namespace) -> Iterator[Case]:
    """The frames whose crossings are known."""
    frames = court_frames()
    for clip in dict.fromkeys(one.clip for one in frames):
        wanted = {one.number: one for one in frames if one.clip == clip}
        name = options.field or wanted[min(wanted)].field
        if options.field and options.field == wanted[min(wanted)].field:
            continue
        with VideoReader(options.folder / f"{clip}.mp4") as video:
            for number, image in enumerate(video):
                if number in wanted:
                    truth = nowhere if options.field else wanted[number].distances
                    yield Case(f"{clip} {number}", field_named(name), image, truth, LIMITS)


def of_synthetic(options: argparse.Namespace) -> Iterator[Case]:
    """Synthetic frames that show the field."""
    made = 0
    for seed in range(options.seed, options.seed + 100 * options.frames):
        one = frame(seed, SIZE, options.field) if options.least_view is None else overview(seed, options)
        if one is None or one.camera is None:
            continue
        made += 1
        searched = field_named(options.field) if options.nominal else one.field
        yield Case(f"seed {seed}", searched, one.image, Truth(one.camera, one.field).distances)
        if made == options.frames:
            break


def overview(seed: int, options: argparse.Namespace) -> SyntheticFrame | None:
    """A frame of the field, None if its camera sees too little of it or its pixels are not square."""
    rng, game = np.random.default_rng(seed), game_named(options.field)
    field = game.random_field(rng)
    camera = random_camera(field, SIZE, rng, game.stands)
    if abs(camera.K[1, 1] / camera.K[0, 0] - 1.0) > SQUARE or np.mean(in_view(camera, field)[1]) < options.least_view:
        return None
    return seen_by(camera, field, rng, game)


def of_basketball(options: argparse.Namespace) -> Iterator[Case]:
    """Rendered views of measured cameras of basketball games."""
    game = game_named(BASKETBALL)
    for index, camera in enumerate(basketball_cameras(json.loads(options.file.read_bytes()))):
        if index >= options.first and (index - options.first) % options.every == 0:
            made = seen_by(camera, game.field, np.random.default_rng(index), game)
            off = np.round(camera.K[:2, 2] - 0.5 * np.array(SIZE)).astype(int).tolist()
            yield Case(f"camera {index}, {off} px off", game.field, made.image, Truth(camera, game.field).distances)


def in_view(camera: Camera, field: Field) -> tuple[Array, BoolArray]:
    """Points (N, 3) in even steps over the field, and which of them a camera sees."""
    x, y = (np.linspace(-half, half, 25) for half in field.half_extent)
    X = np.array([(a, b, 0.0) for a in x for b in y])
    xy = camera.project(X)
    return X, np.asarray(np.all((xy >= 0.0) & (xy < camera.image_size), axis=1))  # false behind the camera


@dataclass(frozen=True, eq=False)
class Truth:
    """The true camera of a frame."""

    camera: Camera
    field: Field

    def distances(self, camera: Camera) -> Array:
        """Distances of the points of the field in view, in pixels of 1280 columns; those of the nearer twin."""
        X, seen = in_view(self.camera, self.field)
        if not np.any(seen):
            return np.array([np.inf])
        return distances(camera, X[seen], self.camera.project(X[seen]), self.camera.image_size[0])

    def distance(self, camera: Camera) -> float:
        """Their median."""
        return float(np.median(self.distances(camera)))


def of_rinks(options: argparse.Namespace) -> Iterator[Case]:
    """Frames of hockey whose points are known."""
    rink = field_named(rink_points.FIELD)
    for one in rink_points.rink_frames(options.folder):
        yield Case(one.path.name, rink, parse_image(one.path.read_bytes()), one.distances, (rink_points.RIGHT, np.inf))


def of_halls(options: argparse.Namespace) -> Iterator[Case]:
    """Pictures of a hall whose cameras were measured."""
    court = field_named(hall_points.FIELD)
    for one in hall_points.hall_pictures(options.folder):
        yield Case(one.name, court, one.image, one.distances, (hall_points.RIGHT, np.inf), one.metres)


def of_pictures(options: argparse.Namespace) -> Iterator[Case]:
    """Pictures that do not show the field."""
    for path in sorted(options.folder.iterdir()):
        if path.suffix.lower() in PICTURES:
            yield Case(path.name, field_named(options.field), parse_image(path.read_bytes()), nowhere)


def of_nonsense(options: argparse.Namespace) -> Iterator[Case]:
    """Pictures without a field."""
    for seed in range(options.seed, options.seed + options.frames):
        yield Case(f"nonsense {seed}", field_named(options.field), nonsense(seed), nowhere)


def search(options: argparse.Namespace) -> int:
    """Search each picture; how many are right, accepted and right, accepted and wrong, good and wrong."""
    table, seconds, lines, metres = [], [], [], []
    for case in options.source(options):
        start = time.process_time()
        found = find_courts(case.image, case.field)
        seconds.append(time.process_time() - start)
        accepted = bool(found) and found[0].calibration.accepted
        good = accepted and found[0].calibration.verdict == Verdict.GOOD
        first = bool(found) and case.is_right(found[0])
        if case.metres is not None:
            metres.append(round(case.metres(found[0].calibration.required_camera), 2) if found else None)
        table.append((first, first and accepted, first and good, accepted and not first, good and not first))
        rows = [
            {"is_same": case.is_same(one), **asdict(one.evidence)}
            for one in found
            if one.calibration.solved is not None
        ]
        lines.append(json.dumps({"name": case.name, "accepted": accepted, "found": rows}) + "\n")
    if options.evidence is not None:
        with options.evidence.open("a", encoding="utf-8") as file:
            file.writelines(lines)
    counts = np.sum(np.array(table, dtype=int).reshape(-1, 5), axis=0).tolist()
    names = ("right", "accepted and right", "good and right", "accepted and wrong", "good and wrong")
    record = {"pictures": len(table), **dict(zip(names, counts, strict=True)), "seconds": _median(seconds)}
    print(json.dumps(record | ({"metres": metres} if metres else {})))
    return 0


def _median(values: list[float]) -> float:
    return round(float(np.median(values)), 2) if values else float("nan")


def fitted(pictures: Sequence[tuple[Array, BoolArray]]) -> Array:
    """Coefficients (n,) for which the cameras that were found are most probable, with a weak prior.

    Parameters
    ----------
    pictures : sequence of (array (N, n), array (N,) of bool)
        Features of the N cameras found in each picture, and which of them are the right one; maybe none.
    """
    from scipy.optimize import minimize

    scale = np.maximum(np.std(np.concatenate([features for features, _ in pictures]), axis=0), 1e-3)
    scale[0] = 1.0
    scaled = [(features / scale, is_same) for features, is_same in pictures]
    prior = np.where(np.arange(len(scale)) > 0, WEAK, 1e-3)

    def loss(b: Array) -> tuple[float, Array]:
        value, gradient = 0.5 * float(prior @ (b * b)), prior * b
        for features, is_same in scaled:
            log_odds = features @ b
            value += _surprise(log_odds, is_same)
            gradient = gradient + features.T @ (_shares(log_odds, 0.0) - _shares(np.where(is_same, log_odds, -np.inf)))
        return value, gradient

    return np.asarray(minimize(loss, np.zeros(len(scale)), jac=True).x / scale)


def _shares(log_odds: Array, other: float = -np.inf) -> Array:
    """Shares (N,) of each in the sum of the odds and another one; 0 if there are none."""
    every = np.logaddexp.reduce(np.append(log_odds, other))
    return np.exp(log_odds - every) if np.isfinite(every) else np.zeros(len(log_odds))


def _surprise(log_odds: Array, is_same: BoolArray) -> float:
    """Negative logarithm of the probability (`fieldcalib.images.search.court_search.probabilities`) of what is true."""
    every = np.logaddexp.reduce(np.append(log_odds, 0.0))
    return float(every - (np.logaddexp.reduce(log_odds[is_same]) if np.any(is_same) else 0.0))


def fit(options: argparse.Namespace) -> int:
    """Print the coefficients, and how surprising each file is for those that are fitted to the others."""
    files = [list(_pictures(path)) for path in options.files]
    for path, held_out in zip(options.files, files, strict=True):
        b = fitted([one for other in files if other is not held_out for one in other])
        surprise = np.mean([_surprise(features @ b, is_same) for features, is_same in held_out])
        print(json.dumps({"file": path.name, "pictures": len(held_out), "surprise": round(float(surprise), 3)}))
    pictures = [one for file in files for one in file]
    right = sum(bool(np.any(is_same)) for _, is_same in pictures)
    coefficients = fitted(pictures).round(2).tolist()
    print(json.dumps({"coefficients": coefficients, "pictures": len(pictures), "right": right}))
    return 0


def _pictures(path: Path) -> Iterator[tuple[Array, BoolArray]]:
    """Features and truth of the cameras in each picture of a file of evidence."""
    for line in path.read_text(encoding="utf-8").splitlines():
        if found := json.loads(line)["found"]:
            is_same = np.array([one.pop("is_same") for one in found], dtype=bool)
            yield np.array([CourtEvidence(**one).features for one in found]), is_same


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line of JSON."""
    sources = {
        "clips": of_clips,
        "frames": of_synthetic,
        "basketball": of_basketball,
        "rinks": of_rinks,
        "halls": of_halls,
        "pictures": of_pictures,
        "nonsense": of_nonsense,
    }
    parser, commands = parser_of(__doc__, {**sources, "fit": fit})
    for name, source in sources.items():
        command = commands[name]
        command.set_defaults(run=search, source=source)
        if name in ("clips", "rinks", "halls", "pictures"):
            command.add_argument("folder", type=Path)
        elif name == "basketball":
            command.add_argument("file", type=Path)
            command.add_argument("--first", type=int, default=0, help="index of the first camera (0)")
            command.add_argument("--every", type=count, default=7, help="steps between their indices (7)")
        else:
            add_made_frames(command, 100)
        if name == "frames":
            command.add_argument("--least-view", type=float, metavar="SHARE", help="of the field in the picture")
            command.add_argument("--nominal", action="store_true", help="search for the field in its usual size")
        if name not in ("basketball", "rinks", "halls"):
            command.add_argument("--field", required=name != "clips", metavar="NAME")
        command.add_argument("--evidence", type=Path, metavar="FILE", help="add a line for each picture to FILE")
    commands["fit"].add_argument("files", type=Path, nargs="+", metavar="FILE")
    commands["fit"].set_defaults(run=fit)
    return run_command(parser.parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
