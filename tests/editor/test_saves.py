"""What a save of the editor replaces, and that it goes on after whatever ends it: nothing is lost or locked."""

import http.client
import json
import os
import random
import shutil
import subprocess
import sys
import threading
import urllib.request
import warnings
from pathlib import Path

import cv2
import editors
import numpy as np
import pytest
from editors import BLANK, _close_editors, edited, marked, opened  # noqa: F401
from hypothesis import given, settings
from hypothesis import strategies as st

import fieldcalib
from fieldcalib import Camera, soccer
from fieldcalib.cli.main import main
from fieldcalib.draw.scene import render_field
from fieldcalib.editor.edit import Known
from fieldcalib.editor.journal import JOURNAL, edit_to_record
from fieldcalib.editor.label_files import LabelWarning
from fieldcalib.editor.label_versions import STAGED, ChangedFileError
from fieldcalib.fields import tennis
from fieldcalib.io.files import BrokenFileError

MINE = b"mine"
AREA = ("Net top", "Side line far", "Base line left")


@pytest.fixture
def pictures(tmp_path):
    """Two pictures of nothing, in which marks of tennis are set."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for name in "ab":
        cv2.imwrite(str(folder / f"{name}.png"), BLANK)
    return folder


def contents(folder):
    """The files of a folder, but the journal, which grows with every opening that changes something."""
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != JOURNAL]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def put(folder, name):
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(MINE)


def saved(pictures, out):
    editor = marked(opened(pictures, out), 3)
    assert editor.save() == 1
    editor.close()


# --- files of others ---

NAMES = ("overlay_b.jpg", "summary.json", "cameras.jsonl", "solver.jsonl", "run.json", "labels/a.json")


@pytest.mark.parametrize("name", NAMES)
def test_files_of_others_are_refused_at_the_opening_or_kept(pictures, tmp_path, name):
    out = tmp_path / "out"
    put(out, name)
    refusal = (FileExistsError, BrokenFileError)  # what is no record of a run is named as such
    with pytest.raises(refusal, match=f"{name}.*(no run has written it|is no record of a run)"):
        opened(pictures, out)
    assert contents(out) == {name: MINE}


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ("run.json", "cameras.jsonl")])
def test_files_of_others_are_replaced_if_told_to(pictures, tmp_path, name):
    out = tmp_path / "out"
    put(out, name)
    editor = edited(pictures, "tennis", out=out, overwrite=True)
    marked(editor, 3)
    editor[1]
    editor.search(0)
    editor.search(1)
    editor.save()
    kept = contents(out / "history")
    assert kept.pop(f"0001/{name}", MINE) == MINE  # that of a frame without a camera stays where it is
    assert not kept
    assert len(json.loads((out / "labels" / "a.json").read_text())["Net top"]) == 3


@pytest.mark.parametrize("name", NAMES[1:])
def test_files_of_others_that_come_later_are_refused_by_name(pictures, tmp_path, name):
    out = tmp_path / "out"
    editor = marked(opened(pictures, out), 3)
    editor[1]
    editor.search(1)
    put(out, name)
    before = contents(out)
    with pytest.raises(ChangedFileError, match=f"^{name} was changed by another program, or is none of those"):
        editor.save()
    assert contents(out) == before
    (out / name).unlink()
    assert editor.save() == 2


def test_labels_of_frames_that_were_only_looked_at_are_left_alone(pictures, tmp_path):
    out = tmp_path / "out"
    editor = marked(opened(pictures, out), 3)
    editor.save()
    put(out, "labels/b.json")
    editor[1]
    editor.search(1)
    editor.save()
    assert (out / "labels" / "b.json").read_bytes() == MINE


def test_a_file_that_was_written_here_and_changed_since_is_not_removed(pictures, tmp_path):
    out = tmp_path / "out"
    editor = marked(opened(pictures, out), 3)
    editor.save()
    put(out, "labels/a.json")
    editor[0] = editor[0].clear()
    with pytest.raises(ChangedFileError, match=r"labels/a\.json"):
        editor.save()
    assert (out / "labels" / "a.json").read_bytes() == MINE


@pytest.mark.parametrize("name", ["labels", "history"])
def test_a_link_leads_to_no_other_folder(pictures, tmp_path, name):
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    saved(pictures, out)
    shutil.rmtree(out / name, ignore_errors=True)
    elsewhere.mkdir()
    (out / name).symlink_to(elsewhere)
    editor = marked(opened(pictures, out), 4)
    with pytest.raises(ChangedFileError, match=f"{name} is a link, and nothing is written through it"):
        editor.save()
    assert not any(elsewhere.iterdir())
    (out / name).unlink()
    assert editor.save() == 1


def test_given_labels_are_not_written_over(pictures, tmp_path):
    out = tmp_path / "out"
    saved(pictures, out)
    before = (out / "labels" / "a.json").read_bytes()
    for given_labels in (out / "labels", out / "labels" / "a.json"):
        with pytest.raises(FileExistsError, match="would write over it"):
            edited(pictures, "tennis", out=out, labels=given_labels)
    assert (out / "labels" / "a.json").read_bytes() == before


def test_a_copy_of_a_folder_goes_on(pictures, tmp_path):
    """Files have other times there, and the same content."""
    saved(pictures, tmp_path / "out")
    copied = shutil.copytree(tmp_path / "out", tmp_path / "copied", copy_function=shutil.copyfile)
    assert marked(opened(pictures, copied), 1).save() == 1


def test_results_of_a_run_that_replaced_those_of_the_page_are_replaced(annotated_folder, tmp_path):
    """The journal knows other files than those that are there then."""
    out = tmp_path / "out"
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((540, 960, 3), np.uint8))

    def run():
        return main(["run", str(tmp_path / "a.png"), "--out", str(out), "--overwrite"])

    def mark(editor):
        editor[0] = editor[0].clear().mark("Middle line", [(480.0, 100.0), (470.0, 300.0)], snap=False)
        count = editor.save()
        editor.close()
        return count

    run()
    assert mark(edited(out)) == 1
    run()
    assert mark(edited(out)) == 1


def test_what_a_save_replaced_is_told(pictures, tmp_path):
    out = tmp_path / "out"
    editor = marked(opened(pictures, out), 3)
    editor.save()
    assert editor.last_save.replaced.folder is None
    before = (out / "labels" / "a.json").read_bytes()
    marked(editor, 1).save()
    replaced = editor.last_save.replaced
    assert replaced.folder == out / "history" / "0001"
    assert (replaced.folder / "labels" / "a.json").read_bytes() == before
    assert not (out / STAGED).exists()


# --- edits that cannot be ---

WRONG = {
    "focal_length": ["a", "", 0, -5.0, float("nan"), float("inf"), 10**400, (1, 2), [3], {}, True, 1e300],
    "position": [
        (0, 40, 16),
        (0, 40, 0),
        "abc",
        (),
        (1, 2),
        (1, 2, "z"),
        (None, None, None),
        (1, 2, float("nan")),
        (1, 2, 1e300),
        5,
        {},
    ],
    "principal_point": ["x", (480, 270), 1, None, []],
    "lens": ["mirror", [], {}, None, 5],
    "field_size": ["ab", [105], 5, (105, 680), (105, 20), (30, 20), (5, 5), (-105, 68), (0, 0), ("a", "b"), {}],
    "aspect": ["a", 0, -1, 100.0, float("nan"), (16, 9), [], True],
}


def test_edits_that_cannot_be_are_refused_before_they_are_kept(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), BLANK)
    editor = edited(tmp_path / "a.png", "soccer", out=tmp_path / "out")
    editor[0] = editor[0].clear().mark("Middle line", (3.0, 1.0), snap=False)
    before = (tmp_path / "out" / JOURNAL).read_bytes()
    for name, value in ((name, value) for name, values in WRONG.items() for value in values):
        with pytest.raises(ValueError, match=r"must be|m is larger than any|m has no room"):
            editor[0] = editor[0].know(**{name: value})
    assert (tmp_path / "out" / JOURNAL).read_bytes() == before
    assert editor.save() == 1


def test_numbers_of_numpy_are_kept(pictures, tmp_path):
    editor = opened(pictures, tmp_path / "out")
    editor[0] = editor[0].know(
        focal_length=np.float32(90.0), position=np.array([0, 40, -10]), principal_point=np.bool_(True)
    )
    editor.close()
    assert opened(pictures, tmp_path / "out")[0].known == Known(90.0, (0.0, 40.0, -10.0), True)


@pytest.mark.parametrize("known", [{"field_size": [105, 680]}, {"focal_length": "a"}, {"lens": []}, {"nonsense": 1}])
def test_a_journal_with_an_edit_that_cannot_be_opens_without_it(tmp_path, known):
    for name in "ab":
        cv2.imwrite(str(tmp_path / f"{name}.png"), BLANK)
    out = tmp_path / "out"

    def of_soccer():
        return edited(tmp_path / "a.png", "soccer", out=out)

    editor = of_soccer()
    for k in range(3):
        editor[0] = editor[0].mark("Middle line", (3.0, float(k)), snap=False)
    count = len(editor[0].marks)
    record = edit_to_record(editor[0].history.present)
    editor.close()
    with (out / JOURNAL).open("a") as file:
        wrong = {**record, "known": {**record["known"], **known}}
        file.write(json.dumps({"frame": "a", "then": wrong}) + "\n")
    with pytest.warns(LabelWarning, match=r"an edit that cannot be, which is left out: frame a: ") as warned:
        editor = of_soccer()
    assert warned[0].filename == editors.__file__  # where `Editor` is called
    assert len(editor[0].marks) == count
    editor[0] = editor[0].undo()
    assert len(editor[0].marks) == count - 1
    assert editor.save() == 1
    editor.close()
    with pytest.warns(LabelWarning, match="left out"):
        again = of_soccer()
    assert (len(again[0].marks), again.unsaved) == (count - 1, 0)  # the undo was that of the last edit that can be
    again[0] = again[0].redo()
    assert len(again[0].marks) == count


def test_a_frame_that_cannot_be_saved_does_not_stop_the_others(pictures, tmp_path):
    editor = marked(opened(pictures, tmp_path / "out"), 3)
    marked(editor, 2, number=1)
    editor.close()
    (pictures / "a.png").write_bytes(b"no picture")
    editor = opened(pictures, tmp_path / "out")
    assert editor.save() == 1
    assert list(editor.last_save.failed) == ["a"]
    assert editor.unsaved == 1
    assert (tmp_path / "out" / "labels" / "b.json").exists()
    cv2.imwrite(str(pictures / "a.png"), BLANK)
    assert editor.save() == 1


def test_labels_of_another_field_are_kept_and_do_not_stop_the_others(pictures, tmp_path):
    out = tmp_path / "out"
    editor = edited(pictures, "soccer", out=out)
    editor[0] = editor[0].clear().mark("Middle line", [(3.0, 1.0), (5.0, 9.0)], snap=False).know(field_size=(100, 64))
    editor.save()
    editor.close()
    with pytest.warns(LabelWarning, match="the field has no 'Middle line': such marks are kept"):
        editor = opened(pictures, out)
    marked(editor, 2, number=1)
    marked(editor, 2, number=0)
    assert editor.save() == 2
    assert json.loads((out / "labels" / "a.json").read_text()).keys() == {"Middle line", "Net top"}
    for format in ("labelme", "coco", "labelstudio"):
        editor.save_labels(format)
    editor.close()
    with pytest.warns(LabelWarning, match="no 'Net top'"):
        again = edited(pictures, "soccer", out=out)
    assert again[0].marks.pixels["Middle line"].tolist() == [[3.0, 1.0], [5.0, 9.0]]
    assert again[0].known.field_size == (100.0, 64.0)


def test_cameras_of_another_field_are_not_shown(tmp_path):
    """Results of soccer that are opened as tennis: frames are of tennis, and what is said of them too."""
    out = tmp_path / "out"
    camera = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (960, 540))
    for name in "ab":
        cv2.imwrite(str(tmp_path / f"{name}.png"), render_field(camera, soccer()))
    fieldcalib.calibrate(tmp_path, progress=False).save(out)
    editor = edited(tmp_path, "tennis", out=out)
    assert [editor[number].field.keys() == tennis().keys() for number in (0, 1)] == [True, True]
    assert editor[0].calibration.camera is None
    editor[0] = editor[0].mark("Base line left", (300.0, 200.0), snap=False)
    with pytest.raises(ValueError, match="unknown label"):
        editor[0].mark("Middle line", (300.0, 200.0))
    assert editor.save() == 1


def test_nothing_to_save_leaves_no_versions(pictures, tmp_path):
    editor = marked(opened(pictures, tmp_path / "out"), 3)
    editor.save()
    assert editor.save() == 0
    editor.save_labels("soccernet")
    assert not (tmp_path / "out" / "history").exists()


def test_what_was_taken_back_no_longer_rests_on_a_person(pictures, tmp_path):
    editor = marked(opened(pictures, tmp_path / "out"), 1)
    editor.save()
    editor[0] = editor[0].undo()
    editor.save()
    line = json.loads((tmp_path / "out" / "cameras.jsonl").read_text().splitlines()[0])
    assert "basis" not in line


# --- whatever ends a save ---

SAVING = """
# Saves in children that end at the k-th operation on files, and then once more.
import errno, json, os, shutil, signal, sys
from pathlib import Path
from fieldcalib import Editor
pictures, out, way, step = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], int(sys.argv[4])
OPERATIONS = {"os.rename", "os.link", "os.mkdir", "os.remove", "os.rmdir", "os.truncate", "os.chmod"}
left = None  # operations until the end; None is never


def happens(name, arguments):
    global left
    writes = name == "open" and isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)
    if left is None or not (name in OPERATIONS or writes or name == "fsync"):
        return
    left -= 1
    if left < 0:
        if way == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        raise OSError(errno.ENOSPC, "No space left on device")


fsync = os.fsync
os.fsync = lambda handle: (happens("fsync", ()), fsync(handle))
sys.addaudithook(happens)


def mark(editor, number, label, count):
    for k in range(count):
        editor[number] = editor[number].mark(label, (float(k), 1.0), snap=False)


def first(folder):
    editor = Editor(pictures, "tennis", out=folder)
    mark(editor, 0, "Net top", 3)
    editor.close()


def second(folder):
    editor = Editor(pictures, "tennis", out=folder)
    mark(editor, 0, "Net top", 3)
    mark(editor, 1, "Net top", 2)
    editor.save()
    editor[1] = editor[1].clear()
    mark(editor, 0, "Base line left", 2)
    editor.close()


def saved(folder):
    # what is lost, what is said, and the files of a folder after a save
    editor = Editor(pictures, "tennis", out=folder)
    marks = [one.marks for one in (editor[0], editor[1])]
    try:
        editor.save()
        said = ""
    except Exception as error:
        said = repr(error)
    editor.close()
    files = {path.relative_to(folder).as_posix(): path for path in folder.rglob("*") if path.is_file()}
    whole = {name: path.read_bytes() for name, path in files.items() if "history" not in name and name != "edits.jsonl"}
    return marks, said, whole


def interrupted(folder, k):
    # whether the save came to its end
    global left
    child = os.fork()
    if child == 0:
        try:
            editor = Editor(pictures, "tennis", out=folder)
            left = k
            try:
                editor.save()
                done = left >= 0
            except OSError:
                done, left = False, None
                editor.save()  # there is room again
            left = None
            editor.close()
            os._exit(0 if done else 1)
        except BaseException as error:
            print(json.dumps({"error": repr(error)}), flush=True)
            os._exit(3)
    status = os.waitpid(child, 0)[1]
    return os.WIFEXITED(status) and os.WEXITSTATUS(status) == 0


for begin in (first, second):
    begun = out / begin.__name__
    begin(begun)
    marks, said, whole = saved(shutil.copytree(begun, out / "whole"))
    shutil.rmtree(out / "whole")
    for k in range(0, 1000, step):
        folder = shutil.copytree(begun, out / "interrupted")
        is_done = interrupted(folder, k)
        found, said, files = saved(folder)
        result = {"begin": begin.__name__, "k": k, "lost": found != marks, "error": said, "same": files == whole}
        print(json.dumps(result), flush=True)
        shutil.rmtree(folder)
        if is_done:
            break
"""


@pytest.mark.parametrize("way", ["kill", pytest.param("full", marks=pytest.mark.slow)])
@pytest.mark.parametrize("step", [9, pytest.param(1, marks=pytest.mark.slow)])
def test_a_save_that_is_interrupted_goes_on(pictures, tmp_path, way, step):
    """At operations on files of a first and a second save, each or every ninth: killed, or with no room on the disk."""
    environment = {**os.environ, "PYTHONPATH": str(Path(fieldcalib.__file__).parents[1])}
    command = [sys.executable, "-c", SAVING, str(pictures), str(tmp_path), way, str(step)]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    tried = [json.loads(line) for line in run.stdout.splitlines()]
    assert min(sum(one.get("begin") == name for one in tried) for name in ("first", "second")) > 15 / step
    assert [one for one in tried if one.get("lost", True) or one["error"] or not one["same"]] == []


def test_a_save_that_another_program_has_overtaken_is_dropped(pictures, tmp_path):
    """It was announced, and its process ended before files were moved; a run has replaced them since."""
    out = tmp_path / "out"
    editor = marked(opened(pictures, out), 3)
    editor.save()
    marked(editor, 1)
    finish = editor.stored.versions.finish
    editor.stored.versions.finish = lambda announced: (_ for _ in ()).throw(SystemExit)
    with pytest.raises(SystemExit):
        editor.save()
    editor.stored.versions.finish = finish
    editor.close()
    put(out, "labels/a.json")
    again = opened(pictures, out)
    assert (out / "labels" / "a.json").read_bytes() == MINE
    assert (len(again[0].marks), again.unsaved) == (4, 1)
    (out / "labels" / "a.json").unlink()
    assert again.save() == 1


# --- damaged journals ---

ODD = st.sampled_from(
    [
        None,
        0,
        -1,
        5,
        "",
        "x",
        "../../x",
        [],
        {},
        [[]],
        [0],
        1e308,
        10**400,
        True,
        {"a": [1, 2]},
        {"../x": [1, 2]},
        [1, 2],
    ]
)


def journal_lines(folder):
    pictures, out = folder / "pictures", folder / "out"
    pictures.mkdir(parents=True)
    for name in "ab":
        cv2.imwrite(str(pictures / f"{name}.png"), BLANK)
    editor = marked(opened(pictures, out), 3)
    editor[0] = editor[0].undo()
    editor[0] = editor[0].redo()
    editor[0] = editor[0].know(focal_length=90.0)
    editor.save()
    marked(editor, 2, number=1)
    editor.save_labels("coco")
    editor.close()
    return pictures, out, [json.loads(line) for line in (out / JOURNAL).read_text().splitlines()]


@pytest.fixture(scope="module")
def journal(tmp_path_factory):
    return journal_lines(tmp_path_factory.mktemp("journal"))


def places(value, at=()):
    yield at
    for key, one in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from places(one, (*at, key))


def replaced(value, at, by):
    if not at:
        return by
    copy = value.copy()
    copy[at[0]] = replaced(value[at[0]], at[1:], by)
    return copy


def check_damaged(journal, data):
    """A damaged journal opens, perhaps without an edit, or is named as broken; what opens can be saved."""
    pictures, out, lines = journal
    number = data.draw(st.integers(0, len(lines) - 1))
    at = data.draw(st.sampled_from([one for one in places(lines[number]) if one]))
    damaged = [*lines]
    damaged[number] = replaced(lines[number], at, data.draw(ODD))
    if data.draw(st.booleans()):
        del damaged[data.draw(st.integers(0, len(lines) - 1))]
    (out / JOURNAL).write_text("".join(json.dumps(line) + "\n" for line in damaged))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LabelWarning)
        try:
            editor = opened(pictures, out)
            editor.fitted(0)
            editor.fitted(1)
        except BrokenFileError as error:
            assert JOURNAL in str(error)  # noqa: PT017 - most examples open
        else:
            editor.close()


@given(st.data())
def test_damaged_journals(journal, data):
    check_damaged(journal, data)


@pytest.mark.slow
@settings(max_examples=200)
@given(st.data())
def test_many_damaged_journals(journal, data):
    check_damaged(journal, data)


def test_a_damaged_journal_whose_numbers_are_no_numbers(journal):
    pictures, out, lines = journal
    for at, value in ((("known",), []), (("marks",), [["Net top", float("nan"), 1, True]]), (("known",), 5)):
        wrong = [replaced(line, ("then", *at), value) if "then" in line else line for line in lines]
        (out / JOURNAL).write_text("".join(json.dumps(line) + "\n" for line in wrong))
        with pytest.warns(LabelWarning, match="is no edit of a frame"):
            assert not len(opened(pictures, out)[0].marks)


# --- the server ---


class Served:
    """The page of a folder, in a process of its own."""

    def __init__(self, pictures, out):
        environment = {**os.environ, "PYTHONPATH": str(Path(fieldcalib.__file__).parents[1])}
        command = [sys.executable, "-m", "fieldcalib", "open", str(pictures), "--field", "tennis", "--out", str(out)]
        self.run = subprocess.Popen([*command, "--no-browser"], stdout=subprocess.PIPE, env=environment, text=True)
        self.address = self.run.stdout.readline().strip()
        self.origin = "/".join(self.address.split("/")[:3])

    def post(self, path, body):
        headers = {"Origin": self.origin, "Content-Type": "application/json"}
        request = urllib.request.Request(self.address + path, json.dumps(body).encode(), headers)
        with urllib.request.urlopen(request, timeout=20.0) as answer:
            return json.load(answer)

    def kill(self):
        self.run.kill()
        self.run.wait()
        self.run.stdout.close()


def check_kills(pictures, out, count, rng):
    """Kill the server while it marks and saves; what it answered is there afterwards, and can be saved."""
    for _ in range(count):
        served, revisions, marks = Served(pictures, out), {}, {}
        killer = threading.Timer(rng.uniform(0.1, 1.5), served.kill)
        try:
            for number in (0, 1):
                with urllib.request.urlopen(f"{served.address}api/frame/{number}", timeout=20.0) as answer:
                    state = json.load(answer)
                revisions[number], marks[number] = state["revision"], len(state["marks"])
            killer.start()
            for k in range(100_000):
                number = k % 2
                edit = {"do": "mark", "label": "Net top", "xy": [[float(k % 90), 1.0]], "snap": False}
                answer = served.post(f"api/frame/{number}/edit", {"revision": revisions[number], **edit})
                revisions[number], marks[number] = answer["revision"], len(answer["marks"])
                if k % 5 == 4:
                    served.post("api/save", {})
        except (OSError, http.client.HTTPException):  # it is gone
            killer.join()
        editor = opened(pictures, out)
        for number, said in marks.items():
            assert said <= len(editor[number].marks) <= said + 1
        editor.save()
        assert editor.unsaved == 0
        editor.close()


@pytest.mark.slow
def test_kills_while_saving(pictures, tmp_path):
    import uvicorn  # noqa: F401 - the server needs it

    check_kills(pictures, tmp_path / "out", 2, random.Random(0))


@pytest.mark.slow
def test_thirty_kills_while_saving(pictures, tmp_path):
    import uvicorn  # noqa: F401 - the server needs it

    check_kills(pictures, tmp_path / "out", 30, random.Random(1))
