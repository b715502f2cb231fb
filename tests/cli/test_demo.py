"""The demo runs the product on a sample; samples are rendered once, whole or not at all."""

import json
import os
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

import fieldcalib
from fieldcalib.assess.probability import ground_in_view
from fieldcalib.cli.main import main
from fieldcalib.io.soccernet import parse_camera
from fieldcalib.io.videos import VideoReader
from fieldcalib.metrics.distance import camera_difference
from fieldcalib.synthetic import sample_files, samples
from fieldcalib.synthetic.film import read_cameras
from fieldcalib.synthetic.sample_files import read_positions


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """An empty cache, and a clip that is short: it is cut after some frames."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("XDG_CACHE_HOME", str(folder))
        patched.setattr(sample_files, "STRETCHES", ((0, 3), (60, 63)))
        samples._cache.cache_clear()
        yield folder / "fieldcalib"
    samples._cache.cache_clear()


@pytest.fixture(scope="module")
def clip(cache):
    return fieldcalib.sample("clip", progress=False)


# samples


def test_a_clip_has_its_truth_beside_it(clip, cache):
    assert clip.parent.parent == cache
    truths = read_cameras(clip.with_suffix(".jsonl"))
    assert [truth.shot for truth in truths] == sorted(truth.shot for truth in truths)
    assert truths[-1].shot == 1
    with VideoReader(clip) as video:
        assert [image.shape for image in video] == [(540, 960, 3)] * len(truths)


def test_the_feet_of_boxes_are_at_the_true_places(clip):
    truths, places = read_cameras(clip.with_suffix(".jsonl")), read_positions(clip.with_name("players.csv"))
    assert len(places) > 30
    lines = clip.with_name("players.csv").read_text().splitlines()[1:]
    for line in lines:
        frame, track, team, *box, _, _ = line.split(",")
        left, _, right, bottom = map(float, box)
        found = truths[int(frame)].camera.image_to_field([(left + right) / 2.0, bottom])
        np.testing.assert_allclose(found[:2], places[int(frame), int(track)], atol=0.05)
        assert team in ("home", "away", "home keeper", "away keeper", "referee")


def test_a_sample_is_rendered_once(clip, monkeypatch):
    monkeypatch.setattr(sample_files, "make", lambda *arguments: pytest.fail("rendered again"))
    assert fieldcalib.sample("clip", progress=False) == clip


def test_a_picture_shows_what_its_camera_sees(cache):
    path = fieldcalib.sample("picture", progress=False)
    truth = parse_camera(path.with_suffix(".json").read_bytes(), (960, 540))
    found = fieldcalib.calibrate(path, progress=False)["picture"]
    assert found.accepted
    X = ground_in_view(found.camera, fieldcalib.soccer())
    assert np.median(np.linalg.norm(found.camera.project(X) - truth.project(X), axis=1)) < 6.0


def test_a_sample_that_cannot_be_written_leaves_nothing(cache, monkeypatch):
    folder = cache / f"picture-{samples._digest()}"
    shutil.rmtree(folder, ignore_errors=True)

    def fail(*arguments):
        raise OSError("disk full")

    with monkeypatch.context() as patched:
        patched.setattr(sample_files, "write_text", fail)
        with pytest.raises(OSError, match="disk full"):
            fieldcalib.sample("picture", progress=False)
    assert not [path for path in cache.iterdir() if "picture" in path.name]


def test_two_that_render_at_once_agree(cache, monkeypatch):
    folder = cache / f"picture-{samples._digest()}"
    shutil.rmtree(folder, ignore_errors=True)
    write_text = sample_files.write_text

    def overtaken(path, text):
        write_text(path, text)
        shutil.copytree(path.parent, folder)

    monkeypatch.setattr(sample_files, "write_text", overtaken)
    assert fieldcalib.sample("picture", progress=False).is_file()
    assert [path.name for path in cache.iterdir() if "picture" in path.name] == [folder.name]


def test_where_nothing_can_be_kept_there_is_a_temporary_folder(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    samples._cache.cache_clear()
    try:
        folder = samples._cache()
        assert folder.is_dir()
        assert samples._cache() == folder
        os.rmdir(folder)
    finally:
        samples._cache.cache_clear()


def test_unknown_samples():
    with pytest.raises(ValueError, match='expected "clip" or "picture", got \'movie\''):
        fieldcalib.sample("movie")


# the demo


@pytest.fixture(scope="module")
def demo(clip, tmp_path_factory):
    """The folder of a demo, and what was printed."""
    from contextlib import redirect_stdout
    from io import StringIO

    out = tmp_path_factory.mktemp("demo") / "new"
    with redirect_stdout(StringIO()) as printed:
        assert main(["demo", "--out", str(out)]) == 0
    return out, printed.getvalue()


def test_what_the_demo_writes(demo):
    out, printed = demo
    names = {"clip.mp4", "clip.jsonl", "players.csv", "cameras", "players_in_metres.csv", "map.mp4"}
    assert {path.name for path in out.iterdir()} == names
    for name in ("overlay.mp4", "motion.png", "report.html", "cameras.jsonl"):
        assert (out / "cameras" / name).is_file()
        assert str(out / "cameras" / name) in printed or name == "cameras.jsonl"
    with VideoReader(out / "map.mp4") as video:
        assert sum(1 for _ in video) == 6


def test_the_errors_that_the_demo_prints(demo):
    out, printed = demo
    lines = printed.splitlines()
    title = next(number for number, line in enumerate(lines) if line.startswith("shot  frames"))
    rows = [line.split() for line in lines[title + 1 : title + 3]]
    assert [row[0] for row in rows] == ["1", "2"]
    truths, results = read_cameras(out / "clip.jsonl"), fieldcalib.read(out / "cameras")
    errors = [
        camera_difference(results.cameras[f"{number:06d}"], truth.camera, fieldcalib.soccer()).reprojection
        for number, truth in enumerate(truths)
        if truth.shot == 0
    ]
    assert float(rows[0][-1]) == pytest.approx(max(errors), abs=0.006)
    assert "places of players, from their boxes: off by 0." in printed
    assert f"$ fieldcalib run {out}/clip.mp4 --out {out}/cameras --report" in printed


def test_the_demo_again_is_as_quick_as_reading(demo, monkeypatch, capsys):
    out, _ = demo
    before = (out / "cameras" / "cameras.jsonl").read_bytes()
    monkeypatch.setattr("fieldcalib.cli.clips.calibrate_clip", lambda *arguments, **options: pytest.fail("again"))
    assert main(["demo", "--out", str(out)]) == 0
    assert (out / "cameras" / "cameras.jsonl").read_bytes() == before
    assert "Next, try" in capsys.readouterr().out


def test_another_clip_of_that_name_is_kept(clip, tmp_path, capsys):
    (tmp_path / "clip.mp4").write_bytes(b"mine")
    assert main(["demo", "--out", str(tmp_path)]) == 2
    assert "is there already, and not that of the demo" in capsys.readouterr().err
    assert (tmp_path / "clip.mp4").read_bytes() == b"mine"


def test_a_frame_without_camera_does_not_spoil_the_table(demo):
    from fieldcalib.cli.demo import _table

    out, _ = demo
    truths, results = read_cameras(out / "clip.jsonl"), fieldcalib.read(out / "cameras")
    lines = [json.loads(line) for line in (out / "cameras" / "cameras.jsonl").read_text().splitlines()]
    assert len(lines) == len(truths)

    some = {id: None if id == "000000" else camera for id, camera in results.cameras.items()}
    row = _table(SimpleNamespace(cameras=some), truths).splitlines()[4].split()
    assert int(row[2]) == int(row[1]) - 1
    assert np.isfinite([float(cell) for cell in row[3:]]).all()
