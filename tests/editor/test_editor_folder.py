"""The editor and its folder: nothing is lost, whatever ends the process; saved results are those of a run."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from editors import (  # noqa: F401
    BLANK,
    LINES,
    PANNED,
    SIZE,
    TRUTH,
    _close_editors,
    edited,
    ends,
    labelled,
    marked,
    opened,
)
from waiting import wait_until

import fieldcalib
from fieldcalib import Camera, soccer
from fieldcalib.assess.findings import What
from fieldcalib.cli.main import main
from fieldcalib.draw.scene import render_field
from fieldcalib.editor.editor import StaleEdit
from fieldcalib.editor.journal import JOURNAL, read_journal
from fieldcalib.editor.label_files import LabelWarning
from fieldcalib.editor.label_versions import ChangedFileError
from fieldcalib.fields import tennis
from fieldcalib.io.files import BrokenFileError


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Two frames of one camera, which pans."""
    folder = tmp_path_factory.mktemp("pictures")
    for name, camera in (("a", TRUTH), ("b", PANNED)):
        cv2.imwrite(str(folder / f"{name}.png"), render_field(camera, soccer(), rng=np.random.default_rng(0)))
    return folder


@pytest.fixture
def blank(tmp_path):
    path = tmp_path / "blank.png"
    cv2.imwrite(str(path), BLANK)
    return path


# --- where it lies ---


@pytest.mark.parametrize("source", [".", "", "../pictures", "inner/.."])
def test_results_of_a_folder_lie_beside_it_under_its_name(tmp_path, monkeypatch, source):
    (tmp_path / "pictures" / "inner").mkdir(parents=True)
    cv2.imwrite(str(tmp_path / "pictures" / "blank.png"), BLANK)
    monkeypatch.chdir(tmp_path / "pictures")
    marked(edited(source, "tennis"), 1)
    assert {path.name for path in tmp_path.iterdir()} == {"pictures", "pictures-fieldcalib"}


def test_the_root_has_no_folder_beside_it():
    with pytest.raises(ValueError, match="expected out, a folder of results: / has no name"):
        fieldcalib.Editor("/")


# --- nothing is lost ---


def test_history_survives(blank, tmp_path):
    editor = marked(opened(blank, tmp_path / "out"), 6)
    for _ in range(2):
        editor[0] = editor[0].undo()
    editor[0] = editor[0].redo()
    editor[0] = editor[0].know(focal_length=90.0)
    before, revision = editor[0].history, editor.revision(0)
    editor.close()
    again = opened(blank, tmp_path / "out")
    assert again[0].history == before
    assert again.revision(0) == revision
    assert again.unsaved == 1
    while again[0].history.can_undo:
        again[0] = again[0].undo()
    assert again[0].is_automatic
    again.close()


def test_a_change_that_was_taken_back_is_nothing_to_save(blank, tmp_path):
    editor = opened(blank, tmp_path / "out")
    marked(editor, 2)
    assert editor.save() == 1
    editor[0] = editor[0].undo()
    assert editor.unsaved == 1
    editor[0] = editor[0].redo()
    assert (editor.unsaved, editor.save()) == (0, 0)
    editor[0] = editor[0].undo()
    editor.close()
    again = opened(blank, tmp_path / "out")
    assert again.unsaved == 1
    again[0] = again[0].redo()
    assert (again.unsaved, again.save()) == (0, 0)


def test_a_folder_that_is_open_elsewhere_is_said_to_be_so(blank, tmp_path):
    out = tmp_path / "out"
    first, second = opened(blank, out), opened(blank, out)
    assert (first.claim(), second.claim(), out.exists()) == ("", "", False)  # nothing is made, and nobody has begun
    marked(first, 1)
    assert second.claim().startswith(f"another run or page writes to {out}")
    with pytest.raises(OSError, match="another run or page writes to"):
        marked(second, 1)
    third = opened(blank, out)
    assert "writes to" in third.claim()
    first.close()
    assert third.claim() == ""
    assert "writes to" in second.claim()
    third.close()
    assert second.claim() == f"{out / JOURNAL} was changed by another program: end this one and open the folder again"


def test_a_folder_that_is_looked_at_is_held_before_the_first_change(blank, tmp_path):
    out = tmp_path / "out"
    marked(opened(blank, out), 1).close()
    first, second = opened(blank, out), opened(blank, out)
    assert first.claim() == ""
    assert "writes to" in second.claim()
    marked(first, 2)
    first.close()


def test_two_undos_at_once_are_a_change_of_their_own(blank, tmp_path):
    """What a journal has no word for is kept as the state that it leads to."""
    editor = marked(opened(blank, tmp_path / "out"), 4)
    editor[0] = editor[0].undo().undo()
    marks = editor[0].marks
    editor.close()
    assert opened(blank, tmp_path / "out")[0].marks == marks


def test_an_incomplete_last_line_is_no_harm(blank, tmp_path):
    marked(opened(blank, tmp_path / "out"), 3).close()
    path = tmp_path / "out" / JOURNAL
    content = path.read_bytes()
    last = content.rstrip(b"\n").rfind(b"\n") + 1
    for end in range(last, len(content)):
        path.write_bytes(content[:end])
        assert len(read_journal(path).frames["blank"].history.present.marks) == 2
    again = opened(blank, tmp_path / "out")
    assert len(again[0].marks) == 2
    again[0] = again[0].mark("Net top", (7.0, 7.0), snap=False)
    again.close()
    assert len(opened(blank, tmp_path / "out")[0].marks) == 3


def test_a_damaged_journal_is_named(blank, tmp_path):
    marked(opened(blank, tmp_path / "out"), 2).close()
    path = tmp_path / "out" / JOURNAL
    path.write_bytes(b"no json\n" + path.read_bytes())
    with pytest.raises(BrokenFileError, match=r"edits\.jsonl, line 1"):
        opened(blank, tmp_path / "out")


MARKING = """
import sys
from fieldcalib import Editor
editor = Editor(sys.argv[1], "tennis", out=sys.argv[2])
editor[0]
print("ready", flush=True)
for k in range(100_000):
    editor[0] = editor[0].mark("Net top", (float(k % 90), 1.0), snap=False)
    print(len(editor[0].marks), flush=True)
"""


def check_kills(blank, out, count, rng):
    """Kill a process that sets marks; what it said to be set is there afterwards."""
    environment = {**os.environ, "PYTHONPATH": str(Path(fieldcalib.__file__).parents[1])}
    said = out.with_suffix(".txt")
    for _ in range(count):
        with said.open("wb") as file:
            run = subprocess.Popen([sys.executable, "-c", MARKING, str(blank), str(out)], stdout=file, env=environment)
            wait_until(lambda: said.read_bytes().count(b"\n") > 3 + rng.integers(0, 20))
            run.send_signal(signal.SIGKILL)
            run.wait()
        lines = [line for line in said.read_bytes().split(b"\n")[1:-1] if line.isdigit()]
        editor = opened(blank, out)
        assert int(lines[-1]) <= len(editor[0].marks) <= int(lines[-1]) + 1
        editor.close()


def test_a_kill(blank, tmp_path):
    check_kills(blank, tmp_path / "out", 1, np.random.default_rng(0))


@pytest.mark.slow
def test_twenty_kills(blank, tmp_path):
    check_kills(blank, tmp_path / "out", 20, np.random.default_rng(1))


# --- several of them ---


def test_a_stale_change(blank, tmp_path):
    editor = opened(blank, tmp_path / "out")
    first = editor[0]
    editor.put(0, first.mark("Net top", (1.0, 1.0), snap=False), editor.revision(0))
    with pytest.raises(StaleEdit, match="changed meanwhile"):
        editor.put(0, first.mark("Net top", (2.0, 2.0), snap=False), 0)
    assert len(editor[0].marks) == 1


def test_a_second_editor_of_one_folder(blank, tmp_path):
    first, second = (opened(blank, tmp_path / "out") for _ in range(2))
    marked(first, 1)
    with pytest.raises(OSError, match="writes to"):
        marked(second, 1)
    first.close()
    with pytest.raises(OSError, match="open the folder again"):
        marked(second, 1)
    marked(opened(blank, tmp_path / "out"), 1)


# --- saved ---


def test_saved_results_are_those_of_a_run(pictures, tmp_path):
    out = tmp_path / "out"
    editor = labelled(edited(pictures, out=out))
    editor[1]
    assert editor.save() == 2
    camera = editor.fitted(0).calibration.camera
    editor.close()
    results = fieldcalib.read(out)
    assert list(results) == ["a", "b"]
    assert results["a"].camera.focal_length == camera.focal_length
    lines = [json.loads(line) for line in (out / "cameras.jsonl").read_text().splitlines()]
    assert [line.get("basis") for line in lines] == ["labelled by hand", None]
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["frames"], summary["verdict"]["good"]) == (2, 2)
    assert {path.name for path in out.glob("overlay_*")} == {"overlay_a.jpg", "overlay_b.jpg"}
    assert main(["export", str(out), "--format", "opencv", "--out", str(tmp_path / "exported")]) == 0
    again = edited(out)  # the folder says where its pictures are
    assert again[0].marks.pixels.keys() == set(LINES)
    assert again.unsaved == 0
    assert again.table.rows[0].by_hand


def run_with_camera_files(pictures, out):
    """The results of `run --camera-files`."""
    assert main(["run", str(pictures), "--camera-files", "--out", str(out)]) == 0


def test_a_run_is_mended(pictures, tmp_path):
    """The results of a run, one frame of which is labelled."""
    out = tmp_path / "out"
    run_with_camera_files(pictures, out)
    editor = edited(pictures, out=out)
    before = (out / "camera_b.json").read_bytes()
    assert editor.table.rows[1].verdict == "good"
    assert {mark.by_hand for mark in editor[1].marks.all} == {False}
    editor[1] = editor.begun(1).mark(LINES[0], ends(LINES[0], PANNED)[0])
    assert len(editor[1].marks) > 9  # with those of the network
    assert editor.save() == 1
    assert fieldcalib.read(out)["b"].camera is not None
    lines = [json.loads(line) for line in (out / "cameras.jsonl").read_text().splitlines()]
    assert [line.get("basis") for line in lines] == [None, "labelled by hand and by the network"]
    kept = out / "history" / "0001"
    assert (kept / "camera_b.json").read_bytes() == before
    assert len((kept / "cameras.jsonl").read_text().splitlines()) == 2
    editor[1] = editor[1].undo()
    editor.save()
    assert (out / "camera_b.json").read_bytes() == before
    assert not (out / "labels" / "b.json").exists()


def test_a_run_is_mended_later(pictures, tmp_path):
    """Frames of a run that were changed, and are saved when the folder is opened again; and with given labels."""
    out = tmp_path / "out"
    run_with_camera_files(pictures, out)
    given = write_soccernet(
        tmp_path / "a.json", Side_line_left=ends(LINES[0]) / SIZE, Side_line_top=ends(LINES[1]) / SIZE
    )
    editor = edited(pictures, out=out)
    editor[1] = editor.begun(1).mark(LINES[0], ends(LINES[0], PANNED)[0])
    editor.close()
    assert edited(pictures, out=out, labels=given).save() == 2
    assert (out / "history" / "0001" / "camera_a.json").exists()


def test_results_that_another_program_has_changed(pictures, tmp_path):
    out = tmp_path / "out"
    editor = labelled(edited(pictures / "a.png", out=out))
    editor.save()
    (out / "cameras.jsonl").write_bytes((out / "cameras.jsonl").read_bytes() + b"\n")
    editor[0] = editor[0].remove([0])
    with pytest.raises(ChangedFileError, match=r"cameras\.jsonl was changed"):
        editor.save()
    assert editor.unsaved == 1


@pytest.mark.parametrize("format", ["soccernet", "labelme", "coco", "labelstudio", "cvat"])
def test_labels_in_a_format(blank, tmp_path, format):
    if format == "cvat":
        import defusedxml  # noqa: F401 - reading it back needs it
    editor = marked(opened(blank, tmp_path / "out"), 3)
    name = editor.save_labels(format)
    found = fieldcalib.io.read_annotations(tmp_path / "out" / name, (96, 54))
    xy = found["blank"].pixels["Net top"]
    assert sorted(np.round(xy, 3).tolist()) == [[0.0, 1.0], [1.0, 1.0], [2.0, 1.0]]


# --- labels that are given ---


@pytest.mark.parametrize(
    "format",
    ["soccernet", "cvat", *(pytest.param(one, marks=pytest.mark.slow) for one in ("labelme", "coco", "labelstudio"))],
)
def test_given_labels(pictures, tmp_path, format):
    """Labels of a file are marks of a person; saved in their format into the folder, never over the file."""
    if format == "cvat":
        import defusedxml  # noqa: F401 - reading them needs it
    first = labelled(edited(pictures, out=tmp_path / "first"))
    given = tmp_path / "first" / first.save_labels(format)
    first.close()
    files = {path: path.read_bytes() for path in ([given] if given.is_file() else given.iterdir())}

    out = tmp_path / "out"
    editor = edited(pictures, out=out, labels=given)
    assert not out.exists()
    assert editor.label_format == format
    assert (editor.unsaved, editor.table.rows[0].by_hand, editor.table.rows[1].by_hand) == (1, True, False)
    assert editor[0].marks.pixels.keys() == set(LINES)
    assert editor.fitted(0).calibration.verdict == "good"
    editor[0] = editor[0].move({0: editor[0].marks.all[0][1:3]}, snap=False).mark("Circle left", ends("Circle left"))
    assert editor.save() == 1
    assert editor.unsaved == 0
    read = fieldcalib.io.read_annotations(out / given.name, SIZE)
    assert read["a"].pixels.keys() == {*LINES, "Circle left"}
    assert fieldcalib.read(out)["a"].camera is not None
    assert {path: path.read_bytes() for path in files} == files
    editor.close()

    again = edited(pictures, out=out)  # the folder knows the labels and their format
    assert (again.unsaved, again.label_format) == (0, format)
    assert again[0].marks.pixels.keys() == {*LINES, "Circle left"}
    again.close()
    assert len(edited(pictures, out=out, labels=given)[0].marks) == 10  # what was changed there is not lost


def test_given_labels_that_were_saved_unchanged(pictures, tmp_path):
    first = labelled(edited(pictures, out=tmp_path / "first"))
    given = tmp_path / "first" / first.save_labels("coco")
    editor = edited(pictures, out=tmp_path / "out", labels=given)
    assert editor.save() == 1
    editor.close()
    again = edited(pictures, out=tmp_path / "out")
    assert again.unsaved == 0
    assert again[0].marks.pixels.keys() == set(LINES)
    again[0] = again[0].clear()
    again.save()
    assert not (tmp_path / "out" / "labels-coco.json").exists()  # nothing is labelled any more
    assert list((tmp_path / "out" / "history").glob("*/labels-coco.json"))


def test_a_file_of_another_program_is_not_overwritten_by_labels(pictures, tmp_path):
    first = labelled(edited(pictures, out=tmp_path / "first"))
    given = tmp_path / "first" / first.save_labels("coco")
    out = tmp_path / "out"
    out.mkdir()
    (out / "labels-coco.json").write_text("mine")
    editor = edited(pictures, out=out, labels=given)
    with pytest.raises(ChangedFileError, match=r"labels-coco\.json"):
        editor.save()
    assert (out / "labels-coco.json").read_text() == "mine"


def write_soccernet(path, **pixels):
    of_label = {label.replace("_", " "): [{"x": x, "y": y} for x, y in xy] for label, xy in pixels.items()}
    path.write_text(json.dumps(of_label))
    return path


@pytest.mark.parametrize(
    ("name", "label", "message"),
    [
        ("c", "Middle_line", r"named as those of the source \('a', 'b'\), got 'c'"),
        ("a", "Half", "labels of the field, got 'Half': give the field"),
    ],
)
def test_given_labels_of_nothing(pictures, tmp_path, name, label, message):
    given = write_soccernet(tmp_path / f"{name}.json", **{label: [(0.5, 0.5), (0.5, 0.7)]})
    with pytest.raises(ValueError, match=message):
        edited(pictures, labels=given)


def test_given_labels_that_are_left_out(pictures, tmp_path):
    (tmp_path / "labels").mkdir()
    line = [(0.5, 0.5), (0.5, 0.7)]
    write_soccernet(tmp_path / "labels" / "a.json", Middle_line=line, Half=line)
    write_soccernet(tmp_path / "labels" / "c.json", Middle_line=line)
    with pytest.warns(LabelWarning) as warned:
        editor = edited(pictures, labels=tmp_path / "labels")
    said = " ".join(str(one.message) for one in warned)
    assert "1 frames are not in the source" in said
    assert "no 'Half'" in said
    assert editor[0].marks.pixels.keys() == {"Middle line"}


def test_what_cannot_be_saved(blank):
    editor = marked(edited([BLANK], "tennis"), 1)
    with pytest.raises(ValueError, match="expected a folder"):
        editor.save()
    with pytest.raises(ValueError, match="expected a clip"):
        editor.set_cuts([0])
    with pytest.raises(ValueError, match="expected a clip"):
        editor.solve()


@pytest.mark.parametrize(
    ("source", "message"),
    [("nothing.mp4", "does not exist"), ("empty", "holds no image"), ("no", "does not exist")],
)
def test_what_cannot_be_opened(tmp_path, source, message):
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match=message):
        edited(tmp_path / source)


# --- what a camera rests on ---


def test_the_basis_tells_of_marks_of_the_network(pictures):
    editor = edited(pictures)
    editor[0] = editor[0].mark("Middle line", (480.0, 100.0), snap=False)
    assert any(not one.by_hand for one in editor[0].marks.all)
    editor.fitted(0)
    assert editor.table.rows[0].basis == "labelled by hand and by the network"
    editor[0] = editor[0].with_marks(editor[0].marks.only_by_hand)
    editor.fitted(0)
    assert editor.table.rows[0].basis == "labelled by hand"


# --- marks of another frame ---


def test_marks_are_copied(pictures):
    editor = labelled(edited([cv2.imread(str(pictures / f"{name}.png")) for name in "ab"]))
    copied = editor.with_marks_of(1, 0)
    assert len(copied.marks) >= 6
    for label, xy in copied.marks.pixels.items():
        near = PANNED.project(soccer()[label].sample(0.02))
        assert max(np.min(np.linalg.norm(near - one, axis=1)) for one in xy) < 2.0
    other = labelled(edited([editor[0].image, np.zeros_like(editor[0].image)]))
    with pytest.raises(ValueError, match="no background in common"):
        other.with_marks_of(1, 0)


def test_a_notebook_shows_the_picture(pictures):
    editor = labelled(edited(pictures / "a.png"))
    html = editor._repr_html_()
    assert "data:image/jpeg;base64," in html
    assert "good: rms" in html


# --- courts by search ---

COURT = Camera.from_angles(1.5, 1.3, 0.0, 1400.0, (-32.0, 1.0, -9.0), SIZE)


def far_from(camera):
    return np.max(np.linalg.norm(camera.project(CORNERS) - COURT.project(CORNERS), axis=1))


CORNERS = np.array([(x, y, 0.0) for x in (-11.885, 11.885) for y in (-4.115, 4.115)])


def test_a_court_is_searched_for(tmp_path):
    editor = edited([render_field(COURT, tennis())], "tennis", out=tmp_path / "out")
    assert editor.fitted(0).calibration.camera is None
    assert editor.save() == 0  # not before the search
    assert editor.search(0)
    assert not editor.search(0)
    assert far_from(editor[0].calibration.camera) < 2.0
    assert editor.table.rows[0].verdict == "good"
    assert editor.unsaved == 0
    assert editor.save() == 1
    assert far_from(fieldcalib.read(tmp_path / "out")["000000"].camera) < 2.0


def test_a_search_does_not_change_what_a_person_has_begun(tmp_path):
    image = render_field(COURT, tennis())
    editor = edited([image], "tennis", out=tmp_path / "out")
    editor[0] = editor[0].mark("Net top", (300.0, 200.0), snap=False)
    editor.close()
    again = edited([image], "tennis", out=tmp_path / "out")
    again[0]
    before = again[0].calibration.camera
    assert again.search(0)
    assert again[0].calibration.camera == before
    assert len(again[0].marks) == 1
    assert again.table.rows[0].by_hand
    again[0] = again[0].undo()
    assert far_from(again[0].calibration.camera) < 2.0


def test_fields_that_cannot_be_searched_for():
    editor = edited([BLANK], replace(tennis(), stands=()))
    assert "no network knows this field" in editor[0].calibration.message
    assert not editor.search(0)
    editor = edited([BLANK], "tennis")
    editor[0]
    assert editor.search(0)
    assert editor[0].calibration.camera is None


# --- marks that are wrong ---


def test_marks_far_from_their_marking_are_named(pictures):
    editor = labelled(edited(pictures / "a.png"))
    for label in ("Small rect. left top", "Circle left"):
        editor[0] = editor[0].mark(label, ends(label))
    assert editor.fitted(0).calibration.verdict == "good"
    editor[0] = editor[0].mark("Small rect. left main", [(700.0, 100.0), (720.0, 130.0)], snap=False)
    found = editor.fitted(0).calibration
    assert found.camera is not None
    assert found.has_finding(What.STRAY)
    assert "'Small rect. left main' lies" in found.reason
    assert found.verdict != "good"


def test_a_mark_is_added_to_the_labels_of_a_good_camera(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), render_field(TRUTH, soccer()))
    out = tmp_path / "out"
    fieldcalib.calibrate(tmp_path / "a.png", progress=False).save(out)
    editor = edited(tmp_path / "a.png", out=out)
    before = editor["a"].calibration
    assert before.verdict == "good"
    editor["a"] = editor["a"].mark("Side line top", ends("Side line top"))
    assert len(editor["a"].marks) > 10
    editor.save()
    (found,) = fieldcalib.read(out).values()
    assert found.verdict == "good"
    assert np.linalg.norm(found.camera.C - before.camera.C) < 1.0


@pytest.mark.slow
def test_a_court_that_was_searched_for_has_marks_to_add_to():
    field = tennis()
    camera = Camera.from_angles(0.0, 1.2, 0.0, 1150.0, (0.0, 24.0, -8.0), SIZE)
    editor = edited([render_field(camera, field)], field)
    assert editor.search(0)
    assert editor[0].calibration
    assert {mark.by_hand for mark in editor[0].marks.all} == {False}
    editor[0] = editor[0].mark("Net top", camera.project(field["Net top"].sample(1.0))[3:4], snap=False)
    assert len(editor[0].marks.pixels) > 4
    assert np.linalg.norm(editor[0].calibration.camera.C - camera.C) < 0.5


def test_an_unknown_frame_of_an_editor_is_named():
    editor = edited([BLANK, BLANK])
    with pytest.raises(KeyError, match="there is no frame '5': ids are '000000', '000001'"):
        editor["5"]
