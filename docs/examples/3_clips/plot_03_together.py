"""
One tripod, many frames: together or one by one
===============================================

Forty labelled frames of one camera. Each by itself puts the camera metres away; together they tell one place.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib

field = fieldcalib.soccer()
rng = np.random.default_rng(5)
frames = []
for pan in np.linspace(-0.5, 0.5, 40):
    camera = fieldcalib.Camera.from_angles(pan, 1.35, 0.0, 1600.0, (0.0, 66.0, -16.0), (960, 540))
    seen = {label: camera.project(segment.sample(4.0)) for label, segment in field.markings.items()}
    inside = {label: xy[((xy > 0) & (xy < (959, 539))).all(axis=1)] for label, xy in seen.items()}
    frames.append({label: xy + rng.normal(scale=1.5, size=xy.shape) for label, xy in inside.items() if len(xy) > 1})

single = fieldcalib.calibrate_batch(field, frames, (960, 540))
together = fieldcalib.calibrate_sequence(field, frames, (960, 540))
C = np.array([one.camera.C for one in single if one])

# %%
(y, y_sd), (z, z_sd) = (together.shared[name] for name in ("y", "z"))
plt.figure(figsize=(7, 5))
plt.plot(C[:, 1], C[:, 2], ".", label="one by one")
plt.errorbar([y], [z], yerr=[2 * z_sd], xerr=[2 * y_sd], fmt="o", label="together, 95 %")
plt.plot(66.0, -16.0, "k+", markersize=14, label="truth")
plt.xlabel("y [m]")
plt.ylabel("z [m], down")
plt.gca().invert_yaxis()
plt.legend()
plt.tight_layout()
