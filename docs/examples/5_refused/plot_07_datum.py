"""
Metres from where?
==================

Frames of one end of a pitch whose length nobody knows: places are known to centimetres relative to the markings in
view, and to a metre and more from the centre mark. The remedy, for metres from the centre mark, is to say the length.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import render_field

field = fieldcalib.soccer()
cameras = [
    fieldcalib.Camera.from_angles(pan, 1.36, 0.0, 2200.0, (0.0, 66.0, -16.0), (960, 540))
    for pan in np.linspace(0.48, 0.62, 9)
]
frames = []
for camera in cameras:
    seen = {label: camera.project(segment.sample(3.0)) for label, segment in field.markings.items()}
    inside = {label: xy[((xy > 0) & (xy < (959, 539))).all(axis=1)] for label, xy in seen.items()}
    frames.append({label: xy.round() for label, xy in inside.items() if len(xy) > 1})
sequence = fieldcalib.calibrate_sequence(field, frames, (960, 540))
calibration = sequence[4]
print(calibration.verdict, "-", calibration.remedy)

# %%
# Regions of 95 %: relative to the markings in view (blue) and from the centre mark (orange).
plt.figure(figsize=(9.6, 5.4))
plt.imshow(render_field(cameras[4], field)[..., ::-1])
turn = np.linspace(0.0, 2.0 * np.pi, 60)
circle = np.stack([np.cos(turn), np.sin(turn)])
for xy in ((250, 300), (480, 250), (700, 330)):
    for datum, colour in (("centre mark", "orange"), ("markings in view", "deepskyblue")):
        there = calibration.field_uncertainty(xy, relative_to=datum)
        print(f"{xy}, relative to {datum}: {there.rms:.2f} m")
        offset = 2.45 * np.linalg.cholesky(there.covariance) @ circle
        ground = np.concatenate([calibration.image_to_field(xy)[:2, None] + offset, np.zeros((1, 60))]).T
        plt.plot(*calibration.project(ground).T, color=colour)
plt.xlim(0, 960)
plt.ylim(540, 0)
plt.axis("off")
plt.tight_layout(pad=0)
