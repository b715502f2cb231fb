"""
From a detector to metres
=========================

Boxes of a detector become places with their errors, here beside the true places of the rendered clip.
"""

import csv

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib import plot

path = fieldcalib.sample("clip")
results = fieldcalib.calibrate(path, end="12f", progress=False)
with (path.parent / "players.csv").open() as table:
    rows = [row for row in csv.DictReader(table) if f"{int(row['frame']):06d}" in results]
boxes, true = (
    np.array([[float(row[name]) for name in names] for row in rows])
    for names in (("x1", "y1", "x2", "y2"), ("true_x", "true_y"))
)
number = np.array([int(row["frame"]) for row in rows])

# %%
# `pixel_sd` is how far off the middle of the lower edge is: here 2 px, as of many detectors.
is_last = number == number.max()
places = results.to_field(boxes[is_last], int(number.max()), pixel_sd=2.0)
off = np.abs(places.X[:, :2] - true[is_last])
print(f"{off.mean():.2f} m off; {100 * np.mean(off < 2 * places.standard_deviations):.0f} % within two deviations")

pitch = plot.soccer_pitch(results[0].field, pitch_color="grass", line_color="white")
figure, ax = pitch.draw(figsize=(9, 6))
plot.draw_visible_area(pitch, ax, results[int(number.max())].camera, color="white", alpha=0.2)
plot.draw_errors(pitch, ax, places.X, places.covariance)
plot.draw_players(pitch, ax, places.X, color="red", s=30)
plt.show()
