"""
How well is each place known?
=============================

The standard deviation of places on the ground, from the covariance of the camera. It grows away from what was
labelled.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import render_field

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.25, 1.35, 0.0, 1100.0, (0.0, 66.0, -16.0), (960, 540))
labels = (
    "Side line top",
    "Middle line",
    "Circle central",
    "Big rect. right main",
    "Big rect. right top",
    "Circle right",
)
rng = np.random.default_rng(3)
pixels = {}
for label in labels:
    xy = truth.project(field[label].sample(5.0))
    xy = xy[np.all((xy > 0) & (xy < (959, 539)), axis=1)]
    pixels[label] = xy + rng.normal(scale=1.5, size=xy.shape)
calibration = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))
print(calibration.verdict, "; right to a metre with a probability of", round(calibration.probability(1.0), 2))

# %%
x, y = np.meshgrid(np.arange(0, 960, 24.0), np.arange(170, 540, 24.0))
sigma = np.array([calibration.field_uncertainty(xy).rms for xy in np.stack([x.ravel(), y.ravel()], axis=-1)])
plt.figure(figsize=(9.6, 5.4))
plt.imshow(render_field(truth, field)[..., ::-1])
levels = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.2)
lines = plt.contour(x, y, sigma.reshape(x.shape), levels=levels, cmap="plasma")
plt.clabel(lines, fmt="%.2f m")
plt.axis("off")
plt.tight_layout(pad=0)
