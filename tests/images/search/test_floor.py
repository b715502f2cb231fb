"""The floor of a court in a picture, and the stripes on it."""

import cv2
import numpy as np
import pytest
from pictures import picture

from data_tools.score_courts import Truth
from fieldcalib import Camera
from fieldcalib.fields import basketball, handball
from fieldcalib.images.search.court_hypotheses import Cameras, stands
from fieldcalib.images.search.court_ranking import PictureToSearch
from fieldcalib.images.search.court_search import find_courts
from fieldcalib.images.search.floor import floor_of
from fieldcalib.images.search.long_lines import Bend
from fieldcalib.images.search.stripes import AllStripes

SIZE = (1280, 720)
STAND = Camera.from_angles(np.radians(92), np.radians(76), 0.0, 900.0, (-36.0, 1.0, -9.0), SIZE)
CORNERS = np.array([(-21.0, -11.0, 0.0), (21.0, -11.0, 0.0), (21.0, 11.0, 0.0), (-21.0, 11.0, 0.0)])


def among_spectators():
    """A court with faint lines before stands with rows of seats, and the mask of its surroundings."""
    rng = np.random.default_rng(0)
    crowd = np.full((*SIZE[::-1], 3), 90, np.uint8)
    for _ in range(700):
        (x, y), (dx, dy) = rng.integers(0, SIZE), rng.integers(-250, 250, 2)
        cv2.line(crowd, (int(x), int(y)), (int(x + dx), int(y + dy)), rng.integers(0, 255, 3).tolist(), 5)
    beyond = np.ones(SIZE[::-1], np.uint8)
    cv2.fillConvexPoly(beyond, np.round(STAND.project(CORNERS)).astype(int), 0)
    court = picture(STAND, handball()).astype(float)
    faint = np.median(court, axis=(0, 1)) * 0.85 + court * 0.15
    return np.where(beyond[..., None], crowd, np.round(faint)).astype(np.uint8), beyond > 0


def test_the_floor_holds_the_markings_and_no_spectators():
    image, beyond = among_spectators()
    floor = floor_of(image)
    markings = np.concatenate([one.sample(0.5) for one in handball().markings.values()])
    column, row = np.round(STAND.project(markings[markings[:, 2] == 0.0])).astype(int).T
    inside = (column >= 0) & (column < SIZE[0]) & (row >= 0) & (row < SIZE[1])
    assert np.all(floor[row[inside], column[inside]])
    assert np.mean(floor[beyond]) < 0.15


def test_on_the_floor_more_of_its_stripes_are_found_and_hardly_others():
    image, beyond = among_spectators()
    every = AllStripes.of(image, lighter=True)
    anywhere, on_floor = (np.round(every.standing_out(area).xy).astype(int).T[::-1] for area in (None, floor_of(image)))
    of_court = [np.count_nonzero(~beyond[tuple(xy)]) for xy in (anywhere, on_floor)]
    of_others = [np.count_nonzero(beyond[tuple(xy)]) for xy in (anywhere, on_floor)]
    assert of_court[1] > 5 * of_court[0]
    assert of_others[1] < 0.2 * of_others[0]


@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_picture_of_one_colour_is_all_floor(level):
    assert np.all(floor_of(np.full((90, 160, 3), level, np.uint8)))


@pytest.mark.parametrize("size", [(1, 1), (1, 900), (900, 1), (40, 3000)])
def test_pictures_of_odd_shapes_have_a_floor(size):
    noise = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    assert floor_of(noise).shape == size


def test_a_court_among_spectators_is_found():
    image, _ = among_spectators()
    found = find_courts(image, handball())[0].calibration
    assert found.accepted
    assert Truth(STAND, handball()).distance(found.required_camera) < 3.0


@pytest.mark.parametrize("a", [0.0, 0.2])
def test_a_lens_must_show_on_the_floor(a):
    stand = Bend(a, SIZE).with_lens(STAND)
    court, bent = picture(stand, handball()), Bend(0.2, SIZE)
    column = np.arange(SIZE[0], dtype=float)
    for row in range(20, 140, 24):  # long seams in the roof, which a lens of 0.2 would have straight
        seam = bent.bent(np.column_stack([column, np.full(len(column), row)]))
        cv2.polylines(court, [np.round(seam).astype(np.int32)], False, (250, 250, 250), 5)
    seen = PictureToSearch(court)
    assert seen.stripes(lighter=True).bend.a == pytest.approx(0.2)
    for lighter in (True, False, None):
        assert seen.stripes(lighter=lighter, on_floor=True).bend.a == pytest.approx(a)


@pytest.mark.slow
@pytest.mark.parametrize("top", [15, 16])
def test_a_court_is_found_with_a_row_more_or_less(top, shared_data):
    image = cv2.imread(str(shared_data / "wild" / "stephanj-bulls_court.png"))
    found = find_courts(np.ascontiguousarray(image[top:298]), basketball("nba"))[0].calibration
    assert found.accepted
    np.testing.assert_allclose(found.required_camera.C, (-0.2, 33.9, -11.0), atol=1.5)


@pytest.mark.slow
def test_no_camera_at_the_height_of_the_ground_is_accepted(shared_data):
    image = cv2.imread(str(shared_data / "wild" / "tex-bas-03.jpeg"))[:-2, :-5]  # the fit to its lines moves one there
    found = find_courts(np.ascontiguousarray(image), basketball("nfhs"))
    assert not any(one.calibration.accepted for one in found)
    assert all(stands(Cameras.of([one.calibration.camera], image.shape[1::-1]), basketball("nfhs"))[0] for one in found)
