"""Clips between black borders, squashed clips, and parts of frames: read from files, and live."""

from concurrent.futures import Future
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from networks import KnownCameras, looked_at
from tripods import far_off

from data_tools.synthetic.clips import labelled
from data_tools.synthetic.film import Scene, film
from data_tools.synthetic.paths import camera_path
from fieldcalib import Camera, calibrate_video, soccer
from fieldcalib.assess.findings import SHAPE, WAS_SQUASHED, Verdict
from fieldcalib.assess.video import Shape, VideoCalibration
from fieldcalib.images.clip import clip_shape
from fieldcalib.images.clip.clip_shape import LiveShape, ShapeEstimator, bright_frames, shape_of_odds
from fieldcalib.images.clip.tracker import Tracker
from fieldcalib.images.from_images import How
from fieldcalib.images.shape.borders_and_windows import parts_of, within_borders
from fieldcalib.io.clips import ClipInput
from fieldcalib.io.frame_source import VideoFrames
from fieldcalib.io.samples import TrueFrame
from fieldcalib.io.videos import VideoReader
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.problem.picture_shape import Crop, Placement
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import KNOWN_INTRINSICS_FLAGS

SIZE, BAR = (480, 270), 45
LETTERBOXED, SQUASHED = (SIZE[0], SIZE[1] + 2 * BAR), (360, 270)
FIELD = soccer(size_known=True)
COUNT, EVERY = 16, 6


@pytest.fixture(scope="module")
def clip():
    """Cameras of a shot, and its pictures."""
    cameras = camera_path(np.random.default_rng((0, 4)), 150, image_size=SIZE)[40 : 40 + COUNT]
    return cameras, list(film(Scene.random(FIELD, 3, cameras), [TrueFrame(camera, 0, 0) for camera in cameras]))


@pytest.fixture
def often(monkeypatch):
    """Every other frame is looked at."""
    monkeypatch.setattr(clip_shape, "APART", 2)


def letterboxed(image, bar=BAR):
    return cv2.copyMakeBorder(image, bar, bar, 0, 0, cv2.BORDER_CONSTANT)


def squashed(image, size=SQUASHED):
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def test_a_declared_part_is_cut_out_of_its_frame(clip):
    """The rest of the frame is black, and where the part is dark does not matter."""
    _, pictures = clip
    frames = [np.zeros_like(image) for image in pictures[:3]]
    for frame, image in zip(frames, pictures, strict=False):
        frame[30:, 120:400] = np.maximum(image[30:, 120:400], 1)
    frames[1][60:, 120:] = 0
    how = How(Task(FIELD), estimate_aspect=False, take_off_borders=False, part=Crop(SIZE, (120, 30)))
    shape = ShapeEstimator(how).shape(frames)
    assert shape.placement.crop == Crop((280, 240), (-120, -30))
    np.testing.assert_array_equal(shape.placement.image_in_frame(frames[0]), frames[0][30:, 120:400])


class Asked(KnownCameras):
    """What cameras see, in the order in which their frames are looked at, again and again."""

    def __init__(self, cameras):
        super().__init__(cameras)
        self.count = 0

    def __call__(self, images):
        found = np.stack([self.maps[(self.count + k) % len(self.maps)] for k in range(len(images))])
        self.count += len(images)
        return found


@pytest.mark.slow
def test_a_letterboxed_clip_is_calibrated_as_without_borders(clip):
    cameras, pictures = clip
    seen = [cameras[t] for t in looked_at(pictures, cameras)]
    plain = calibrate_video(FIELD, pictures, KnownCameras(seen))
    boxed = [letterboxed(picture) for picture in pictures]
    found = calibrate_video(FIELD, boxed, KnownCameras(seen))
    assert found.shape.placement == Placement(LETTERBOXED, LETTERBOXED, Crop(SIZE, (0, -BAR)))
    assert [one.verdict for one in found] == [one.verdict for one in plain]
    for one, other, truth in zip(found, plain, cameras, strict=True):
        assert one.camera.image_size == LETTERBOXED
        np.testing.assert_allclose(one.camera.C, other.camera.C, atol=1e-6)
        assert np.median(far_off(one.camera.cropped((0, BAR), SIZE), truth)) < 1.0
        assert "the picture is in 480 x 270 at 0, 45" in one.message
    assert "the rest is left out" in found.notes[-1]
    again = VideoCalibration.from_dict(found.to_dict())
    assert again == found
    assert again[3:5].cameras[0].image_size == LETTERBOXED
    whole = {"take_off_borders": False, "estimate_aspect": False}
    assert calibrate_video(FIELD, boxed[:1], Asked(cameras[:1]), **whole).shape is None


@pytest.mark.slow
def test_a_squashed_clip_is_calibrated_as_shown(clip, often):
    cameras, pictures = clip
    thin = [squashed(picture) for picture in pictures]
    # eight frames as they are, and as shown; then those that any clip is looked at in
    first = [cameras[t] for t in range(0, COUNT, 2)]
    network = Asked([*first, *first, *(cameras[t] for t in looked_at(pictures, cameras))])
    found = calibrate_video(FIELD, thin, network)
    assert found.shape.placement.frame_size == SIZE
    assert found.shape.findings == (WAS_SQUASHED,)
    for one, truth in zip(found, cameras, strict=True):
        assert one.verdict is Verdict.GOOD
        assert WAS_SQUASHED in one.findings
        assert one.camera.image_size == SQUASHED
        assert one.camera.K[1, 1] / one.camera.K[0, 0] == pytest.approx(SIZE[0] / SQUASHED[0], rel=1e-6)
        assert np.median(far_off(one.camera, truth.scaled(SQUASHED))) < 1.0


@pytest.mark.slow
def test_frames_together_tell_squashed_clips_from_parts(clip):
    cameras, pictures = clip
    some = slice(0, COUNT, 4)
    network = Asked(cameras[some])
    asked = ShapeEstimator(How(Task(FIELD), network))
    assert asked.log_odds([squashed(picture) for picture in pictures[some]]) > 3.0
    corner = SIZE[0] - SQUASHED[0], 0
    parts = [camera.cropped(corner, SQUASHED) for camera in cameras[some]]
    asked = ShapeEstimator(How(Task(FIELD), Asked(parts)))
    assert asked.log_odds([picture[:, corner[0] :] for picture in pictures[some]]) < 0.0


@pytest.mark.parametrize("estimate", [True, False])
def test_a_video_that_states_its_pixels_is_stretched_by_them(tmp_path, estimate):
    """As of HDV, 1440 x 1080 shown as 16:9, here with borders above and below."""
    picture = np.full((96, 144, 3), 120, np.uint8)
    picture[:12] = picture[-12:] = 0
    with av.open(str(tmp_path / "a.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 144, 96, "yuv420p"
        stream.codec_context.sample_aspect_ratio = Fraction(4, 3)
        for _ in range(3):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(stream.encode(None))
    estimator = ShapeEstimator(How(Task(FIELD), estimate_aspect=estimate))
    for images in (VideoReader(tmp_path / "a.mp4"), ClipInput(VideoFrames(tmp_path / "a.mp4"), progress=False)):
        shape = estimator.shape(images)
        assert shape.placement.display_size == ((192, 96) if estimate else (144, 96))
        assert shape.placement.frame_size == ((192, 72) if estimate else (144, 72))
        assert shape.findings == ()


def test_a_told_size_that_is_off_is_no_evidence_of_squashed_frames():
    views = (
        Camera.from_angles(pan, 1.3, 0.0, 2000.0, (0.0, 60.0, -14.0), (960, 540)) for pan in (0.0, 0.3, 0.33, 0.36)
    )
    seen = labelled(list(views), soccer(98.0), np.random.default_rng(0), 0.5)
    frames = [PixelTable.of(tuple(FIELD), [one.pixels]) for one in seen]
    off = ShapeEstimator(How(Task(soccer(101.0, size_known=True))))._distances(frames, (960, 540), (960, 540))
    assert np.nanmax(off) < 2.0  # of the noise of the labels


def test_what_is_not_told_is_to_be_checked(clip, monkeypatch):
    cameras, pictures = (some[:8] for some in clip)
    monkeypatch.setattr(ShapeEstimator, "log_odds", lambda asked, images: -1.0)
    thin = [squashed(picture) for picture in pictures]
    seen = [cameras[t] for t in looked_at(pictures, cameras)]
    found = calibrate_video(FIELD, thin, KnownCameras(seen))
    assert str(SHAPE) in found.notes
    assert all(SHAPE in one.findings and one.verdict is not Verdict.GOOD for one in found)
    as_they_are = calibrate_video(FIELD, thin, KnownCameras(seen), estimate_aspect=False)
    assert as_they_are.shape is None
    assert not as_they_are[0].findings or SHAPE not in as_they_are[0].findings


def test_borders_are_those_of_all_pictures_that_show_something(clip):
    boxed = [letterboxed(picture) for picture in clip[1][:3]]
    black = np.zeros_like(boxed[0])
    assert bright_frames([black] * 60) == []
    assert len(bright_frames([black] * 24 + boxed * 10)) > 1
    assert parts_of(bright_frames([black] * 24 + boxed * 10))[0].frame_size == SIZE
    bright = boxed[0].copy()
    bright[:20] = 90
    assert parts_of([*boxed, bright])[0].is_whole


def test_a_sky_that_is_black_is_no_border(clip):
    night = [picture.copy() for picture in clip[1][:3]]
    for picture in night:
        picture[:40] = 0
    assert parts_of(night)[0].is_whole


@pytest.mark.parametrize("log_odds", [-9.0, -1.0, 1.0, 9.0])
def test_odds_within_borders(log_odds):
    """Squashed frames between borders: their pixels come back where they were."""
    found = shape_of_odds(log_odds, Shape(within_borders((360, 360), (0, BAR))))
    assert (SHAPE in found.findings) is (abs(log_odds) < 3.0)
    assert found.placement.frame_size == (SIZE if log_odds > 0.0 else SQUASHED)
    xy = found.placement.to_frame([90.0, BAR + 10.0])
    np.testing.assert_allclose(xy, [120.0 if log_odds > 0.0 else 90.0, 10.0])
    assert found.words[0] == "the picture is in 360 x 270 at 0, 45, the rest is left out"
    assert Shape.from_dict(found.to_dict()) == found


def tracked(pictures, network, **options):
    with Tracker(FIELD, network, every=EVERY, wait=True, **options) as tracker:
        return [tracker.update(picture) for picture in pictures]


@pytest.mark.slow
def test_a_live_video_between_borders(clip):
    cameras, pictures = (some[: EVERY + 3] for some in clip)
    plain = tracked(pictures, Asked(cameras[::EVERY]))
    found = tracked([letterboxed(picture) for picture in pictures], Asked(cameras[::EVERY]))
    for one, other in zip(found, plain, strict=True):
        assert one.verdict is other.verdict
        np.testing.assert_allclose(one.camera.cropped((0, BAR), SIZE).C, other.camera.C, atol=1e-6)
        assert one.camera.image_size == LETTERBOXED


@pytest.mark.slow
def test_a_live_video_begins_anew_where_borders_are_none(clip):
    """What was taken for a border shows a score: it is part of the picture."""
    cameras, pictures = clip
    boxed = [letterboxed(picture) for picture in pictures]
    for picture in boxed[12:]:
        picture[:, :200] = np.maximum(picture[:, :200], 90)
    found = tracked(boxed, Asked(cameras[::EVERY]))
    assert all("the rest is left out" in one.message for one in found[:12])
    assert not any("the rest is left out" in one.message for one in found[12:])


@pytest.mark.slow
def test_live_pictures_of_another_shape_are_to_be_checked_until_it_is_told(clip, often, monkeypatch):
    cameras, pictures = clip
    monkeypatch.setattr(ShapeEstimator, "log_odds", lambda asked, images: 1.0 if len(images) < 8 else 9.0)
    found = tracked([squashed(picture) for picture in pictures], Asked(cameras[:1]))
    assert all(SHAPE in one.findings for one in found[:14] if one.camera is not None)
    assert WAS_SQUASHED in found[-1].findings
    assert SHAPE not in found[-1].findings
    assert found[-1].camera.K[1, 1] / found[-1].camera.K[0, 0] == pytest.approx(SIZE[0] / SQUASHED[0])


def live(log_odds=-9.0):
    def submit(function, images):
        done = Future()
        done.set_result(log_odds)
        return done

    return LiveShape(ShapeEstimator(How(Task(FIELD))), submit)


def test_larger_borders_begin_where_all_of_the_last_pictures_have_them(clip, often):
    shape, (_, pictures) = live(), clip
    plain = np.asarray(cv2.resize(pictures[0], LETTERBOXED), np.uint8)
    assert [shape.update(plain) for _ in range(4)] == [False] * 4
    changed = [shape.update(letterboxed(pictures[0])) for _ in range(20)]
    assert changed.count(True) == 1
    assert 14 <= changed.index(True) <= 18
    assert shape.shape.placement.frame_size == SIZE
    assert shape.update(plain) or shape.update(plain)
    assert shape.shape is None or shape.shape.placement.is_whole


def test_dark_pictures_say_nothing_of_borders(clip):
    shape, (_, pictures) = live(), clip
    boxed = letterboxed(pictures[0])
    assert not shape.update(np.zeros_like(boxed))
    assert shape.update(boxed)
    assert shape.shape.placement.frame_size == SIZE


def test_nothing_is_asked_of_pictures_whose_camera_is_given(clip):
    camera, picture = clip[0][0], letterboxed(clip[1][0])
    K = camera.cropped((0, -BAR), LETTERBOXED).K
    (found,) = tracked([picture], Asked([camera]), camera_matrix=K, flags=KNOWN_INTRINSICS_FLAGS)
    assert "borders" not in found.message
    assert SHAPE not in found.findings
    video = calibrate_video(FIELD, [picture], Asked([camera]), K, flags=KNOWN_INTRINSICS_FLAGS)
    assert video.shape is None
