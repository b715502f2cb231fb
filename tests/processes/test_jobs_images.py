"""Images on the command line with the network that comes along: by several processes, and gone on with."""

import zipfile

import cv2
import numpy as np
import pytest
from commands import lines_of, run
from killed import check_that_kills_change_nothing, content_of
from networks import FIELD
from views import camera

from fieldcalib.draw.scene import render_field


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    """A zip of images for three units, one of which is broken."""
    path = tmp_path_factory.mktemp("images") / "images.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for number, pan in enumerate(np.linspace(-30.0, 30.0, 18)):
            truth = camera(pan, 78, 1400, (0, 68, -17)).scaled((480, 270))
            picture = render_field(truth, FIELD, rng=np.random.default_rng(number))
            content = cv2.imencode(".jpg", picture)[1].tobytes()
            archive.writestr(f"{number:02d}.jpg", content[: len(content) // (2 if number == 11 else 1)])
    return path


@pytest.fixture(scope="module")
def whole(images, tmp_path_factory):
    """The output of an uninterrupted run."""
    out = tmp_path_factory.mktemp("whole") / "out"
    assert run("run", images, "--out", out) == 1
    return out


@pytest.mark.slow
def test_the_files_are_the_same_with_any_number_of_jobs(images, whole, tmp_path, capsys):
    assert run("run", images, "--out", tmp_path, "--jobs", 2) == 1
    assert content_of(tmp_path) == content_of(whole)
    assert "11.jpg: is cut off" in capsys.readouterr().err
    statuses = [line["status"] for line in lines_of(tmp_path)]
    assert statuses.count("accepted") > 12


def test_shards_together_are_the_whole(images, whole, tmp_path):
    for number in (1, 2):
        run("run", images, "--out", tmp_path / str(number), "--shard", f"{number}/2")
    assert run("join", tmp_path / "1", tmp_path / "2", "--out", tmp_path / "joined") == 1
    assert content_of(tmp_path / "joined") == content_of(whole)


@pytest.mark.slow
def test_localize(images, tmp_path, capsys):
    for name, options in (
        ("whole", []),
        ("jobs", ["--jobs", 2]),
        ("1", ["--shard", "1/2"]),
        ("2", ["--shard", "2/2"]),
    ):
        assert run("localize", images, "--out", tmp_path / name, *options) == (name != "1")
    assert run("localize", images, "--out", tmp_path / "whole") == 2
    assert "--resume goes on with it, --overwrite begins anew" in capsys.readouterr().err
    (tmp_path / "jobs" / "summary.json").unlink()
    (tmp_path / "jobs" / "17.json").unlink()
    assert run("localize", images, "--out", tmp_path / "jobs", "--resume") == 1
    assert run("join", tmp_path / "1", tmp_path / "2", "--out", tmp_path / "joined") == 1
    assert content_of(tmp_path / "jobs") == content_of(tmp_path / "whole") == content_of(tmp_path / "joined")
    assert len(list((tmp_path / "whole").glob("[0-9]*.json"))) == 17


@pytest.mark.slow
@pytest.mark.parametrize(("jobs", "seed"), [(2, 1), (2, 200), (1, 202)])
def test_kills_change_nothing(images, whole, tmp_path, jobs, seed):
    command = ["run", images, "--jobs", jobs]
    check_that_kills_change_nothing(command, whole, tmp_path / "out", np.random.default_rng(seed), code=1)
