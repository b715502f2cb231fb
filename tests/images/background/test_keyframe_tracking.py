"""Pieces and keyframes of clips whose cuts and motion are known."""

import weakref
from itertools import pairwise

import cv2
import numpy as np
import pytest
from panoramas import SIZE, dissolved, homography, motions, shot

from fieldcalib.images.background.keyframe_tracking import CONFIRMED, EVERY, KeyframeTracker, tied_frames

WHITE = np.full(SIZE[::-1], 250, np.uint8)


@pytest.fixture(scope="module")
def one():
    return shot(50)


@pytest.fixture(scope="module")
def other():
    """Of the same motion, so that a mixture of both moves like a scene."""
    return shot(45, seed=1)


def tied(frames, **options):
    """Of each frame, and the contract that holds for any frames."""
    found = [tie for _, tie in tied_frames(frames, **options)]
    assert [tie.index for tie in found] == list(range(len(frames)))
    steps = np.diff([tie.piece for tie in found])
    assert found[0].piece == 0
    assert np.all((steps == 0) | (steps == 1))
    for tie in found:
        keys = [key for key, _ in tie.ties]
        assert all(found[key].is_key and found[key].piece == tie.piece and key < tie.index for key in keys)
        assert tie.is_key or keys in ([], [tie.key])
    return found


def starts(found):
    return [b.index for a, b in pairwise(found) if a.piece != b.piece]


def keys(found):
    return [tie.index for tie in found if tie.is_key]


def untied(found):
    return [tie.index for tie in found if not tie.ties and not tie.is_key]


def test_frames_are_tied_to_keyframes_and_these_to_earlier_ones(one):
    found = tied(one)
    assert keys(found) == [0, 12, 24, 36, 48]
    assert [[key for key, _ in found[index].ties] for index in keys(found)] == [
        [],
        [0],
        [12, 0],
        [24, 12],
        [36, 24, 0],
    ]
    assert untied(found) == []
    assert median_distance(found, motions(len(one))) < 0.3  # from the keyframe: no drift


def test_keyframes_come_earlier_where_the_view_changes():
    found = tied(shot(14, pan=2.0))  # 31 px per frame: 60 % are in view after 8
    zoomed = tied(shot(10, pan=0.0, zoom=1.04))  # 60 % after 6.5, by a coarse grid
    assert keys(found)[1] in (8, 9)
    assert keys(zoomed)[1] in (7, 8)
    assert starts(found) == starts(zoomed) == []


@pytest.mark.parametrize("at", [5, pytest.param(12, marks=pytest.mark.slow)])
def test_a_cut_begins_a_piece(one, other, at):
    found = tied([*one[:at], *other[:20]])
    assert starts(found) == [at]
    assert found[at].is_key
    assert untied(found) == []


@pytest.mark.parametrize(
    ("count", "every"), [(8, EVERY), *(pytest.param(25, every, marks=pytest.mark.slow) for every in (EVERY, 4))]
)
def test_no_tie_goes_through_a_dissolve(one, other, count, every):
    """Nor in small steps: four frames of 25 change a sixth of the picture."""
    found = tied(dissolved(one[: 10 + count], other[: 20 + count], count), every=every)
    before = {tie.piece for tie in found[:10]}
    after = {tie.piece for tie in found[10 + count :] if tie.ties}
    assert before == {0}
    assert after
    assert 0 not in after


def test_last_frames_after_a_cut_are_a_piece_but_a_single_one_is_not(one, other):
    three = tied([*one[:10], *other[:3]])
    assert starts(three) == [10]
    assert len(three[-1].ties) == 1
    assert untied(tied([*one[:10], other[0]])) == [10]


@pytest.mark.parametrize("count", [1, CONFIRMED + 4])
def test_a_piece_goes_on_after_a_flash(one, count):
    found = tied([*one[:20], *count * [WHITE], *one[20 + count : 40]])
    assert starts(found) == []
    assert untied(found) == list(range(20, 20 + count))
    assert found[20].key == 12


def test_a_piece_goes_on_after_a_short_graphic(one, other):
    """Seven frames that match one another are not enough for a piece."""
    found = tied([*one[:20], *other[: CONFIRMED - 1], *one[20 + CONFIRMED - 1 : 40]])
    assert starts(found) == []
    assert untied(found) == list(range(20, 20 + CONFIRMED - 1))


def test_a_pan_too_fast_to_follow_is_found_again():
    """Back at an earlier keyframe, after frames that were blurred."""
    fast = shot(26, pan=0.8)  # 13 px per frame
    blurred = [cv2.blur(picture, (201, 1)) for picture in fast[14:18]]
    found = tied([*fast[12:], *blurred, *fast[:6]])
    assert starts(found) == []
    assert untied(found) == [14, 15, 16, 17]


def test_a_graphic_before_a_plain_scene_does_not_hide_that_the_scene_is_the_same():
    """Most of the contrast of the picture is the graphic's, which does not move with the scene."""
    frames = shot(16, pan=0.5)
    board = np.random.default_rng(2).integers(0, 255, (6, 26), dtype=np.uint8)
    for frame in frames:
        frame[140:] = 109 + 0.15 * frame[140:]
        frame[200:320, 60:580] = cv2.resize(board, (520, 120), interpolation=cv2.INTER_NEAREST)
    found = tied(frames)
    assert starts(found) == untied(found) == []
    assert keys(found) == [0, 12]


def test_a_frozen_stream_repeats_its_ties(one):
    found = tied([*one[:16], *30 * [one[15]], *one[16:30]])
    assert [tie.index for tie in found if tie.duplicate] == list(range(16, 46))
    assert all(tie.ties == found[15].ties for tie in found[16:46])
    assert keys(found) == [0, 12, 46, 58]
    assert untied(found) == []


def test_every_second_frame_twice(one):
    found = tied([one[i // 2 * 2] for i in range(40)])
    assert [tie.index for tie in found if tie.duplicate] == list(range(1, 40, 2))
    assert starts(found) == untied(found) == []
    assert keys(found) == [0, 12, 24, 36]


def test_interlaced_frames_are_tied():
    """Every frame has the odd rows of one moment and the even rows of the next: combs of 3 px in this pan."""
    fields = shot(80, pan=0.2)
    woven = [first.copy() for first in fields[::2]]
    for frame, second in zip(woven, fields[1::2], strict=True):
        frame[1::2] = second[1::2]
    found = tied(woven)
    assert starts(found) == []
    assert untied(found) == []
    H = [homography(0.2 * (2.0 * i + 0.5), 1.002 ** (2.0 * i + 0.5)) for i in range(len(woven))]
    assert median_distance(found, H) < 0.6


@pytest.mark.slow
def test_frames_of_a_rolling_shutter_are_tied():
    """The last row is read most of a frame after the first one: a pan shears the picture."""
    steps = 12  # rows that are read at once are a twelfth of the picture
    moments = shot(25 * steps, pan=0.5 / steps, zoom=1.0)
    frames = [
        np.concatenate([np.array_split(moments[i + k], steps)[k] for k in range(steps)])
        for i in range(0, len(moments) - steps, steps)
    ]
    found = tied(frames)
    assert starts(found) == []
    assert untied(found) == []
    H = [homography(0.5 * i, 1.0) for i in range(len(frames))]
    assert median_distance(found, H) < 0.6


def median_distance(found, H):
    """Of the matches from where the motion of the camera has them, the largest of all pairs."""
    return max(
        np.median(
            np.linalg.norm(
                cv2.perspectiveTransform(matches.first[None], H[tie.index] @ np.linalg.inv(H[key]))[0] - matches.second,
                axis=1,
            )
        )
        for tie in found
        for key, matches in tie.ties
    )


def test_nothing_to_follow():
    found = tied([*9 * [WHITE], *9 * [WHITE // 2]])
    assert keys(found) == [0]
    assert starts(found) == []
    assert list(tied_frames([])) == []


def test_no_more_than_a_few_pictures_are_held(one, other):
    alive = []
    most = 0

    def video():
        for picture in [*one[:30], *other[:20]]:
            colour = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
            alive.append(weakref.ref(colour))
            yield colour

    for image, tie in tied_frames(video()):
        most = max(most, len(alive) - 1 - tie.index)
        assert image.shape == (*SIZE[::-1], 3)
        assert sum(reference() is not None for reference in alive) <= CONFIRMED + 2
    assert most == CONFIRMED - 1


def test_frames_of_several_sizes(one):
    with pytest.raises(ValueError, match="frame 3 has 320 x 180 pixels, those before it 640 x 360"):
        list(tied_frames([*one[:3], one[3][::2, ::2]]))


def test_pairs_of_keyframes_that_are_left(one):
    """They are those that are matched otherwise."""
    at_once, later = (
        [tied for image in one for tied in tracker.update(image)]
        for tracker in (KeyframeTracker(5), KeyframeTracker(5, leave_pairs=True))
    )
    keys = [tied for tied in at_once if tied.is_key]
    assert [tied.index for tied in later if tied.is_key] == [tied.index for tied in keys]
    for one, other in zip(keys, (tied for tied in later if tied.is_key), strict=True):
        assert len(other.ties) == min(len(one.ties), 1)
        assert [pair.indices for pair in other.unmatched] == [(key, one.index) for key, _ in one.ties[1:]]
        for (_, matches), pair in zip(one.ties[1:], other.unmatched, strict=True):
            assert abs(len(pair.matches()) - len(matches)) <= 0.1 * len(matches)


def test_a_piece_that_is_left_is_matched_no_more_up_to_a_cut(one, other):
    tracker, frames = KeyframeTracker(), [*one[:30], *other[:15]]
    left = []
    for t, frame in enumerate(frames):
        left += tracker.update(frame)
        if t == 13:
            tracker.leave(7)  # another piece
            assert not left[-1].is_passed
        if t == 20:
            tracker.leave(0)
    assert [tie.index for tie in left] == list(range(45))
    assert [tie.index for tie in left if tie.is_passed] == list(range(21, 30))
    assert all(not tie.ties and not tie.is_key for tie in left[21:30])
    assert starts(left) == [30]
    assert keys(left) == [0, 12, 30, 42]


def test_a_new_piece_may_begin_after_one_that_was_left(one):
    tracker = KeyframeTracker()
    found = [tie for frame in one[:10] for tie in tracker.update(frame)]
    tracker.begin_anew()  # nothing was left
    found += [tie for frame in one[10:14] for tie in tracker.update(frame)]
    tracker.leave(0)
    found += [tie for frame in one[14:20] for tie in tracker.update(frame)]
    tracker.begin_anew()
    found += [tie for frame in one[20:34] for tie in tracker.update(frame)]
    assert [tie.index for tie in found if tie.is_passed] == list(range(14, 20))
    assert starts(found) == [20]
    assert keys(found) == [0, 12, 20, 32]


def test_every_is_a_number_of_frames():
    with pytest.raises(ValueError, match="every must be 1 or more frames, got 0"):
        KeyframeTracker(0)


def clip(shared_data, name, first, last):
    path = shared_data / "clips" / f"{name}.mp4"
    if not path.is_file():
        pytest.skip(f"needs {path}")
    capture = cv2.VideoCapture(str(path))
    for _ in range(first):
        capture.grab()
    return [cv2.resize(capture.read()[1], (960, 540), interpolation=cv2.INTER_AREA) for _ in range(first, last)]


@pytest.mark.slow
def test_a_broadcast_with_a_dissolve(shared_data):
    """From the left half to the middle line, frames 125 to 132 are mixed."""
    found = tied(clip(shared_data, "pan-to-goal", 115, 145))
    assert len(starts(found)) == 1
    assert starts(found)[0] in range(15, 20)
    assert untied(found) == list(range(untied(found)[0], starts(found)[0]))
    assert untied(found)[0] in range(10, 15)


@pytest.mark.slow
def test_two_broadcasts_with_the_same_view(shared_data):
    """Both show the middle line, the circle and the stands above."""
    one, other = clip(shared_data, "chelsea-milan", 33, 54), clip(shared_data, "pan-to-goal", 150, 175)
    found = tied(dissolved(one, other, 8))
    assert {tie.piece for tie in found[:13]} == {0}
    assert {tie.piece for tie in found[24:]} == {1}
