"""A segmentation network as two files: MODEL.onnx, and beside it MODEL.json, the description of its input and output.

The input "image" is (N, 3, height, width), float32, ``(pixels / 255 - mean) / std`` in the order of `channels`; the
output "logits" is (N, classes, h, w), where h and w may be a fraction of the input's. N is free, and so are width and
height if upright pictures have a size of their own.
"""

from __future__ import annotations

import json
import tempfile
import warnings
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from fieldcalib._extras import missing

try:
    import onnx
except ModuleNotFoundError as error:
    raise missing(error, "train") from None

import torch
from torch import Tensor, nn

from data_tools.network import MarkingsNet
from fieldcalib._whole_files import write_bytes, write_text
from fieldcalib.localize import BACKGROUND
from fieldcalib.localize.network import UPRIGHT, NetworkDescription

CHANNELS = "RGB"
MEAN = (0.485, 0.456, 0.406)  # of ImageNet, as is usual
STD = (0.229, 0.224, 0.225)
OPSET = 17


def read_network(path: Path, images: Tensor) -> tuple[MarkingsNet, list[str]]:
    """A network to train on, rebuilt from what `write_model` wrote of a `MarkingsNet`, and its classes.

    In the file, normalisations are folded into the convolutions before them. Here each gets the mean and the variance
    that its input has over some images, and the scale and shift that undo them: the logits are the same to rounding,
    and training, which normalises by the batch, begins where the network is.

    Parameters
    ----------
    path : Path
        The .onnx file, with its .json beside it.
    images : (N, 3, H, W) tensor
        Normalised images; 16 are enough.

    Raises
    ------
    ValueError
        If the network in the file is another one.
    """
    classes = list(NetworkDescription.parse(path.with_suffix(".json").read_bytes()).classes[1:])
    graph = onnx.load(str(path)).graph
    weights = {one.name: torch.from_numpy(onnx.numpy_helper.to_array(one).copy()) for one in graph.initializer}
    nodes = [node for node in graph.node if node.op_type == "Conv"]
    network = MarkingsNet(1 + len(classes)).eval()
    called: list[Any] = []  # torch says of modules only that they are some
    _run_with(network, images[:1], nn.Conv2d, lambda module, _: called.append(module))
    shapes = [[*weights[node.input[1]].shape] for node in nodes]
    if shapes != [[*module.weight.shape] for module in called]:
        raise ValueError(f"{path} is no network of data_tools.train: its convolutions are others")
    after = _normalisations(network)
    with torch.no_grad():
        for node, module in zip(nodes, called, strict=True):
            module.weight.copy_(weights[node.input[1]])
            norm: Any = after.get(module)
            bias = weights[node.input[2]]
            if norm is None:
                module.bias.copy_(bias)
            else:
                norm.weight.fill_(1.0)
                norm.running_var.fill_(1.0 - norm.eps)
                norm.running_mean.zero_()
                norm.bias.copy_(bias)
        _run_with(network, images, nn.BatchNorm2d, _measure)
    return network, classes


def _normalisations(network: nn.Module) -> dict[nn.Module, Any]:
    """The normalisation after each convolution that has one."""
    parts = [list(one) for one in network.modules() if isinstance(one, nn.Sequential)]
    pairs = [pair for part in parts for pair in pairwise(part)]
    return {a: b for a, b in pairs if isinstance(a, nn.Conv2d) and isinstance(b, nn.BatchNorm2d)}


def _run_with(network: nn.Module, images: Tensor, kind: type[nn.Module], see: Callable[[Any, Tensor], object]) -> None:
    """Run a network, and show the modules of a kind with their input, in the order in which they are called."""
    handles = [
        one.register_forward_pre_hook(lambda module, inputs: see(module, inputs[0]) and None)
        for one in network.modules()
        if isinstance(one, kind)
    ]
    with torch.no_grad():
        network(images)
    for handle in handles:
        handle.remove()


def _measure(norm: Any, x: Tensor) -> None:
    """Give a normalisation that does nothing but shift the statistics of its input, so that it does the same."""
    mean, variance = x.mean((0, 2, 3)), x.var((0, 2, 3), unbiased=False)
    norm.bias.add_(mean)
    norm.weight.copy_(torch.sqrt(variance + norm.eps))
    norm.running_mean.copy_(mean)
    norm.running_var.copy_(variance)


def write_model(
    network: nn.Module,
    path: Path,
    classes: Sequence[str],
    size: tuple[int, int],
    upright_size: tuple[int, int] | None = None,
) -> None:
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
    upright_size : (int, int), optional
        The same for pictures that are higher than wide, if the network maps images of any size.
    """
    width, height = size
    free = {0: "batch"} if upright_size is None else {0: "batch", 2: "height", 3: "width"}
    axes = {"image": free, "logits": {axis: f"{name} of logits" if axis else name for axis, name in free.items()}}
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
    sizes = {"input_size": size} if upright_size is None else {"input_size": size, UPRIGHT: upright_size}
    about = {"classes": [BACKGROUND, *classes], **sizes, "mean": MEAN, "std": STD, "channels": CHANNELS}
    write_text(path.with_suffix(".json"), json.dumps(about, indent=1) + "\n")
