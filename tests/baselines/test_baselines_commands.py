"""The baselines' command lines, on synthetic annotations: what they write, and that others can read it."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from killed import content_of
from synthetic import random_frames

from baselines import dlt_lines, hdecomp, tvcalib
from fieldcalib.cli.main import main as fieldcalib_main
from fieldcalib.io.formats import CAMERAS, HOMOGRAPHIES
from fieldcalib.io.soccernet import camera_from_record, format_annotation
from fieldcalib.io.wc14 import format_homography, parse_homography
from fieldcalib.run_folder import work_units

SIZE = (960, 540)
SIZED = ("--size", "960x540", "--camera-files")
NAMES = ("a", "b", "c")
COMMANDS = {
    "dlt_lines": (dlt_lines.main, ()),
    "hdecomp": (hdecomp.main, ()),
    "tvcalib": (tvcalib.main, ("--steps", "30")),
}


# The commands share the code of jobs.
one_quickly = pytest.mark.parametrize(
    "name", ["dlt_lines", *(pytest.param(name, marks=pytest.mark.slow) for name in ("hdecomp", "tvcalib"))]
)


def run(main, *arguments):
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as error:  # argparse ends so
        return error.code


def pixels_of(camera, X):
    return camera.project(np.append(X, np.zeros((len(X), 1)), axis=1))


@pytest.fixture(scope="module")
def truth():
    frames, cameras = random_frames(3, seed=3, least_segments=7, stands=("main center",))
    return {name: (frame, camera) for name, frame, camera in zip(NAMES, frames, cameras, strict=True)}


@pytest.fixture(scope="module")
def folder(truth, tmp_path_factory):
    path = tmp_path_factory.mktemp("annotations")
    for name, (frame, _) in truth.items():
        (path / f"{name}.json").write_text(format_annotation(frame, SIZE))
    (path / "circle.json").write_text('{"Circle central": [{"x": 0.5, "y": 0.5}, {"x": 0.6, "y": 0.5}]}')
    return path


KNOWN_BY_OUR_SOLVER = {"are_annotated", "standard_deviations", "probability_right_0.5m", "probability_right_1m"}


@pytest.mark.parametrize("name", COMMANDS)
def test_files_are_those_of_fieldcalib_calibrate(name, folder, tmp_path, capsys):
    main, options = COMMANDS[name]
    assert run(main, folder, *SIZED, "--out", tmp_path / name, *options) == 0
    assert run(fieldcalib_main, "calibrate", folder, *SIZED, "--out", tmp_path / "ours") == 0
    lines, ours = (
        [json.loads(line) for line in (tmp_path / run / "cameras.jsonl").read_text().splitlines()]
        for run in (name, "ours")
    )
    assert [line["id"] for line in lines] == [line["id"] for line in ours] == ["a", "b", "c", "circle"]
    assert set(lines[0]) == set(ours[0]) - KNOWN_BY_OUR_SOLVER
    summaries = [json.loads((tmp_path / run / "summary.json").read_text()) for run in (name, "ours")]
    assert set(summaries[0]) == set(summaries[1])
    written = {path.stem for path in (tmp_path / name).glob("camera_*.json")}
    assert written == {f"camera_{line['id']}" for line in lines if "K" in line}
    assert {"camera_a", "camera_b", "camera_c"} <= written
    assert f"{len(written)} cameras of 4 frames" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["dlt_lines", "hdecomp"])
def test_noise_free_lines_give_the_camera(name, truth, folder, tmp_path):
    assert run(COMMANDS[name][0], folder, *SIZED, "--out", tmp_path) == 0
    for id, (_, camera) in truth.items():
        found = camera_from_record(json.loads((tmp_path / f"camera_{id}.json").read_text()))
        assert found.focal_length == pytest.approx(camera.focal_length, rel=1e-4)
        np.testing.assert_allclose(found.C, camera.C, atol=1e-2)
    assert not (tmp_path / "camera_circle.json").exists()


def test_homographies_are_written_in_wc14s_format_and_read_back(truth, folder, tmp_path):
    matrices, cameras = tmp_path / "matrices", tmp_path / "cameras"
    assert run(dlt_lines.main, folder, *SIZED, "--out", matrices) == 0
    files = {file.id: file for file in HOMOGRAPHIES.find([matrices])}
    assert set(files) == set(truth)
    X = np.array([[0.0, 0.0], [10.0, -30.0], [-20.0, 5.0]])
    for id, (_, camera) in truth.items():
        for size in (SIZE, (1280, 720)):
            H = parse_homography(files[id].read(), image_size=size)
            mapped = np.append(X, np.ones((3, 1)), axis=1) @ H.T
            expected = pixels_of(camera, X) * np.divide(size, SIZE)
            np.testing.assert_allclose(mapped[:, :2] / mapped[:, 2:], expected, atol=1e-3)
    assert run(hdecomp.main, matrices, "--homographies", *SIZED, "--out", cameras) == 0
    for id, (_, camera) in truth.items():
        found = camera_from_record(json.loads((cameras / f"camera_{id}.json").read_text()))
        np.testing.assert_allclose(found.C, camera.C, atol=1e-2)


@pytest.mark.slow
def test_homographies_are_decomposed_by_other_processes(truth, folder, tmp_path):
    assert run(dlt_lines.main, folder, *SIZED, "--out", tmp_path) == 0
    cameras, options = tmp_path / "cameras", ("--homographies", *SIZED, "--jobs", "2")
    assert run(hdecomp.main, tmp_path, *options, "--out", cameras) == 0
    assert {file.id for file in CAMERAS.find([cameras])} == set(truth)


def test_homographies_of_an_earlier_run_are_removed(folder, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    for name in "ab":
        (tmp_path / "elsewhere" / f"{name}_.json").write_bytes((folder / f"{name}.json").read_bytes())
    out = tmp_path / "out"
    assert run(dlt_lines.main, tmp_path / "elsewhere", *SIZED, "--out", out) == 0
    assert (out / "a_.homographyMatrix").exists()
    (out / "mine.homographyMatrix").write_text("of somebody else")
    assert run(dlt_lines.main, folder, *SIZED, "--out", out, "--overwrite") == 0
    assert {path.stem for path in out.glob("*.homographyMatrix")} == {"a", "b", "c", "mine"}


@pytest.mark.parametrize("alignment", ["chen", "jiang"])
def test_homographies_of_others(alignment, truth, tmp_path):
    matrices = tmp_path / "matrices"
    matrices.mkdir()
    for id, (_, camera) in truth.items():
        (matrices / f"{id}.homographyMatrix").write_text(
            format_homography(camera.homography, alignment, image_size=SIZE)
        )
    options = ("--homographies", "--alignment", alignment, *SIZED, "--out", tmp_path)
    assert run(hdecomp.main, matrices, *options) == 0
    for id, (_, camera) in truth.items():
        found = camera_from_record(json.loads((tmp_path / f"camera_{id}.json").read_text()))
        np.testing.assert_allclose(found.C, camera.C, atol=1e-3)


def test_broken_homographies_are_named(truth, tmp_path, capsys):
    matrices = tmp_path / "matrices"
    matrices.mkdir()
    (matrices / "a.homographyMatrix").write_text(format_homography(truth["a"][1].homography, image_size=SIZE))
    (matrices / "b.homographyMatrix").write_text("1 2 3")
    arguments = (matrices, "--homographies", *SIZED, "--out", tmp_path)
    assert run(hdecomp.main, *arguments) == 1
    assert "b.homographyMatrix" in capsys.readouterr().err
    lines = [json.loads(line) for line in (tmp_path / "cameras.jsonl").read_text().splitlines()]
    assert [line["status"] for line in lines] == ["accepted", "broken file"]
    strict = tmp_path / "strict"
    assert run(hdecomp.main, *arguments[:-1], strict, "--strict") == 1
    assert not strict.exists()


def test_a_frame_in_two_folders_is_noticed(truth, tmp_path, capsys):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        text = format_homography(truth["a"][1].homography, image_size=SIZE)
        (tmp_path / folder / "a.homographyMatrix").write_text(text)
    arguments = ("--homographies", *SIZED, "--out", tmp_path / "out")
    assert run(hdecomp.main, tmp_path / "one", tmp_path / "two", *arguments) != 0
    assert "are the same frame a" in capsys.readouterr().err
    assert not (tmp_path / "out" / "cameras.jsonl").exists()


def test_homographies_are_computed_once(folder, tmp_path, monkeypatch):
    calls = []

    def counted(*arguments):
        calls.append(arguments)
        return homographies(*arguments)

    homographies = dlt_lines.homographies
    monkeypatch.setattr(dlt_lines, "homographies", counted)
    assert run(dlt_lines.main, folder, *SIZED, "--out", tmp_path) == 0
    assert len(calls) == 1


@pytest.mark.parametrize("options", [("--zeta", "0"), ("--zeta", "x"), ("--tolerance", "-0.1"), ("--alignment", "sha")])
def test_wrong_options(options, folder, tmp_path):
    assert run(hdecomp.main, folder, *SIZED, "--out", tmp_path, *options) == 2


def test_zeta_decides_what_is_rejected(truth, tmp_path):
    """A homography that no camera has: squeezed along the rows, its decomposition is pixels off."""
    matrices = tmp_path / "matrices"
    matrices.mkdir()
    squeezed = np.diag([0.7, 1.0, 1.0]) @ truth["a"][1].homography
    (matrices / "a.homographyMatrix").write_text(format_homography(squeezed, image_size=SIZE))
    found = {}
    for zeta in ("1", "1000"):
        out = tmp_path / zeta
        assert run(hdecomp.main, matrices, "--homographies", "--zeta", zeta, *SIZED, "--out", out) == 0
        found[zeta] = (out / "camera_a.json").exists()
    assert found == {"1": False, "1000": True}


def test_tau_rejects(folder, tmp_path):
    arguments = (folder, *SIZED, "--out", tmp_path, "--steps", "30", "--tau", "1e-9")
    assert run(tvcalib.main, *arguments) == 0
    assert not list(tmp_path.glob("camera_*.json"))
    statuses = {json.loads(line)["status"] for line in (tmp_path / "cameras.jsonl").read_text().splitlines()}
    assert statuses == {"rejected by tau"}


@pytest.mark.slow
@one_quickly
def test_the_files_are_the_same_with_any_number_of_jobs(name, folder, tmp_path, monkeypatch):
    monkeypatch.setattr(work_units, "SMALLEST_UNIT", 1)
    main, options = COMMANDS[name]
    for jobs in (1, 2):
        arguments = (folder, *SIZED, "--out", tmp_path / str(jobs), *options, "--jobs", jobs)
        assert run(main, *arguments) == 0
    assert content_of(tmp_path / "1") == content_of(tmp_path / "2")


@pytest.mark.slow
@one_quickly
def test_modules_that_are_run_have_jobs_too(name, folder, tmp_path):
    """What they ask other processes for must not be of the script."""
    command = [sys.executable, "-m", f"baselines.{name}", folder, *SIZED, "--out", tmp_path, "--jobs", "2"]
    root = Path(dlt_lines.__file__).parents[1]
    subprocess.run([*command, *COMMANDS[name][1]], check=True, cwd=root, capture_output=True)
    assert len((tmp_path / "cameras.jsonl").read_text().splitlines()) == 4


# --- cameras of known type ---

TYPES = {
    "left": "Main camera left",
    "right": "Main camera right",
    "goal": "Main behind the goal",
    "other": "Spider camera",
}
STANDS = {"left": "main left", "right": "main right", "goal": "behind right goal", "other": "main center"}


@pytest.fixture(scope="module")
def stacked(tmp_path_factory):
    """A folder of frames whose cameras' types are known, and the true cameras."""
    path = tmp_path_factory.mktemp("stacked")
    cameras = {}
    for seed, (name, stand) in enumerate(STANDS.items()):
        (frame,), (camera,) = random_frames(1, seed=seed, noise=0.3, least_segments=6, stands=(stand,))
        (path / f"{name}.json").write_text(format_annotation(frame, SIZE))
        cameras[name] = camera
    (path / "match_info_cam_gt.json").write_text(
        json.dumps({f"{id}.jpg": {"camera": name} for id, name in TYPES.items()})
    )
    return path, cameras


def test_calibrate_uses_known_types(stacked, tmp_path):
    path, cameras = stacked
    assert run(fieldcalib_main, "calibrate", path, *SIZED, "--prior", "stacked", "--out", tmp_path) == 0
    for name, camera in cameras.items():
        found = camera_from_record(json.loads((tmp_path / f"camera_{name}.json").read_text()))
        assert np.linalg.norm(found.C - camera.C) < 0.1 * np.linalg.norm(camera.C)


def test_tvcalib_starts_from_known_types(stacked, tmp_path):
    path, _ = stacked
    found = {}
    for starts in ("center", "stacked", "argmin"):
        out = tmp_path / starts
        options = ("--steps", "20", "--initial-cameras", starts)
        assert run(tvcalib.main, path, *SIZED, "--out", out, *options) == 0
        lines = [json.loads(line) for line in (out / "cameras.jsonl").read_text().splitlines()]
        found[starts] = {line["id"]: (line["C"][0], line["loss_ndc"]) for line in lines}
    # in 20 steps a camera does not come far from where it starts
    assert found["stacked"]["left"][0] < -20.0 < found["center"]["left"][0]
    assert found["stacked"]["right"][0] > 20.0 > found["center"]["right"][0]
    assert found["stacked"]["other"] == pytest.approx(found["center"]["other"], rel=1e-9)  # in other company
    for name in TYPES:
        assert found["argmin"][name][1] <= min(found["center"][name][1], found["stacked"][name][1]) + 1e-12


@pytest.mark.parametrize("command", ["calibrate", "tvcalib"])
def test_known_types_must_be_known(command, folder, tmp_path, capsys):
    arguments = (folder, *SIZED, "--out", tmp_path)
    if command == "calibrate":
        assert run(fieldcalib_main, "calibrate", *arguments, "--prior", "stacked") == 2
    else:
        assert run(tvcalib.main, *arguments, "--initial-cameras", "stacked") == 2
    assert "match_info_cam_gt.json" in capsys.readouterr().err
