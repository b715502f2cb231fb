"""`fieldcalib export`: results of real frames in every format, some of the frames, gaps, and wrong usage."""

import csv
import io
import json

import pytest
from commands import SIZE, calibrate, run, write_two_annotations
from other_tools import (
    EXACT,
    MOST,
    by_blender,
    by_freed,
    by_gamestate,
    farthest,
    without_lens,
    without_lens_and_principal_point,
)

from fieldcalib import Camera
from fieldcalib.assess.findings import Finding, What
from fieldcalib.cli.export import FORMATS, LOST
from fieldcalib.io.exports.colmap import colmap_files
from fieldcalib.io.exports.homography import homography_files
from fieldcalib.io.exports.table import table_files
from fieldcalib.io.soccernet import parse_camera
from fieldcalib.io.tvcalib import parse_per_sample_output
from fieldcalib.results.entry import read
from fieldcalib.solve.from_homography import on_level_ground


@pytest.fixture(scope="module")
def real_folder(shared_data, tmp_path_factory):
    """100 calibrated frames."""
    out = tmp_path_factory.mktemp("real")
    files = sorted(f for f in (shared_data / "sncalib-test-center").glob("*.json") if f.stem.isdigit())[:100]
    assert calibrate(out, *files) == 0
    return out


def exported(folder, out, format, *options):
    assert run("export", folder, "--format", format, "--out", out, "--keep-rejected", *options) == 0
    return {path.name: path.read_bytes() for path in out.iterdir()}


@pytest.mark.parametrize(  # of those that hold the whole camera others tell by default
    "format", [*(pytest.param(name, marks=pytest.mark.slow) for name in (*EXACT, "blender", "freed")), "gsr"]
)
def test_a_hundred_real_frames(real_folder, tmp_path, format):
    results = read(real_folder)
    expected = {id: one.camera for id, one in results.items() if one.camera is not None}
    assert len(expected) > 95
    files = exported(real_folder, tmp_path / "out", format)
    most, scale = MOST, 1.0
    if format == "blender":
        found = by_blender(files)
        expected = {id: without_lens(camera) for id, camera in expected.items()}
    elif format == "freed":
        found = dict(zip(results, by_freed(files["camera.freed"], (960, 540)), strict=True))
        expected = {id: without_lens_and_principal_point(camera) for id, camera in expected.items()}
        most = 0.05
    elif format == "gsr":
        found, scale = by_gamestate(files), 2.0
    else:
        found = EXACT[format][1](files)
    errors = [farthest(found[id], camera, scale) for id, camera in expected.items()]
    assert max(errors) < most


@pytest.mark.parametrize("format", sorted(FORMATS.keys() - {"rerun"}))  # it needs an extra: see test_export_rerun
def test_the_command(format, calibrated_folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert exported(calibrated_folder, out, format)
    printed = capsys.readouterr()
    assert printed.out == f"4 cameras of 4 frames in {out}\n"
    assert ("without it the image moves by up to" in printed.err) == (format in LOST)
    assert ("cameras of one rig" in printed.err) == (format == "toml")
    assert run("export", calibrated_folder, "--format", format, "--out", out) == 2
    assert "already: give --overwrite" in capsys.readouterr().err
    assert run("export", calibrated_folder, "--format", format, "--out", out, "--overwrite") == 0


def test_the_command_takes_some_frames(calibrated_folder, tmp_path):
    assert list(exported(calibrated_folder, tmp_path / "1", "opencv", "--frames", "b")) == ["b.yml"]
    assert set(exported(calibrated_folder, tmp_path / "2", "opencv")) == {"a.yml", "b.yml", "c.yml", "d.yml"}


def test_the_table_has_what_the_run_says(calibrated_folder, tmp_path):
    content = exported(calibrated_folder, tmp_path / "out", "csv")["cameras.csv"].decode()
    for row in csv.DictReader(io.StringIO(content)):
        line = next(line for line in read(calibrated_folder).lines if line["id"] == row["id"])
        assert (row["status"], row["verdict"], float(row["rms_px"])) == (
            line["status"],
            line["verdict"],
            line["rms_px"],
        )


def test_tvcalib_gets_the_loss(calibrated_folder, tmp_path):
    records = parse_per_sample_output(
        exported(calibrated_folder, tmp_path / "out", "tvcalib")["per_sample_output.json"]
    )
    assert {one.id: one.loss_ndc_total for one in records} == {
        id: found.loss_ndc for id, found in read(calibrated_folder).items()
    }


def test_a_file_of_results_will_do(calibrated_folder, tmp_path):
    folder = rewritten(calibrated_folder, tmp_path / "results")
    assert run("export", folder / "cameras.jsonl", "--format", "freed") == 0
    assert len((folder / "freed" / "camera.freed").read_bytes()) == 4 * 29


def rewritten(folder, out, **changes):
    """The results of a folder with other values in the line of frame a."""
    out.mkdir()
    lines = [json.loads(line) for line in (folder / "cameras.jsonl").read_text().splitlines()]
    changed = [line | changes if line["id"] == "a" else line for line in lines]
    (out / "cameras.jsonl").write_text("".join(json.dumps(line) + "\n" for line in changed))
    return out


def test_rejected_cameras_are_gaps(calibrated_folder, tmp_path, capsys):
    folder = rewritten(calibrated_folder, tmp_path / "results", verdict="reject")
    assert run("export", folder, "--format", "opencv") == 0
    assert sorted(path.name for path in (folder / "opencv").iterdir()) == ["b.yml", "c.yml", "d.yml"]
    printed = capsys.readouterr()
    assert printed.out == f"3 cameras of 4 frames in {folder / 'opencv'}\n"
    assert '1 camera left out, whose verdict is "reject"; --keep-rejected' in printed.err
    assert "a.yml" in exported(folder, tmp_path / "all", "opencv")


def test_cameras_of_which_only_the_ground_is_known_are_said(calibrated_folder, tmp_path, capsys):
    folder = rewritten(calibrated_folder, tmp_path / "above", findings=[Finding(What.GROUND_ONLY).to_dict()])
    for one, is_said in ((folder, True), (calibrated_folder, False)):
        exported(one, tmp_path / f"out {is_said}", "opencv")
        assert (str(Finding(What.GROUND_ONLY)) in capsys.readouterr().err) == is_said


def test_broken_frames_are_gaps(calibrated_folder, tmp_path):
    folder = rewritten(calibrated_folder, tmp_path / "results", status="broken file")
    assert "a.yml" not in exported(folder, tmp_path / "out", "opencv")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--format", "colmap", "--fps", "25"], "--fps is of blender, not of colmap"),
        (["--format", "csv", "--sensor-width", "9.6"], "--sensor-width is of blender and freed, not of csv"),
        (["--format", "opencv", "--frames", "a", "x", "y"], "has no frame x, y, its frames are a to d"),
        (["--format", "ply"], "invalid choice: 'ply'"),
        ([], "--format"),
        (["--format", "colmap", "--image-names", "x.png"], "expected a name with <id> in it"),
    ],
)
def test_wrong_usage_is_said(calibrated_folder, tmp_path, capsys, options, message):
    assert run("export", calibrated_folder, *options, "--out", tmp_path / "out") == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_folder_without_results_is_said(tmp_path, capsys):
    assert run("export", tmp_path, "--format", "csv") == 2
    assert "expected the folder that a run wrote" in capsys.readouterr().err


@pytest.mark.parametrize("files_of", [table_files, homography_files, colmap_files])
def test_names_that_are_not_utf8_are_escaped(files_of):
    """As on stderr: two that differ in such a byte alone stay two."""
    camera = Camera.from_angles(0.1, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    files = files_of(dict.fromkeys(("T\udcfcrkei", "T\udcfdrkei"), camera))
    text = "".join(content.decode() for name, content in files.items() if not name.endswith(".npz"))
    assert "T\\udcfcrkei" in text
    assert "T\\udcfdrkei" in text


def test_an_id_that_leads_elsewhere_is_no_name_of_a_file(calibrated_folder, tmp_path, capsys):
    folder = rewritten(calibrated_folder, tmp_path / "results", id="../a")
    assert run("export", folder, "--format", "opencv", "--keep-rejected") == 2
    assert "'../a.yml' is no name of a file" in capsys.readouterr().err


def test_programs_of_level_fields_get_cameras_on_level_ground(tmp_path):
    out = tmp_path / "out"
    options = "--size", "960x540", "--crown", "0.3", "--camera-files"
    assert run("calibrate", write_two_annotations(tmp_path / "labels"), "--out", out, *options) == 0
    written = {path.name: path.read_bytes().strip() for path in out.glob("camera_*.json")}
    assert {name: of.strip() for name, of in exported(out, tmp_path / "files", "soccernet").items()} == written
    for id, found in read(out).items():
        file = parse_camera(written[f"camera_{id}.json"], SIZE)
        assert farthest(file.project, on_level_ground(found.camera, found.field)) < 1e-6
        assert farthest(file.project, found.camera) > 1.0
