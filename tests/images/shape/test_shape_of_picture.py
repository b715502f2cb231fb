"""Pictures of courts of another shape than 16:9 by search: their shape is asked for only where it matters."""

import numpy as np
import pytest
from pictures import picture

from data_tools.probability import largest_true_error
from fieldcalib.assess.findings import Verdict, What
from fieldcalib.fields.catalogue import field_named, tennis
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.images.shape.shape_of_picture import with_small_enlarged
from fieldcalib.io.image_files import parse_image, size_of
from fieldcalib.solve.from_homography import calibrate_from_homography

COURT = tennis()
ENDS = (240.6, 101.5), (241.0, 179.0)  # px, by eye, of the centre line in tex-bas-02.jpeg


@pytest.mark.parametrize(
    ("size", "y"), [((960, 640), 14.0), pytest.param((960, 720), 16.0, marks=pytest.mark.slow)], ids=["3:2", "4:3"]
)
def test_a_court_is_good_if_its_shape_moves_no_place(size, y):
    truth = Camera.from_angles(0.2, 1.25, 0.0, 1100.0, (0.0, y, -4.2), size)
    shown = picture(truth, COURT)
    (found,) = calibrate_from_images(COURT, [shown])
    assert found.verdict is Verdict.GOOD
    assert largest_true_error(found.camera, truth, COURT) < COURT.tolerance
    (open_one,) = calibrate_from_images(COURT, [shown], estimate_aspect=False)
    assert open_one.has_finding(What.SHAPE)


def test_small_pictures_are_seen_at_twice_their_size_with_cameras_in_their_own_pixels():
    truth, seen = Camera.from_angles(0.2, 1.25, 0.0, 1100.0, (0.0, 14.0, -4.2), (960, 540)), []

    def calibrate(images):
        seen.extend(map(size_of, images))
        return [calibrate_from_homography(truth.scaled(size).pinhole_homography, size) for size in seen]

    small, wide, upright = (np.zeros((*shape, 3), np.uint8) for shape in ((252, 448), (270, 480), (480, 270)))
    found = with_small_enlarged(calibrate, [small, wide, upright])
    assert seen == [(896, 504), (480, 270), (270, 480)]
    assert [one.camera.image_size for one in found] == [(448, 252), (480, 270), (270, 480)]
    assert found[0].camera.focal_length == pytest.approx(truth.scaled((448, 252)).focal_length)


@pytest.mark.slow
def test_a_court_in_a_small_picture_is_accepted(shared_data):
    shown = parse_image((shared_data / "wild" / "tex-bas-02.jpeg").read_bytes())
    (found,) = calibrate_from_images(field_named("basketball-ncaa"), [shown])
    assert found.accepted
    assert found.camera.image_size == size_of(shown)
    assert np.max(np.abs(found.camera.project([(0.0, -7.62, 0.0), (0.0, 7.62, 0.0)]) - ENDS)) < 3.0
