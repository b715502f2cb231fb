"""Synthetic frames kept in a folder: ``<seed>_main.jpg`` or ``<seed>_goal.jpg``, with the mask in a PNG beside it.

The name says where the camera stands, since that is what mirroring must know (`mirrored_values`).
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np

from data_tools.synthetic.frames import frame
from data_tools.synthetic.masks import Mask
from fieldcalib.io.files import write_bytes
from fieldcalib.io.image import Image

QUALITY = 95  # of the JPEG; what a broadcast chain does to the image has been done


def write_cache(folder: Path, seeds: Iterable[int], processes: int) -> None:
    """Make the frames of these seeds; those that are there are kept, so an interrupted run goes on."""
    folder.mkdir(parents=True, exist_ok=True)
    present = {int(path.stem.split("_")[0]) for path in folder.glob("*.jpg")}
    missing = [seed for seed in seeds if seed not in present]
    with get_context("spawn").Pool(processes, initializer=cv2.setNumThreads, initargs=(1,)) as pool:
        for _ in pool.imap_unordered(partial(_write_frame, folder), missing, chunksize=8):
            pass


def read_frame(path: Path) -> tuple[Image, Mask, bool]:
    """Image, mask, and whether the camera stands behind a goal, of a cached ``.jpg``."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    mask = cv2.imread(str(path.with_suffix(".png")), cv2.IMREAD_GRAYSCALE)
    return np.asarray(image, np.uint8), np.asarray(mask, np.uint8), path.stem.endswith("_goal")


def _write_frame(folder: Path, seed: int) -> None:
    made = frame(seed)
    path = folder / f"{seed:07d}_{'goal' if made.behind_goal else 'main'}.jpg"
    write_bytes(path.with_suffix(".png"), cv2.imencode(".png", made.mask)[1].tobytes())
    write_bytes(path, cv2.imencode(".jpg", made.image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes())
