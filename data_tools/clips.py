"""Errors of jointly calibrated clips, measured on withheld labels and frames.

    python -m data_tools.clips CLIP... [--flow] [--jitter] [--every-third-second] [--halves] [--labels]
        [--masked FIRST LAST]

`--flow` follows static points over 12 frames by optical flow and prints their distances from where the cameras predict
them: the median and the 90 % quantile, over pairs of frames, of the median over points; and how many frames have a
camera. `--jitter` follows them to the frames before and after and prints the root mean square of their second
differences, by flow and as predicted by the cameras, over sqrt(6): independent errors of one pixel give 1.
`--every-third-second` withholds all lines of every third second and prints how far field points in view move against
the calibration from all lines. `--halves` calibrates the two halves of a clip separately and prints the distance of
their tripods, in metres and against their joint 95 % region. `--labels` leaves out each label in turn and prints how
far its lines lie from the cameras of the other labels, and from those of all. `--masked` withholds the field between
two frames instead: no lines, and no matches within 20 px of it. Pixels are those of an image of 1280 columns.
"""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from data_tools.synthetic.paths import seen_far_away
from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.estimate import region_radius
from fieldcalib.assess.frame_table import Basis
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.console.program import run_command
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.background.keyframe_tracking import TiedFrame, tied_frames
from fieldcalib.images.background.matches import Matches, match_background
from fieldcalib.images.background.matching_frame import Frame
from fieldcalib.images.clip.finished_clip import find_clip_lines, finish_clip
from fieldcalib.images.clip.keyframes import KeyframeLabels, read_keyframes
from fieldcalib.images.clip.solved_shots import solve_shots, solve_tripods
from fieldcalib.images.from_images import How
from fieldcalib.io.image_files import Image, read_ahead
from fieldcalib.io.videos import VideoReader
from fieldcalib.localize.network import Padded, SegmentationNetwork
from fieldcalib.problem.evaluation import evaluate_camera
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.solve.request import Task

GRID = (9, 7)  # columns and rows of the pixels at which field points are compared
UNIT = 1280.0  # columns
APART = 12  # frames over which static points are followed
MASK_EDGE = 20.0  # px
AROUND = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)

Withheld = Callable[[int, str], bool]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line for each clip and measurement."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", nargs="+", type=Path)
    parser.add_argument("--flow", action="store_true")
    parser.add_argument("--jitter", action="store_true")
    parser.add_argument("--every-third-second", action="store_true")
    parser.add_argument("--halves", action="store_true")
    parser.add_argument("--labels", action="store_true")
    parser.add_argument("--masked", nargs=2, type=int, metavar=("FIRST", "LAST"))
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Measure and print; returns the exit code."""
    for path in options.clips:
        whole = Clip(path)
        everything = whole.calibrated()
        frame = np.arange(len(everything))
        if options.flow:
            print(f"{path.name} flow over {APART} frames: {_flow(whole, everything)}")
        if options.jitter:
            print(f"{path.name} jitter: {_jitter(whole, everything)}")
        if options.every_third_second:
            with VideoReader(path) as video:
                is_third = frame // round(video.frames_per_second) % 3 == 2
            moved = _moved(everything, whole.calibrated(withhold_frames(is_third)), is_third)
            print(f"{path.name} lines withheld in every third second: {moved}")
        if options.masked:
            first, last = options.masked
            inside = (frame >= first) & (frame < last)
            part = Clip(path, masked={int(t): everything[int(t)].camera for t in frame[inside]})
            moved = _moved(everything, part.calibrated(withhold_frames(inside)), inside)
            print(f"{path.name} field masked in frames {first} to {last}: {moved}")
        if options.halves:
            middle = len(everything) // 2
            halves = [Clip(path, start, stop).calibrated() for start, stop in ((0, middle), (middle, None))]
            print(f"{path.name} halves: {_tripod_distance(*halves)}")
        if options.labels:
            for label, used, left_out in _left_out(whole, everything):
                print(f"{path.name} {label}: median {used:.2f} px, left out {left_out:.2f} px")
    return 0


def withhold_frames(some: BoolArray) -> Withheld:
    """Withhold all lines of some frames (T,)."""
    return lambda t, label: bool(some[t])


def _withhold_nothing(t: int, label: str) -> bool:
    return False


def _masked(tied: TiedFrame, cameras: dict[int, Camera | None]) -> TiedFrame:
    """The frame without the matches that lie on the field, as the `cameras` of the masked frames see it."""

    def off_field(key: int, matches: Matches) -> Matches:
        usable = _off_field(matches.first, cameras.get(key)) & _off_field(matches.second, cameras.get(tied.index))
        return replace(matches, first=matches.first[usable], second=matches.second[usable])

    return replace(tied, ties=tuple((key, off_field(key, matches)) for key, matches in tied.ties))


class Clip:
    """A part of a video that is calibrated repeatedly; keyframes and matches are computed once."""

    def __init__(
        self, path: Path, start: int = 0, stop: int | None = None, masked: dict[int, Camera | None] | None = None
    ) -> None:
        self.path, self.start, self.stop, self.masked = path, start, stop, masked or {}
        self.network = Padded(SegmentationNetwork.load())
        tied = ((image, _masked(one, self.masked)) for image, one in tied_frames(read_ahead(self.images())))
        self.keyframes = read_keyframes(tied, How(Task(soccer()), self.network).on_paint())
        self.lines: dict[int, PixelTable] = {}

    def images(self) -> Iterator[Image]:
        """Frames of the clip."""
        with VideoReader(self.path) as video:
            yield from islice(video, self.start, self.stop)

    def calibrated(self, withheld: Withheld = _withhold_nothing) -> VideoCalibration:
        """The calibration of all frames from the lines that are not withheld."""
        accepted = {t: KeyframeLabels(one) for t, one in _kept(self.keyframes.accepted, withheld).items()}
        doubtful = {t: one for t, one in self.keyframes.labels.items() if not one.accepted}
        solved = solve_tripods(solve_shots(replace(self.keyframes, labels={**doubtful, **accepted})))
        lines = find_clip_lines(solved, read_ahead(self.images()))
        self.lines = dict(lines.labels)
        return finish_clip(replace(lines, labels=_kept(self.lines, withheld)))


def _flow(clip: Clip, found: VideoCalibration) -> str:
    """Distances of static points from where the cameras of two frames predict them."""
    before: deque[Frame] = deque(maxlen=APART)
    medians: list[float] = []
    for t, image in enumerate(read_ahead(clip.images())):
        frame = Frame.of(image)
        if len(before) == APART:
            one, two = found[t - APART].camera, found[t].camera
            matches = match_background(before[0], frame) if one is not None and two is not None else None
            if matches is not None and one is not None and two is not None:
                distance = np.linalg.norm(seen_far_away(one, two, matches.first) - matches.second, axis=1)
                medians.append(float(np.nanmedian(distance)) * UNIT / image.shape[1])
        before.append(frame)
    accepted = 100.0 * np.mean([calibration.accepted for calibration in found])
    if not medians:
        return f"{accepted:.1f} % accepted, nothing to follow"
    median, most = np.percentile(medians, [50, 90])
    return f"{accepted:.1f} % accepted, median {median:.2f}, 90 % {most:.2f} px"


def _jitter(clip: Clip, found: VideoCalibration) -> str:
    """Second differences of static points by flow and by the cameras."""
    three: deque[Frame] = deque(maxlen=3)
    followed: list[Array] = []
    expected: list[Array] = []
    for t, image in enumerate(read_ahead(clip.images())):
        three.append(Frame.of(image))
        cameras = [camera for one in found[max(t - 2, 0) : t + 1] if (camera := one.camera) is not None]
        if len(three) < 3 or len(cameras) < 3:
            continue
        back, ahead = (match_background(three[1], three[side]) for side in (0, 2))
        if back is None or ahead is None:
            continue
        same = (back.first[:, None] == ahead.first).all(axis=2)
        i, j = np.nonzero(same)
        x = back.first[i]
        before, after = (seen_far_away(cameras[1], cameras[side], x) for side in (0, 2))
        unit = UNIT / image.shape[1] / np.sqrt(6.0)
        followed.append(unit * (back.second[i] + ahead.second[j] - 2.0 * x))
        expected.append(unit * (before + after - 2.0 * x))
    if not followed:
        return "nothing to follow"
    by_flow, by_cameras = (np.sqrt(np.mean(np.sum(np.square(np.concatenate(d)), axis=1))) for d in (followed, expected))
    return f"{by_flow:.2f} px of static points, {by_cameras:.2f} px of the cameras"


def _kept(lines: dict[int, PixelTable], withheld: Withheld) -> dict[int, PixelTable]:
    return {
        t: table.take(~np.array([withheld(t, label) for label in table.labels])[table.label])
        for t, table in lines.items()
    }


def _off_field(xy: Array, camera: Camera | None) -> BoolArray:
    """Mask of the pixels (n, 2) that are more than `MASK_EDGE` from the field; all, without a camera."""
    if camera is None:
        return np.ones(len(xy), dtype=bool)
    edge = MASK_EDGE * camera.image_size[0] / UNIT
    around = edge * np.stack([np.cos(AROUND), np.sin(AROUND)], axis=-1)
    X = camera.image_to_field(xy[:, None] + np.concatenate([np.zeros((1, 2)), around]))
    with np.errstate(invalid="ignore"):
        on_field = np.all(np.abs(X[..., :2]) < (soccer().length / 2.0, soccer().width / 2.0), axis=-1)
    return np.asarray(~np.any(on_field, axis=1))


def _moved(everything: VideoCalibration, found: VideoCalibration, some: BoolArray) -> str:
    """Distances, in some frames, of field points in view from their images under the calibration of the whole clip."""
    errors: list[Array] = []
    lost = 0
    for t in np.flatnonzero(some).tolist():
        before, after = everything[t].camera, found[t].camera
        if before is None:
            continue
        if after is None or not found[t].accepted:
            lost += 1
            continue
        width, height = before.image_size
        xy = np.stack(np.meshgrid(np.linspace(0, width - 1, GRID[0]), np.linspace(0, height - 1, GRID[1])), axis=-1)
        X = before.image_to_field(xy.reshape(-1, 2))
        X = X[np.all(np.abs(X[:, :2]) < (55.0, 37.0), axis=1)]
        errors.append(np.linalg.norm(after.project(X) - before.project(X), axis=1) * UNIT / width)
    basis = np.array([str(one) for one in found.basis])[some]
    by_lines = int(np.sum(np.char.startswith(basis, Basis.LINES)))
    if not errors:
        return f"no camera in any of {int(np.sum(some))} frames"
    median, most = np.percentile(np.concatenate(errors), [50, 95])
    return f"median {median:.2f}, 95 % {most:.2f} px in {len(errors)} frames, {by_lines} of them by lines; {lost} lost"


def _tripod_distance(one: VideoCalibration, two: VideoCalibration) -> str:
    """Distance between the first tripods, those with most frames, of two calibrations."""
    if not one.tripods or not two.tripods:
        return "one of them has no tripod"
    (a, V), (b, W) = ((tripods[0].values[:3], tripods[0].covariance[:3, :3]) for tripods in (one.tripods, two.tripods))
    sigmas = float(np.sqrt((a - b) @ np.linalg.solve(V + W, a - b)))
    limit = region_radius(3, 1e9, 0.95)
    return f"{np.linalg.norm(a - b):.2f} m apart, {sigmas:.2f} standard deviations (95 %: {limit:.2f})"


def _left_out(clip: Clip, everything: VideoCalibration) -> Iterable[tuple[str, float, float]]:
    """Median distances of the lines of each label when they are used and when they are left out."""
    lines = clip.lines
    for label in sorted({label for table in lines.values() for label in table.by_label(0)}):
        without = clip.calibrated(_withhold_label(label))
        yield label, _distance(everything, lines, label), _distance(without, lines, label)
    clip.lines = lines


def _withhold_label(label: str) -> Withheld:
    return lambda t, other: other == label


def _distance(found: VideoCalibration, lines: dict[int, PixelTable], label: str) -> float:
    """Median distance, px, of the lines of a label from their projections."""
    distances: list[Array] = []
    for t, table in lines.items():
        calibration, pixels = found[t], table.by_label(0)
        if label in pixels and calibration.camera is not None and calibration.field is not None:
            evaluation = evaluate_camera(calibration.camera, calibration.field, {label: pixels[label]})
            distances.append(np.abs(evaluation.r[0]) * UNIT / calibration.camera.image_size[0])
    return float(np.median(np.concatenate(distances))) if distances else float("nan")


if __name__ == "__main__":
    raise SystemExit(main())
