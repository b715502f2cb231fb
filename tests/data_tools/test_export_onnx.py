"""data_tools.export_onnx: the network is the published one, and what is written gives what it gives."""

import json

import numpy as np
import pytest
import torch

from data_tools import deeplab
from data_tools.export_onnx import SOCCERNET_CLASSES, main, network_from_checkpoint
from data_tools.synthetic.games import game_named
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.localize import SegmentationNetwork, localize, ridge_points, skeleton_points


@pytest.fixture(scope="module")
def shallow():
    """The network with one block or two a stage: the same code, in a tenth of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(deeplab, "BLOCKS", (1, 1, 2, 2))
        yield


@pytest.fixture(scope="module")
def network(shallow):
    """The network with random weights."""
    torch.manual_seed(0)
    network = deeplab.DeepLabV3(1 + len(SOCCERNET_CLASSES)).eval()
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):  # nothing of them may get lost
            torch.nn.init.uniform_(module.running_mean, -0.1, 0.1)
            torch.nn.init.uniform_(module.running_var, 0.5, 1.5)
    return network


@pytest.fixture(scope="module")
def exported(network, tmp_path_factory):
    """MODEL.onnx of its checkpoint."""
    folder = tmp_path_factory.mktemp("exported")
    torch.save({"model": network.state_dict(), "epoch": 59}, folder / "checkpoint.pt")
    assert main([str(folder / "checkpoint.pt"), "--out", str(folder / "model.onnx")]) == 0
    return folder / "model.onnx"


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
def test_checkpoints_of_every_kind_hold_the_same_weights(network, prefix, wrapped):
    state = {prefix + name: value for name, value in network.state_dict().items()}
    state[prefix + "aux_classifier.4.bias"] = torch.zeros(29)
    found = network_from_checkpoint({"model": state, "epoch": 59} if wrapped else state)
    assert not found.training
    expected = network.state_dict()
    assert list(found.state_dict()) == list(expected)
    assert all(torch.equal(value, expected[name]) for name, value in found.state_dict().items())


@pytest.mark.slow
def test_what_is_written_gives_what_the_checkpoint_gives(network, exported):
    import onnxruntime

    about = json.loads(exported.with_suffix(".json").read_text())
    assert len(about["classes"]) == 29
    assert about["classes"][15:19] == ["Goal right post right", "background", "background", "Middle line"]
    assert about["input_size"] == [455, 256]
    session = onnxruntime.InferenceSession(exported, providers=["CPUExecutionProvider"])
    image = np.random.default_rng(0).normal(size=(2, 3, 256, 455)).astype(np.float32)
    (logits,) = session.run(["logits"], {"image": image})
    with torch.inference_mode():
        expected = network(torch.from_numpy(image)).numpy()
    assert logits.shape == (2, 29, 256, 455)
    assert np.ptp(expected) > 0.05
    assert np.abs(logits - expected).max() < 1e-4 * np.abs(expected).max()


@pytest.mark.slow
def test_what_is_written_can_be_run(exported):
    image = np.random.default_rng(0).integers(0, 256, size=(540, 960, 3), dtype=np.uint8)
    network = SegmentationNetwork.load(exported)
    for select in (ridge_points, skeleton_points):
        (found,) = localize(soccer(), [image], network, select=select)
        assert set(found.pixels) <= set(soccer())


def test_other_networks_are_refused(shallow):
    with pytest.raises(ValueError, match="not a DeepLabV3 with ResNet-101 and 29 classes"):
        network_from_checkpoint({"model": deeplab.DeepLabV3(3).state_dict()})
    with pytest.raises(ValueError, match="expected a state dict"):
        network_from_checkpoint({"model": 3})


@pytest.mark.slow
def test_networks_of_other_fields_have_their_classes(shallow, tmp_path):
    classes = game_named("padel").classes
    state = deeplab.DeepLabV3(1 + len(classes)).state_dict()
    torch.save(state, tmp_path / "checkpoint.pt")
    out = tmp_path / "model.onnx"
    assert main([str(tmp_path / "checkpoint.pt"), "--out", str(out), "--field", "padel"]) == 0
    assert SegmentationNetwork.load(out).classes == ("background", *classes)
    with pytest.raises(ValueError, match="29 classes"):
        network_from_checkpoint(state)
