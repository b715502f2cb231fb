"""
Players with their errors, on a pitch of mplsoccer
==================================================

Ellipses hold the true places with a probability of 95 %: they are long along the line of sight.
"""

import fieldcalib
from fieldcalib import plot
from fieldcalib.io.boxes import foot_points

field = fieldcalib.soccer()
truth = fieldcalib.Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
pixels = {label: truth.project(field[label].sample(9.0)).round() for label in labels}
calibration = fieldcalib.calibrate_from_segments(field, pixels, (960, 540))

boxes = [(400, 200, 420, 260), (610, 240, 632, 305), (250, 300, 275, 370), (700, 180, 716, 228)]
players = fieldcalib.locate_on_ground(calibration, foot_points(boxes), pixel_sd=3.0)

pitch = plot.soccer_pitch(field, pitch_color="grass", line_color="white", stripe=True)
figure, ax = pitch.draw(figsize=(9, 6))
plot.draw_visible_area(pitch, ax, calibration.camera, color="white", alpha=0.2)
plot.draw_errors(pitch, ax, players.X, players.covariance)
plot.draw_players(pitch, ax, players.X, color="red", s=30)
