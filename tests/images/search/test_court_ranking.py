"""Which of the cameras that were searched are rivals of one that was found."""

import numpy as np
import pytest

from fieldcalib import Camera
from fieldcalib.fields import tennis
from fieldcalib.images.search.court_hypotheses import Cameras
from fieldcalib.images.search.court_ranking import Ranked, Rivals, are_apart, distances, grid_of, seen_grids
from fieldcalib.images.search.long_lines import Bend

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
