"""The picture of docs/explanation/results.md: one view calibrated from three sets of labels, with what is said of each.

python -m data_tools.results_picture docs/images/results.jpg
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import fieldcalib
from fieldcalib import Calibration, Camera, soccer
from fieldcalib._types import Array
from fieldcalib.draw import contact_sheet, draw_calibration, draw_segments, render_field
from fieldcalib.io.image_files import Image, write_image

SIZE = (960, 540)
CAMERA = Camera.from_angles(0.42, 1.36, 0.0, 1250.0, (0.0, 66.0, -17.0), SIZE)
ALL = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Small rect. right main")
LABELS = {  # of the three pictures; the second one has labels on one side only
    "good": (*ALL, "Big rect. right bottom", "Circle right"),
    "check": ("Side line right", "Big rect. right main", "Small rect. right main", "Big rect. right top"),
    "reject": ("Side line top", "Side line right"),
}


def labelled(labels: tuple[str, ...], rng: np.random.Generator) -> dict[str, Array]:
    """Pixels of labels as a person sets them: a few on each marking, to a pixel."""
    found = {}
    for label in labels:
        xy = CAMERA.project(soccer()[label].sample(4.0))
        xy = xy[np.all((xy >= 0.0) & (xy < SIZE), axis=1)]
        if len(xy):
            found[label] = xy + rng.normal(scale=1.0, size=xy.shape)
    return found


def picture() -> Image:
    """The sheet of all three."""
    image = render_field(CAMERA, soccer(), rng=np.random.default_rng(0))
    rng = np.random.default_rng(1)
    frames = {name: labelled(labels, rng) for name, labels in LABELS.items()}
    results = fieldcalib.calibrate(frames, image_size=SIZE, progress=False)
    drawn = [
        draw_segments(draw_calibration(image, results[name], soccer()), frame, names=False)
        for name, frame in frames.items()
    ]
    return contact_sheet(drawn, [caption(results[name]) for name in frames], width=520)


def caption(calibration: Calibration) -> str:
    """Verdict, reason and remedy."""
    words = f"{calibration.verdict}: {calibration.reason}"
    return f"{words}. Remedy: {calibration.remedy}" if calibration.remedy else words


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    write_image(parser.parse_args().out, picture())


if __name__ == "__main__":
    main()
