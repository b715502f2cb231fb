"""Correction of a clip: which frame to label next, and the solution of the clip around frames that a person labelled.

Frames that a person has labelled or corrected ("mended") are anchors: `solve` solves the clip again around them, and
gives a `Proposal` that may be kept or dropped. `draw_again` draws the clip's files anew after its cameras changed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from dataclasses import field as attribute
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.findings import Finding, Verdict, What
from fieldcalib.assess.label_errors import rms_of_labels
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import Shape, Shot, VideoCalibration
from fieldcalib.draw.clip_plot import plot_sequence
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.draw.sheet import contact_sheet, worst_frames
from fieldcalib.editor.fitting import FARTHER, network_marks, pixels_in_picture
from fieldcalib.editor.frame_states import Row
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.background.keyframe_tracking import linked_frames, tied_frames
from fieldcalib.images.clip.clip_shape import ShapeEstimator
from fieldcalib.images.clip.clip_with_anchors import Anchors, solve_around
from fieldcalib.images.clip.from_video import PART
from fieldcalib.images.clip.keyframes import KeyframeLabels, Keyframes, read_keyframes
from fieldcalib.images.from_images import How, Mount
from fieldcalib.io.decoders import DEFAULT_RATE
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.formats import VIDEOS
from fieldcalib.io.frame_source import FrameSource
from fieldcalib.io.image_files import Image, spread, write_image
from fieldcalib.localize import Network
from fieldcalib.localize.network import Padded
from fieldcalib.problem.evaluation import evaluate_cameras
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.run_folder.clip_results import SHEET_FRAMES, caption
from fieldcalib.run_folder.results import MOTION, OVERLAY, WORST
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import pixel_unit

GRID = (9, 6)  # points across and down the picture by which cameras are compared
STAGES = ("matching", "solving", "finding lines", "comparing")

SAME = 1e-6  # px: cameras between which points move less than this are the same
LOOKED_AT = 9  # frames of a stretch in which markings are counted
BESIDE_MENDED = 5  # frames around a mended frame that are not proposed, as their view is nearly the same

AGAIN = (OVERLAY, WORST, MOTION)
"""Files that can be drawn again."""

BESIDE, CUTS = Finding(What.FRAMES_BESIDE_CLIP), Finding(What.CUTS_BESIDE_CLIP)

Progress = Callable[[int, int, str], None]
"""Gets the number of frames that are done, of all, and the stage; may raise an error to end the work."""


class Window(NamedTuple):
    """Consecutive frames that are solved together."""

    begin: int
    end: int


@dataclass(frozen=True, eq=False)
class FirstPass:
    """The part of a solution that does not depend on anchors: matches and labels of a window, and its frames' shape."""

    window: Window
    keyframes: Keyframes
    shape: Shape | None


@dataclass(frozen=True, eq=False)
class Proposal:
    """A solution that is not kept yet."""

    window: Window
    video: VideoCalibration
    calibrations: Mapping[int, Calibration]
    """Calibrations by number of the frame."""
    anchors: frozenset[int]
    """Numbers of the frames that a person has labelled."""
    moves: Mapping[int, float]
    """Largest move of the picture's points, pixels, by frame; NaN where there was no camera before, or is none now."""
    revisions: Mapping[int, int] = attribute(default_factory=dict)
    """Revisions of the anchors that were solved, by number of the frame."""

    def __repr__(self) -> str:
        largest = max((move for move in self.moves.values() if move == move), default=0.0)
        return f"Proposal(frames {self.window.begin} to {self.window.end - 1}, moved by up to {largest:.1f} px)"

    @property
    def contradicted(self) -> dict[int, str]:
        """What the labels of anchors that keep cameras of their own contradict in the clip, by number of the frame."""
        found = dict[int, str]()
        for n in sorted(self.anchors):
            here, in_clip = self.calibrations[n].camera, self.video[n - self.window.begin]
            if here is in_clip.camera or largest_move(here, in_clip.camera) < SAME:
                continue
            found[n] = "its cameras"
            if in_clip.has_finding(What.OTHER_SIZE):
                found[n] = "the size of its field"
            elif here is not None and in_clip.camera is not None:
                metres = np.linalg.norm(here.C - in_clip.camera.C)
                found[n] = f"the place of its camera, {metres:.1f} m from where they put it"
        return found

    def whole(
        self, before: VideoCalibration | None, count: int, *, mended_outside: bool = False
    ) -> VideoCalibration | None:
        """Complete the solution to a whole clip of `count` frames by the calibration before; None if it does not fit.

        It has a finding if anchors have cameras other than the clip's, or frames outside the window were mended since.
        """
        begin, end = self.window
        video: VideoCalibration | None = None
        if len(self.video) == count:
            video = self.video
        elif before is not None and len(before) == count and len(self.video) == end - begin:
            video = VideoCalibration.joined([before[:begin], self.video, before[end:]])
        if video is None:
            return None
        findings = (BESIDE,) if self.contradicted or mended_outside else ()
        return replace(video, notes=tuple(dict.fromkeys(video.notes)), findings=findings)

    def basis(self, number: int) -> str:
        """Basis of the camera of a frame: lines, matches, both or interpolation."""
        return str(self.video.basis[number - self.window.begin])


def with_cuts(video: VideoCalibration, cuts: Sequence[int]) -> VideoCalibration:
    """Divide a clip into shots at given cuts; if a shot would be of two tripods, only add a finding."""
    starts = sorted({0, *cuts})
    shots = []
    for start, stop in pairwise((*starts, len(video))):
        tripods = set(video.tripod[start:stop].tolist())
        if len(tripods) > 1:
            return replace(video, findings=(*(one for one in video.findings if one != CUTS), CUTS))
        shots.append(Shot(start, stop, tripods.pop()))
    return replace(video, shots=tuple(shots), findings=tuple(one for one in video.findings if one != CUTS))


def window_around(count: int, anchors: Sequence[int]) -> Window:
    """Choose the frames to solve again: all of a short clip, of a long one two minutes around the anchors.

    Examples
    --------
    >>> window_around(1000, [10]), window_around(90_000, [45_000])
    (Window(begin=0, end=1000), Window(begin=43500, end=46500))
    """
    if count <= 1.5 * PART or not anchors:
        return Window(0, count)
    middle = (min(anchors) + max(anchors)) // 2
    reach = max(PART // 2, (max(anchors) - min(anchors)) // 2 + PART // 10)
    return Window(max(middle - reach, 0), min(middle + reach, count))


def first_pass(
    frames: FrameSource,
    window: Window,
    field: Field,
    network: Network | None,
    options: Mapping[str, Any],
    progress: Progress,
) -> FirstPass:
    """Match the frames of a window, and label its keyframes by the network, or by search for the court without one."""
    mount: Mount = "moving" if options.get("camera") == "moving" else "tripod"
    estimate_size = options.get("field_size", "estimated") == "estimated"
    how = How(Task(field), network and Padded(network), camera=mount, estimate_size=estimate_size).on_paint()
    shape = ShapeEstimator(how).shape(_readable(frames, window))
    images = _in_frame(_counted(_readable(frames, window), window, progress, STAGES[0]), shape)
    tied = linked_frames(tied_frames(images, moving=not how.is_on_tripod), moving=not how.is_on_tripod)
    return FirstPass(window, read_keyframes(tied, how), shape)


def solve(
    frames: FrameSource,
    first: FirstPass,
    anchors: Mapping[int, Calibration],
    cuts: Sequence[int] | None,
    before: Callable[[int], Calibration | None],
    progress: Progress,
) -> Proposal:
    """Solve a window around its anchors, the frames that a person has mended.

    Parameters
    ----------
    frames : FrameSource
    first : FirstPass
    anchors : mapping of int to Calibration
        Calibrations of the anchors by their labels, by number of the frame.
    cuts : sequence of int, optional
        First frames of the shots.
    before : callable
        Returns the calibration that a frame has now, if it has one.
    progress : callable
    """
    window, shape = first.window, first.shape
    count = window.end - window.begin
    inside = {t: one for t, one in anchors.items() if window.begin <= t < window.end}
    known = {
        t - window.begin: KeyframeLabels(pixels, one.accepted)
        for t, one in inside.items()
        if (pixels := _pixels_in_frame(one, shape)) is not None
    }
    starts = None if cuts is None else [cut - window.begin for cut in cuts]
    progress(0, count, STAGES[1])

    def images() -> Iterable[Image]:
        return _in_frame(_counted(_readable(frames, window), window, progress, STAGES[2]), shape)

    found = solve_around(first.keyframes, Anchors(known, starts), images)
    found = replace(found, shape=shape)
    calibrations, moves = dict[int, Calibration](), dict[int, float]()
    for k, calibration in enumerate(found):
        progress(k, count, STAGES[3])
        number = window.begin + k
        calibrations[number] = _held(inside[number], calibration) if number in inside else calibration
        old = before(number)
        moves[number] = largest_move(None if old is None else old.camera, calibrations[number].camera)
    return Proposal(window, found, calibrations, frozenset(inside), moves)


def _held(by_hand: Calibration, in_clip: Calibration) -> Calibration:
    """Choose the camera of an anchor: by hand or of the clip.

    It is the clip's, in which the labels of the anchor count too, unless the labels alone determine the camera well and
    the clip's camera does not fit them.
    """
    if by_hand.camera is None or in_clip.camera is None or in_clip.field is None:
        return by_hand
    pixels = pixels_in_picture(by_hand)
    if pixels is None:
        return by_hand
    before, after = (
        float(rms_of_labels(evaluate_cameras([one.camera], one.field or {}, pixels))[0])
        for one in (by_hand, in_clip)
        if one.camera is not None
    )
    is_well_known = by_hand.verdict is Verdict.GOOD
    farther = after > before + FARTHER * pixel_unit(by_hand.camera.image_size)
    return by_hand if is_well_known and farther else in_clip


def largest_move(old: Camera | None, new: Camera | None) -> float:
    """Largest distance, in pixels, that ground points in view move in the picture from one camera to another.

    NaN without both cameras, or without ground in view.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, 1.35, 0.0, 1400.0, (0.0, 66.0, -16.0), (960, 540))
    >>> round(largest_move(camera, camera.cropped((3.0, 4.0), (960, 540))), 6)
    5.0
    """
    if old is None or new is None:
        return float("nan")
    x, y = (np.linspace(0.0, size - 1.0, count) for size, count in zip(old.image_size, GRID, strict=True))
    xy: Array = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    moved = np.linalg.norm(new.project(old.image_to_field(xy)) - xy, axis=1)
    moved = moved[np.isfinite(moved)]
    return float(np.max(moved)) if len(moved) else float("nan")


def _readable(frames: FrameSource, window: Window) -> Iterator[Image]:
    """Yield the images of a window up to the first one that cannot be read, as the file may be cut off."""
    with suppress(BrokenFileError):
        yield from frames.each(window.begin, window.end)


def _counted(images: Iterable[Image], window: Window, progress: Progress, stage: str) -> Iterator[Image]:
    for done, image in enumerate(images):
        progress(done, window.end - window.begin, stage)
        yield image


def _in_frame(images: Iterable[Image], shape: Shape | None) -> Iterable[Image]:
    return images if shape is None else map(shape.placement.image_in_frame, images)


def _pixels_in_frame(calibration: Calibration, shape: Shape | None) -> PixelTable | None:
    """Labelled pixels from which an anchor was calibrated, in pixels of the clip's frame; None if it was not."""
    pixels = pixels_in_picture(calibration)
    if pixels is None or shape is None:
        return pixels
    return replace(pixels, xy=shape.placement.to_frame(pixels.xy))


def next_frame(frames: FrameSource, rows: Sequence[Row], field: Field, network: Network | None) -> int | None:
    """Choose the frame to mend next; None if all are good.

    Among the stretches of frames whose cameras are not good, the one with the largest sum of concern is taken, and in
    it the frame that shows most markings: its labels determine its camera, and matches pass this on to its neighbours.
    Without a network it is the frame in the middle.
    """
    stretches = sorted(_stretches(rows), key=lambda stretch: -sum(rows[n].concern for n in stretch))
    if not stretches:
        return None
    mended = np.array([n for n, row in enumerate(rows) if row.by_hand])
    far: list[int] = [n for n in stretches[0] if not len(mended) or np.min(np.abs(mended - n)) > BESIDE_MENDED]
    candidates = far or [*stretches[0]]
    middle: int = candidates[len(candidates) // 2]
    if network is None:
        return middle
    looked_at = [candidates[k] for k in spread(len(candidates), LOOKED_AT)]
    counts = {n: _markings(frames, n, field, network) for n in looked_at}
    return max(counts, key=lambda n: (counts[n], -abs(n - middle)))


def _stretches(rows: Sequence[Row]) -> Iterator[list[int]]:
    """Yield runs of frames whose cameras are not good; mended frames within a run are left out but do not end it."""
    run: list[int] = []
    for n, row in enumerate(rows):
        if row.verdict == Verdict.GOOD or row.by_hand:
            if run and row.verdict == Verdict.GOOD:
                yield run
                run = []
        else:
            run.append(n)
    if run:
        yield run


def _markings(frames: FrameSource, number: int, field: Field, network: Network) -> int:
    """Number of markings that the network finds in a frame; 0 if it cannot be read."""
    try:
        return len(network_marks(field, frames.image(number), network).pixels)
    except BrokenFileError:
        return 0


def draw_again(
    folder: Path,
    frames: FrameSource,
    calibrations: Sequence[Calibration | None],
    clip: VideoCalibration | None,
    field: Field,
    names: Collection[str],
    progress: Progress,
) -> None:
    """Draw files of `AGAIN` as a run draws them; `progress` may raise an error to end the work.

    Drawing ends at the first frame that cannot be read, where the file is cut off.
    """
    rate = frames.rate or DEFAULT_RATE
    if {OVERLAY, WORST} & set(names):
        _draw_frames(folder, frames, calibrations, field, rate, progress)
    if MOTION in names and clip is not None:
        write_image(folder / MOTION, plot_sequence(clip, frames_per_second=rate))


def _draw_frames(
    folder: Path,
    frames: FrameSource,
    calibrations: Sequence[Calibration | None],
    field: Field,
    rate: float,
    progress: Progress,
) -> None:
    """Write the overlay video and the sheet of the worst frames."""
    worst = worst_frames(calibrations, SHEET_FRAMES)
    pictures: dict[int, Image] = {}
    with VIDEOS.write(folder / OVERLAY, rate) as video:
        for number, image in enumerate(_readable(frames, Window(0, len(frames)))):
            progress(number, len(frames), f"drawing {OVERLAY}")
            calibration = calibrations[number]
            if calibration is not None:
                image = draw_calibration(image, calibration, calibration.field or field)
            video.write(image)
            if number in worst:
                pictures[number] = image
    shown = [number for number in worst if number in pictures]
    if shown:
        captions = [caption(frames.ids[number], calibrations[number]) for number in shown]
        write_image(folder / WORST, contact_sheet([pictures[number] for number in shown], captions))
