"""
A court of one's own
====================

A file with the size, the lines and where the camera stands; then pictures of it need no labels.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import fieldcalib
from fieldcalib.draw import draw_calibration, render_field
from fieldcalib.io.field_files import read_field

COURT = """
length: 10.0
width: 6.0
segments:
  Back line left: {kind: Line, start: [-5, -3, 0], end: [-5, 3, 0]}
  Back line right: {kind: Line, start: [5, -3, 0], end: [5, 3, 0]}
  Side line top: {kind: Line, start: [-5, -3, 0], end: [5, -3, 0]}
  Side line bottom: {kind: Line, start: [-5, 3, 0], end: [5, 3, 0]}
  Service line: {kind: Line, start: [2, -3, 0], end: [2, 3, 0]}
lines: {width: 0.05}
stands:
  - {name: side, pan: [-30, 30], tilt: [50, 85], roll: [-5, 5], fov: [20, 70], x: [-4, 4], y: [7, 20], z: [-8, -2]}
"""
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "court.yaml"
    path.write_text(COURT)
    field = read_field(path)

truth = fieldcalib.Camera.from_angles(0.1, 1.2, 0.0, 1000.0, (-1.0, 13.0, -5.0), (960, 540))
image = render_field(truth, field)
(calibration,) = fieldcalib.calibrate_from_images(field, [image])
print(calibration.verdict, "-", calibration.reason)

# %%
picture = draw_calibration(image, calibration, field)
plt.figure(figsize=(9.6, 5.4))
plt.imshow(picture[..., ::-1])
plt.axis("off")
plt.tight_layout(pad=0)
