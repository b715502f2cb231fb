"""
Graphics that players hide
==========================

A carpet on the grass and a board behind the far touchline: pixels of another colour than the grass are in front of the
carpet.
"""

import cv2
import matplotlib.pyplot as plt
import numpy as np

import fieldcalib

results = fieldcalib.calibrate(fieldcalib.sample("picture"), progress=False)
calibration, picture = results[0], results.image(0).copy()
print(calibration.verdict)


def text(words, size, colour):
    """A picture of some words."""
    made = np.full((size[1], size[0], 3), colour, np.uint8)
    cv2.putText(made, words, (30, size[1] - 45), cv2.FONT_HERSHEY_DUPLEX, size[1] / 60, (255, 255, 255), 6, cv2.LINE_AA)
    return made


def drawn(graphic, X):
    """The picture of a rectangle by its corners (4, 3) in metres, from the upper left one on, and where it is."""
    X = calibration.field.terrain.raised(np.array(X, float))  # the ground may be higher in the middle of the pitch
    height, width = graphic.shape[:2]
    corners = np.array([(0, 0), (width, 0), (width, height), (0, height)], np.float32)
    H = cv2.getPerspectiveTransform(corners, calibration.project(X).astype(np.float32))
    size = picture.shape[1::-1]
    return cv2.warpPerspective(graphic, H, size), cv2.warpPerspective(np.ones((height, width), np.uint8), H, size) > 0


# %%
# The carpet lies between the penalty area and the centre; the grass is what has its usual colour there.
x, y = calibration.image_to_field([picture.shape[1] / 2, picture.shape[0] / 2])[:2]
carpet, inside = drawn(
    text("CARPET", (500, 200), (160, 60, 20)),
    [(x - 7, y - 3, 0), (x + 7, y - 3, 0), (x + 7, y + 3, 0), (x - 7, y + 3, 0)],
)
lab = cv2.cvtColor(cv2.GaussianBlur(picture, (3, 3), 0), cv2.COLOR_BGR2LAB).astype(float)
is_grass = np.linalg.norm((lab - np.median(lab[inside], axis=0))[..., 1:], axis=-1) < 20.0
shown = picture.copy()
shown[inside & is_grass] = (0.35 * picture + 0.65 * carpet)[inside & is_grass]

# %%
# A board stands: its upper edge is two metres above the ground, where z is -2.
far = -calibration.field.width / 2 - 3.0
ends = [(x - 9, far), (x + 9, far)]
board, inside = drawn(
    text("BOARD", (900, 200), (40, 40, 190)), [(*ends[0], -2.0), (*ends[1], -2.0), (*ends[1], 0.0), (*ends[0], 0.0)]
)
shown[inside] = board[inside]
plt.figure(figsize=(9.6, 5.4))
plt.imshow(shown[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
