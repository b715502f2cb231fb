"""
Which end?
==========

The middle line and the centre circle look the same from the other side. The camera across the field fits as well, and
is in ``alternatives``; a label that names an end tells which.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import draw_minimap

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.05, 1.33, 0.0, 1400.0, (0.0, 66.0, -16.0), (960, 540))
pixels = {}
for label in ("Middle line", "Circle central"):
    xy = truth.project(field[label].sample(3.0))
    pixels[label] = xy[np.all((xy > 0) & (xy < (959, 539)), axis=1)].round()
calibration = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))
print(calibration.verdict, "-", calibration.reason)
print("position", calibration.camera.C.round(1), "; alternatives", [one.C.round(1) for one in calibration.alternatives])

# %%
# What both cameras see.
cameras = (calibration.camera, *calibration.alternatives)
figure, axes = plt.subplots(1, len(cameras), figsize=(6 * len(cameras), 4), squeeze=False)
for ax, camera in zip(axes[0], cameras, strict=True):
    ax.imshow(draw_minimap(camera, field, size=(560, 380))[..., ::-1])
    ax.axis("off")
figure.tight_layout(pad=0.5)
