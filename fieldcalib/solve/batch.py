"""Calibration of many independent frames at once, in chunks of similar frames, here or by an executor.

The errors of many calibrations at once, which is faster than one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, IntArray, expect, listed, several, truth
from fieldcalib.assess.camera_errors import KnownErrors, NoErrors, Solved
from fieldcalib.assess.findings import Status
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.geometry.camera import Camera, checked_image_size
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.labelled_pixels import ImageSegments, Pixels, PixelTable, PixelWeights, Weights
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.losses import LossName, RobustLoss
from fieldcalib.processes.jobs import in_order
from fieldcalib.solve.auto_lens import with_fisheye_lens
from fieldcalib.solve.from_segments import NOTHING_LABELLED, calibrate_checked, checked_labels
from fieldcalib.solve.likelier_shape import with_border_complaint, with_likely_aspect
from fieldcalib.solve.request import GivenCamera, Options, Task, as_fixed
from fieldcalib.solve.solver_options import DEFAULT_CRITERIA, GUESS, CalibrationFlags, Criteria, Prior

CHUNK = 128  # frames solved together: their arrays still fit the processor's cache
CHUNK_PIXELS = 16384  # of a chunk, padding included: bounds the memory of densely labelled frames
FARTHEST_START = 1e12  # m: the squares of much larger numbers are not finite, and end a whole batch


def compute_errors(calibrations: Sequence[Calibration]) -> list[Calibration]:
    """Compute the errors behind `Calibration.uncertainty`, `probability` and `verdict` for many calibrations.

    A calibration computes them when they are first needed; for frames that were solved together, this takes a fifth of
    the time. Results are the same; they are cached in the errors of each calibration.

    Returns
    -------
    list of Calibration
        The given calibrations.

    Examples
    --------
    >>> import numpy as np
    >>> from fieldcalib import Camera, calibrate_batch, soccer
    >>> cameras = [Camera.from_angles(pan, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540)) for pan in (0.2, 0.3)]
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
    >>> frames = [{label: one.project(soccer()[label].sample(9.0)) for label in labels} for one in cameras]
    >>> [str(one.verdict) for one in compute_errors(calibrate_batch(soccer(), frames, (960, 540)))]
    ['good', 'good']
    """
    solved: dict[tuple[int, int], list[Solved]] = {}
    known: dict[tuple[int, int], list[KnownErrors]] = {}
    for one in listed(calibrations, "calibrations"):
        expect(one, Calibration, "fieldcalib.calibrate_from_segments(...)")
    fields = {id(one.field): one.field for one in calibrations}
    for errors, field in [(one.errors, id(one.field)) for one in calibrations]:
        if isinstance(errors, Solved) and not errors.are_computed:
            solved.setdefault((id(errors.evaluation), field), []).append(errors)
        elif isinstance(errors, KnownErrors) and not errors.are_computed:
            known.setdefault((id(errors.layout), id(errors.field)), []).append(errors)
    for (_, field), members in solved.items():
        Solved.compute(members, fields[field])
    for frames in known.values():
        for start in range(0, len(frames), CHUNK):
            KnownErrors.compute(frames[start : start + CHUNK])
    return list(calibrations)


def calibrate_batch(
    object_segments: ObjectSegments,
    frames: Iterable[ImageSegments],
    image_size: tuple[int, int],
    camera_matrix: ArrayLike | None = None,
    dist_coeffs: ArrayLike | None = None,
    rvec: ArrayLike | None = None,
    tvec: ArrayLike | None = None,
    *,
    flags: int | None = None,
    criteria: Criteria = DEFAULT_CRITERIA,
    prior: Prior = "all",
    loss: LossName | RobustLoss = "cauchy",
    tau: float | None = None,
    trust_labels: bool = False,
    weights: Iterable[Weights] | None = None,
    paint: float = 0.0,
    estimate_aspect: bool = False,
    cameras: Iterable[Camera] | None = None,
    executor: Executor | None = None,
) -> list[Calibration]:
    """Calibrate many independent frames at once, with the results of `calibrate_from_segments` to 1e-6, but faster.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object.
    frames : iterable of mappings of str to (N, 2) array_like
        Pixels of each frame.
    image_size : (int, int)
        Width and height of every frame, pixels.
    camera_matrix, dist_coeffs, rvec, tvec, flags, criteria, prior, loss, tau, trust_labels, paint, estimate_aspect
        As in `calibrate_from_segments`; the same for all frames.
    weights : iterable of mappings, optional
        As in `calibrate_from_segments`, for each frame.
    cameras : iterable of Camera, optional
        Initial cameras, one for each frame, used as with `CALIB_USE_INTRINSIC_GUESS` and `CALIB_USE_EXTRINSIC_GUESS`:
        no others are searched, which is faster if they are near. They also give the aspect ratio, and the values of
        parameters that the flags fix.
    executor : concurrent.futures.Executor, optional
        Executor for chunks of 128 frames, e.g. `Processes`, or that of a cluster (dask's ``Client.get_executor()``);
        the results are the same.

    Returns
    -------
    list of Calibration
        In the order of `frames`.

    Raises
    ------
    ValueError
        As in `calibrate_from_segments`; the message begins with the index of the frame.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> [str(calibration.status) for calibration in calibrate_batch(soccer(), [{}, {}], (960, 540))]
    ['too few segments', 'too few segments']
    """
    initial = None if cameras is None else _checked_cameras(cameras)
    given = GivenCamera(camera_matrix, dist_coeffs, rvec, tvec)
    if initial:
        _check_nothing_given(given)
    task = Task(object_segments, given, flags, criteria, prior, loss, tau, paint, trust_labels)
    each_weights = None if weights is None else several(weights, "the weights of each frame")

    def calibrated(some: Sequence[ImageSegments], size: tuple[int, int]) -> list[Calibration]:
        return calibrate_labels(task, some, size, each_weights, cameras=initial, executor=executor)

    is_estimated = truth(estimate_aspect, "estimate_aspect") and camera_matrix is None
    return with_likely_aspect(object_segments, calibrated, _several(frames), image_size, estimated=is_estimated)


def calibrate_labels(
    task: Task,
    frames: Sequence[ImageSegments],
    image_size: tuple[int, int],
    weights: Sequence[Weights] | None = None,
    *,
    cameras: Sequence[Camera] | None = None,
    executor: Executor | None = None,
) -> list[Calibration]:
    """Check the labels of frames of one size and calibrate them, from initial cameras if these are given."""
    checked, pixel_weights = checked_batch(task.object_segments, frames, weights, checked_image_size(image_size))
    table = PixelTable.of(task.object_segments, checked, pixel_weights)
    found = calibrate_pixels(task, table, image_size, cameras, executor=executor)
    return [with_border_complaint(task.object_segments, *pair) for pair in zip(checked, found, strict=True)]


def calibrate_pixels(
    task: Task,
    pixels: PixelTable,
    image_size: tuple[int, int],
    cameras: Sequence[Camera] | None = None,
    *,
    executor: Executor | None = None,
) -> list[Calibration]:
    """Calibrate checked frames of one size, from initial cameras if these are given."""
    if cameras and task.chosen_flags & CalibrationFlags.CALIB_FISHEYE:
        cameras = list(map(with_fisheye_lens, cameras))
    is_fisheye = np.array([camera.fisheye for camera in cameras or ()])
    if cameras and len(cameras) == pixels.count and len(set(is_fisheye)) > 1:  # the parameters of such a lens differ
        parts = [np.flatnonzero(is_fisheye == one).tolist() for one in (False, True)]
        some = [(pixels.of_frames(part), image_size, [cameras[t] for t in part]) for part in parts]
        found = [one for each in some for one in calibrate_pixels(task, *each, executor=executor)]
        return [found[k] for k in np.argsort(np.concatenate(parts))]
    # the layout needs the largest lens of all cameras
    largest = max(cameras, key=lambda camera: len(camera.lens.names)) if cameras else None
    options = (task.with_flags(GUESS) if cameras else task).options(image_size, largest)
    start = None if cameras is None else _thetas(cameras, pixels.count, options)
    found = calibrate_frames(pixels, options, given=start, executor=executor)
    return as_fixed(found, cameras or task.given, options.flags)


def _check_nothing_given(given: GivenCamera) -> None:
    if given.camera_matrix is not None or given.dist_coeffs is not None:
        raise ValueError("cameras give the intrinsics of each frame: leave camera_matrix and dist_coeffs out")
    if given.rvec is not None or given.tvec is not None:
        raise ValueError("cameras give the pose of each frame: leave rvec and tvec out")


def _thetas(cameras: Sequence[Camera], count: int, options: Options) -> Array:
    """Initial cameras as parameters; a ValueError if they do not fit the frames."""
    if len(cameras) != count:
        raise ValueError(f"expected cameras for each of {count} frames, got {len(cameras)}")
    for index, camera in enumerate(cameras):
        if camera.image_size != options.image_size:
            width, height = camera.image_size
            raise ValueError(f"frame {index}: its camera is for images of {width} x {height}; see Camera.scaled")
    return np.array([options.layout.theta(camera) for camera in cameras])


def checked_batch(
    object_segments: ObjectSegments,
    frames: Iterable[ImageSegments],
    weights: Iterable[Weights] | None,
    image_size: tuple[int, int],
) -> tuple[list[Pixels], list[PixelWeights | None]]:
    """The checked pixels and weights of frames; a ValueError begins with the index of the frame."""
    frames, weights = _several(frames), None if weights is None else several(weights, "the weights of each frame")
    if weights is not None and len(weights) != len(frames):
        raise ValueError(f"expected weights for each of {len(frames)} frames, got {len(weights)}")
    checked: list[Pixels] = []
    pixel_weights: list[PixelWeights | None] = []
    for index, frame in enumerate(frames):
        try:
            of_frame = None if weights is None else weights[index]
            pixels, weight = checked_labels(object_segments, frame, of_frame, image_size)
        except ValueError as error:
            raise ValueError(f"frame {index}: {error}") from None
        checked.append(pixels)
        pixel_weights.append(weight)
    return checked, pixel_weights


def _several(frames: Iterable[ImageSegments]) -> list[ImageSegments]:
    if isinstance(frames, Mapping):
        raise ValueError("expected a sequence of frames, got one mapping: calibrate_from_segments takes a single frame")
    return several(frames, "mappings of labels to (N, 2) pixels")


def calibrate_frames(
    pixels: PixelTable, options: Options, *, given: Array | None = None, executor: Executor | None = None
) -> list[Calibration]:
    """Calibrate checked frames, from cameras `given` (T, n) if these are not None."""
    calibrations = [Calibration.without_camera(Status.TOO_FEW_SEGMENTS, NOTHING_LABELLED) for _ in range(pixels.count)]
    chunks = list(_chunks(options.object_segments, pixels))
    parts = (_Part(pixels.of_frames(chunk), None if given is None else given[chunk]) for chunk in chunks)
    of_part = partial(_calibrated_part, options)
    found: Iterable[list[Calibration]] = map(of_part, parts)
    if executor is not None:
        packed = in_order(executor, partial(_calibrate_and_pack, of_part), parts)
        found = (one.unpacked(options.field) for one in packed)
    for chunk, some in zip(chunks, found, strict=True):
        for t, calibration in zip(chunk, some, strict=True):
            calibrations[t] = calibration
    return calibrations


class _Part(NamedTuple):
    """Frames that are solved together."""

    pixels: PixelTable
    given: Array | None


def _calibrated_part(options: Options, part: _Part) -> list[Calibration]:
    return calibrate_checked(part.pixels, options, levenberg_marquardt, part.given)


def _calibrate_and_pack(of_part: Callable[[_Part], list[Calibration]], part: _Part) -> PackedCalibrations:
    return PackedCalibrations.of(of_part(part))


def _checked_cameras(cameras: Iterable[Camera]) -> list[Camera]:
    found = several(cameras, "cameras, one for each frame")
    for index, camera in enumerate(found):
        if not isinstance(camera, Camera):
            raise ValueError(
                f"frame {index}: expected a Camera, got {type(camera).__name__}; calibrate frames without one apart"
            )
        if np.max(np.abs(camera.C)) > FARTHEST_START:
            raise ValueError(
                f"frame {index}: expected a camera within {FARTHEST_START:g} m, got one at {camera.C.tolist()}; "
                f"calibrate frames without an initial camera apart"
            )
    return [
        one if one.checked else Camera(one.K, one.R, one.C, one.image_size, one.dist, fisheye=one.fisheye)
        for one in found
    ]


def _chunks(object_segments: ObjectSegments, pixels: PixelTable) -> Iterator[IntArray]:
    """Indices of the frames that have pixels, grouped by pixel count for less padding."""
    is_straight = np.array([object_segments[label].is_straight for label in pixels.labels], dtype=bool)[pixels.label]
    lines, others = (np.bincount(pixels.frame[its], minlength=pixels.count) for its in (is_straight, ~is_straight))
    order = np.lexsort((lines, others // 4))
    order = order[lines[order] + others[order] > 0]
    total = (lines + others)[order]
    begin = 0
    while begin < len(order):
        ahead = total[begin : begin + CHUNK]
        padded = np.maximum.accumulate(ahead) * np.arange(1, len(ahead) + 1)
        size = max(1, int(np.searchsorted(padded, CHUNK_PIXELS, side="right")))
        yield order[begin : begin + size]
        begin += size


@dataclass(frozen=True, eq=False)
class PackedCalibrations:
    """Calibrations without solver state; the shared state is stored once."""

    calibrations: Sequence[Calibration]
    """The calibrations without solver state and field."""
    states: Mapping[int, tuple[Evaluation, Array]]
    """Solver states, each with the unit of its parameters."""
    places: Sequence[tuple[int, int] | None]
    """Index of each calibration's state and of its frame therein; None without solver state."""

    @classmethod
    def of(cls, calibrations: Sequence[Calibration]) -> PackedCalibrations:
        """Pack calibrations of one field, as `calibrate_batch` returns them."""
        solved = [one.solved for one in calibrations]
        return cls(
            [replace(one, errors=NoErrors(), field=None) for one in calibrations],
            {id(one.evaluation): (one.evaluation, one.unit) for one in solved if one is not None},
            [None if one is None else (id(one.evaluation), one.frame) for one in solved],
        )

    def unpacked(self, field: Field | None) -> list[Calibration]:
        """The calibrations with solver state and field."""
        return [
            replace(
                one,
                errors=NoErrors() if place is None else Solved(*self.states[place[0]], place[1]),
                field=None if one.camera is None else field,
            )
            for one, place in zip(self.calibrations, self.places, strict=True)
        ]
