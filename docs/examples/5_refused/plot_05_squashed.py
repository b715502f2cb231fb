"""
A squashed picture
==================

A broadcast picture that somebody made square. Its pixels are not square any more: `fieldcalib.calibrate` sees it in
the lines, and the camera has two focal lengths.
"""

import cv2
import matplotlib.pyplot as plt

import fieldcalib
from fieldcalib.draw import draw_calibration, render_field

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.25, 1.33, 0.0, 1000.0, (0.0, 66.0, -16.0), (960, 540))
image = cv2.resize(render_field(truth, field), (640, 640), interpolation=cv2.INTER_AREA)
(calibration,) = fieldcalib.calibrate(image, progress=False).values()
print(calibration.verdict, "-", calibration.reason)
K = calibration.camera.K
print(f"fx / fy = {K[0, 0] / K[1, 1]:.3f}; 9 / 16 = {9 / 16:.3f}")

# %%
# Where it is not certain, say so: ``fieldcalib run --display-size 1920x1080``.
picture = draw_calibration(image, calibration, field)
plt.figure(figsize=(6.4, 6.4))
plt.imshow(picture[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
