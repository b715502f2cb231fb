"""
FreeD to a render engine
========================

Engines for virtual graphics take the cameras of frames as FreeD packets (D1) by UDP: 29 bytes each.
``fieldcalib run STREAM --send freed://HOST:PORT`` sends them as they come; here they come from a `Tracker`.
"""

import socket

import fieldcalib
from fieldcalib.draw import render_field
from fieldcalib.io.exports.freed import freed_packet

field = fieldcalib.soccer()
pans = (0.2, 0.22, 0.24)
truths = [fieldcalib.Camera.from_angles(pan, 1.35, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540)) for pan in pans]

engine, sender = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
engine.bind(("127.0.0.1", 0))  # stands in for the engine, which says its own address
with fieldcalib.Tracker(field, wait=True) as tracker, engine, sender:
    for truth in truths:
        calibration = tracker.update(render_field(truth, field))
        if calibration.verdict != "reject":
            sender.sendto(freed_packet(calibration.camera, sensor_width=36.0), engine.getsockname())
            packet = engine.recv(64)
            pan, tilt, roll = (int.from_bytes(packet[k : k + 3], "big", signed=True) / 32768 for k in (2, 5, 8))
            print(f"{len(packet)} bytes: pan {pan:.2f}, tilt {tilt:.2f}, roll {roll:.2f} degrees")
