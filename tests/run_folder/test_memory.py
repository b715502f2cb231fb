"""What the command line holds in memory does not grow with the number of frames."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from commands import PEAK, SIZE, calibrate
from synthetic import random_frames

import fieldcalib
from fieldcalib.io.formats import ANNOTATIONS
from fieldcalib.io.soccernet import format_annotation
from fieldcalib.run_folder import work_units
from fieldcalib.run_folder.results import ResultsWriter

SAME = ("--size", "960x540")


def peak_of(module, *arguments):
    """Megabytes (MiB) that the command line of a module held at most."""
    done = subprocess.run(
        [sys.executable, "-c", PEAK, module, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(fieldcalib.__file__).parents[1],
    )
    return float(done.stdout.splitlines()[-1])


def written(folder, count):
    """A folder of small annotations."""
    folder.mkdir()
    frames, _ = random_frames(10, seed=4, noise=0.5)
    contents = [format_annotation({label: xy[:3] for label, xy in frame.items()}, SIZE) for frame in frames]
    for number in range(count):
        (folder / f"{number:06d}.json").write_text(contents[number % len(contents)])
    return folder


def test_frames_are_read_unit_by_unit(tmp_path, monkeypatch):
    monkeypatch.setattr(work_units, "SMALLEST_UNIT", 2)
    monkeypatch.setattr(work_units, "LARGEST_UNIT", 2)
    read, ahead = [], []

    def reading(content, size, *, unknown=False):
        read.append(content)
        return {}

    def adding(results, outcome):
        ahead.append(len(read) - results.done)
        results.done += 1

    monkeypatch.setattr("fieldcalib.io.formats.ANNOTATIONS", replace(ANNOTATIONS, read=reading))
    monkeypatch.setattr(ResultsWriter, "add", adding)
    assert calibrate(tmp_path / "out", written(tmp_path / "in", 9)) == 0
    assert ahead == [2, 1] * 4 + [1]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs getrusage")
@pytest.mark.parametrize(
    "program",
    [
        ("baselines.dlt_lines",),
        ("fieldcalib.cli.main", "calibrate", "--jobs", 1),
        ("fieldcalib.cli.main", "calibrate", "--jobs", 2),
    ],
    ids=["dlt_lines", "one job", "two jobs"],
)
def test_it_does_not_grow(tmp_path, program):

    def peak(count):
        out = tmp_path / f"{count} out"
        return peak_of(*program, written(tmp_path / str(count), count), *SAME, "--out", out)

    peak(2)  # what is compiled only once takes memory too
    few, many = map(peak, (250, 750))
    assert many < few + 15.0  # 500 outcomes that are held take 30 MiB
    assert many < 500.0


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs getrusage")
def test_maps_that_are_drawn_are_not_kept(tmp_path):
    """A map takes a megabyte."""
    peaks = []
    for count in (30, 150):
        out = tmp_path / f"{count} out"
        assert calibrate(out, written(tmp_path / str(count), count)) == 0
        video = tmp_path / f"{count}.mp4"
        peaks.append(peak_of("fieldcalib.cli.main", "minimap", "--cameras", out, "--out", video))
    assert peaks[1] < peaks[0] + 40.0
