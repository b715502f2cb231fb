"""Contact sheets, and the frames that are chosen for them."""

from dataclasses import replace

import numpy as np
import pytest

from fieldcalib import Camera, Status, calibrate_batch, soccer
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.assess.probability import largest_error
from fieldcalib.assess.result import Calibration
from fieldcalib.draw.sheet import BACKGROUND, contact_sheet, worst_frames

NOTHING = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")


def plain(value, size=(96, 54)):
    return np.full((size[1], size[0], 3), value, np.uint8)


def test_every_picture_is_there_in_its_place():
    values = [40, 80, 120, 160, 200]
    sheet = contact_sheet([plain(value) for value in values], [""] * 5, columns=2, width=48)
    assert sheet.shape == (14 + 3 * (27 + 30 + 14), 14 + 2 * (48 + 14), 3)
    for index, value in enumerate(values):
        y, x = 14 + index // 2 * 71, 14 + index % 2 * 62
        assert np.all(sheet[y : y + 27, x : x + 48] == value)
    assert np.all(sheet[14 + 2 * 71 :, 14 + 62 :] == BACKGROUND)  # no sixth one


def test_captions_stay_below_their_pictures():
    """A long one in several lines, as the words one by one; every row of tiles has room for it."""
    words = ["frame", "7:", "a", "caption", "that", "is", "far", "too", "long", "for", "a", "tile"]
    sheet = contact_sheet([plain(90)] * 3, [" ".join(words), "", "x"], columns=2, width=150)
    lines = (sheet.shape[0] - 14) / 2 - 84 - 30 - 14
    assert lines in (18, 36, 54)
    below = sheet[14 + 84 : 14 + 84 + 30 + int(lines)]
    assert np.all(below[:, 164:] == BACKGROUND)
    written = (below[:, 14:164] != BACKGROUND).any(axis=-1)
    apart = contact_sheet([plain(90)] * len(words), words, columns=len(words), width=150)[14 + 84 :]
    assert written.sum() == pytest.approx((apart != BACKGROUND).any(axis=-1).sum(), rel=0.05)
    assert not written[-4:].any()


def test_a_word_that_is_longer_than_its_tile_is_cut_off():
    sheet = contact_sheet([plain(90)] * 2, ["a" * 60, ""], width=100)
    assert sheet.shape[0] == 14 + 56 + 30 + 14
    below = sheet[14 + 56 :]
    assert np.any(below[:, 14:114] != BACKGROUND)
    assert np.all(below[:, 114:] == BACKGROUND)


def test_pictures_of_another_shape_keep_it():
    sheet = contact_sheet([plain(90), plain(200, (50, 100))], ["", ""], width=96)
    tile = sheet[14 : 14 + 54, 14 + 96 + 14 : 14 + 96 + 14 + 96]
    rows, columns = np.nonzero(np.all(tile == 200, axis=-1))
    assert (np.ptp(rows) + 1, np.ptp(columns) + 1) == (54, 27)
    assert abs(columns.mean() - 47.5) <= 0.5


def test_a_title_takes_its_room_above():
    plain_sheet, titled = (contact_sheet([plain(90)], [""], title=title) for title in ("", "worst frames"))
    assert titled.shape[0] == plain_sheet.shape[0] + 36
    np.testing.assert_array_equal(titled[-plain_sheet.shape[0] + 14 :], plain_sheet[14:])


def test_wrong_sheets():
    with pytest.raises(ValueError, match="a caption each, got 2 and 1 captions"):
        contact_sheet([plain(1), plain(2)], [""])
    with pytest.raises(ValueError, match="a caption each, got 0 and 0 captions"):
        contact_sheet([], [])
    with pytest.raises(ValueError, match="columns must be a whole number from 1, got 0"):
        contact_sheet([plain(1)], [""], columns=0)
    with pytest.raises(ValueError, match="must be uint8"):
        contact_sheet([plain(1).astype(float)], [""])


# worst_frames


@pytest.fixture(scope="module")
def good_and_noisy():
    """Two accepted calibrations: the second one is from noisier pixels."""
    field = soccer(size_known=True)
    camera = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
    rng = np.random.default_rng(0)
    exact = {label: camera.project(field[label].sample(5.0)) for label in labels}
    frames = [{label: xy + rng.normal(0.0, noise, xy.shape) for label, xy in exact.items()} for noise in (0.1, 3.0)]
    good, noisy = calibrate_batch(field, frames, (960, 540))
    assert good.accepted
    assert noisy.accepted
    assert largest_error(noisy.uncertainty, field) > 1.5 * largest_error(good.uncertainty, field)
    return good, noisy


def test_worst_come_first(good_and_noisy):
    good, noisy = good_and_noisy
    rejected = replace(good, status=Status.IMPROBABLE)
    assert worst_frames([good, noisy, rejected, None], 4) == [3, 2, 1, 0]
    assert worst_frames([good, NOTHING, noisy, rejected], 4) == [1, 3, 2, 0]
    assert worst_frames([good, noisy], 12) == [1, 0]


def test_one_bad_moment_does_not_fill_the_sheet(good_and_noisy):
    good, noisy = good_and_noisy
    clip = [good] * 200
    clip[20:60] = [None] * 40
    clip[150] = noisy
    chosen = worst_frames(clip, 8)
    assert len(set(chosen)) == 8
    in_gap = [index for index in chosen if clip[index] is None]
    assert chosen[: len(in_gap)] == in_gap
    assert 2 <= len(in_gap) <= 4
    assert chosen[len(in_gap)] == 150
    assert min(np.diff(sorted(chosen))) >= 200 // 16


def test_equally_bad_frames_are_chosen_all_over_the_clip():
    chosen = worst_frames([None] * 100, 8)
    assert max(np.diff([0, *sorted(chosen), 100])) <= 25


def test_all_frames_if_there_are_no_more():
    assert sorted(worst_frames([None] * 7, 12)) == list(range(7))
    assert worst_frames([], 12) == worst_frames([None], 0) == []
    with pytest.raises(ValueError, match="count must be a whole number from 0, got -1"):
        worst_frames([None], -1)


def test_frames_with_markings_beside_their_paint_come_before_others():
    camera = Camera.from_angles(0.2, 1.35, 0.01, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top")
    pixels = {label: camera.project(soccer()[label].sample(9.0)) for label in labels}
    (good,) = calibrate_batch(soccer(), [pixels], (960, 540))
    on = MarkingInView("Side line top", 700.0, 30, 1.0, 0.0)
    off = [good.seen_in_image([on, MarkingInView("Middle line", 90.0, 9, 0.1, px)]) for px in (5.0, 17.0)]
    assert worst_frames([good, off[0], NOTHING, good, off[1]], 3) == [2, 4, 1]
