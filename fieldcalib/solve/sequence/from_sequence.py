"""`calibrate_sequence`: calibration of frames of one camera, whose shared parameters are estimated from all of them.

Over a shot the law by which principal point and lens follow the zoom, the size of the field and, on a tripod, the
centre are constant. The steps are in `fieldcalib.solve.sequence.sequence_solver`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.labelled_pixels import ImageSegments, Weights
from fieldcalib.problem.losses import LossName, RobustLoss
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.batch import checked_batch
from fieldcalib.solve.request import Task
from fieldcalib.solve.sequence.background_matches import Matched
from fieldcalib.solve.sequence.sequence_problem import SHARED, SequenceProblem
from fieldcalib.solve.sequence.sequence_solver import solve_sequence
from fieldcalib.solve.solver_options import CalibrationFlags, Prior, default_flags, paint_sigma


def calibrate_sequence(
    object_segments: ObjectSegments,
    frames: Iterable[ImageSegments],
    image_size: tuple[int, int],
    *,
    flags: int | None = None,
    prior: Prior = "all",
    loss: LossName | RobustLoss = "cauchy",
    trust_labels: bool = False,
    weights: Iterable[Weights] | None = None,
    shared: Sequence[str] = SHARED,
    paint: float | None = None,
    matches: Matched | None = None,
    start: SequenceCalibration | None = None,
) -> SequenceCalibration:
    """Calibrate frames of one camera, which share its zoom law and, on a tripod, its centre.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object, e.g. `soccer()`.
    frames : iterable of mappings of str to (N, 2) array_like
        Pixels of each frame, in any order unless the camera moves; frames without labels get a camera if `matches` tie
        them to others.
    image_size : (int, int)
        Width and height of every frame, pixels.
    flags, prior, loss, trust_labels, weights
        As in `calibrate_batch`. By default k2 is estimated too: frames together determine it.
    shared : sequence of str
        Names of the shared parameters: ``"centre"``, ``"principal point"``, ``"lens"``, ``"zoom law"`` and ``"field
        size"`` (unless it is known, or the frames hardly determine it). Other parameters belong to each frame, under
        their prior. Without a zoom law no parameter follows the zoom; a size that is not shared is the given one, with
        its prior uncertainty. Without the centre the camera moves on a smooth path: the frames must be in order, evenly
        spaced in time, at about 25 per second.
    paint : float, optional
        Standard deviation, in metres, of the position of a painted line as a whole, the same in all frames. By default
        a quarter of the width of the field's lines, 3 cm on a soccer pitch.
    matches : mapping of (int, int) to pair of (N, 2) array_like, optional
        Pixels of static points of the background in two frames, e.g. `first` and `second` of
        `fieldcalib.images.match_background`; None for a pair without matches. They tie frames without labels to frames
        that have some. Frames that come first in a pair are solved together; the others are solved from them.
    start : SequenceCalibration, optional
        Calibration of the same frames from fewer pixels, as initial cameras. The labels must be trusted.

    Returns
    -------
    SequenceCalibration
        A calibration for each frame, and the shared parameters. If no position of the tripod is found, the frames are
        calibrated one by one and share nothing.

    Raises
    ------
    ValueError
        As in `calibrate_batch`, for unknown names in `shared`, and for matches between frames that do not exist.

    References
    ----------
    Theiner, Ewerth: TVCalib, WACV 2023, whose tensors have a dimension T for frames of one camera.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> field, pans = soccer(size_known=True), (-0.3, -0.1, 0.1, 0.3)
    >>> cameras = [Camera.from_angles(pan, 1.35, 0.0, 1400.0, (0.0, 66.0, -16.0), (960, 540)) for pan in pans]
    >>> labels = ("Side line top", "Middle line", "Circle central", "Big rect. left main", "Big rect. right main")
    >>> frames = []
    >>> for camera in cameras:
    ...     seen = {label: camera.project(field[label].sample(2.0)) for label in labels}
    ...     inside = {label: xy[((xy > 0.0) & (xy < (959, 539))).all(axis=1)] for label, xy in seen.items()}
    ...     frames.append({label: xy for label, xy in inside.items() if len(xy) > 1})
    >>> found = calibrate_sequence(field, frames, (960, 540))
    >>> [str(frame.status) for frame in found]
    ['accepted', 'accepted', 'accepted', 'accepted']
    >>> found.values[1:3].round()  # y and z of the tripod
    array([ 66., -16.])
    """
    paint = paint_sigma(object_segments) if paint is None else paint
    task = Task(object_segments, flags=flags, prior=prior, loss=loss, paint=paint, trust_labels=trust_labels)
    if flags is None:
        task = replace(task, flags=default_flags(prior) & ~CalibrationFlags.CALIB_FIX_K2)
    options = task.options(image_size)
    checked = checked_batch(object_segments, frames, weights, options.image_size)
    problem = SequenceProblem.of(options, PixelTable.of(object_segments, *checked), shared, matches)
    if start is not None and not trust_labels:
        raise ValueError("start needs trust_labels=True: from there labels are not doubted again")
    if start is not None and len(start) != len(problem):
        raise ValueError(f"start must be a calibration of the same {len(problem)} frames, got {len(start)}")
    return solve_sequence(problem, start).calibration
