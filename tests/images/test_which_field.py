"""The field that pictures show, of all that are tried."""

import cv2
import numpy as np
import pytest

import fieldcalib
from data_tools.nonsense import nonsense
from fieldcalib import Camera
from fieldcalib.cli.main import main
from fieldcalib.draw.scene import render_field
from fieldcalib.fields import badminton, tennis
from fieldcalib.images import which_field as module
from fieldcalib.images.which_field import WhichField, which_field

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

    def score(image, field, network):
        asked.append(field)
        return (100.0, True) if field == tennis() else (10.0, True)

    monkeypatch.setattr(module, "_score", score)
    monkeypatch.setattr(module, "_likely", lambda image, names, network: names)
    assert which_field([np.zeros((2, 2, 3), np.uint8)] * 2, FEW).name == "tennis"
    assert asked == [tennis(), badminton(), tennis()]


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
