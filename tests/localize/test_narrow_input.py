"""Upright pictures, for which the input of the package's network has another size."""

import json
import pickle

import numpy as np
import pytest
from onnx_networks import DESCRIPTION, coloured, write_network

from data_tools.synthetic import frame
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.files import BrokenFileError
from fieldcalib.localize import SegmentationNetwork, localize
from fieldcalib.localize.network import Padded, as_frames

UPRIGHT = [(300, 400), (399, 400), (225, 400)]
WIDE = [(711, 400), (400, 400), (900, 400)]


@pytest.fixture(scope="module")
def network():
    return SegmentationNetwork.load(threads=1)


@pytest.mark.parametrize("size", UPRIGHT + WIDE)
def test_the_shape_of_a_picture_decides_the_size_of_the_input(network, size):
    probability = network([coloured(size)[0]])
    assert probability.shape == ((1, 27, 144, 112) if size in UPRIGHT else (1, 27, 96, 160))


@pytest.mark.parametrize("size", [UPRIGHT[0], WIDE[1]])
def test_where_narrow_pictures_are_padded_upright_ones_are_so_without_an_input_of_their_own(network, size):
    (image, _), wide = coloured(size), as_frames(network)
    assert np.array_equal(Padded(network)([image]), network([image])) == (size in UPRIGHT)
    assert not np.array_equal(Padded(wide)([image]), wide([image]))


def test_other_pictures_are_seen_as_if_there_were_one_size(network):
    image = frame(1).image
    (node,) = network.session.get_inputs()
    inputs = network._prepared([image], are_upright=False)
    assert inputs.shape == (1, 3, 192, 320)
    logits = network.session.run(None, {node.name: inputs})[0][0].astype(float)
    p = np.exp(logits - logits.max(axis=0))
    np.testing.assert_allclose(network([image])[0], p / p.sum(axis=0), atol=1e-6)


def test_pictures_of_both_kinds_are_each_seen_as_alone(network):
    pictures = [coloured(size)[0] for size in (WIDE[0], UPRIGHT[0], UPRIGHT[1], WIDE[1])]
    seen = []

    class Seen:
        classes = network.classes

        def __call__(self, images):
            seen.append([image.shape[1::-1] for image in images])
            return network(images)

    together = localize(soccer(), pictures, Seen())
    assert seen == [[WIDE[0]], [UPRIGHT[0], UPRIGHT[1]], [WIDE[1]]]
    for found, image in zip(together, pictures, strict=True):
        (alone,) = localize(soccer(), [image], network)
        assert found.pixels.keys() == alone.pixels.keys()
        assert all(np.array_equal(found.pixels[label], alone.pixels[label]) for label in alone.pixels)


def test_it_does_so_in_other_processes(network):
    image, _ = coloured(UPRIGHT[0])
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(network))([image]), network([image]))


def test_a_network_with_another_input_in_its_file_is_refused(tmp_path):
    path = write_network(tmp_path)
    for size, message in (
        ([48, 64], r"expected one float32 input of shape \(N, 3, 64, 48\)"),
        ([48], r"upright_input_size: "),
    ):
        path.with_suffix(".json").write_text(json.dumps(DESCRIPTION | {"upright_input_size": size}))
        with pytest.raises(BrokenFileError, match=message):
            SegmentationNetwork.load(path, threads=1)
