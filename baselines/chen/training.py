"""Training of the siamese features on pairs of edge images, which are drawn on demand.

Features of similar cameras at one place shall be near, those of two random cameras far apart. With d the distance of
two features, which have length 1, the contrastive loss is ``d^2`` for similar pairs and ``max(0, 1 - d)^2`` for others
(Hadsell, Chopra, LeCun: Dimensionality Reduction by Learning an Invariant Mapping, CVPR 2006). One image of each pair
is degraded (`spoilt`), unlike in Chen and Little's code, since lines found by a network differ from drawn ones.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from fieldcalib._extras import missing

try:
    import torch
except ModuleNotFoundError as error:
    raise missing(error, "train") from None

from torch import Tensor, nn
from torch.nn.functional import normalize, relu

from baselines.chen.cameras import Draw, nearby
from baselines.chen.edges import EDGE_SIZE, WHITE, Edges, edge_images, ground_pieces
from fieldcalib._whole_files import write_bytes
from fieldcalib.fields.field import Field

STEPS = 1280  # ten epochs of 128 batches each
PAIRS = 64  # similar pairs in a batch, and as many others
LEARNING_RATE, WEIGHT_DECAY = 0.01, 1e-6
MARGIN = 1.0
MEAN, STD = 0.0188, 0.128  # of edge images with values from 0 to 1
LENGTH = 16  # number of components of a feature
OPSET = 17


class SiameseNet(nn.Module):
    """Maps edge images (N, 1, 180, 320) from 0 to 255 to features (N, 16) of length 1; 26,816 weights."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            *(nn.Conv2d(1, 4, 7, 2, 3), nn.LeakyReLU(0.1)),
            *(nn.Conv2d(4, 8, 5, 2, 2), nn.ReLU()),
            *(nn.Conv2d(8, 16, 3, 2, 1), nn.ReLU()),
            *(nn.Conv2d(16, 32, 3, 2, 1), nn.ReLU()),
            *(nn.Conv2d(32, 16, 3, 2, 1), nn.ReLU()),
            nn.Flatten(),
            nn.Linear(16 * 6 * 10, LENGTH),
        )

    def forward(self, edges: Tensor) -> Tensor:
        """Features of edge images."""
        features: Tensor = normalize(self.layers((edges / 255.0 - MEAN) / STD))
        return features


def contrastive_loss(features: Tensor, others: Tensor) -> Tensor:
    """Contrastive loss of N similar pairs; the first of each and the second of the pair before are a dissimilar pair.

    Examples
    --------
    >>> one, two = torch.eye(2)[:1], torch.eye(2)[1:]
    >>> float(contrastive_loss(torch.cat([one, two]), torch.cat([one, two])))  # 0 apart within pairs, else 1.4
    0.0
    """
    like = torch.sum(torch.square(features - others), dim=1)
    unlike = torch.sqrt(torch.sum(torch.square(features - others.roll(1, dims=0)), dim=1) + 1e-12)
    return (torch.mean(like) + torch.mean(torch.square(relu(MARGIN - unlike)))) / 2.0


def trained(
    field: Field,
    draw: Draw,
    *,
    steps: int = STEPS,
    seed: int = 0,
    progress: Callable[[int, float], object] = lambda step, loss: None,
) -> SiameseNet:
    """Train a network on random cameras, with a one-cycle learning rate; the same for the same seed."""
    rng = np.random.default_rng(seed)
    torch.manual_seed(seed)
    pieces = ground_pieces(field)
    network = SiameseNet()
    optimizer = torch.optim.Adam(network.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    cycle = torch.optim.lr_scheduler.OneCycleLR(optimizer, LEARNING_RATE, total_steps=steps)
    for step in range(steps):
        cameras = draw(PAIRS, rng)
        views, others = (edge_images(each.homographies, pieces) for each in (cameras, nearby(cameras, rng)))
        views = np.concatenate([views, np.array([spoilt(other, rng) for other in others])])
        loss = contrastive_loss(*network(_tensor(views)).split(PAIRS))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        cycle.step()
        progress(step + 1, float(loss.detach()))
    network.eval()
    return network


def spoilt(edges: Edges, rng: np.random.Generator) -> Edges:
    """Degrade an edge image to look like a network's: lines thinner, thicker or blurred, gaps, a few false lines."""
    width, height = EDGE_SIZE
    image = edges.copy()
    for _ in range(rng.integers(4)):
        w, h = rng.integers(10, 80), rng.integers(10, 50)
        x, y = rng.integers(-w // 2, width - w // 2), rng.integers(-h // 2, height - h // 2)
        image[max(y, 0) : y + h, max(x, 0) : x + w] = 0
    for _ in range(rng.integers(3)):
        start = rng.integers((0, 0), EDGE_SIZE)
        cv2.line(image, start.tolist(), (start + rng.integers(-25, 26, 2)).tolist(), WHITE, 1, cv2.LINE_AA)
    style = rng.integers(4)
    if style > 0:
        image = np.where(image > rng.integers(60, 150), WHITE, 0).astype(np.uint8)
    if style == 2:
        image = np.asarray(cv2.dilate(image, np.ones((2, 2), np.uint8)), np.uint8)
    if style == 3:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 1.0)), np.uint8)
    return image


def _tensor(edges: Edges) -> Tensor:
    return torch.from_numpy(edges[:, None].astype(np.float32))


def write_model(network: SiameseNet, path: Path) -> None:
    """Write the network in ONNX, whole or not at all; `baselines.chen.features.Siamese` runs it."""
    width, height = EDGE_SIZE
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        # The exporter that is to replace this one needs another package, onnxscript.
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            network,
            (torch.zeros(1, 1, height, width),),
            str(Path(folder) / "siamese.onnx"),
            input_names=["edges"],
            output_names=["features"],
            dynamic_axes={name: {0: "batch"} for name in ("edges", "features")},
            opset_version=OPSET,
            dynamo=False,
        )
        write_bytes(path, (Path(folder) / "siamese.onnx").read_bytes())
