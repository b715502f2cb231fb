"""Files that are read, or that are of others, are not written over; records of others reach no file outside."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import calibrate, lines_of, run, write_two_annotations

from fieldcalib import read
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.image_files import write_image
from fieldcalib.run_folder.record import RunOptions, RunRecord


@pytest.fixture
def frames(tmp_path):
    """A folder with two annotations."""
    return write_two_annotations(tmp_path / "frames")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two annotations in `frames`, a run over them in `whole` and its only shard in `shard`: to be copied."""
    folder = tmp_path_factory.mktemp("made")
    frames = write_two_annotations(folder / "frames")
    assert calibrate(folder / "whole", frames) == 0
    assert calibrate(folder / "shard", frames, options=["--shard", "1/1"]) == 0
    return folder


@pytest.fixture
def pictures(tmp_path):
    """A folder with two pictures without markings."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(2):
        write_image(folder / f"{number}.jpg", np.full((90, 160, 3), 40 + number, dtype=np.uint8))
    return folder


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def edited(folder, **changes):
    """Change values in the record of a run."""
    path = folder / "run.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


# --- what is read, or of others, stays ---


def test_annotations_beside_pictures_are_not_replaced(pictures, capsys):
    (pictures / "1.json").write_text("{}")
    before = contents(pictures)
    assert run("localize", pictures, "--out", pictures) == 2
    assert contents(pictures) == before
    assert "1.json is there already: no run has written it; give another --out" in capsys.readouterr().err
    assert run("localize", pictures, "--out", pictures, "--overwrite") == 0  # told to
    assert (pictures / "0.jpg").read_bytes() == before["0.jpg"]


@pytest.mark.parametrize("own", ["overlay_1.jpg", "motion.png"])
def test_pictures_of_ones_own_are_not_replaced(pictures, capsys, own):
    (pictures / own).write_bytes(b"mine")
    before = contents(pictures)
    assert run("run", pictures, "--out", pictures) == 2
    assert contents(pictures) == before
    assert f"{own} is " in capsys.readouterr().err


@pytest.mark.parametrize("again", [(), ("--overwrite",)])
def test_a_video_is_not_replaced_by_its_overlay(tmp_path, capsys, again):
    video = tmp_path / "overlay.mp4"
    from fieldcalib.io.videos import VideoWriter

    with VideoWriter(video, 25.0) as writer:
        for _ in range(3):
            writer.write(np.zeros((90, 160, 3), dtype=np.uint8))
    before = contents(tmp_path)
    assert run("run", video, "--out", tmp_path, *again) == 2
    assert contents(tmp_path) == before
    assert "overlay.mp4 is read by this command" in capsys.readouterr().err


def test_annotations_that_a_run_wrote_are_not_removed_while_they_are_read(pictures, tmp_path, capsys):
    out = tmp_path / "out"
    assert run("localize", pictures, "--out", out) == 0
    before = contents(out)
    assert calibrate(out, out, options=["--overwrite"]) == 2
    assert contents(out) == before
    assert "is read by this command" in capsys.readouterr().err


def test_a_link_to_the_input_is_seen_through(frames, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    (out / "summary.json").symlink_to(frames / "0.json")
    before = contents(frames)
    assert calibrate(out, frames, options=["--overwrite"]) == 2
    assert contents(frames) == before


def test_a_frame_named_as_a_file_of_the_run(pictures, capsys):
    (pictures / "0.jpg").rename(pictures / "summary.jpg")
    assert run("localize", pictures, "--out", pictures / "out") == 2
    assert "the result of frame 'summary' would be summary.json" in capsys.readouterr().err


def test_a_picture_from_above_does_not_replace_its_input(made, tmp_path, capsys):
    out, picture = tmp_path / "out", tmp_path / "0.jpg"
    shutil.copytree(made / "whole", out)
    write_image(picture, np.zeros((540, 960, 3), dtype=np.uint8))
    before = picture.read_bytes()
    assert run("topview", picture, "--cameras", out, "--out", picture) == 2
    assert picture.read_bytes() == before
    lines = (out / "cameras.jsonl").read_bytes()
    (out / "cameras.png").symlink_to(out / "cameras.jsonl")
    assert run("topview", picture, "--cameras", out, "--out", out / "cameras.png") == 2
    assert run("minimap", "--cameras", out, "--out", out / "cameras.png") == 2
    assert (out / "cameras.jsonl").read_bytes() == lines
    assert "is read by this command" in capsys.readouterr().err


def test_maps_do_not_replace_pictures(made, tmp_path, capsys):
    out, maps = tmp_path / "out", tmp_path / "maps"
    shutil.copytree(made / "whole", out)
    maps.mkdir()
    (maps / "minimap_1.png").write_bytes(b"mine")
    assert run("minimap", "--cameras", out, "--out", maps) == 2
    assert contents(maps) == {"minimap_1.png": b"mine"}


def test_saved_results_leave_other_files_alone(made, tmp_path):
    out, copy = tmp_path / "out", tmp_path / "copy"
    shutil.copytree(made / "whole", out)
    copy.mkdir()
    (copy / "motion.png").write_bytes(b"mine")
    with pytest.raises(FileExistsError, match=r"motion\.png is there already: give overwrite=True"):
        read(out).save(copy)
    assert contents(copy) == {"motion.png": b"mine"}


@pytest.mark.parametrize("again", ["--resume", "--overwrite"])
def test_logs_that_are_links_are_not_followed(made, tmp_path, again):
    out, mine = tmp_path / "out", tmp_path / "mine.txt"
    shutil.copytree(made / "whole", out)
    mine.write_text("mine\n")
    for name in ("cameras.jsonl", "solver.jsonl"):
        (out / name).unlink()
        (out / name).symlink_to(mine)
    code = calibrate(out, made / "frames", options=[again])
    assert mine.read_text() == "mine\n"
    assert code == (0 if again == "--overwrite" else 2)


def test_a_dangling_link_is_not_written_through(frames, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "cameras.jsonl").symlink_to(tmp_path / "new.txt")
    assert calibrate(out, frames) == 2
    assert not (tmp_path / "new.txt").exists()


# --- records of others ---

WRONG = [
    {"writes": ["../.bashrc"]},
    {"writes": ["<id>.jpg"]},
    {"writes": "camera_<id>.json"},
    {"writes": None},
    {"unit": 0},
    {"unit": -1},
    {"unit": 10**30},
    {"unit": "64"},
    {"shard": "0/0"},
    {"shard": 3},
    {"options": []},
    {"options": {"step": "x"}},
    {"source": "/etc/passwd"},
    {"frames": "many"},
    {"command": ["calibrate"]},
    {"version": 3},
    {"unknown": 1},
]


@pytest.mark.parametrize("changes", WRONG, ids=str)
def test_a_wrong_record_is_named(made, tmp_path, changes, capsys):
    out, bashrc = tmp_path / "out", tmp_path / ".bashrc"
    shutil.copytree(made / "shard", out)
    bashrc.write_text("mine")
    edited(out, **changes)
    with pytest.raises(BrokenFileError, match=r"run\.json: is no record of a run"):
        RunRecord.read(out)
    assert run("join", out, "--out", tmp_path / "joined") == 2
    assert calibrate(out, made / "frames", options=["--resume"]) == 2
    assert "run.json: is no record of a run" in capsys.readouterr().err
    assert calibrate(out, made / "frames", options=["--overwrite"]) == 0
    assert bashrc.read_text() == "mine"
    assert len(lines_of(out)) == 2


@pytest.mark.parametrize("id", ["../mine", "/etc/passwd", "..", "", "a" * 300, "\ud800"])
def test_ids_of_others_name_no_files(made, tmp_path, id):
    out, mine = tmp_path / "out", tmp_path / "mine.json"
    shutil.copytree(made / "shard", out)
    mine.write_text("mine")
    edited(out, writes=["<id>.json"])
    for name in ("cameras.jsonl", "solver.jsonl"):
        lines = [json.loads(line) for line in (out / name).read_text().splitlines()]
        lines[0]["id"] = id
        (out / name).write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert run("join", out, "--out", tmp_path / "joined") in (0, 1, 2)
    assert calibrate(out, made / "frames", options=["--overwrite"]) == 0
    assert mine.read_text() == "mine"


@pytest.mark.parametrize("text", ["[]", "{", '{"seconds": 3}', '{"seconds": {"total": "x"}}', '{"options": []}'])
def test_a_wrong_summary_is_named(made, tmp_path, text, capsys):
    out = tmp_path / "out"
    shutil.copytree(made / "shard", out)
    (out / "summary.json").write_text(text)
    assert run("join", out, "--out", tmp_path / "joined") == 2
    assert "summary.json: " in capsys.readouterr().err


@pytest.mark.parametrize("text", ["[]", "{", '{"version": 1}', '{"version": 1, "tripods": 3, "shots": {}}'])
def test_a_wrong_part_of_a_clip_is_named(tmp_path, text):
    from fieldcalib.cli.clips import KeptParts

    (tmp_path / ".part-0000.json").write_text(text)
    with pytest.raises(BrokenFileError, match=r"\.part-0000\.json: is no part of a clip"):
        KeptParts(tmp_path).get(0)


# --- lines that were changed ---


def _rewritten(out, change):
    for name in ("cameras.jsonl", "solver.jsonl"):
        path = out / name
        path.write_text("".join(change(path.read_text().splitlines(keepends=True), name)))


CHANGES = {
    "corrupt": lambda lines, name: ["{\n", *lines[1:]],
    "a list": lambda lines, name: ["[]\n", *lines[1:]],
    "repeated": lambda lines, name: [lines[0], *lines],
    "swapped": lambda lines, name: lines[::-1],
    "dropped": lambda lines, name: lines[1:],
    "of one file": lambda lines, name: lines[::-1] if name == "cameras.jsonl" else lines,
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_changed_lines_are_named(made, tmp_path, change, capsys):
    out = tmp_path / "out"
    shutil.copytree(made / "whole", out)
    (out / "summary.json").unlink()  # as of a run that is not finished
    with (out / "cameras.jsonl").open("a") as log, (out / "solver.jsonl").open("a") as solver:
        for file in (log, solver):
            file.write('{"id": "2", "status": "broken file", "message": ""}\n')
    _rewritten(out, change)
    assert calibrate(out, made / "frames", options=["--resume"]) == 2
    assert "cameras.jsonl, line " in capsys.readouterr().err
    assert calibrate(out, made / "frames", options=["--overwrite"]) == 0


def test_repeated_lines_are_no_results(made, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(made / "whole", out)
    _rewritten(out, CHANGES["repeated"])
    with pytest.raises(BrokenFileError, match=r"cameras\.jsonl, line 2: frame '0' is there already, in line 1"):
        read(out)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda line: line.pop("image_size"), "'image_size'"),
        (lambda line: line.pop("R"), "'R', each three rows"),
        (lambda line: line.update(K="K"), "'K' and 'R'"),
        (lambda line: line["R"].pop(), "'R', each three rows"),
        (lambda line: line["C"].pop(), "'C', three numbers"),
        (lambda line: line.update(dist=None), "'dist', a list of one number or more"),
        (lambda line: line.update(dist=[]), "'dist', a list of one number or more"),
    ],
)
def test_cameras_that_are_not_whole_are_named(made, tmp_path, change, problem):
    out = tmp_path / "out"
    shutil.copytree(made / "whole", out)
    first, *others = (out / "cameras.jsonl").read_text().splitlines(keepends=True)
    line = json.loads(first)
    change(line)
    (out / "cameras.jsonl").write_text("".join([json.dumps(line) + "\n", *others]))
    with pytest.raises(BrokenFileError, match=r"cameras\.jsonl, line 1: ") as error:
        dict(read(out).cameras)
    assert problem in str(error.value)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda solved: solved["problem"]["prior"]["sigma"].pop(), "'prior', 'sigma'"),
        (lambda solved: solved["problem"]["prior"].update(mean=1.0), "'prior', 'mean'"),
        (lambda solved: solved["theta"].pop(), "'theta'"),
        (lambda solved: solved["unit"].pop(), "'unit'"),
    ],
)
def test_solutions_that_do_not_fit_together_are_named(made, tmp_path, change, name):
    out = tmp_path / "out"
    shutil.copytree(made / "whole", out)
    first, *others = (out / "solver.jsonl").read_text().splitlines(keepends=True)
    line = json.loads(first)
    change(line["solved"])
    (out / "solver.jsonl").write_text("".join([json.dumps(line) + "\n", *others]))
    with pytest.raises(BrokenFileError, match=rf"cameras\.jsonl, line 1: .*{name}: expected finite numbers of shape"):
        read(out)["0"]


def test_long_names_do_not_block_a_folder(frames, tmp_path):
    out, long = tmp_path / "out", "a" * 245
    (frames / f"{long}.json").write_bytes((frames / "0.json").read_bytes())
    assert calibrate(out, frames) == 1
    before = contents(out)
    assert calibrate(out, frames, options=["--resume"]) == 1
    assert {name: content for name, content in contents(out).items() if name != "summary.json"} == {
        name: content for name, content in before.items() if name != "summary.json"
    }
    Path(out / "summary.json").unlink()
    assert calibrate(out, frames, options=["--resume"]) == 1
    assert calibrate(out, frames, options=["--overwrite"]) == 1


def test_another_network_is_another_run(frames):
    record = RunRecord.of(RunOptions(frames, {}, "run"), [], unit=1, writes=[], network="a")
    assert "the network of --model has changed" in record.differences(replace(record, network="b"))
    assert not record.differences(replace(record))
