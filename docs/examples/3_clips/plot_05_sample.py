"""
The clip of the demo: cameras, players, map
===========================================

`fieldcalib.sample` has a rendered clip of a match with players, boards and a cut. Its cameras are found from its
pictures, and boxes of its players become places on the pitch.
"""

import csv

import cv2
import matplotlib.pyplot as plt

import fieldcalib
from fieldcalib.draw import draw_minimap
from fieldcalib.io.boxes import foot_points

path = fieldcalib.sample("clip")
results = fieldcalib.calibrate(path, progress=False)
print(len(results), "frames,", sum(verdict == "good" for verdict in results.verdicts.values()), "good")

# %%
# One frame with the projected field, and its players on a map.
frame = list(results)[30]
with (path.parent / "players.csv").open() as table:
    rows = [row for row in csv.DictReader(table) if int(row["frame"]) == int(frame)]
boxes = [[float(row[name]) for name in ("x1", "y1", "x2", "y2")] for row in rows]
players = fieldcalib.locate_on_ground(results[frame], foot_points(boxes))
board = draw_minimap(results[frame].camera, results[frame].field, size=(800, 540), points=players.X)
figure, axes = plt.subplots(1, 2, figsize=(12, 4), width_ratios=(960, 800))
for ax, image in zip(axes, (results.overlay(frame), board), strict=True):
    ax.imshow(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
    ax.axis("off")
figure.tight_layout(pad=0)
