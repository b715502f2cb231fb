"""data_tools.export_onnx: the network is the published one, and what is written gives what it gives."""

import json

import numpy as np
import pytest
import torch

from data_tools import deeplab
from data_tools.export_onnx import SOCCERNET_CLASSES, main, network_of
from fieldcalib.fields.soccer import soccer
from fieldcalib.localize import SegmentationNetwork, localize, ridge_points, skeleton_points


@pytest.fixture
def shallow(monkeypatch):
    """The network with one block or two a stage: the same code, in a tenth of the time."""
    monkeypatch.setattr(deeplab, "BLOCKS", (1, 1, 2, 2))


def random_network():
    torch.manual_seed(0)
    network = deeplab.DeepLabV3(1 + len(SOCCERNET_CLASSES)).eval()
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):  # nothing of them may get lost
            torch.nn.init.uniform_(module.running_mean, -0.1, 0.1)
            torch.nn.init.uniform_(module.running_var, 0.5, 1.5)
    return network


def test_classes_are_those_of_soccernet_in_its_order():
    assert len(SOCCERNET_CLASSES) == 28
    assert SOCCERNET_CLASSES[0] == "Big rect. left bottom"
    assert SOCCERNET_CLASSES[15:18] == ("Goal unknown", "Line unknown", "Middle line")
    assert SOCCERNET_CLASSES[27] == "Small rect. right top"


def test_the_network_has_as_many_parameters_as_the_published_one():
    # torchvision gives 60 996 202 for 21 classes, of which the auxiliary classifier has these
    auxiliary = 1024 * 256 * 9 + 2 * 256 + 256 * 21 + 21
    network = deeplab.DeepLabV3(21)
    assert sum(p.numel() for p in network.parameters()) == 60_996_202 - auxiliary
    stages = [getattr(network.backbone, f"layer{index}") for index in (1, 2, 3, 4)]
    dilations = [[block.conv2.dilation[0] for block in stage] for stage in stages]
    assert dilations == [[1] * 3, [1] * 4, [1] + [2] * 22, [2, 4, 4]]
    assert {"backbone.layer3.22.bn3.weight", "backbone.layer2.0.downsample.0.weight", "classifier.4.bias"} <= set(
        network.state_dict()
    )


@pytest.mark.parametrize("prefix", ["", "module."])
@pytest.mark.parametrize("wrapped", [False, True], ids=["state", "model"])
def test_what_is_written_gives_what_the_checkpoint_gives(tmp_path, shallow, prefix, wrapped):
    import onnxruntime

    network = random_network()
    state = {prefix + name: value for name, value in network.state_dict().items()}
    state[prefix + "aux_classifier.4.bias"] = torch.zeros(29)
    torch.save({"model": state, "epoch": 59} if wrapped else state, tmp_path / "checkpoint.pt")
    assert main([str(tmp_path / "checkpoint.pt"), "--out", str(tmp_path / "model.onnx")]) == 0

    about = json.loads((tmp_path / "model.json").read_text())
    assert len(about["classes"]) == 29
    assert about["classes"][15:19] == ["Goal right post right", "background", "background", "Middle line"]
    assert about["input_size"] == [455, 256]
    session = onnxruntime.InferenceSession(tmp_path / "model.onnx", providers=["CPUExecutionProvider"])
    image = np.random.default_rng(0).normal(size=(2, 3, 256, 455)).astype(np.float32)
    (logits,) = session.run(["logits"], {"image": image})
    with torch.inference_mode():
        expected = network(torch.from_numpy(image)).numpy()
    assert logits.shape == (2, 29, 256, 455)
    assert np.ptp(expected) > 0.05
    assert np.abs(logits - expected).max() < 1e-4 * np.abs(expected).max()


def test_what_is_written_can_be_run(tmp_path, shallow):
    torch.save(random_network().state_dict(), tmp_path / "checkpoint.pt")
    main([str(tmp_path / "checkpoint.pt"), "--out", str(tmp_path / "model.onnx")])
    image = np.random.default_rng(0).integers(0, 256, size=(540, 960, 3), dtype=np.uint8)
    network = SegmentationNetwork.load(tmp_path / "model.onnx")
    for select in (ridge_points, skeleton_points):
        (found,) = localize(soccer(), [image], network, select=select)
        assert set(found.pixels) <= set(soccer())


def test_other_networks_are_refused(shallow):
    with pytest.raises(ValueError, match="no DeepLabV3 with ResNet-101 and 29 classes"):
        network_of({"model": deeplab.DeepLabV3(3).state_dict()})
    with pytest.raises(ValueError, match="expected a state dict"):
        network_of({"model": 3})
