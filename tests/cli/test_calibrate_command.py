"""`fieldcalib calibrate` on synthetic annotations: what it writes and prints."""

import json
import time
import zipfile
from collections import Counter

import numpy as np
import pytest
from commands import SIZE, WITH_CAMERA, calibrate, cameras_in, lines_of, summary_of

import fieldcalib
from fieldcalib.io.soccernet import camera_from_record
from fieldcalib.run_folder import labelled_frames as commands_on_folders
from fieldcalib.run_folder import record as records_of_commands


def test_files(calibrated_folder):
    expected = {f"camera_{name}.json" for name in "abcd"} | {
        "cameras.jsonl",
        "solver.jsonl",
        "run.json",
        "summary.json",
    }
    assert {path.name for path in calibrated_folder.iterdir()} == expected


def test_camera_files_are_soccernets_and_right(calibrated_folder, annotated_frames):
    for name, (_, true_camera) in annotated_frames.items():
        camera = camera_from_record(json.loads((calibrated_folder / f"camera_{name}.json").read_text()), SIZE)
        assert np.all(np.abs(camera.principal_point - (480.0, 270.0)) < 0.04 * 960)  # two sigma of its prior
        assert np.linalg.norm(camera.C - true_camera.C) < 4.0
        pixel = np.array([480.0, 400.0])
        np.testing.assert_allclose(camera.project(true_camera.image_to_field(pixel)), pixel, atol=8.0)


def test_one_line_a_frame_in_the_order_of_the_input(calibrated_folder):
    lines = lines_of(calibrated_folder)
    assert [line["id"] for line in lines] == list("abcd")
    for line in lines:
        assert list(line) == WITH_CAMERA
        assert line["status"] == "accepted"


def test_a_line_holds_the_camera_of_the_file(calibrated_folder, annotated_frames):
    for line in lines_of(calibrated_folder):
        camera = camera_from_record(json.loads((calibrated_folder / f"camera_{line['id']}.json").read_text()), SIZE)
        np.testing.assert_allclose(line["K"], camera.K)
        np.testing.assert_allclose(line["R"], camera.R, atol=1e-12)
        np.testing.assert_allclose(line["C"], camera.C)
        np.testing.assert_allclose(line["dist"], [*camera.k, 0.0, 0.0, 0.0])
        angles = np.degrees(camera.angles)
        np.testing.assert_allclose([line["angles_degrees"][name] for name in ("pan", "tilt", "roll")], angles)
        assert list(line["segment_errors_px"]) == list(annotated_frames[line["id"]][0])
        assert 0.0 < line["rms_px"] < 2.0
        assert 0.0 < line["loss_ndc"] < 0.019
        assert line["alternatives"] == []


def test_summary(calibrated_folder, annotated_folder):
    summary = summary_of(calibrated_folder)
    assert list(summary) == [
        "frames",
        "cameras",
        "completeness",
        "verdict",
        "status",
        "seconds",
        "milliseconds_per_frame",
        "options",
        "version",
    ]
    assert summary["frames"] == summary["cameras"] == 4
    assert summary["completeness"] == 100.0
    assert summary["verdict"] == dict.fromkeys(("good", "check", "reject"), 0) | Counter(
        line["verdict"] for line in lines_of(calibrated_folder)
    )
    assert summary["status"] == {"accepted": 4}
    assert 0.0 < summary["seconds"]["calibration"] < summary["seconds"]["total"]
    assert summary["milliseconds_per_frame"] == pytest.approx(250.0 * summary["seconds"]["calibration"])
    assert summary["version"] == fieldcalib.__version__
    assert summary["options"] == {
        "input": [str(annotated_folder)],
        "format": "jsonl",
        "size": [960, 540],
        "labels": None,
        "display_size": None,
        "aspect": "estimated",
        "crop_of": None,
        "field_size": "nominal",
        "same_field": False,
        "field": "soccer",
        "field_length": None,
        "field_width": None,
        "line_width": None,
        "crown": None,
        "prior": "all",
        "tau": None,
        "least_probability": None,
        "lens": "k1",
        "intrinsics": None,
        "position": None,
        "rotation": None,
        "camera_files": True,
    }


def test_the_total_time_is_that_of_everything(annotated_folder, tmp_path, monkeypatch):
    """Of the probabilities, the paper's loss and the files too."""

    def slow(function):
        def slept(*arguments, **options):
            time.sleep(0.3)
            return function(*arguments, **options)

        return slept

    monkeypatch.setattr(records_of_commands, "calibration_line", slow(records_of_commands.calibration_line))
    for name in ("ndc_loss", "compute_errors"):
        monkeypatch.setattr(commands_on_folders, name, slow(getattr(commands_on_folders, name)))
    assert calibrate(tmp_path, annotated_folder / "a.json") == 0
    seconds = summary_of(tmp_path)["seconds"]
    assert seconds["total"] - seconds["calibration"] > 0.9


def test_off_a_terminal_only_one_line_is_printed(annotated_folder, tmp_path, capsys):
    assert calibrate(tmp_path, annotated_folder / "a.json") == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    (line,) = lines_of(tmp_path)
    assert printed.out == f"1 camera of 1 frame in {tmp_path}: 1 {line['verdict']}\n"


def test_the_same_again_gives_the_same_files(annotated_folder, calibrated_folder, tmp_path):
    """Even where the results lie among the annotations."""
    for path in annotated_folder.glob("?.json"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    for _ in range(2):
        assert calibrate(tmp_path, tmp_path, options=["--overwrite"]) == 0
        assert cameras_in(tmp_path) == cameras_in(calibrated_folder)
        assert (tmp_path / "cameras.jsonl").read_bytes() == (calibrated_folder / "cameras.jsonl").read_bytes()


def test_a_zip_and_single_files(annotated_folder, calibrated_folder, tmp_path):
    with zipfile.ZipFile(tmp_path / "test.zip", "w") as archive:
        for path in annotated_folder.glob("[ab].json"):
            archive.write(path, f"test/{path.name}")
    inputs = annotated_folder / "d.json", tmp_path / "test.zip", annotated_folder / "c.json"
    assert calibrate(tmp_path / "out", *inputs) == 0
    assert [line["id"] for line in lines_of(tmp_path / "out")] == ["d", "a", "b", "c"]
    found = {line["id"]: line for line in lines_of(tmp_path / "out")}
    for line in lines_of(calibrated_folder):
        np.testing.assert_allclose(found[line["id"]]["K"], line["K"], rtol=1e-6)
        np.testing.assert_allclose(found[line["id"]]["C"], line["C"], atol=1e-4)
