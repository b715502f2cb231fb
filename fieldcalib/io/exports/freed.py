"""FreeD, the protocol of tracked cameras in virtual studios: a D1 packet of 29 bytes for every frame.

    0xD1, camera, pan, tilt, roll, x, y, z, zoom, focus (3 bytes each, big-endian), spare (2), checksum

Angles are signed, in 1/32768 degree; positions signed, in 1/64 mm; zoom and focus are unsigned numbers whose meaning is
the vendor's. The world is x right, y away from the main camera, z up; pan 0 looks along y and grows clockwise from
above, tilt grows upwards, roll clockwise as seen from behind the camera.
"""

from __future__ import annotations

import numpy as np

from fieldcalib.geometry.camera import Camera
from fieldcalib.io.exports.frames import TURN, FrameCameras, farthest_shift, with_cameras

D1 = 0xD1
CAMERA_NUMBER = 1
COUNTS_PER_DEGREE = 32768
COUNTS_PER_MM = 64
COUNTS_OF_ZOOM_PER_MM = 1000  # focal length in micrometres; FreeD leaves it to the vendor
LOOKING_LEVEL = 90.0  # degrees: our tilt at FreeD's tilt 0


def freed_files(frames: FrameCameras, sensor_width: float = 36.0) -> dict[str, bytes]:
    """``camera.freed``, one packet after the other, one for every frame: a frame without camera repeats the one before.

    Frames before the first camera repeat it.

    Parameters
    ----------
    frames : mapping of str to Camera or None
    sensor_width : float
        Width of the camera's sensor in mm, by which the focal length is given in micrometres.

    Raises
    ------
    ValueError
        If no frame has a camera, or one is farther than 131 m from the origin along an axis, or its focal length is
        16.7 m or more.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, np.radians(80), 0.0, 1500.0, C=(0, 60, -15), image_size=(960, 540))
    >>> freed_files({"000000": camera})["camera.freed"].hex(" ", 3)
    'd101 000000 fb0000 000000 000000 c56800 0ea600 00dbba 000000 0000fd'
    """
    packets = {id: freed_packet(camera, sensor_width) for id, camera in with_cameras(frames).items()}
    last = next(iter(packets.values()))
    stream = bytearray()
    for id in frames:
        last = packets.get(id, last)
        stream += last
    return {"camera.freed": bytes(stream)}


def freed_packet(camera: Camera, sensor_width: float = 36.0) -> bytes:
    """The D1 packet of a camera, which cannot hold lens and principal point."""
    pan, tilt, roll = np.degrees(camera.angles)
    angles = np.array([pan, tilt - LOOKING_LEVEL, roll]) * COUNTS_PER_DEGREE
    place = TURN @ camera.C * 1000.0 * COUNTS_PER_MM
    zoom = camera.focal_length / camera.image_size[0] * sensor_width * COUNTS_OF_ZOOM_PER_MM
    counts = np.rint([*angles, *place]).astype(int).tolist()
    if max(map(abs, counts)) >= 1 << 23:
        raise ValueError(f"FreeD holds positions of less than 131 m along each axis, this camera is at {camera.C} m")
    if not zoom < (1 << 24) - 1:
        raise ValueError(
            f"a focal length of {zoom / 1e6:.1f} m on a sensor of {sensor_width:g} mm does not fit into FreeD"
        )
    packet = bytes([D1, CAMERA_NUMBER]) + b"".join(count.to_bytes(3, "big", signed=True) for count in counts)
    packet += round(zoom).to_bytes(3, "big") + bytes(5)  # focus and spare: nothing is known of them
    return packet + bytes([(0x40 - sum(packet)) & 0xFF])


def freed_error(camera: Camera) -> float:
    """Largest displacement of a point of the image, pixels, without lens, principal point and aspect ratio."""
    width, height = camera.image_size
    f = camera.focal_length
    return farthest_shift(camera, np.array([[f, 0.0, (width - 1) / 2], [0.0, f, (height - 1) / 2], [0.0, 0.0, 1.0]]))
