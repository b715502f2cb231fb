"""Soccer fields with lines of a width: the middles of the lines, and who takes them."""

import numpy as np
import pytest
from commands import run
from hypothesis import given
from hypothesis import strategies as st

from fieldcalib import soccer
from fieldcalib.fields import Ground, tennis
from fieldcalib.fields.records import field_from_record, field_to_record
from fieldcalib.fields.segments import Arc, Line
from fieldcalib.fields.sports.soccer import with_line_width, with_painted_lines
from fieldcalib.images.from_images import How
from fieldcalib.solve.request import Task

THIN = soccer()


@given(st.floats(0.0, 0.12), st.floats(95.0, 110.0), st.floats(62.0, 74.0))
def test_outer_edges_of_lines_are_where_the_law_measures(width, length, across):
    field, thin, half = soccer(length, across, line_width=width), soccer(length, across), width / 2.0
    for side, sign in (("left", -1.0), ("right", 1.0)):
        goal_line, area = sign * field[f"Side line {side}"].start[0], field[f"Big rect. {side} main"]
        assert goal_line + half == pytest.approx(length / 2.0)
        assert goal_line + half - (sign * area.start[0] - half) == pytest.approx(16.5)
        assert abs(area.end[1] - area.start[1]) + width == pytest.approx(40.32)
        post, bar = field[f"Goal {side} post left"], field[f"Goal {side} crossbar"]
        assert 2.0 * (abs(post.start[1]) - half) == pytest.approx(7.32)
        assert -bar.start[2] - half == pytest.approx(2.44)
        arc = field[f"Circle {side}"]
        assert sign * arc.center[0] == pytest.approx(length / 2.0 - 11.0)  # the mark, whatever the lines
        assert sign * arc.sample(0.5)[0, 0] == pytest.approx(sign * area.start[0])  # the arc ends at the area's middle
    assert field["Circle central"].radius + half == pytest.approx(9.15)
    for label, segment in field.items():
        assert type(segment) is type(thin[label])
        if isinstance(segment, Line | Arc):
            assert np.max(np.abs(segment.sample(9.0)[0] - thin[label].sample(9.0)[0])) <= width + 1e-9


def test_lines_are_kept_by_size_ground_and_files():
    field = soccer(line_width=0.1).resized(100.0, 64.0).with_ground(Ground(0.3))
    assert dict(field) == dict(soccer(100.0, 64.0, line_width=0.1))
    assert field_from_record(field_to_record(field)) == field
    assert field_to_record(field)["line_width"] == 0.1
    assert "line_width" not in field_to_record(THIN)


@pytest.mark.parametrize("wrong", [-0.01, 0.13, np.nan, "0.1", True])
def test_no_lines_of_other_widths(wrong):
    with pytest.raises(ValueError, match=r"expected a line_width from 0 to 0\.12 m"):
        soccer(line_width=wrong)


def test_a_width_that_was_said_is_kept():
    assert dict(with_painted_lines(THIN)) == dict(soccer(line_width=0.12))
    for said in (soccer(line_width=0.0), soccer(line_width=0.1), tennis()):
        assert with_painted_lines(said) is said
    with pytest.raises(ValueError, match="expected a soccer field"):
        with_line_width(tennis(), 0.1)


def test_clips_take_painted_lines_where_they_estimate_the_size():
    assert dict(How(Task(THIN)).on_paint().task.field) == dict(soccer(line_width=0.12))
    assert How(Task(THIN), estimate_size=False).on_paint().task.field is THIN


def test_the_option_is_of_soccer(tmp_path, capsys):
    (tmp_path / "1.json").write_text("{}")
    arguments = ("calibrate", tmp_path, "--size", "960x540", "--out", tmp_path / "out", "--line-width", "0.1")
    assert run(*arguments, "--field", "tennis") == 2
    assert "expected a soccer field" in capsys.readouterr().err
