"""DeepLabV3 on a ResNet-101, with the names of torchvision, so that its checkpoints can be loaded.

Chen, Papandreou, Schroff, Adam: Rethinking Atrous Convolution for Semantic Image Segmentation (2017). The last two
stages of the ResNet keep the resolution of 1/8 and use dilations of 2 and 4 instead of strides; the head is an atrous
pyramid with rates 12, 24 and 36 and global average pooling.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, relu

BLOCKS = (3, 4, 23, 3)
WIDTHS = (64, 128, 256, 512)
STRIDES = (1, 2, 1, 1)
DILATIONS = ((1, 1), (1, 1), (1, 2), (2, 4))  # of the first block of each stage, and of the others
EXPANSION = 4
RATES = (12, 24, 36)
HEAD_WIDTH = 256


class DeepLabV3(nn.Module):
    """Logits (N, classes, H, W) of normalised images (N, 3, H, W)."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.backbone = _ResNet101()
        self.classifier = nn.Sequential(
            _AtrousPyramid(WIDTHS[-1] * EXPANSION),
            nn.Conv2d(HEAD_WIDTH, HEAD_WIDTH, 3, padding=1, bias=False),
            nn.BatchNorm2d(HEAD_WIDTH),
            nn.ReLU(),
            nn.Conv2d(HEAD_WIDTH, classes, 1),
        )

    def forward(self, image: Tensor) -> Tensor:
        """Logits of a batch of images."""
        logits = self.classifier(self.backbone(image))
        return interpolate(logits, size=image.shape[-2:], mode="bilinear", align_corners=False)


class _ResNet101(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, WIDTHS[0], 7, stride=2, padding=3, bias=False)
        self.bn1 = nn.BatchNorm2d(WIDTHS[0])
        self.maxpool = nn.MaxPool2d(3, stride=2, padding=1)
        inputs = WIDTHS[0]
        for index, (count, width, stride, (first, others)) in enumerate(
            zip(BLOCKS, WIDTHS, STRIDES, DILATIONS, strict=True), start=1
        ):
            blocks = [_Bottleneck(inputs, width, stride, first)]
            inputs = EXPANSION * width
            blocks += [_Bottleneck(inputs, width, 1, others) for _ in range(count - 1)]
            self.add_module(f"layer{index}", nn.Sequential(*blocks))

    def forward(self, x: Tensor) -> Tensor:
        x = self.maxpool(relu(self.bn1(self.conv1(x))))
        for index in range(1, len(BLOCKS) + 1):
            x = self.get_submodule(f"layer{index}")(x)
        return x


class _Bottleneck(nn.Module):
    """Convolutions 1 x 1, 3 x 3, 1 x 1 with a skip connection, which is projected where the shape changes."""

    def __init__(self, inputs: int, width: int, stride: int, dilation: int) -> None:
        super().__init__()
        outputs = EXPANSION * width
        self.conv1 = nn.Conv2d(inputs, width, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(width)
        self.conv2 = nn.Conv2d(width, width, 3, stride, padding=dilation, dilation=dilation, bias=False)
        self.bn2 = nn.BatchNorm2d(width)
        self.conv3 = nn.Conv2d(width, outputs, 1, bias=False)
        self.bn3 = nn.BatchNorm2d(outputs)
        self.downsample: nn.Module = nn.Identity()
        if inputs != outputs:
            self.downsample = nn.Sequential(nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs))

    def forward(self, x: Tensor) -> Tensor:
        y = relu(self.bn1(self.conv1(x)))
        y = relu(self.bn2(self.conv2(y)))
        return relu(self.bn3(self.conv3(y)) + self.downsample(x))


class _AtrousPyramid(nn.Module):
    def __init__(self, inputs: int) -> None:
        super().__init__()
        whole = nn.Sequential(nn.AdaptiveAvgPool2d(1), *_activated(inputs, HEAD_WIDTH, 1))
        spread = (nn.Sequential(*_activated(inputs, HEAD_WIDTH, 3, rate)) for rate in RATES)
        self.convs = nn.ModuleList([nn.Sequential(*_activated(inputs, HEAD_WIDTH, 1)), *spread, whole])
        self.project = nn.Sequential(*_activated(len(self.convs) * HEAD_WIDTH, HEAD_WIDTH, 1))

    def forward(self, x: Tensor) -> Tensor:
        seen = [convolution(x) for convolution in self.convs]
        seen[-1] = seen[-1].expand_as(seen[0])  # the mean, the same everywhere
        y: Tensor = self.project(torch.cat(seen, dim=1))
        return y


def _activated(inputs: int, outputs: int, size: int, dilation: int = 1) -> list[nn.Module]:
    padding = dilation * (size // 2)
    convolution = nn.Conv2d(inputs, outputs, size, padding=padding, dilation=dilation, bias=False)
    return [convolution, nn.BatchNorm2d(outputs), nn.ReLU()]
