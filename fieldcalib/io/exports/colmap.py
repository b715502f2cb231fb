"""COLMAP's model in text: ``cameras.txt``, ``images.txt`` and an empty ``points3D.txt``.

World and camera axes are those of this package. COLMAP's first pixel has its centre at (0.5, 0.5): its principal point
is ours + 0.5. Every image has a camera of its own, as the zoom changes.
"""

from __future__ import annotations

from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens.model import nonzero_coefficients
from fieldcalib.io.exports.frames import IMAGE_NAMES, FrameCameras, image_name, lens_coefficients, with_cameras
from fieldcalib.io.files import escaped

# Coefficients of COLMAP's models in its order, smallest model first.
MODELS = {
    "PINHOLE": (),
    "SIMPLE_RADIAL": ("k1",),
    "OPENCV": ("k1", "k2", "p1", "p2"),
    "FULL_OPENCV": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
FISHEYE = "OPENCV_FISHEYE"  # k1, k2, k3, k4 of cv2.fisheye
ONE_FOCAL_LENGTH, LARGEST = "SIMPLE_RADIAL", "FULL_OPENCV"
HALF_PIXEL = 0.5


def colmap_files(frames: FrameCameras, image_names: str = IMAGE_NAMES) -> dict[str, bytes]:
    """The three files; frames without camera are left out.

    Parameters
    ----------
    frames : mapping of str to Camera or None
    image_names : str
        Names of the images, with ``<id>`` in it.

    Raises
    ------
    ValueError
        If no frame has a camera, a name of an image has blanks, or a lens has thin prism coefficients.

    Examples
    --------
    >>> import numpy as np
    >>> camera = Camera.from_angles(0.0, np.radians(90), 0.0, 1500.0, C=(0, 60, 0), image_size=(960, 540), k=(0.1, 0))
    >>> files = colmap_files({"00001": camera})
    >>> print(files["cameras.txt"].decode().splitlines()[-1])
    1 SIMPLE_RADIAL 960 540 1500.0 480.5 270.5 0.1
    """
    cameras = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    images = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[]: none"]
    for number, (id, camera) in enumerate(with_cameras(frames).items(), start=1):
        name = escaped(image_name(image_names, id))
        if not name or any(letter.isspace() for letter in name):
            raise ValueError(f"COLMAP's names of images have no blanks, got {name!r}: rename the images")
        cameras.append(f"{number} {_intrinsics(id, camera)}")
        images += [f"{number} {_pose(camera)} {number} {name}", ""]
    points = ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]: none"]
    texts = {"cameras.txt": cameras, "images.txt": images, "points3D.txt": points}
    return {name: ("\n".join(lines) + "\n").encode() for name, lines in texts.items()}


def _intrinsics(id: str, camera: Camera) -> str:
    """``MODEL WIDTH HEIGHT PARAMS...`` with the smallest model that holds the lens."""
    fx, fy = camera.K[0, 0], camera.K[1, 1]
    width, height = camera.image_size
    if camera.fisheye:
        return (
            f"{FISHEYE} {width} {height} {_numbers([fx, fy, *(camera.principal_point + HALF_PIXEL), *camera.dist[0]])}"
        )
    needed = nonzero_coefficients(camera.dist).keys()
    fitting = (
        model for model, names in MODELS.items() if needed <= set(names) and (fx == fy or model != ONE_FOCAL_LENGTH)
    )
    model = next(fitting, LARGEST)
    lens = lens_coefficients(id, camera, MODELS[model], "COLMAP")
    focal_lengths = [fx] if model == ONE_FOCAL_LENGTH else [fx, fy]
    values = [*focal_lengths, *(camera.principal_point + HALF_PIXEL), *lens]
    return f"{model} {width} {height} {_numbers(values)}"


def _pose(camera: Camera) -> str:
    """``QW QX QY QZ TX TY TZ``, from the world to the camera."""
    from scipy.spatial.transform import Rotation  # a slow import

    x, y, z, w = Rotation.from_matrix(camera.R.copy()).as_quat()
    return _numbers([w, x, y, z, *(-camera.R @ camera.C)])


def _numbers(values: list[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
