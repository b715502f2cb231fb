"""
The size of a pitch, from labels of several frames
==================================================

Pitches differ: this one has 100 x 64 m. Two or more frames of it tell its length and width together with their
cameras.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib

true_field = fieldcalib.soccer(100.0, 64.0)
frames = []
for pan in (-0.45, 0.0, 0.45):
    camera = fieldcalib.Camera.from_angles(pan, 1.33, 0.0, 1000.0, (0.0, 62.0, -16.0), (960, 540))
    seen = {label: camera.project(segment.sample(3.0)) for label, segment in true_field.markings.items()}
    inside = {label: xy[((xy > 0) & (xy < (959, 539))).all(axis=1)] for label, xy in seen.items()}
    frames.append({label: xy.round() for label, xy in inside.items() if len(xy) > 1})

size = fieldcalib.solve.estimate_field_size(fieldcalib.soccer(), frames, (960, 540))
print(f"{size.length:.1f} x {size.width:.1f} m")

# %%
# The nominal pitch, the true one, and the one that was found.
plt.figure(figsize=(7, 5))
for name, (length, width), style in (
    ("nominal", (105.0, 68.0), ":"),
    ("true", (100.0, 64.0), "-"),
    ("estimated", (size.length, size.width), "--"),
):
    x, y = np.array([-1, 1, 1, -1, -1]) * length / 2, np.array([-1, -1, 1, 1, -1]) * width / 2
    plt.plot(x, y, style, label=f"{name}, {length:.1f} x {width:.1f} m")
plt.axis("equal")
plt.gca().invert_yaxis()
plt.xlabel("x [m]")
plt.ylabel("y [m], towards the main camera")
plt.legend(loc="center")
plt.tight_layout()
