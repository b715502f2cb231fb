"""
What a homography leaves of the lens
====================================

A homography is exact only without distortion. `fieldcalib.fields.field_homography` gives the nearest one, and says by
how much it misses.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib

field = fieldcalib.soccer()
camera = fieldcalib.Camera.from_angles(0.25, 1.35, 0.0, 1100.0, (0.0, 66.0, -16.0), (960, 540), k=(0.25, 0.0))
homography = fieldcalib.fields.field_homography(camera, field)
print(f"nearest homography: {homography.largest_px:.1f} px, {homography.largest_m:.2f} m off at most")

# %%
# Where it misses, in metres on the ground: the camera itself (``image_to_field``) misses by nothing.
x, y = np.meshgrid(np.arange(0, 960, 8.0), np.arange(0, 540, 8.0))
xy = np.stack([x, y], axis=-1)
exact = camera.image_to_field(xy)[..., :2]
u = np.concatenate([xy, np.ones_like(x)[..., None]], axis=-1) @ homography.from_raw.T
near = u[..., :2] / u[..., 2:]
error = np.linalg.norm(near - exact, axis=-1)
error[~((np.abs(exact[..., 0]) < 52.5) & (np.abs(exact[..., 1]) < 34.0))] = np.nan
plt.figure(figsize=(9.6, 5.4))
plt.pcolormesh(x, y, error, cmap="viridis")
plt.colorbar(label="m")
plt.gca().invert_yaxis()
plt.title("from_raw against the camera, in view of the field")
plt.xlabel("x [px]")
plt.ylabel("y [px]")
plt.tight_layout()
