"""
A camera from known points
==========================

Points of any object and their pixels, as for ``cv2.calibrateCamera`` with one view: here corners of the penalty area
and the goal.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import draw_field, render_field

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.45, 1.36, 0.0, 1500.0, (0.0, 66.0, -16.0), (960, 540))
X = np.array(
    [
        (52.5, -20.16, 0.0),
        (36.0, -20.16, 0.0),
        (36.0, 20.16, 0.0),
        (47.0, -9.16, 0.0),
        (47.0, 9.16, 0.0),
        (52.5, -3.66, -2.44),
        (52.5, 3.66, -2.44),
        (41.5, 0.0, 0.0),
    ]
)
xy = truth.project(X).round()  # as a person would click them
calibration = fieldcalib.calibrate_from_points(X, xy, (960, 540))
print(calibration.status, "-", calibration.message)
print(calibration.camera)

# %%
# The whole field by that camera, over the rendered picture, and the points.
picture = draw_field(render_field(truth, field), calibration.camera, field)
plt.figure(figsize=(9.6, 5.4))
plt.imshow(picture[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
plt.plot(*xy.T, "o", color="yellow", markersize=5)
