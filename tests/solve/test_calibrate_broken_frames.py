"""`fieldcalib calibrate` where frames are broken, empty, too large, or have no camera."""

from dataclasses import replace

import numpy as np
import pytest
from commands import BROKEN_KEYS, SIZE, WITH_CAMERA, WITHOUT_CAMERA, calibrate, cameras_in, lines_of, summary_of

from fieldcalib.io.formats import ANNOTATIONS
from fieldcalib.io.soccernet import format_annotation
from fieldcalib.solve.batch import calibrate_labels

BROKEN = {
    "cut": ('{"Middle line": [{"x"', "is no JSON"),
    "pixels": ('{"Middle line": [{"x": 480, "y": 20}]}', "'Middle line': coordinates up to 480 are not normalised"),
    "typo": ('{"Midle line": [{"x": 0.5, "y": 0.2}]}', "did you mean 'Middle line'?"),
}


@pytest.fixture
def mixed(annotated_folder, tmp_path):
    """Two good frames, an empty one, one with too little, and three broken files."""
    path = tmp_path / "mixed"
    path.mkdir()
    for name in "ab":
        (path / f"{name}.json").write_bytes((annotated_folder / f"{name}.json").read_bytes())
    (path / "empty.json").write_text("{}")
    (path / "lone.json").write_text('{"Middle line": [{"x": 0.5, "y": 0.2}, {"x": 0.5, "y": 0.8}]}')
    for name, (content, _) in BROKEN.items():
        (path / f"{name}.json").write_text(content)
    return path


def test_broken_files_are_named_and_the_others_calibrated(mixed, calibrated_folder, tmp_path, capsys):
    assert calibrate(tmp_path / "out", mixed) == 1
    errors, others = capsys.readouterr().err.split("fieldcalib: 2 frames to look at")
    assert ["  empty: reject, no" in others, "  lone: reject, 1 segment" in others] == [True, True]
    errors = errors.splitlines()
    for error, (name, (_, message)) in zip(errors, BROKEN.items(), strict=True):
        assert error.startswith(f"fieldcalib: {mixed / name}.json: ")
        assert message in error
    lines = {line["id"]: line for line in lines_of(tmp_path / "out")}
    assert list(lines) == ["a", "b", "cut", "empty", "lone", "pixels", "typo"]
    for name, (_, message) in BROKEN.items():
        assert list(lines[name]) == BROKEN_KEYS
        assert lines[name]["status"] == "broken file"
        assert message in lines[name]["message"]
    assert list(lines["empty"]) == WITHOUT_CAMERA
    assert (lines["empty"]["status"], lines["lone"]["status"]) == ("too few segments", "too few segments")
    assert list(lines["lone"]) == WITH_CAMERA  # the best camera is given whatever the status
    assert sorted(cameras_in(tmp_path / "out")) == ["a", "b", "lone"]
    summary = summary_of(tmp_path / "out")
    assert summary["frames"] == 7
    assert summary["cameras"] == 3
    assert summary["completeness"] == pytest.approx(300.0 / 7.0)
    assert summary["status"] == {"accepted": 2, "broken file": 3, "too few segments": 2}
    assert {name: lines[name]["verdict"] for name in ("empty", "lone")} == {"empty": "reject", "lone": "reject"}
    assert summary["verdict"]["reject"] == 2
    assert sum(summary["verdict"].values()) == 4


def test_files_that_are_skipped_are_named(annotated_folder, tmp_path, capsys):
    for name in ("a.json", "camera_b.json", "summary_c.json", "d.jpg", "e.jpg", "f.jpg", "g.jpg"):
        (tmp_path / name).write_bytes((annotated_folder / "a.json").read_bytes())
    (tmp_path / "cameras.jsonl").write_text("of an earlier run")
    assert calibrate(tmp_path / "out", tmp_path) == 0
    assert capsys.readouterr().err == (
        "fieldcalib: skipped 2 .json (camera_b.json, summary_c.json), 4 .jpg (d.jpg, e.jpg, f.jpg, ...)\n"
    )


def test_a_frame_that_takes_too_much_memory_is_broken(annotated_folder, tmp_path, monkeypatch, capsys):
    def parse(content, size, *, unknown=False):
        if len(content) > 5000:
            raise MemoryError
        return {}

    monkeypatch.setattr("fieldcalib.io.formats.ANNOTATIONS", replace(ANNOTATIONS, read=parse))
    (tmp_path / "a.json").write_text("{}")
    (tmp_path / "b.json").write_bytes(bytes(6000))
    assert calibrate(tmp_path / "out", tmp_path) == 1
    said = f"fieldcalib: {tmp_path / 'b.json'}: there is not enough memory for it\nfieldcalib: 1 frame to look at"
    assert capsys.readouterr().err.startswith(said)
    assert [line["status"] for line in lines_of(tmp_path / "out")] == ["too few segments", "broken file"]


def test_files_that_are_too_large_are_broken(annotated_folder, tmp_path, capsys):
    (tmp_path / "a.json").write_bytes((annotated_folder / "a.json").read_bytes())
    (tmp_path / "b.json").write_bytes((annotated_folder / "b.json").read_bytes() + b" " * 100_000)
    assert calibrate(tmp_path / "out", tmp_path, options=["--max-megabytes", 0.1]) == 1
    assert "b.json: has more than 0.1 MB; --max-megabytes of a command allows more" in capsys.readouterr().err
    assert list(cameras_in(tmp_path / "out")) == ["a"]
    assert calibrate(tmp_path / "out", tmp_path, options=["--overwrite"]) == 0
    assert set(cameras_in(tmp_path / "out")) == {"a", "b"}


def test_names_that_are_too_long_are_broken(annotated_folder, tmp_path):
    for length in (236, 250):
        (tmp_path / f"{'a' * length}.json").write_bytes((annotated_folder / "a.json").read_bytes())
    assert calibrate(tmp_path / "out", tmp_path) == 1
    assert list(cameras_in(tmp_path / "out")) == ["a" * 236]
    assert {line["status"] for line in lines_of(tmp_path / "out")} == {"accepted", "broken file"}


def test_dense_labels_are_thinned_before_anything_is_done_with_them(annotated_frames, tmp_path, monkeypatch):
    frame, _ = annotated_frames["a"]
    label = next(label for label in frame if label != "Middle line")
    dense = {**frame, label: np.repeat(frame[label], 2000, axis=0)}
    (tmp_path / "a.json").write_text(format_annotation(frame, SIZE))
    (tmp_path / "dense.json").write_text(format_annotation(dense, SIZE))
    most = []

    def method(task, frames, *arguments, **options):
        most.extend(len(xy) for frame in frames for xy in frame.values())
        return calibrate_labels(task, frames, *arguments, **options)

    monkeypatch.setattr("fieldcalib.cli.calibrate.calibrate_labels", method)
    assert calibrate(tmp_path / "out", tmp_path) == 0
    assert max(most) <= 200
    sparse, thinned = lines_of(tmp_path / "out")
    np.testing.assert_allclose(thinned["C"], sparse["C"], atol=0.02)  # the same pixels, each a thousand times


def test_strict_stops_at_the_first_broken_file(mixed, tmp_path, capsys):
    assert calibrate(tmp_path / "out", mixed, options=["--strict"]) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    (error,) = printed.err.splitlines()
    assert error.startswith(f"fieldcalib: {mixed / 'cut.json'}: is no JSON")
    assert not (tmp_path / "out").exists()


def test_strict_does_not_mind_empty_frames(tmp_path):
    (tmp_path / "empty.json").write_text("{}")
    assert calibrate(tmp_path / "out", tmp_path, options=["--strict"]) == 0
    assert summary_of(tmp_path / "out")["status"] == {"too few segments": 1}


def test_nothing_but_broken_files(tmp_path):
    (tmp_path / "cut.json").write_text("{")
    assert calibrate(tmp_path / "out", tmp_path) == 2
    assert not (tmp_path / "out").exists()


def test_a_frame_that_broke_since_loses_its_camera(annotated_folder, tmp_path):
    for name in ("a.json", "b.json"):
        (tmp_path / name).write_bytes((annotated_folder / name).read_bytes())
    assert calibrate(tmp_path / "out", tmp_path) == 0
    assert sorted(cameras_in(tmp_path / "out")) == ["a", "b"]
    (tmp_path / "a.json").write_text("{")
    assert calibrate(tmp_path / "out", tmp_path, options=["--overwrite"]) == 1
    assert list(cameras_in(tmp_path / "out")) == ["b"]
