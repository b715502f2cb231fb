"""
The lens bends the model, not the pixels
========================================

Straight lines of a wide-angle picture are bent. The projected field is bent with them; a pinhole camera cannot
follow.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import draw_field, render_field

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.0, 1.25, 0.0, 600.0, (0.0, 52.0, -18.0), (960, 540), k=(-0.12, 0.01))
image = render_field(truth, field)
pixels = {}
for label, segment in field.markings.items():
    xy = truth.project(segment.sample(4.0))
    xy = xy[np.all((xy > 0) & (xy < (959, 539)), axis=1)]
    if len(xy) > 1:
        pixels[label] = xy

lens = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))
pinhole = fieldcalib.calibrate_from_segments(field, pixels, (960, 540), flags=fieldcalib.PINHOLE_FLAGS)
print(f"root mean square: {lens.rms:.2f} px with a lens, {pinhole.rms:.2f} px without")

# %%
# Orange: the best pinhole camera; magenta: with k1.
picture = draw_field(image, pinhole.camera, field, colour=(0, 140, 255))
picture = draw_field(picture, lens.camera, field)
plt.figure(figsize=(9.6, 5.4))
plt.imshow(picture[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
