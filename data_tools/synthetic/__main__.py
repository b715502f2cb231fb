"""Show synthetic frames, write them to a folder, measure how fast they are made, or film a clip with true cameras."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import cv2
import numpy as np

from data_tools.measured_cameras import read_zoom
from data_tools.synthetic import SIZE, frame
from data_tools.synthetic.cache import write_cache
from data_tools.synthetic.film import CLIP_SIZE, PAINTED, Scene, clip_frames, write_clip
from data_tools.synthetic.games import game_named
from data_tools.synthetic.paths import with_displaced_lines
from data_tools.synthetic.samples import write_samples
from fieldcalib._whole_files import write_bytes
from fieldcalib.console.arguments import SOCCER, add_named_field, count, image_size
from fieldcalib.draw.overlays import label_colour
from fieldcalib.fields.sports.soccer import soccer, with_painted_lines
from fieldcalib.io.image_files import Image

COLUMNS, ROWS = 4, 8
BENCH_FRAMES = 200


def frame_sheet(first_seed: int, name: str = SOCCER) -> Image:
    """32 frames, every other row the masks of the one above."""
    rows = []
    palette = np.array([(0, 0, 0), *map(label_colour, game_named(name).classes)], np.uint8)
    for start in range(first_seed, first_seed + COLUMNS * ROWS, COLUMNS):
        frames = [frame(seed, name=name) for seed in range(start, start + COLUMNS)]
        rows += [np.hstack([f.image for f in frames]), np.hstack([palette[f.mask] for f in frames])]
    return np.vstack(rows)


def frames_per_second(processes: int, name: str) -> float:
    """Joint speed of `processes`, without the time that they need to start."""
    make = partial(frame, size=SIZE, name=name)
    with get_context("spawn").Pool(processes, initializer=cv2.setNumThreads, initargs=(1,)) as pool:
        pool.map(make, range(processes * 4), chunksize=1)
        start = time.perf_counter()
        pool.map(make, range(BENCH_FRAMES), chunksize=4)
        return BENCH_FRAMES / (time.perf_counter() - start)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the chosen command; the bench prints a line of JSON."""
    parser = argparse.ArgumentParser(prog="python -m data_tools.synthetic", description=__doc__)
    add_named_field(parser)
    parser.add_argument("--sheet", type=Path, metavar="OUT.png", help="write frames and masks as one picture")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="write frames and masks for data_tools.train")
    parser.add_argument("--out", type=Path, metavar="DIR", help="the same, with true cameras and annotations")
    parser.add_argument("--count", type=int, default=10000, help="frames of the cache or of OUT (10000)")
    parser.add_argument("--seed", type=int, default=0, help="first frame, or the clip (0)")
    parser.add_argument("--bench", action="store_true", help="measure frames a second")
    parser.add_argument("--processes", type=int, default=2, help="of the cache and of the bench (2)")
    parser.add_argument("--clip", type=Path, metavar="OUT.mp4", help="film a clip, its cameras beside it in OUT.jsonl")
    parser.add_argument("--samples", type=Path, metavar="DIR", help="write the files of fieldcalib.sample")
    parser.add_argument("--frames", type=count, default=300, help="of the clip, 30 a second (300)")
    parser.add_argument("--size", type=image_size, default=CLIP_SIZE, metavar="WxH", help="of the clip (960x540)")
    parser.add_argument("--cuts", type=int, default=0, help="between the main camera and one beside it (0)")
    parser.add_argument("--measured", type=Path, metavar="FILE.npz", help="zoom, lens and place of a measured camera")
    parser.add_argument("--flies", action="store_true", help="the main camera is no tripod's, but flies")
    options = parser.parse_args(arguments)
    if options.clip and options.field != SOCCER:
        parser.error("--clip films soccer only")
    try:
        game_named(options.field)
    except ValueError as error:
        parser.error(str(error))
    if options.sheet:
        write_bytes(options.sheet, cv2.imencode(".png", frame_sheet(options.seed, options.field))[1].tobytes())
    seeds = range(options.seed, options.seed + options.count)
    if options.cache:
        write_cache(options.cache, seeds, options.processes, options.field)
    if options.out:
        write_cache(options.out, seeds, options.processes, options.field, truth=True)
    if options.bench:
        speed = frames_per_second(options.processes, options.field)
        print(json.dumps({"processes": options.processes, "frames_per_second": round(speed, 1)}))
    if options.samples:
        write_samples(options.samples)
    if options.clip:
        measured = options.measured and read_zoom(options.measured)
        frames = clip_frames(options.seed, options.frames, options.cuts, measured, options.size, flies=options.flies)
        field = with_displaced_lines(with_painted_lines(soccer()), np.random.default_rng((options.seed, PAINTED)))
        scene = Scene.random(field, options.seed, [frame.camera for frame in frames])
        write_clip(options.clip, scene, frames)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
