"""Verdicts on spoiled labels: frames whose labels, picture or given camera are wrong in one of many ways.

    python -m data_tools.spoiled_labels ANNOTATIONS --size WxH [--frames N] [--seed N] [--ways WORDS...]

N random frames whose labels, as annotated, give the verdict "good" are spoiled in every way of `WAYS`: labels moved,
mixed, renamed, rounded; the picture mirrored, turned, cropped, bent; wrong values of the camera given as known. The
camera of the labels as annotated is taken as true. A found camera is off by the median distance, in metres, between the
places on the field that it and the true one see at the pixels of a grid.

A line for each way has how many frames were tried, how many of them refused with an error, the verdicts on the others,
how many of the good ones are more than 1 m and 3 m off, and the worst of these: its median, the 95 % quantile, its
frame. The last line sums up all ways but those of `UNTOLD`, in which the labels are right for another picture.
`--ways` measures only ways whose names have one of these words.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from data_tools.annotated_frames import read_frames
from data_tools.verdicts import under_labels_of_other_side
from fieldcalib._progress import say
from fieldcalib._types import Array
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import add_size, count
from fieldcalib.console.program import run_command
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.from_segments import calibrate_from_segments
from fieldcalib.solve.solver_options import DEFAULT_FLAGS
from fieldcalib.solve.solver_options import CalibrationFlags as F

FIELD = soccer()
GRID = (24, 14)  # pixels across and down the picture at which cameras are compared
FAR_OFF = (1.0, 3.0)  # m
OF_ONE_FRAME = frozenset({"camera_matrix", "dist_coeffs", "rvec", "tvec", "weights"})
Map: TypeAlias = Callable[[Array], Array]


@dataclass(frozen=True)
class Frame:
    """An annotated frame with a good camera."""

    name: str
    pixels: Pixels
    camera: Camera
    another: Pixels
    """The labels of another frame."""

    @property
    def size(self) -> Array:
        """Width and height, pixels."""
        return np.array(self.camera.image_size, dtype=float)


@dataclass(frozen=True)
class Spoiled:
    """Spoiled labels, and what is said about them."""

    pixels: Pixels
    said: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of the calibration."""
    size: tuple[int, int] | None = None
    """Size of the picture; None for that of the frame."""
    shown: Map = np.asarray
    """Where the picture shows pixels (N, 2) of the frame."""


Way: TypeAlias = Callable[[Frame, np.random.Generator], Spoiled | None]
"""Spoils a frame; None where the way does not apply to it."""


def _renamed(frame: Frame, names: Mapping[str, str]) -> Spoiled:
    return Spoiled({names.get(label, label): xy for label, xy in frame.pixels.items()})


def _top_bottom(label: str) -> str:
    swapped = label.replace("top", "TOP").replace("bottom", "top").replace("TOP", "bottom")
    return swapped if swapped in FIELD else label


def _one_swapped(**said: Any) -> Way:
    """One label replaced by that of the other side."""

    def way(frame: Frame, rng: np.random.Generator) -> Spoiled | None:
        its = frame.pixels
        others = {
            label: next(iter(under_labels_of_other_side({label: xy}, FIELD))) for label, xy in frame.pixels.items()
        }
        possible = [label for label, other in others.items() if other not in its]
        if not possible:
            return None
        label = str(rng.choice(possible))
        return Spoiled(_renamed(frame, {label: others[label]}).pixels, said)

    return way


def _picture(shown: Callable[[Frame], Map], size: tuple[int, int] | None = None, *, is_cut: bool = False) -> Way:
    """The picture is shown otherwise, and its labels where it shows them; if it is cut, those outside it are lost."""

    def way(frame: Frame, rng: np.random.Generator) -> Spoiled:
        moved, inside = shown(frame), frame.size if size is None else np.array(size)
        pixels = {label: moved(xy) for label, xy in frame.pixels.items()}
        if is_cut:
            kept = {label: xy[np.all((xy >= 0.0) & (xy <= inside - 1.0), axis=1)] for label, xy in pixels.items()}
            pixels = {label: xy for label, xy in kept.items() if len(xy)}
        return Spoiled(pixels, size=size, shown=moved)

    return way


def _turned(degrees: float) -> Way:
    angle = np.radians(degrees)
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return _picture(lambda frame: lambda xy: (xy - frame.size / 2.0) @ R.T + frame.size / 2.0)


def _bent(k: float) -> Way:
    def shown(frame: Frame) -> Map:
        def bent(xy: Array) -> Array:
            d = xy - frame.size / 2.0
            r2 = np.sum(np.square(d), axis=-1, keepdims=True) / np.sum(np.square(frame.size / 2.0))
            return np.asarray(frame.size / 2.0 + d * (1.0 + k * r2))

        return bent

    return _picture(shown)


def _marked(moved: Callable[[Array, np.random.Generator], Array], **said: Any) -> Way:
    """The marks of each label are changed, the picture is not."""
    return lambda frame, rng: Spoiled({label: moved(xy, rng) for label, xy in frame.pixels.items()}, said)


def _said(size: tuple[int, int] | None = None, **said: Any) -> Way:
    return lambda frame, rng: Spoiled(frame.pixels, said, size)


def _known(given: Callable[[Frame], Mapping[str, Any]]) -> Way:
    """Labels as they are, with a camera given as known; `flags` are added to the usual ones."""

    def way(frame: Frame, rng: np.random.Generator) -> Spoiled:
        said = dict(given(frame))
        return Spoiled(frame.pixels, {**said, "flags": DEFAULT_FLAGS | said["flags"]})

    return way


def _K(factor: float = 1.0, off: tuple[float, float] = (0.0, 0.0), *, whole: float = 1.0) -> Callable[[Frame], Array]:
    """The camera matrix with a wrong focal length, principal point or scale."""

    def wrong(frame: Frame) -> Array:
        K = frame.camera.K.copy()
        K[0, 0] *= factor
        K[1, 1] *= factor
        K[:2, 2] += off
        K[:2] *= whole
        return K

    return wrong


def _known_K(K: Callable[[Frame], Array], flags: int, **others: Any) -> Way:
    return _known(lambda frame: {"camera_matrix": K(frame), "flags": flags, **others})


def _standing(off: tuple[float, float, float]) -> Way:
    """The position is given, wrong by so many metres."""
    at = np.array(off)
    known = lambda frame: {"rvec": np.zeros(3), "tvec": -(frame.camera.C + at), "flags": F.CALIB_FIX_POSITION}  # noqa: E731
    return _known(known)


def _rolled(degrees: float) -> Way:
    def known(frame: Frame) -> dict[str, Any]:
        pan, tilt, roll = frame.camera.angles
        one = Camera.from_angles(pan, tilt, roll + np.radians(degrees), 1000.0, frame.camera.C, frame.camera.image_size)
        rvec, tvec, *_ = one.to_opencv()
        return {"rvec": rvec, "tvec": tvec, "flags": F.CALIB_FIX_ROLL | F.CALIB_USE_EXTRINSIC_GUESS}

    return _known(known)


def _mixed(frame: Frame, rng: np.random.Generator) -> Spoiled | None:
    """A tenth of the labels, at least one, are where another frame has them."""
    both = [label for label in frame.pixels if label in frame.another]
    if not both:
        return None
    chosen = rng.choice(both, min(len(both), max(1, round(0.1 * len(frame.pixels)))), replace=False)
    return Spoiled({**frame.pixels, **{str(label): frame.another[str(label)] for label in chosen}})


def _one_more(frame: Frame, rng: np.random.Generator) -> Spoiled | None:
    """One more label, of another frame."""
    new = [label for label in frame.another if label not in frame.pixels]
    if not new:
        return None
    label = str(rng.choice(new))
    return Spoiled({**frame.pixels, label: frame.another[label]})


def _half_later(frame: Frame, rng: np.random.Generator) -> Spoiled:
    """Half of the labels are of a picture that a panning camera took a little later."""
    later = set(rng.permutation(list(frame.pixels))[: len(frame.pixels) // 2].tolist())
    return Spoiled({label: xy + [25.0 * (label in later), 0.0] for label, xy in frame.pixels.items()})


def _copies(frame: Frame, rng: np.random.Generator) -> Spoiled:
    label = str(rng.choice(list(frame.pixels)))
    xy = frame.pixels[label]
    turn = rng.uniform(0.0, 2.0 * np.pi)
    far = np.clip(xy[0] + 70.0 * np.array([np.cos(turn), np.sin(turn)]), 0.0, frame.size - 1.0)
    return Spoiled({**frame.pixels, label: np.concatenate([xy, np.repeat(far[None], 30, axis=0)])})


def _noise(sigma: float) -> Way:
    return _marked(lambda xy, rng: xy + sigma * rng.normal(size=xy.shape))


def _heavy(frame: Frame, rng: np.random.Generator) -> Spoiled:
    return Spoiled(frame.pixels, {"weights": {next(iter(frame.pixels)): 1e6}})


def _interlaced(xy: Array, rng: np.random.Generator) -> Array:
    return np.asarray(xy + np.where(np.arange(len(xy)) % 2, 12.0, 0.0)[:, None] * [1.0, 0.0])


CONTROL = "unchanged"
SHIFTED, OTHER_SIDE = "all labels shifted 40 px", "left/right and top/bottom swapped"
UNTOLD = (CONTROL, SHIFTED, OTHER_SIDE)  # a picture could have these labels: of another view, from the other side
FIX_K = F.CALIB_FIX_FOCAL_LENGTH | F.CALIB_FIX_PRINCIPAL_POINT
LENS = F.CALIB_USE_INTRINSIC_GUESS | F.CALIB_FIX_K1
WAYS: Mapping[str, Way] = {
    CONTROL: _said(),
    "x and y swapped": _marked(lambda xy, rng: xy[:, ::-1]),
    "y flipped": _picture(lambda frame: lambda xy: xy * [1.0, -1.0] + [0.0, frame.size[1] - 1.0]),
    "rounded to integers": _marked(lambda xy, rng: np.rint(xy)),
    "rounded to 8 px": _marked(lambda xy, rng: 8.0 * np.rint(xy / 8.0)),
    "said to be 1280x720": _said((1280, 720)),
    "said to be 960x720": _said((960, 720)),
    "said to be 1920x1080": _said((1920, 1080)),
    "4:3 stretched to 16:9": _picture(lambda frame: lambda xy: (xy - [120.0, 0.0]) * [4.0 / 3.0, 1.0], is_cut=True),
    "upper left quarter enlarged": _picture(lambda frame: lambda xy: 2.0 * xy, is_cut=True),
    "lower right quarter enlarged": _picture(lambda frame: lambda xy: 2.0 * xy - frame.size, is_cut=True),
    "one label left/right swapped": _one_swapped(),
    "all labels left/right swapped": lambda frame, rng: Spoiled(under_labels_of_other_side(frame.pixels, FIELD)),
    "all labels top/bottom swapped": lambda frame, rng: _renamed(frame, {name: _top_bottom(name) for name in FIELD}),
    OTHER_SIDE: lambda frame, rng: _renamed(frame, FIELD.symmetric),
    "a tenth where another frame has them": _mixed,
    "one more label of another frame": _one_more,
    "rolled 10 degrees": _turned(10.0),
    "rolled 30 degrees": _turned(30.0),
    "upside down": _turned(180.0),
    "portrait, turned by 90": _picture(
        lambda frame: lambda xy: [frame.size[1] - 1.0, 0.0] + xy[:, ::-1] * [-1, 1], (540, 960)
    ),
    "half of the labels 25 px later": _half_later,
    SHIFTED: _marked(lambda xy, rng: xy + [40.0, 0.0]),
    "2 points a label": _marked(lambda xy, rng: xy[rng.choice(len(xy), min(2, len(xy)), replace=False)]),
    "2 leftmost points a label": _marked(lambda xy, rng: xy[np.argsort(xy[:, 0])[:2]]),
    "each point 50 times": _marked(lambda xy, rng: np.repeat(xy, 50, axis=0)),
    "30 copies of a point 70 px off": _copies,
    "mirrored": _picture(lambda frame: lambda xy: xy * [-1.0, 1.0] + [frame.size[0] - 1.0, 0.0]),
    "barrel -0.15": _bent(-0.15),
    "barrel -0.3": _bent(-0.3),
    "barrel -0.45": _bent(-0.45),
    "pincushion 0.2": _bent(0.2),
    "every second point 12 px aside": _marked(_interlaced),
    "noise of 6 px": _noise(6.0),
    "weight 1e6 of the first label": _heavy,
    "focal length given 20 % too long": _known_K(_K(1.2), F.CALIB_FIX_FOCAL_LENGTH),
    "focal length given 20 % too short": _known_K(_K(1.0 / 1.2), F.CALIB_FIX_FOCAL_LENGTH),
    "camera matrix given for 1920x1080": _known_K(_K(whole=2.0), FIX_K),
    "principal point given 150, 80 px off": _known_K(_K(off=(150.0, 80.0)), FIX_K),
    "k1 given, +0.25": _known_K(_K(), LENS, dist_coeffs=np.array([0.25, 0.0])),
    "k1 given, -0.25": _known_K(_K(), LENS, dist_coeffs=np.array([-0.25, 0.0])),
    "position given 5 m too near": _standing((0.0, -5.0, 0.0)),
    "position given 5 m too high": _standing((0.0, 0.0, -5.0)),
    "roll given 3 degrees off": _rolled(3.0),
    "one label swapped, labels trusted": _one_swapped(trust_labels=True),
    "one label swapped, no prior": _one_swapped(prior=None),
    "prior of the opposite tribune": _said(prior="opposite tribune"),
}


def calibrated(frames: Sequence[Frame], spoiled: Sequence[Spoiled]) -> list[Calibration | None]:
    """The calibrations of spoiled frames; None for those that are refused with an error."""
    found: list[Calibration | None] = [None] * len(spoiled)
    batches: dict[tuple[Any, ...], list[int]] = {}
    for t, (frame, one) in enumerate(zip(frames, spoiled, strict=True)):
        size = one.size or frame.camera.image_size
        try:
            if OF_ONE_FRAME & one.said.keys():
                found[t] = calibrate_from_segments(FIELD, one.pixels, size, **one.said)
            else:
                calibrate_batch(FIELD, [one.pixels], size, criteria=(1, 1, 1.0), trust_labels=True)  # checks them
                batches.setdefault((size, *sorted(one.said.items())), []).append(t)
        except ValueError:
            continue
    for (size, *said), batch in batches.items():
        of_batch = calibrate_batch(FIELD, [spoiled[t].pixels for t in batch], size, **dict(said))
        for t, calibration in zip(batch, of_batch, strict=True):
            found[t] = calibration
    return found


def metres_off(camera: Camera, frame: Frame, shown: Map) -> tuple[float, float]:
    """Median and 95 % quantile, metres, of the distances between the places that a pixel of the picture shows."""
    width, height = frame.camera.image_size
    x, y = np.meshgrid(np.linspace(0.0, width - 1.0, GRID[0]), np.linspace(0.0, height - 1.0, GRID[1]))
    xy = np.stack([x, y], axis=-1).reshape(-1, 2)
    xy = xy[np.all((shown(xy) >= 0.0) & (shown(xy) <= np.subtract(camera.image_size, 1.0)), axis=1)]
    X = frame.camera.image_to_field(xy)
    on_field = np.all(np.abs(X[:, :2]) <= np.array([FIELD.length, FIELD.width]) / 2.0, axis=1)  # false for NaN
    off = np.linalg.norm(camera.image_to_field(shown(xy[on_field])) - X[on_field], axis=1)
    median, most = np.quantile(np.nan_to_num(off, nan=np.inf), (0.5, 0.95), method="nearest")
    return float(median), float(most)


@dataclass(frozen=True)
class Counts:
    """What came of one way."""

    tried: int
    refused: int
    verdicts: Mapping[str, int]
    off: Sequence[tuple[float, float, str]]
    """Median, 95 % quantile and frame of the good ones, the worst first."""

    @property
    def numbers(self) -> list[int]:
        """The columns of the table."""
        verdicts = [self.verdicts.get(str(one), 0) for one in Verdict]
        return [self.tried, self.refused, *verdicts, *(sum(m > far for m, _, _ in self.off) for far in FAR_OFF)]


def measured(way: Way, frames: Sequence[Frame], rng: np.random.Generator) -> Counts:
    """Spoil frames in one way and count what comes."""
    pairs = [(frame, one) for frame in frames if (one := way(frame, rng)) is not None]
    found = calibrated(*map(list, zip(*pairs, strict=True))) if pairs else []
    verdicts: Counter[str] = Counter()
    off = []
    for (frame, one), calibration in zip(pairs, found, strict=True):
        if calibration is None:
            continue
        verdicts[str(calibration.verdict)] += 1
        if calibration.verdict is Verdict.GOOD:
            off.append((*metres_off(calibration.required_camera, frame, one.shown), frame.name))
    return Counts(len(pairs), sum(one is None for one in found), verdicts, sorted(off, reverse=True))


def good_frames(
    frames: Mapping[str, Pixels], size: tuple[int, int], number: int, rng: np.random.Generator
) -> list[Frame]:
    """Random frames whose labels, as annotated, give a good camera."""
    names, found = list(frames), calibrate_batch(FIELD, list(frames.values()), size)
    chosen: list[Frame] = []
    for t in rng.permutation(len(names)).tolist():
        if len(chosen) == number:
            break
        if found[t].verdict is Verdict.GOOD:
            another = names[int(rng.integers(max(len(names) - 1, 1)))]
            another = names[-1] if another == names[t] else another
            chosen.append(Frame(names[t], frames[names[t]], found[t].required_camera, frames[another]))
    return chosen


def run(options: argparse.Namespace) -> int:
    """Spoil, calibrate and print; returns the exit code."""
    frames = read_frames([options.annotations], FIELD, options.size)
    chosen = good_frames(frames, options.size, options.frames, np.random.default_rng(options.seed))
    heads = ("tried", "refused", *map(str, Verdict), *(f"good>{far:g}m" for far in FAR_OFF))
    print(f"{'way':38}", *(f"{head:>8}" for head in heads), "  worst")
    total = np.zeros(len(heads), dtype=int)
    for k, (name, way) in enumerate(WAYS.items()):
        if options.ways and not any(word in name for word in options.ways):
            continue
        counts = measured(way, chosen, np.random.default_rng((options.seed, k)))
        total += 0 if name in UNTOLD else np.array(counts.numbers)
        worst = [f"{m:.1f} m, 95 % {most:.1f} m, {one}" for m, most, one in counts.off[:1] if m > FAR_OFF[0]]
        print(f"{name:38}", *(f"{number:8}" for number in counts.numbers), " ", *worst, flush=True)
    print(f"{'all but ' + str(len(UNTOLD)):38}", *(f"{number:8}" for number in total))
    say(f"{100.0 * total[heads.index('good>1m')] / max(total[0], 1):.2f} % are good and more than {FAR_OFF[0]:g} m off")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("annotations", type=Path, help="folder or zip of <id>.json")
    add_size(parser, "of the images", required=True)
    parser.add_argument("--frames", type=count, default=100, help="(100)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--ways", nargs="+", metavar="WORD", help="only ways whose names have one of these")
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
