"""
A pitch that is not flat
========================

A pitch that is 0.4 m higher in the middle than at its touchlines, taken for a level one and for what it is, and its
ground drawn ten times as high.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.assess import What
from fieldcalib.fields import Ground

rng = np.random.default_rng(3)
level, pitch = fieldcalib.soccer(), fieldcalib.soccer().with_ground(Ground(crown=0.4))
camera = fieldcalib.Camera.from_angles(-0.3, 1.30, 0.0, 900.0, (-2.0, 62.0, -15.0), (960, 540))


def on_ground(field, label):
    """Points of a marking on the ground of its field, (N, 3) metres."""
    return field.terrain.raised(field[label].sample(4.0))


# %%
# Labels, half a pixel off
labels = {}
for label in pitch.markings:
    xy = camera.project(on_ground(pitch, label))
    inside = xy[np.all((xy > 0.0) & (xy < (959.0, 539.0)), axis=1)]
    if len(inside) > 1:
        labels[label] = inside + rng.normal(0.0, 0.5, inside.shape)

# %%
# On level ground the lines do not fit, and the verdict says why
flat = fieldcalib.calibrate_from_segments(level, labels, (960, 540))
print(flat.verdict, flat.reason, flat.remedy, sep="\n")

# %%
# With the height that it names
(height,) = next(found.numbers for found in flat.findings if found.what is What.NOT_LEVEL)
found = fieldcalib.calibrate_from_segments(level.with_ground(Ground(crown=height)), labels, (960, 540))
print(found.verdict, found.reason, sep="\n")
print("the camera stands", np.round(found.camera.C, 1), "; taken for level", np.round(flat.camera.C, 1))

# %%
# The same pitch seen from far behind its near touchline: level in grey, and its ground ten times as high
view = fieldcalib.Camera.from_angles(0.0, 1.48, 0.0, 1700.0, (0.0, 190.0, -18.0), (960, 300))
plt.figure(figsize=(10, 3))
for label in found.field.markings:
    X = on_ground(found.field, label)
    if np.min(X[:, 2]) > -1.0:  # not the goals, which stand on it
        plt.plot(*view.project(X * (1.0, 1.0, 0.0)).T, color="lightgrey")
        plt.plot(*view.project(X * (1.0, 1.0, 10.0)).T, color="green")
plt.gca().invert_yaxis()
plt.axis("off")
plt.tight_layout()
