"""
A rink
======

Circles tell as much as lines: a face-off circle, its goal line and a blue line are enough.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import draw_calibration, draw_segments, render_field

field = fieldcalib.field("ice-hockey-nhl")
truth = fieldcalib.Camera.from_angles(0.5, 1.25, 0.0, 900.0, (0.0, 34.0, -13.0), (960, 540))
labels = (
    "Goal line right",
    "Blue line right",
    "Face-off circle right top",
    "Face-off circle right bottom",
    "Side board top",
)
pixels = {}
for label in labels:
    xy = truth.project(field[label].sample(1.5))
    xy = xy[np.all((xy > 0) & (xy < (959, 539)), axis=1)]
    if len(xy) > 1:
        pixels[label] = xy.round()
calibration = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))
print(calibration.verdict, "-", calibration.reason)

# %%
picture = draw_segments(draw_calibration(render_field(truth, field), calibration, field), pixels, names=False)
plt.figure(figsize=(9.6, 5.4))
plt.imshow(picture[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
