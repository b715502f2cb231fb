"""
Smooth tracks
=============

Tracks in metres, with the standard deviations that the cameras give, smoothed by a spline of SciPy.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import make_smoothing_spline

import fieldcalib

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
pixels = {label: truth.project(field[label].sample(9.0)).round() for label in labels}
calibration = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))

t = np.arange(75) / 25.0  # s
path = np.stack([20 + 6 * t - 1.2 * t**2, -12 + 9 * np.sin(0.8 * t), 0 * t], axis=-1)  # where the player runs
feet = truth.project(path) + np.random.default_rng(2).normal(scale=3.0, size=(75, 2))  # what a detector says
players = fieldcalib.locate_on_ground(calibration, feet, pixel_sd=3.0)
X, sd = players.X, players.standard_deviations
smooth = np.stack([make_smoothing_spline(t, X[:, i], w=1 / sd[:, i] ** 2)(t) for i in range(2)], axis=-1)
for name, xy in (("as located", X[:, :2]), ("smoothed", smooth)):
    print(f"{name}: {np.sqrt(np.mean(np.sum((xy - path[:, :2]) ** 2, axis=1))):.2f} m off (root mean square)")

# %%
plt.figure(figsize=(7, 5))
plt.plot(*path[:, :2].T, "k", label="truth")
plt.plot(*X[:, :2].T, ".", alpha=0.5, label="as located")
plt.plot(*smooth.T, label="smoothed")
plt.axis("equal")
plt.gca().invert_yaxis()
plt.xlabel("x [m]")
plt.ylabel("y [m]")
plt.legend()
plt.tight_layout()
