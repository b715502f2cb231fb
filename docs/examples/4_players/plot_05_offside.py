"""
An offside line
===============

A line across the field through a player's foot, bent by the lens as the picture is.
"""

import cv2
import matplotlib.pyplot as plt
import numpy as np

import fieldcalib

results = fieldcalib.calibrate(fieldcalib.sample("picture"), progress=False)
calibration, picture = results[0], results.image(0).copy()
field = calibration.field
foot = (398, 257)  # px, of the last defender
x, y, _ = calibration.image_to_field(foot)
print(f"{field.length / 2 - abs(x):.1f} m from the goal line")

# %%
# The ground may be higher in the middle of the pitch: the line is raised with it.
line = fieldcalib.Line((x, -field.width / 2, 0.0), (x, field.width / 2, 0.0))
xy = calibration.project(field.terrain.raised(line.sample(0.5)))
cv2.polylines(picture, [np.rint(16 * xy).astype(np.int32)], False, (0, 220, 255), 2, cv2.LINE_AA, shift=4)
cv2.circle(picture, foot, 5, (0, 220, 255), 2, cv2.LINE_AA)
plt.figure(figsize=(9.6, 5.4))
plt.imshow(picture[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
