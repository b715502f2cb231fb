"""Courts in pictures of one camera (`fieldcalib.images.search.place_search`), against points that were set by hand.

    python -m data_tools.score_tripod FOLDER

FOLDER holds frames of hockey with points (`data_tools.rink_points`). Prints a line of JSON with the number of pictures;
how many have a right camera, an accepted right one, a good right one, an accepted wrong one; the place, metres; and the
processor time for each picture, seconds, with the share of the search for the place.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from data_tools.rink_points import FIELD, rink_frames
from fieldcalib.assess.findings import Verdict
from fieldcalib.console.program import run_command
from fieldcalib.fields.catalogue import field as field_named
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.images.search.place_search import pooled_place
from fieldcalib.io.image_files import parse_image


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Search and print; returns the exit code."""
    start, rink = time.process_time(), field_named(FIELD)
    frames = list(rink_frames(options.folder))
    images = [parse_image(frame.path.read_bytes()) for frame in frames]
    place = pooled_place(rink, images)
    found = calibrate_from_images(rink, images, place=place)
    right = [one.camera is not None and frame.is_right(one.camera) for frame, one in zip(frames, found, strict=True)]
    is_right, accepted = np.array(right), np.array([one.accepted for one in found])
    good = np.array([one.verdict == Verdict.GOOD for one in found])
    record = {
        "pictures": len(frames),
        "right": int(np.sum(is_right)),
        "accepted and right": int(np.sum(is_right & accepted)),
        "good and right": int(np.sum(is_right & good)),
        "accepted and wrong": int(np.sum(~is_right & accepted)),
        "place": None if place is None else np.round(place.C, 1).tolist(),
        "seconds": round((time.process_time() - start) / max(len(frames), 1), 2),
    }
    print(json.dumps(record))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
