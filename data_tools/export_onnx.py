"""Turn a segmentation checkpoint into ONNX: DeepLabV3 with ResNet-101, 455 x 256, as those published for soccer.

    python -m data_tools.export_onnx CHECKPOINT.pt --out MODEL.onnx

Its classes are SoccerNet's, or, with --field, those of the masks of `data_tools.synthetic --field` in their order.

A checkpoint is a state dict with torchvision's names, or holds one as "model"; a prefix "module." is removed, and
the auxiliary classifier, which is used in training only, is ignored.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from fieldcalib._extras import missing

try:
    import torch
except ModuleNotFoundError as error:
    raise missing(error, "train") from None

from torch import Tensor

from data_tools.deeplab import DeepLabV3
from data_tools.onnx_model import write_model
from data_tools.synthetic import CLASSES
from data_tools.synthetic.games import game_named
from fieldcalib.console.arguments import SOCCER, add_named_field
from fieldcalib.localize import BACKGROUND

SIZE = (455, 256)
# The classes of SoccerNet's calibration from 1 on, in order: those that are annotated, and two for
# segments that annotators could not identify.
UNKNOWN = ("Goal unknown", "Line unknown")
SOCCERNET_CLASSES = tuple(sorted((*CLASSES, *UNKNOWN)))
AUXILIARY = "aux_classifier."


def network_from_checkpoint(checkpoint: Mapping[str, object], classes: int = len(SOCCERNET_CLASSES)) -> DeepLabV3:
    """The network with the weights of a checkpoint for `classes` and the background, in evaluation mode.

    Raises
    ------
    ValueError
        If the weights do not fit this network.
    """
    state = checkpoint.get("model", checkpoint)
    if not isinstance(state, Mapping):
        raise ValueError(f'expected a state dict as "model", got {type(state).__name__}')
    weights: dict[str, Tensor] = {name.removeprefix("module."): value for name, value in state.items()}
    weights = {name: value for name, value in weights.items() if not name.startswith(AUXILIARY)}
    network = DeepLabV3(1 + classes)
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        raise ValueError(
            f"the checkpoint is not a DeepLabV3 with ResNet-101 and {1 + classes} classes: {error}"
        ) from error
    network.eval()
    return network


def main(arguments: Sequence[str] | None = None) -> int:
    """Write MODEL.onnx and MODEL.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--out", type=Path, required=True, metavar="MODEL.onnx")
    add_named_field(parser)
    options = parser.parse_args(arguments)
    checkpoint = torch.load(options.checkpoint, map_location="cpu", weights_only=True)
    classes = SOCCERNET_CLASSES if options.field == SOCCER else game_named(options.field).classes
    names = [BACKGROUND if name in UNKNOWN else name for name in classes]
    write_model(network_from_checkpoint(checkpoint, len(classes)), options.out, names, SIZE)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
