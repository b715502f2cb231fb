"""A recording of Rerun (``.rrd``): cameras, pictures' markings and the field on a timeline, for its viewer.

Rerun's pinhole has no lens: the markings in the picture are lines bent by the lens of the camera, point by point, while
the picture plane in space is that of a pinhole. The world is ours: x right, y towards the main camera, z down.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from fieldcalib._extras import imported
from fieldcalib._types import Array
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.exports.frames import FrameCameras, with_cameras

SPACING = 0.25  # m: of the points along curves
NEAR_PLANE = 0.1  # m in front of the camera
PLANE = 0.15  # distance of the picture plane in space, as a share of the camera's from the centre mark
TIMELINE = "frame"
CAMERA, IMAGE, MARKINGS, FIELD = "field/camera", "field/camera/image", "field/camera/image/markings", "field/markings"
COLOUR, PAINT = (255, 40, 220), (240, 240, 240)


def rerun_files(frames: FrameCameras, fields: Mapping[str, Field | None]) -> dict[str, bytes]:
    """``cameras.rrd``: each camera at its place on the timeline "frame", frames without one as gaps.

    Parameters
    ----------
    frames : mapping of str to Camera or None
        Their numbers on the timeline are their ids where all of these are numbers, and their order otherwise.
    fields : mapping of str to Field or None
        The fields of the frames that have a camera; that of the first one is drawn in space.

    Raises
    ------
    ImportError
        If rerun-sdk is not installed.
    ValueError
        If no frame has a camera, or none a field.
    """
    rr = imported("rerun", "rerun", "--format rerun")
    field = next((fields[id] for id in with_cameras(frames) if fields[id] is not None), None)
    if field is None:
        raise ValueError("no frame has a field: markings cannot be drawn")
    recording = rr.RecordingStream("fieldcalib")
    stream = recording.binary_stream()
    recording.log("field", rr.ViewCoordinates.RIGHT_HAND_Z_DOWN, static=True)
    lines = [field.terrain.raised(segment.polyline(SPACING)) for segment in field.markings.values() if segment.is_curve]
    recording.log(FIELD, rr.LineStrips3D(lines, colors=PAINT), static=True)
    are_numbers = all(id.isdecimal() for id in frames)
    for number, (id, camera) in enumerate(frames.items()):
        recording.set_time(TIMELINE, sequence=int(id) if are_numbers else number)
        if camera is None:
            recording.log(CAMERA, rr.Clear(recursive=True))
        else:
            _log(rr, recording, camera, fields[id] or field)
    return {"cameras.rrd": bytes(stream.read())}


def _log(rr: Any, recording: Any, camera: Camera, field: Field) -> None:
    """Log a camera, its picture plane, and the markings in its picture."""
    recording.log(CAMERA, rr.Transform3D(translation=camera.C, mat3x3=camera.R.T))
    pinhole = rr.Pinhole(
        image_from_camera=camera.K,
        resolution=camera.image_size,
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=PLANE * float(np.linalg.norm(camera.C)),
    )
    recording.log(IMAGE, pinhole)
    found = list(bent_lines(camera, field))
    lines, labels = [xy for _, xy in found], [label for label, _ in found]
    recording.log(MARKINGS, rr.LineStrips2D(lines, labels=labels, colors=COLOUR, show_labels=False))


def bent_lines(camera: Camera, field: Field) -> Iterator[tuple[str, Array]]:
    """The visible parts of the markings in a picture with their labels, pixels (N, 2), bent by the lens.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, C=(0, 60, -15), image_size=(960, 540))
    >>> [label for label, _ in bent_lines(camera, soccer())]
    ['Side line top', 'Middle line', 'Circle central']
    """
    half = np.array(camera.image_size) / 2.0
    for label, segment in field.markings.items():
        if not segment.is_curve or label in field.half_labels:
            continue
        X = field.terrain.raised(segment.polyline(SPACING))
        xy = camera.project(X)
        shown = (camera.depth(X) >= NEAR_PLANE) & np.all(np.abs(xy - half) <= 1.1 * half, axis=-1)  # false for NaN
        for run in np.split(np.arange(len(X)), np.flatnonzero(np.diff(shown)) + 1):
            if shown[run[0]] and len(run) > 1:
                yield label, xy[run]
