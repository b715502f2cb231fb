"""
Players on a map
================

The lower edges of boxes of a detector, on the ground, with the ground in view.
"""

import matplotlib.pyplot as plt

import fieldcalib
from fieldcalib.draw import draw_minimap, draw_players, render_field
from fieldcalib.io.boxes import foot_points

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
pixels = {label: truth.project(field[label].sample(9.0)).round() for label in labels}
calibration = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))

boxes = [(400, 200, 420, 260), (610, 240, 632, 305), (250, 300, 275, 370), (700, 180, 716, 228)]  # x1, y1, x2, y2
players = fieldcalib.locate_on_ground(calibration, foot_points(boxes), pixel_sd=2.0)
colours = [(60, 60, 230), (230, 120, 40), (60, 60, 230), (230, 120, 40)]  # blue, green, red

# %%
# On the picture, and on the map.
picture = draw_players(render_field(truth, field), calibration.camera, players.X, colours=colours)
board = draw_minimap(calibration.camera, field, size=(800, 540), points=players.X, colours=colours)
figure, axes = plt.subplots(1, 2, figsize=(12, 4), width_ratios=(960, 800))
for ax, image in zip(axes, (picture, board), strict=True):
    ax.imshow(image[..., ::-1])
    ax.axis("off")
figure.tight_layout(pad=0)
