"""The two networks: ResNet-18 (He et al., CVPR 2016), as wide as in the paper or narrower."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import adaptive_avg_pool2d
from torch.nn.utils.parametrizations import spectral_norm

from baselines.jiang.four_points import CANONICAL, field_drawing, homography_of_points, warped_field
from fieldcalib.io.image_files import Image

WIDTH = 64  # channels of ResNet-18's first stage
SIZE = 256  # px: width and height of the pictures


class GuessNetwork(nn.Module):
    """Predicts four points on the field (N, 4, 2) from pictures (N, 3, SIZE, SIZE).

    Examples
    --------
    >>> GuessNetwork(4)(torch.rand(2, 3, 64, 64)).shape
    torch.Size([2, 4, 2])
    """

    def __init__(self, width: int = WIDTH, size: int = SIZE) -> None:
        super().__init__()
        self.width, self.size = width, size
        self.features = _resnet18(3, width, spectral=False)
        self.head = nn.Linear(8 * width, CANONICAL.size)

    def forward(self, pictures: Tensor) -> Tensor:
        """Points (N, 4, 2) in the coordinates of `four_points`."""
        smaller = adaptive_avg_pool2d(normalised(pictures), self.size)
        points: Tensor = self.head(self.features(smaller).float())
        return points.view(-1, *CANONICAL.shape)


class ErrorNetwork(nn.Module):
    """Predicts the error 1 - IoU, (N,), of four points (N, 4, 2) in pictures (N, 3, SIZE, SIZE).

    Every layer has spectral normalisation (Miyato et al., ICLR 2018), which keeps gradients small enough for descent.

    Examples
    --------
    >>> points = torch.as_tensor(0.3 * CANONICAL, dtype=torch.float32)[None]
    >>> ErrorNetwork(4)(torch.rand(1, 3, 64, 64), points).shape
    torch.Size([1])
    """

    drawing: Tensor

    def __init__(self, width: int = WIDTH, size: int = SIZE) -> None:
        super().__init__()
        self.features = _resnet18(6, width, spectral=True)
        self.head = spectral_norm(nn.Linear(8 * width, 1))
        self.width, self.size = width, size
        self.register_buffer("drawing", torch.as_tensor(field_drawing(), dtype=torch.float32), persistent=False)

    def forward(self, pictures: Tensor, points: Tensor) -> Tensor:
        """Predicted errors (N,), differentiable by the points."""
        smaller = adaptive_avg_pool2d(normalised(pictures), self.size)
        warped = warped_field(homography_of_points(points), self.drawing, self.size)
        features = self.features(torch.cat([smaller, warped], dim=1))
        return torch.sigmoid(self.head(features.float())[:, 0])


def squashed(image: Image) -> Image:
    """Resize an image to the networks' input, SIZE x SIZE."""
    if image.shape[:2] == (SIZE, SIZE):
        return image
    return np.asarray(cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_AREA), np.uint8)


def normalised(pictures: Tensor) -> Tensor:
    """Scale each picture of (N, 3, H, W) to mean 0 and standard deviation 1."""
    deviation, mean = torch.std_mean(pictures.float(), dim=(1, 2, 3), keepdim=True)
    return (pictures.float() - mean) / (deviation + 1e-6)


class _Block(nn.Module):
    """Residual block: two convolutions and a shortcut."""

    def __init__(self, inputs: int, outputs: int, stride: int, *, spectral: bool) -> None:
        super().__init__()
        self.residual = nn.Sequential(
            *_convolution(inputs, outputs, 3, stride, spectral=spectral),
            nn.ReLU(inplace=True),
            *_convolution(outputs, outputs, 3, 1, spectral=spectral),
        )
        same = stride == 1 and inputs == outputs
        self.shortcut = nn.Sequential(*([] if same else _convolution(inputs, outputs, 1, stride, spectral=spectral)))
        self.active = nn.ReLU(inplace=True)

    def forward(self, x: Tensor) -> Tensor:
        y: Tensor = self.active(self.shortcut(x) + self.residual(x))
        return y


def _resnet18(inputs: int, width: int, *, spectral: bool) -> nn.Sequential:
    """Layers that map pictures to features (N, 8 width)."""
    layers = [*_convolution(inputs, width, 7, 2, spectral=spectral), nn.ReLU(inplace=True), nn.MaxPool2d(3, 2, 1)]
    channels = width
    for stage in range(4):
        outputs = width << stage
        layers.append(_Block(channels, outputs, 1 if stage == 0 else 2, spectral=spectral))
        layers.append(_Block(outputs, outputs, 1, spectral=spectral))
        channels = outputs
    return nn.Sequential(*layers, nn.AdaptiveAvgPool2d(1), nn.Flatten())


def _convolution(inputs: int, outputs: int, size: int, stride: int, *, spectral: bool) -> list[nn.Module]:
    convolution = nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False)
    return [spectral_norm(convolution) if spectral else convolution, nn.BatchNorm2d(outputs)]
