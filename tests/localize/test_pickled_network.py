"""Networks that go to other processes."""

import copy
import json
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from onnx_networks import DESCRIPTION, coloured, write_network

from fieldcalib.io.files import BrokenFileError
from fieldcalib.localize import SegmentationNetwork
from fieldcalib.localize.network import NetworkDescription


def in_another_process(network, images):
    """What a pickle of the network says there, by an executor whose process begins anew."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as executor:
        return executor.submit(network, images).result()


def test_a_pickled_network_says_the_same_in_another_process(tmp_path, monkeypatch):
    write_network(tmp_path)
    monkeypatch.chdir(tmp_path)
    network = SegmentationNetwork.load("colours.onnx", threads=1)
    monkeypatch.chdir(tmp_path.parent)  # its path is not relative to where a process happens to be
    images = [coloured((64, 36))[0]]
    assert np.array_equal(in_another_process(network, images), network(images))
    assert len(pickle.dumps(network)) < 2000


def test_the_shipped_network_is_pickled_without_a_path():
    network = SegmentationNetwork.load()
    read = pickle.loads(pickle.dumps(network))
    assert read.source == replace(network.source, threads=1)  # where others work beside it
    assert read.source.model is None
    image = coloured((640, 360))[0]
    assert np.array_equal(read([image]), network([image]))


def test_all_pickles_of_a_network_are_loaded_once(tmp_path, monkeypatch):
    import onnxruntime

    network = SegmentationNetwork.load(write_network(tmp_path))
    content, image, started = pickle.dumps(network), coloured((64, 36))[0], []

    class Session(onnxruntime.InferenceSession):
        def __init__(self, *arguments, **options):
            started.append(arguments)
            super().__init__(*arguments, **options)

    monkeypatch.setattr(onnxruntime, "InferenceSession", Session)
    for _ in range(3):
        pickle.loads(content)([image])
    assert len(started) == 1
    again = pickle.loads(pickle.dumps(pickle.loads(content)))
    assert again.source == replace(network.source, threads=1)


def test_a_copy_is_the_network_itself(tmp_path):
    network = SegmentationNetwork.load(write_network(tmp_path))
    assert copy.copy(network) is network
    assert copy.deepcopy({"network": network})["network"] is network


def test_a_pickled_network_whose_file_is_gone(tmp_path):
    network = SegmentationNetwork.load(write_network(tmp_path))
    (tmp_path / "colours.onnx").unlink()
    with pytest.raises(FileNotFoundError, match=r"cannot be loaded here: .*colours.onnx does not exist"):
        in_another_process(network, [])


def test_a_pickled_network_whose_file_has_changed(tmp_path):
    network = SegmentationNetwork.load(write_network(tmp_path))
    changed = DESCRIPTION | {"std": [0.5, 0.5, 0.5]}
    (tmp_path / "colours.json").write_text(json.dumps(changed))
    with pytest.raises(BrokenFileError, match=r"colours.onnx is not the network that was pickled"):
        in_another_process(network, [])


def test_a_session_of_somebody_else_cannot_be_pickled():
    network = SegmentationNetwork(NetworkDescription.parse(json.dumps(DESCRIPTION)), object())
    with pytest.raises(TypeError, match=r"SegmentationNetwork\.load gives one that can"):
        pickle.dumps(network)
