"""A video of one shot: its frames share a tripod."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from networks import KnownCameras

from fieldcalib import Camera, calibrate_video, soccer
from fieldcalib.assess.findings import Verdict
from fieldcalib.draw.scene import render_field
from fieldcalib.images.clip.finished_clip import _with_little_paint_doubted
from fieldcalib.io.videos import VideoWriter

FIELD = soccer(line_width=0.0)  # as its pictures are drawn
CENTRE = (1.0, 66.0, -16.0)
CAMERAS = [
    Camera.from_angles(pan, 1.32, 0.0, 475.0 + 200.0 * abs(pan), CENTRE, (480, 270))
    for pan in np.linspace(-0.5, 0.5, 9)
]


@pytest.fixture(scope="module")
def pictures():
    return [render_field(camera, FIELD) for camera in CAMERAS]


def test_frames_share_their_tripod(pictures):
    found = calibrate_video(FIELD, pictures, KnownCameras(CAMERAS))
    assert all(frame.accepted for frame in found)
    assert np.linalg.norm(found.tripods[0].values[:3] - CENTRE) < 0.3
    for frame, truth in zip(found, CAMERAS, strict=True):
        mark = truth.image_to_field([240.0, 150.0])
        assert np.linalg.norm(frame.camera.project(mark) - [240.0, 150.0]) < 0.25
        assert frame.camera.focal_length == pytest.approx(truth.focal_length, rel=0.01)


@pytest.mark.slow
def test_a_frame_that_shows_nothing_is_interpolated(pictures):
    black = np.zeros_like(pictures[0])
    cameras = [*CAMERAS[:4], None, *CAMERAS[4:]]
    found = calibrate_video(FIELD, [*pictures[:4], black, *pictures[4:]], KnownCameras(cameras))
    assert [str(basis) for basis in found.basis].index("interpolated") == 4
    sigma = [np.sqrt(frame.covariance[0, 0]) for frame in found]
    assert sigma[4] > max(sigma[3], sigma[5])
    assert found[3].camera.angles[0] < found[4].camera.angles[0] < found[5].camera.angles[0]


def test_a_file(pictures, tmp_path):
    with VideoWriter(tmp_path / "shot.mp4", 25.0) as video:
        for picture in pictures[:3]:
            video.write(picture)
    found = calibrate_video(FIELD, tmp_path / "shot.mp4", KnownCameras(CAMERAS))
    assert len(found) == 3
    assert np.linalg.norm(found.tripods[0].values[:3] - CENTRE) < 1.0


def test_a_file_that_is_cut_off(tmp_path, capfd):
    path = tmp_path / "a.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 36))
    for image in np.random.default_rng(0).integers(0, 255, (12, 36, 64, 3), dtype=np.uint8):
        writer.write(image)
    writer.release()
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.warns(UserWarning, match=r"a.avi: announces 12 frames, [45] can be read"):
        assert len(calibrate_video(FIELD, path, KnownCameras([None] * 12))) < 6


@pytest.mark.slow
def test_a_folder(pictures, tmp_path):
    for number, picture in enumerate(pictures[:2], 9):
        cv2.imwrite(str(tmp_path / f"frame {number}.png"), picture)
    assert calibrate_video(FIELD, tmp_path, KnownCameras(CAMERAS)) == calibrate_video(
        FIELD, pictures[:2], KnownCameras(CAMERAS)
    )


def test_frames_of_several_sizes_are_refused(pictures):
    with pytest.raises(ValueError, match="frame 1 has 240 x 135 pixels, those before it 480 x 270"):
        calibrate_video(FIELD, [pictures[0], pictures[1][::2, ::2]], KnownCameras(CAMERAS))
    assert len(calibrate_video(FIELD, [], KnownCameras([]))) == 0
    with pytest.raises(FileNotFoundError):
        calibrate_video(FIELD, "no such video.mp4", KnownCameras([]))


def test_a_shot_is_doubted_where_few_of_its_markings_show_paint(pictures):
    (tripod,) = calibrate_video(FIELD, pictures[:4], KnownCameras(CAMERAS[:4])).tripods
    assert _with_little_paint_doubted(tripod) is tripod
    faint = {t: tuple(replace(one, share=0.4) for one in seen) for t, seen in tripod.frames.markings.items()}
    doubted = _with_little_paint_doubted(replace(tripod, frames=replace(tripod.frames, markings=faint)))
    assert all(one.verdict is Verdict.CHECK for one in doubted)
    assert "only 40 % of the markings in view show paint" in doubted[0].reason
