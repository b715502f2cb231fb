"""Live video: cameras from what came before."""

import gc
import time
from collections import deque
from dataclasses import replace
from itertools import repeat
from threading import Event

import numpy as np
import pytest
from networks import KnownCameras
from waiting import wait_until

from data_tools.synthetic.film import Scene, film
from data_tools.synthetic.paths import camera_path
from fieldcalib import Status, soccer
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.frame_table import Basis
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.background.keyframe_tracking import LOST_FOR, KeyframeTracker
from fieldcalib.images.clip import live_shot
from fieldcalib.images.clip import tracker as tracker_module
from fieldcalib.images.clip.clip_problem import ClipProblem
from fieldcalib.images.clip.live_shot import MOST_EXTRAPOLATED, SegmentedImage, ShotProblem, solve_shot
from fieldcalib.images.clip.tracker import Tracker
from fieldcalib.images.from_images import How
from fieldcalib.images.paint.paint_evidence import PaintEvidence
from fieldcalib.io.samples import TrueFrame
from fieldcalib.problem.labelled_pixels import NO_PIXELS
from fieldcalib.processes.other_process import OtherProcess, ProcessEndedError
from fieldcalib.solve.request import Task

SIZE = (480, 270)
FIELD = soccer(size_known=True)
EVERY = 6
RELATIVE_TO = ("markings in view", "centre mark")


@pytest.fixture(scope="module")
def clip():
    """Cameras of a shot, and its pictures."""
    rng = np.random.default_rng((0, 4))
    cameras = camera_path(rng, 150, image_size=SIZE)[40:58]
    return cameras, list(film(Scene.random(FIELD, 3, cameras), [TrueFrame(camera, 0, 0) for camera in cameras]))


def off(calibration, camera):
    """Largest distance, px, of field points in view."""
    xy = np.stack(np.meshgrid(np.linspace(40.0, 440.0, 5), np.linspace(60.0, 250.0, 4)), axis=-1).reshape(-1, 2)
    X = camera.image_to_field(xy)
    seen = np.all(np.abs(X[:, :2]) < (52.5, 34.0), axis=1)
    return np.max(np.linalg.norm(calibration.camera.project(X[seen]) - xy[seen], axis=1))


class Forever(KnownCameras):
    """What the cameras of keyframes see, whichever of them are asked for."""

    def __init__(self, cameras):
        super().__init__(cameras)
        self.asked = 0

    def __call__(self, images):
        found = np.stack([self.maps[min(self.asked + k, len(self.maps) - 1)] for k in range(len(images))])
        self.asked += len(images)
        return found


def tracked(pictures, keyframes):
    with Tracker(FIELD, KnownCameras(keyframes), every=EVERY, wait=True) as tracker:
        return [(tracker.update(picture), tracker.basis) for picture in pictures]


@pytest.fixture(scope="module")
def followed(clip):
    """The clip as a tracker follows it whose network knows the keyframes."""
    cameras, pictures = clip
    return tracked(pictures, cameras[::EVERY])


def test_every_frame_has_its_camera_at_once(clip, followed):
    cameras, _ = clip
    assert all(calibration.accepted for calibration, _ in followed)
    assert max(off(one, camera) for (one, _), camera in zip(followed, cameras, strict=True)) < 2.0
    assert [basis for _, basis in followed][1:] == [Basis.BOTH] * (len(cameras) - 1)


@pytest.mark.slow
def test_clips_of_one_end_are_accepted():
    """Of a pitch of unknown length: what is in view is known well relative to its markings."""
    pans = np.linspace(0.5, 0.6, 20)
    cameras = [Camera.from_angles(pan, 1.34, 0.0, 700.0, (0.0, 66.0, -17.0), SIZE) for pan in pans]
    pictures = list(film(Scene.random(FIELD, 3, cameras), [TrueFrame(camera, 0, 0) for camera in cameras]))
    with Tracker(soccer(), KnownCameras(cameras[::EVERY]), every=EVERY, wait=True) as tracker:
        found = [tracker.update(picture) for picture in pictures]
    assert all(one.accepted for one in found), [one.reason for one in found]
    assert all(str(one.verdict) == "good" for one in found[1:])
    here = (480.0 / 2.0, 150.0)
    assert (
        found[-1].field_uncertainty(here).rms < 0.5 < found[-1].field_uncertainty(here, relative_to="centre mark").rms
    )


def test_keyframes_that_are_known_too_badly_to_be_accepted_have_cameras(clip, monkeypatch):
    """Frames follow from them, and say themselves how well they are known."""
    monkeypatch.setattr("fieldcalib.solve.sequence.sequence_problem.tolerance_of", lambda field: 1e-3)
    cameras, pictures = clip
    found = tracked(pictures[: 2 * EVERY], [None, cameras[EVERY]])
    shown = [one for one, _ in found[EVERY + 1 :]]  # the first keyframe tells nothing
    assert max(off(one, camera) for one, camera in zip(shown, cameras[EVERY + 1 :], strict=False)) < 2.0


def test_verdicts_rest_on_the_paint_in_the_images(clip, followed, monkeypatch):
    cameras, pictures = clip
    looked_at = [one for one, _ in followed if one.camera is not None]
    assert all(len(one.markings) > 3 for one in looked_at)
    assert not any(marking.is_beside for one in looked_at for marking in one.markings)
    beside = MarkingInView("Middle line", 300.0, 25, share=0.1, offset=21.4), *looked_at[0].markings
    monkeypatch.setattr(live_shot, "evidence_of", lambda *_: PaintEvidence(beside, NO_PIXELS))
    again = [one for one, _ in tracked(pictures[: EVERY + 2], cameras[::EVERY]) if one.camera is not None]
    assert {one.verdict for one in again} == {Verdict.CHECK}
    assert again[0].reason.startswith("'Middle line' lies 21 px beside its paint")


def test_errors_grow_while_nothing_ties_the_frames(clip, monkeypatch):
    """But for matches the frames go on as before: the last one is shown again and again."""
    cameras, pictures = clip
    lost = MOST_EXTRAPOLATED + 2
    update = KeyframeTracker.update
    monkeypatch.setattr(KeyframeTracker, "update", lambda self, image: update(self, image) if np.any(image[0]) else [])
    again = pictures[9].copy()
    again[0] = 0  # a black line on top: nothing ties it
    found = tracked([*pictures[:10], *[again] * lost], cameras[::EVERY])[9:]
    held = [one for one, basis in found if basis == Basis.INTERPOLATED]
    assert 3 <= len(held) <= MOST_EXTRAPOLATED
    assert np.all(np.diff([found[0][0].covariance[0, 0], *(one.covariance[0, 0] for one in held)]) > 0.0)
    assert [one.camera for one, _ in found[1 + MOST_EXTRAPOLATED :]] == [None, None]


def test_a_cut_ends_what_was_known(clip):
    cameras, pictures = clip
    white = np.full_like(pictures[0], 255)
    found = tracked([*pictures[:10], white, white], cameras[::EVERY])
    assert [one.camera for one, _ in found[10:]] == [None, None]
    assert "a cut?" in found[10][0].message


def test_what_is_never_calibrated_has_no_camera(clip):
    _, pictures = clip
    found = tracked(pictures[:3], [None])
    assert [one.status for one, _ in found] == [Status.TOO_FEW_SEGMENTS] * 3


@pytest.mark.slow
def test_another_process_calibrates_keyframes(clip):
    """The frames do not wait; the camera comes when it comes."""
    cameras, pictures = clip
    with Tracker(FIELD, Forever([cameras[0]]), every=100) as tracker:
        first = tracker.update(pictures[0])
        wait_until(lambda: tracker.update(pictures[1]).accepted)
        assert not first.accepted
        assert off(tracker.update(pictures[1]), cameras[1]) < 3.0


def test_pictures_of_another_size_begin_anew(clip):
    cameras, pictures = clip
    larger = [np.repeat(np.repeat(picture, 2, axis=0), 2, axis=1) for picture in pictures[:2]]
    with Tracker(FIELD, Forever(cameras[:1]), wait=True) as tracker:
        first = [tracker.update(picture) for picture in pictures[:2]]
        second = [tracker.update(picture) for picture in larger]
    assert [one.required_camera.image_size for one in (*first, *second)] == [SIZE] * 2 + [
        (2 * SIZE[0], 2 * SIZE[1])
    ] * 2


def test_a_camera_beside_its_paint_is_moved_onto_it(clip):
    """The keyframe that the frame is tied to moves with it, so that the frames after it are right too."""
    cameras, pictures = clip
    with Tracker(FIELD, KnownCameras(cameras[:1]), every=100, wait=True) as tracker:
        for picture in pictures[:3]:
            tracker.update(picture)
        shot, (t, camera) = tracker._shot, tracker._shot.last[-1]
        turned = camera._replace(theta=camera.theta + np.eye(len(camera.theta))[0] * 12.0 / cameras[0].focal_length)
        key = min(shot.known)
        of_key = shot.known[key]
        off_key = of_key._replace(theta=of_key.theta + turned.theta - camera.theta)
        solved = replace(shot.solved, cameras={key: off_key})
        tracker._shot = replace(shot, solved=solved, last=((t, turned),), paint=None)
        found = [tracker.update(picture) for picture in pictures[3:6]]
    assert max(off(one, camera) for one, camera in zip(found, cameras[3:6], strict=True)) < 2.0
    assert all(one.accepted for one in found)


def test_a_frame_that_matches_an_old_keyframe_has_its_camera(clip):
    """After a jump in the stream, the last camera looked elsewhere."""
    cameras, pictures = clip
    with Tracker(FIELD, KnownCameras(cameras[:1]), every=100, wait=True) as tracker:
        for picture in pictures[:3]:
            tracker.update(picture)
        ((t, camera),) = tracker._shot.last[-1:]
        elsewhere = camera._replace(theta=camera.theta + 0.8 * np.eye(len(camera.theta))[0])
        tracker._shot = replace(tracker._shot, last=((t, elsewhere),))
        found = tracker.update(pictures[3])
    assert off(found, cameras[3]) < 2.0


def test_frames_that_contradict_their_keyframes_are_found_again(clip, monkeypatch):
    cameras, pictures = clip
    tied = live_shot._tied
    with Tracker(FIELD, Forever(cameras[::12]), every=12, wait=True) as tracker:
        for picture in pictures[:2]:
            tracker.update(picture)
        first = tracker._shot.identity
        monkeypatch.setattr(
            live_shot, "_tied", lambda *a: None if tracker._shot.identity == first and a[3] is not None else tied(*a)
        )
        found = [tracker.update(picture) for picture in pictures[2:]]
    assert found[0].camera is None
    assert tracker._shot.identity > first
    assert off(found[-1], cameras[-1]) < 2.0


@pytest.mark.slow
def test_a_shot_from_a_known_tripod_is_recognised(clip):
    """One of its keyframes, with few lines, is enough: place, lens and field are those of the shot before."""
    cameras, pictures = clip
    crowd = [np.random.default_rng(k).integers(0, 255, pictures[0].shape, np.uint8) for k in range(LOST_FOR + 1)]
    seen = [*cameras[::EVERY], cameras[5], cameras[5 + EVERY]]
    with Tracker(FIELD, KnownCameras(seen), every=EVERY, wait=True) as tracker:
        for picture in pictures:
            tracker.update(picture)
        before = tracker._shot
        assert not any(tracker.update(picture) for picture in crowd)
        found = [tracker.update(picture) for picture in pictures[5:17]]
    assert tracker._shot.tripod == before.identity != tracker._shot.identity
    assert found[-1].accepted
    assert off(found[-1], cameras[16]) < 2.0
    assert tracker._shot.solved.shared.object_segments == before.solved.shared.object_segments


@pytest.mark.slow
def test_cameras_that_the_paint_contradicts_are_found_again(clip, monkeypatch):
    cameras, pictures = clip
    beside = PaintEvidence((MarkingInView("Middle line", 300.0, 25, share=0.1, offset=21.4),), NO_PIXELS)
    evidence = live_shot.evidence_of
    with Tracker(FIELD, Forever(cameras[::5]), every=5, wait=True) as tracker:
        for picture in pictures[:2]:
            tracker.update(picture)
        first = tracker._shot

        def of_first(*ridges):
            return beside if tracker._shot.identity == first.identity else evidence(*ridges)

        monkeypatch.setattr(live_shot, "evidence_of", of_first)
        found = [tracker.update(picture) for picture in pictures[2:]]
    assert not all(one.accepted for one in found)
    assert set(first.remembered.labels) == {0}
    assert tracker._shot.identity > first.identity
    assert found[-1].accepted
    assert off(found[-1], cameras[-1]) < 2.0


def test_images_that_come_too_fast_are_dropped_and_counted(clip):
    cameras, pictures = clip
    with Tracker(FIELD, Forever(cameras[:1]), wait=True) as tracker:
        frames = list(tracker.live(pictures[k % 2] for k in range(40)))
    assert frames[-1].dropped == 40 - len(frames) > 0
    assert all(0.0 < frame.late < 60.0 for frame in frames)
    assert len(repr(frames[-1])) < 200  # without the picture
    assert frames[-1].calibration.accepted


def test_it_gives_what_this_process_gives(clip):
    cameras, pictures = clip
    network = KnownCameras(cameras[:1])
    seen = SegmentedImage(pictures[0], network.classes, network(pictures[:1]))
    problem = ShotProblem(ClipProblem(How(Task(FIELD)), SIZE, [0], {}, {}), 0)
    other = OtherProcess()
    there = other.run(solve_shot, problem, seen)
    other.close()
    here = solve_shot(problem, seen)
    np.testing.assert_allclose(there.solved.cameras[0].theta, here.solved.cameras[0].theta, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_keyframes_that_came_in_the_meantime_have_cameras(clip):
    """The first one is calibrated when the third one has come."""
    cameras, pictures = clip
    shown = Event()

    class Late(Forever):
        def __call__(self, images):
            shown.wait()
            return super().__call__(images)

    with Tracker(FIELD, Late([cameras[0]]), every=EVERY) as tracker:
        for picture in pictures[: 2 * EVERY + 2]:
            assert tracker.update(picture).camera is None
        shown.set()
        found = wait_until(lambda: (one := tracker.update(pictures[2 * EVERY + 1])).accepted and one)
    assert off(found, cameras[2 * EVERY + 1]) < 3.0


@pytest.mark.parametrize("wait", [True, False])
def test_a_network_that_fails(clip, wait):
    def fails(images):
        raise ZeroDivisionError("no network")

    fails.classes = KnownCameras.classes
    _, pictures = clip
    with Tracker(FIELD, fails, wait=wait) as tracker, pytest.raises(ZeroDivisionError, match="no network"):
        deque(map(tracker.update, repeat(pictures[0])))


@pytest.mark.parametrize("wait", [True, False])
def test_a_closed_tracker(clip, wait):
    cameras, pictures = clip
    tracker = Tracker(FIELD, KnownCameras(cameras[:1]), wait=wait)
    tracker.update(pictures[0])
    tracker.close()
    tracker.close()
    with pytest.raises(ValueError, match="the tracker is closed"):
        tracker.update(pictures[1])


@pytest.mark.slow
def test_another_process_goes_on_for_one_that_is_killed(clip, caplog):
    """As the system kills one when memory is short."""
    cameras, pictures = clip
    with Tracker(FIELD, KnownCameras([cameras[0]] * 10)) as tracker:
        tracker._other._process.kill()
        deadline = time.monotonic() + 60.0
        while not tracker.update(pictures[0]).accepted:
            assert time.monotonic() < deadline
            time.sleep(0.05)
    assert "with exit code -9: another one goes on" in caplog.text


def test_a_keyframe_whose_process_always_ends_is_left_out(clip, monkeypatch):
    cameras, pictures = clip
    with Tracker(FIELD, KnownCameras(cameras[:1])) as tracker:
        monkeypatch.setattr(tracker_module, "OtherProcess", lambda *_: _Ends())
        tracker._other.close()
        tracker._other = _Ends()
        assert tracker._solution_there(None, None).solved is None
        assert not tracker.update(pictures[0]).accepted


class _Ends:
    def run(self, *arguments):
        raise ProcessEndedError(-9)

    def close(self):
        pass


@pytest.mark.parametrize(
    ("field", "network", "message"), [("a", None, "expected a field"), (FIELD, "network.onnx", "expected a network")]
)
def test_what_is_no_field_or_network_is_named(field, network, message):
    with pytest.raises(ValueError, match=message):
        Tracker(field, network)


@pytest.mark.slow
def test_nothing_is_left_of_a_tracker_that_is_not_closed(clip):
    cameras, pictures = clip
    tracker = Tracker(FIELD, KnownCameras(cameras[:1]))
    tracker.update(pictures[0])
    process = tracker._other._process
    del tracker
    while process.poll() is None:  # when the thread has done what it is at
        gc.collect()
        time.sleep(0.1)
