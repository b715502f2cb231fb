"""Shards of a run, and what they are put together to."""

import pytest
from commands import calibrate, lines_of, run
from killed import content_of
from synthetic import random_frames

from baselines import dlt_lines
from fieldcalib.io.soccernet import format_annotation
from fieldcalib.results.entry import read
from fieldcalib.run_folder import work_units


@pytest.fixture(autouse=True)
def small_units(monkeypatch):
    monkeypatch.setattr(work_units, "SMALLEST_UNIT", 1)
    monkeypatch.setattr(work_units, "LARGEST_UNIT", 2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("frames")
    frames, _ = random_frames(9, seed=2, noise=0.5)
    for number, frame in enumerate(frames):
        (folder / f"{number}.json").write_text(format_annotation(frame, (960, 540)))
    return folder


def shards_of(folder, out, count, options=()):
    for number in range(1, count + 1):
        shard = [*options, "--shard", f"{number}/{count}"]
        assert calibrate(out / str(number), folder, options=shard) == 0
    return [out / str(number) for number in range(1, count + 1)]


@pytest.mark.parametrize("count", [1, 3, *(pytest.param(count, marks=pytest.mark.slow) for count in (2, 7))])
def test_shards_together_are_the_whole(folder, tmp_path, count):
    assert calibrate(tmp_path / "whole", folder) == 0
    shards = shards_of(folder, tmp_path, count)
    assert run("join", *shards[::-1], "--out", tmp_path / "joined") == 0
    assert content_of(tmp_path / "joined") == content_of(tmp_path / "whole")


def test_joined_shards_are_asked_about_their_pictures(folder, tmp_path, capsys):
    size = ["--size", "540x540"]
    for name, options in (("squashed", size), ("declared", [*size, "--display-size", "960x540"])):
        shards = shards_of(folder, tmp_path / name, 2, options)
        capsys.readouterr()
        assert run("join", *shards, "--out", tmp_path / name / "joined") == 0
        said = capsys.readouterr().err
        assert ("--aspect declares" in said) is (name == "squashed")


def test_shards_as_one_table(folder, tmp_path):
    from pyarrow.parquet import read_table

    assert calibrate(tmp_path / "whole", folder) == 0
    shards = shards_of(folder, tmp_path, 2)
    assert run("join", *shards, "--out", tmp_path / "joined", "--format", "parquet") == 0
    assert not (tmp_path / "joined" / "cameras.jsonl").exists()
    assert read_table(tmp_path / "joined" / "cameras.parquet").num_rows == len(lines_of(tmp_path / "whole"))
    assert read(tmp_path / "joined") == read(tmp_path / "whole")


def test_broken_files_and_the_files_of_baselines(folder, tmp_path):
    copy = tmp_path / "in"
    copy.mkdir()
    for path in folder.iterdir():
        (copy / path.name).write_bytes(path.read_bytes())
    (copy / "3.json").write_text("{")
    for name, options in (("whole", []), ("1", ["--shard", "1/2"]), ("2", ["--shard", "2/2"])):
        arguments = [copy, "--size", "960x540", "--out", tmp_path / name, *options]
        assert dlt_lines.main([str(argument) for argument in arguments]) == (name != "1")
    assert run("join", tmp_path / "1", tmp_path / "2", "--out", tmp_path / "joined") == 1
    assert content_of(tmp_path / "joined") == content_of(tmp_path / "whole")
    assert (tmp_path / "joined" / "1.homographyMatrix").exists()


def test_what_is_not_all_of_one_run(folder, tmp_path, capsys):
    one, two, three = shards_of(folder, tmp_path / "a", 3)
    (other,) = shards_of(folder, tmp_path / "b", 1, ["--tau", "1"])
    assert calibrate(tmp_path / "whole", folder) == 0
    (tmp_path / "a" / "2" / "summary.json").rename(tmp_path / "summary")
    capsys.readouterr()
    for inputs, message in (
        ([one, three], "expected all shards of the run, missing: 2/3"),
        ([one, one, three], f"{one} and {one} are both shard 1/3"),
        ([one, two, three], f"{two}, shard 2/3, is not finished: --resume goes on with it"),
        ([one, other], f"{other} and {one} are not of the same run: --tau was None, is 1.0"),
        ([tmp_path / "whole"], "is no shard: expected the folder of a run with --shard K/N"),
        ([tmp_path / "nothing"], "is no shard"),
    ):
        assert run("join", *inputs, "--out", tmp_path / "joined") == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "joined").exists()


@pytest.mark.parametrize("shard", ["0/2", "3/2", "1", "a/b", "1/0", "-1/2"])
def test_wrong_shards(folder, tmp_path, capsys, shard):
    assert calibrate(tmp_path, folder, options=[f"--shard={shard}"]) == 2
    assert f"argument --shard: expected K/N with K from 1 to N, as 1/8, got '{shard}'" in capsys.readouterr().err


def test_one_pitch_has_no_shards(folder, tmp_path, capsys):
    assert calibrate(tmp_path, folder, options=["--field-size", "estimated", "--same-field", "--shard", "1/2"]) == 2
    assert "leave --shard out" in capsys.readouterr().err
