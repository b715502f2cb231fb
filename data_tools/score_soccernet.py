"""Score camera files with the evaluation of the SoccerNet package (extra `soccernet`).

    python -m data_tools.score_soccernet CAMERAS ANNOTATIONS --size 960x540

CAMERAS holds camera_<id>.json for images of that size, ANNOTATIONS <id>.json. AC@t is TP / (TP + FP + FN) of a frame,
where a segment is a true positive if all of its annotated points lie within t pixels of its projection; the better
value of the labels and of those of the field turned by 180 degrees counts, averaged over the frames with a camera. CR
is the share of frames with a camera. Lines are sampled every 0.9 m. The package takes a third of a second per frame.
"""

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from fieldcalib.console.arguments import add_size
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.formats import ANNOTATIONS

THRESHOLDS = (5, 10, 20)  # px


def frame_accuracy(frame: tuple[str, bytes], cameras: Path, size: tuple[int, int]) -> list[float] | None:
    """AC at each threshold for one frame, given its id and its annotation, 0..1; None without a camera."""
    from SoccerNet.Evaluation import utils_calibration as soccernet

    id, annotation = frame
    camera = cameras / f"camera_{id}.json"
    if not camera.exists():
        return None
    projected = soccernet.get_polylines(json.loads(camera.read_text()), *size, sampling_factor=0.9)
    annotated = soccernet.scale_points(json.loads(annotation), *size)
    accuracies = []
    for labels in (annotated, soccernet.mirror_labels(annotated)):
        confusions = [soccernet.evaluate_camera_prediction(projected, labels, t)[0] for t in THRESHOLDS]
        accuracies.append([float(confusion[0, 0] / max(confusion.sum(), 1.0)) for confusion in confusions])
    return [float(best) for best in np.max(accuracies, axis=0)]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line of JSON: frames, CR and AC@5, @10, @20 in percent."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cameras", type=Path, help="folder of camera_<id>.json")
    parser.add_argument("annotations", type=Path, help="folder or zip of <id>.json")
    add_size(parser, "of the images, e.g. 960x540", required=True)
    options = parser.parse_args(arguments)
    if find_spec("SoccerNet") is None:
        parser.error("needs the SoccerNet package: pip install 'fieldcalib[soccernet]'")
    if not options.cameras.is_dir():
        parser.error(f"{options.cameras} is not a folder of cameras")
    try:
        files = [(file.id, file.read()) for file in ANNOTATIONS.find([options.annotations])]
    except (FileNotFoundError, BrokenFileError) as error:
        parser.error(str(error))
    with ProcessPoolExecutor() as pool:
        score = partial(frame_accuracy, cameras=options.cameras, size=options.size)
        rows = [row for row in pool.map(score, files, chunksize=8) if row is not None]
    result = {"frames": len(files), "CR": 100.0 * len(rows) / len(files)}
    for threshold, accuracy in zip(THRESHOLDS, np.mean(rows, axis=0) if rows else np.zeros(3), strict=True):
        result[f"AC@{threshold}"] = round(100.0 * float(accuracy), 2)
    print(json.dumps(result))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
