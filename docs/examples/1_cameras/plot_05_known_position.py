"""
What a known position is worth
==============================

The same few labels, with the position of the camera free and known: zoom and distance are hard to tell apart from
pixels alone.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib import CalibrationFlags

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.3, 1.36, 0.0, 1800.0, (0.0, 66.0, -16.0), (960, 540))
labels = ("Side line top", "Big rect. right main", "Big rect. right top", "Circle right")
rng = np.random.default_rng(0)
frames = []
for _ in range(40):
    frame = {}
    for label in labels:
        xy = truth.project(field[label].sample(4.0))
        xy = xy[np.all((xy > 0) & (xy < (959, 539)), axis=1)]
        if len(xy) > 1:
            frame[label] = xy + rng.normal(scale=1.0, size=xy.shape)
    frames.append(frame)

free = fieldcalib.calibrate_batch(field, frames, (960, 540))
flags = fieldcalib.DEFAULT_FLAGS | CalibrationFlags.CALIB_FIX_POSITION
known = [
    fieldcalib.calibrate_from_segments(field, frame, (960, 540), rvec=(0, 0, 0), tvec=-truth.C, flags=flags)
    for frame in frames
]

# %%
# Focal lengths of 40 labellings with 1 px of noise.
plt.figure(figsize=(8, 4))
for name, calibrations in (("position free", free), ("position known", known)):
    plt.hist([one.camera.focal_length for one in calibrations if one.camera], bins=20, alpha=0.6, label=name)
plt.axvline(1800.0, color="k", label="truth")
plt.xlabel("focal length [px]")
plt.ylabel("labellings")
plt.legend()
plt.tight_layout()
