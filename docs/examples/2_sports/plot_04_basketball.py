"""
A basketball court from labels
==============================

Lines, arcs and the rim: whatever is labelled counts, on the floor or above it.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import draw_calibration, draw_segments, render_field

field = fieldcalib.field("basketball-fiba")
truth = fieldcalib.Camera.from_angles(0.35, 1.25, 0.0, 900.0, (1.0, 19.0, -6.0), (960, 540))
labels = (
    "Side line top",
    "End line right",
    "Three-point arc right",
    "Lane right top",
    "Free-throw line right",
    "Rim right",
)
pixels = {}
for label in labels:
    xy = truth.project(field[label].sample(1.0))
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
