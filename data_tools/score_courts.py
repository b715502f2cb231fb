"""Cameras that are searched for in pictures of courts (`fieldcalib.images.court_search`), against what is true.

    python -m data_tools.score_courts clips FOLDER [--field NAME]
    python -m data_tools.score_courts frames --field NAME [--frames N] [--seed N] [--least-view SHARE] [--nominal]
    python -m data_tools.score_courts basketball FILE [--first N] [--every N]
    python -m data_tools.score_courts pictures FOLDER --field NAME
    python -m data_tools.score_courts nonsense --field NAME [--frames N]
    python -m data_tools.score_courts fit FILE...

All but the last print a line of JSON with the number of pictures; how many have a right camera in the first place, an
accepted right one, an accepted right one that is good, an accepted wrong one; and the median of the processor time,
seconds. A camera is right too if it says that it may stand where the true one does (`FoundCourt.moved`). With
--evidence FILE they add a line for each picture to a file, from which `fit` prints the coefficients of
`CourtEvidence.probability`.

`clips`: the frames of `data_tools.court_truth`, whose clips are in FOLDER; with --field all of them under that field,
where it is not their own, so that any camera is wrong.

`frames`: synthetic frames of the field (`data_tools.synthetic`), 960x540. A camera is right if the points of the field
in view lie within 5 px of 1280 columns in the median. With --least-view, frames that show at least that share of the
field's area, with square pixels, as overviews of broadcasts do; without it, close views of a corner are among them.
The size of a field that varies is the true one, with --nominal the usual one, from which the true one is to be found.

`basketball`: rendered views of measured cameras of basketball games, in FILE as for `data_tools.undeclared`.

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

from data_tools.command_parser import add_made_frames, parser_of
from data_tools.court_truth import UNIT, court_frames
from data_tools.nonsense import nonsense
from data_tools.synthetic import SyntheticFrame, frame
from data_tools.synthetic.cameras import random_camera
from data_tools.synthetic.frames import seen_by
from data_tools.synthetic.games import game_named
from data_tools.undeclared import BASKETBALL, basketball_cameras
from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.words import Verdict
from fieldcalib.console.arguments import count
from fieldcalib.console.program import run_command
from fieldcalib.fields.catalogue import field_named
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.court_evidence import CourtEvidence
from fieldcalib.images.court_search import find_courts
from fieldcalib.io.image import Image
from fieldcalib.io.images import parse_image
from fieldcalib.io.videos import VideoReader

SIZE = (960, 540)
RIGHT = 5.0  # px of 1280 columns: largest median distance of a right camera of a synthetic frame
SQUARE = 0.01  # largest difference of the pixels' sides
PICTURES = (".jpg", ".jpeg", ".png")
STEPS = 100  # of the fit of the coefficients, by Newton's method
WEAK = 0.3  # standard deviation of the coefficients' prior is 1 over its root: evidence that separates has no limit


@dataclass(frozen=True, eq=False)
class Case:
    """A picture, and the test of a camera."""

    name: str
    field: Field
    """That is searched for."""
    image: Image
    is_right: Callable[[Camera], bool]


def never(camera: Camera) -> bool:
    """Say that a camera is wrong: the picture does not show its field."""
    return False


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
                    truth = never if options.field else wanted[number].is_right
                    yield Case(f"{clip} {number}", field_named(name), image, truth)


def of_synthetic(options: argparse.Namespace) -> Iterator[Case]:
    """Synthetic frames that show the field."""
    made = 0
    for seed in range(options.seed, options.seed + 100 * options.frames):
        one = frame(seed, SIZE, options.field) if options.least_view is None else overview(seed, options)
        if one is None or one.camera is None:
            continue
        made += 1
        searched = field_named(options.field) if options.nominal else one.field
        yield Case(f"seed {seed}", searched, one.image, Truth(one.camera, one.field).is_right)
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
            yield Case(f"camera {index}, {off} px off", game.field, made.image, Truth(camera, game.field).is_right)


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

    def distance(self, camera: Camera) -> float:
        """Median distance of the points of the field in view, in pixels of 1280 columns; of the nearer twin."""
        X, seen = in_view(self.camera, self.field)
        xy = self.camera.project(X)
        unit, twins = self.camera.image_size[0] / UNIT, ((1.0, 1.0, 1.0), (-1.0, -1.0, 1.0))
        off = [np.linalg.norm(camera.project(X[seen] * turn) - xy[seen], axis=1) / unit for turn in twins]
        return min(float(np.median(np.where(np.isfinite(one), one, np.inf))) if len(one) else np.inf for one in off)

    def is_right(self, camera: Camera) -> bool:
        """Whether a camera is within `RIGHT` of the true one."""
        return self.distance(camera) <= RIGHT


def of_pictures(options: argparse.Namespace) -> Iterator[Case]:
    """Pictures that do not show the field."""
    for path in sorted(options.folder.iterdir()):
        if path.suffix.lower() in PICTURES:
            yield Case(path.name, field_named(options.field), parse_image(path.read_bytes()), never)


def of_nonsense(options: argparse.Namespace) -> Iterator[Case]:
    """Pictures without a field."""
    for seed in range(options.seed, options.seed + options.frames):
        yield Case(f"nonsense {seed}", field_named(options.field), nonsense(seed), never)


def search(options: argparse.Namespace) -> int:
    """Search each picture; how many are right, accepted and right, accepted and wrong."""
    table, seconds, lines = [], [], []
    for case in options.source(options):
        start = time.process_time()
        found = find_courts(case.image, case.field)
        seconds.append(time.process_time() - start)
        right = [any(map(case.is_right, (one.calibration.required_camera, *one.moved))) for one in found]
        accepted = bool(found) and found[0].calibration.accepted
        good = accepted and found[0].calibration.verdict == Verdict.GOOD
        first = bool(found) and right[0]
        table.append((first, first and accepted, first and good, accepted and not first))
        rows = [{"right": is_right, **asdict(one.evidence)} for is_right, one in zip(right, found, strict=True)]
        lines.append(json.dumps({"name": case.name, "accepted": accepted, "found": rows}) + "\n")
    if options.evidence is not None:
        with options.evidence.open("a", encoding="utf-8") as file:
            file.writelines(lines)
    counts = np.sum(np.array(table, dtype=int).reshape(-1, 4), axis=0).tolist()
    names = ("right", "accepted and right", "good and right", "accepted and wrong")
    print(json.dumps({"pictures": len(table), **dict(zip(names, counts, strict=True)), "seconds": _median(seconds)}))
    return 0


def _median(values: list[float]) -> float:
    return round(float(np.median(values)), 2) if values else float("nan")


def fitted(features: Array, right: Array) -> Array:
    """Coefficients (n,) of the logistic model of rows of features (N, n), with a weak prior."""
    scale = np.maximum(np.std(features, axis=0), 1e-3)
    scale[0] = 1.0
    F, b = features / scale, np.zeros(features.shape[1])
    prior = np.diag(np.where(np.arange(len(b)) > 0, WEAK, 1e-3))
    for _ in range(STEPS):
        p = 1.0 / (1.0 + np.exp(-F @ b))
        gradient = F.T @ (right - p) - prior @ b
        b = b + np.linalg.solve((F.T * (p * (1.0 - p))) @ F + prior, gradient)
    return np.asarray(b / scale)


def fit(options: argparse.Namespace) -> int:
    """Print the coefficients, and how well they separate the first cameras of the pictures."""
    rows, right = [], []
    for path in options.files:
        for line in path.read_text(encoding="utf-8").splitlines():
            for one in json.loads(line)["found"][:1]:
                right.append(float(one.pop("right")))
                rows.append(CourtEvidence(**one).features)
    features, truth = np.array(rows), np.array(right)
    b = fitted(features, truth)
    p = 1.0 / (1.0 + np.exp(-features @ b))
    print(json.dumps({"coefficients": b.round(2).tolist(), "pictures": len(truth), "right": int(truth.sum())}))
    for least in (0.5, 0.8, 0.9, 0.95, 0.99):
        accepted = p >= least
        wrong = int(np.count_nonzero(accepted & (truth == 0.0)))
        print(json.dumps({"least": least, "accepted": int(accepted.sum()), "wrong": wrong}))
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line of JSON."""
    sources = {
        "clips": of_clips,
        "frames": of_synthetic,
        "basketball": of_basketball,
        "pictures": of_pictures,
        "nonsense": of_nonsense,
    }
    parser, commands = parser_of(__doc__, {**sources, "fit": fit})
    for name, source in sources.items():
        command = commands[name]
        command.set_defaults(run=search, source=source)
        if name in ("clips", "pictures"):
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
        if name != "basketball":
            command.add_argument("--field", required=name != "clips", metavar="NAME")
        command.add_argument("--evidence", type=Path, metavar="FILE", help="add a line for each picture to FILE")
    commands["fit"].add_argument("files", type=Path, nargs="+", metavar="FILE")
    commands["fit"].set_defaults(run=fit)
    return run_command(parser.parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
