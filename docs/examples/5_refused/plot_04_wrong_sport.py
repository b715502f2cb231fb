"""
The wrong sport
===============

A tennis court, calibrated as a soccer pitch: refused, with a question. The remedy is to name the field.
"""

import matplotlib.pyplot as plt

import fieldcalib
from fieldcalib.draw import contact_sheet, draw_calibration, render_field
from fieldcalib.fields import tennis

truth = fieldcalib.Camera.from_angles(1.5, 1.3, 0.0, 1400.0, (-32.0, 1.0, -9.0), (960, 540))
image = render_field(truth, tennis())
(soccer,) = fieldcalib.calibrate(image, progress=False).values()
(court,) = fieldcalib.calibrate(image, field="tennis", progress=False).values()
print(soccer.verdict, "-", soccer.reason, "- remedy:", soccer.remedy)

# %%
pictures = [draw_calibration(image, soccer, soccer.field), draw_calibration(image, court, court.field)]
captions = [f"as soccer: {soccer.verdict}. {soccer.reason}", f"field='tennis': {court.verdict}. {court.reason}"]
sheet = contact_sheet(pictures, captions, columns=2, width=640)
plt.figure(figsize=(12, 4.6))
plt.imshow(sheet[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
