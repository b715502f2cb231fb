"""Cameras of pictures that show frames within them: split screens, shrunken frames, insets, digital zoom.

    python -m data_tools.pictures_in_pictures rendered [--frames N] [--seed S]
    python -m data_tools.pictures_in_pictures real FOLDER ...
    python -m data_tools.pictures_in_pictures enlarged FOLDER ... [--seed S]
    python -m data_tools.pictures_in_pictures clips [--clips N] [--frames N] [--seed S]

`rendered` takes single frames of synthetic clips with their true cameras; `real` takes the pictures of folders whose
cameras are good, and these cameras as true; `clips` takes short synthetic clips. Each is shown in every way of `WAYS`,
next to or around another one of them. `enlarged` shows of each picture that `real` takes a random part off the middle,
of 0.5 to 0.8 of its size, enlarged to that. A line of JSON for each way has the number of pictures (of frames, for
clips), how many of them get a camera that is accepted and how many a good one, how many of the good ones are wrong,
and how many of these in metres, and how many complain of their layout.

A camera is wrong if it is off by more than 1 m on the ground somewhere in view (`data_tools.probability`), or if the
points of the field in view are, in the median, more than 5 px of 1280 away. In view is what the window shows; where
there are two, the one that the camera fits better counts.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from data_tools.command_parser import add_made_frames, parser_of
from data_tools.probability import largest_true_error
from data_tools.synthetic.film import PAINTED, Scene, clip_frames, filmed
from data_tools.synthetic.paths import with_displaced_lines
from data_tools.truth import UNIT, points_in_view
from fieldcalib.assess.findings import Verdict, What
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import count
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.clip.from_video import calibrate_video
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.io.image_files import Image, parse_image, size_of
from fieldcalib.localize.network import SegmentationNetwork

LARGEST_ERROR, RIGHT = 1.0, 5.0  # metres; px of `UNIT`
SUFFIXES = (".jpg", ".png")
NOT_WHOLE_FRAMES = What.PART, What.ENLARGED, What.SHAPE, What.SEVERAL_VIEWS, What.IN_WINDOW
LINE = (235, 235, 235)
PARTS, OFF_MIDDLE = (0.5, 0.8), 0.25  # of the size; least distance from the middle, where 0.5 is at the border
BLUR = 25.0  # px: of a picture that is the background of itself


@dataclass(frozen=True, eq=False)
class View:
    """A frame with its true camera and the field that it shows."""

    image: Image
    camera: Camera
    field: Field


@dataclass(frozen=True)
class Window:
    """A part of a frame, shown in a part of a picture; all are (left, top, width, height) as shares."""

    part: tuple[float, float, float, float]
    place: tuple[float, float, float, float]
    view: int = 0
    """Number of the frame."""


WHOLE = (0.0, 0.0, 1.0, 1.0)
Arrangement = tuple[tuple[Window, ...], str, float]
"""Windows, the last one on top; the background; the width of a line around them, as a share of the picture's."""


def _shrunk(share: float, x: float, y: float, background: str, line: float) -> Arrangement:
    place = (x * (1.0 - share), y * (1.0 - share), share, share)
    return (Window(WHOLE, place),), background, line


def _zoomed(share: float, x: float, y: float) -> Arrangement:
    return (Window((x * (1.0 - share), y * (1.0 - share), share, share), WHOLE),), "even", 0.0


def part_off_the_middle(rng: np.random.Generator) -> Arrangement:
    """A random part of a frame, enlarged to its size.

    Examples
    --------
    >>> (window,), _, _ = part_off_the_middle(np.random.default_rng(0))
    >>> [round(float(share), 2) for share in window.part], window.place
    ([0.01, 0.0, 0.74, 0.74], (0.0, 0.0, 1.0, 1.0))
    """
    x, y = rng.uniform(0.0, 1.0, 2)
    while max(abs(x - 0.5), abs(y - 0.5)) < OFF_MIDDLE:
        x, y = rng.uniform(0.0, 1.0, 2)
    return _zoomed(rng.uniform(*PARTS), x, y)


def _inset(share: float, x: float, y: float) -> Arrangement:
    place = (0.03 + x * (0.94 - share), 0.03 + y * (0.94 - share), share, share)
    return (Window(WHOLE, WHOLE), Window(WHOLE, place, 1)), "even", 0.004


def _halves(share: float, line: float) -> Arrangement:
    left, right = (0.5 - share / 2.0, 0.0, share, 1.0), (share / 2.0, 0.0, 1.0 - share, 1.0)
    return (Window(left, (0.0, 0.0, share, 1.0)), Window(right, (share, 0.0, 1.0 - share, 1.0), 1)), "even", line


def _beside(first: float, second: float, background: str) -> Arrangement:
    gap = (1.0 - first - second) / 3.0
    left = (gap, 0.5 - first / 2.0, first, first)
    right = (first + 2.0 * gap, 0.5 - second / 2.0, second, second)
    return (Window(WHOLE, left), Window(WHOLE, right, 1)), background, 0.003


WAYS: Mapping[str, Arrangement] = {
    "as it is": ((Window(WHOLE, WHOLE),), "even", 0.0),
    "split into halves": _halves(0.5, 0.004),
    "split into halves, no line": _halves(0.5, 0.0),
    "split, two thirds": _halves(0.66, 0.004),
    "side by side, studio": _beside(0.47, 0.47, "graded"),
    "side by side, unequal": _beside(0.6, 0.34, "blurred"),
    "0.8 upper left, studio": _shrunk(0.8, 0.1, 0.1, "graded", 0.004),
    "0.75 left, even": _shrunk(0.75, 0.0, 0.0, "even", 0.0),
    "0.7 middle, blurred": _shrunk(0.7, 0.5, 0.5, "blurred", 0.0),
    "0.65 right, studio": _shrunk(0.65, 0.9, 0.4, "graded", 0.0),
    "0.5 lower right, blurred": _shrunk(0.5, 0.95, 0.9, "blurred", 0.004),
    "inset lower right": _inset(0.3, 1.0, 1.0),
    "inset upper left": _inset(0.35, 0.0, 0.0),
    "zoom 1.33 upper left": _zoomed(0.75, 0.0, 0.0),
    "zoom 1.33 lower right": _zoomed(0.75, 1.0, 1.0),
    "zoom 2 upper right": _zoomed(0.5, 1.0, 0.0),
    "zoom 1.5 left": _zoomed(0.67, 0.0, 0.5),
}


@dataclass(frozen=True, eq=False)
class Shown:
    """A picture with its windows: their places in pixels (left, top, width, height), true cameras, fields."""

    image: Image
    windows: tuple[tuple[tuple[int, int, int, int], Camera, Field], ...]


def arranged(views: Sequence[View], how: Arrangement, rng: np.random.Generator) -> Shown:
    """Frames shown in the windows of a picture as large as the first one.

    Examples
    --------
    >>> camera = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> view = View(np.full((540, 960, 3), 90, np.uint8), camera, soccer())
    >>> shown = arranged([view], WAYS["0.75 left, even"], np.random.default_rng(0))
    >>> shown.windows[0][0], shown.windows[0][1].focal_length
    ((0, 0, 720, 405), 1050.0)
    """
    windows, background, line = how
    size = size_of(views[0].image)
    picture = _background(views[0].image, background, rng)
    border = round(line * size[0])
    seen = []
    for window in windows:
        view = views[window.view]
        a, b, c, d = _pixels(window.part, size_of(view.image))
        x, y, w, h = place = _pixels(window.place, size)
        if border:
            picture[max(y - border, 0) : y + h + border, max(x - border, 0) : x + w + border] = LINE
        interpolation = cv2.INTER_AREA if w < c else cv2.INTER_LINEAR
        picture[y : y + h, x : x + w] = cv2.resize(
            view.image[b : b + d, a : a + c], (w, h), interpolation=interpolation
        )
        camera = view.camera.cropped((a, b), (c, d)).scaled((w, h)).cropped((-x, -y), size)
        seen.append((place, camera, view.field))
    return Shown(picture, tuple(seen))


def _pixels(share: tuple[float, float, float, float], size: tuple[int, int]) -> tuple[int, int, int, int]:
    """A rectangle (left, top, width, height) in whole pixels, which has its shape to half a pixel."""
    left, top = round(share[0] * size[0]), round(share[1] * size[1])
    right, bottom = (round((share[i] + share[i + 2]) * size[i]) for i in (0, 1))
    return left, top, right - left, bottom - top


def _background(image: Image, kind: str, rng: np.random.Generator) -> Image:
    """A picture as large as the image: of one colour, a dim gradient with noise and stripes, or the image blurred."""
    width, height = size_of(image)
    colour = rng.uniform(20.0, 200.0, 3)
    if kind == "even":
        return np.full((height, width, 3), colour, np.uint8)
    if kind == "blurred":
        middle = image[height // 6 : -height // 6, width // 6 : -width // 6]
        large = cv2.resize(middle, (width, height), interpolation=cv2.INTER_LINEAR)
        return np.asarray(0.6 * cv2.GaussianBlur(large, (0, 0), BLUR), np.uint8)
    x, y = np.meshgrid(np.linspace(0.0, 1.0, width), np.linspace(0.0, 1.0, height))
    light = 0.4 + 0.6 * (x * rng.uniform() + y * rng.uniform()) + 0.08 * np.sin(rng.uniform(20.0, 60.0) * (x + 0.5 * y))
    return np.asarray(
        np.clip(light[..., None] * colour + rng.normal(0.0, 2.0, (height, width, 1)), 0.0, 255.0), np.uint8
    )


def is_wrong(found: Camera, shown: Shown) -> bool:
    """Whether a camera is wrong in all windows of a picture, in pixels or in metres."""
    errors = [_errors_in(found, *window) for window in shown.windows]
    return all(pixels > RIGHT or metres > LARGEST_ERROR for pixels, metres in errors)


def is_off_in_metres(found: Camera, shown: Shown) -> bool:
    """Whether a camera is wrong in metres in all windows of a picture."""
    return all(_errors_in(found, *window)[1] > LARGEST_ERROR for window in shown.windows)


def _errors_in(found: Camera, place: tuple[int, int, int, int], truth: Camera, field: Field) -> tuple[float, float]:
    """Median error of points in view, px of `UNIT`, and the largest one on the ground, metres; infinite if unknown."""
    x, y, w, h = place
    one, true = (camera.cropped((x, y), (w, h)) for camera in (found, truth))
    xy, X = points_in_view(true, field)
    off = np.linalg.norm(one.project(X) - xy, axis=1) * UNIT / found.image_size[0]
    pixels = float(np.median(np.nan_to_num(off, nan=np.inf))) if len(xy) else np.inf
    return pixels, float(np.nan_to_num(largest_true_error(one, true, soccer(), field), nan=np.inf))


def counts(found: Iterable[Calibration], shown: Iterable[Shown]) -> dict[str, int]:
    """Numbers of pictures, of accepted and good cameras, of good ones that are wrong, and of complaints."""
    total = {"count": 0, "accepted": 0, "good": 0, "good and wrong": 0, "good and 1 m off": 0, "complain": 0}
    for one, picture in zip(found, shown, strict=True):
        good = one.verdict is Verdict.GOOD
        total["count"] += 1
        total["accepted"] += one.accepted
        total["good"] += good
        total["good and wrong"] += good and is_wrong(one.required_camera, picture)
        total["good and 1 m off"] += good and is_off_in_metres(one.required_camera, picture)
        total["complain"] += one.has_finding(*NOT_WHOLE_FRAMES)
    return total


def rendered_views(seeds: Iterable[int]) -> list[View]:
    """Single frames of synthetic clips, one of each."""
    return [clip_views(seed, 1)[0] for seed in seeds]


def clip_views(seed: int, frames: int) -> list[View]:
    """The first frames of a synthetic clip."""
    field = with_displaced_lines(soccer(), np.random.default_rng((seed, PAINTED)))
    true = clip_frames(seed, frames)
    scene = Scene.random(field, seed, [frame.camera for frame in true])
    return [View(filmed(scene, true, index), frame.camera, field) for index, frame in enumerate(true)]


def rendered(options: argparse.Namespace) -> int:
    """Measure frames of synthetic clips."""
    return _of_pictures(rendered_views(range(options.seed, options.seed + options.frames)))


def real(options: argparse.Namespace) -> int:
    """Measure the pictures of folders."""
    return _of_pictures(good_views(options.folders))


def enlarged(options: argparse.Namespace) -> int:
    """Measure random parts of the pictures of folders."""
    rngs = map(np.random.default_rng, itertools.count(options.seed))
    shown = [
        arranged([view], part_off_the_middle(rng), rng)
        for view, rng in zip(good_views(options.folders), rngs, strict=False)
    ]
    _print_counts("enlarged part", shown, SegmentationNetwork.load())
    return 0


def good_views(folders: Iterable[Path]) -> list[View]:
    """The pictures of folders whose cameras are good, with these."""
    paths = sorted(path for folder in folders for path in folder.iterdir() if path.suffix in SUFFIXES)
    images = [parse_image(path.read_bytes()) for path in paths]
    found = calibrate_from_images(soccer(), images, SegmentationNetwork.load(), estimate_size=False)
    both = zip(images, found, strict=True)
    return [View(image, one.required_camera, soccer()) for image, one in both if one.verdict is Verdict.GOOD]


def _of_pictures(views: Sequence[View]) -> int:
    network = SegmentationNetwork.load()
    for name, how in WAYS.items():
        shown = [
            arranged([view, views[index - 1]], how, np.random.default_rng(index)) for index, view in enumerate(views)
        ]
        _print_counts(name, shown, network)
    return 0


def _print_counts(name: str, shown: Sequence[Shown], network: SegmentationNetwork) -> None:
    found = calibrate_from_images(soccer(), [one.image for one in shown], network, estimate_size=False)
    print(json.dumps({"way": name, **counts(found, shown)}), flush=True)


def clips(options: argparse.Namespace) -> int:
    """Measure synthetic clips."""
    seeds = range(options.seed, options.seed + options.clips)
    made = [clip_views(seed, options.frames) for seed in seeds]
    for name, how in WAYS.items():
        total: Counter[str] = Counter()
        for index, (views, others) in enumerate(zip(made, [made[-1], *made[:-1]], strict=True)):
            pairs = zip(views, others, strict=True)
            shown = [arranged(pair, how, np.random.default_rng(index)) for pair in pairs]
            found = calibrate_video(soccer(), [one.image for one in shown])
            total.update(counts(found, shown))
        print(json.dumps({"way": name, **total}), flush=True)
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line of JSON for each way."""
    measures = (rendered, real, enlarged, clips)
    functions: dict[str, Callable[[argparse.Namespace], int]] = {one.__name__: one for one in measures}
    parser, commands = parser_of(__doc__, functions)
    for name, command in commands.items():
        command.set_defaults(run=functions[name])
        if name in ("real", "enlarged"):
            command.add_argument("folders", type=Path, nargs="+", help="pictures of soccer")
        else:
            add_made_frames(command, 40 if name == "rendered" else 90)
    commands["enlarged"].add_argument("--seed", type=int, default=0)
    commands["clips"].add_argument("--clips", type=count, default=4, help="(4)")
    return run_command(parser.parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
