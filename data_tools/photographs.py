"""Verdicts and probabilities of rendered pictures as people take them.

    python -m data_tools.photographs take [--field NAME] [--kind WORDS] [--frames N] [--seed N] [--evidence FILE]
    python -m data_tools.photographs judge FILE...
    python -m data_tools.photographs fit FILE... [--frames N] [--seed N]

Cameras stand where people hold a phone or put up a camera: behind an end, at a corner and beside the field, at the
height of a hand and raised, with action cameras of 100 to 150 degrees, or with drones that look down by 45 to 90
degrees; and on the stands of the field, as those of broadcasts do. Pictures are 16:9, 4:3 and 3:2, and small ones. They
show a quarter of the field at least, whose lines are painted some centimetres elsewhere.

`take` renders and calibrates N pictures of each kind with the defaults, soccer by the network and other fields by
search. A line of JSON for each kind and for each size says how many there are, and how many are accepted, right, good
and right, and good although wrong: a camera is right if no place in view is off by more than the field's tolerance.
Then it prints the reliability, as `data_tools.probability` does, of all accepted cameras. --evidence adds a line for
each picture to a file, for which `judge` prints the same again, with the present coefficients of the probability.

`fit` prints the coefficients for pictures in files and for as heavy a set of N labelled frames with wrong labels, as
`data_tools.probability fit` draws them, together; and the reliability on other labelled frames.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from data_tools.command_parser import add_made_frames, parser_of
from data_tools.pitches import random_pitch
from data_tools.probability import features_of, fitted_coefficients, judged_frames, largest_true_error, reliability
from data_tools.score_courts import in_view
from data_tools.synthetic.cameras import random_camera
from data_tools.synthetic.frames import seen_by
from data_tools.synthetic.games import Game, game_named
from data_tools.synthetic.paths import with_displaced_lines
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.paint_in_view import paint_share
from fieldcalib.assess.probability import (
    OddsTerms,
    log_odds_of_paint,
    odds_terms,
    probability_given_paint,
    probability_right,
)
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import SOCCER
from fieldcalib.console.program import run_command
from fieldcalib.fields.catalogue import FIELDS, field_named
from fieldcalib.fields.field import Field, looks_the_same_turned, turned_camera
from fieldcalib.fields.ground import LEVEL
from fieldcalib.fields.traits import CameraDistribution
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.io.image_files import Image
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.solve.solver_options import paint_sigma

SIZES = ((960, 540), (960, 640), (960, 720), (640, 360))
LEAST_VIEW = 0.25  # of the field
HAND, LOWEST, HIGHEST = (1.2, 2.2), 3.0, 0.3  # m; raised: the least height, and what is added in shares of the width
NEAR, FAR = (0.1, 0.5), (0.2, 1.5)  # from the field, in shares of its width: in the hand and raised
FOV, FOV_RAISED = (45.0, 85.0), (20.0, 70.0)
PAINT = 2.0  # most of the deviation of lines from where they should be, in units of the usual one: no court is exact
ACTION, FOV_ACTION = "action camera", (100.0, 150.0)
DRONE, FOV_DRONE, ABOVE = "drone", (60.0, 85.0), (0.3, 1.2)  # metres above the ground, in shares of the width
STANDS = "on the stands"


@dataclass(frozen=True, eq=False)
class Photograph:
    """A rendered picture."""

    kind: str
    seed: int
    image: Image
    camera: Camera
    field: Field


def kinds(field: Field) -> Mapping[str, CameraDistribution]:
    """Where people with a camera stand around a field, beside its stands.

    Examples
    --------
    >>> from fieldcalib.fields import tennis
    >>> {name: stand.z for name, stand in kinds(tennis()).items() if name.startswith("corner")}
    {'corner, in the hand': (-2.2, -1.2), 'corner, raised': (-6.291, -3.0)}
    """
    a, b, width = 0.5 * field.length, 0.5 * field.width, field.width
    found = {}
    for how, fov, (near, far), up in (
        ("in the hand", FOV, NEAR, HAND),
        ("raised", FOV_RAISED, FAR, (LOWEST, LOWEST + HIGHEST * width)),
    ):
        behind, beside = (-a - far * width, -a - near * width), (b + near * width, b + far * width)
        for where, x, y in (("behind", behind, (-b, b)), ("corner", behind, beside), ("beside", (-a, a), beside)):
            name = f"{where}, {how}"
            found[name] = CameraDistribution(name, (-180, 180), (45, 90), (-2, 2), fov, x, y, (-up[1], -up[0]))
    return found


def machines(field: Field) -> Mapping[str, CameraDistribution]:
    """Where action cameras are put up beside a field, and drones fly over it.

    Examples
    --------
    >>> from fieldcalib.fields import tennis
    >>> {name: stand.tilt for name, stand in machines(tennis()).items()}
    {'action camera': (45, 90), 'drone': (0, 45)}
    """
    a, b, width = 0.5 * field.length, 0.5 * field.width, field.width
    x, y = (-a - NEAR[1] * width, a), (b + NEAR[0] * width, b + NEAR[1] * width)
    up, above = (-LOWEST - HIGHEST * width, -LOWEST), (-ABOVE[1] * width, -ABOVE[0] * width)
    return {
        ACTION: CameraDistribution(ACTION, (-180, 180), (45, 90), (-2, 2), FOV, x, y, up),
        DRONE: CameraDistribution(DRONE, (-180, 180), (0, 45), (-1, 1), FOV_DRONE, (-a, a), (-b, b), above),
    }


def _all_kinds(field: Field) -> list[str]:
    return [*kinds(field), STANDS, *machines(field)]


def _with_fisheye(camera: Camera, rng: np.random.Generator) -> Camera:
    """The camera with the lens of an action camera: a projection between equal in area and stereographic."""
    half = np.radians(0.5 * rng.uniform(*FOV_ACTION))
    k1, k2 = (np.array([-1 / 24, 1 / 1920]) + rng.uniform() * np.array([1 / 8, 1 / 128])).tolist()
    f = 0.5 * camera.image_size[0] / (half * (1.0 + k1 * half**2 + k2 * half**4))
    K = camera.K.copy()
    K[[0, 1], [0, 1]] = f
    return Camera(K, camera.R, camera.C, camera.image_size, (k1, k2, 0.0, 0.0), fisheye=True)


def _drawn(kind: str, field: Field, size: tuple[int, int], rng: np.random.Generator, game: Game) -> Camera:
    """A camera of a kind that sees enough of the field."""
    stands = game.stands if kind == STANDS else {{**kinds(field), **machines(field)}[kind]: 1.0}
    while True:
        camera = random_camera(field, size, rng, stands)
        camera = _with_fisheye(camera, rng) if kind == ACTION else camera
        if np.mean(in_view(camera, field)[1]) >= LEAST_VIEW:
            return camera


def photographs(game: Game, kind: str, number: int, seed: int) -> Iterator[Photograph]:
    """Render pictures of a kind, the same ones for the same seeds."""
    last = seed + number
    order = _all_kinds(game.field).index(kind)
    while seed < last:
        rng = np.random.default_rng((seed, order))
        field = random_pitch(rng)[0] if game.field.size_model is not None and game is game_named(SOCCER) else game.field
        camera = _drawn(kind, field, SIZES[seed % len(SIZES)], rng, game)
        shown = with_displaced_lines(field, rng, rng.uniform(0.0, PAINT) * paint_sigma(field))
        yield Photograph(kind, seed, seen_by(camera, shown, rng, game).image, camera, field)
        seed += 1


def true_error(found: Calibration, truth: Camera, field: Field) -> float:
    """Largest error over the field in view, metres; that of the other side's camera where it takes the same picture."""
    camera, fitted = found.required_camera, found.field or field
    both = [camera, turned_camera(camera)] if looks_the_same_turned(field) else [camera]
    errors = [largest_true_error(one, truth, fitted, field) for one in both]
    return float(np.min(np.nan_to_num(errors, nan=np.inf)))


def record_of(found: Calibration, shown: Photograph) -> dict[str, Any]:
    """What a calibration says of a picture, and how far it is off, for `json.dumps`."""
    record: dict[str, Any] = {
        **{"kind": shown.kind, "seed": shown.seed, "size": list(shown.camera.image_size)},
        **{"verdict": str(found.verdict), "reason": found.reason, "metres": None},
    }
    if found.camera is None:
        return record
    record["metres"] = true_error(found, shown.camera, shown.field)
    if not found.accepted or found.solved is None or found.field is None:
        return record
    (terms,) = odds_terms([found.solved.uncertainty], found.field)
    share = paint_share(found.markings)
    return {**record, "paint": share, "terms": terms.rows.tolist(), "weights": terms.weights.tolist()}


def take(options: argparse.Namespace) -> int:
    """Render and calibrate pictures of each kind."""
    game, network = game_named(options.field), SegmentationNetwork.load() if options.field == SOCCER else None
    records = []
    for kind in (one for one in _all_kinds(game.field) if options.kind in one):
        for shown in photographs(game, kind, options.frames, options.seed):
            (found,) = calibrate_from_images(game.field, [shown.image], network)
            records.append({"field": options.field, **record_of(found, shown)})
            if options.evidence is not None:
                with options.evidence.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(records[-1]) + "\n")
    _print_judgement(records)
    return 0


def judge(options: argparse.Namespace) -> int:
    """Print verdicts and reliability of pictures that were calibrated before."""
    _print_judgement(_records(options.files))
    return 0


def _records(files: Sequence[Path]) -> list[dict[str, Any]]:
    return [json.loads(line) for file in files for line in file.read_text(encoding="utf-8").splitlines()]


def _print_judgement(records: Sequence[Mapping[str, Any]]) -> None:
    field = field_named(records[0]["field"])
    groups = dict.fromkeys(name for one in records for name in (one["kind"], str(one["size"])))
    for name in groups:
        some = [one for one in records if name in (one["kind"], str(one["size"]))]
        right = np.array([one["metres"] is not None and one["metres"] < field.tolerance for one in some])
        verdict = np.array([one["verdict"] for one in some])
        counts = {
            "accepted": verdict != Verdict.REJECT,
            "right": right,
            "good and right": right & (verdict == Verdict.GOOD),
            "good and wrong": ~right & (verdict == Verdict.GOOD),
        }
        print(json.dumps({"pictures": name, "count": len(some), **{k: int(np.sum(v)) for k, v in counts.items()}}))
    known = [one for one in records if "terms" in one]
    p, errors = np.array([probability_of(one, field) for one in known]), np.array([one["metres"] for one in known])
    print(json.dumps(reliability(p, errors < field.tolerance)))


def probability_of(record: Mapping[str, Any], field: Field) -> float:
    """Probability that the camera of a record is right, by the model of its field."""
    assert field.probability is not None
    terms = OddsTerms(np.array(record["terms"]), np.array(record["weights"]))
    return probability_given_paint(probability_right(field.probability, terms, field.tolerance), record["paint"])


def fit(options: argparse.Namespace) -> int:
    """Print the coefficients for pictures in files and labelled frames together."""
    records = [one for one in _records(options.files) if "terms" in one]
    field = replace(field_named(records[0]["field"]), size_known=True, ground=LEVEL)
    rng = np.random.default_rng(options.seed)
    labelled, errors_of_labelled = judged_frames(field, options.frames, rng)
    of_labelled = features_of(labelled, field)
    of_pictures = np.array([one["terms"][int(np.argmax(one["weights"]))] for one in records])
    by_paint = np.array([log_odds_of_paint(one["paint"]) for one in records])
    coefficients = fitted_coefficients(
        np.concatenate([of_labelled, of_pictures]),
        np.concatenate([errors_of_labelled, [one["metres"] for one in records]]),
        field.tolerance,
        known=np.concatenate([np.zeros(len(of_labelled)), by_paint]),
        weight=np.repeat([1.0, len(of_labelled) / len(records)], [len(of_labelled), len(records)]),
    )
    print(json.dumps({"pictures": len(records), "coefficients": coefficients.round(2).tolist()}))
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Print lines of JSON."""
    parser, commands = parser_of(__doc__, {"take": take, "judge": judge, "fit": fit})
    for name, run in (("take", take), ("judge", judge), ("fit", fit)):
        commands[name].set_defaults(run=run)
        if name != "take":
            commands[name].add_argument("files", type=Path, nargs="+", help="written by take --evidence")
    add_made_frames(commands["take"], 50)
    add_made_frames(commands["fit"], 3000)
    commands["take"].add_argument("--field", choices=FIELDS, default=SOCCER, help="(soccer)")
    commands["take"].add_argument("--kind", default="", help="words in the name of the kinds (all)")
    commands["take"].add_argument("--evidence", type=Path, help="file to which a line for each picture is added")
    return run_command(parser.parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
