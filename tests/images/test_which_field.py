"""The field that pictures show, of all that are tried."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import fieldcalib
from data_tools.nonsense import nonsense
from fieldcalib import Camera
from fieldcalib.assess.findings import Verdict
from fieldcalib.cli.main import main
from fieldcalib.draw.scene import render_field
from fieldcalib.fields import tennis
from fieldcalib.fields.catalogue import field as field_named
from fieldcalib.images import which_field as module
from fieldcalib.images.search.court_ranking import PictureToSearch
from fieldcalib.images.which_field import WhichField, which_field
from fieldcalib.localize import SegmentationNetwork

BEHIND = Camera.from_angles(1.5, 1.3, 0.0, 1400.0, (-32.0, 1.0, -9.0), (960, 540))
FEW = ("tennis", "badminton")


@pytest.fixture
def few(monkeypatch):
    """Two sports only: sixteen take ten seconds."""
    monkeypatch.setattr("fieldcalib.results.frames.COMPARED", FEW)


def test_the_best_field_wins_with_a_margin():
    found = WhichField({"tennis": 900.0, "badminton": 300.0, "soccer": 0.0})
    assert (found.name, found.alternatives, found.reason) == ("tennis", ("tennis",), "")
    alike = WhichField({"futsal": 500.0, "handball": 480.0})
    assert alike.name is None
    assert alike.alternatives == ("futsal", "handball")
    assert "futsal and handball" in alike.reason
    assert "name it" in WhichField({"tennis": 0.0}).reason


def test_fields_that_explain_the_first_picture_badly_are_left_out(monkeypatch):
    asked = []

    def compared(picture, names, network):
        asked.append(tuple(names))
        return {name: module._Found(100.0 if name == "tennis" else 10.0, Verdict.CHECK) for name in names}

    monkeypatch.setattr(module, "_compared", compared)
    assert which_field([np.zeros((2, 2, 3), np.uint8)] * 2, FEW).name == "tennis"
    assert asked == [FEW, ("tennis",)]


@pytest.fixture
def searched(monkeypatch):
    """The searches that were made, of fields of which only the second search finds badminton."""
    made = []

    def searches(picture, field):
        name = "tennis" if field == tennis() else "badminton"
        for number in (1, 2, 3):
            made.append((name, number))
            verdict = Verdict.GOOD if (name, number) == ("badminton", 2) else Verdict.REJECT
            court = SimpleNamespace(evidence=SimpleNamespace(score=50.0), calibration=SimpleNamespace(verdict=verdict))
            yield SimpleNamespace(courts=[court])
            if verdict is Verdict.GOOD:
                return

    monkeypatch.setattr(module, "searches_for", searches)
    likely = 90.0, 80.0
    monkeypatch.setattr(module, "_unrefined", lambda picture, fields, **how: dict(zip(fields, likely, strict=True)))
    return made


def test_fields_are_searched_for_once_before_any_is_searched_for_thoroughly(searched):
    assert which_field([np.zeros((2, 2, 3), np.uint8)], FEW).name == "badminton"
    assert searched == [("tennis", 1), ("badminton", 1), ("tennis", 2), ("tennis", 3), ("badminton", 2)]


@pytest.mark.parametrize(("verdict", "count"), [(Verdict.GOOD, 1), (Verdict.CHECK, 3)])
def test_where_the_network_finds_a_good_camera_no_other_field_is_tried(monkeypatch, searched, verdict, count):
    found = module._Found(500.0, verdict)
    monkeypatch.setattr(module, "_by_network", lambda *arguments, is_thorough: found)
    which = which_field([np.zeros((2, 2, 3), np.uint8)], ("soccer", *FEW), SegmentationNetwork.load())
    assert which.name == "soccer"
    assert len(which.scores) == count
    assert not searched  # the others are not likely beside it


def test_courts_of_a_sport_are_compared_if_its_first_is_likely():
    picture = PictureToSearch(render_field(BEHIND, tennis()))
    rinks = {name: field_named(name) for name in ("ice-hockey-iihf", "ice-hockey-nhl")}
    for is_thorough in (False, True):
        assert module._unrefined(picture, rinks, is_thorough=is_thorough).keys() == rinks.keys()
        likely = module._unrefined(picture, {"tennis": tennis(), **rinks}, is_thorough=is_thorough)
        assert likely.keys() == {"tennis", "ice-hockey-iihf"}


def test_three_lines_are_asked_only_of_a_thorough_search():
    court, far = {"tennis": tennis()}, np.full((540, 960, 3), 90, np.uint8)
    for line in (((100, 400), (900, 380)), ((300, 250), (100, 500)), ((650, 240), (900, 500))):
        cv2.line(far, *line, (220, 220, 220), 4, cv2.LINE_AA)
    assert module._unrefined(PictureToSearch(far), court, is_thorough=False)["tennis"] == 0.0
    assert module._unrefined(PictureToSearch(far), court, is_thorough=True)["tennis"] > 10.0


def test_no_field_is_found_where_there_is_none():
    assert which_field([nonsense(0)], FEW).alternatives == ()


@pytest.mark.slow
def test_a_field_of_pictures_is_found(few, tmp_path, capsys):
    picture = render_field(BEHIND, tennis())
    found = fieldcalib.calibrate(picture, field="auto", progress=False)
    assert found["000000"].field == tennis()
    assert found["000000"].accepted
    cv2.imwrite(str(tmp_path / "court.png"), picture)
    out = tmp_path / "out"
    assert main(["run", "--field", "auto", "--out", str(out), str(tmp_path / "court.png")]) == 0
    assert (
        f"the pictures show tennis, compared with {', '.join(sorted({*FEW} - {'tennis'}))}" in capsys.readouterr().err
    )


def test_what_cannot_be_searched_twice_is_refused(few):
    with pytest.raises(ValueError, match="can be read twice: name it"):
        fieldcalib.calibrate(iter([render_field(BEHIND, tennis())]), field="auto", progress=False)
    with pytest.raises(ValueError, match="no field was found"):
        fieldcalib.calibrate(nonsense(1), field="auto", progress=False)
