"""A segmentation network as two files: MODEL.onnx, and beside it MODEL.json, the description of its input and output.

The input "image" is (N, 3, height, width), float32, ``(pixels / 255 - mean) / std`` in the order of `channels`; the
output "logits" is (N, classes, h, w), where h and w may be a fraction of the input's. N is free.
"""

from __future__ import annotations

import json
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path

import torch
from torch import nn

from fieldcalib.io.files import write_bytes, write_text
from fieldcalib.localize import BACKGROUND

CHANNELS = "RGB"
MEAN = (0.485, 0.456, 0.406)  # of ImageNet, as is usual
STD = (0.229, 0.224, 0.225)
OPSET = 17


def write_model(network: nn.Module, path: Path, classes: Sequence[str], size: tuple[int, int]) -> None:
    """Write ``path`` (.onnx) and the .json file beside it, each atomically.

    Parameters
    ----------
    network : nn.Module
        In evaluation mode; maps images to logits.
    path : Path
    classes : sequence of str
        Names of the classes from 1 on; class 0 is the background.
    size : (int, int)
        Width and height of the input in pixels.
    """
    width, height = size
    axes = {name: {0: "batch"} for name in ("image", "logits")}
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        # PyTorch's newer exporter needs another package, onnxscript.
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            network,
            (torch.zeros(1, 3, height, width),),
            str(Path(folder) / path.name),
            input_names=["image"],
            output_names=["logits"],
            dynamic_axes=axes,
            opset_version=OPSET,
            dynamo=False,
        )
        write_bytes(path, (Path(folder) / path.name).read_bytes())
    about = {"classes": [BACKGROUND, *classes], "input_size": size, "mean": MEAN, "std": STD, "channels": CHANNELS}
    write_text(path.with_suffix(".json"), json.dumps(about, indent=1) + "\n")
