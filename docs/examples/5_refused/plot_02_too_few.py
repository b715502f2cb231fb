"""
Too few markings
================

Two lines leave the camera open: the best guess is drawn dashed, and rejected. The remedy names what would help; one
more marking mends it.
"""

import matplotlib.pyplot as plt

import fieldcalib
from fieldcalib.draw import contact_sheet, draw_calibration, draw_segments, render_field

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
image = render_field(truth, field)
few = ("Side line top", "Big rect. right main")
pictures, captions = [], []
for labels in (few, (*few, "Big rect. right top", "Circle right", "Side line right")):
    pixels = {label: truth.project(field[label].sample(9.0)).round() for label in labels}
    calibration = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))
    pictures.append(draw_segments(draw_calibration(image, calibration, field), pixels, names=False))
    captions.append(f"{calibration.verdict}: {calibration.reason}")
    print(calibration.verdict, "-", calibration.reason, "- remedy:", calibration.remedy or "none needed")

# %%
sheet = contact_sheet(pictures, captions, columns=2, width=640)
plt.figure(figsize=(12, 4.4))
plt.imshow(sheet[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
