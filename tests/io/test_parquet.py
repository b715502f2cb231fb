"""Results as a table: what it says, and that nothing is lost on the way."""

import json
import sys

import pytest
from commands import calibrate, run

from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.parquet import ROW_GROUP, read_parquet, write_parquet
from fieldcalib.io.results import split_line
from fieldcalib.results.entry import read

BROKEN = {"id": "b\udc80", "status": "broken file", "message": "is no JSON"}
FRAME = {
    "id": "a",
    "status": "accepted",
    "message": "rms 1 px",
    "verdict": "good",
    "reason": "",
    "K": [[1500.5, 0, 480], [0, 1500.5, 270], [0, 0, 1]],
    "dist": [0.1, 0, 0, 0, 0],
    "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "C": [0.0, 60.0, -15.0],
    "angles_degrees": {"pan": 3.5, "tilt": 78.0, "roll": 0.25},
    "rms_px": "inf",
    "segment_errors_px": {"Middle line": 0.5, "Circle central": None},
    "suspect_labels": [{"label": "Middle line", "fits": None, "error_px": 3.0}],
    "image_size": [960, 540],
    "field": {"builder": "soccer", "length": 105.0, "width": 68.0, "size_known": False},
    "standard_deviations": {
        "focal_length_px": 9.5,
        "C": [1, 2, None],
        "angles_degrees": {"pan": 1, "tilt": 1, "roll": 1},
    },
    "probability_right_1m": 0.75,
    "later": {"anything": [1]},
}


def lines_of(*records):
    """The lines of frames in both files."""
    return [tuple((json.dumps(part) + "\n").encode() for part in split_line(record)) for record in records]


def test_the_lines_come_back_as_they_were(tmp_path):
    lines = lines_of(FRAME, BROKEN)
    write_parquet(lines, tmp_path / "cameras.parquet")
    found = read_parquet(tmp_path / "cameras.parquet")
    assert [(main + b"\n", solver + b"\n") for main, solver in found] == lines


def test_columns_of_a_frame(tmp_path):
    import pyarrow.parquet

    write_parquet(lines_of(FRAME, BROKEN), tmp_path / "cameras.parquet")
    frame, broken = pyarrow.parquet.read_table(tmp_path / "cameras.parquet").to_pylist()
    for key in ("id", "verdict", "K", "dist", "R", "C", "angles_degrees", "image_size"):
        assert frame[key] == FRAME[key]
    assert frame["rms_px"] == float("inf")
    assert frame["segment_errors_px"] == [("Middle line", 0.5), ("Circle central", None)]
    assert frame["suspect_labels"] == ["Middle line"]
    assert frame["standard_deviations"]["C"] == [1.0, 2.0, None]
    assert frame["field"] == {"length": 105.0, "width": 68.0}
    assert frame["loss_ndc"] is None
    assert broken["id"] == r"b\udc80"
    assert (broken["message"], broken["K"], broken["verdict"]) == ("is no JSON", None, None)


def test_row_groups_keep_memory_flat(tmp_path):
    import pyarrow.parquet

    count = 2 * ROW_GROUP + 1
    write_parquet((line for _ in range(count) for line in lines_of(FRAME)), tmp_path / "cameras.parquet")
    with pyarrow.parquet.ParquetFile(tmp_path / "cameras.parquet") as file:
        rows = [file.metadata.row_group(group).num_rows for group in range(file.metadata.num_row_groups)]
    assert rows == [ROW_GROUP, ROW_GROUP, 1]
    assert sum(1 for _ in read_parquet(tmp_path / "cameras.parquet")) == count


def test_tables_of_several_runs_are_one(tmp_path):
    import pandas
    import pyarrow.dataset

    for name, record in (("first", FRAME), ("second", BROKEN)):
        (tmp_path / name).mkdir()
        write_parquet(lines_of(record), tmp_path / name / "cameras.parquet")
    table = pyarrow.dataset.dataset(tmp_path, format="parquet").to_table(columns=["id", "rms_px"])
    assert sorted(table.column("id").to_pylist()) == ["a", r"b\udc80"]
    assert pandas.read_parquet(tmp_path / "first" / "cameras.parquet")["angles_degrees"][0]["pan"] == 3.5


def test_a_table_is_written_whole_or_not_at_all(tmp_path):
    def lines():
        yield from lines_of(FRAME)
        raise OSError("no more")

    with pytest.raises(OSError, match="no more"):
        write_parquet(lines(), tmp_path / "cameras.parquet")
    assert list(tmp_path.iterdir()) == []


def test_a_run_of_no_frames(tmp_path):
    write_parquet([], tmp_path / "cameras.parquet")
    assert list(read_parquet(tmp_path / "cameras.parquet")) == []


def test_what_is_no_table_of_cameras(tmp_path):
    import pyarrow
    import pyarrow.parquet

    path = tmp_path / "cameras.parquet"
    path.write_bytes(b"PAR1 and no more")
    with pytest.raises(BrokenFileError, match=r"cameras.parquet: cannot be read as Parquet"):
        list(read_parquet(path))
    pyarrow.parquet.write_table(pyarrow.table({"id": ["a"]}), path)
    with pytest.raises(BrokenFileError, match=r"cameras.parquet: has no column 'line'"):
        list(read_parquet(path))


def test_without_pyarrow_it_is_said_how_to_install_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ImportError, match=r"needs pyarrow: pip install 'fieldcalib\[parquet\]'"):
        write_parquet([], tmp_path / "cameras.parquet")
    assert list(tmp_path.iterdir()) == []


# --- of a run ---


def files_in(out):
    return {path.name for path in out.iterdir()}


def test_a_run_leaves_a_table_that_reads_back_the_same(annotated_folder, calibrated_folder, tmp_path):
    import pyarrow  # noqa: F401

    assert calibrate(tmp_path, annotated_folder, options=["--format", "parquet"]) == 0
    assert files_in(tmp_path) == files_in(calibrated_folder) - {"cameras.jsonl", "solver.jsonl"} | {"cameras.parquet"}
    ours, theirs = read(tmp_path), read(calibrated_folder)
    assert list(ours) == list(theirs)
    assert dict(ours) == dict(theirs)
    assert ours.lines == theirs.lines
    assert read(tmp_path / "cameras.parquet").lines == theirs.lines
    assert run("evaluate", tmp_path, annotated_folder) == 0


def test_a_run_with_a_table_is_gone_on_with_and_replaced(annotated_folder, tmp_path, capsys):
    import pyarrow  # noqa: F401

    options = ["--format", "parquet"]
    assert calibrate(tmp_path, annotated_folder, options=options) == 0
    before = (tmp_path / "cameras.parquet").read_bytes()
    files = files_in(tmp_path)
    assert calibrate(tmp_path, annotated_folder, options=options) == 2
    assert "--resume goes on with it, --overwrite begins anew" in capsys.readouterr().err
    assert calibrate(tmp_path, annotated_folder, options=[*options, "--resume"]) == 0
    assert (tmp_path / "cameras.parquet").read_bytes() == before
    assert calibrate(tmp_path, annotated_folder / "b.json", options=[*options, "--overwrite"]) == 0
    assert list(read(tmp_path)) == ["b"]
    assert files_in(tmp_path) == files - {f"camera_{id}.json" for id in "acd"}


def test_a_run_that_ended_before_its_table(annotated_folder, tmp_path, monkeypatch):
    import pyarrow  # noqa: F401

    def full(lines, path):
        raise OSError("no space left on device")

    options = ["--format", "parquet"]
    monkeypatch.setattr("fieldcalib.run_folder.results.write_parquet", full)
    assert calibrate(tmp_path, annotated_folder, options=options) == 2
    assert {"cameras.jsonl", "solver.jsonl"} <= files_in(tmp_path)
    monkeypatch.undo()
    assert calibrate(tmp_path, annotated_folder, options=[*options, "--resume"]) == 0
    assert {"cameras.jsonl", "solver.jsonl", "cameras.parquet"} & files_in(tmp_path) == {"cameras.parquet"}
    assert len(read(tmp_path)) == 4


def test_a_table_without_pyarrow_is_refused_before_the_work(annotated_folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert calibrate(tmp_path, annotated_folder, options=["--format", "parquet"]) == 2
    assert "pip install 'fieldcalib[parquet]'" in capsys.readouterr().err
    assert files_in(tmp_path) == set()


def test_a_table_that_cannot_be_read_without_pyarrow_is_one_line(annotated_folder, tmp_path, monkeypatch, capsys):
    import pyarrow  # noqa: F401

    assert calibrate(tmp_path, annotated_folder, options=["--format", "parquet"]) == 0
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    capsys.readouterr()
    assert run("evaluate", tmp_path, annotated_folder) == 2
    said = "Parquet needs pyarrow: pip install 'fieldcalib[parquet]', in a checkout pip install '.[parquet]'"
    assert capsys.readouterr().err == f"fieldcalib: {said}\n"


def test_shards_have_no_tables(annotated_folder, tmp_path, capsys):
    import pyarrow  # noqa: F401

    assert calibrate(tmp_path, annotated_folder, options=["--format", "parquet", "--shard", "1/2"]) == 2
    assert "--shard writes cameras.jsonl" in capsys.readouterr().err
