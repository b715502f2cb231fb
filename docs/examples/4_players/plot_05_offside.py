"""
An offside line
===============

A line across the field through a player's foot, bent by the lens as the picture is.
"""

import matplotlib.pyplot as plt

import fieldcalib
from fieldcalib import Line
from fieldcalib.draw import draw_field, draw_players, render_field

field = fieldcalib.soccer()
camera = fieldcalib.Camera.from_angles(0.35, 1.36, 0.0, 1200.0, (0.0, 66.0, -16.0), (960, 540), k=(0.15, 0.0))
foot = (470.0, 300.0)  # px, of the last defender
x, y, _ = camera.image_to_field(foot)
line = {"offside": Line((x, -field.width / 2, 0.0), (x, field.width / 2, 0.0))}
print(f"{52.5 - x:.1f} m from the goal line")

# %%
# Of a calibration take `calibration.field.with_segments(line)`: its ground may be higher in the middle.
picture = draw_field(render_field(camera, field), camera, line, colour=(0, 220, 255), thickness=3)
picture = draw_players(picture, camera, [[x, y]])
plt.figure(figsize=(9.6, 5.4))
plt.imshow(picture[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
