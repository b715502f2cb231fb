"""Which of the cameras that were searched are rivals of one that was found."""

from dataclasses import replace

import numpy as np
import pytest
from pictures import picture

from data_tools.nonsense import nonsense
from data_tools.rink_points import FIELD as RINK
from data_tools.rink_points import rink_frames
from fieldcalib import Camera
from fieldcalib.fields import tennis
from fieldcalib.fields.catalogue import field_named
from fieldcalib.images.search import court_search
from fieldcalib.images.search.court_hypotheses import Cameras
from fieldcalib.images.search.court_ranking import (
    PictureToSearch,
    Ranked,
    Rivals,
    are_apart,
    distances,
    grid_of,
    seen_grids,
)
from fieldcalib.images.search.court_search import find_courts, searches_for
from fieldcalib.images.search.long_lines import Bend
from fieldcalib.io.image_files import parse_image

SIZE = (1280, 720)
FIELD = tennis()


def panned(degrees):
    return Camera.from_angles(np.radians(92 + degrees), np.radians(76), 0.0, 2300.0, (-38.0, 1.0, -10.0), SIZE)


# 0.1 degrees are 4 px: the first two see the court alike
SEARCHED = [panned(degrees) for degrees in (0.0, 0.1, 2.0, 4.0)]
RANKED = Ranked(Cameras.of(SEARCHED, SIZE), np.array([400.0, 390.0, 300.0, 200.0]), Bend(0.0, SIZE))
FOUND = seen_grids(SEARCHED[0], FIELD)


def test_cameras_that_see_the_field_elsewhere_are_apart():
    xy = np.array([camera.project(grid_of(FIELD)) for camera in SEARCHED])
    assert are_apart(xy, FOUND, SIZE).tolist() == [False, False, True, True]
    assert distances(xy, FOUND[0], SIZE, median=True)[1] == pytest.approx(4.0, abs=0.5)
    assert np.all(distances(xy, FOUND[0], SIZE) >= distances(xy, FOUND[0], SIZE, median=True))
    away = panned(90.0)  # sees no court at all
    assert np.isinf(distances(away.project(grid_of(FIELD))[None], away.project(grid_of(FIELD)), SIZE)[0])


@pytest.mark.parametrize(
    ("refined", "best"),
    [
        ({}, 300.0),
        ({0: SEARCHED[0], 2: SEARCHED[2]}, 300.0),
        ({0: SEARCHED[0], 2: SEARCHED[0]}, 200.0),
        ({0: SEARCHED[0], 2: None}, 200.0),
        ({2: None, 3: SEARCHED[1]}, 0.0),
    ],
    ids=["none refined", "it stays another", "it becomes the camera", "it becomes none", "none is left"],
)
def test_those_that_refinement_takes_to_the_camera_or_to_none_are_no_rivals(refined, best):
    assert Rivals.of(RANKED, FIELD, refined).best_score(FOUND) == best


def test_stripes_without_proposals_of_their_own_weigh_those_of_others():
    stripes = PictureToSearch(picture(SEARCHED[0], FIELD)).stripes(lighter=True)
    two = stripes.take(np.flatnonzero(np.any(stripes.on_lines[:2], axis=0)))  # of one direction: no camera follows
    assert not len(two.ranked(FIELD, may_be_cut_out=False).cameras)
    best = two.ranked_with([RANKED], FIELD)
    assert distances(best.projected(grid_of(FIELD)), FOUND[0], SIZE)[0] < 6.0
    bent = Ranked(RANKED.cameras, RANKED.score, Bend(0.2, SIZE))  # cameras of the picture without another distortion
    assert not len(two.ranked_with([bent], FIELD).cameras)


def test_a_picture_is_looked_at_again_only_where_lines_are_explained_and_no_camera_is_sure():
    for image, searches in ((picture(SEARCHED[0], FIELD), 1), (nonsense(0), 2)):  # all stripes, and from above
        seen = PictureToSearch(image)
        assert len([*searches_for(seen, FIELD)]) == searches
        assert not any(look._found for look in seen._again.values())


def test_white_paint_on_grass_is_found_in_the_darkest_channel():
    image = np.full((360, 640, 3), (60, 200, 120), np.uint8)  # bright grass
    image[178:182] = 164  # paint that is hardly brighter
    seen = PictureToSearch(image)
    assert (
        len(seen.again(darkest=True).stripes(lighter=True).seen.xy) > 500 > 10 * len(seen.stripes(lighter=True).seen.xy)
    )


@pytest.mark.parametrize(("surface", "is_darkest"), [("grass", True), ("ice", False)])
def test_the_second_look_is_at_the_darkest_channel_on_grass_and_at_another_size_elsewhere(
    surface, is_darkest, monkeypatch
):
    monkeypatch.setattr(court_search, "LEAST_PROBABILITY", 2.0)  # no camera is ever accepted
    seen = PictureToSearch(picture(SEARCHED[0], FIELD))
    assert len([*searches_for(seen, replace(FIELD, surface=surface))]) == 3
    assert [darkest for darkest, look in seen._again.items() if look._found] == [is_darkest]


def test_a_rink_is_found_by_a_second_look(shared_data):
    (frame,) = (one for one in rink_frames(shared_data / "hockey-points") if one.path.name == "image1521.jpg")
    found = find_courts(parse_image(frame.path.read_bytes()), field_named(RINK))[0].calibration
    assert found.accepted
    assert frame.is_right(found.required_camera)
