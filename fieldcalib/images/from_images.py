"""Calibration of images: a network labels pixels, a camera is calibrated from them and refined on the image.

For an image whose labelled segments are inconsistent, cameras are calibrated from subsets of the segments (hypothesise
and verify, as in RANSAC). A hypothesis is scored on the image, by its line support, instead of by its number of
inliers: a network that mistakes a mowing pattern for a penalty area does so for several of its lines, which are then
consistent with one another but have no line support. Without a network, or where its camera is rejected, the field is
searched for (`images.search`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, islice, product
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, one_of, truth
from fieldcalib.assess.findings import ENLARGED, NARROW, SHAPE, WAS_SQUASHED, Finding, Status, What, in_words
from fieldcalib.assess.result import LEAST_PROBABILITY, Calibration, doubted, found_of, with_findings
from fieldcalib.fields.field import Field, ObjectSegments, Side
from fieldcalib.fields.sports.soccer import with_painted_lines
from fieldcalib.images.background.keyframe_tracking import EVERY
from fieldcalib.images.camera_side import CameraSide
from fieldcalib.images.paint.detected_lines import SEARCH_RANGES
from fieldcalib.images.paint.line_profiles import Markings
from fieldcalib.images.refinement import (
    Refined,
    ToRefine,
    line_support,
    near_labels,
    on_field_as_seen,
    refine_all,
    refined_under,
    unrefined,
)
from fieldcalib.images.search.court_search import search_courts
from fieldcalib.images.search.place_search import Place, search_from
from fieldcalib.images.search.stored_cameras import StoredCameras
from fieldcalib.images.shape.shape_of_picture import (
    SURE_OF_PART,
    Method,
    Step,
    of_part_of_frames,
    said_plainly,
    with_aspect_estimated,
    with_enlarged_parts,
    with_shape_compared,
    with_small_enlarged,
    within_frame,
    without_borders,
)
from fieldcalib.io.image_files import IMAGES_AT_ONCE, Image, each_checked, in_parts, size_of
from fieldcalib.localize import Localization, Network, localize
from fieldcalib.localize.network import Padded, SegmentationNetwork, as_frames, check_network, is_upright
from fieldcalib.localize.point_selection import classes_without_segment
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.problem.picture_shape import Crop, Declared
from fieldcalib.processes.jobs import in_order
from fieldcalib.solve.auto_lens import STRONG
from fieldcalib.solve.batch import calibrate_pixels, compute_errors
from fieldcalib.solve.field_size import doubted_for_size
from fieldcalib.solve.from_segments import checked_labels
from fieldcalib.solve.request import GivenCamera, Task
from fieldcalib.solve.sequence.sequence_problem import SHARED, SHARED_IN_MOTION, SIZE
from fieldcalib.solve.solver_options import ALL, DEFAULT_FLAGS, FISHEYE_FLAGS, WHOLE_LENS, CalibrationFlags, Prior

HEAVIEST = 5  # number of segments, those with the largest weights, from which hypotheses are made
PER_HYPOTHESIS = 3  # segments of a hypothesis, the fewest that determine a camera: 10 hypotheses
VERIFIED = 2  # hypotheses that are calibrated again from all segments near them
NO_MARKING = "no marking was found in the image"
SHOW_MORE = "show more of the field, in a sharper or larger picture, or say what is known of the camera"

LEAST_WEIGHT = 0.7  # of a segment (1 if it is labelled by hand): segments below are mostly false detections
LEAST_CHECKED = 5  # segments of a sure camera of a narrow part
LEAST_UPRIGHT = 6  # segments of a good camera of an upright picture
SURE_UPRIGHT = 0.9  # least probability of a good camera of a declared upright part, seen at the input for uprights
LEAST_SEGMENTS = 3  # fewest that determine a camera; where fewer have the least weight, all segments are used
# Line support of a camera in its image, and the share of the labels' weight that the camera explains. On broadcast
# frames 1 in 80 refined cameras is wrong above SURE_SUPPORT, and 1 in 5 below.
SURE_SUPPORT, LEAST_EXPLAINED_SURE = 0.45, 0.5
LEAST_SUPPORT, LEAST_EXPLAINED = 0.2, 0.75
LEAST_SUPPORT_CHOSEN = 0.35  # of a camera chosen for its line support: the largest of several values is biased upwards
# times the field's tolerance: the error for which `LEAST_PROBABILITY` is required
LARGEST_ERROR, LARGEST_ERROR_REFINED = 3.0, 2.0

NOTE = "the network's labels gave no camera"

Mount = Literal["tripod", "moving"]
SHARED_BY: dict[Mount, tuple[str, ...]] = {"tripod": SHARED, "moving": SHARED_IN_MOTION}


@dataclass(frozen=True, eq=False)
class How:
    """How pictures and clips are calibrated: the task of each, and what is looked for in it.

    The attributes are the parameters of these names of `calibrate_from_images` and `calibrate_video`.
    """

    task: Task
    """What is known of the camera, and how it is solved."""
    network: Network | None = None
    side: Side | None = None
    refine: bool = True
    take_off_borders: bool = True
    estimate_aspect: bool = True
    estimate_size: bool = True
    may_be_enlarged: bool = True
    place: Place | None = None
    stored: StoredCameras | None = None
    """Cameras by which single pictures are recognised."""
    camera: Mount = "tripod"
    every: int = EVERY
    not_shared: str = ""
    """Name of a parameter that each frame of a clip has for itself, although its camera would share it."""
    declared: Declared = Declared.NOTHING
    """What the user says of the shape of the pictures."""
    part: Crop | None = None
    """The part of their frames, black elsewhere, that pictures show, if the user says it."""

    def __post_init__(self) -> None:
        """Raise a ValueError for a value that is invalid by itself."""
        for name in ("refine", "estimate_size", "estimate_aspect", "take_off_borders", "may_be_enlarged"):
            truth(getattr(self, name), name)
        one_of(self.camera, SHARED_BY, "camera")
        if self.network is not None:
            check_network(self.network)
        if self.stored is not None and not self.task.given.is_empty:
            raise ValueError("a camera is given, or it is the same as in earlier results: leave one of them out")

    @property
    def shared(self) -> tuple[str, ...]:
        """Names of the parameters that frames of a clip share, as in `calibrate_sequence`."""
        own = {self.not_shared} if self.estimate_size else {self.not_shared, SIZE}
        return tuple(name for name in SHARED_BY[self.camera] if name not in own)

    @property
    def is_part(self) -> bool:
        """Whether the user says which part of a frame pictures are: they are looked at as frames, also upright ones."""
        return self.declared is Declared.FRAME

    @property
    def is_on_tripod(self) -> bool:
        """Whether the frames of a clip share the place of the camera."""
        return "centre" in self.shared

    def with_network(self) -> How:
        """Take the given network, or load that of the package, unless the object is a field that it does not know."""
        if self.network is not None:
            return self
        network, segments = SegmentationNetwork.load(), self.task.object_segments
        is_unknown = isinstance(segments, Field) and classes_without_segment(network.classes, segments)
        return self if is_unknown else replace(self, network=network)

    def on_paint(self) -> How:
        """Take the middles of painted lines for the markings of a soccer field, if its size is estimated.

        As thin lines at the distances of the law they would make it half a percent too large.
        """
        field = self.task.field
        if field is None or not self.estimate_size:
            return self
        return replace(self, task=replace(self.task, object_segments=with_painted_lines(field)))

    def of_part(self, part: Crop | None) -> How:
        """Take which part of their frames pictures show, as the user says: nothing is asked of their shape any more."""
        if part is None:
            return self
        shown = replace(self, take_off_borders=False, estimate_aspect=False, may_be_enlarged=False)
        return replace(shown, part=part, declared=Declared.FRAME)

    def on_part(self) -> How:
        """Take the prior of the frames for a declared part that a network looks at.

        The part is dropped where that prior would not count, and pictures are calibrated in their black frames: without
        a network, or with a camera matrix, which is that of the frames.
        """
        is_prior = self.network is not None and self.task.prior is not None and self.task.given.camera_matrix is None
        if self.part is None or not is_prior:
            return replace(self, part=None)
        return replace(self, task=of_part_of_frames(self.task, self.part))

    def on_side(self) -> tuple[CameraSide, How]:
        """Find the side of the camera, and restrict the task to it; the network then names the ends as seen from it."""
        on = CameraSide.of(self.task, self.side)
        network = None if self.network is None else on.network(self.network, self.task.field)
        return on, replace(self, task=on.task(self.task), network=network)


def calibrate_from_consensus(
    task: Task, images: Sequence[Image], found: Sequence[PixelTable]
) -> list[list[Calibration]]:
    """Calibrate images of one size from subsets of their labelled pixels that are consistent with the lines in them.

    A camera is calibrated from every three of the five heaviest segments of an image. For each of the two cameras with
    the highest line support, a camera is calibrated from all segments within 12 px of it (in an image of 960x540).

    Parameters
    ----------
    task : Task
        Calibration object, flags, prior and what is known of the camera.
    images : sequence of (height, width, 3) uint8 arrays
        Blue, green, red.
    found : sequence of PixelTable
        Labelled pixels of each image.

    Returns
    -------
    list of list of Calibration
        For each image one per hypothesis, that of the best supported one first; none if it has too few segments for
        subsets.

    References
    ----------
    Fischler, Bolles: Random Sample Consensus, Communications of the ACM 24 (1981).
    """
    markings, chosen = Markings.of(task.object_segments), list[list[PixelTable]]()
    for image, part, subsets in zip(
        images, found, _each_calibrated(task, images, [_subsets(one) for one in found]), strict=True
    ):
        cameras = [one.camera for one in subsets if one.camera is not None]
        share = [line_support(image, camera, markings, max(SEARCH_RANGES)) for camera in cameras]
        best = [cameras[index] for index in np.argsort(share)[::-1][:VERIFIED]]
        near = near_labels(task.object_segments, best, len(best) * [part], max(SEARCH_RANGES))
        chosen.append([part.take(np.array(one)[part.label]) for one in dict.fromkeys(map(tuple, near.tolist()))])
    return _each_calibrated(task, images, chosen)


def _subsets(found: PixelTable) -> list[PixelTable]:
    """The labelled pixels of every three of the heaviest segments of an image; none if there are no more."""
    weight = label_weights(found)
    heaviest = np.argsort(-weight, kind="stable")[: min(HEAVIEST, np.count_nonzero(weight))].tolist()
    if len(heaviest) <= PER_HYPOTHESIS:
        return []
    return [found.take(np.isin(found.label, labels)) for labels in combinations(heaviest, PER_HYPOTHESIS)]


def _each_calibrated(
    task: Task, images: Sequence[Image], tables: Sequence[Sequence[PixelTable]]
) -> list[list[Calibration]]:
    """Calibrate each image from several tables of labelled pixels, all of them together."""
    every = [table for some in tables for table in some]
    found = iter(calibrate_localized(task, every, size_of(images[0])) if every else [])
    return [list(islice(found, len(some))) for some in tables]


def label_weights(found: PixelTable) -> Array:
    """Weights (L,) of the labels found in an image: the sum of a label's pixel weights times its number of pixels."""
    count = len(found.labels)
    return np.asarray(np.bincount(found.label, found.weight, count) * np.bincount(found.label, minlength=count), float)


def calibrate_localized(task: Task, found: Sequence[PixelTable], size: tuple[int, int]) -> list[Calibration]:
    """Calibrate localized images of one size, without the search for mislabelled segments."""
    # a network's pixels are too coarse to determine the principal point
    task = replace(task, trust_labels=True).with_flags(CalibrationFlags.CALIB_FIX_PRINCIPAL_POINT)
    pixels = PixelTable.joined(task.object_segments, found)
    return [_with_advice(one) for one in calibrate_pixels(task, pixels, size)]


def _with_advice(calibration: Calibration) -> Calibration:
    """Replace the message of a calibration with too few labelled segments by one that says what would help."""
    if calibration.status is not Status.TOO_FEW_SEGMENTS:
        return calibration
    if not calibration.pixel_counts:
        return replace(calibration, message=f"{NO_MARKING}: if it shows a field, {SHOW_MORE}")
    labels, equations, unknowns = next(one for one in found_of(calibration) if one.what is What.TOO_FEW_LABELS).numbers
    few = f"{labels:.0f} segment{'s' * (labels != 1)}: {equations:.0f} equations for {unknowns:.0f} unknowns"
    return replace(calibration, message=f"{few}; {SHOW_MORE}")


def calibrate_from_images(
    object_segments: ObjectSegments,
    images: Iterable[Image],
    network: Network | None = None,
    camera_matrix: ArrayLike | None = None,
    dist_coeffs: ArrayLike | None = None,
    rvec: ArrayLike | None = None,
    tvec: ArrayLike | None = None,
    *,
    flags: int = DEFAULT_FLAGS,
    prior: Prior = ALL,
    refine: bool = True,
    take_off_borders: bool = True,
    estimate_aspect: bool = True,
    estimate_size: bool = True,
    may_be_enlarged: bool = True,
    place: Place | None = None,
    side: Side | None = None,
    executor: Executor | None = None,
) -> list[Calibration]:
    """Calibrate a camera for each of several images.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object that the network was trained for, e.g. `soccer()`; without a network any `Field`.
    images : iterable of (height, width, 3) uint8 arrays
        Blue, green, red; of any sizes. They are taken in parts of `IMAGES_AT_ONCE`.
    network : Network, optional
        Finds the markings, e.g. `SegmentationNetwork.load()`. Without a network the field is searched for in each image
        (`fieldcalib.images.find_courts`); then nothing of the camera may be given, cameras are always refined, the
        aspect is not estimated, and small images are enlarged. With a network the field is searched for in images whose
        camera is rejected, if nothing of the camera is given and cameras are refined.
    camera_matrix, dist_coeffs, rvec, tvec, flags, prior
        As in `calibrate_from_segments`, the same for all images; with `camera_matrix` all images must be of one size.
        Values that flags fix are kept by the refinement too, to the last bit.
    refine : bool
        Whether cameras are refined on the lines in the images (`refine_on_image`): more accurate, and takes 1.4 times
        as long.
    take_off_borders : bool
        Whether black borders, and the surroundings of frames shown in windows
        (`fieldcalib.images.shape.borders_and_windows`), are left out; not with a `camera_matrix`. Cameras are in pixels
        of the whole pictures, with the principal point near the middle of the part that shows the frame.
    estimate_aspect : bool
        Whether pictures of another shape than 16:9 may have been squashed from 16:9, as in `calibrate_from_segments`;
        not without a prior. Otherwise their pixels are square, or as the `camera_matrix` says.
    estimate_size : bool
        Whether an image that shows a field of another size than the given one, or one that is not level, is calibrated
        on that field (`Calibration.field`). A size that is declared known (`size_known`), and a ground that is given,
        are kept. Only if cameras are refined, and nothing of the camera is given.
    may_be_enlarged : bool
        Whether pictures of the shape of a frame may be enlarged parts of larger ones (digital zoom), whose principal
        point is not in the middle (`fieldcalib.images.shape.shape_of_picture`). Only with a network and a prior, where
        cameras are refined and nothing of the camera is given.
    place : Place, optional
        Position of the camera, if one camera took all images (`fieldcalib.images.search.place_search.pooled_place`):
        the search considers cameras at this place only. Not with a network.
    side : {"main", "opposite"}, optional
        The side of the field that the camera is on, where this looks the same from both (`fieldcalib.fields.field`):
        "main" in front of the near touchline or behind the left end, "opposite" beyond the far touchline or behind the
        right end. By default the side that a given position, rotation or `prior` implies; if none does, "main", and the
        camera on the other side is in `Calibration.alternatives`.
    executor : concurrent.futures.Executor, optional
        Works on the images, e.g. `Processes`, or the executor of a cluster (dask's ``Client.get_executor()``); other
        processes must be able to import the classes of the arguments. The results are the same.

    Returns
    -------
    list of Calibration
        One per image. An image that cannot be calibrated is no error: see `status` and `message`. A camera is "probably
        wrong" if the image has no lines at its projected markings. Before an image is rejected, cameras from subsets of
        its segments are tried (`calibrate_from_consensus`), and what the network finds in it padded to 4:3, if it is
        narrower and its shape is not known: such a camera is "check".

    Raises
    ------
    ValueError
        As `localize` and `calibrate_from_segments`, and if images of several sizes come with one `camera_matrix`.

    Examples
    --------
    >>> import numpy as np
    >>> from fieldcalib import soccer
    >>> class Blind:
    ...     classes = ("background", "Middle line")
    ...     def __call__(self, images):
    ...         return np.zeros((len(images), 2, 90, 160), np.float32)
    >>> (calibration,) = calibrate_from_images(soccer(), [np.zeros((540, 960, 3), np.uint8)], Blind())
    >>> str(calibration.status), calibration.message.split(":")[0]
    ('too few segments', 'the picture shows nothing')
    """
    task = Task(object_segments, GivenCamera(camera_matrix, dist_coeffs, rvec, tvec), flags, prior=prior)
    how = How(
        task,
        network,
        side,
        refine=refine,
        take_off_borders=take_off_borders,
        estimate_aspect=estimate_aspect,
        estimate_size=estimate_size,
        may_be_enlarged=may_be_enlarged,
        place=place,
    )
    checked = each_checked(images)
    return calibrate_pictures(how, checked if camera_matrix is None else _of_one_size(checked), executor)


def calibrate_pictures(how: How, images: Iterable[Image], executor: Executor | None = None) -> list[Calibration]:
    """Calibrate a camera for each of several checked images (`calibrate_from_images`)."""
    by_shape, wide = how.network, as_frames(how.network)
    on, how = (replace(how, network=wide) if how.is_part else how).on_side()
    upright = None if by_shape is None or by_shape is wide else on.network(by_shape, how.task.field)
    whole, how = replace(how, part=None), how.on_part()
    task, by_network, without_matrix = how.task, how.network is not None, how.task.given.camera_matrix is None
    if by_network and how.place is not None:
        raise ValueError("a place is of courts that are searched for: leave it or the network out")
    is_open = by_network and task.prior is not None  # the network finds the camera, its principal point under a prior
    may_be_enlarged = how.may_be_enlarged and is_open and how.refine and task.given.is_empty
    of_lens_k1 = task.given.is_empty and task.chosen_flags & WHOLE_LENS == DEFAULT_FLAGS & WHOLE_LENS
    may_be_padded = is_open and without_matrix and (how.estimate_aspect or how.part is not None)
    # Each step wraps the calibration of pictures by the steps after it, down to `calibrate_alone`. The outermost step
    # comes first.
    steps: tuple[tuple[bool, Step], ...] = (
        (True, partial(said_plainly, object_segments=task.object_segments, by_network=by_network)),
        (how.take_off_borders and without_matrix, without_borders),
        (not by_network and how.place is None, with_small_enlarged),
        (
            how.part is not None,
            partial(
                within_frame, part=how.part, tasks=(how.task, whole.task), as_whole=partial(calibrate_pictures, whole)
            ),
        ),
        (how.refine and task.prior is not None and of_lens_k1, partial(with_fisheye, task=task)),
        (may_be_enlarged, partial(with_enlarged_parts, task=task)),
        (is_open and how.refine and may_be_searched(task), partial(with_second_opinion, how=how)),
        (may_be_padded, partial(with_narrow_padded, how=how, upright=upright)),
        (how.estimate_aspect and is_open and without_matrix, partial(with_aspect_estimated, task=task)),
        (how.estimate_aspect and not by_network and task.prior is not None, partial(with_shape_compared, task=task)),
    )
    of_part: Method = partial(calibrate_alone, how)
    for applies, step in reversed(steps):
        if applies:
            of_part = partial(step, of_part)
    parts = in_parts(images, IMAGES_AT_ONCE, lambda image: image.shape[0] * image.shape[1])
    found = [on.with_alternatives(one, task.field) for part in in_order(executor, of_part, parts) for one in part]
    return found if how.declared is Declared.NOTHING else [replace(one, declared=how.declared) for one in found]


def _searched(how: How, images: Sequence[Image]) -> list[Calibration]:
    """Calibrate images by searching for the field, with cameras anywhere or at a known place."""
    task, place, field = how.task, how.place, how.task.field
    # without a place this finds the cameras, with one it only raises what is wrong
    found = search_courts(task, images if place is None else [], estimate_size=how.estimate_size)
    assert field is not None
    return found if place is None else [search_from(task, field, image, place) for image in images]


def _of_one_size(images: Iterable[Image]) -> Iterator[Image]:
    """Pass images on; a ValueError if they are of several sizes, for which one camera matrix cannot hold."""
    first: tuple[int, int] | None = None
    for image in images:
        size = size_of(image)
        first = first or size
        if size != first:
            raise ValueError(
                f"camera_matrix holds for images of one size, got {first[0]} x {first[1]} and {size[0]} x {size[1]}: "
                "calibrate each size by itself, with the matrix of that size (Camera.scaled)"
            )
        yield image


def calibrate_alone(how: How, images: Sequence[Image]) -> list[Calibration]:
    """Calibrate single images as they are, without looking for borders or a changed aspect ratio."""
    if how.network is None:
        return _searched(how, images)
    segments = how.task.object_segments
    sizes = [size_of(image) for image in images]
    localized = zip(localize(segments, images, how.network), sizes, strict=True)
    found = [_labels(segments, labels, size) for labels, size in localized]
    calibrations: dict[int, Calibration] = {}
    for size in dict.fromkeys(sizes):
        members = [index for index, other in enumerate(sizes) if other == size]
        parts = _calibrated_size(how, [images[index] for index in members], [found[index] for index in members])
        calibrations |= dict(zip(members, parts, strict=True))
    found_alone = [calibrations[index] for index in range(len(images))]
    return found_alone if how.is_part else list(map(_doubted_if_upright, found_alone, sizes))


def _doubted_if_upright(calibration: Calibration, size: tuple[int, int]) -> Calibration:
    """Doubt the camera of an upright picture that was found from few labels, which hardly check one another.

    Of good cameras of upright parts three of 17 with less than six labels are off by 0.8 % of the frame's width or
    more, none of 22 with six or more.
    """
    is_doubted = calibration.accepted and size[0] < size[1] and len(calibration.pixel_counts) < LEAST_UPRIGHT
    return with_findings(calibration, NARROW) if is_doubted else calibration


def _calibrated_size(how: How, images: Sequence[Image], found: Sequence[PixelTable]) -> list[Calibration]:
    """Calibrate images of one size; where a camera is not sure, also from subsets of the segments, the best is kept."""
    markings = Markings.of(how.task.object_segments)
    from_labels = calibrate_localized(how.task, found, size_of(images[0]))
    first = _verified(how, markings, images, found, from_labels, LEAST_SUPPORT)
    calibrations = [calibration for calibration, _ in first]
    unsure = [t for t, (_, is_sure) in enumerate(first) if not is_sure]
    if unsure:
        others = calibrate_from_consensus(how.task, [images[t] for t in unsure], [found[t] for t in unsure])
        owner = [t for t, some in zip(unsure, others, strict=True) for _ in some]
        least_support = LEAST_SUPPORT_CHOSEN if how.refine else LEAST_SUPPORT
        every = [one for some in others for one in some]
        of_owner = [images[t] for t in owner], [found[t] for t in owner]
        second = iter(_verified(how, markings, *of_owner, every, least_support))
        for t, some in zip(unsure, others, strict=True):
            hypotheses = [calibrations[t], *(one for one, _ in islice(second, len(some)))]
            calibrations[t] = _best_supported(markings, images[t], hypotheses)
    if how.task.field is not None and how.task.field.size_known:
        return [doubted_for_size(one) for one in calibrations]
    if how.estimate_size and how.refine and how.task.given.is_empty:
        return [_with_field_from_labels(how, *one) for one in zip(images, found, calibrations, strict=True)]
    return calibrations


def _with_field_from_labels(how: How, image: Image, found: PixelTable, calibration: Calibration) -> Calibration:
    """Calibrate an image on the field that it shows, in size and ground, or return the calibration on the given one."""
    sized = on_field_as_seen(how.task, image, calibration, found)
    if sized is None or sized.calibration.field is None:
        return calibration
    how = replace(how, task=replace(how.task, object_segments=sized.calibration.field))
    ((judged, _),) = _judged(how, [found], [sized], LEAST_SUPPORT)
    return judged if judged.accepted else calibration


def _labels(object_segments: ObjectSegments, found: Localization, image_size: tuple[int, int]) -> PixelTable:
    """Labels of an image without segments of low weight, which are mostly false; refinement finds the true ones again.

    All segments are kept if fewer than `LEAST_SEGMENTS` would remain.
    """
    strong = [label for label, weight in found.weight.items() if weight >= LEAST_WEIGHT]
    if len(strong) >= LEAST_SEGMENTS:
        found = found.only(strong)
    pixels, weights = checked_labels(object_segments, found.pixels, found.weights, image_size)
    return PixelTable.of(object_segments, [pixels], [weights])


def _verified(
    how: How,
    markings: Markings,
    images: Sequence[Image],
    found: Sequence[PixelTable],
    calibrations: Sequence[Calibration],
    least_support: float,
) -> list[tuple[Calibration, bool]]:
    """Refine and judge the calibrations of images of one size; also return whether each is sure."""
    given = [
        ToRefine(image, calibration, part, are_detected=True)
        for image, calibration, part in zip(images, calibrations, found, strict=True)
    ]
    refined = refine_all(how.task, markings, given) if how.refine else [unrefined(markings, one) for one in given]
    return _judged(how, found, refined, least_support)


def _judged(
    how: How, found: Sequence[PixelTable], refined: Sequence[Refined], least_support: float
) -> list[tuple[Calibration, bool]]:
    """Judge the cameras of several images of one size by `_one_judged`."""
    judged = [one.judged for one in refined]
    compute_errors([seen for seen, one in zip(judged, refined, strict=True) if one.calibration.accepted])
    explained = _explained(how.task.object_segments, judged, found)
    return [_one_judged(*one, how.refine, least_support) for one in zip(judged, refined, explained, strict=True)]


def _one_judged(
    calibration: Calibration, refined: Refined, explained: float, refine: bool, least_support: float
) -> tuple[Calibration, bool]:
    """Mark a calibration "probably wrong" if its support or its probability is low; also return whether it is sure."""
    share = refined.support
    if calibration.camera is None or not refined.calibration.accepted:
        return calibration, False
    on_paint = not any(one.is_displaced for one in calibration.markings)
    is_sure = refine and share >= SURE_SUPPORT and explained >= LEAST_EXPLAINED_SURE and on_paint
    doubt, notes = "", list[Finding]()
    if share < least_support:
        notes = [Finding(What.FEW_LINES)]
        doubt = f"only {100.0 * share:.0f} % line support: {in_words(*notes)}"
    elif explained < LEAST_EXPLAINED and not is_sure:
        doubt = f"only {100.0 * explained:.0f} % of the detected segments, by weight, are near their projections"
    if doubt:
        message = f"{doubt}; {refined.calibration.message}"
        return with_findings(replace(calibration, status=Status.IMPROBABLE, message=message), *notes), False
    if not calibration.accepted:
        return calibration, False
    if calibration.has_probability:
        # a field of another size is no reason to give up a camera that fits its image
        assert calibration.field is not None
        metres = (LARGEST_ERROR_REFINED if refine else LARGEST_ERROR) * calibration.field.tolerance
        calibration = doubted(calibration, LEAST_PROBABILITY, metres, size_known=True)
    return calibration, calibration.accepted and (is_sure or not refine)


def _explained(
    object_segments: ObjectSegments, calibrations: Sequence[Calibration], found: Sequence[PixelTable]
) -> list[float]:
    """Share of the labels' weight, for each image, on labels near their projected segments; 0 without a camera."""
    cameras = {t: one.camera for t, one in enumerate(calibrations) if one.camera is not None}
    shares = len(found) * [0.0]
    near = near_labels(object_segments, list(cameras.values()), [found[t] for t in cameras], max(SEARCH_RANGES))
    for t, is_near in zip(cameras, near, strict=True):
        weight = label_weights(found[t])
        shares[t] = float(np.sum(weight[is_near]) / max(np.sum(weight), 1e-9))
    return shares


def _best_supported(markings: Markings, image: Image, calibrations: Sequence[Calibration]) -> Calibration:
    """The accepted calibration with the highest line support; the first one if none is accepted."""

    def support(one: Calibration) -> float:
        return line_support(image, one.required_camera, markings, max(SEARCH_RANGES)) if one.accepted else 0.0

    return max(calibrations, key=support)


def with_second_opinion(calibrate: Method, images: Sequence[Image], *, how: How) -> list[Calibration]:
    """Calibrate pictures by a network; where its camera is rejected, take an accepted camera of the search, if any."""
    found = calibrate(images)
    refused = [index for index, one in enumerate(found) if not one.accepted]
    searched = search_courts(how.task, [images[index] for index in refused], estimate_size=how.estimate_size)
    for index, one in zip(refused, searched, strict=True):
        if one.accepted:
            found[index] = replace(one, message=f"{NOTE}; {one.message}")
    return found


def with_fisheye(calibrate: Method, images: Sequence[Image], *, task: Task) -> list[Calibration]:
    """Calibrate pictures; of a strong barrel lens also with that of a fisheye, which is kept where more lines fit it.

    k1, by which cameras are found, follows such a lens to some pixels only.
    """
    found, task = calibrate(images), replace(task, flags=FISHEYE_FLAGS)
    for index, one in enumerate(found):
        if one.solved is not None and one.required_camera.corner_distortion[0] < STRONG:
            refined = refined_under(task, images[index], one)
            if refined is not None and refined.accepted:
                kept = [finding for finding in found_of(one) if finding in (SHAPE, ENLARGED, NARROW, WAS_SQUASHED)]
                found[index] = with_findings(replace(refined, declared=one.declared), *kept)
    return found


def with_narrow_padded(
    calibrate: Method, images: Sequence[Image], *, how: How, upright: Network | None
) -> list[Calibration]:
    """Calibrate pictures; narrow ones whose camera is rejected once more, as the network sees them padded.

    Cameras found so are "check": of 16 in upright parts of frames 3 are wrong, one of which would be good. Of probable
    ones in declared parts 20 of 20 with five labels are right, 2 of 3 with four, which hardly check one another.
    Declared parts that are upright are then seen by the network `upright`, at its own input for them: of 22 cameras
    found so 15 are good and right, one is wrong, with a probability of 0.11.
    """
    found, wide = calibrate(images), as_frames(how.network)
    assert wide is not None
    looks = [(Padded(wide), SURE_OF_PART), *([(upright, SURE_UPRIGHT)] if upright is not None and how.is_part else [])]
    for (network, sure), (index, image) in product(looks, enumerate(images)):
        is_seen = is_upright(image) if network is upright else Padded.missing(size_of(image)) > 0
        if is_seen and not found[index].accepted:
            (again,) = calibrate_alone(replace(how, network=network), [image])
            if again.accepted:
                is_checked = len(again.pixel_counts) >= LEAST_CHECKED and again.has_probability
                is_sure = is_checked and again.probability() >= sure
                doubts = (SHAPE,) if how.part is None else () if is_sure else (NARROW,)
                found[index] = with_findings(again, *doubts)
    return found


def may_be_searched(task: Task) -> bool:
    """Whether a field can be searched for: it has stands, and nothing of the camera is given."""
    field = task.field
    return field is not None and bool(field.stands or field.named_stands) and task.given.is_empty
