"""Narrow pictures in which a network finds the field once they are padded."""

from dataclasses import replace

import numpy as np
import pytest
from networks import CLASSES, FIELD, GRID, KnownCameras, seen_by
from pictures import picture
from synthetic import observe

from fieldcalib import Camera, calibrate_from_images, calibrate_from_segments
from fieldcalib.assess.advice import Advice
from fieldcalib.assess.findings import NARROW, Status, Verdict, What
from fieldcalib.assess.result import with_findings
from fieldcalib.images import from_images
from fieldcalib.images.from_images import How, calibrate_alone, calibrate_pictures, with_narrow_padded
from fieldcalib.images.shape import shape_of_picture
from fieldcalib.images.shape.shape_of_picture import SURE_OF_PART, of_part_of_frames, within_frame
from fieldcalib.metrics.cameras import camera_difference
from fieldcalib.problem.picture_shape import Crop, Declared
from fieldcalib.solve.request import GivenCamera, Task
from fieldcalib.solve.solver_options import KNOWN_INTRINSICS_FLAGS

ANGLES, f, C = (0.45, 1.33, 0.0), 1400.0, (5.0, 66.0, -17.0)
UPRIGHT, PADDED = (Camera.from_angles(*ANGLES, f, C, size) for size in ((420, 560), (747, 560)))


class SeesWide:
    """A network that knows pictures of the padded shape, and finds nothing in others."""

    classes = CLASSES

    def __call__(self, images):
        blind = KnownCameras([None]).maps[0]
        wide = seen_by(PADDED, GRID)
        return np.stack([wide if image.shape[1::-1] == PADDED.image_size else blind for image in images])


def how(network, part):
    """How pictures are calibrated that are declared to be a part of their frames."""
    return How(
        Task(FIELD),
        network,
        take_off_borders=False,
        estimate_aspect=False,
        estimate_size=False,
        may_be_enlarged=False,
        declared=Declared.FRAME,
        part=part,
    )


def test_a_narrow_picture_is_looked_at_padded():
    (found,) = calibrate_from_images(FIELD, [picture(UPRIGHT)], SeesWide(), estimate_size=False)
    assert found.verdict is Verdict.CHECK
    assert found.has_finding(What.SHAPE)
    assert "no camera" not in found.message
    assert camera_difference(found.camera, UPRIGHT, FIELD).reprojection < 3.0


@pytest.mark.parametrize("corner", [(288, 80), (400, 120)])
def test_of_a_part_of_a_frame_the_network_sees_the_part_alone(corner):
    """The principal point is the frame's middle, and the camera is in pixels of the frame."""
    part = Crop((996, 720), corner)
    truth = Camera.from_angles(*ANGLES, f, C, part.frame_size)
    seen = truth.cropped(corner, UPRIGHT.image_size)
    frame = np.zeros((720, 996, 3), np.uint8)
    (left, top), (width, height) = corner, UPRIGHT.image_size
    frame[top : top + height, left : left + width] = picture(seen)
    (found,) = calibrate_pictures(how(KnownCameras(2 * [seen]), part), [frame])
    assert found.accepted
    assert not {What.SHAPE, What.PART} & {one.what for one in found.findings}
    assert "borders" not in found.message
    assert found.camera.image_size == part.frame_size
    np.testing.assert_allclose(found.camera.principal_point, (498.0, 360.0), atol=8.0)
    assert camera_difference(found.camera.cropped(corner, UPRIGHT.image_size), seen, FIELD).reprojection < 3.0


def test_a_camera_of_a_whole_picture_is_solved_again_as_that_of_a_part():
    part = Crop((996, 720), (400, 120))
    seen = Camera.from_angles(*ANGLES, f, C, part.frame_size).cropped(part.corner, UPRIGHT.image_size)
    image = picture(seen)
    (whole,) = calibrate_from_images(FIELD, [image], KnownCameras(4 * [seen]), estimate_size=False)
    found = shape_of_picture._as_part(of_part_of_frames(Task(FIELD), part), image, whole)
    off, before = (np.linalg.norm(one.camera.principal_point - seen.principal_point) for one in (found, whole))
    assert off < 8.0 < before
    assert camera_difference(found.camera, seen, FIELD).reprojection < 1.0


@pytest.mark.parametrize("corner", [(0, 80), (576, 0)])
def test_a_part_that_the_lines_contradict_is_told(corner):
    frame = Camera.from_angles(*ANGLES, f, C, (996, 720))
    seen = frame.cropped((288, 80), UPRIGHT.image_size)
    placed = np.zeros((720, 996, 3), np.uint8)
    (left, top), (width, height) = corner, UPRIGHT.image_size
    placed[top : top + height, left : left + width] = picture(seen)
    (found,) = calibrate_pictures(how(KnownCameras(2 * [seen]), Crop((996, 720), corner)), [placed])
    assert found.verdict is Verdict.CHECK
    assert [one.about for one in found.findings if one.what is What.CONTRADICTED] == ["part"]
    assert "another part of a frame than the given one" in found.reason
    assert Advice.PART in found.advice


def test_a_narrow_part_that_is_looked_at_padded_is_to_be_checked_unless_it_is_sure(monkeypatch):
    declared, image = how(SeesWide(), Crop(UPRIGHT.image_size, (0, 0))), picture(UPRIGHT)
    (sure,) = calibrate_pictures(declared, [image])
    assert sure.verdict is Verdict.GOOD
    assert sure.probability() >= SURE_OF_PART
    monkeypatch.setattr(from_images, "SURE_OF_PART", 1.0)
    (found,) = with_narrow_padded(lambda images: [REJECT], [image], how=declared.on_part(), upright=None)
    assert found.verdict is Verdict.CHECK
    assert found.has_finding(What.NARROW)
    assert "lie on their paint" in found.reason
    assert not replace(found, declared=Declared.FRAME).has_finding(What.SHAPE)


@pytest.mark.parametrize(
    ("part", "sure", "expected"),
    [
        (Crop(UPRIGHT.image_size, (0, 0)), 0.9, Verdict.GOOD),
        (Crop(UPRIGHT.image_size, (0, 0)), 1.0, Verdict.CHECK),
        (None, 0.9, Verdict.REJECT),
    ],
)
def test_an_upright_part_without_a_camera_is_seen_at_the_input_for_uprights(part, sure, expected, monkeypatch):
    monkeypatch.setattr(from_images, "SURE_UPRIGHT", sure)
    declared = how(KnownCameras([None]), part).on_part() if part else How(Task(FIELD), KnownCameras([None]))
    sees = KnownCameras([UPRIGHT])
    (found,) = with_narrow_padded(lambda images: [REJECT], [picture(UPRIGHT)], how=declared, upright=sees)
    found = replace(found, declared=Declared.FRAME)
    assert found.verdict is expected
    assert found.has_finding(What.NARROW) == (expected is Verdict.CHECK)


@pytest.mark.parametrize(
    ("size", "labels", "is_doubted"), [((420, 560), 5, True), ((420, 560), 6, False), ((560, 560), 5, False)]
)
def test_a_good_camera_of_an_upright_picture_needs_six_labels(size, labels, is_doubted, monkeypatch):
    good = replace(GOOD, pixel_counts=dict.fromkeys(list(FIELD)[:labels], 3))
    monkeypatch.setattr(from_images, "_calibrated_size", lambda how, images, found: [good])
    (found,) = calibrate_alone(How(Task(FIELD), KnownCameras([None])), [np.zeros((*size[::-1], 3), np.uint8)])
    assert found.verdict is (Verdict.CHECK if is_doubted else Verdict.GOOD)
    assert found.has_finding(What.NARROW) == is_doubted


GOOD = calibrate_from_segments(FIELD, observe(FIELD.markings, PADDED, np.random.default_rng(0)), PADDED.image_size)
CHECK, REJECT = with_findings(GOOD, NARROW), replace(GOOD, status=Status.IMPROBABLE)


@pytest.mark.parametrize(
    ("of_part", "of_whole", "is_taken"),
    [
        (REJECT, CHECK, False),
        (REJECT, GOOD, True),
        (REJECT, REJECT, False),
        (CHECK, GOOD, True),
        (CHECK, CHECK, False),
        (CHECK, REJECT, False),
    ],
)
def test_where_a_part_gives_no_good_camera_a_better_one_of_a_whole_picture_is_taken(
    of_part, of_whole, is_taken, monkeypatch
):
    monkeypatch.setattr(shape_of_picture, "_as_part", lambda task, image, whole: whole)
    whole, part = np.full((560, 747, 3), 9, np.uint8), Crop(PADDED.image_size, (0, 0))
    others = [GOOD, replace(of_whole, message="of a whole picture")]
    shown = []

    def as_whole(images):
        shown.extend(images)
        return others[1:]

    told = {"part": part, "tasks": 2 * (Task(FIELD),), "as_whole": as_whole}
    first, found = within_frame(lambda images: [GOOD, of_part], [whole, whole], **told)
    assert first == replace(GOOD, declared=Declared.FRAME)
    assert len(shown) == 1
    assert (found.message == "of a whole picture") == is_taken


def test_a_part_is_no_prior_with_a_camera_matrix_or_without_a_network():
    """Then pictures stay in their frames, whose matrix it is, and in which courts are searched for."""
    part = Crop((996, 720), (288, 80))
    known = how(SeesWide(), part)
    assert known.on_part().part == part
    K = Camera.from_angles(*ANGLES, f, C, part.frame_size).K
    given = replace(known, task=Task(FIELD, GivenCamera(K), KNOWN_INTRINSICS_FLAGS))
    for other in (given, replace(known, network=None), replace(known, task=Task(FIELD, prior=None))):
        assert (other.on_part().part, other.on_part().task) == (None, other.task)


def test_a_black_picture_has_no_part():
    part = Crop((200, 120), (20, 10))
    (found,) = calibrate_pictures(how(KnownCameras(2 * [None]), part), [np.zeros((120, 200, 3), np.uint8)])
    assert found.status is Status.TOO_FEW_SEGMENTS


def test_a_picture_of_square_pixels_is_looked_at_as_it_is():
    (found,) = calibrate_from_images(FIELD, [picture(UPRIGHT)], SeesWide(), estimate_aspect=False)
    assert "the network's labels gave no camera" in found.message
