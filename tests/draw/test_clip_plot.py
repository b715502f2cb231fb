"""The plot of a clip: curves where the values are, gaps where there is no camera, bands as wide as the errors."""

from dataclasses import replace

import numpy as np
import pytest
from tripods import matched, panned

from data_tools.synthetic.clips import labelled
from fieldcalib import Camera, Status, calibrate_batch, calibrate_sequence, soccer
from fieldcalib.assess.camera_errors import NoErrors
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import Shot, VideoCalibration
from fieldcalib.draw.clip_plot import (
    BAND,
    FIGURE,
    GAP,
    LEFT,
    LINE,
    NO_CAMERA,
    PANEL,
    REJECTED_LINE,
    RIGHT,
    STRIP,
    STRIP_COLOURS,
    TOP,
    Curve,
    half_widths,
    nice_ticks,
    plot_sequence,
    tick_label,
    value_range,
)

FIELD = soccer()
COUNT = 20
NOTHING = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")
LABELS = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top")


@pytest.fixture(scope="module")
def frames():
    """Labelled pixels of a pan at constant speed."""
    rng = np.random.default_rng(0)
    frames = []
    for pan in np.linspace(0.2, 0.4, COUNT):
        camera = Camera.from_angles(pan, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
        frame = {label: camera.project(FIELD[label].sample(5.0)) for label in LABELS}
        frames.append({label: xy + rng.normal(0.0, 0.3, xy.shape) for label, xy in frame.items()})
    return frames


@pytest.fixture(scope="module")
def calibrations(frames):
    found = list(calibrate_batch(soccer(size_known=True), frames, (960, 540)))
    assert all(calibration.accepted for calibration in found)
    return found


def near(picture, colour, tolerance=12):
    return np.all(np.abs(picture.astype(int) - colour) <= tolerance, axis=-1)


def column(frame, count=COUNT):
    """In the middle of a frame."""
    return round(LEFT + (frame + 0.5) / count * (FIGURE[0] - LEFT - RIGHT))


def curve_of(values, half=np.nan, shot=0):
    return Curve("", "m", values, values - half, values + half, np.broadcast_to(shot, len(values)))


PAN = slice(TOP + STRIP + GAP, TOP + STRIP + GAP + 110)
PANELS = slice(TOP + STRIP + GAP, FIGURE[1] - 60)


def test_a_pan_at_constant_speed_is_a_straight_line(calibrations):
    picture = plot_sequence(calibrations)
    drawn = near(picture[PAN], LINE, 60)
    columns = np.arange(column(1), column(COUNT - 2))
    rows = np.array([np.flatnonzero(drawn[:, x]).mean() for x in columns])
    pan = np.array([calibration.camera.angles[0] for calibration in calibrations[1:-1]])
    share = (rows[0] - rows[[column(i) - column(1) for i in range(1, COUNT - 2)]]) / (rows[0] - rows[-1])
    np.testing.assert_allclose(share, ((pan - pan[0]) / (pan[-1] - pan[0]))[:-1], atol=0.03)
    assert rows[-1] < rows[0]  # more is up


def test_bands_hold_95_percent(calibrations):
    """The band of the height of the centre, whose panel it fills: its share of the panel against the marks."""
    picture = plot_sequence(calibrations)
    x = column(10)
    rows = np.flatnonzero(near(picture[-170:-60, x], BAND) | near(picture[-170:-60, x], LINE, 60))
    one = calibrations[10].uncertainty
    expected = 2.0 * one.radius() * np.sqrt(one.covariance[6, 6])
    values = np.array([calibration.camera.C[2] for calibration in calibrations])
    half = np.array([c.uncertainty.radius() * np.sqrt(c.uncertainty.covariance[6, 6]) for c in calibrations])
    low, high = value_range(curve_of(values, half), np.ones(COUNT, bool))
    height = (FIGURE[1] - (TOP + STRIP + GAP) - 48 + GAP) / 7 - GAP
    assert np.ptp(rows) / height * (high - low) == pytest.approx(expected, rel=0.05)


def test_frames_without_camera_are_gaps(calibrations):
    with_gaps = [*calibrations[:5], None, NOTHING, *calibrations[7:12], None, *calibrations[13:]]
    picture = plot_sequence(with_gaps)
    for frame, calibration in enumerate(with_gaps):
        drawn = near(picture[PANELS, column(frame)], LINE, 60).any()
        assert drawn == (calibration is not None and calibration.camera is not None)
        strip = picture[TOP + STRIP // 2, column(frame)]
        assert tuple(strip) == (STRIP_COLOURS["accepted"] if drawn else NO_CAMERA)


def test_a_frame_alone_between_gaps_is_seen(calibrations):
    picture = plot_sequence([None] * 10 + calibrations[:1] + [None] * 9)
    assert near(picture[PANELS, column(10)], LINE, 60).sum() >= 7
    assert not near(picture[PANELS, column(9)], LINE, 60).any()


def test_rejected_cameras_are_red_and_do_not_scale_the_panels(calibrations):
    far = Camera.from_angles(1.0, 0.7, 0.5, 9000.0, (300.0, 500.0, -200.0), (960, 540))
    wrong = replace(calibrations[8], camera=far, status=Status.IMPLAUSIBLE, errors=NoErrors())
    picture = plot_sequence([*calibrations[:8], wrong, *calibrations[9:]])
    assert near(picture[PANELS, column(8)], REJECTED_LINE).any()
    assert not near(picture[PANELS, column(8)], LINE, 60).any()
    others = np.r_[LEFT : column(7), column(9) : FIGURE[0] - RIGHT]
    with_none = plot_sequence([*calibrations[:8], None, *calibrations[9:]])
    np.testing.assert_array_equal(picture[PANELS, others], with_none[PANELS, others])


def test_a_sequence_says_itself_what_its_frames_rest_on():
    cameras, rng = panned(4), np.random.default_rng(0)
    frames = [frame.pixels if t % 2 == 0 else {} for t, frame in enumerate(labelled(cameras, soccer(), rng, 0.5))]
    matches = matched(cameras, [(0, 1), (0, 2), (2, 3)], rng)
    found = calibrate_sequence(soccer(size_known=True), frames, (960, 540), matches=matches)
    assert [str(basis) for basis in found.basis] == ["lines and matches", "matches"] * 2
    found = replace(found, frames=replace(found.frames, basis=np.arange(1, 5)))
    words = [str(basis) for basis in found.basis]
    assert words == ["lines", "matches", "lines and matches", "interpolated"]
    strip = plot_sequence(found)[TOP + STRIP // 2]
    width = FIGURE[0] - RIGHT - LEFT
    for frame, word in enumerate(words):
        assert tuple(strip[int(LEFT + width * (frame + 0.5) / 4)]) == STRIP_COLOURS[word]


def test_labels_that_leave_the_camera_open():
    """Infinite errors fill the panels, and nothing else happens."""
    camera = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    frame = {label: camera.project(FIELD[label].sample(5.0)) for label in LABELS[:2]}
    found = list(calibrate_batch(FIELD, [frame] * 3, (960, 540), prior=None))
    open_to_labels = [replace(one, status=Status.ACCEPTED) for one in found]
    assert np.isinf(open_to_labels[0].covariance).any()
    assert near(plot_sequence(open_to_labels)[PANELS], BAND).any()


@pytest.mark.parametrize("frames", [[None], [NOTHING] * 3])
def test_no_camera_at_all(frames):
    picture = plot_sequence(frames, frames_per_second=25.0)
    assert picture.shape == (FIGURE[1], FIGURE[0], 3)
    assert near(picture, PANEL).any()
    assert not near(picture[PANELS], LINE).any()


def test_wrong_input(calibrations):
    with pytest.raises(ValueError, match="at least one frame, got none"):
        plot_sequence([])
    with pytest.raises(ValueError, match="frames_per_second must be positive, got 0"):
        plot_sequence(calibrations, frames_per_second=0)


def test_a_range_holds_all_but_what_lies_far_out():
    rng = np.random.default_rng(0)
    values = rng.normal(10.0, 1.0, 200)
    everything = np.ones(200, bool)
    low, high = value_range(curve_of(values), everything)
    assert low < values.min() < values.max() < high < 20.0
    values[50] = 1000.0
    assert value_range(curve_of(values), everything)[1] < 20.0
    constant = np.full(200, 3.0)
    assert value_range(curve_of(constant), everything) == pytest.approx((2.42, 3.58))


def test_the_bands_of_every_shot_are_in_their_panel():
    """A few frames of another tripod, elsewhere and less certain, are neither far out nor wider than the panel."""
    shot = np.repeat([0, 1, 2], (100, 6, 60))
    values, half = np.array([1.0, 30.0, 1.1])[shot], np.array([0.1, 0.1, 4.0])[shot]
    curve, everything = curve_of(values, half, shot), np.ones(len(shot), bool)
    low, high = value_range(curve, everything)
    assert low < curve.low.min() < curve.high.max() < high < 33.0
    assert half_widths(curve, everything) == ["+/- 0.1", "to 4 m"]
    assert half_widths(curve, shot < 2) == ["+/- 0.1 m"]


def test_curves_end_where_a_shot_does(frames):
    """Between two shots nothing moves: no line leads from one to the other."""
    tripod = calibrate_sequence(soccer(size_known=True), frames, (960, 540))
    number = np.r_[:5, 15:20]
    shots = Shot(0, 5, 0), Shot(5, 10, 0)
    video = VideoCalibration((tripod,), shots, np.zeros(10, dtype=np.intp), number)
    drawn, joined = (near(plot_sequence(one)[PAN], LINE, 60) for one in (video, list(video)))
    between = slice(column(4, 10) + 3, column(5, 10) - 2)
    assert joined[:, between].any(axis=0).all()
    assert not drawn[:, between].any()
    for shot in (slice(column(0, 10), column(4, 10)), slice(column(5, 10), column(9, 10))):
        assert drawn[:, shot].any(axis=0).all()


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-3e-7, 2e-7), (12.3, 12.9), (-5e6, 1e3)])
def test_ticks(low, high):
    ticks = nice_ticks(low, high, 5)
    assert 2 <= len(ticks) <= 6
    assert low <= ticks[0] < ticks[-1] <= high
    labels = [tick_label(tick, ticks) for tick in ticks]
    assert len(set(labels)) == len(labels)
    np.testing.assert_allclose([float(label) for label in labels], ticks, atol=1e-9 * (high - low))
