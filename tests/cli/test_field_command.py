"""Other fields than soccer's on the command line."""

import json
from dataclasses import replace
from pathlib import Path
from shutil import copy

import cv2
import numpy as np
import pytest
from commands import lines_of, run

from fieldcalib import Camera, soccer
from fieldcalib.fields import tennis
from fieldcalib.fields.segments import Point
from fieldcalib.io.field_files import write_field
from fieldcalib.io.soccernet import format_annotation
from fieldcalib.localize.network import SHIPPED
from fieldcalib.results.entry import read

SIZE = (1280, 720)
TRUTH = Camera.from_angles(np.pi / 2.0, 1.2, 0.0, 1500.0, (-30.0, 0.0, -8.0), SIZE)


def labelled(camera, field):
    pixels = {label: camera.project(segment.sample(1.0)) for label, segment in field.items()}
    inside = {label: xy[np.all((xy > 0) & (xy < np.array(SIZE) - 1), axis=1)] for label, xy in pixels.items()}
    return {label: xy for label, xy in inside.items() if len(xy) > 1}


@pytest.fixture
def court(tmp_path):
    """A frame of a tennis court."""
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "a.json").write_text(format_annotation(labelled(TRUTH, tennis()), SIZE))
    return folder


@pytest.fixture
def own(tmp_path):
    write_field(tmp_path / "own.yaml", tennis())
    return tmp_path / "own.yaml"


def calibrate(court, out, *options):
    return run("calibrate", court, "--size", "1280x720", "--out", out, *options)


def test_a_court_by_name_and_by_file(court, own, tmp_path, capsys):
    assert calibrate(court, tmp_path / "named", "--field", "tennis") == 0
    assert calibrate(court, tmp_path / "own", "--field", own) == 0
    (named,), (of_file,) = lines_of(tmp_path / "named"), lines_of(tmp_path / "own")
    assert named["verdict"] == "good"
    np.testing.assert_allclose(named["C"], TRUTH.C, atol=0.05)
    assert named["C"] == of_file["C"]
    assert read(tmp_path / "own")["a"].field == tennis()
    capsys.readouterr()
    assert run("evaluate", tmp_path / "named", court, "--field", "tennis", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["AC"]["5"] == 100.0
    assert "Net bottom" in report["segments"]


@pytest.mark.parametrize("method", ["baselines.dlt_lines", "baselines.tvcalib"])
def test_baselines_take_it_too(court, tmp_path, method):
    from importlib import import_module

    out = tmp_path / "out"
    options = ["--size", "1280x720", "--field", "tennis", "--out", str(out)]
    assert import_module(method).main([str(court), *options]) == 0
    assert len(lines_of(out)) == 1


def test_another_file_is_another_run(court, own, tmp_path, capsys):
    out = tmp_path / "out"
    assert calibrate(court, out, "--field", own) == 0
    own.write_text(own.read_text() + "# changed\n")
    assert calibrate(court, out, "--field", own, "--resume") == 2
    assert "have other sizes or times" in capsys.readouterr().err


def test_a_folder_with_the_name_of_a_sport_is_no_field(court, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert calibrate(court, "tennis", "--field", "tennis") == 0
    (tmp_path / "tennis" / "notes.txt").write_text("of somebody else")
    assert calibrate(court, "tennis", "--field", "tennis", "--resume") == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--field", "golf"], "argument --field: expected american-football-ncaa, "),
        (["--field", "none.yaml"], "fieldcalib: none.yaml: cannot be read"),
        (["--field", "tennis", "--field-length", "20"], "--field tennis has one size, 23.77 x 10.97 m"),
        (["--field", "tennis", "--prior", "umpire"], "--prior umpire: expected all, main center, "),
    ],
)
def test_what_cannot_be(court, tmp_path, capsys, options, message):
    assert calibrate(court, tmp_path / "out", *options) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"stands": ()}, "the field has no `stands`"),
        ({"segments": {"Corner": Point((0.0, 0.0, 0.0))}, "paint": {}}, "the field has no lines to search for"),
    ],
)
def test_only_labels_do_without_stands_and_lines(court, tmp_path, capsys, parts, says):
    path, picture = tmp_path / "own.yaml", tmp_path / "a.png"
    write_field(path, replace(tennis(), **parts))
    cv2.imwrite(str(picture), np.zeros((540, 960, 3), np.uint8))
    assert run("run", picture, "--field", path, "--out", tmp_path / "run") == 2
    assert says in capsys.readouterr().err


@pytest.mark.parametrize("prior", ["all", "none"])
def test_labels_need_no_stands(court, tmp_path, prior):
    path, out = tmp_path / "own.yaml", tmp_path / "out"
    write_field(path, replace(tennis(), stands=()))
    assert calibrate(court, out, "--field", path, "--prior", prior) == 0
    (found,) = read(out).values()
    assert found.verdict == "good"
    assert np.linalg.norm(found.camera.C - TRUTH.C) < 1.0
    is_in_the_middle = np.array_equal(found.camera.principal_point, np.divide(SIZE, 2.0))
    assert is_in_the_middle == (prior == "none")


def test_a_field_that_was_edited_has_one_size(court, tmp_path, capsys):
    path = tmp_path / "own.yaml"
    write_field(path, soccer())
    path.write_text(path.read_text().replace("Middle line", "Halfway line"))
    assert calibrate(court, tmp_path / "out", "--field", path, "--field-length", "100") == 2
    assert f"--field {path} has one size, 105 x 68 m" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["run", "localize"])
def test_a_network_for_another_field(tmp_path, capsys, command):
    (tmp_path / "a.png").write_bytes(b"")
    if command == "localize":
        assert run(command, tmp_path / "a.png", "--field", "tennis", "--out", tmp_path / "out") == 2
        said = capsys.readouterr().err
        assert "knows soccer fields only: --field tennis needs one that was trained for it, --model" in said
        assert not (tmp_path / "out").exists()
    model = tmp_path / "mine.onnx"
    copy(Path(SHIPPED), model)
    copy(Path(SHIPPED).with_suffix(".json"), model.with_suffix(".json"))
    assert run(command, tmp_path / "a.png", "--field", "tennis", "--model", model, "--out", tmp_path / "out") == 2
    assert f"which is a class of --model {model}: give the field that it was trained for" in capsys.readouterr().err


def test_a_prior_that_is_none_of_the_fields(tmp_path, capsys):
    (tmp_path / "a.png").write_bytes(b"")
    assert run("run", tmp_path / "a.png", "--field", "tennis", "--prior", "x", "--out", tmp_path / "out") == 2
    assert "--prior x: expected all" in capsys.readouterr().err
