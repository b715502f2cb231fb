"""
Paint beside a marking
======================

A pitch 74 m wide, calibrated from its penalty area as one of 68 m: the labels fit, but the touchlines lie beside
their paint. The remedy is to let the size be estimated, which is what `fieldcalib.calibrate` and ``fieldcalib run``
do.
"""

import matplotlib.pyplot as plt

import fieldcalib
from fieldcalib.draw import contact_sheet, draw_calibration, render_field

true_field = fieldcalib.soccer(105.0, 74.0)
truth = fieldcalib.Camera.from_angles(0.3, 1.3, 0.0, 850.0, (0.0, 70.0, -20.0), (960, 540))
image = render_field(truth, true_field)
labels = ("Side line right", "Big rect. right main", "Big rect. right top", "Big rect. right bottom", "Circle right")
pixels = {label: truth.project(true_field[label].sample(9.0)).round() for label in labels}
nominal = fieldcalib.soccer()
fixed = fieldcalib.calibrate_from_segments(nominal, pixels, (960, 540))
fixed = fieldcalib.images.refine_on_image(nominal, image, fixed)
(free,) = fieldcalib.calibrate(image, progress=False).values()

# %%
# Orange markings lie beside their paint.
pictures, captions = [], []
for calibration in (fixed, free):
    pictures.append(draw_calibration(image, calibration, calibration.field, show_paint=True))
    captions.append(f"{calibration.field.width:.1f} m wide. {calibration.verdict}: {calibration.reason}")
    print(captions[-1])
sheet = contact_sheet(pictures, captions, columns=2, width=640)
plt.figure(figsize=(12, 4.6))
plt.imshow(sheet[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
