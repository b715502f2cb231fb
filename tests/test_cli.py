"""The command line, on synthetic annotations: what it writes, prints and returns."""

import json
import os
import signal
import subprocess
import sys
import time
import zipfile
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import views
from synthetic import in_image, observe, random_frames, whole_circle_markings

import fieldcalib
import fieldcalib.cli.demo
from fieldcalib.calibrate.from_segments import calibrate_batch
from fieldcalib.cli import folder as commands_on_folders
from fieldcalib.cli.main import main
from fieldcalib.fields.soccer import soccer
from fieldcalib.fields.stands import DISTRIBUTIONS
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.formats import ANNOTATIONS
from fieldcalib.io.output_folder import output_folder
from fieldcalib.io.soccernet import camera_from_record, format_annotation

SIZE = (960, 540)
NAMES = ("c", "a", "d", "b")  # not in the order of the files
GOOD = ("a", "b", "c", "d")
CAMERA_KEYS = ["K", "dist", "R", "C", "angles_degrees"]
FITTED_KEYS = ["rms_px", "segment_errors_px", "suspect_labels", "loss_ndc", "alternatives"]
KEPT_KEYS = ["complaints", "pixel_counts", "image_size", "field", "solved", "version"]  # for reading results back
ACCURACY_KEYS = [
    "rms_as_labelled_px",
    "loss_ndc_eq3",
    "standard_deviations",
    "probability_right_0.5m",
    "probability_right_1m",
]
SIZE_KEYS = ["field_length", "field_width", "field_standard_deviations", "field_from_labels"]
BROKEN_KEYS = ["id", "status", "message"]
LINE_KEYS = [*BROKEN_KEYS, "verdict", "reason"]
WITHOUT_CAMERA = LINE_KEYS + [key for key in FITTED_KEYS if key not in ("rms_px", "loss_ndc")] + KEPT_KEYS
WITH_CAMERA = LINE_KEYS + CAMERA_KEYS + FITTED_KEYS + KEPT_KEYS + ACCURACY_KEYS


def run(*arguments):
    """Exit code of the command line."""
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as error:  # argparse ends so
        return error.code


def calibrate(out, *inputs, options=()):
    return run("calibrate", *inputs, "--size", "960x540", "--out", out, *options)


def lines_of(out):
    def no_constant(name):
        raise AssertionError(f"{name} is no JSON")

    text = (out / "cameras.jsonl").read_text()
    assert text.endswith("\n")
    return [json.loads(line, parse_constant=no_constant) for line in text.splitlines()]


def summary_of(out):
    return json.loads((out / "summary.json").read_text())


def cameras_in(out):
    return {path.stem.removeprefix("camera_"): path.read_bytes() for path in out.glob("camera_*.json")}


@pytest.fixture(scope="module")
def truth():
    """Frames and their true cameras by name."""
    frames, cameras = random_frames(4, seed=0, noise=0.5, stands=("main center",))
    return {name: (frame, camera) for name, frame, camera in zip(NAMES, frames, cameras, strict=True)}


@pytest.fixture(scope="module")
def folder(truth, tmp_path_factory):
    """Annotations of the four frames, and what else lies beside annotations."""
    path = tmp_path_factory.mktemp("annotations")
    for name, (frame, _) in truth.items():
        (path / f"{name}.json").write_text(format_annotation(frame, SIZE))
    (path / "match_info.json").write_text("{}")
    (path / "a.jpg").write_bytes(b"")
    return path


@pytest.fixture(scope="module")
def result(folder, tmp_path_factory):
    """The output of a plain run."""
    out = tmp_path_factory.mktemp("result") / "new" / "folder"
    assert calibrate(out, folder) == 0
    return out


# --- what is written ---


def test_files(result):
    expected = {f"camera_{name}.json" for name in GOOD} | {"cameras.jsonl", "summary.json"}
    assert {path.name for path in result.iterdir()} == expected


def test_camera_files_are_soccernets_and_right(result, truth):
    for name, (_, true_camera) in truth.items():
        camera = camera_from_record(json.loads((result / f"camera_{name}.json").read_text()), SIZE)
        assert np.all(np.abs(camera.principal_point - (480.0, 270.0)) < 0.04 * 960)  # two sigma of its prior
        assert np.linalg.norm(camera.C - true_camera.C) < 4.0
        pixel = np.array([480.0, 400.0])
        np.testing.assert_allclose(camera.project(true_camera.image_to_field(pixel)), pixel, atol=8.0)


def test_one_line_a_frame_in_the_order_of_the_input(result):
    lines = lines_of(result)
    assert [line["id"] for line in lines] == list(GOOD)
    for line in lines:
        assert list(line) == WITH_CAMERA
        assert line["status"] == "accepted"


def test_a_line_holds_the_camera_of_the_file(result, truth):
    for line in lines_of(result):
        camera = camera_from_record(json.loads((result / f"camera_{line['id']}.json").read_text()), SIZE)
        np.testing.assert_allclose(line["K"], camera.K)
        np.testing.assert_allclose(line["R"], camera.R, atol=1e-12)
        np.testing.assert_allclose(line["C"], camera.C)
        np.testing.assert_allclose(line["dist"], [*camera.k, 0.0, 0.0, 0.0])
        angles = np.degrees(camera.angles)
        np.testing.assert_allclose([line["angles_degrees"][name] for name in ("pan", "tilt", "roll")], angles)
        assert list(line["segment_errors_px"]) == list(truth[line["id"]][0])
        assert 0.0 < line["rms_px"] < 2.0
        assert 0.0 < line["loss_ndc"] < 0.019
        assert line["alternatives"] == []


def test_summary(result, folder):
    summary = summary_of(result)
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
        line["verdict"] for line in lines_of(result)
    )
    assert summary["status"] == {"accepted": 4}
    assert 0.0 < summary["seconds"]["calibration"] < summary["seconds"]["total"]
    assert summary["milliseconds_per_frame"] == pytest.approx(250.0 * summary["seconds"]["calibration"])
    assert summary["version"] == fieldcalib.__version__
    assert summary["options"] == {
        "input": [str(folder)],
        "size": [960, 540],
        "display_size": None,
        "crop_of": None,
        "field_size": "nominal",
        "field_length": 105.0,
        "field_width": 68.0,
        "free_field_size": None,
        "prior": "all",
        "tau": None,
        "least_probability": None,
        "lens": "k1",
    }


def test_the_total_time_is_that_of_everything(folder, tmp_path, monkeypatch):
    """Of the probabilities, the paper's loss and the files too."""

    def slow(function):
        def slept(*arguments, **options):
            time.sleep(0.3)
            return function(*arguments, **options)

        return slept

    for name in ("calibration_line", "ndc_loss", "whole_file"):
        monkeypatch.setattr(f"fieldcalib.cli.folder.{name}", slow(getattr(commands_on_folders, name)))
    assert calibrate(tmp_path, folder / "a.json") == 0
    seconds = summary_of(tmp_path)["seconds"]
    assert seconds["total"] - seconds["calibration"] > 0.9


def test_off_a_terminal_only_one_line_is_printed(folder, tmp_path, capsys):
    assert calibrate(tmp_path, folder / "a.json") == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    (line,) = lines_of(tmp_path)
    assert printed.out == f"1 camera of 1 frame in {tmp_path}: 1 accepted; 1 {line['verdict']}\n"


def test_the_same_again_gives_the_same_files(folder, result, tmp_path):
    """Even where the results lie among the annotations."""
    for path in folder.glob("?.json"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    for _ in range(2):
        assert calibrate(tmp_path, tmp_path) == 0
        assert cameras_in(tmp_path) == cameras_in(result)
        assert (tmp_path / "cameras.jsonl").read_bytes() == (result / "cameras.jsonl").read_bytes()


def test_a_zip_and_single_files(folder, result, tmp_path):
    with zipfile.ZipFile(tmp_path / "test.zip", "w") as archive:
        for path in folder.glob("[ab].json"):
            archive.write(path, f"test/{path.name}")
    assert calibrate(tmp_path / "out", folder / "d.json", tmp_path / "test.zip", folder / "c.json") == 0
    assert [line["id"] for line in lines_of(tmp_path / "out")] == ["d", "a", "b", "c"]
    found = {line["id"]: line for line in lines_of(tmp_path / "out")}
    for line in lines_of(result):
        np.testing.assert_allclose(found[line["id"]]["K"], line["K"], rtol=1e-6)
        np.testing.assert_allclose(found[line["id"]]["C"], line["C"], atol=1e-4)


# --- frames without a camera ---

BROKEN = {
    "cut": ('{"Middle line": [{"x"', "is no JSON"),
    "pixels": ('{"Middle line": [{"x": 480, "y": 20}]}', "'Middle line': coordinates up to 480 are not normalised"),
    "typo": ('{"Midle line": [{"x": 0.5, "y": 0.2}]}', "did you mean 'Middle line'?"),
}


@pytest.fixture
def mixed(folder, tmp_path):
    """Two good frames, an empty one, one with too little, and three broken files."""
    path = tmp_path / "mixed"
    path.mkdir()
    for name in "ab":
        (path / f"{name}.json").write_bytes((folder / f"{name}.json").read_bytes())
    (path / "empty.json").write_text("{}")
    (path / "lone.json").write_text('{"Middle line": [{"x": 0.5, "y": 0.2}, {"x": 0.5, "y": 0.8}]}')
    for name, (content, _) in BROKEN.items():
        (path / f"{name}.json").write_text(content)
    return path


def test_broken_files_are_named_and_the_others_calibrated(mixed, result, tmp_path, capsys):
    assert calibrate(tmp_path / "out", mixed) == 1
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == len(BROKEN)
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


def test_files_that_are_skipped_are_named(folder, tmp_path, capsys):
    for name in ("a.json", "camera_b.json", "summary_c.json", "d.jpg", "e.jpg", "f.jpg", "g.jpg"):
        (tmp_path / name).write_bytes((folder / "a.json").read_bytes())
    (tmp_path / "cameras.jsonl").write_text("of an earlier run")
    assert calibrate(tmp_path / "out", tmp_path) == 0
    assert capsys.readouterr().err == (
        "fieldcalib: skipped 2 .json (camera_b.json, summary_c.json), 4 .jpg (d.jpg, e.jpg, f.jpg, ...)\n"
    )


def test_a_frame_that_takes_too_much_memory_is_broken(folder, tmp_path, monkeypatch, capsys):
    def parse(content, size):
        if len(content) > 5000:
            raise MemoryError
        return {}

    monkeypatch.setattr("fieldcalib.cli.folder.ANNOTATIONS", replace(ANNOTATIONS, read=parse))
    (tmp_path / "a.json").write_text("{}")
    (tmp_path / "b.json").write_bytes(bytes(6000))
    assert calibrate(tmp_path / "out", tmp_path) == 1
    assert capsys.readouterr().err == f"fieldcalib: {tmp_path / 'b.json'}: there is not enough memory for it\n"
    assert [line["status"] for line in lines_of(tmp_path / "out")] == ["too few segments", "broken file"]


def test_files_that_are_too_large_are_broken(folder, tmp_path, capsys):
    (tmp_path / "a.json").write_bytes((folder / "a.json").read_bytes())
    (tmp_path / "b.json").write_bytes((folder / "b.json").read_bytes() + b" " * 100_000)
    assert calibrate(tmp_path / "out", tmp_path, options=["--max-megabytes", 0.1]) == 1
    assert "b.json: has more than 0.1 MB; --max-megabytes allows more" in capsys.readouterr().err
    assert list(cameras_in(tmp_path / "out")) == ["a"]
    assert calibrate(tmp_path / "out", tmp_path) == 0
    assert set(cameras_in(tmp_path / "out")) == {"a", "b"}


def test_names_that_are_too_long_are_broken(folder, tmp_path):
    for length in (236, 250):
        (tmp_path / f"{'a' * length}.json").write_bytes((folder / "a.json").read_bytes())
    assert calibrate(tmp_path / "out", tmp_path) == 1
    assert list(cameras_in(tmp_path / "out")) == ["a" * 236]
    assert {line["status"] for line in lines_of(tmp_path / "out")} == {"accepted", "broken file"}


def test_dense_labels_are_thinned_before_anything_is_done_with_them(truth, tmp_path, monkeypatch):
    frame, _ = truth["a"]
    label = next(label for label in frame if label != "Middle line")
    dense = {**frame, label: np.repeat(frame[label], 2000, axis=0)}
    (tmp_path / "a.json").write_text(format_annotation(frame, SIZE))
    (tmp_path / "dense.json").write_text(format_annotation(dense, SIZE))
    most = []

    def method(field, frames, *arguments, **options):
        most.extend(len(xy) for frame in frames for xy in frame.values())
        return calibrate_batch(field, frames, *arguments, **options)

    monkeypatch.setattr("fieldcalib.cli.calibrate.calibrate_batch", method)
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
    assert calibrate(tmp_path / "out", tmp_path) == 1
    summary = summary_of(tmp_path / "out")
    assert (summary["frames"], summary["cameras"], summary["completeness"]) == (1, 0, 0.0)


def test_a_frame_that_broke_since_loses_its_camera(folder, tmp_path):
    (tmp_path / "a.json").write_bytes((folder / "a.json").read_bytes())
    assert calibrate(tmp_path / "out", tmp_path) == 0
    assert list(cameras_in(tmp_path / "out")) == ["a"]
    (tmp_path / "a.json").write_text("{")
    assert calibrate(tmp_path / "out", tmp_path) == 1
    assert cameras_in(tmp_path / "out") == {}


# --- options ---


def test_tau_withholds_cameras_and_removes_those_of_an_earlier_run(folder, result, tmp_path):
    assert calibrate(tmp_path, folder) == 0
    (tmp_path / "camera_other.json").write_text("not of this run")
    losses = {line["id"]: line["loss_ndc"] for line in lines_of(result)}
    tau = float(np.median(list(losses.values())))
    assert calibrate(tmp_path, folder, options=["--tau", tau]) == 0
    kept = {name for name, loss in losses.items() if loss <= tau}
    assert 0 < len(kept) < 4
    assert set(cameras_in(tmp_path)) == kept | {"other"}
    assert {line["id"] for line in lines_of(tmp_path) if line["status"] == "rejected by tau"} == set(GOOD) - kept
    assert summary_of(tmp_path)["cameras"] == len(kept)
    assert summary_of(tmp_path)["options"]["tau"] == tau


def test_improbable_cameras_are_withheld_on_request(folder, result, tmp_path):
    probabilities = {line["id"]: line["probability_right_1m"] for line in lines_of(result)}
    least = float(np.median(list(probabilities.values())))
    assert calibrate(tmp_path, folder, options=["--least-probability", least]) == 0
    kept = {name for name, p in probabilities.items() if p >= least}
    assert 0 < len(kept) < 4
    assert set(cameras_in(tmp_path)) == kept
    improbable = [line for line in lines_of(tmp_path) if line["status"] == "probably wrong"]
    assert {line["id"] for line in improbable} == set(GOOD) - kept
    assert all(f"{probabilities[line['id']]:.2f}" in line["message"] for line in improbable)


def test_a_frame_says_how_sure_it_is(result, truth):
    for line in lines_of(result):
        camera, sigma = truth[line["id"]][1], line["standard_deviations"]
        assert np.all(np.abs(camera.C - line["C"]) < 5.0 * np.array(sigma["C"]))
        assert abs(camera.focal_length - line["K"][0][0]) < 5.0 * sigma["focal_length_px"]
        assert 0.0 <= line["probability_right_0.5m"] <= line["probability_right_1m"] <= 1.0


def test_the_other_side_is_written_where_it_fits(tmp_path):
    camera = fieldcalib.Camera.from_angles(0.0, 1.35, 0.0, 900.0, (0.0, 65.0, -16.0), SIZE)
    frame = {label: camera.project(soccer()[label].sample(1.0)) for label in ("Middle line", "Circle central")}
    inside = {label: xy[np.all((xy >= 0.0) & (xy < SIZE), axis=1)] for label, xy in frame.items()}
    (tmp_path / "a.json").write_text(format_annotation(inside, SIZE))
    assert calibrate(tmp_path / "out", tmp_path) == 0
    (line,) = lines_of(tmp_path / "out")
    (other,) = line["alternatives"]
    np.testing.assert_allclose(np.multiply(other["C"], (-1.0, -1.0, 1.0)), line["C"])
    assert line["probability_right_1m"] <= 0.5


def test_the_prior_matters(folder, result, tmp_path):
    found = {"all": cameras_in(result)}
    for prior in ("main center", "none", "opposite tribune"):
        assert calibrate(tmp_path / prior, folder, options=["--prior", prior]) == 0
        assert summary_of(tmp_path / prior)["options"]["prior"] == prior
        found[prior] = cameras_in(tmp_path / prior)
    assert found["none"] != found["all"]
    assert found["opposite tribune"] != found["all"]


def test_main_center_finds_the_true_cameras(folder, truth, tmp_path):
    assert calibrate(tmp_path, folder, options=["--prior", "main center"]) == 0
    for line in lines_of(tmp_path):
        assert np.linalg.norm(truth[line["id"]][1].C - line["C"]) < 4.0


def test_the_size_of_the_field(truth, tmp_path):
    """Annotations of a field of 90 x 60 m fit it better than they fit the default."""
    markings = whole_circle_markings(soccer(90.0, 60.0))
    for name, (_, camera) in truth.items():
        (tmp_path / f"{name}.json").write_text(format_annotation(observe(markings, camera), SIZE))
    size = ["--field-length", 90, "--field-width", 60]
    for out, options in (("default", []), ("true", size), ("length", size[:2]), ("width", size[2:])):
        assert calibrate(tmp_path / out, tmp_path, options=[*options, "--lens", "none"]) == 0
    rms = {out: [line["rms_px"] for line in lines_of(tmp_path / out)] for out in ("default", "true", "length", "width")}
    assert max(rms["true"]) < 0.1
    assert all(min(np.mean(rms[out]) for out in ("default", "length", "width")) > 5.0 * value for value in rms["true"])
    assert summary_of(tmp_path / "true")["options"]["field_length"] == 90.0
    assert summary_of(tmp_path / "true")["options"]["field_width"] == 60.0


@pytest.fixture
def small_pitch(truth, tmp_path):
    """Annotations of the four cameras on a field of 101 x 65 m, and a frame without any."""
    path, rng = tmp_path / "small", np.random.default_rng(0)
    path.mkdir()
    markings = whole_circle_markings(soccer(101.0, 65.0))
    for name, (_, camera) in truth.items():
        (path / f"{name}.json").write_text(format_annotation(observe(markings, camera, rng, 0.5), SIZE))
    (path / "empty.json").write_text("{}")
    return path


def sizes_in(out):
    return np.array([(line["field_length"], line["field_width"]) for line in lines_of(out)])


def test_one_size_of_the_field_for_all_frames(small_pitch, tmp_path, capsys):
    assert calibrate(tmp_path / "free", small_pitch, options=["--free-field-size", "shared"]) == 0
    printed = capsys.readouterr().out.splitlines()
    lines = lines_of(tmp_path / "free")
    for line in lines:
        assert list(line) == (WITH_CAMERA if "K" in line else WITHOUT_CAMERA) + SIZE_KEYS
        assert {key: line[key] for key in SIZE_KEYS} == {key: lines[0][key] for key in SIZE_KEYS}
    (length, width), *_ = sizes_in(tmp_path / "free")
    deviations = np.array(lines[0]["field_standard_deviations"])
    assert np.all(np.abs((length - 101.0, width - 65.0)) < 3.0 * deviations)
    assert np.all(deviations < 0.5)
    assert min(lines[0]["field_from_labels"]) > 0.95
    assert printed[0].startswith(f"length: {length:.2f} ± {deviations[0]:.2f} m from the labels; width: {width:.2f} ± ")
    assert printed[1].startswith("4 cameras of 5 frames")
    assert summary_of(tmp_path / "free")["options"]["free_field_size"] == "shared"
    # from there on it is as if the size had been known
    known = ["--field-length", length, "--field-width", width]
    for out, options in (("known", known), ("default", [])):
        assert calibrate(tmp_path / out, small_pitch, options=options) == 0
    assert cameras_in(tmp_path / "free") == cameras_in(tmp_path / "known")
    for key in ("rms_px", "loss_ndc", "loss_ndc_eq3"):
        free, known, default = (
            [line[key] for line in lines_of(tmp_path / out) if "K" in line] for out in ("free", "known", "default")
        )
        assert free == known
        assert np.mean(free) < 0.8 * np.mean(default)


def test_a_size_of_the_field_for_each_frame(small_pitch, tmp_path, capsys):
    assert calibrate(tmp_path / "all", small_pitch, options=["--free-field-size", "each"]) == 0
    assert capsys.readouterr().out.startswith("4 cameras of 5 frames")
    sizes = sizes_in(tmp_path / "all")
    assert len(set(map(tuple, sizes))) == 5
    ids = [line["id"] for line in lines_of(tmp_path / "all")]
    np.testing.assert_array_equal(sizes[ids.index("empty")], (105.0, 68.0))
    for id in ("a", "d"):
        assert calibrate(tmp_path / id, small_pitch / f"{id}.json", options=["--free-field-size", "shared"]) == 0
        assert lines_of(tmp_path / id) == [lines_of(tmp_path / "all")[ids.index(id)]]


def test_cameras_on_a_free_field_are_doubted_too(small_pitch, tmp_path):
    options = ["--free-field-size", "shared", "--least-probability", 1]
    assert calibrate(tmp_path, small_pitch, options=options) == 0
    assert cameras_in(tmp_path) == {}


def test_the_size_of_the_field_is_sought_near_the_given_one(small_pitch, tmp_path):
    known = ["--field-length", 99, "--field-width", 67]
    assert calibrate(tmp_path, small_pitch / "empty.json", options=["--free-field-size", "each", *known]) == 0
    np.testing.assert_array_equal(sizes_in(tmp_path), [(99.0, 67.0)])


def test_the_size_of_the_images(folder, result, tmp_path):
    """Annotations are relative: in larger images focal lengths are longer, everything else stays."""
    assert run("calibrate", folder, "--size", "1920X1080", "--out", tmp_path) == 0
    for small, large in zip(lines_of(result), lines_of(tmp_path), strict=True):
        assert large["K"][0][0] == pytest.approx(2.0 * small["K"][0][0], rel=5e-3)
        assert [large["K"][i][2] for i in range(2)] == pytest.approx(
            [2.0 * small["K"][i][2] for i in range(2)], abs=4.0
        )
        np.testing.assert_allclose(large["C"], small["C"], atol=0.5)


def test_a_field_of_known_size_is_trusted_more(folder, result, tmp_path):
    assert calibrate(tmp_path, folder, options=["--field-size", "known"]) == 0
    assert summary_of(tmp_path)["options"]["field_size"] == "known"
    for nominal, known in zip(lines_of(result), lines_of(tmp_path), strict=True):
        np.testing.assert_allclose(known["C"], nominal["C"], rtol=1e-9)
        assert np.all(np.array(known["standard_deviations"]["C"]) < nominal["standard_deviations"]["C"])
        assert known["probability_right_1m"] > nominal["probability_right_1m"]


# --- squashed and cropped pictures ---

WHOLE = views.camera(24, 78, 1400, (0, 68, -17), k=(0.06, 0.0))  # of 960 x 540
HALF, SQUARE = (480, 540), (640, 640)
DECLARED = {  # the camera of the picture, and what is said of it
    "squashed": (WHOLE.scaled(SQUARE), ["--display-size", "960x540"]),
    "right half": (WHOLE.cropped((480, 0), HALF), ["--crop-of", "960x540+480+0"]),
    "both": (
        WHOLE.cropped((480, 0), HALF).scaled(SQUARE),
        ["--display-size", "480x540", "--crop-of", "960x540+480+0"],
    ),
}


@pytest.mark.parametrize(("true_camera", "declaration"), DECLARED.values(), ids=DECLARED)
def test_squashed_and_cropped_pictures(true_camera, declaration, tmp_path):
    width, height = true_camera.image_size
    pixels = observe(whole_circle_markings(soccer()), true_camera, np.random.default_rng(0), 0.3, per_line=9)
    shown = {label: xy[in_image(xy, true_camera.image_size)] for label, xy in pixels.items()}
    (tmp_path / "a.json").write_text(format_annotation(shown, true_camera.image_size))
    options = ["--size", f"{width}x{height}", "--prior", "main center"]
    assert run("calibrate", tmp_path / "a.json", *options, *declaration, "--out", tmp_path / "out") == 0
    (line,) = lines_of(tmp_path / "out")
    found = camera_from_record(json.loads((tmp_path / "out" / "camera_a.json").read_text()), true_camera.image_size)
    np.testing.assert_allclose(found.K, line["K"])
    sigma = line["standard_deviations"]
    assert abs(found.focal_length - true_camera.focal_length) < 3.0 * sigma["focal_length_px"]
    assert np.all(np.abs(found.C - true_camera.C) < 3.0 * np.array(sigma["C"]))
    assert found.K[1, 1] / found.K[0, 0] == pytest.approx(true_camera.K[1, 1] / true_camera.K[0, 0])
    np.testing.assert_allclose(found.principal_point, true_camera.principal_point, atol=30.0)
    X = soccer()["Big rect. right main"].sample(1.0)
    visible = in_image(true_camera.project(X), true_camera.image_size)
    assert np.count_nonzero(visible) > 20
    np.testing.assert_allclose(found.project(X)[visible], true_camera.project(X)[visible], atol=0.6)
    assert line["loss_ndc_eq3"] < 0.005
    assert line["verdict"] == "good"


# --- wrong usage ---


@pytest.mark.parametrize("size", ["960", "960x", "960x540x3", "960,540", "axb", "0x540", "960x-540", "960.0x540"])
def test_wrong_sizes(folder, tmp_path, capsys, size):
    assert run("calibrate", folder, "--size", size, "--out", tmp_path) == 2
    assert "argument --size: expected " in capsys.readouterr().err


def test_an_unknown_prior(folder, tmp_path, capsys):
    assert calibrate(tmp_path / "out", folder, options=["--prior", "main centre"]) == 2
    message = capsys.readouterr().err
    assert "main centre" in message
    for name in (*DISTRIBUTIONS, "all", "none"):
        assert name in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--field-length", "40"], "no room for its penalty areas"),
        (["--field-width", "10"], "no room for its penalty areas"),
        (["--field-length", "long"], "argument --field-length: expected a positive number, got 'long'"),
        (["--tau", "0"], "argument --tau: expected a positive number, got '0'"),
        (["--tau", "low"], "argument --tau: expected a positive number, got 'low'"),
        (["--least-probability", "90"], "argument --least-probability: expected a number from 0 to 1, got '90'"),
        (["--lens", "fisheye"], "argument --lens: invalid choice"),
        (["--free-field-size", "both"], "argument --free-field-size: invalid choice"),
        (["--free-field-size", "shared", "--field-length", "85"], "90 to 120 x 45 to 90 m (law 1)"),
        (["--free-field-size", "each", "--field-size", "known"], "--field-size known leaves nothing to --free-field-"),
        (["--field-size", "unknown"], "argument --field-size: invalid choice"),
        (["--display-size", "16:9"], "argument --display-size: expected WIDTHxHEIGHT, as 960x540, got '16:9'"),
        (["--crop-of", "1920x1080"], "argument --crop-of: expected WIDTHxHEIGHT+X+Y, as 1920x1080+960+0, got '19"),
        (["--crop-of", "0x1080+0+0"], "argument --crop-of: expected positive numbers"),
        (["--crop-of", "1280x720+330+0"], "--size does not fit, with 960 x 540 pixels, into the frame of --crop-of 12"),
        (["--free-field-size", "shared", "--prior", "stacked"], "--prior stacked goes with --free-field-size each"),
    ],
)
def test_wrong_options(folder, tmp_path, capsys, options, message):
    assert calibrate(tmp_path / "out", folder, options=options) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert printed.out == ""


def test_wrong_inputs(tmp_path, capsys):
    (tmp_path / "none.zip").write_bytes(b"no zip")
    for path, message in (
        (tmp_path / "missing", "does not exist"),
        (tmp_path, "holds no annotation"),
        (tmp_path / "none.zip", "not a zip file"),
    ):
        assert calibrate(tmp_path / "out", path) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"fieldcalib: {path}")
        assert message in error


def test_an_output_folder_that_cannot_be(folder, tmp_path, monkeypatch, capsys):
    """It is known before the work, not after it."""
    monkeypatch.setattr("fieldcalib.cli.calibrate.calibrate_batch", lambda *_, **__: pytest.fail("has worked"))
    (tmp_path / "file").write_text("in the way")
    for out, message in ((tmp_path / "file", f"{tmp_path}/file is a file"), (tmp_path / "file" / "below", "[Errno ")):
        assert calibrate(out, folder / "a.json") == 2
        assert capsys.readouterr().err.startswith(f"fieldcalib: {message}")
    assert (tmp_path / "file").read_text() == "in the way"


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder that not even root can write to")
def test_an_output_folder_that_cannot_be_written_to(folder, monkeypatch, capsys):
    monkeypatch.setattr("fieldcalib.cli.calibrate.calibrate_batch", lambda *_, **__: pytest.fail("has worked"))
    assert calibrate("/proc/self", folder / "a.json") == 2
    assert "/proc/self" in capsys.readouterr().err


def test_an_output_folder_that_another_run_writes_to(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("fieldcalib.cli.calibrate.calibrate_batch", lambda *_, **__: pytest.fail("has worked"))
    with output_folder(tmp_path):
        assert calibrate(tmp_path, folder / "a.json") == 2
    assert capsys.readouterr().err.startswith(f"fieldcalib: another run writes to {tmp_path}: wait for its end")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [[], ["calibrate"], ["calibrate", "x"], ["demo"], ["guess"]])
def test_missing_arguments(capsys, arguments):
    assert run(*arguments) == 2
    assert "usage: fieldcalib" in capsys.readouterr().err


def test_help(capsys):
    assert run("calibrate", "--help") == 0
    printed = capsys.readouterr().out
    for word in ("--size", "--prior", "main center", "--tau", "0.019", "cameras.jsonl"):
        assert word in printed


# --- the other command, and the module itself ---


def test_demo(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(fieldcalib.cli.demo, "run_demo", partial(fieldcalib.cli.demo.run_demo, count=1))
    assert run("demo", "--out", tmp_path / "new") == 0
    written = {str(path.relative_to(tmp_path / "new")) for path in tmp_path.rglob("*") if path.is_file()}
    assert written == {"annotations/00.json", "frame_00.png", "overview.png", "true_cameras.json"}
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "overview.png shows them all" in printed.out


def test_it_runs_as_a_module():
    command = [sys.executable, "-m", "fieldcalib.cli.main", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (f"fieldcalib {fieldcalib.__version__}\n", "")


def in_a_process(code, *arguments, **environment):
    """A fresh interpreter that runs some code, and the command line after it."""
    command = [sys.executable, "-c", f"{code}\nfrom fieldcalib.cli.main import main\nraise SystemExit(main())"]
    return subprocess.run(
        [*command, *map(str, arguments)],
        capture_output=True,
        text=True,
        encoding="latin-1",
        env=os.environ | environment,
        cwd=Path(fieldcalib.__file__).parents[1],
    )


INTERRUPTED_IMPORT = """
import os, signal, sys
class Interrupting:
    def find_spec(name, path, target=None):
        if name == {name!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupting)
"""


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
@pytest.mark.parametrize("name", ["numpy", "numpy.linalg", "fieldcalib.cli.calibrate"])
def test_an_interrupt_during_the_start_leaves_no_traceback(name):
    # in the background of a shell this test itself ignores interrupts
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)" + INTERRUPTED_IMPORT.format(
        name=name
    )
    done = in_a_process(code, "--version")
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_an_interrupt_that_is_ignored_stays_so():
    """As for a job in the background of a shell."""
    code = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)" + INTERRUPTED_IMPORT.format(name="numpy")
    done = in_a_process(code, "--version")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_terminal_without_unicode(small_pitch, tmp_path):
    options = ("--size", "960x540", "--free-field-size", "shared", "--out", tmp_path / "out")
    done = in_a_process("", "calibrate", small_pitch / "a.json", *options, PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, "")
    assert r" \xb1 " in done.stdout  # ±


def test_no_memory_left_is_one_line(folder, tmp_path, monkeypatch, capsys):
    def exhausted(*arguments, **options):
        raise MemoryError

    monkeypatch.setattr("fieldcalib.cli.calibrate.calibrate_batch", exhausted)
    assert calibrate(tmp_path, folder / "a.json") == 2
    assert capsys.readouterr().err == "fieldcalib: there is not enough memory\n"
    assert list(tmp_path.iterdir()) == []


def test_a_size_that_squashes_the_frames_is_doubted(tmp_path, capsys):
    """Width and height swapped: annotations are normalised, so that only the geometry tells."""
    frames = tmp_path / "frames"
    frames.mkdir()
    pans = np.linspace(-0.4, 0.4, 6)
    for number, pan in enumerate(pans):
        camera = Camera.from_angles(pan, 1.3, 0.0, 900.0, (0.0, 66.0, -16.0), (960, 540))
        seen = observe(whole_circle_markings(soccer()), camera)
        points = {label: [{"x": x / 959.0, "y": y / 539.0} for x, y in xy.tolist()] for label, xy in seen.items()}
        (frames / f"{number}.json").write_text(json.dumps(points))
    assert main(["calibrate", str(frames), "--size", "960x540", "--out", str(tmp_path / "right")]) == 0
    assert "not square" not in capsys.readouterr().err
    assert main(["calibrate", str(frames), "--size", "540x960", "--out", str(tmp_path / "swapped")]) == 0
    assert "show pixels that are not square: is the size right?" in capsys.readouterr().err
