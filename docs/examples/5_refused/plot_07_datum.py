"""
Metres from where?
==================

With one end of a pitch of unknown length in view, places are known to centimetres from the goal line, and to a metre
from the centre mark.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import render_field

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
pixels = {label: truth.project(field[label].sample(9.0)).round() for label in labels}
calibration = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))
print(calibration.remedy)

# %%
# Ellipses of 95 %: relative to the markings in view (blue) and from the centre mark (orange).
plt.figure(figsize=(9.6, 5.4))
plt.imshow(render_field(truth, field)[..., ::-1])
for xy in ((330, 330), (520, 300), (700, 250)):
    for datum, colour in (("markings in view", "deepskyblue"), ("centre mark", "orange")):
        there = calibration.field_uncertainty(xy, relative_to=datum)
        turn = np.linspace(0.0, 2.0 * np.pi, 60)
        circle = np.stack([np.cos(turn), np.sin(turn)])
        offset = 2.45 * np.linalg.cholesky(there.covariance) @ circle
        X = calibration.image_to_field(xy)[:2, None] + offset
        ground = np.concatenate([X, np.zeros((1, 60))]).T
        plt.plot(*calibration.project(ground).T, color=colour)
plt.axis("off")
plt.tight_layout(pad=0)
