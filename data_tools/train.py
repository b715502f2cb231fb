"""Train the network that finds the markings of a field, on synthetic frames and on real ones with labelled points.

    python -m data_tools.synthetic --cache FRAMES --count 20000
    python -m data_tools.train OUT --cache FRAMES --labelled KEYPOINTS/train --held-out KEYPOINTS/valid

With few pictures of one's own, whose cameras `fieldcalib open` gave, it goes on from a network that is there:

    python -m data_tools.train OUT --start-from package --cache FRAMES --labelled RESULTS --held-out OTHERS --steps 1000

Networks of other fields learn from synthetic frames alone:

    python -m data_tools.synthetic --field basketball-fiba --cache FRAMES --count 20000
    python -m data_tools.train OUT --field basketball-fiba --cache FRAMES
    fieldcalib run GAME.mp4 --field basketball-fiba --model OUT/model.onnx --out CAMERAS

A network for upright and square pictures, with an input narrower than 4:3, learns from such parts of the frames:

    python -m data_tools.train OUT --start-from package --cache FRAMES --labelled KEYPOINTS/train --size 192x256

OUT receives model.onnx with model.json (`data_tools.onnx_model`), checkpoint.pt, from which training resumes, and
log.jsonl: every ten minutes, and at the end, the loss and the intersection over union on held-out synthetic frames.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from importlib.resources import as_file
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fieldcalib._extras import missing

try:
    import torch
except ModuleNotFoundError as error:
    raise missing(error, "train") from None

from torch import Tensor, nn
from torch.nn.functional import cross_entropy
from torch.optim.swa_utils import AveragedModel
from torch.utils._pytree import tree_map_only
from torch.utils.data import DataLoader

from data_tools.labelled import clip_of, is_results, labelled_frames
from data_tools.network import MarkingsNet
from data_tools.onnx_model import read_network, write_model
from data_tools.synthetic import CLASSES, Mask, frame
from data_tools.synthetic.cache import check_cached_classes
from data_tools.synthetic.games import game_named
from data_tools.training_data import Batches, normalised, part, stacked, whole
from fieldcalib._types import Array
from fieldcalib._whole_files import write_bytes
from fieldcalib.console.arguments import SOCCER, add_named_field, image_size
from fieldcalib.io.image_files import Image
from fieldcalib.localize.network import SHAPE, SHIPPED

LEARNING_RATE, WARM_UP, WEIGHT_DECAY = 2e-3, 200, 1e-2
FINE_TUNING_RATE = 3e-4  # of a network that was trained before: larger ones forget it
MEASURED_FRAMES = 16  # on which the normalisations of that network are measured
PACKAGE = "package"
AVERAGED = 0.999  # decay of the exported moving average of the weights: over about the last thousand steps
BACKGROUND_WEIGHT = 0.1  # 96 % of the pixels are background
BACKGROUND_SAMPLED = 0.25  # random share of background pixels in the loss: saves time
REPORT_MINUTES = 10.0
MULTIPLE = 32  # of which width and height of the input are multiples
TURNED = 0.7, 1.5  # width and height of the input for upright pictures, by the others: fieldcalib/models/README.md
VALIDATION_SEEDS = range(1_000_000_000, 1_000_000_100)
# Of a training's state, with the types of their numbers in half precision: mean squares of gradients are tiny
PARTS = {"network": torch.float16, "averaged": torch.float16, "optimizer": torch.bfloat16}
MaskedImages = Sequence[tuple[Image, Mask]]


@dataclass
class Training:
    """State of a training, from which it can be resumed; the only mutable class here."""

    network: MarkingsNet
    averaged: AveragedModel
    optimizer: torch.optim.Optimizer
    device: torch.device
    step: int = 0
    rate: float = LEARNING_RATE
    """Largest learning rate."""

    @classmethod
    def begin(cls, seed: int, device: torch.device, classes: int = len(CLASSES)) -> Training:
        """Random weights, determined by the seed, for `classes` and the background."""
        torch.manual_seed(seed)
        return cls.of(MarkingsNet(1 + classes), device)

    @classmethod
    def of(cls, network: MarkingsNet, device: torch.device, rate: float = LEARNING_RATE) -> Training:
        """Begin with the weights of a network."""
        network = network.to(device)
        averaged = AveragedModel(network, multi_avg_fn=_average, use_buffers=True)
        optimizer = torch.optim.AdamW(network.parameters(), rate, weight_decay=WEIGHT_DECAY)
        return cls(network, averaged, optimizer, device, rate=rate)

    def save(self, path: Path, *, half: bool = False) -> None:
        """Write the state atomically; with numbers of 16 bits if `half`, in half the size."""
        buffer = io.BytesIO()
        parts = {name: getattr(self, name).state_dict() for name in PARTS}
        if half:
            parts = {name: _converted(part, PARTS[name]) for name, part in parts.items()}
        torch.save({**parts, "step": self.step, "rate": self.rate}, buffer)
        write_bytes(path, buffer.getvalue())

    def load(self, path: Path) -> None:
        """Resume from a file of `save`."""
        state = torch.load(path, map_location=self.device, weights_only=True)
        for name in PARTS:
            getattr(self, name).load_state_dict(state[name])
        self.step, self.rate = state["step"], state["rate"]

    def advance(self, images: Tensor, classes: Tensor, steps: int) -> float:
        """Take one of `steps` steps on a batch; returns the loss before it."""
        for group in self.optimizer.param_groups:
            group["lr"] = learning_rate(self.step, steps, self.rate)
        self.network.train()
        chosen = sampled_pixels(classes, self.step)
        loss = _loss(self.network, images.to(self.device), classes.to(self.device), chosen.to(self.device))
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()
        self.averaged.update_parameters(self.network)
        self.step += 1
        return float(loss.detach())


def _converted(state: Any, kind: torch.dtype) -> Any:
    """A state whose tensors with more than one number have another type."""
    return tree_map_only(Tensor, lambda x: x.to(kind) if x.is_floating_point() and x.numel() > 1 else x, state)


def learning_rate(step: int, steps: int, most: float = LEARNING_RATE) -> float:
    """A short warm-up, then half a cosine down to 0.

    Examples
    --------
    >>> learning_rate(0, 1000) < learning_rate(WARM_UP, 1000) > learning_rate(999, 1000)
    True
    """
    return most * min(1.0, (step + 1) / WARM_UP) * 0.5 * (1.0 + math.cos(math.pi * step / steps))


def _average(averaged: Sequence[Tensor], current: Sequence[Tensor], count: Tensor | int) -> None:
    """Move averages towards the current weights, in place; faster at first, to forget the initial weights."""
    share = max(1.0 - AVERAGED, 9.0 / (10.0 + int(count)))
    for mean, value in zip(averaged, current, strict=True):
        if mean.is_floating_point():
            mean.lerp_(value, share)
        else:  # how many batches were seen
            mean.copy_(value)


def sampled_pixels(classes: Tensor, seed: int) -> Tensor:
    """Flat indices of the pixels in the loss: all pixels of markings, and some of the background."""
    chance = torch.rand(classes.shape, generator=torch.Generator().manual_seed(seed))
    return ((classes > 0) | (chance < BACKGROUND_SAMPLED)).flatten().nonzero()[:, 0]


def _has_bfloat16(device: torch.device) -> bool:
    """Whether a device computes with 16 bits itself: where they are emulated, training takes ten times as long."""
    on_gpu = device.type == "cuda"
    return bool(torch.cuda.is_bf16_supported() if on_gpu else torch.ops.mkldnn._is_mkldnn_bf16_supported())


def _loss(network: nn.Module, images: Tensor, classes: Tensor, chosen: Tensor) -> Tensor:
    """Cross-entropy over the chosen pixels, with a lower weight for the background."""
    with torch.autocast(images.device.type, torch.bfloat16, enabled=_has_bfloat16(images.device)):  # half the time
        logits = network(normalised(images).contiguous(memory_format=torch.channels_last))
    weight = torch.ones(logits.shape[1], device=images.device)
    weight[0] = BACKGROUND_WEIGHT / BACKGROUND_SAMPLED
    by_pixel = logits.permute(0, 2, 3, 1).reshape(-1, len(weight))
    return cross_entropy(by_pixel[chosen].float(), classes.flatten()[chosen], weight)


def intersection_over_union(
    network: nn.Module, samples: MaskedImages, size: tuple[int, int], device: torch.device, known: int = len(CLASSES)
) -> Array:
    """Intersection over union of each class, (known,); NaN for classes that no mask holds."""
    count = 1 + known
    confusion = np.zeros((count, count))
    network.eval()
    with torch.inference_mode():
        for sample in samples:
            images, classes = stacked([sample], size)
            found = network(normalised(images.to(device))).argmax(1).cpu()
            pairs = count * classes.numpy().ravel() + found.numpy().ravel()
            confusion += np.bincount(pairs, minlength=count * count).reshape(count, count)
    both = np.diag(confusion)
    either = confusion.sum(axis=0) + confusion.sum(axis=1) - both
    return np.where(confusion.sum(axis=1) > 0.0, both / np.maximum(either, 1.0), np.nan)[1:]


def upright_size(size: tuple[int, int]) -> tuple[int, int] | None:
    """Input of about as many pixels for pictures that are higher than wide; None if that is the shape of the given one.

    Examples
    --------
    >>> upright_size((320, 192)), upright_size((224, 288))
    ((224, 288), None)
    """
    width, height = (MULTIPLE * round(factor * side / MULTIPLE) for factor, side in zip(TURNED, size, strict=True))
    return (width, height) if size[0] >= SHAPE * size[1] else None


@dataclass(frozen=True)
class Report:
    """Measures a network and saves it."""

    out: Path
    size: tuple[int, int]
    classes: Sequence[str]
    validation: Mapping[str, MaskedImages]
    half: bool = False
    """Whether checkpoints are in half precision."""

    def __call__(self, training: Training, losses: Sequence[float]) -> None:
        """Save a checkpoint and the model, and add a line to the log."""
        training.save(self.out / "checkpoint.pt", half=self.half)
        network = training.averaged.module
        row: dict[str, object] = {"step": training.step, "loss": round(float(np.mean(losses)), 4) if losses else None}
        for name, samples in self.validation.items():
            values = intersection_over_union(network, samples, self.size, training.device, len(self.classes))
            row[f"iou_{name}"] = round(float(np.nanmean(values)), 4)
            shown = {label: round(float(v), 3) for label, v in zip(self.classes, values, strict=True) if np.isfinite(v)}
            row[f"iou_{name}_classes"] = shown
        write_model(network.cpu().eval(), self.out / "model.onnx", self.classes, self.size, upright_size(self.size))
        network.to(training.device)
        with (self.out / "log.jsonl").open("a") as log:
            print(json.dumps(row), file=log)


def train(training: Training, batches: Batches, report: Report, steps: int, minutes: float, workers: int) -> None:
    """Train for `steps` or `minutes`, whichever ends first, reporting from time to time."""
    start = reported = time.monotonic()
    losses: list[float] = []
    rest: Iterable[int] = range(training.step, steps)
    loader = DataLoader(batches, batch_size=None, sampler=rest, num_workers=workers)
    for images, classes in loader:
        losses.append(training.advance(images, classes, steps))
        now = time.monotonic()
        if now - start > 60.0 * minutes:
            break
        if now - reported > 60.0 * REPORT_MINUTES:
            report(training, losses)
            reported, losses = now, []
    report(training, losses)


def _going_on(
    name: str, classes: Sequence[str], size: tuple[int, int], field: str, device: torch.device, seed: int
) -> Training:
    """Training that goes on from a network in a file; from all but its last layer if that has other classes.

    The seed determines the weights of a new last layer.

    Raises
    ------
    ValueError
        If the network is another one.
    """
    with as_file(SHIPPED) if name == PACKAGE else nullcontext(Path(name)) as path:
        made = [frame(seed, name=field) for seed in range(MEASURED_FRAMES)]
        images, _ = stacked([(one.image, one.mask) for one in made], size)
        network, known = read_network(path, normalised(images))
    if known == list(classes):
        return Training.of(network, device, FINE_TUNING_RATE)
    torch.manual_seed(seed)
    network.head = MarkingsNet(1 + len(classes)).head
    return Training.of(network, device)


def main(arguments: Sequence[str] | None = None) -> int:
    """Train a model."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the model, the checkpoint and the log")
    add_named_field(parser)
    parser.add_argument("--cache", type=Path, metavar="DIR", help="frames of data_tools.synthetic --cache")
    parser.add_argument(
        "--start-from",
        metavar="FILE.onnx",
        help=f'a network of this program to go on from; of another field, its features; "{PACKAGE}": the package\'s',
    )
    parser.add_argument(
        "--labelled",
        type=Path,
        metavar="DIR",
        help="real frames: results of fieldcalib open, or see data_tools.labelled",
    )
    parser.add_argument("--held-out", type=Path, metavar="DIR", help="real frames whose clips are only measured")
    parser.add_argument(
        "--steps", type=int, default=40000, help="steps; the learning rate falls to 0 at the last one (40000)"
    )
    parser.add_argument("--minutes", type=float, default=math.inf, help="after which to stop, to be resumed")
    parser.add_argument(
        "--size", type=image_size, default=(384, 224), metavar="WxH", help="of the input, multiples of 32 (384x224)"
    )
    parser.add_argument("--batch", type=int, default=16, help="frames of a step (16)")
    parser.add_argument("--workers", type=int, default=1, help="processes that prepare batches (1)")
    parser.add_argument("--threads", type=int, default=1, help="of the network on a CPU (1)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--rate",
        type=float,
        help=f"largest learning rate ({LEARNING_RATE:g}, or {FINE_TUNING_RATE:g} on from a network of the same field)",
    )
    parser.add_argument("--half", action="store_true", help="write checkpoints in half precision, 8 MB each")
    parser.add_argument("--resume", action="store_true", help="go on from the checkpoint in OUT")
    options = parser.parse_args(arguments)
    for folder in (options.labelled, options.held_out):
        if folder and options.field != SOCCER and not is_results(folder):
            parser.error(f"{folder}: labelled points are of soccer; of other fields give results of fieldcalib open")
    if options.start_from and options.resume:
        parser.error("--resume goes on from the checkpoint: leave --start-from out")
    try:
        classes = game_named(options.field).classes
        if options.cache:
            check_cached_classes(options.cache, classes)
    except ValueError as error:
        parser.error(str(error))
    torch.set_num_threads(options.threads)
    cv2.setNumThreads(1)
    options.out.mkdir(parents=True, exist_ok=True)

    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    if options.start_from:
        try:
            training = _going_on(options.start_from, classes, options.size, options.field, device, options.seed)
        except (ValueError, OSError) as error:
            parser.error(str(error))
    else:
        training = Training.begin(options.seed, device, len(classes))
    if options.resume:
        training.load(options.out / "checkpoint.pt")
    training.rate = options.rate or training.rate
    made = [frame(seed, name=options.field) for seed in VALIDATION_SEEDS]
    validation: dict[str, MaskedImages] = {"synthetic": [(one.image, one.mask) for one in made]}
    clips: set[str] = set()
    if options.held_out:
        held_out = list(labelled_frames(options.held_out))
        clips = {clip_of(path) for path in options.held_out.glob("*.jpg")} | {one.clip for one in held_out}
        validation["held_out"] = [whole(one, classes) for one in held_out]
    labelled = [one for one in labelled_frames(options.labelled) if one.clip not in clips] if options.labelled else []
    cached = sorted(options.cache.glob("*.jpg")) if options.cache else []
    batches = Batches(options.seed, options.batch, options.size, cached, labelled, options.field)
    if batches.are_narrow:
        rng = np.random.default_rng(options.seed)
        validation = {name: [part(*one, rng) for one in samples] for name, samples in validation.items()}
    report = Report(options.out, options.size, classes, validation, options.half)
    train(training, batches, report, options.steps, options.minutes, options.workers)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
