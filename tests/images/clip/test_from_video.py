"""Videos of known cameras: shots of one tripod and of two, and odd ones."""

import json

import cv2
import numpy as np
import pytest
from networks import FIELD, GRID, KnownCameras, KnownPictures, looked_at
from tripods import far_off

from data_tools.synthetic.film import BESIDE, Scene, film
from data_tools.synthetic.paths import camera_path
from fieldcalib import Camera, calibrate_video, soccer
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.frame_table import Basis
from fieldcalib.assess.video import NO_TRIPOD, Shot, VideoCalibration
from fieldcalib.images.background.keyframe_tracking import EVERY, tied_frames
from fieldcalib.images.clip.finished_clip import MIXED
from fieldcalib.images.clip.keyframes import BARE, EXTRA_OFFSETS
from fieldcalib.io.samples import TrueFrame

KNOWN = soccer(size_known=True)
SIZE = (480, 270)
MAIN, OTHER = (1.0, 64.0, -16.0), (-14.0, 70.0, -21.0)
SHOT = 8  # frames
SEED = 5


def shot(number, tripod, first, last, focal_length, count=SHOT):
    """A camera that pans from one angle to another and zooms in."""
    share = np.linspace(0.0, 1.0, count)
    return [
        TrueFrame(
            Camera.from_angles(
                first + (last - first) * s,
                1.3 + 0.01 * s,
                0.0,
                focal_length * (1.0 + 0.1 * s),
                (MAIN, OTHER)[tripod],
                SIZE,
            ),
            number,
            tripod,
        )
        for s in share
    ]


def filmed(frames):
    return list(film(Scene.random(FIELD, SEED, cameras_of(frames)), frames))


def cameras_of(frames):
    return [frame.camera for frame in frames]


def calibrated(pictures, cameras, field=KNOWN, **options):
    return calibrate_video(field, pictures, KnownCameras([cameras[t] for t in looked_at(pictures, cameras)]), **options)


def off(found, cameras):
    """Median error of each frame over the picture, pixels."""
    return [np.median(far_off(frame.camera, truth)) for frame, truth in zip(found, cameras, strict=True)]


LEFT, RIGHT = shot(0, 0, -0.42, -0.36, 560.0), shot(1, 0, 0.36, 0.42, 590.0)
ELSEWHERE = shot(1, 1, 0.52, 0.58, 580.0)


@pytest.fixture(scope="module")
def one_tripod():
    return [*filmed(LEFT), *filmed(RIGHT)]


@pytest.fixture(scope="module")
def two_tripods(one_tripod):
    """The same first shot."""
    return [*one_tripod[:SHOT], *filmed(ELSEWHERE)]


# shots


def test_shots_of_one_tripod_share_it(one_tripod):
    cameras = cameras_of([*LEFT, *RIGHT])
    found = calibrated(one_tripod, cameras)
    assert found.shots == (Shot(0, SHOT, 0), Shot(SHOT, 2 * SHOT, 0))
    (tripod,) = found.tripods
    assert len(tripod) == 2 * SHOT
    assert all(frame.accepted for frame in found)
    assert np.linalg.norm(tripod.values[:3] - MAIN) < 0.4
    assert max(off(found, cameras)) < 0.6
    assert tripod.shared["y"][1] < 0.3


@pytest.mark.slow
def test_shots_of_two_tripods_do_not(two_tripods):
    cameras = cameras_of([*LEFT, *ELSEWHERE])
    found = calibrated(two_tripods, cameras)
    assert [(one.start, one.stop) for one in found.shots] == [(0, SHOT), (SHOT, 2 * SHOT)]
    assert sorted(one.tripod for one in found.shots) == [0, 1]
    for one, truth in zip(found.shots, (MAIN, OTHER), strict=True):
        assert np.linalg.norm(found.tripods[one.tripod].values[:3] - truth) < 1.0
    assert all(frame.accepted for frame in found)
    assert max(off(found, cameras)) < 0.8
    assert set(found.basis) == {Basis.BOTH}


def dissolved(one, other, count):
    """Two runs of pictures, the last ones of the first mixed with the first ones of the second."""
    share = np.arange(1, count + 1) / (count + 1)
    mixed = [cv2.addWeighted(a, 1.0 - s, b, s, 0.0) for a, b, s in zip(one[-count:], other, share, strict=False)]
    return [*one[:-count], *mixed, *other[count:]]


@pytest.mark.slow
def test_a_dissolve_belongs_to_neither_shot(two_tripods):
    """What is seen in pictures that nothing ties is of the second camera: it says nothing of the first shot."""
    mixed = 6
    one, other = two_tripods[:SHOT], two_tripods[SHOT:]
    pictures = dissolved([*one, *one[::-1]], [*other, *other[::-1]], mixed)
    begin, end = 2 * SHOT - mixed, 2 * SHOT
    seen_later = [(ELSEWHERE + ELSEWHERE[::-1])[t - begin].camera for t in range(begin, len(pictures))]
    cameras = [*[None] * begin, *seen_later]
    found = calibrated(pictures, cameras)
    assert all(frame.camera is None for frame in found[:begin])
    assert all(frame.verdict is not Verdict.GOOD for frame in found[:end])
    assert any(MIXED in frame.findings for frame in found[begin:end])
    assert all(frame.verdict is Verdict.GOOD for frame in found[end + 1 :])
    assert max(off(found[end + 1 :], cameras[end + 1 :])) < 0.8


@pytest.mark.slow
def test_a_shot_that_shows_no_pitch_has_no_tripod(one_tripod):
    crowd = np.random.default_rng(0).integers(0, 255, (27, 48, 3), np.uint8)
    wide = cv2.resize(crowd, (600, 300), interpolation=cv2.INTER_CUBIC)
    between = [wide[5:275, 5 * t : 5 * t + 480].copy() for t in range(SHOT)]
    pictures = [*one_tripod[:SHOT], *between, *one_tripod[SHOT:]]
    cameras = [*cameras_of(LEFT), *[None] * SHOT, *cameras_of(RIGHT)]
    found = calibrated(pictures, cameras)
    assert [one.tripod for one in found.shots] == [0, NO_TRIPOD, 0]
    assert [camera is None for camera in found.cameras] == [camera is None for camera in cameras]
    assert max(off([*found[:SHOT], *found[-SHOT:]], cameras_of([*LEFT, *RIGHT]))) < 0.6
    assert found.basis[SHOT : 2 * SHOT] == [Basis.NOTHING] * SHOT


class Counting(KnownPictures):
    """A network that counts the pictures that it sees."""

    seen = 0

    def __call__(self, images):
        self.seen += len(images)
        return super().__call__(images)


@pytest.mark.slow
def test_a_long_close_up_is_glanced_at(one_tripod):
    """The shots around it have the cameras that they have without it."""
    crowd = np.random.default_rng(0).integers(0, 255, (27, 64, 3), np.uint8)
    wide = cv2.resize(crowd, (1280, 300), interpolation=cv2.INTER_CUBIC)
    length = 120
    between = [wide[5:275, 5 * t : 5 * t + 480].copy() for t in range(length)]
    pictures = [*one_tripod[:SHOT], *between, *one_tripod[SHOT:]]
    cameras = [*cameras_of(LEFT), *[None] * length, *cameras_of(RIGHT)]
    network = Counting(pictures, cameras)
    found = calibrate_video(KNOWN, pictures, network)
    assert [(one.start, one.stop, one.tripod) for one in found.shots] == [
        (0, SHOT, 0),
        (SHOT, SHOT + length, NO_TRIPOD),
        (SHOT + length, len(pictures), 0),
    ]
    assert max(off([*found[:SHOT], *found[-SHOT:]], cameras_of([*LEFT, *RIGHT]))) < 0.6
    assert network.seen < 20  # every keyframe, and six frames more, would be 18 of the close-up alone


@pytest.mark.slow
def test_a_keyframe_that_the_network_mistakes_is_voted_out(one_tripod):
    """It is told the other penalty area, in the middle of three shots' keyframes."""
    pictures = one_tripod[:SHOT]
    cameras = cameras_of(LEFT)
    found = calibrate_video(KNOWN, pictures, told := KnownCameras([cameras[0], cameras[3], RIGHT[0].camera]), every=3)
    assert len(told.maps) == 0  # keyframes are 0, 3 and 6
    assert all(frame.accepted for frame in found)
    assert max(off(found, cameras)) < 1.0


@pytest.mark.slow
def test_more_frames_are_looked_at_where_a_keyframe_tells_nothing(one_tripod):
    cameras = cameras_of(LEFT)
    network = KnownCameras([None, cameras[EXTRA_OFFSETS[0]]])
    found = calibrate_video(KNOWN, one_tripod[:SHOT], network)
    assert len(network.maps) == 0
    assert all(frame.accepted for frame in found)
    assert max(off(found, cameras)) < 1.0


def test_the_network_does_not_look_on_and_on(one_tripod):
    count = 4 * EVERY
    looked = []

    class Blind(KnownCameras):
        def __call__(self, images):
            looked.extend(images)
            return np.stack([self.nothing(GRID)] * len(images))

    rng = np.random.default_rng(0)
    crowd = cv2.resize(rng.integers(0, 255, (27, 60, 3), np.uint8), (1200, 270), interpolation=cv2.INTER_CUBIC)
    found = calibrate_video(KNOWN, [crowd[:, t : t + SIZE[0]].copy() for t in range(count)], Blind([]))
    assert not any(frame.accepted for frame in found)
    assert len(looked) == BARE  # then it is glanced at, after `GLANCE` frames again


def test_the_result_of_a_video_survives_json(one_tripod):
    found = calibrated(one_tripod[:3], cameras_of(LEFT))
    back = VideoCalibration.from_dict(json.loads(json.dumps(found.to_dict())))
    assert list(back) == list(found)


def test_what_stands_still_is_the_background_of_a_camera_at_rest():
    """Not players who run the same way, though more than a third of the corners is on them."""
    rng = np.random.default_rng((0, 9))
    cameras = camera_path(rng, 150, image_size=SIZE)
    beside = camera_path(rng, 150, centre=cameras[0].C + (BESIDE, 0.0, 0.0), image_size=SIZE)
    play = [*cameras[:16], *beside[75:91]]  # what players follow
    frames = [TrueFrame(camera, 0, 0) for camera in cameras[:5]]  # which move by a tenth of a pixel
    pictures = list(film(Scene.random(FIELD, 3, play), frames))
    ((_, matches),) = list(tied_frames(pictures))[-1][1].ties
    moved = np.median(np.linalg.norm(matches.second - matches.first, axis=1))
    assert moved < 0.3


# odd videos


def test_a_video_without_a_pitch():
    noise = np.random.default_rng(0).integers(0, 255, (27, 48, 3), np.uint8)
    pictures = [cv2.resize(np.roll(noise, t, axis=1), SIZE, interpolation=cv2.INTER_CUBIC) for t in range(4)]
    found = calibrated(pictures, [None] * 4, take_off_borders=False)  # smooth noise has windows now and then
    assert found.cameras == [None] * 4
    assert found.tripods == ()
    assert [str(frame.status) for frame in found] == ["too few segments"] * 4
    assert {one.tripod for one in found.shots} == {NO_TRIPOD}


def test_a_video_of_one_frame(one_tripod):
    found = calibrated(one_tripod[:1], cameras_of(LEFT))
    assert found.shots == (Shot(0, 1, 0),)
    assert found.basis == [Basis.LINES]
    assert found[0].accepted
    assert off(found, cameras_of(LEFT[:1]))[0] < 1.0


def test_frames_that_know_the_field_alike_have_one_verdict(one_tripod):
    """One penalty area in view does not tell how long the pitch is: of the keyframe no more than of the others."""
    found = calibrated(one_tripod[:4], cameras_of(LEFT), FIELD)
    assert len({str(frame.status) for frame in found}) == 1


def test_a_frozen_video(one_tripod):
    found = calibrated([one_tripod[0]] * 5, [LEFT[0].camera] * 5)
    assert found.shots == (Shot(0, 5, 0),)
    assert all(frame.accepted for frame in found)
    assert np.ptp([frame.camera.focal_length for frame in found]) < 0.5


def test_no_video():
    found = calibrate_video(FIELD, [], KnownCameras([]))
    assert (len(found), found.shots, found.tripods) == (0, (), ())


def test_a_frame_of_another_size_is_named(one_tripod):
    pictures = [*one_tripod[:4], one_tripod[4][:, :470]]
    with pytest.raises(ValueError, match="frame 4 has 470 x 270 pixels, those before it 480 x 270"):
        calibrate_video(FIELD, pictures, KnownCameras([LEFT[0].camera] * 5))


def test_an_iterator_is_refused_before_it_is_read(one_tripod):
    images = iter(one_tripod)
    with pytest.raises(ValueError, match="expected a path or a sequence of images, got an iterator"):
        calibrate_video(FIELD, images, KnownCameras([]))
    assert len(list(images)) == 2 * SHOT
    with pytest.raises(ValueError, match="got an iterator"):
        calibrate_video(FIELD, (picture for picture in one_tripod), KnownCameras([]))


def test_every_is_one_or_more(one_tripod):
    with pytest.raises(ValueError, match="every must be 1 or more frames, got 0"):
        calibrate_video(FIELD, one_tripod[:1], KnownCameras([LEFT[0].camera]), every=0)


@pytest.mark.slow
def test_a_long_video_is_calibrated_part_by_part(one_tripod, monkeypatch):
    """Each shot is a part: both know one tripod."""
    monkeypatch.setattr("fieldcalib.images.clip.from_video.PART", SHOT)
    cameras = cameras_of([*LEFT, *RIGHT])
    found = calibrate_video(KNOWN, one_tripod, KnownPictures(one_tripod, cameras))
    assert found.shots == (Shot(0, SHOT, 0), Shot(SHOT, 2 * SHOT, 0))
    assert len(found.tripods) == 1
    assert all(frame.accepted for frame in found)
    assert max(off(found, cameras)) < 0.8
