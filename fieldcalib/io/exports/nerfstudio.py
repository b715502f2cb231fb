"""nerfstudio's ``transforms.json``: intrinsics in every frame, poses from camera to world with OpenGL's axes, z up.

nerfstudio's first pixel has its centre at (0.5, 0.5): its principal point is ours + 0.5.
"""

from __future__ import annotations

import json
from typing import Any

from fieldcalib.geometry.camera import Camera
from fieldcalib.io.exports.frames import (
    IMAGE_NAMES,
    FrameCameras,
    camera_to_world,
    image_name,
    lens_coefficients,
    with_cameras,
)

KEYS = ("k1", "k2", "k3", "p1", "p2")
FISHEYE_KEYS = ("k1", "k2", "k3", "k4")  # of cv2.fisheye
HALF_PIXEL = 0.5


def nerfstudio_files(frames: FrameCameras, image_names: str = IMAGE_NAMES) -> dict[str, bytes]:
    """``transforms.json``; frames without camera are left out.

    Parameters
    ----------
    frames : mapping of str to Camera or None
    image_names : str
        Paths of the images from the folder of the file, with ``<id>`` in it.

    Raises
    ------
    ValueError
        If no frame has a camera, a lens has coefficients beyond k1, k2, k3, p1 and p2, or only some are fisheye lenses.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, C=(0, 60, -15), image_size=(960, 540))
    >>> (frame,) = json.loads(nerfstudio_files({"00001": camera})["transforms.json"])["frames"]
    >>> frame["file_path"], frame["fl_x"], frame["cx"]
    ('00001.jpg', 1500.0, 480.5)
    """
    cameras = with_cameras(frames)
    models = {"OPENCV_FISHEYE" if camera.fisheye else "OPENCV" for camera in cameras.values()}
    if len(models) > 1:
        raise ValueError("nerfstudio has one model for all frames: some have a fisheye lens, export them apart")
    record = {
        "camera_model": models.pop(),
        "frames": [_frame(id, camera, image_name(image_names, id)) for id, camera in cameras.items()],
    }
    return {"transforms.json": (json.dumps(record, indent=1) + "\n").encode()}


def _frame(id: str, camera: Camera, path: str) -> dict[str, Any]:
    keys = FISHEYE_KEYS if camera.fisheye else KEYS
    values = camera.dist[0].tolist() if camera.fisheye else lens_coefficients(id, camera, KEYS, "nerfstudio")
    width, height = camera.image_size
    cx, cy = (camera.principal_point + HALF_PIXEL).tolist()
    return {
        "file_path": path,
        "w": width,
        "h": height,
        "fl_x": float(camera.K[0, 0]),
        "fl_y": float(camera.K[1, 1]),
        "cx": cx,
        "cy": cy,
        **dict(zip(keys, values, strict=True)),
        "transform_matrix": camera_to_world(camera).tolist(),
    }
