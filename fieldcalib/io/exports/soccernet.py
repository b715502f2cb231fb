"""Files of the SoccerNet family: its cameras, those of TVCalib, and those of a game state (sn-gamestate, tracklab)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from fieldcalib.geometry.camera import Camera
from fieldcalib.io.exports.frames import FrameCameras, with_cameras
from fieldcalib.io.formats import CAMERAS
from fieldcalib.io.soccernet import camera_to_record, format_camera
from fieldcalib.io.tvcalib import TVCalibRecord, format_per_sample_output

GAMESTATE_SIZE = (1920, 1080)  # of its images; its tools take no size from the file
CAMERA_CATEGORY = 6


def soccernet_files(frames: FrameCameras) -> dict[str, bytes]:
    """``camera_<id>.json`` for every camera, for images of the camera's own size.

    Raises
    ------
    ValueError
        If no frame has a camera.
    """
    return {CAMERAS.file_name(id): format_camera(camera).encode() for id, camera in with_cameras(frames).items()}


def tvcalib_files(frames: FrameCameras, about: Mapping[str, Mapping[str, Any]] | None = None) -> dict[str, bytes]:
    """``per_sample_output.json``, a line for every frame; one without camera has neither camera nor homography.

    The homography is that of the pinhole, as in TVCalib's own files.

    Parameters
    ----------
    frames : mapping of str to Camera or None
    about : mapping of str to mapping, optional
        The line of every frame's result, by id: TVCalib's evaluation compares its ``loss_ndc`` with tau.

    Raises
    ------
    ValueError
        If no frame has a camera.
    """
    with_cameras(frames)
    lines = about or {}
    records = [
        TVCalibRecord(id)
        if camera is None
        else TVCalibRecord(id, camera, camera.pinhole_homography, _loss(lines.get(id, {})))
        for id, camera in frames.items()
    ]
    return {"per_sample_output.json": format_per_sample_output(records).encode()}


def _loss(line: Mapping[str, Any]) -> float | None:
    """The loss in the line of a frame; None where it is not finite, which the line has as a text."""
    loss = line.get("loss_ndc")
    return loss if isinstance(loss, float) else None


def gamestate_files(frames: FrameCameras, sequence: str = "") -> dict[str, bytes]:
    """Predictions of a game state, ``SNGS-<video>.json``, as tracklab writes them.

    Cameras are scaled to images of 1920 x 1080. Frames without camera have no parameters. Without a sequence the file
    is called ``gamestate.json``.

    Parameters
    ----------
    frames : mapping of str to Camera or None
        Ids are those of the files in ``img1``, or whole ids of images where no sequence is given.
    sequence : str
        Prefix of image ids: the digit of the split and the number of the video, such as 3116.

    Raises
    ------
    ValueError
        If no frame has a camera, an image is not 16:9, or the sequence is no number.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, C=(0, 60, -15), image_size=(960, 540))
    >>> content = gamestate_files({"000001": camera}, "3116")["SNGS-116.json"]
    >>> (prediction,) = json.loads(content)["predictions"]
    >>> prediction["image_id"], prediction["video_id"], prediction["parameters"]["x_focal_length"]
    ('3116000001', '116', 3000.0)
    """
    if sequence and not sequence.isdecimal():
        raise ValueError(f"expected the digit of the split and the number of the video, as 3116, got {sequence!r}")
    for id, camera in with_cameras(frames).items():
        width, height = camera.image_size
        if width * GAMESTATE_SIZE[1] != height * GAMESTATE_SIZE[0]:
            raise ValueError(
                f"frame {id}: a game state has images of 1920x1080, this one is {width}x{height}: not 16:9"
            )
    predictions = [_prediction(sequence + id, sequence[1:], camera) for id, camera in frames.items()]
    name = f"SNGS-{sequence[1:]}.json" if sequence else "gamestate.json"
    return {name: (json.dumps({"predictions": predictions}, indent=2) + "\n").encode()}


def _prediction(image_id: str, video_id: str, camera: Camera | None) -> dict[str, Any]:
    parameters = {} if camera is None else {"parameters": camera_to_record(camera.scaled(GAMESTATE_SIZE))}
    return {
        "id": f"{image_id}01",
        "image_id": image_id,
        "video_id": video_id,
        "supercategory": "camera",
        "category_id": CAMERA_CATEGORY,
        **parameters,
    }
