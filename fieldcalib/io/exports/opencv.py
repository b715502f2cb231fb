"""OpenCV's calibration files, as its calibration sample writes them with ``cv2.FileStorage``: YAML, XML or JSON.

Keys are ``image_width``, ``image_height``, ``camera_matrix``, ``distortion_coefficients``, ``fisheye_model`` (1 where
the coefficients are the four of cv2.fisheye), and here also ``rvec`` and ``tvec``, which place the camera:
``Xc = R X + t`` with X in metres, in the axes of this package.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from fieldcalib._types import Array
from fieldcalib.geometry.camera import Camera, checked_image_size
from fieldcalib.geometry.lens.fisheye import fisheye_vector
from fieldcalib.geometry.lens.model import opencv_vector, shortest_opencv_vector
from fieldcalib.io.exports.frames import FrameCameras, with_cameras
from fieldcalib.io.files import BrokenFileError, named_in_errors, read_regular_file

# "%YAML:1.0", which OpenCV 4 reads too: by default OpenCV 5 begins a file with "%YAML 1.2"
YAML = getattr(cv2, "FILE_STORAGE_FORMAT_YAML_1_0", cv2.FILE_STORAGE_FORMAT_YAML)
FISHEYE_KEY = "fisheye_model"  # of OpenCV's calibration sample
FISHEYE_MODELS = ("equidistant", "fisheye")  # values of "distortion_model", as ROS has it


@dataclass(frozen=True, eq=False)
class OpenCVCalibration:
    """Content of a calibration file of OpenCV; None for missing keys."""

    camera_matrix: Array
    """(3, 3), pixels."""
    dist_coeffs: Array
    """(5,), (8,) or (12,): k1, k2, p1, p2, k3, ...; (4,) of a fisheye lens."""
    image_size: tuple[int, int] | None = None
    """Width and height in pixels."""
    rvec: Array | None = None
    """(3,) rotation from the world to the camera, radians."""
    tvec: Array | None = None
    """(3,) origin of the world in the camera, metres."""
    fisheye: bool = False
    """Whether the coefficients are those of cv2.fisheye."""

    @property
    def camera(self) -> Camera:
        """The camera.

        Raises
        ------
        ValueError
            If the file has no pose or no image size, or its values give no camera.
        """
        if self.rvec is None or self.tvec is None or self.image_size is None:
            raise ValueError("a camera needs rvec, tvec, image_width and image_height: the file has intrinsics only")
        pose = self.rvec, self.tvec
        return Camera.from_opencv(*pose, self.camera_matrix, self.dist_coeffs, self.image_size, self.fisheye)


def opencv_files(frames: FrameCameras) -> dict[str, bytes]:
    """A file ``<id>.yml`` for every camera.

    Raises
    ------
    ValueError
        If no frame has a camera.
    """
    return {f"{id}.yml": format_opencv(camera).encode() for id, camera in with_cameras(frames).items()}


def format_opencv(camera: Camera) -> str:
    """The YAML of one camera.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> parse_opencv(format_opencv(camera)).camera.project([0.0, 0.0, 0.0]).round(1)
    array([480. , 269.9])
    """
    rvec, tvec, K, dist = camera.to_opencv()
    storage = cv2.FileStorage("camera.yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | YAML)
    for key, value in zip(("image_width", "image_height"), camera.image_size, strict=True):
        storage.write(key, value)
    if camera.fisheye:
        storage.write(FISHEYE_KEY, 1)
    matrices = {"camera_matrix": K, "distortion_coefficients": dist, "rvec": rvec, "tvec": tvec}
    for key, matrix in matrices.items():
        storage.write(key, matrix)
    return str(storage.releaseAndGetString())


def read_opencv(path: str | os.PathLike[str]) -> OpenCVCalibration:
    """Read a calibration file of OpenCV (`parse_opencv`).

    Raises
    ------
    BrokenFileError
        If it cannot be read or is no such file; the message begins with the path.

    Examples
    --------
    >>> import tempfile
    >>> text = "%YAML:1.0\\n---\\ncamera_matrix: !!opencv-matrix\\n   rows: 3\\n   cols: 3\\n   dt: d\\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "cam.yml"
    ...     _ = path.write_text(text + "   data: [ 1500., 0., 480., 0., 1500., 270., 0., 0., 1. ]\\n")
    ...     found = read_opencv(path)
    >>> found.camera_matrix[0], found.dist_coeffs, found.image_size
    (array([1500.,    0.,  480.]), array([0., 0., 0., 0., 0.]), None)
    """
    with named_in_errors(path):
        return parse_opencv(read_regular_file(Path(path)))


def parse_opencv(content: bytes | str) -> OpenCVCalibration:
    """Parse a calibration file of OpenCV: YAML, XML or JSON.

    Raises
    ------
    BrokenFileError
        If it is no such file, has no camera_matrix, or holds values that are no camera's.
    """
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (UnicodeDecodeError, SystemError, cv2.error) as error:
        raise BrokenFileError("is no YAML, XML or JSON of cv2.FileStorage") from error
    if not storage.isOpened() or not storage.root().isMap():
        raise BrokenFileError("is no YAML, XML or JSON of cv2.FileStorage")
    K, dist, rvec, tvec = (
        _matrix(storage, key) for key in ("camera_matrix", "distortion_coefficients", "rvec", "tvec")
    )
    if K is None:
        raise BrokenFileError(f'has no key "camera_matrix", only {", ".join(storage.root().keys()) or "none"}')
    if K.shape != (3, 3) or not np.all(np.isfinite(K)) or K[0, 0] <= 0.0 or K[1, 1] <= 0.0:
        raise BrokenFileError(f"camera_matrix must be a finite (3, 3) with focal lengths above 0, got {K.tolist()}")
    fisheye = _is_fisheye(storage)
    for key, vector in (("rvec", rvec), ("tvec", tvec)):
        if vector is not None and (vector.size != 3 or not np.all(np.isfinite(vector))):
            raise BrokenFileError(f"{key} must be 3 finite numbers, got {vector.tolist()}")
    try:
        vector_of = fisheye_vector if fisheye else opencv_vector
        coefficients = vector_of(dist, "distortion_coefficients")
        coefficients = coefficients if fisheye else shortest_opencv_vector(coefficients)
        width, height = (storage.getNode(key) for key in ("image_width", "image_height"))
        size = None if width.empty() or height.empty() else checked_image_size((width.real(), height.real()))
    except ValueError as error:
        raise BrokenFileError(str(error)) from error
    rvec, tvec = (None if vector is None else vector.ravel() for vector in (rvec, tvec))
    return OpenCVCalibration(K, coefficients, size, rvec, tvec, fisheye)


def _is_fisheye(storage: cv2.FileStorage) -> bool:
    """Whether a file says that its coefficients are those of cv2.fisheye."""
    flag, model = storage.getNode(FISHEYE_KEY), storage.getNode("distortion_model")
    return bool(not flag.empty() and flag.real()) or (model.isString() and model.string() in FISHEYE_MODELS)


def _matrix(storage: cv2.FileStorage, key: str) -> Array | None:
    """The matrix of a key; None if it is not there."""
    node = storage.getNode(key)
    if node.empty():
        return None
    try:
        matrix = node.mat()
    except (SystemError, cv2.error):
        matrix = None
    if matrix is None:
        raise BrokenFileError(f"{key} is no matrix (!!opencv-matrix)")
    return np.asarray(matrix, dtype=float)
