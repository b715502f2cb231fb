"""Frames that a person labels: marks and their history, clicks on paint, advice, and the camera that follows."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import examples, pixel_arrays
from views import inside

from fieldcalib import Camera, calibrate_batch, calibrate_from_homography, calibrate_from_segments, soccer
from fieldcalib.assess.advice import NoCameraError
from fieldcalib.assess.findings import Status
from fieldcalib.assess.result import Calibration
from fieldcalib.draw.scene import render_field
from fieldcalib.editor.edit import Edit, History, Known, Marks
from fieldcalib.editor.frame import GRID, REACH, FrameEditor, click_errors, likely_labels, next_mark, snapped

FIELD, SIZE = soccer(), (960, 540)
TRUTH = Camera.from_angles(-0.3, 1.35, 0.01, 1500.0, (0.0, 66.0, -16.0), SIZE)
LABELS = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left")
CLICKS = pixel_arrays((0.0, 0.0), (959.0, 539.0), 3)


@pytest.fixture(scope="module")
def image():
    return render_field(TRUTH, FIELD, rng=np.random.default_rng(0))


def on_marking(label, camera=TRUTH, spacing=3.0, margin=10.0):
    """Pixels along a marking in view."""
    xy = camera.project(FIELD[label].sample(spacing))
    return xy[((xy > margin) & (xy < np.subtract(camera.image_size, 1 + margin))).all(axis=1)]


def ends_of(labels=LABELS):
    return {label: on_marking(label)[[0, -1]] for label in labels}


# --- marks and their history ---


@given(st.dictionaries(st.sampled_from(LABELS), CLICKS), st.data())
def test_marks_that_are_moved_and_relabelled_and_removed(pixels, data):
    marks = Marks.of(pixels)
    assert {label: xy.tolist() for label, xy in marks.pixels.items()} == {k: v.tolist() for k, v in pixels.items()}
    numbers = data.draw(st.sets(st.integers(0, len(marks) - 1))) if len(marks) else set()
    moved = marks.moved(dict.fromkeys(numbers, (1.0, 2.0)))
    assert [one[1:3] == (1.0, 2.0) for one in moved.all] == [
        k in numbers or one[1:3] == (1.0, 2.0) for k, one in enumerate(marks.all)
    ]
    assert {one.label for k, one in enumerate(marks.relabelled(numbers, "x").all) if k in numbers} <= {"x"}
    assert len(marks.without(numbers)) == len(marks) - len(numbers)


@pytest.mark.parametrize("number", [-1, 2])
def test_numbers_of_no_mark(number):
    marks = Marks().added("Middle line", [(1, 2), (3, 4)])
    for change in (lambda: marks.moved({number: (0, 0)}), lambda: marks.without([number])):
        with pytest.raises(ValueError, match="expected numbers of marks from 0 to 1"):
            change()


@given(st.lists(st.one_of(st.integers(0, 3), st.sampled_from(["undo", "redo"]))))
def test_history_is_that_of_any_editor(actions):
    """Against a plain list of states and a place in it."""
    history, states, place = History(0), [0], 0
    for action in actions:
        if action == "undo":
            history, place = history.undone, max(place - 1, 0)
        elif action == "redo":
            history, place = history.redone, min(place + 1, len(states) - 1)
        else:
            history = history.then(action)
            if action != states[place]:
                states, place = [*states[: place + 1], action], place + 1
        assert history.present == states[place]
        assert (history.can_undo, history.can_redo) == (place > 0, place < len(states) - 1)


# --- clicks on paint ---


@pytest.mark.parametrize("noise", [1.0, 2.0])
def test_clicks_beside_a_line_snap_to_its_middle(image, noise):
    rng, before, after = np.random.default_rng(1), [], []
    for label in LABELS:
        curve = on_marking(label, spacing=0.05)
        for xy in on_marking(label, margin=30.0):
            click = xy + rng.normal(0.0, noise, 2)
            before.append(np.min(np.linalg.norm(curve - click, axis=1)))
            way = curve[-1] - curve[0] if FIELD[label].is_straight else None
            after.append(np.min(np.linalg.norm(curve - snapped(image, click, way), axis=1)))
    assert np.median(after) < 0.45 < np.median(before)  # lines at the border are painted inside of it
    assert np.mean(np.array(after) < 1.0) > 0.8


@given(st.floats(0.0, np.pi), st.floats(-4.0, 4.0), st.floats(2.5, 6.0))
def test_the_middle_of_a_line_in_any_direction(angle, distance, width):
    x, y = np.meshgrid(np.arange(200.0), np.arange(160.0))
    normal = np.array([np.cos(angle), np.sin(angle)])
    across = (x - 100.3) * normal[0] + (y - 80.7) * normal[1]
    cover = np.clip(0.5 * width - np.abs(across) + 0.5, 0.0, 1.0)
    picture = np.repeat((60.0 + 150.0 * cover)[..., None], 3, axis=-1).astype(np.uint8)
    found = snapped(np.pad(picture, ((190, 190), (380, 380), (0, 0)), mode="edge"), (480.3, 270.7) + distance * normal)
    assert abs((found - (480.3, 270.7)) @ normal) < 0.25


def test_clicks_away_from_lines_stay(image):
    grass = np.full((540, 960, 3), (60, 140, 60), np.uint8)
    for click in [(0.0, 0.0), (959.0, 539.0), (480.5, 3.25), (-5.0, 700.0)]:
        np.testing.assert_array_equal(snapped(grass, click), click)
    far = on_marking("Side line top")[3] + (0.0, 2.0 * REACH)
    assert np.linalg.norm(snapped(image, far) - far) <= REACH


# --- advice ---


def test_likely_labels_begin_with_the_nearest():
    for label in LABELS:
        for xy in on_marking(label, margin=40.0):
            likely = likely_labels(FIELD, TRUTH, xy)
            distance = min(np.linalg.norm(on_marking(likely[0], spacing=0.05, margin=0.0) - xy, axis=1))
            assert distance < 1.0
    assert likely_labels(FIELD, None, (0.0, 0.0)) == list(FIELD.markings)


def calibrated(pixels):
    return calibrate_from_segments(FIELD, pixels, SIZE)


def test_the_next_mark_lowers_the_errors_as_it_says():
    """By the covariance of the frame that is calibrated with it, whose weights differ a little."""
    calibration = calibrated(ends_of(LABELS[:4]))
    found = next_mark(calibration)
    assert found.label in FIELD.markings
    assert 0.1 < found.gain < 1.0
    shown = np.linalg.norm(on_marking(found.label, calibration.camera, 0.05, 0.0) - found.xy, axis=1)
    assert np.min(shown) < 1.0  # it lies where the camera projects that marking

    x, y = (np.linspace(-half, half, count) for half, count in zip(FIELD.half_extent, GRID, strict=True))
    X = np.array([(a, b, 0.0) for a in x for b in y])
    seen = TRUTH.project(X)
    X = X[((seen >= 0.0) & (seen < SIZE)).all(axis=1)]

    def error(pixels):
        return np.mean(np.square(calibrated(pixels).uncertainty.at_field(X).rms))

    given = ends_of(LABELS[:4])
    where = on_marking(found.label, spacing=0.05)
    xy = where[np.argmin(np.linalg.norm(where - found.xy, axis=1))]
    more = {**given, found.label: np.vstack([given.get(found.label, np.empty((0, 2))), xy])}
    assert error(more) < (1.0 - 0.4 * found.gain) * error(given)


def test_no_next_mark_without_a_camera():
    assert next_mark(Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "nothing")) is None


@examples(10)
@given(st.integers(0, 2**32 - 1))
def test_click_errors_are_the_shifts_of_inexact_clicks(seed):
    """By simulation: the cameras of clicks that are off by a tenth of a pixel."""
    pixels = ends_of()
    calibration = calibrated(pixels)
    X = np.array([(-45.0, -20.0, 0.0), (-36.0, 10.0, 0.0), (-20.0, 0.0, 0.0)])
    rng, shifts = np.random.default_rng(seed), []
    clicks = [{label: xy + rng.normal(0.0, 0.1, xy.shape) for label, xy in pixels.items()} for _ in range(25)]
    for other in calibrate_batch(FIELD, clicks, SIZE):
        shifts.append(other.camera.image_to_field(calibration.camera.project(X)) - X)
    rms = np.sqrt(np.mean(np.sum(np.square(shifts), axis=-1), axis=0))
    expected = click_errors(replace(calibration, field=FIELD), X, 0.1)
    assert np.all((rms > 0.5 * expected) & (rms < 2.0 * expected))


def test_errors_of_clicks_need_clicks():
    with pytest.raises(NoCameraError, match="nothing"):
        click_errors(Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "nothing"), (0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="expected the calibration of a single frame"):
        click_errors(calibrate_from_homography(TRUTH.homography, SIZE), (0.0, 0.0, 0.0))


# --- the editor ---


def worst_in_view(camera):
    """Largest distance of markings in view from where a camera projects them, pixels."""
    worst = 0.0
    for label, segment in FIELD.markings.items():
        X = segment.sample(3.0)
        seen = inside(TRUTH.project(X))
        if np.any(seen) and "Goal" not in label:
            worst = max(worst, np.max(np.linalg.norm(camera.project(X) - TRUTH.project(X), axis=1)[seen]))
    return worst


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
def test_a_frame_is_labelled_from_nothing(image, seed):
    """Clicks that are 2 px off: eight on four lines, then four where the editor asks for one."""
    rng = np.random.default_rng(seed)
    editor = FrameEditor.of(image)
    assert not editor.calibration
    for label, xy in ends_of(LABELS[:4]).items():
        editor = editor.mark(label, xy + rng.normal(0.0, 2.0, xy.shape))
    for _ in range(4):
        label, asked, _ = editor.next_mark
        there = on_marking(label, spacing=0.05)
        editor = editor.mark(label, there[np.argmin(np.linalg.norm(there - asked, axis=1))] + rng.normal(0.0, 2.0, 2))
    assert editor.calibration.accepted
    assert len(editor.marks) == 12
    assert worst_in_view(editor.calibration.camera) < 1.0  # refined on the image
    assert np.all(editor.click_errors([(-40.0, 0.0, 0.0)]) < 1.0)


def test_twenty_steps_back_and_forth(image):
    editor = FrameEditor.of(image)
    seen = [editor.marks]
    for number in range(20):
        editor = editor.mark(LABELS[number % 5], (100.0 + 30.0 * number, 300.0), snap=False)
        seen.append(editor.marks)
    for marks in seen[-2::-1]:
        editor = editor.undo()
        assert editor.marks == marks
    assert editor.undo().marks == editor.marks
    for marks in seen[1:]:
        editor = editor.redo()
        assert editor.marks == marks


def test_the_camera_follows_from_the_marks_however_they_came(image):
    editor = FrameEditor.of(image)
    for label, xy in ends_of().items():
        editor = editor.mark(label, xy)
        _ = editor.calibration  # as after each click
    editor = editor.move({0: editor.marks.all[0][1:3] + np.array([3.0, 2.0])}, snap=False).undo().remove([1]).undo()
    cold = FrameEditor.of(image, pixels=editor.marks.pixels)
    assert editor.calibration.camera == cold.calibration.camera
    assert editor.calibration.reason == cold.calibration.reason


def test_a_wrong_label_does_not_keep_the_camera_from_the_paint():
    """The paint then tells what it is a label of, which the labels of one end do not."""
    truth = Camera.from_angles(-0.3, 1.35, 0.0, 1300.0, (1.5, 66.0, -16.0), SIZE, k=(-0.04, 0.0))
    pixels = {label: on_marking(label, truth)[[0, len(on_marking(label, truth)) // 2, -1]] for label in LABELS}
    pixels["Side line bottom"] = on_marking("Middle line", truth)[[0, -1]]
    editor = FrameEditor.of(render_field(truth, FIELD, rng=np.random.default_rng(0)), FIELD)
    for label, xy in pixels.items():
        editor = editor.mark(label, xy)
    found = editor.calibration
    assert [(one.label, one.fits) for one in found.suspect_labels] == [("Side line bottom", "Middle line")]
    assert found.reason.count("Side line bottom") == 1
    assert found.markings  # paint was looked for
    assert np.linalg.norm(found.camera.C - truth.C) < 0.5


def test_marks_are_mended(image):
    pixels = ends_of()
    editor = FrameEditor.of(image, FIELD, {**pixels, "Middle line": pixels["Side line left"]})
    numbers = [k for k, one in enumerate(editor.marks.all) if one.label == "Middle line"]
    assert editor.calibration.suspect_labels[0].label == "Middle line"
    assert editor.likely_labels(pixels["Side line left"][1])[0] == "Side line left"  # [0] is a corner
    mended = editor.relabel(numbers, "Side line left")
    assert mended.calibration.suspect_labels == ()
    assert editor.remove(numbers).marks == Marks.of(pixels)
    dragged = editor.move({numbers[0]: (480.0, 270.0)}, snap=False)
    assert dragged.marks.all[numbers[0]] == ("Middle line", 480.0, 270.0, True)
    assert dragged.undo().marks == editor.marks


def test_what_is_known_is_kept(image):
    editor = FrameEditor.of(image, pixels=ends_of())
    known = editor.know(focal_length=1500.0, position=(0.0, 66.0, -16.0), principal_point=True, lens="none")
    camera = known.calibration.camera
    assert camera.focal_length == 1500.0
    np.testing.assert_array_equal(camera.C, (0.0, 66.0, -16.0))
    np.testing.assert_array_equal(camera.K[:2, 2], (480.0, 270.0))
    sized = editor.know(field_size=(100.0, 64.0)).calibration
    assert (sized.field.length, sized.field.width, sized.field.size_known) == (100.0, 64.0, True)
    assert known.undo().known == Known()


@pytest.mark.parametrize(
    ("do", "message"),
    [
        (lambda editor: editor.mark("Midle line", (0, 0)), "did you mean 'Middle line'"),
        (lambda editor: editor.mark("Middle line", [(9, 9), (5000, 20)]), r"pixels: \(5000, 20\) lies far outside"),
        (lambda editor: editor.mark("Middle line", (9, 9)).move({0: (5000, 20)}), r"\(5000, 20\) lies far outside"),
        (lambda editor: editor.relabel([], "nothing at all"), "unknown label"),
        (lambda editor: editor.move({7: (0.0, 0.0)}), "expected numbers of marks"),
        (lambda editor: editor.know(lens="mirror"), "lens must be one of none, k1"),
        (lambda editor: FrameEditor.of(editor.image, pixels={"x": [(1, 2)]}), "unknown label 'x'"),
        (lambda editor: FrameEditor.of(editor.image[..., 0]), "image"),
        (lambda editor: FrameEditor.of(editor.image, "soccre"), "soccer"),
    ],
)
def test_what_is_wrong_is_said(image, do, message):
    with pytest.raises(ValueError, match=message):
        do(FrameEditor.of(image))


def test_marks_of_which_nothing_can_be_made_are_kept(image):
    """Two marks in the corner look like normalised coordinates; the reason says so, and more marks mend it."""
    editor = FrameEditor.of(image).mark("Side line left", [(0.0, 1.0), (1.0, 1.0)], snap=False)
    assert editor.calibration.camera is None
    assert "look normalised" in editor.calibration.message
    editor = editor.remove([0, 1])
    for label, xy in ends_of().items():
        editor = editor.mark(label, xy)
    assert editor.calibration.accepted


@pytest.mark.parametrize(
    "xy", [(float("nan"), 2.0), [(3.0, 4.0), (np.inf, 1.0)], [1, 2, 3], None, "a", np.zeros((1, 1, 2))]
)
def test_clicks_that_are_no_pixels(xy):
    frame = FrameEditor.of(np.zeros((54, 96, 3), np.uint8))
    with pytest.raises(
        ValueError, match=r"expected a pixel \(x, y\), or several of shape \(N, 2\), finite numbers, got "
    ):
        frame.mark("Middle line", xy)


def test_labels_of_a_network_that_its_camera_does_not_follow_have_no_part_in_what_a_person_goes_on_with(image):
    """One right mark of a person had made another camera of them: after it 15 of 107 good pictures were "check"."""
    false = {"Side line bottom": np.array([(100.0, 300.0), (900.0, 280.0)])}
    base = calibrate_from_segments(FIELD, ends_of(), SIZE)
    network = Marks.of({**ends_of(), **false}, by_hand=False)
    frame = FrameEditor(image, FIELD, History(Edit(network, automatic=True)), base)
    mark = on_marking("Small rect. left main")[[0]]
    for changed in (frame.mark("Small rect. left main", mark), frame.know(lens="none"), frame.remove([0])):
        assert {one.label for one in changed.marks.all if not one.by_hand} == set(LABELS)
        assert changed.undo().marks == network
    assert "Side line bottom" in frame.mark("Side line bottom", (500.0, 530.0)).marks.pixels  # a person's own
    others = {label: xy + 1.0 for label, xy in false.items()}
    assert "Side line bottom" in frame.with_marks(Marks.of(others, by_hand=False)).marks.pixels  # given instead
    found = frame.mark("Small rect. left main", mark).calibration
    np.testing.assert_allclose(found.camera.project([(-30.0, 0.0, 0.0)]), TRUTH.project([(-30.0, 0.0, 0.0)]), atol=1.5)


def test_right_marks_of_a_person_leave_a_good_camera_where_it_is(image):
    """Of few labels that agree with it another camera had been found: up to 108 px off in broadcast pictures."""
    pixels = {label: on_marking(label) for label in FIELD.markings}
    base = calibrate_from_segments(FIELD, {label: xy for label, xy in pixels.items() if len(xy)}, SIZE)
    few = Marks.of(ends_of(LABELS[:1]), by_hand=False)
    frame = FrameEditor(image, FIELD, History(Edit(few, automatic=True)), base)
    here = pixels[LABELS[0]][[1]]
    found = frame.mark(LABELS[0], here, snap=False).calibration
    assert found.verdict == base.verdict == "good"
    X = FIELD["Circle left"].sample(1.0)
    assert np.max(np.abs(found.camera.project(X) - TRUTH.project(X))) < 1.0
    assert frame.mark(LABELS[0], here + (20.0, 0.0), snap=False).calibration.verdict != "good"  # contradicts it
    doubted = replace(frame, base=replace(base, status=Status.IMPROBABLE))
    assert doubted.mark(LABELS[0], here, snap=False).calibration.verdict != "good"
