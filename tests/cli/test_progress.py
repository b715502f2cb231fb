"""Progress: bars, lines where there is no terminal, and functions of the caller's."""

import io
import re
import sys
import time

import pytest

from fieldcalib import _progress as module
from fieldcalib._progress import progress_bar, solving


@pytest.fixture
def clock(monkeypatch):
    """A clock that moves by three seconds with each look at it."""
    now = [0.0]

    def look():
        now[0] += 3.0
        return now[0]

    monkeypatch.setattr(module.time, "monotonic", look)
    return now


def lines_of(text):
    return [line.removeprefix("fieldcalib: ") for line in text.splitlines()]


def test_a_line_every_ten_seconds_where_there_is_no_terminal(clock, capfd):
    with progress_bar(unit="frame", total=9, desc="looking") as progress:
        for _ in range(9):
            progress.update()
    lines = lines_of(capfd.readouterr().err)
    assert lines == [
        "looking: 4 of 9 frames, 0.333 a second, 0:15 left",
        "looking: 8 of 9 frames, 0.333 a second, 0:03 left",
    ]


def test_a_stage_within_another_is_told_with_the_time_left_of_both(clock, capfd):
    with progress_bar(unit="frame", total=12, desc="calibrating") as whole:
        for _ in range(3):
            with progress_bar(unit="frame", total=4, desc="matching") as progress:
                for _ in range(4):
                    progress.update()
            whole.update(4)
    lines = lines_of(capfd.readouterr().err)
    assert lines[0] == "calibrating: 0 of 12 frames; matching: 3 of 4 frames, 0.333 a second, 0:03 left"
    ends = [re.fullmatch(r"calibrating: \d+ of 12 frames, (\d):(\d\d) left; matching: .*", one) for one in lines[1:]]
    left = [60 * int(one[1]) + int(one[2]) for one in ends if one]
    assert len(left) >= 2
    assert left == sorted(left, reverse=True)
    assert 12 <= left[0] <= 48  # 24 to 27


def test_work_of_few_large_parts_tells_the_time_left_between_them(monkeypatch, capfd):
    monkeypatch.setattr(module, "INTERVAL", 0.1)
    seen = []

    def left():
        seen.extend(re.findall(r"calibrating: 30 of 60 frames, 0:0(\d) left", capfd.readouterr().err))
        return len(seen) >= 2

    with progress_bar(unit="frame", total=60, desc="calibrating") as progress:
        module.time.sleep(1.5)
        progress.update(30)
        until(left)
    assert 0 <= int(seen[-1]) <= int(seen[0]) <= 3


def test_a_line_without_a_known_end(clock, capfd):
    with progress_bar(unit="frame") as progress:
        for _ in range(5):
            progress.update()
    assert lines_of(capfd.readouterr().err) == ["4 frames, 0.333 a second"]


def test_what_was_done_before_does_not_count_for_the_rate(clock, capfd):
    with progress_bar(unit="frame", total=20, initial=10) as progress:
        for _ in range(4):
            progress.update()
    assert lines_of(capfd.readouterr().err) == ["14 of 20 frames, 0.333 a second, 0:18 left"]


def test_short_work_prints_nothing(capfd):
    with progress_bar(unit="frame", total=2) as progress:
        progress.update(2)
    assert capfd.readouterr().err == ""


def test_text_that_is_kept_in_memory_gets_no_lines(clock, monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with progress_bar(unit="frame", total=9) as progress:
        for _ in range(9):
            progress.update()
    assert sys.stderr.getvalue() == ""


def test_a_terminal_gets_a_bar(monkeypatch):
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr(sys, "stderr", terminal)
    with progress_bar(unit="frame", total=2, desc="looking") as progress:
        progress.update(2)
    assert re.search(r"looking: 100%.*2/2", terminal.getvalue())


def test_a_function_is_told_of_each():
    seen = []
    with progress_bar(unit="frame", total=3, desc="looking", progress=lambda *what: seen.append(what)) as progress:
        progress.update()
        progress.update(2)
    assert seen == [(0, 3, "looking"), (1, 3, "looking"), (3, 3, "looking")]


def test_an_error_of_the_function_ends_the_work():
    def stop(done, total, stage):
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), progress_bar(unit="frame", progress=stop) as progress:
        progress.update()


def test_nothing_is_shown_if_it_is_not_wanted(clock, capfd):
    with progress_bar(unit="frame", progress=False) as progress:
        for _ in range(9):
            progress.update()
    assert capfd.readouterr().err == ""


def test_stages_that_are_short_have_lines_together(clock, capfd):
    for stage in ("looking", "matching", "drawing"):
        with progress_bar(unit="frame", total=2, desc=stage) as progress:
            progress.update()
            progress.update()
    lines = lines_of(capfd.readouterr().err)
    assert [line.partition(":")[0] for line in lines] == ["matching", "drawing"]


def until(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end and not condition():
        time.sleep(0.01)
    assert condition()


def test_a_stage_that_stands_still_is_told_of(monkeypatch, capfd):
    monkeypatch.setattr(module, "INTERVAL", 0.1)
    seen = []

    def lines():
        seen.extend(lines_of(capfd.readouterr().err))
        return seen

    with solving("solving the clip"):
        with progress_bar(unit="frame", total=20, desc="matching") as progress:
            progress.update(5)
            until(lambda: any("matching: 5 of 20 frames, " in line and line.endswith(" left") for line in lines()))
            until(lambda: "matching: 5 of 20 frames, 0:00 so far" in lines())  # what is left would grow
        until(lambda: "solving the clip, 0:00 so far" in lines())
    before = len(lines())
    time.sleep(0.3)
    assert len(lines()) == before


def test_a_function_is_not_told_of_work_that_cannot_be_counted(monkeypatch, capfd):
    monkeypatch.setattr(module, "INTERVAL", 0.02)
    with solving("solving the clip", print), progress_bar(unit="frame", progress=False):
        time.sleep(0.2)
    assert capfd.readouterr() == ("", "")
