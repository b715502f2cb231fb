"""Clips, and videos whose frames are calibrated by themselves, that are gone on with."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import lines_of, run
from killed import content_of
from networks import FIELD, KnownPictures
from waiting import wait_until

import fieldcalib
from fieldcalib import Camera, calibrate_video
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.draw.scene import render_field
from fieldcalib.images.clip import from_video
from fieldcalib.io.videos import VideoWriter
from fieldcalib.processes import Processes

TRUTHS = [
    Camera.from_angles(pan, 1.32, 0.0, 475.0, (1.0, 66.0, -16.0), (480, 270)) for pan in np.linspace(0.1, 0.36, 26)
]


@pytest.fixture(scope="module")
def rendered():
    return [render_field(camera, FIELD, rng=np.random.default_rng(0)) for camera in TRUTHS]


def written(images, path):
    with VideoWriter(path, 25.0) as video:
        for image in images:
            video.write(image)
    return path


@pytest.fixture(scope="module")
def video(rendered, tmp_path_factory):
    return written(rendered, tmp_path_factory.mktemp("video") / "clip.mp4")


@pytest.fixture(autouse=True)
def small_parts(monkeypatch):
    """Parts of some frames."""
    monkeypatch.setattr(from_video, "PART", 9)


@pytest.fixture
def network(rendered, monkeypatch):
    """A network that knows the pictures."""
    known = KnownPictures(rendered, TRUTHS)
    monkeypatch.setattr("fieldcalib.cli.clips.load_network", lambda options: known)
    return known


class Interrupting:
    """Raises a KeyboardInterrupt at the n-th call of a function, before it."""

    def __init__(self, function, count):
        self.function, self.left = function, count

    def __call__(self, *arguments, **options):
        if not self.left:
            raise KeyboardInterrupt
        self.left -= 1
        return self.function(*arguments, **options)


@pytest.fixture(scope="module")
def whole(video, rendered, tmp_path_factory):
    """What an uninterrupted run writes."""
    out = tmp_path_factory.mktemp("whole") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(from_video, "PART", 9)
        patch.setattr("fieldcalib.cli.clips.load_network", lambda options: KnownPictures(rendered, TRUTHS))
        assert run("run", video, "--out", out) == 0
    return out


def test_parts_that_are_kept_are_not_calibrated_again(rendered, network, monkeypatch):
    kept, rendered = {}, rendered[:18]
    whole = calibrate_video(FIELD, rendered, network, parts=kept)
    assert len(kept) == 2
    assert sum(map(len, kept.values())) == len(rendered)
    read_back = {index: VideoCalibration.from_dict(part.to_dict()) for index, part in kept.items()}
    monkeypatch.setattr(from_video, "solve_tripods", lambda *_: pytest.fail("has worked"))
    again = calibrate_video(FIELD, rendered, network, parts=read_back)
    assert again == whole
    assert [camera.K.tolist() for camera in again.cameras] == [camera.K.tolist() for camera in whole.cameras]
    with pytest.raises(ValueError, match="is it of another one"):
        calibrate_video(FIELD, rendered[:8], network, parts=read_back)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2])
def test_a_clip_goes_on_after_its_parts(video, whole, network, tmp_path, monkeypatch, capsys, count):
    with monkeypatch.context() as patch:
        finished = from_video.finish_clip
        ending = Interrupting(finished, count)
        patch.setattr(from_video, "finish_clip", lambda *arguments: ending(*arguments))
        assert run("run", video, "--out", tmp_path) == 130
    assert "--resume goes on with it" in capsys.readouterr().err
    parts = sorted(path.name for path in tmp_path.glob(".part-*"))
    assert parts == [f".part-{index:04d}.json" for index in range(count)]
    solved = []
    with monkeypatch.context() as patch:
        patch.setattr(from_video, "finish_clip", lambda *arguments: solved.append(1) or finished(*arguments))
        assert run("run", video, "--out", tmp_path, "--resume") == 0
    assert len(solved) == 3 - count
    assert content_of(tmp_path) == content_of(whole)


@pytest.mark.slow
@pytest.mark.parametrize("lines", [0, 3])
@pytest.mark.parametrize("clip", ["--clip", "--independent"])
def test_a_finished_video_whose_lines_are_gone_is_calibrated_again(short, know, tmp_path, clip, lines):
    def calibrated(*options):
        know(TRUTHS[:12] if clip == "--independent" else [TRUTHS[0]] * 12)
        return run("run", short, clip, "--out", tmp_path / "out", *options)

    assert calibrated() == 0
    before, summary = content_of(tmp_path / "out")
    for name in ("cameras.jsonl", "solver.jsonl"):
        path = tmp_path / "out" / name
        path.write_text("".join(path.read_text().splitlines(keepends=True)[:lines]))
    if not lines:
        (tmp_path / "out" / "cameras.jsonl").unlink()
    assert calibrated("--resume") == 0
    assert content_of(tmp_path / "out") == (before, summary)


@pytest.mark.slow
@pytest.mark.parametrize("count", [0, 7, 25])
def test_a_clip_goes_on_with_its_frames(video, whole, network, tmp_path, monkeypatch, count):
    from fieldcalib.draw.overlays import draw_calibration

    with monkeypatch.context() as patch:
        patch.setattr("fieldcalib.cli.run_options.draw_calibration", Interrupting(draw_calibration, count))
        assert run("run", video, "--out", tmp_path) == 130
    done = (tmp_path / "cameras.jsonl").read_text().count("\n")
    assert max(count - (os.cpu_count() or 1), 0) <= done <= count  # others are drawn beside them
    assert run("run", video, "--out", tmp_path, "--resume") == 0
    assert content_of(tmp_path) == content_of(whole)


@pytest.fixture(scope="module")
def short(rendered, tmp_path_factory):
    """A video of twelve frames: a batch of eight, and four."""
    return written(rendered[:12], tmp_path_factory.mktemp("short") / "clip.mp4")


@pytest.mark.parametrize("count", [pytest.param(8, marks=pytest.mark.slow), 9])
def test_a_video_by_itself_goes_on(short, know, tmp_path, monkeypatch, count):
    from fieldcalib.run_folder.results import ResultsWriter

    know(TRUTHS[:12])
    assert run("run", short, "--independent", "--out", tmp_path / "whole") == 0
    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        ending = Interrupting(ResultsWriter.add, count)
        patch.setattr(ResultsWriter, "add", lambda *arguments: ending(*arguments))
        know(TRUTHS[:12])
        assert run("run", short, "--independent", "--out", out) == 130
    assert len(lines_of(out)) == count
    assert not (out / "overlay.mp4").exists()
    know(TRUTHS[8 * ((count - 1) // 8) : 12])  # the last line is written again
    assert run("run", short, "--independent", "--out", out, "--resume") == 0
    assert content_of(out) == content_of(tmp_path / "whole")


@pytest.mark.slow
def test_other_processes_give_the_same(rendered, network):
    with Processes(2) as executor:
        found = calibrate_video(FIELD, rendered, network, executor=executor)
    assert found == calibrate_video(FIELD, rendered, network)


@pytest.mark.slow
def test_processes_write_the_same_files(video, whole, network, tmp_path):
    assert run("run", video, "--out", tmp_path, "--jobs", "2") == 0
    assert content_of(tmp_path) == content_of(whole)


PROGRAM = """
import sys
from fieldcalib.cli.main import main
from fieldcalib.images.clip import from_video
from_video.PART = 9
raise SystemExit(main(sys.argv[1:]))
"""


def in_parts(*arguments):
    """A process of the command line with parts of some frames."""
    environment = {**os.environ, "PYTHONPATH": str(Path(fieldcalib.__file__).parents[1])}
    return subprocess.Popen([sys.executable, "-c", PROGRAM, *map(str, arguments)], env=environment)


@pytest.mark.slow
def test_a_run_by_processes_that_is_killed_goes_on(video, tmp_path):
    out = tmp_path / "out"
    running = in_parts("run", video, "--out", out, "--jobs", "2", "--no-pictures")
    wait_until(lambda: any(out.glob(".part-*")), 300.0)
    running.kill()
    assert running.wait() == -signal.SIGKILL
    assert not (out / "summary.json").exists()
    assert in_parts("run", video, "--out", out, "--resume", "--no-pictures").wait() == 0
    assert in_parts("run", video, "--out", tmp_path / "whole", "--no-pictures").wait() == 0
    assert content_of(out) == content_of(tmp_path / "whole")


@pytest.mark.slow
def test_shards_of_a_clip_are_joined(video, whole, network, tmp_path, monkeypatch):
    shards = [tmp_path / "1", tmp_path / "2"]
    for number, out in enumerate(shards, 1):
        assert run("run", video, "--shard", f"{number}/2", "--out", out) == 0
    assert [len(list(out.glob(".part-*"))) for out in shards] == [2, 1]
    monkeypatch.setattr(from_video, "calibrated_part", lambda *_: pytest.fail("has worked"))
    out = tmp_path / "out"
    assert run("join", *shards, "--out", out) == 0
    assert content_of(out) == content_of(whole)


@pytest.mark.slow
def test_shards_of_several_clips_are_joined_one_by_one(video, short, network, tmp_path):
    videos = tmp_path / "videos"
    videos.mkdir()
    for one in (video, short):
        (videos / f"{one.parent.name}.mp4").write_bytes(one.read_bytes())
    options = ("--no-pictures", "--out")
    assert run("run", videos, *options, tmp_path / "whole") == 0
    for number in (1, 2):
        assert run("run", videos, "--shard", f"{number}/2", *options, tmp_path / str(number)) == 0
    for name in (path.stem for path in videos.iterdir()):
        assert run("join", tmp_path / "1" / name, tmp_path / "2" / name, "--out", tmp_path / "joined" / name) == 0
        assert content_of(tmp_path / "joined" / name) == content_of(tmp_path / "whole" / name)


def test_frames_of_a_video_one_by_one_have_no_shards(video, know, tmp_path, capsys):
    know([])
    assert run("run", video, "--shard", "1/2", "--out", tmp_path / "out", "--independent") == 2
    assert "--shard is of images" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
