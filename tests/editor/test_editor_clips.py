"""The editor and the folder of a clip: its files agree, whatever is kept, undone or drawn again."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from editors import (  # noqa: F401
    BLANK,
    CENTRE,
    LINES,
    OPENED,
    SIZE,
    _close_editors,
    edited,
    ends,
    marked,
    opened,
)

import fieldcalib
from fieldcalib import Camera, calibrate_from_segments, soccer
from fieldcalib.assess.findings import Finding, What
from fieldcalib.assess.result import with_findings
from fieldcalib.assess.video import Shot, VideoCalibration
from fieldcalib.editor.clip import BESIDE, CUTS, Proposal, Window, largest_move, with_cuts
from fieldcalib.editor.journal import JOURNAL
from fieldcalib.editor.label_versions import ChangedFileError
from fieldcalib.editor.saved_files import MOVED
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.videos import VideoReader
from fieldcalib.run_folder.record import CAMERA_FILE, camera_content

TRUTH, OTHER = (Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (x, 66.0, -16.0), (960, 540)) for x in (1.0, 4.0))


def nothing(count, starts=(0,), notes=()):
    """The calibration of a clip without any camera."""
    shots = tuple(Shot(*ends, -1) for ends in zip(starts, (*starts[1:], count), strict=True))
    return VideoCalibration((), shots, np.full(count, -1), np.zeros(count, dtype=int), notes)


def proposal(video, window, anchors=(), revisions=None):
    calibrations = {window.begin + k: one for k, one in enumerate(video)}
    moves = dict.fromkeys(calibrations, np.nan)
    return Proposal(window, video, calibrations, frozenset(anchors), moves, revisions or {})


@pytest.mark.parametrize(
    ("other", "found", "what"),
    [
        (TRUTH, (), None),
        (OTHER, (), "the place of its camera, 3.0 m from where they put it"),
        (OTHER, (Finding(What.OTHER_SIZE, numbers=(101.0, 68.0)),), "the size of its field"),
        (None, (), "its cameras"),
    ],
)
def test_what_the_labels_of_a_frame_contradict_is_said(other, found, what):
    """Before anything is kept: its camera is not that of the clip."""
    labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top")
    pixels = {label: TRUTH.project(soccer()[label].sample(9.0)) for label in labels}
    one = replace(calibrate_from_segments(soccer(), pixels, TRUTH.image_size), camera=TRUTH)
    window, own = Window(4, 6), {4: one, 5: replace(one, camera=other)}
    in_clip = [with_findings(one, *found)] * 2
    kept = Proposal(window, in_clip, own, frozenset([4, 5]), dict.fromkeys(own, 0.0))
    assert kept.contradicted == ({} if what is None else {5: what})
    assert repr(kept) == "Proposal(frames 4 to 5, moved by up to 0.0 px)"


@pytest.fixture
def clip(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "clip.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (96, 54))
    for _ in range(8):
        writer.write(BLANK)
    writer.release()
    return tmp_path / "clip.avi"


def starts_of(out):
    return [shot["first_frame"] for shot in json.loads((out / "tripods.json").read_text())["shots"]]


def notes_of(out):
    return json.loads((out / "summary.json").read_text()).get("notes", [])


def test_a_kept_clip_is_saved(clip, tmp_path):
    out = tmp_path / "out"
    editor = marked(opened(clip, out), 2, number=5)
    anchors = {5: editor.revision(5)}
    editor.keep(proposal(nothing(8, (0, 3)), Window(0, 8), anchors, anchors))
    assert editor.unsaved == 0
    assert (out / "labels" / "000005.json").exists()
    assert editor.cuts == starts_of(out) == [0, 3]
    assert str(BESIDE) not in notes_of(out)
    editor.close()
    assert opened(clip, out).unsaved == 0


def files_of(out):
    """Contents of the files of a folder, without its history and its journal."""
    paths = [one for one in out.rglob("*") if one.is_file() and "history" not in one.parts]
    return {one.relative_to(out).as_posix(): one.read_bytes() for one in paths if one.name != JOURNAL}


def test_a_clip_of_which_some_frames_were_saved_is_opened_whole(clip, tmp_path):
    editor = marked(opened(clip, tmp_path / "out"), 1, number=5)
    assert editor.save() == 1
    editor.close()
    again = opened(clip, tmp_path / "out")
    assert len(again) == 8
    assert len(again[5].marks) == 1
    assert again[6].is_automatic


def test_keep_is_undone(clip, tmp_path):
    out = tmp_path / "out"
    editor = marked(opened(clip, out), 2, number=5)
    editor.save()
    marked(editor, 3, number=5)
    _, found = editor.fitted(2), editor.fitted(5).calibration
    before, rows = files_of(out), list(editor.table.rows)
    anchors = {5: editor.revision(5)}
    kept = proposal(nothing(8, (0, 3)), Window(0, 8), anchors, anchors)
    assert not editor.can_undo_keep
    editor.keep(kept)
    assert editor.can_undo_keep
    assert files_of(out) != before
    _ = editor.fitted(7)  # looked at since
    assert editor.undo_keep() is kept
    assert files_of(out) == before
    assert (editor.unsaved, editor.cuts, list(editor.table.rows)) == (1, [], rows)
    assert editor.fitted(5).calibration is found
    with pytest.raises(ValueError, match="expected a solution that was kept last"):
        editor.undo_keep()
    editor.close()
    again = opened(clip, out)
    assert again.unsaved == 1
    assert len(again[5].marks) == 5
    assert again.keep(kept) == 8  # and may be kept again


def test_what_is_changed_after_keep_stays_when_that_is_undone(clip, tmp_path):
    out = tmp_path / "out"
    editor = marked(opened(clip, out), 2, number=5)
    anchors = {5: editor.revision(5)}
    editor.keep(proposal(nothing(8, (0, 3)), Window(0, 8), anchors, anchors))
    marked(editor, 1, number=5)
    marked(editor, 1, number=6)
    editor.undo_keep()
    assert [name for name in files_of(out) if name.startswith(("cameras", "clip", "labels"))] == []
    assert (len(editor[5].marks), len(editor[6].marks), editor.unsaved) == (3, 1, 2)
    assert editor.save() >= 2
    assert not editor.can_undo_keep


def test_a_save_after_keep_ends_its_undo(clip, tmp_path):
    editor = marked(opened(clip, tmp_path / "out"), 2, number=5)
    anchors = {5: editor.revision(5)}
    editor.keep(proposal(nothing(8), Window(0, 8), anchors, anchors))
    marked(editor, 1, number=6)
    editor.save()
    with pytest.raises(ValueError, match="expected a solution that was kept last"):
        editor.undo_keep()


def test_a_mended_frame_has_the_camera_of_the_clip_again_with_its_marks(clip, tmp_path):
    editor = marked(opened(clip, tmp_path / "out"), 2, number=5)
    anchors = {5: editor.revision(5)}
    of_clip = proposal(nothing(8), Window(0, 8), anchors, anchors)
    editor.keep(of_clip)
    editor[5] = editor[5].undo()
    assert editor.fitted(5).calibration is not of_clip.calibrations[5]
    editor[5] = editor[5].redo()
    assert editor.fitted(5).calibration is of_clip.calibrations[5]


def of_a_run(out):
    """Let a folder that an editor has kept be that of a run, which has no journal."""
    OPENED.pop().close()
    (out / JOURNAL).unlink()
    record = json.loads((out / "run.json").read_text())
    (out / "run.json").write_text(json.dumps({**record, "command": "run"}))
    return out


def with_camera_files(clip, out):
    """A folder of results as `run --camera-files` leaves it, whose frames nobody has looked at."""
    opened(clip, out).keep(proposal(panned(8), Window(0, 8)))
    of_a_run(out)
    record = json.loads((out / "run.json").read_text())
    (out / "run.json").write_text(json.dumps({**record, "writes": [CAMERA_FILE, *record["writes"]]}))
    for line in map(json.loads, (out / "cameras.jsonl").read_text().splitlines()):
        (out / f"camera_{line['id']}.json").write_bytes(camera_content(line))
    return out


def test_a_mark_far_from_the_camera_of_the_clip_is_told(clip, tmp_path, monkeypatch):
    """A camera that the clip gives a mended frame is to be checked, as that of a picture is."""
    editor, camera = edited(clip, out=tmp_path / "out"), TRUTH.scaled((96, 54))
    near, far = camera.project(soccer()["Big rect. right main"].sample(1.0))[:2], [(20.0, 50.0), (30.0, 50.0)]
    editor[5] = editor[5].clear().mark("Big rect. right main", near, snap=False)
    editor[5] = editor[5].mark("Middle line", far, snap=False)
    labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top")
    pixels = {label: camera.project(soccer()[label].sample(3.0)) for label in labels}
    of_clip = calibrate_from_segments(soccer(), pixels, camera.image_size)
    monkeypatch.setattr("fieldcalib.editor.editor.first_pass", lambda *_: None)
    monkeypatch.setattr("fieldcalib.editor.editor.solve", lambda *_: proposal([of_clip] * 8, Window(0, 8), [5]))
    found = editor.solve().calibrations
    assert [(one.what, one.about) for one in found[5].findings if one.what is What.STRAY] == [
        (What.STRAY, "Middle line")
    ]
    assert "correct 'Middle line'" in found[5].remedy
    assert found[4] is of_clip


def test_a_clip_is_kept_in_the_folder_of_a_run(clip, tmp_path):
    out = with_camera_files(clip, tmp_path / "out")
    before = {path.name: path.read_bytes() for path in out.glob("camera_*.json")}
    assert len(before) == 8
    opened(clip, out).keep(proposal(nothing(8, (0, 3)), Window(0, 8)))
    assert starts_of(out) == [0, 3]
    assert not [*out.glob("camera_*.json")]
    assert {path.name: path.read_bytes() for path in (out / "history").glob("*/camera_*.json")} == before


def test_a_camera_that_another_program_has_changed(clip, tmp_path):
    """Also that of a frame that nobody has looked at."""
    out = with_camera_files(clip, tmp_path / "out")
    editor = opened(clip, out)
    (out / "camera_000006.json").write_text("changed")
    with pytest.raises(ChangedFileError, match=r"camera_000006\.json was changed"):
        editor.keep(proposal(panned(8, 0.01), Window(0, 8)))
    assert (out / "camera_000006.json").read_text() == "changed"


def test_a_change_after_a_clip_was_solved_is_not_kept_with_it(clip, tmp_path):
    editor = marked(opened(clip, tmp_path / "out"), 2, number=5)
    anchors = {5: editor.revision(5)}
    marked(marked(editor, 1, number=5), 1, number=6)
    editor.keep(proposal(nothing(8), Window(0, 8), anchors, anchors))
    assert editor.unsaved == 2


@pytest.mark.parametrize("shots", [3, [[]], [{"first_frame": None}], [{"first_frame": True}], [{"first_frame": -1}]])
def test_damaged_shots_are_named(clip, tmp_path, shots):
    out = tmp_path / "out"
    editor = opened(clip, out)
    editor.keep(proposal(nothing(8, (0, 3)), Window(0, 8)))
    editor.close()
    (out / "edits.jsonl").unlink()
    (out / "tripods.json").write_text(json.dumps({"shots": shots}))
    with pytest.raises(BrokenFileError, match=r"tripods\.json: 'shots': expected"):
        opened(clip, out)


def test_a_damaged_summary_is_named(clip, tmp_path):
    out = tmp_path / "out"
    editor = opened(clip, out)
    editor.keep(proposal(nothing(8), Window(0, 8)))
    (out / "summary.json").write_text("[]")
    with pytest.raises(BrokenFileError, match=r"summary\.json: expected a JSON object"):
        assert editor.stored.moved


def test_a_clip_whose_frames_were_mended_says_so(clip, tmp_path):
    out = tmp_path / "out"
    editor = opened(clip, out)
    editor.keep(proposal(nothing(8, (0, 3), ("a note",)), Window(0, 8)))
    for name in ("overlay.mp4", "motion.png", "worst_frames.jpg", "report.html"):
        (out / name).write_text("as it was")
    of_a_run(out)
    editor = marked(opened(clip, out), 4, number=5)
    editor.save()
    video = fieldcalib.read(out).video
    assert (video.notes, video.findings) == (("a note",), (BESIDE,))
    assert json.loads((out / "tripods.json").read_text())["notes"] == ["a note", str(BESIDE)]
    assert starts_of(out) == [0, 3]
    moved = ["overlay.mp4", "motion.png", "worst_frames.jpg", "report.html"]
    assert notes_of(out) == ["a note", str(BESIDE), *(MOVED[name] for name in moved)]
    for name in moved:
        assert not (out / name).exists()
        assert [path.read_text() for path in (out / "history").glob(f"*/{name}")] == ["as it was"]
    editor[5] = editor[5].remove([0])
    editor.save()
    assert notes_of(out) == ["a note", str(BESIDE), *(MOVED[name] for name in moved)]
    editor.close()
    opened(clip, out).keep(proposal(nothing(8), Window(0, 8)))
    assert notes_of(out) == [MOVED[name] for name in moved if name != "motion.png"]
    assert cv2.imread(str(out / "motion.png")) is not None  # drawn again


def test_a_window_of_a_clip(clip, tmp_path):
    """What is outside of it stays as it was."""
    out = tmp_path / "out"
    editor = opened(clip, out)
    editor.keep(proposal(nothing(8, (0, 2, 7)), Window(0, 8)))
    editor.keep(proposal(nothing(3, (0, 1)), Window(3, 6)))
    assert editor.cuts == [0, 2, 3, 4, 7]
    assert starts_of(out) == [0, 2, 3, 4, 6, 7]
    assert len(fieldcalib.read(out).video) == 8
    assert len((out / "cameras.jsonl").read_text().splitlines()) == 8


def panned(count, by=0.0):
    """The calibration of a clip of one tripod, panned by some radians more."""
    return VideoCalibration(
        (panned_clip(count, by),), (Shot(0, count, 0),), np.zeros(count, dtype=int), np.arange(count)
    )


def panned_clip(count=6, by=0.0):
    cameras = [Camera.from_angles(by - 0.3 + 0.01 * k, 1.35, 0.0, 1600.0, CENTRE, SIZE) for k in range(count)]
    labels = [{label: ends(label, camera) for label in LINES} for camera in cameras]
    return fieldcalib.calibrate_sequence(soccer(), labels, SIZE)


def test_a_window_keeps_the_tripods_outside():
    before = VideoCalibration((panned_clip(),), (Shot(0, 6, 0),), np.zeros(6, dtype=int), np.arange(6))
    whole = proposal(nothing(2), Window(2, 4)).whole(before, 6)
    assert [one.camera is None for one in whole] == [False, False, True, True, False, False]
    for k in (0, 1, 4, 5):
        assert whole[k].camera == before[k].camera
    by_hand = proposal(before, Window(0, 6), [3])
    assert BESIDE not in by_hand.whole(None, 6).findings
    held = replace(by_hand, calibrations={**by_hand.calibrations, 3: before[4]})
    assert BESIDE in held.whole(None, 6).findings
    assert held.whole(None, 7) is None


DRAWINGS = ("overlay.mp4", "motion.png", "worst_frames.jpg", "report.html")


def with_drawings(clip, out):
    """A folder of results of a clip that was kept, with drawings of it."""
    editor = opened(clip, out)
    editor.keep(proposal(nothing(8), Window(0, 8)))
    for name in DRAWINGS:
        (out / name).write_text("as it was")
    return of_a_run(out)


def test_files_stay_where_no_camera_has_changed(clip, tmp_path):
    out = with_drawings(clip, tmp_path / "out")
    editor = marked(opened(clip, out), 2, number=5)
    editor[5] = editor.automatic(5)
    editor.save()
    assert editor.unsaved == 0
    assert [(out / name).read_text() for name in DRAWINGS] == 4 * ["as it was"]
    assert notes_of(out) == list(fieldcalib.read(out).video.notes) == []


def test_what_was_drawn_is_drawn_again(clip, tmp_path):
    out = with_drawings(clip, tmp_path / "out")
    editor = marked(opened(clip, out), 4, number=5)
    assert editor.to_draw == []
    assert editor.draw() == []
    editor.save()
    assert set(editor.to_draw) == {"overlay.mp4", "motion.png", "worst_frames.jpg"}

    def cancelled(done, count, stage):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        editor.draw(cancelled)
    assert not (out / "overlay.mp4").exists()
    done = []
    assert set(editor.draw(lambda *at: done.append(at))) == {"overlay.mp4", "motion.png", "worst_frames.jpg"}
    assert done == [(k, 8, "drawing overlay.mp4") for k in range(8)]
    assert editor.to_draw == []
    assert notes_of(out) == [str(BESIDE), MOVED["report.html"]]
    assert VideoReader(out / "overlay.mp4").count == 8
    assert cv2.imread(str(out / "worst_frames.jpg")) is not None
    marked(editor, 1, number=5).save()
    assert len([*(out / "history").glob("*/overlay.mp4")]) == 2

    def saves(done, count, stage):
        if done == 3:
            marked(editor, 6, number=2).save()

    assert editor.draw(saves) == []
    assert not (out / "overlay.mp4").exists()


def test_cuts_survive_saving_without_solving(clip, tmp_path):
    out = tmp_path / "out"
    editor = opened(clip, out)
    editor.keep(proposal(nothing(8, (0, 3)), Window(0, 8)))
    editor.set_cuts([2, 6])
    editor.save()
    assert starts_of(out) == [0, 2, 6]
    assert [shot.start for shot in fieldcalib.read(out).video.shots] == [0, 2, 6]
    assert notes_of(out) == []


def test_a_shot_of_two_tripods_is_said():
    first, second = (
        VideoCalibration((panned_clip(3),), (Shot(0, 3, 0),), np.zeros(3, int), np.arange(3)) for _ in "ab"
    )
    both = VideoCalibration.joined([first, second])
    assert [shot.start for shot in with_cuts(both, [1, 3]).shots] == [0, 1, 3]
    moved = with_cuts(both, [4])
    assert (moved.shots, moved.findings) == (both.shots, (CUTS,))
    assert with_cuts(moved, [3]).notes == ()


def test_a_kept_window_brings_files_together_again():
    """The note of frames that were mended since goes, unless some are outside of the window."""
    video = replace(nothing(8), notes=("a note",), findings=(BESIDE,))
    window = proposal(nothing(4), Window(2, 6))
    assert window.whole(video, 8).notes == ("a note",)
    assert window.whole(video, 8, mended_outside=True).findings == (BESIDE,)


def test_what_was_kept_is_shown(clip, tmp_path):
    """An anchor has the camera of the clip, also when the folder is opened again, until it is changed."""
    out = tmp_path / "out"
    editor = edited(clip, "soccer", out=out)
    editor[5] = editor[5].mark("Middle line", [(10.0, 5.0), (12.0, 40.0)], snap=False)
    camera = Camera.from_angles(-0.3, 1.35, 0.0, 160.0, CENTRE, (96, 54))
    found = fieldcalib.calibrate_from_homography(camera.homography, (96, 54))
    anchors = {5: editor.revision(5)}
    kept = proposal(nothing(8), Window(0, 8), anchors, anchors)
    editor.keep(replace(kept, calibrations={**kept.calibrations, 5: found}))
    assert editor.fitted(5).calibration.camera == found.camera
    assert editor.table.rows[5].pan is not None
    editor.close()
    again = edited(clip, "soccer", out=out)
    assert largest_move(again.fitted(5).calibration.camera, found.camera) < 1e-6
    again[5] = again[5].mark("Middle line", (11.0, 20.0), snap=False)
    assert not largest_move(again.fitted(5).calibration.camera, found.camera) < 1.0
