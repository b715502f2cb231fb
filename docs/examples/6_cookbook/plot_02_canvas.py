"""
A picture on a canvas of the pitch
==================================

`results.homographies()` map pixels to metres; a canvas has so many pixels a metre, and its origin in a corner.
"""

import cv2
import matplotlib.pyplot as plt
import numpy as np

import fieldcalib

results = fieldcalib.calibrate(fieldcalib.sample("picture"), progress=False)
found, field = results.homographies()[0], results[0].field
print(f"the lens moves points by {found.rms_m:.2f} m on average, at most by {found.largest_m:.2f} m")

scale, margin = 8.0, 5.0  # pixels a metre, metres
width, height = (round(scale * (length + 2 * margin)) for length in (field.length, field.width))
to_canvas = np.array([[scale, 0, width / 2], [0, scale, height / 2], [0, 0, 1.0]])
canvas = cv2.warpPerspective(results.image(0), to_canvas @ found.from_raw, (width, height))

# %%
# The markings of the field, from metres by the same matrix.
for segment in field.markings.values():
    X = segment.sample(0.5)
    if not np.any(X[:, 2]):  # on the ground
        xy = (X[:, :2] * scale + (width / 2, height / 2)).round().astype(np.int32)
        cv2.polylines(canvas, [xy], False, (0, 220, 255), 1, cv2.LINE_AA)
plt.figure(figsize=(9.6, 6.4))
plt.imshow(canvas[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
