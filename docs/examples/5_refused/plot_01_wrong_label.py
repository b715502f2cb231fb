"""
A wrong label
=============

A line of the penalty area was labelled as that of the goal area. It is found, named, and the frame is calibrated
under the label that fits.
"""

import matplotlib.pyplot as plt

import fieldcalib
from fieldcalib.draw import draw_calibration, draw_segments, render_field

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
labels = (
    "Side line top",
    "Side line right",
    "Big rect. right main",
    "Big rect. right bottom",
    "Circle right",
    "Middle line",
)
pixels = {label: truth.project(field[label].sample(9.0)).round() for label in labels}
pixels["Small rect. right top"] = truth.project(field["Big rect. right top"].sample(9.0)).round()  # the mistake

calibration = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))
print(calibration.verdict, "-", calibration.reason)
print(calibration.suspect_labels)

# %%
picture = draw_segments(draw_calibration(render_field(truth, field), calibration, field), pixels, names=False)
plt.figure(figsize=(9.6, 5.4))
plt.imshow(picture[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
