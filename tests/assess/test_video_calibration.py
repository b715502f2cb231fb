"""What the calibration of a sequence and of a video returns."""

import json
import pickle
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tripods import SIZE, matched, panned

from data_tools.synthetic.clips import labelled
from fieldcalib import calibrate_sequence, soccer
from fieldcalib.assess.findings import Status
from fieldcalib.assess.frame_table import BASES, STATUSES, STEP, Basis
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.assess.video import NO_TRIPOD, Shot, VideoCalibration
from fieldcalib.problem.layout import LOG_F, PAN

FIELD = soccer()
COUNT = 9


@pytest.fixture(scope="module")
def sequence():
    """Labels in every third frame, matches in the others, and at the end a frame without a camera."""
    rng = np.random.default_rng(0)
    cameras = panned(COUNT, -0.4, 0.4)
    frames = labelled(cameras, FIELD, rng, 0.5)
    pairs = [(0, 1), (0, 3), (3, 2), (3, 4), (3, 6), (6, 5), (6, 7)]
    pixels = [frame.pixels if t in (0, 3, 6) else {} for t, frame in enumerate(frames)]
    found = calibrate_sequence(FIELD, pixels, SIZE, matches=matched(cameras, pairs, rng))
    assert found.accepted.tolist() == [True] * 8 + [False]
    return found


@pytest.fixture(scope="module")
def video(sequence):
    """Two shots of the tripod, frames of another shot between them, and one frame of a second tripod."""
    rng = np.random.default_rng(1)
    other = calibrate_sequence(FIELD, [labelled(panned(1), FIELD, rng, 0.5)[0].pixels], SIZE)
    tripod = np.array([0] * 4 + [NO_TRIPOD] * 2 + [0] * 5 + [1])
    number = np.array([*range(4), 0, 0, *range(4, 9), 0])
    shots = (Shot(0, 4, 0), Shot(4, 6, NO_TRIPOD), Shot(6, 11, 0), Shot(11, 12, 1))
    return VideoCalibration((sequence, other), shots, tripod, number)


def expected_of(video):
    return [
        None if tripod == NO_TRIPOD else video.tripods[tripod][int(number)]
        for tripod, number in zip(video.tripod, video.number, strict=True)
    ]


@pytest.fixture(params=["sequence", "video"])
def frames(request):
    return request.getfixturevalue(request.param)


def test_frames_of_a_video_are_those_of_its_tripods(video):
    for found, expected in zip(video, expected_of(video), strict=True):
        if expected is None:
            assert (found.camera, str(found.status)) == (None, "too few segments")
            assert found.message == "nothing in this shot determines the camera"
        else:
            assert found == expected
    none = Basis.NOTHING
    assert video.basis == [*video.tripods[0].basis[:4], none, none, *video.tripods[0].basis[4:], Basis.LINES]


def test_indices_and_slices_are_those_of_a_list(frames):
    listed = list(frames)
    assert len(listed) == len(frames)
    for index in (0, len(frames) - 1, -1, -len(frames), np.int64(2)):
        assert frames[index] == listed[index]
    for part in (slice(None), slice(2, 5), slice(None, None, -2), slice(-3, None), slice(50, 60), slice(5, 2)):
        assert list(frames[part]) == listed[part]
    for index in (len(frames), -len(frames) - 1):
        with pytest.raises(IndexError, match=f"frame {index} is out of range: there are {len(frames)} frames"):
            frames[index]
    assert list(reversed(frames)) == listed[::-1]
    assert [frame.camera is None for frame in frames] == [camera is None for camera in frames.cameras]


@pytest.mark.parametrize("part", [slice(3, 9), slice(None, None, -2), slice(4, 6), slice(5, 2)])
def test_a_slice_keeps_what_frames_rest_on(frames, part):
    some = frames[part]
    assert type(some) is type(frames)
    assert some.basis == frames.basis[part]
    assert [camera is None for camera in some.cameras] == [camera is None for camera in frames.cameras[part]]
    np.testing.assert_array_equal(some.to_pandas()["ground_error_m"], frames.to_pandas()["ground_error_m"][part])
    assert type(frames).from_dict(json.loads(json.dumps(some.to_dict()))) == some


def test_a_slice_of_a_sequence_keeps_what_is_shared(sequence):
    some = sequence[2:5]
    assert some.shared == sequence.shared
    np.testing.assert_array_equal(some.covariance, sequence.covariance)
    assert (some.field, some.together) == (sequence.field, sequence.together)
    assert sequence[5:][3].message == sequence[8].message  # of the frame without a camera


def test_a_slice_of_a_video_has_its_shots_and_tripods(video):
    assert video[:] == video
    some = video[9:]
    assert some.shots == (Shot(0, 2, 0), Shot(2, 3, 1))
    assert [len(tripod) for tripod in some.tripods] == [2, 1]
    assert some.tripods[0].shared == video.tripods[0].shared
    back = video[::-1]
    assert back.shots == (Shot(0, 1, 1), Shot(1, 6, 0), Shot(6, 8, NO_TRIPOD), Shot(8, 12, 0))
    assert back[::-1][3] == video[3]
    assert list(back.tripods[0]) == list(video.tripods[0])[::-1]
    alone = video[10:12]  # the tripod with most frames is no longer the one with more frames than the other
    assert [len(tripod) for tripod in alone.tripods] == [1, 1]
    assert (video[4:6].shots, video[4:6].tripods) == ((Shot(0, 2, NO_TRIPOD),), ())
    assert video[2:2].shots == ()


def test_two_are_equal_if_all_is(frames, sequence, video):
    assert frames == pickle.loads(pickle.dumps(frames))
    assert frames != frames[:-1]
    assert sequence != video
    assert sequence != replace(sequence, values=sequence.values + 1e-9)
    assert video != replace(video, shots=(*video.shots[:-1], Shot(11, 12, 0)))


def test_frames_can_be_read_again_and_again(frames):
    assert list(frames) == list(frames)
    assert frames.index(frames[3]) == 3
    assert frames[0] in frames


def test_a_table(frames):
    table = frames.to_pandas()
    assert list(table.index) == list(range(len(frames)))
    assert table["focal_length_px"].dtype == float
    for t, frame in enumerate(frames):
        row = table.iloc[t]
        if frame.camera is None:
            assert np.isnan([row["focal_length_px"], row["x_m"], row["rms_px"], row["pan_degrees"]]).all()
            continue
        assert (row["status"], row["basis"]) == (str(frame.status), str(frames.basis[t]))
        np.testing.assert_allclose(row["focal_length_px"], frame.camera.focal_length)
        np.testing.assert_allclose([row[f"{name}_m"] for name in "xyz"], frame.camera.C)
        angles = [row[f"{name}_degrees"] for name in ("pan", "tilt", "roll")]
        np.testing.assert_allclose(angles, np.degrees(frame.camera.angles), atol=1e-9)
        np.testing.assert_array_equal(row["rms_px"], frame.rms)


def test_a_table_of_a_video_says_shots_and_tripods(video):
    table = video.to_pandas()
    assert table["shot"].tolist() == [0] * 4 + [1] * 2 + [2] * 5 + [3]
    assert table["tripod"].tolist() == video.tripod.tolist()
    nothing = VideoCalibration((), (Shot(0, 2, -1),), np.full(2, -1), np.zeros(2, dtype=int)).to_pandas()
    assert nothing["tripod"].tolist() == [-1, -1]


def test_a_table_of_frames_without_a_tripod_has_a_status(video):
    """As `video[4]` has: a reader who counts them must not find NaN."""
    table = video.to_pandas()
    assert table["status"].tolist() == [str(frame.status) for frame in video]
    assert table["basis"].tolist() == [str(basis) for basis in video.basis]
    nothing = VideoCalibration((), (Shot(0, 2, -1),), np.full(2, -1), np.zeros(2, dtype=int)).to_pandas()
    assert nothing["status"].tolist() == ["too few segments"] * 2
    assert list(nothing) == list(table)
    assert nothing["focal_length_px"].isna().all()


def test_json(video):
    record = json.dumps(video.to_dict(), allow_nan=False)
    back = VideoCalibration.from_dict(json.loads(record))
    assert list(back) == list(video)
    assert (back.shots, back.basis) == (video.shots, video.basis)
    assert all(isinstance(shot, Shot) for shot in back.shots)
    assert json.dumps(back.to_dict()) == record
    for t in (0, 7, 11):
        np.testing.assert_array_equal(back[t].covariance, video[t].covariance)
    assert back.tripods[0].shared == video.tripods[0].shared
    np.testing.assert_array_equal(back.tripods[0].frames.theta, video.tripods[0].frames.theta)
    assert back == video


def test_what_is_no_record_of_a_video(video):
    for record, message in (
        ({}, "expected a calibration of a video of version 2, got None"),
        ({**video[0].to_dict(), "version": 2}, "is no calibration of a video: the key 'tripods' is missing"),
        ({**video.to_dict(), "version": 0}, "expected a calibration of a video of version 2, got 0"),
        ([1], "is no calibration of a video: expected a JSON object, got a list"),
    ):
        with pytest.raises(ValueError, match=message):
            VideoCalibration.from_dict(record)
    with pytest.raises(ValueError, match="is no calibration of a sequence: the key 'names' is missing"):
        SequenceCalibration.from_dict({k: v for k, v in video.tripods[0].to_dict().items() if k != "names"})


def test_pickle(frames):
    back = pickle.loads(pickle.dumps(frames))
    assert list(back) == list(frames)
    np.testing.assert_array_equal(back[0].covariance, frames[0].covariance)


def test_a_frame_is_kept_in_two_kilobytes():
    """With all that frames can share, and matches: what is kept beyond the columns is for all frames together."""
    cameras = panned(60, -0.4, 0.4)
    rng = np.random.default_rng(0)
    frames = [frame.pixels for frame in labelled(cameras, FIELD, rng, 0.5)]
    pairs = [(12 * (t // 12), t) for t in range(60) if t % 12]
    matches = matched(cameras, [*pairs, *((k, k + 12) for k in range(0, 48, 12))], rng)
    found = calibrate_sequence(FIELD, frames, SIZE, matches=matches)
    assert found.accepted.all()
    columns = [getattr(found.frames, one.name) for one in fields(found.frames)]
    arrays = [column for column in columns if isinstance(column, np.ndarray)]
    assert all(len(array) == 60 for array in arrays)
    assert sum(array.nbytes for array in arrays) <= 2000 * 60
    assert len(pickle.dumps(found)) - len(pickle.dumps(found[:10])) <= 2000 * 50


# frames between others


def moving(sequence, motion, known):
    """The sequence with so many frames, of a motion of pan and log f; only some have a camera."""
    T = len(motion)
    frames = sequence.frames
    theta = np.tile(frames.theta[3], (T, 1))
    theta[:, PAN] = 0.02 * motion
    theta[:, LOG_F] += 0.01 * motion
    theta[~known] = np.nan
    lost = STATUSES.index(Status.TOO_FEW_SEGMENTS)
    columns = replace(
        frames,
        theta=theta,
        own=np.tile(frames.own[3], (T, 1, 1)),
        following=np.tile(frames.following[3], (T, 1, 1)),
        status=np.where(known, STATUSES.index(Status.ACCEPTED), lost),
        basis=np.where(known, BASES.index(Basis.BOTH), 0),
        rms=np.where(known, 1.0, np.nan),
        ground_error=np.where(known, 0.1, np.nan),
        label_errors=np.zeros((T, len(frames.labels)), np.float32),
        label_counts=np.zeros((T, len(frames.labels)), np.uint16),
        notes=dict.fromkeys(np.flatnonzero(~known).tolist(), "no labelled pixels"),
        misfit=np.where(known, 0.2, np.nan),
    )
    return replace(sequence, frames=columns)


def gap(T, *missing):
    return ~np.isin(np.arange(T), np.concatenate([np.arange(a, b) for a, b in missing]))


def pans(found):
    return found.frames.theta[:, PAN] / 0.02


def test_even_motion_is_met(sequence):
    known = gap(12, (4, 7))
    motion = np.arange(12.0)
    found = moving(sequence, motion, known).interpolated(np.zeros(12, dtype=int), 25)
    np.testing.assert_allclose(pans(found), motion, atol=1e-9)
    assert [t for t, basis in enumerate(found.basis) if basis == Basis.INTERPOLATED] == [4, 5, 6]
    assert found.accepted.all()
    assert found[5].message.startswith("interpolated, the field in view to 0.")


@given(st.integers(1, 20), st.floats(-0.05, 0.05))
def test_motion_that_speeds_up_is_nearly_met(sequence, missing, acceleration):
    """Slopes are those half a frame beyond both ends: of G frames, 1 / G of a straight line's error is left."""
    T = missing + 8
    known, motion = gap(T, (4, 4 + missing)), acceleration * np.square(np.arange(T) - 3.0)
    found = moving(sequence, motion, known).interpolated(np.zeros(T, dtype=int), 25)
    G = missing + 1.0
    error = np.abs(pans(found) - motion)
    straight = np.abs(acceleration) * G * G / 4.0
    assert np.max(error) <= straight / G * 1.0001 + 1e-12
    np.testing.assert_array_equal(found.frames.theta[known], moving(sequence, motion, known).frames.theta[known])


def test_only_what_is_the_frames_own_moves(sequence):
    known = gap(12, (4, 7))
    found = moving(sequence, np.square(np.arange(12.0)) * 0.1, known).interpolated(np.zeros(12, dtype=int), 25)
    rest = ~sequence.layout.free
    np.testing.assert_allclose(found.frames.theta[4:7][:, rest], np.tile(sequence.frames.theta[3, rest], (3, 1)))


def test_the_spread_grows_towards_the_middle_and_with_the_gap(sequence):
    sigma = {}
    for missing in (1, 5, 11):
        T = missing + 6
        known = gap(T, (3, 3 + missing))
        found = moving(sequence, np.arange(float(T)), known).interpolated(np.zeros(T, dtype=int), 25)
        own = np.sqrt(found.frames.own[:, PAN, PAN])
        middle = 3 + missing // 2
        assert np.all(np.diff(own[2 : middle + 1]) > 0.0)
        assert np.all(np.diff(own[middle : T - 2]) < 0.0)
        assert np.all(np.linalg.eigvalsh(found.frames.own)[:, 0] > 0.0)
        assert np.all(found.frames.ground_error[3 : 3 + missing] > found.frames.ground_error[~known].min() - 1e-12)
        sigma[missing] = np.sqrt(own[middle] ** 2 - own[0] ** 2)
        np.testing.assert_allclose(sigma[missing], 0.25 * STEP * (missing + 1.0), rtol=0.01)
    assert sigma[1] < sigma[5] < sigma[11]


def test_uneven_motion_is_less_certain(sequence):
    known = gap(14, (5, 9))
    even, uneven = (
        moving(sequence, motion, known).interpolated(np.zeros(14, dtype=int), 25)
        for motion in (np.arange(14.0), np.abs(np.arange(14.0) - 6.5))
    )
    assert np.all(uneven.frames.own[5:9, PAN, PAN] > even.frames.own[5:9, PAN, PAN])
    assert np.all(uneven.frames.ground_error[5:9] > even.frames.ground_error[5:9])


def test_what_is_not_known_to_a_metre_is_not_accepted(sequence):
    T = 60
    known = gap(T, (10, 50))
    found = moving(sequence, np.arange(float(T)) * 0.1, known).interpolated(np.zeros(T, dtype=int), 40)
    inside = np.flatnonzero(~known)
    large = found.frames.ground_error[inside] > 1.0
    np.testing.assert_array_equal(found.accepted[inside], ~large)
    assert large.any()
    assert not large.all()


@pytest.mark.parametrize(("longest", "filled"), [(4, False), (5, True)])
def test_gaps_that_are_too_long_stay(sequence, longest, filled):
    known = gap(14, (2, 3), (5, 10))
    found = moving(sequence, np.arange(14.0), known).interpolated(np.zeros(14, dtype=int), longest)
    assert np.isfinite(found.frames.theta[2]).all()
    assert np.isfinite(found.frames.theta[5:10]).all() == filled
    assert np.isnan(found.frames.theta[5:10]).all() == (not filled)
    assert all((found[t].camera is not None) == filled for t in range(5, 10))
    assert filled or found[6].message == "no labelled pixels"


def test_nothing_is_interpolated_across_runs(sequence):
    known, run = gap(12, (4, 8)), np.repeat([0, 1], 6)
    found = moving(sequence, np.arange(12.0), known).interpolated(run, 25)
    assert np.isnan(found.frames.theta[4:8]).all()
    one = np.array([0] * 3 + [1] + [0] * 8)  # a frame of another run beyond the gap says nothing of its slope
    motion = np.arange(12.0)
    motion[3:] += 40.0
    motion[3] = -30.0
    known = gap(12, (5, 8))
    found = moving(sequence, motion, known).interpolated(one, 25)
    np.testing.assert_allclose(pans(found)[5:8], motion[5:8], atol=1e-9)


def test_nothing_is_extrapolated(sequence):
    known = gap(12, (0, 3), (9, 12))
    found = moving(sequence, np.arange(12.0), known).interpolated(np.zeros(12, dtype=int), 25)
    assert np.isnan(found.frames.theta[~known]).all()
    everything = moving(sequence, np.arange(12.0), np.ones(12, dtype=bool))
    assert everything.interpolated(np.zeros(12, dtype=int), 25) is everything
    nothing = moving(sequence, np.arange(12.0), np.zeros(12, dtype=bool))
    assert nothing.interpolated(np.zeros(12, dtype=int), 25) is nothing


def test_what_was_there_stays_as_it_was(sequence):
    known = gap(12, (4, 7))
    before = moving(sequence, np.arange(12.0), known)
    theta, notes = before.frames.theta.copy(), dict(before.frames.notes)
    found = before.interpolated(np.zeros(12, dtype=int), 25)
    np.testing.assert_array_equal(before.frames.theta, theta)
    assert before.frames.notes == notes
    assert [found[t] == before[t] for t in range(12)] == known.tolist()


def test_an_interpolated_sequence_survives_json(sequence):
    found = moving(sequence, np.arange(12.0), gap(12, (4, 7))).interpolated(np.zeros(12, dtype=int), 25)
    back = SequenceCalibration.from_dict(json.loads(json.dumps(found.to_dict())))
    assert back.basis == found.basis
    assert list(back) == list(found)
