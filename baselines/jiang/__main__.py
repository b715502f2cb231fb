"""Command line of `baselines.jiang`: run (the default), train, score and figure."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import get_args

import cv2

from fieldcalib._extras import missing
from fieldcalib.console.arguments import add_image_limits, add_run_options, run_options

try:
    import torch
except ModuleNotFoundError as error:
    raise missing(error, "train") from None


from baselines import hdecomp
from baselines.dlt_lines import homography_file
from baselines.jiang import optimiser, training
from baselines.jiang.estimate import CostName, Estimator, homographies
from baselines.jiang.networks import SIZE, WIDTH
from baselines.jiang.score import score
from baselines.jiang.training_pairs import Batches, read_pairs
from fieldcalib.console.arguments import add_format, add_inputs, count, folder_name, image_size, positive
from fieldcalib.console.options import given
from fieldcalib.console.program import run_command
from fieldcalib.io.formats import HOMOGRAPHIES
from fieldcalib.io.frame_source import ReadImage
from fieldcalib.io.image_files import Image
from fieldcalib.run_folder.engine import image_files
from fieldcalib.run_folder.labelled_frames import CalibratedFrame, FromFiles, calibrate_files

AT_ONCE = 16  # images that are optimised together
COMMANDS = ("run", "train", "score", "figure")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given and given[0] not in (*COMMANDS, "-h", "--help"):
        given = ["run", *given]
    torch.set_num_threads(1)  # as for NumPy: results then do not depend on --jobs
    cv2.setNumThreads(1)
    parser = argparse.ArgumentParser(prog="python -m baselines.jiang", description=_DESCRIPTION)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_run(commands.add_parser("run", help="homographies and cameras of images; may be left out"))
    _add_train(commands.add_parser("train", help="train the two networks"))
    _add_score(commands.add_parser("score", help="measure on images with homographies and annotations"))
    _add_figure(commands.add_parser("figure", help="draw how cost and overlap move over the steps"))
    return run_command(parser.parse_args(given))


_DESCRIPTION = "Jiang et al. (WACV 2020), for comparison: four points optimised through a predicted error."


def _add_run(parser: argparse.ArgumentParser) -> None:
    add_inputs(parser, "images, folders and zips of them")
    parser.add_argument("--size", type=image_size, metavar="WxH", help="of images that are squashed (as they are)")
    parser.add_argument("--out", required=True, type=folder_name, metavar="DIR", help="where the results go")
    _add_method(parser)
    add_format(parser)
    parser.add_argument("--strict", action="store_true", help="read all files first, and do nothing if one is broken")
    add_image_limits(parser)
    add_run_options(parser)
    parser.set_defaults(run=_run, command="baselines.jiang")


def _add_method(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--weights", required=True, type=Path, metavar="DIR", help="what train has written")
    parser.add_argument(
        "--cost",
        choices=get_args(CostName),
        default="learned",
        help="what falls: the predicted error, or the distances of pixels that fieldcalib's network labels (learned)",
    )
    parser.add_argument("--steps", type=count, default=optimiser.STEPS, help=f"({optimiser.STEPS}, the paper's)")


def _run(options: argparse.Namespace) -> int:
    Estimator.load(options.weights, options.cost)  # broken weights are reported before the work begins
    read = partial(given(ReadImage, options).sized, size=options.size)
    method = FromFiles(read, _FromImages(options.weights, options.cost, options.steps))
    writes = [HOMOGRAPHIES.file_name("<id>")]
    names = [training.GUESS, *([training.ERROR] if options.cost == "learned" else [])]
    states = [(options.weights / name).stat().st_mtime_ns for name in names]
    files = image_files(options.input)
    return calibrate_files(run_options(options), files, method, AT_ONCE, writes, more=states)


@dataclass(frozen=True)
class _FromImages:
    """Calibrates images."""

    weights: Path
    cost: CostName
    steps: int

    def __call__(self, images: dict[str, Image], size: tuple[int, int]) -> list[CalibratedFrame]:
        """Calibrate images of one size: their homographies, decomposed into cameras."""
        path = _estimator(self.weights, self.cost)(list(images.values()), size, self.steps)
        matrices = homographies(path.best, size)
        costs = path.costs.double()
        results = []
        for i, (id, calibration) in enumerate(zip(images, hdecomp.calibrate(matrices, size), strict=True)):
            details = {"cost_of_guess": costs[0, i].item(), "cost": costs[:, i].min().item()}
            files = homography_file(id, matrices[i], size, "jiang")
            results.append(CalibratedFrame(calibration, details, files))
        return results


@lru_cache(maxsize=1)
def _estimator(weights: Path, cost: CostName) -> Estimator:
    return Estimator.load(weights, cost)


def _add_train(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path, help="folder of the weights and of the logs")
    parser.add_argument(
        "--pictures",
        type=Path,
        required=True,
        metavar="DIR",
        help="pictures, which fill half of every batch",
    )
    parser.add_argument("--homographies", type=Path, required=True, metavar="DIR", help="theirs, as in WC14")
    parser.add_argument(
        "--synthetic", type=Path, metavar="DIR", help="frames of data_tools.homography_frames, the other half"
    )
    parser.add_argument("--network", choices=("both", "guess", "error"), default="both", help="which one (both)")
    parser.add_argument("--width", type=count, default=WIDTH, help=f"of ResNet-18's first stage ({WIDTH}, the paper's)")
    parser.add_argument("--picture-size", type=count, default=SIZE, help=f"pixels ({SIZE}, the paper's)")
    parser.add_argument("--steps", type=count, default=20000, help="(20000)")
    parser.add_argument("--minutes", type=positive, default=math.inf, help="of each network, if steps take longer")
    parser.add_argument("--batch", type=count, default=32, help="pictures of a step (32)")
    parser.add_argument("--seed", type=int, default=0)
    parser.set_defaults(run=_train)


def _train(options: argparse.Namespace) -> int:
    folders = [read_pairs(options.pictures, options.homographies)]
    if options.synthetic is not None:
        folders.append(read_pairs(options.synthetic, options.synthetic))
    options.out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(options.seed)
    batches = Batches(options.seed, options.batch, folders)
    for name, train in {"guess": training.train_guess, "error": training.train_error}.items():
        if options.network in ("both", name):
            train(batches, options.out, options.width, options.picture_size, options.steps, options.minutes)
    return 0


def _add_score(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("images", type=Path, help="folder of <id>.png, of 1280x720 or squashed")
    parser.add_argument("annotations", type=Path, help="folder of <id>.homographyMatrix and <id>.json")
    _add_method(parser)
    parser.add_argument("--trace", type=Path, metavar="FILE.json", help="cost and overlaps at every step, for figure")
    parser.set_defaults(run=_score)


def _score(options: argparse.Namespace) -> int:
    o = options
    print(json.dumps(score(o.images, o.annotations, o.weights, o.cost, o.steps, o.trace)))
    return 0


def _add_figure(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path, metavar="OUT.png")
    parser.add_argument("traces", type=Path, nargs="+", metavar="FILE.json", help="what score --trace has written")
    parser.set_defaults(run=_figure)


def _figure(options: argparse.Namespace) -> int:
    from baselines.jiang.figure import draw  # imports matplotlib

    draw(options.out, [json.loads(path.read_text()) for path in options.traces])
    return 0


if __name__ == "__main__":
    from baselines.jiang.__main__ import main as main_of_module  # other processes find its classes there

    raise SystemExit(main_of_module())
