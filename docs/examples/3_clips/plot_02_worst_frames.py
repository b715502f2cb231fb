"""
The frames to look at first
===========================

Of any sequence of calibrations, the worst frames with what is said of them: what `fieldcalib run` writes as
``worst_frames.jpg``.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import contact_sheet, draw_calibration, render_field, worst_frames

field = fieldcalib.soccer()
cameras = [
    fieldcalib.Camera.from_angles(pan, 1.35, 0.0, 1200.0 + 900.0 * pan, (0.0, 66.0, -16.0), (960, 540))
    for pan in np.linspace(-0.25, 0.3, 12)
]
clip = [render_field(camera, field, rng=np.random.default_rng(0)) for camera in cameras]  # or "clip.mp4"
clip[6] = np.full_like(clip[6], 90)  # a flash
video = fieldcalib.calibrate_video(field, clip)

# %%
# The flash shows no field: its camera is that of its neighbours, and says so.
print("frame 6 rests on:", video.basis[6])
worst = worst_frames(video, 6)
captions = [f"{frame}: {video[frame].verdict}. {video[frame].reason}" for frame in worst]
sheet = contact_sheet([draw_calibration(clip[frame], video[frame], field) for frame in worst], captions)
plt.figure(figsize=(12, 5.4))
plt.imshow(sheet[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
