"""
Top view
========

The ground from above, with the lens taken out; several frames together show more of it.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import draw_field, mosaic, overhead_camera, render_field, top_view

field = fieldcalib.soccer()
cameras = [
    fieldcalib.Camera.from_angles(pan, 1.33, 0.0, 900.0, (0.0, 66.0, -18.0), (960, 540), k=(0.1, 0.0))
    for pan in (-0.6, -0.3, 0.0, 0.3, 0.6)
]
images = [render_field(camera, field, rng=np.random.default_rng(0)) for camera in cameras]
overhead = overhead_camera(field, 0.2)
one, _ = top_view(images[3], cameras[3], overhead, field)
all_, _ = mosaic(zip(images, cameras, strict=True), overhead, field)

# %%
figure, axes = plt.subplots(1, 2, figsize=(12, 4.2))
for ax, picture, title in zip(axes, (one, all_), ("one frame", "five frames"), strict=True):
    ax.imshow(draw_field(picture, overhead, field, thickness=1)[..., ::-1])
    ax.set_title(title)
    ax.axis("off")
figure.tight_layout(pad=0.5)
