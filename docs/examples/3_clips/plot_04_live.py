"""
Live
====

`fieldcalib.Tracker` gives each image its camera as it comes, from what came before.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import render_field

field = fieldcalib.soccer()
cameras = [
    fieldcalib.Camera.from_angles(pan, 1.35, 0.0, 1200.0 + 900.0 * pan, (0.0, 66.0, -16.0), (960, 540))
    for pan in np.linspace(-0.25, 0.3, 16)
]
clip = [render_field(camera, field, rng=np.random.default_rng(0)) for camera in cameras]  # or "clip.mp4"

with fieldcalib.Tracker(field, wait=True) as tracker:
    live = [tracker.update(image) for image in clip]
print([str(calibration.status) for calibration in live[:3]], "...")

# %%
# Pan and focal length against the truth.
figure, axes = plt.subplots(2, 1, sharex=True, figsize=(8, 5))
axes[0].plot([np.degrees(camera.angles[0]) for camera in cameras], "k", label="truth")
axes[0].plot([np.degrees(one.camera.angles[0]) for one in live], "o", label="Tracker")
axes[0].set_ylabel("pan [deg]")
axes[0].legend()
axes[1].plot([camera.focal_length for camera in cameras], "k")
axes[1].plot([one.camera.focal_length for one in live], "o")
axes[1].set_ylabel("focal length [px]")
axes[1].set_xlabel("frame")
figure.tight_layout()
