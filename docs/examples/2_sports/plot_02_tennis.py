"""
A tennis court by search
========================

No network and no labels: the camera is searched for whose court explains the stripes in the picture.
"""

import matplotlib.pyplot as plt

from fieldcalib import Camera
from fieldcalib.draw import draw_field, render_field
from fieldcalib.fields import tennis
from fieldcalib.images import find_courts

truth = Camera.from_angles(1.5, 1.3, 0.0, 1400.0, (-32.0, 1.0, -9.0), (960, 540))
image = render_field(truth, tennis())
best, *others = find_courts(image, tennis())
print(best.calibration.verdict, "-", best.calibration.reason)
print(best.calibration.camera)

# %%
# From the other side the court looks the same: that camera is the twin.
print("twin at", best.twin.C.round(1))
picture = draw_field(image, best.calibration.camera, tennis())
plt.figure(figsize=(9.6, 5.4))
plt.imshow(picture[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
