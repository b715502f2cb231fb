"""A small network that segments the markings: a U-Net of depthwise-separable blocks.

Features have 1/2 to 1/32 of the image's resolution. The receptive field of the coarsest blocks is the whole image, and
a global mean is added: what tells the left from the right penalty area may be far from its lines.
"""

from __future__ import annotations

from itertools import pairwise

from torch import Tensor, nn
from torch.nn.functional import interpolate

CHANNELS = (16, 24, 48, 96, 160)  # at 1/2, 1/4, ... 1/32
BLOCKS = (1, 2, 4, 6)  # of the encoder, at 1/4 ... 1/32
EXPANSION = 2
STRIDE = 2  # of the logits, in pixels of the image


class MarkingsNet(nn.Module):
    """Logits (N, classes, H / 2, W / 2) of normalised images (N, 3, H, W); H and W are multiples of 32.

    Examples
    --------
    >>> import torch
    >>> MarkingsNet(27)(torch.zeros(1, 3, 64, 96)).shape
    torch.Size([1, 27, 32, 48])
    """

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.stem = _convolution(3, CHANNELS[0], size=5, stride=2)
        steps = list(pairwise(CHANNELS))
        self.down = nn.ModuleList(
            nn.Sequential(_halved(fine, coarse), *[_Block(coarse, size=5) for _ in range(count)])
            for (fine, coarse), count in zip(steps, BLOCKS, strict=True)
        )
        self.whole = nn.Conv2d(CHANNELS[-1], CHANNELS[-1], 1)
        self.narrow = nn.ModuleList(nn.Conv2d(coarse, fine, 1) for fine, coarse in steps)
        self.up = nn.ModuleList(_Block(fine, size=3) for fine in CHANNELS[:-1])
        self.head = nn.Conv2d(CHANNELS[0], classes, 1)

    def forward(self, image: Tensor) -> Tensor:
        """Logits of a batch of images."""
        features: list[Tensor] = [self.stem(image)]
        for stage in self.down:
            features.append(stage(features[-1]))
        x = features.pop()
        x = x + self.whole(x.mean((2, 3), keepdim=True))
        for narrow, block in zip(reversed(self.narrow), reversed(self.up), strict=True):
            x = block(features.pop() + interpolate(narrow(x), scale_factor=2.0, mode="bilinear"))
        logits: Tensor = self.head(x)
        return logits


class _Block(nn.Module):
    """An inverted residual block: a depthwise convolution, then two of size 1 with more channels in between."""

    def __init__(self, channels: int, size: int) -> None:
        super().__init__()
        self.residual = nn.Sequential(
            _convolution(channels, channels, size=size, groups=channels, active=False),
            _convolution(channels, EXPANSION * channels),
            _convolution(EXPANSION * channels, channels, active=False),
        )

    def forward(self, x: Tensor) -> Tensor:
        y: Tensor = x + self.residual(x)
        return y


def _convolution(
    inputs: int, outputs: int, *, size: int = 1, stride: int = 1, groups: int = 1, active: bool = True
) -> nn.Sequential:
    convolution = nn.Conv2d(inputs, outputs, size, stride, size // 2, groups=groups, bias=False)
    layers = [convolution, nn.BatchNorm2d(outputs)]
    return nn.Sequential(*layers, nn.ReLU(inplace=True)) if active else nn.Sequential(*layers)


def _halved(inputs: int, outputs: int) -> nn.Sequential:
    """Half the resolution, and more channels."""
    return nn.Sequential(
        _convolution(inputs, inputs, size=3, stride=2, groups=inputs, active=False), _convolution(inputs, outputs)
    )
