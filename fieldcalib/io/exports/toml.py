"""Cameras in TOML, as Pose2Sim, anipose and caliscope read those of a rig."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from fieldcalib.io.exports.frames import TURN, FrameCameras, with_cameras

METADATA = {"adjusted": False, "error": 0.0}


def toml_files(frames: FrameCameras) -> dict[str, bytes]:
    """``calibration.toml`` for Pose2Sim and anipose, ``camera_array.toml`` for caliscope; in a world with z up.

    Raises
    ------
    ValueError
        If no frame has a camera.

    Examples
    --------
    >>> from fieldcalib import Camera
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0, 56, -15), (960, 540))
    >>> print(toml_files({"left": camera})["calibration.toml"].decode().splitlines()[2])
    size = [960, 540]
    """
    sections: dict[str, dict[str, Any]] = {}
    numbered: dict[str, dict[str, Any]] = {}
    cameras = with_cameras(frames)
    digits = len(str(len(cameras)))
    for number, (id, camera) in enumerate(cameras.items()):
        rvec, tvec, K, dist = camera.moved(camera.R @ TURN, TURN @ camera.C).to_opencv()
        values = {
            "size": list(camera.image_size),
            "matrix": K.tolist(),
            "distortions": dist.ravel().tolist(),
            "rotation": rvec.ravel().tolist(),
            "translation": tvec.ravel().tolist(),
            "fisheye": camera.fisheye,
        }
        sections[f"cam_{number:0{digits}d}"] = {"name": id, **values}  # anipose sorts them as texts
        numbered[f"cameras.{number}"] = {"cam_id": number, **values}
    return {"calibration.toml": _toml({**sections, "metadata": METADATA}), "camera_array.toml": _toml(numbered)}


def _toml(sections: Mapping[str, Mapping[str, Any]]) -> bytes:
    """TOML of sections; its values are written as those of JSON."""
    lines = [[f"[{name}]", *(f"{key} = {json.dumps(one)}" for key, one in of.items())] for name, of in sections.items()]
    return "\n\n".join("\n".join(section) for section in lines).encode() + b"\n"
