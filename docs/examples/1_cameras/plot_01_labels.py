"""
A camera from labelled pixels
=============================

Pixels on five markings give focal length, position, rotation and lens.
"""

import matplotlib.pyplot as plt

import fieldcalib
from fieldcalib.draw import draw_calibration, render_field

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
pixels = {label: truth.project(field[label].sample(9.0)).round() for label in labels}

calibration = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))
print(calibration.camera)
print(calibration.verdict, "-", calibration.reason)

# %%
# The projected field on the (rendered) picture, with a map of what the camera sees.
picture = draw_calibration(render_field(truth, field), calibration, field)
plt.figure(figsize=(9.6, 5.4))
plt.imshow(picture[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
