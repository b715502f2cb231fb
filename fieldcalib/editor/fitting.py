"""Calibration of a single frame in the editor: without a person, or from marks, refined on the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.findings import BESIDE, Finding, Status, SuspectLabel, Verdict, What, in_words
from fieldcalib.assess.label_errors import rms_of_labels
from fieldcalib.assess.result import Calibration, found_of, with_findings
from fieldcalib.editor.edit import Mark, Marks
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import common_lens
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.images.refinement import refine_on_image
from fieldcalib.io.image_files import Image, size_of, spread
from fieldcalib.localize import Network, localize
from fieldcalib.localize.point_selection import classes_without_segment
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.labelled_pixels import Pixels, PixelTable, Weights
from fieldcalib.problem.layout import Layout
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.picture_shape import Placement
from fieldcalib.solve.batch import calibrate_labels
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import pixel_unit

WEIGHT_OF_NETWORK = 0.3  # weight of a mark that a network set; one that a person set has 1
MOST_MARKS = 6  # largest number of marks taken over from a network for each label
LEAST_WEIGHT = 0.5  # of a segment that a network found: segments below are mostly false detections
NOTHING_YET = "nothing is labelled yet, and no network knows this field"
STRAY = 8.0  # px, in units of `click_unit`: if a mark is farther from its marking, it or the camera is wrong
# A refined camera is not taken if it increases the rms distance of marks by more than this many px of such an image,
FARTHER = 1.5
FARTHER_CLICKS = 3.0  # px, but at least this: a few clicks, each 2 px off, are fitted more closely than the truth fits


@lru_cache(maxsize=1)
def included_network() -> Network:
    """Load the network that comes with the package, which knows soccer."""
    from fieldcalib.localize.network import SegmentationNetwork

    return SegmentationNetwork.load(threads=2)


def network_of(field: Field) -> Network | None:
    """Choose the network that knows the markings of a field; None if there is none."""
    network = included_network()
    return None if classes_without_segment(network.classes, field) else network


def automatic(field: Field, image: Image, network: Network | None) -> tuple[Calibration, Marks]:
    """Calibrate a frame at once without a person; also returns labels of the network, a few for each segment.

    Without a network there is no camera yet, as the search (`searched`) takes longer.
    """
    if network is None:
        to_search = [Finding(What.TO_SEARCH)] if field.stands and field.markings else []
        said = in_words(*to_search) or NOTHING_YET
        return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, said, *to_search), Marks()
    (calibration,) = calibrate_from_images(field, [image], network)
    return calibration, network_marks(field, image, network)


def is_to_search(calibration: Calibration) -> bool:
    """Whether a calibration by `automatic` is only a placeholder until `searched` is called."""
    return calibration.camera is None and calibration.has_finding(What.TO_SEARCH)


def searched(field: Field, image: Image) -> Calibration:
    """Calibrate a frame by search for the court, without a network."""
    (calibration,) = calibrate_from_images(field, [image])
    return calibration


def network_marks(field: Field, image: Image, network: Network) -> Marks:
    """Label an image by a network: a few marks for each segment, in their order along it."""
    (found,) = localize(field, [image], network)
    return _few(field, {label: found.pixels[label] for label, one in found.weight.items() if one >= LEAST_WEIGHT})


def marks_of(calibration: Calibration | None) -> Marks:
    """Marks at a few of the pixels that a camera was fitted to, such as those of a court that was searched for."""
    pixels = pixels_in_picture(calibration) if calibration else None
    if calibration is None or calibration.field is None or pixels is None:
        return Marks()
    return _few(calibration.field, pixels.by_label(0))


def pixels_in_picture(calibration: Calibration) -> PixelTable | None:
    """Labelled pixels from which a frame was calibrated by itself, in its picture; None if it was not."""
    if calibration.solved is None or calibration.camera is None:
        return None
    pixels = calibration.solved.pixels
    placement = Placement.of_cameras(calibration.camera, calibration.solved.camera)
    return replace(pixels, xy=placement.to_picture(pixels.xy))


def _few(field: Field, pixels: Pixels) -> Marks:
    """A few marks for each segment, in their order along it, of pixels that no person labelled."""
    few = {}
    for label, xy in pixels.items():
        few[label] = xy[field[label].order(xy)][spread(len(xy), MOST_MARKS)]
    return Marks.of(few, by_hand=False)


def fitted(task: Task, image: Image, marks: Marks) -> Calibration:
    """Calibrate a frame from marks, refined on the image if the result agrees with the marks of the person.

    Parameters
    ----------
    task : Task
        What is known of the camera; its field.
    image : (height, width, 3) uint8 array
        Blue, green, red.
    marks : Marks
        Marks of a network count less than marks of a person.
    """
    size, field = size_of(image), task.field
    assert field is not None
    try:
        # agrees with calibrate_from_segments to 1e-6, and saves the time of its second solver
        weights = _weights(marks, size)
        (by_marks,) = calibrate_labels(task, [marks.pixels], size, None if weights is None else [weights])
    except ValueError as error:  # marks that cannot be used yet, e.g. only in a corner: more marks may help
        return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, str(error).removeprefix("frame 0: "))
    if not by_marks.accepted:
        return by_marks
    suspects = {one.label for one in by_marks.suspect_labels}
    agreeing = Marks(tuple(one for one in marks.all if one.label not in suspects))
    weights, flags, prior = _weights(agreeing, size), task.chosen_flags, task.prior
    pixels = agreeing.pixels
    refined = refine_on_image(field, image, by_marks, pixels, weights=weights, flags=flags, prior=prior, quick=True)
    if refined is by_marks or _is_nearer(by_marks, refined, agreeing.only_by_hand):
        return with_strays(marks, by_marks)
    said = (one for one in found_of(by_marks) if one.what is What.SUSPECTS)
    named = (_renamed(one, marks, refined) for one in by_marks.suspect_labels)
    return with_strays(marks, with_findings(replace(refined, suspect_labels=tuple(named)), *said))


def _renamed(suspect: SuspectLabel, marks: Marks, refined: Calibration) -> SuspectLabel:
    """A suspect with the label that fits where the refined camera tells it, and the camera of the marks did not."""
    field, camera = refined.field, refined.required_camera
    others = [label for label in field or () if label not in marks.pixels]
    if suspect.fits or field is None or not others:
        return suspect
    own = [one for one in marks.all if one.label == suspect.label]
    errors = mark_errors(field, Marks(tuple(one._replace(label=label) for label in others for one in own)), [camera])
    off = errors.reshape(len(others), -1).max(axis=1)
    is_on = np.min(off) < BESIDE * click_unit(camera.image_size)
    return replace(suspect, fits=others[int(np.argmin(off))]) if is_on else suspect


def _is_nearer(by_marks: Calibration, refined: Calibration, by_hand: Marks) -> bool:
    """Whether the camera of the marks alone is nearer than the refined one to the marks of the person that agree."""
    if not len(by_hand) or refined.field is None:
        return False
    errors, after = mark_errors(refined.field, by_hand, [by_marks.required_camera, refined.required_camera])
    return _rms(after) > _rms(errors) + max(FARTHER * pixel_unit(refined.required_camera.image_size), FARTHER_CLICKS)


def confirmed(base: Calibration, image: Image, marks: Marks) -> Calibration | None:
    """Refine a good camera with the marks that a person added to those of a network, if they lie on its markings.

    None if the camera is not good, before or after, or a mark lies elsewhere: then the marks have to find the camera.
    """
    field, camera, by_hand = base.field, base.camera, marks.only_by_hand
    if base.verdict is not Verdict.GOOD or field is None or camera is None or not 0 < len(by_hand) < len(marks):
        return None
    if np.max(mark_errors(field, by_hand, [camera])) > BESIDE * click_unit(camera.image_size):
        return None
    weights = _weights(by_hand, camera.image_size)
    found = refine_on_image(field, image, base, by_hand.pixels, weights=weights, quick=True)
    return found if found.verdict is Verdict.GOOD else None


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def click_unit(image_size: tuple[int, int]) -> float:
    """Pixels of an image per pixel of a 960 x 540 image, at least 1, as clicks in smaller images are no more exact."""
    return max(pixel_unit(image_size), 1.0)


def is_stray(error: float, image_size: tuple[int, int]) -> bool:
    """Whether a mark at distance `error`, pixels, from its projected marking contradicts the camera."""
    return error > STRAY * click_unit(image_size)


def is_left_out(error: float, image_size: tuple[int, int]) -> bool:
    """Whether a network's mark at distance `error`, pixels, from its projected marking does not affect the camera."""
    return error > BESIDE * pixel_unit(image_size)


def with_strays(marks: Marks, calibration: Calibration) -> Calibration:
    """Add findings for marks of a person that lie far from their markings."""
    camera, field = calibration.camera, calibration.field
    if camera is None or field is None:
        return calibration
    by_hand, worst = marks.of_field(field).only_by_hand, dict[str, float]()
    (errors,) = mark_errors(field, by_hand, [camera])
    for mark, error in zip(by_hand.all, errors.tolist(), strict=True):
        if is_stray(error, camera.image_size):
            worst[mark.label] = max(error, worst.get(mark.label, 0.0))
    return with_findings(calibration, *(Finding(What.STRAY, label, (error,)) for label, error in worst.items()))


def not_followed(field: Field, marks: Marks, calibration: Calibration) -> set[Mark]:
    """Marks of a network whose whole label an accepted camera does not follow; with them it may become another one."""
    if not calibration:
        return set()
    found, camera = marks.of_field(field), calibration.required_camera
    (errors,) = mark_errors(field, found, [camera])
    near = {one.label for one, px in zip(found.all, errors, strict=True) if not is_left_out(px, camera.image_size)}
    return {one for one in found.all if not one.by_hand and one.label not in near}


def mark_errors(field: Field, marks: Marks, cameras: Sequence[Camera]) -> Array:
    """Distances (C, N) of N marks from the projections of their segments by C cameras of one image size, pixels."""
    if not len(marks):
        return np.zeros((len(cameras), 0))
    size, count = cameras[0].image_size, len(cameras) * len(marks)
    labels = tuple(field)
    label = np.tile([labels.index(one.label) for one in marks.all], len(cameras))
    xy = np.tile([(one.x, one.y) for one in marks.all], (len(cameras), 1))
    table = PixelTable(labels, count, np.arange(count), label, xy, np.ones(count))  # one in a frame
    layout = Layout.of(size, common_lens([one.lens for one in cameras]))
    problem = Problem(Observations.of(field, table, size), layout, RobustLoss("linear", 1.0))
    theta = np.repeat([layout.theta(one) for one in cameras], len(marks), axis=0)
    return np.asarray(rms_of_labels(evaluate(problem, theta)).reshape(len(cameras), -1))


def _weights(marks: Marks, image_size: tuple[int, int]) -> Weights | None:
    """Weights of the marks by label; None if a person set all, with the accuracy of annotators.

    Clicks in a small image are less accurate than annotations of it, and weigh less by the square of the ratio.
    """
    own = (pixel_unit(image_size) / click_unit(image_size)) ** 2
    if own == 1.0 and all(one.by_hand for one in marks.all):
        return None
    weights: dict[str, list[float]] = {}
    for one in marks.all:
        weights.setdefault(one.label, []).append(own * (1.0 if one.by_hand else WEIGHT_OF_NETWORK))
    return weights
