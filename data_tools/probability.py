"""The probability that a camera is right: fit of its coefficients, and tests of its reliability.

    python -m data_tools.probability fit [--field NAME] [--frames N]
    python -m data_tools.probability verdicts [--field NAME] [--frames N]
    python -m data_tools.probability sizes [--frames N]
    python -m data_tools.probability measured CAMERAS
    python -m data_tools.probability annotated ANNOTATIONS --size WxH

`fit` calibrates random synthetic frames and prints the coefficients of `fieldcalib.assess.probability`: logistic
regression on whether the largest error in view is below the field's tolerance (1 m on a soccer pitch, less on courts)
and below half of it. It ends with the reliability on as many other frames.

`verdicts` prints, with the default prior and without one, how many synthetic frames are good, to be checked and
rejected among those whose camera is within the tolerance, beyond it, and beyond ten times the tolerance; apart where
some of their labels are wrong, which is a reason to check a right camera.

`sizes` draws pitches, 70 % of 105 x 68 m and 30 % of a random legal size, and calibrates their frames as 105 x 68 m.

`measured` takes the cameras of `data_tools.measured_cameras`, with random parts of their labels. `annotated` takes the
camera of all labels of a frame as true, where these are many and fit well, and judges cameras of four to six of them.
All print the reliability: the share of right cameras among the frames with a probability between p and q.

`annotated` also sorts frames by tau's loss and by the probability, and prints the area under the risk-coverage curve:
the mean risk of the frames with the best scores, averaged over all shares of frames. Risk is the share of cameras off
by more than 1 m, or 1 - AC@t of the frames with all their labels. It also prints AC and CS against CR for both scores.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from data_tools.annotated_frames import read_frames
from data_tools.crown import on_crown
from data_tools.measured_cameras import camera_files, read_camera, with_simulated_pixels
from data_tools.random_frames import RandomFrame, random_frame
from data_tools.synthetic.paths import SIZE
from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.estimate import motion_in_view
from fieldcalib.assess.probability import ground_in_view, odds_terms
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import add_size, count
from fieldcalib.console.program import run_command
from fieldcalib.fields.catalogue import FIELDS, field_named
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground import LEVEL
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import ProbabilityModel
from fieldcalib.geometry.camera import Camera
from fieldcalib.metrics import compound_score, evaluate_segments
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.problem.layout import Layout
from fieldcalib.problem.projection import Projection
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.solver_options import pixel_unit

TOLERANCES = (0.5, 1.0)  # limits of a right camera's error, in shares of the field's tolerance
BINS = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)
FINER = 4  # the true largest error is searched on a finer grid than that of `fieldcalib.assess.probability`
RIDGE = 1e-3  # keeps the regression from infinite coefficients; too small to matter
FEW_LABELS = (4, 6)  # of the cameras that are judged
MISLABELLED = ", wrong labels"  # of the frames in which some segments are mislabelled
MANY_LABELS, WELL_FITTED = 8, 2.0  # labels, px at 960 x 540: of frames whose camera is taken as true
EXACT = 0.7  # share of the pitches of 105 x 68 m
COVERAGES = (100, 98, 95, 90, 80)


def largest_true_error(
    camera: Camera,
    truth: Camera,
    field: Field,
    pitch: Field | None = None,
    *,
    crown: float = 0.0,
    roof: bool = False,
) -> float:
    """Largest error on the ground of a camera over the field in view, metres.

    It is relative to the markings in view (`fieldcalib.assess.estimate`): the camera was calibrated on `field`, the
    true one sees `pitch`, which may have another size and is crowned by `crown` metres.
    """
    pitch = field if pitch is None else pitch
    X = ground_in_view(truth, pitch, FINER)
    if not len(X):
        return float("nan")
    seen = truth.project(on_crown(X, pitch, crown, roof=roof))
    off = (camera.image_to_field(seen, terrain=field.terrain) - X)[:, :2]
    wrong_by = np.array([field.length - pitch.length, field.width - pitch.width])
    if np.any(wrong_by):
        layout = Layout.of(truth.image_size, truth.lens)
        (motion,) = motion_in_view(Projection(layout.theta(truth)[None], layout), pitch)
        off -= motion @ wrong_by
    return float(np.max(np.nan_to_num(np.linalg.norm(off, axis=1), nan=np.inf)))


def judged(
    field: Field,
    frames: Sequence[Pixels],
    truths: Sequence[Camera],
    size: tuple[int, int],
    pitches: Sequence[Field] | None = None,
) -> tuple[list[Calibration], Array]:
    """Calibrations, and their largest true errors (n,), of the frames whose camera sees the field.

    `pitches` are the true fields of the frames, by default `field`.
    """
    found = calibrate_batch(field, frames, size)
    shown = [field] * len(found) if pitches is None else pitches
    errors = np.array(
        [
            largest_true_error(c.uncertainty.camera, truth, field, pitch)
            for c, truth, pitch in zip(found, truths, shown, strict=True)
        ]
    )
    seen = np.flatnonzero(~np.isnan([c.probability() for c in found]) & ~np.isnan(errors))
    return [found[i] for i in seen], errors[seen]


def fitted_coefficients(
    features: Array, errors: Array, tolerance: float, known: Array | float = 0.0, weight: Array | float = 1.0
) -> Array:
    """Coefficients (5,) of `fieldcalib.assess.probability` from features (n, 5) and errors (n,), metres: log odds.

    `known` are log odds (n,) that come to those of the features, and `weight` (n,) is that of each camera.
    """
    from scipy.optimize import minimize

    limits = tolerance * np.array(TOLERANCES)
    A = np.concatenate([features - [0.0, np.log(metres), 0.0, 0.0, 0.0] for metres in limits])
    right = np.concatenate([errors < metres for metres in limits])
    added, share = (np.tile(np.broadcast_to(one, len(features)), len(limits)) for one in (known, weight))
    # infinitely uncertain frames have probability 0, whatever the coefficients
    A, right, added, share = (one[np.isfinite(A).all(axis=1)] for one in (A, right, added, share))

    def loss(b: Array) -> tuple[float, Array]:
        odds = A @ b + added
        p = 1.0 / (1.0 + np.exp(-odds))
        minus_log_likelihood = np.sum(share * (np.logaddexp(0.0, odds) - right * odds))
        return float(minus_log_likelihood + RIDGE * b @ b), A.T @ (share * (p - right)) + 2.0 * RIDGE * b

    return np.asarray(minimize(loss, np.zeros(A.shape[1]), jac=True, method="BFGS").x)


def reliability(p: Array, right: BoolArray) -> dict[str, object]:
    """Number of frames, mean probability and share of right cameras in each bin of probabilities (n,)."""
    rows = []
    for low, high in pairwise(BINS):
        inside = (p >= low) & ((p < high) | (high == BINS[-1]))
        if np.any(inside):
            shares = (round(float(np.mean(values[inside])), 3) for values in (p, right))
            rows.append([int(np.sum(inside)), *shares])
    brier = {"brier": round(float(np.mean((p - right) ** 2)), 3), "of_constant": round(float(np.var(right)), 3)}
    return {"frames_probability_right": rows, **brier}


def risk_coverage_area(score: Array, risk: Array) -> float:
    """Mean risk of the frames with the highest scores, over all shares of them.

    Examples
    --------
    >>> round(risk_coverage_area(np.array([3.0, 2.0, 1.0]), np.array([0.0, 0.0, 0.6])), 3)
    0.067
    """
    ordered = risk[np.argsort(-score, kind="stable")]
    return float(np.mean(np.cumsum(ordered) / np.arange(1, len(ordered) + 1)))


def fit(options: argparse.Namespace) -> int:
    """Print coefficients, and their reliability on other frames."""
    rng, field = np.random.default_rng(options.seed), replace(field_named(options.field), size_known=True, ground=LEVEL)

    found, errors = judged_frames(field, options.frames, rng)
    coefficients = fitted_coefficients(features_of(found, field), errors, field.tolerance).round(2)
    print(json.dumps({"frames": len(found), "coefficients": coefficients.tolist()}))
    b0, b1, b2, b3, b4 = coefficients.tolist()
    modelled = replace(field, probability=ProbabilityModel((b0, b1, b2, b3, b4)))
    _print_reliability(*judged_frames(modelled, options.frames, rng), field.tolerance)
    return 0


def judged_frames(field: Field, count: int, rng: np.random.Generator) -> tuple[list[Calibration], Array]:
    """Calibrations, and their largest true errors (n,), of random labelled frames."""
    frames = [random_frame(field, rng) for _ in range(count)]
    return judged(field, [f.pixels for f in frames], [f.camera for f in frames], frames[0].camera.image_size)


def features_of(found: Sequence[Calibration], field: Field) -> Array:
    """Terms (n, 5) of the log odds of calibrations on a field of known size, for 1 m."""
    uncertainties = [c.solved.uncertainty for c in found if c.solved is not None]
    return np.array([terms.rows[0] for terms in odds_terms(uncertainties, field)])


def verdicts(options: argparse.Namespace) -> int:
    """Print verdicts on cameras that are right, wrong and very wrong, apart for frames with wrong labels."""
    rng, field = np.random.default_rng(options.seed), replace(field_named(options.field), size_known=True, ground=LEVEL)
    frames = [random_frame(field, rng) for _ in range(options.frames)]
    kinds = ("right", "wrong", "very wrong")
    for prior in ("all", None):
        counts: dict[str, Counter[str]] = {one + label: Counter() for label in ("", MISLABELLED) for one in kinds}
        found = calibrate_batch(field, [f.pixels for f in frames], frames[0].camera.image_size, prior=prior)
        for one, frame in zip(found, frames, strict=True):
            error = np.inf if one.camera is None else largest_true_error(one.camera, frame.camera, field)
            if not np.isnan(error):
                kind = kinds[np.searchsorted((field.tolerance, 10.0 * field.tolerance), error, side="right")]
                counts[kind + (MISLABELLED if frame.wrong else "")][str(one.verdict)] += 1
        print(json.dumps({"field": options.field, "prior": prior, **counts}))
    return 0


def sizes(options: argparse.Namespace) -> int:
    """Print the reliability on pitches whose size was not measured."""
    rng, field = np.random.default_rng(options.seed), soccer()
    assert field.size_model is not None
    low, high = field.size_model.limits
    frames: list[RandomFrame] = []
    pitches: list[Field] = []
    while len(frames) < options.frames:
        length, width = rng.uniform(low, high)
        if rng.random() < EXACT:
            length, width = field.length, field.width
        if length > width:
            pitches.append(field.resized(length, width))
            frames.append(random_frame(pitches[-1], rng))
    image_size = frames[0].camera.image_size
    found = judged(field, [f.pixels for f in frames], [f.camera for f in frames], image_size, pitches)
    _print_reliability(*found, field.tolerance)
    return 0


def measured(options: argparse.Namespace) -> int:
    """Print the reliability on measured cameras, for frames with random parts of the labels in view."""
    field = soccer(size_known=True).with_ground(LEVEL)  # the field of the pixels
    rng = np.random.default_rng(options.seed)
    cameras = [read_camera(path) for path in camera_files(options.cameras)]
    pairs = with_simulated_pixels(cameras, field, options.noise, options.repeats, options.seed)
    parts = [_part(frame, int(rng.integers(1, len(frame), endpoint=True)), rng) for _, frame in pairs]
    _print_reliability(*judged(field, parts, [truth for truth, _ in pairs], SIZE), field.tolerance)
    return 0


def annotated(options: argparse.Namespace) -> int:
    """Print reliability, areas under risk-coverage curves and these curves for annotated frames."""
    # all labels and few are calibrated on a pitch of the same size
    field, rng, size = soccer(size_known=True).with_ground(LEVEL), np.random.default_rng(options.seed), options.size
    frames = list(read_frames([options.annotations], field, size).values())
    found = calibrate_batch(field, frames, size)
    parts, truths = [], []
    for _ in range(options.repeats):
        for frame, whole in zip(frames, found, strict=True):
            well = whole.accepted and not whole.suspect_labels and whole.rms < WELL_FITTED * pixel_unit(size)
            if len(frame) >= MANY_LABELS and well and whole.camera is not None:
                parts.append(_part(frame, int(rng.integers(*FEW_LABELS, endpoint=True)), rng))
                truths.append(whole.camera)
    few, errors = judged(field, parts, truths, size)
    _print_reliability(few, errors, field.tolerance)
    _print_areas("few labels", few, {"more than 1 m off": (errors > 1.0).astype(float)})

    evaluation = evaluate_segments([c.camera for c in found], frames, size)
    accuracies = evaluation.frame_accuracy
    risks = {f"1 - AC@{t:g}": 1.0 - ac for t, ac in zip(evaluation.thresholds, accuracies.T, strict=True)}
    _print_areas("all labels", found, risks)
    for name, score in _scores(found).items():
        for coverage in COVERAGES:
            kept = np.argsort(-score, kind="stable")[: round(0.01 * coverage * len(score))]
            cr, ac = len(kept) / len(score), accuracies[kept].mean(axis=0)
            row = {"by": name, "CR": coverage, "threshold": round(abs(float(score[kept[-1]])), 4)}
            percent = {"AC": (100.0 * ac).round(2).tolist(), "CS": round(100.0 * compound_score(ac, cr), 2)}
            print(json.dumps({**row, **percent}))
    return 0


def _part(frame: Pixels, count: int, rng: np.random.Generator) -> Pixels:
    labels = list(frame)
    chosen = set(rng.choice(len(labels), min(count, len(labels)), replace=False).tolist())
    return {label: frame[label] for index, label in enumerate(labels) if index in chosen}


def _scores(found: Sequence[Calibration]) -> dict[str, Array]:
    """Scores by which frames are sorted, the surest first."""
    return {
        "tau": -np.array([c.loss_ndc for c in found]),
        "probability": np.nan_to_num([c.probability() for c in found], nan=0.0),
    }


def _print_reliability(found: Sequence[Calibration], errors: Array, tolerance: float) -> None:
    for metres in tolerance * np.array(TOLERANCES):
        p = np.array([c.probability(float(metres)) for c in found])
        print(json.dumps({"metres": float(metres), **reliability(p, errors < metres)}))


def _print_areas(frames: str, found: Sequence[Calibration], risks: dict[str, Array]) -> None:
    for name, risk in risks.items():
        areas = {by: round(risk_coverage_area(score, risk), 4) for by, score in _scores(found).items()}
        print(json.dumps({"frames": frames, "risk": name, "mean": round(float(np.mean(risk)), 4), "area": areas}))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print lines of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    commands = parser.add_subparsers(required=True)
    for run, repeats in ((fit, None), (verdicts, None), (sizes, None), (measured, 100), (annotated, 2)):
        command = commands.add_parser(run.__name__, help=run.__doc__)
        command.set_defaults(run=run)
        if repeats is not None:
            command.add_argument("--repeats", type=count, default=repeats, help=f"of each camera or frame ({repeats})")
        if run in (fit, verdicts):
            command.add_argument("--field", choices=FIELDS, default="soccer", help="(soccer)")
        if run in (fit, verdicts, sizes):
            command.add_argument("--frames", type=count, default=6000, help="frames; to fit, as many others too (6000)")
        elif run is measured:
            command.add_argument("cameras", type=Path, help="folder of <name>.npz")
            command.add_argument("--noise", type=float, default=2.0, help="pixels at 1920x1080 (2)")
        else:
            command.add_argument("annotations", type=Path, help="folder or zip of <id>.json")
            add_size(command, "of the images", required=True)
    return run_command(parser.parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
