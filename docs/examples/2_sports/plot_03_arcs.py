"""
A court and a rink from labels
==============================

Arcs tell as much as lines, and what is above the floor counts too: a three-point arc and the rim of a basket; two
face-off circles with a goal line and a blue line.
"""

import matplotlib.pyplot as plt
import numpy as np

import fieldcalib
from fieldcalib.draw import draw_calibration, draw_segments, render_field


def show(name, truth, labels, spacing):
    """Calibrate a rendered view from pixels on some markings, and draw what was found."""
    field, pixels = fieldcalib.field(name), {}
    for label in labels:
        xy = truth.project(field[label].sample(spacing))
        xy = xy[np.all((xy > 0) & (xy < (959, 539)), axis=1)]
        if len(xy) > 1:
            pixels[label] = xy.round()
    calibration = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))
    print(calibration.verdict, "-", calibration.reason)
    picture = draw_segments(draw_calibration(render_field(truth, field), calibration, field), pixels, names=False)
    plt.figure(figsize=(9.6, 5.4))
    plt.imshow(picture[..., ::-1])
    plt.axis("off")
    plt.tight_layout(pad=0)


# %%
# Basketball
truth = fieldcalib.Camera.from_angles(0.35, 1.25, 0.0, 900.0, (1.0, 19.0, -6.0), (960, 540))
labels = ["Side line top", "End line right", "Three-point arc right", "Lane right top"]
show("basketball-fiba", truth, [*labels, "Free-throw line right", "Rim right"], spacing=1.0)

# %%
# Ice hockey
truth = fieldcalib.Camera.from_angles(0.5, 1.25, 0.0, 900.0, (0.0, 34.0, -13.0), (960, 540))
labels = ["Goal line right", "Blue line right", "Face-off circle right top", "Face-off circle right bottom"]
show("ice-hockey-nhl", truth, [*labels, "Side board top"], spacing=1.5)
