"""Markings of a court that boards, nets or wear hide, with other lines beside them."""

from dataclasses import replace

import numpy as np
from pictures import picture

from fieldcalib import Camera
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.fields import futsal, tennis
from fieldcalib.images.search.court_search import find_courts, with_hidden_markings
from fieldcalib.images.search.place_search import Place, search_from
from fieldcalib.solve.request import Task

SIZE = (1280, 720)
TENNIS = Camera.from_angles(np.radians(92), np.radians(76), 0.01, 2300.0, (-38.0, 1.0, -10.0), SIZE)


def calibrated(field=None, camera=TENNIS):
    field = field or tennis()
    return find_courts(picture(camera, field), field)[0].calibration


def test_a_line_far_from_a_known_marking_is_not_its_paint():
    found = calibrated()
    label = found.markings[0].label
    off = MarkingInView(label, 400.0, 30, share=0.1, offset=25.0)
    doubted = replace(found, markings=(off, *found.markings[1:]))
    assert doubted.verdict == Verdict.CHECK
    sure = with_hidden_markings(doubted)
    assert sure.verdict == Verdict.GOOD
    assert f"hidden or worn: {label!r}" in sure.message
    near = replace(found, markings=(replace(off, offset=6.5), *found.markings[1:]))
    assert with_hidden_markings(near) is near  # may be its paint: the camera is off


def test_a_line_beside_a_marking_of_a_field_whose_size_varies_may_be_its_paint():
    hall = Camera.from_angles(0.05, 1.2, 0.0, 1000.0, (2.0, 24.0, -9.0), SIZE)
    found = calibrated(futsal(), hall)
    off = MarkingInView(found.markings[0].label, 400.0, 30, share=0.1, offset=25.0)
    doubted = replace(found, markings=(off, *found.markings[1:]))
    assert with_hidden_markings(doubted) is doubted


def test_from_a_known_place_a_marking_may_be_hidden_too():
    field = tennis()
    label = "Side line bottom"
    hidden = picture(TENNIS, replace(field, segments={k: v for k, v in field.segments.items() if k != label}))
    place = Place(np.array(TENNIS.C), np.full(3, 0.3), (1.5, 2.2))
    found = search_from(Task(field), field, hidden, place)
    assert found.verdict == Verdict.GOOD
    assert f"hidden or worn: {label!r}" in found.message
