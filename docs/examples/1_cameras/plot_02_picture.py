"""
A camera from a picture
=======================

The network of the package finds the markings; the camera is then refined on the lines of the picture.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import draw_calibration, render_field

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(-0.3, 1.35, 0.01, 1500.0, (2.0, 66.0, -16.0), (960, 540), k=(0.08, 0.0))
image = render_field(truth, field, rng=np.random.default_rng(1))  # or cv2.imread("frame.jpg")

results = fieldcalib.calibrate(image, progress=False)
(calibration,) = results.values()
print(calibration.verdict, "-", calibration.reason)
print("focal length", round(calibration.camera.focal_length), "px; true:", round(truth.focal_length))
print("position", calibration.camera.C.round(1), "m; true:", truth.C)

# %%
# Magenta lines are the field as projected by the camera that was found.
picture = draw_calibration(image, calibration, calibration.field)
plt.figure(figsize=(9.6, 5.4))
plt.imshow(picture[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
