"""A script for Blender that makes an animated camera: ``blender --python camera.py``, or run in its text editor.

World: metres, x right, y away from the main camera, z up. The edges of Blender's image are half a pixel outside the
centres of the outermost pixels, so that with a principal point c of ours and an image of w x h

    lens = fx sensor_width / w      shift_x = (w / 2 - (cx + 1/2)) / w
    fy / fx = pixel_aspect_x / pixel_aspect_y      shift_y = (cy + 1/2 - h / 2) / w pixel_aspect_y / pixel_aspect_x

Blender's camera has no distortion: see `blender_error`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from fieldcalib._types import Array
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.exports.frames import FrameCameras, camera_to_world, with_cameras

SAME_ASPECT = 1e-9  # relative
FIRST_FRAME = 1  # Blender's number of a film's first frame

SCRIPT = Path(__file__).with_name("blender_script.txt").read_text(encoding="utf-8")


def blender_files(frames: FrameCameras, fps: float = 25.0, sensor_width: float = 36.0) -> dict[str, bytes]:
    """``camera.py``: a script that makes the camera, with a key for every frame that has one.

    Ids that are numbers, as those of videos, are kept: frame 0 is Blender's frame 1. Others are counted from 1.

    Parameters
    ----------
    frames : mapping of str to Camera or None
    fps : float
        Frames per second.
    sensor_width : float
        Width of the sensor in mm. The picture does not depend on it, but the focal length in mm does.

    Raises
    ------
    ValueError
        If no frame has a camera, or cameras differ in the size of the image or in fy / fx, which a scene has once.
    """
    cameras = with_cameras(frames)
    first_id, first = next(iter(cameras.items()))
    aspect = first.K[1, 1] / first.K[0, 0]
    for id, camera in cameras.items():
        if camera.image_size != first.image_size:
            raise ValueError(
                f"Blender has one size of images: {first_id} has {first.image_size}, {id} {camera.image_size}; "
                f"export them one by one"
            )
        if abs(camera.K[1, 1] / camera.K[0, 0] / aspect - 1.0) > SAME_ASPECT:
            raise ValueError(
                f"Blender has one aspect ratio of pixels: {first_id} and {id} differ; export them one by one"
            )
    whole = max(round(fps), 1)
    settings = {
        "image_size": first.image_size,
        "pixel_aspect": (aspect, 1.0) if aspect >= 1.0 else (1.0, 1.0 / aspect),  # Blender's are 1 or more
        "sensor_width": sensor_width,
        "fps": whole,
        "fps_base": whole / fps,
    }
    numbers = _frame_numbers(frames)
    poses = {id: camera_to_world(camera) for id, camera in cameras.items()}
    quaternions = _continuous_quaternions(poses.values())
    keys = [
        {"frame": numbers[id], **_key(camera, sensor_width, poses[id], quaternion, aspect)}
        for (id, camera), quaternion in zip(cameras.items(), quaternions, strict=True)
    ]
    keys.sort(key=lambda one: one["frame"])
    lines = "[\n" + ",\n".join(json.dumps(one) for one in keys) + "\n]"
    return {"camera.py": (SCRIPT % {"settings": json.dumps(settings), "cameras": lines}).encode()}


def blender_error(camera: Camera) -> float:
    """Largest displacement of a point of the image, pixels, without the lens, which Blender's camera lacks."""
    return camera.lens_shift


def _frame_numbers(frames: FrameCameras) -> dict[str, int]:
    if all(id.isdecimal() for id in frames):
        numbers = {id: int(id) + FIRST_FRAME for id in frames}
        if len(set(numbers.values())) == len(numbers):  # not "1" and "01"
            return numbers
    return {id: number for number, id in enumerate(frames, start=FIRST_FRAME)}


def _key(camera: Camera, sensor_width: float, pose: Array, quaternion: Array, aspect: float) -> dict[str, Any]:
    width, height = camera.image_size
    x, y = camera.principal_point + 0.5  # from the edges of the image
    return {
        "lens": camera.focal_length * sensor_width / width,
        "shift": [float((width / 2 - x) / width), float((y - height / 2) / width / aspect)],
        "location": pose[:3, 3].tolist(),
        "quaternion": quaternion.tolist(),
        "distortion": camera.dist[0].tolist(),
    }


def _continuous_quaternions(poses: Iterable[Array]) -> list[Array]:
    """Quaternions (w, x, y, z) of 4 x 4 poses, with the signs that make each near to the previous one."""
    from scipy.spatial.transform import Rotation  # a slow import

    quaternions: list[Array] = []
    for pose in poses:
        q = Rotation.from_matrix(pose[:3, :3]).as_quat()[[3, 0, 1, 2]]
        quaternions.append(-q if quaternions and np.dot(q, quaternions[-1]) < 0.0 else q)
    return quaternions
