"""The demo runs the product on a sample; samples show what their truth says."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

import fieldcalib
from fieldcalib.assess.probability import ground_in_view
from fieldcalib.cli.main import main
from fieldcalib.io import samples
from fieldcalib.io.boxes import foot_points
from fieldcalib.io.samples import read_cameras, read_positions
from fieldcalib.io.soccernet import parse_camera
from fieldcalib.io.videos import VideoReader, VideoWriter
from fieldcalib.metrics.cameras import camera_difference

SHOWN = (0, 1, 2, 30, 31, 32)


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """The clip, cut short: of either shot some frames, which `fieldcalib.sample` then gives."""
    whole, folder = fieldcalib.sample("clip"), tmp_path_factory.mktemp("samples")
    with VideoReader(whole) as video, VideoWriter(folder / whole.name, 30.0) as short:
        for number, image in enumerate(video):
            if number in SHOWN:
                short.write(image)
    lines = whole.with_suffix(samples.TRUTH).read_text().splitlines(keepends=True)
    (folder / whole.name).with_suffix(samples.TRUTH).write_text("".join(lines[number] for number in SHOWN))
    title, *rows = whole.with_name(samples.PLAYERS).read_text().splitlines(keepends=True)
    rows = [row.split(",", 1) for row in rows]
    kept = [f"{SHOWN.index(int(frame))},{rest}" for frame, rest in rows if int(frame) in SHOWN]
    (folder / samples.PLAYERS).write_text("".join([title, *kept]))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(samples, "FOLDER", folder)
        yield folder / whole.name


# samples


def test_a_clip_has_its_truth_beside_it():
    clip = fieldcalib.sample("clip")
    truths = read_cameras(clip.with_suffix(".jsonl"))
    assert [truth.shot for truth in truths] == 30 * [0] + 30 * [1]
    with VideoReader(clip) as video:
        assert [image.shape for image in video] == [(540, 960, 3)] * len(truths)


def test_boxes_are_off_as_is_said_of_boxes():
    """By 2 px in x and in y, which `fieldcalib project` assumes."""
    clip = fieldcalib.sample("clip")
    truths, places = read_cameras(clip.with_suffix(".jsonl")), read_positions(clip.with_name("players.csv"))
    assert len(places) > 30
    off = []
    for line in clip.with_name("players.csv").read_text().splitlines()[1:]:
        frame, track, team, *box, _, _ = line.split(",")
        X = np.append(places[int(frame), int(track)], 0.0)
        off.append(foot_points(list(map(float, box))) - truths[int(frame)].camera.project(X))
        assert team in ("blue", "red", "yellow", "orange")  # as their shirts
    np.testing.assert_allclose(np.std(off, axis=0), 2.0, atol=0.4)
    np.testing.assert_allclose(np.mean(off, axis=0), 0.0, atol=0.4)


def test_a_picture_shows_what_its_camera_sees():
    path = fieldcalib.sample("picture")
    truth = parse_camera(path.with_suffix(".json").read_bytes(), (960, 540))
    found = fieldcalib.calibrate(path, progress=False)["picture"]
    assert found.accepted
    X = ground_in_view(found.camera, fieldcalib.soccer())
    assert np.median(np.linalg.norm(found.camera.project(X) - truth.project(X), axis=1)) < 6.0


@pytest.mark.slow
def test_every_frame_of_the_sample_is_good():
    found = fieldcalib.calibrate(fieldcalib.sample("clip"), progress=False)
    assert {str(verdict) for verdict in found.verdicts.values()} == {"good"}


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
    assert "places of players, from boxes that are 2 px off: off by 0." in printed
    assert f"$ fieldcalib run {out}/clip.mp4 --out {out}/cameras --report" in printed


def test_the_demo_again_is_as_quick_as_reading(demo, monkeypatch, capsys):
    out, _ = demo
    before = (out / "cameras" / "cameras.jsonl").read_bytes()
    monkeypatch.setattr("fieldcalib.cli.clips.Clip.of", lambda *arguments, **options: pytest.fail("again"))
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
