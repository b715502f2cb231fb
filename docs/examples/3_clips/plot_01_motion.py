"""
Cameras of a clip over time
===========================

Frames of a tripod are calibrated together: smooth pan, tilt and zoom, one place, with bands of 95 %.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import plot_sequence, render_field

field = fieldcalib.soccer()
cameras = [
    fieldcalib.Camera.from_angles(pan, 1.35, 0.0, 1200.0 + 900.0 * pan, (0.0, 66.0, -16.0), (960, 540))
    for pan in np.linspace(-0.25, 0.3, 24)
]
clip = [render_field(camera, field, rng=np.random.default_rng(0)) for camera in cameras]  # or "clip.mp4"

video = fieldcalib.calibrate_video(field, clip)
print(len(video), "frames,", sum(calibration.verdict == "good" for calibration in video), "good")
for name, (value, sigma) in list(video.tripods[0].shared.items())[:3]:
    print(f"{name} = {value:.2f} ± {sigma:.2f} m")

# %%
# What `fieldcalib run` writes as ``motion.png``.
picture = plot_sequence(video, frames_per_second=25.0)
plt.figure(figsize=(9.6, 7.5))
plt.imshow(picture[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
