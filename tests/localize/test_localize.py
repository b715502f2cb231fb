"""From class probabilities to labelled pixels: where they lie, what they lead to, and what a network file may be."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from networks import CLASSES, FIELD, GRID, KnownCameras, band_maps, probabilities
from onnx_networks import DESCRIPTION, coloured, write_network
from views import camera

import fieldcalib
from fieldcalib.io.files import BrokenFileError
from fieldcalib.localize import SegmentationNetwork, localize, ridge_points, skeleton_points
from fieldcalib.localize.network import NetworkDescription, resized
from fieldcalib.localize.point_selection import image_from_grid
from fieldcalib.metrics.cameras import camera_difference
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.layout import Layout, theta_from_camera
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import pack
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.from_segments import calibrate_from_segments

HD = (1920, 1080)
VIEWS = {
    "penalty area": camera(28, 79, 1500, (0, 68, -17), k=(0.05, 0.0)),
    "midfield": camera(3, 76, 1100, (-2, 66, -16), roll=0.5, k=(0.03, 0.0)),
    "from the left": camera(42, 80, 1300, (-30, 62, -14), k=(0.04, 0.0)),
    "barrel": camera(-25, 77, 900, (0, 66, -16), k=(-0.15, 0.02)),
    "behind the goal": camera(88, 76, 900, (-80, 4, -16)),
}
CAMERAS = {name: view.scaled(HD) for name, view in VIEWS.items()}
any_view = pytest.mark.parametrize("truth", CAMERAS.values(), ids=CAMERAS)


def found_by(select, maps, image_size=HD):
    return select(maps, CLASSES, FIELD, image_size)


def distances(found, truth):
    """Distances in pixels of the points to their segments' true images, by label."""
    theta = theta_from_camera(truth)[None]
    result = {}
    for label, xy in found.pixels.items():
        observations = pack(FIELD, [{label: xy}], truth.image_size)
        problem = Problem(observations, Layout.of(truth.image_size), RobustLoss("linear", 1.0))
        result[label] = np.abs(evaluate(problem, theta).r[0])[: len(xy)]
    return result


def error(found, truth):
    """Root mean square distance between the images of the field's visible ground points, pixels.

    Clean maps are surer than a network's: with ten times the weight the camera's prior says nothing.
    """
    weights = {label: 10.0 * weight for label, weight in found.weights.items()}
    estimated = calibrate_from_segments(FIELD, found.pixels, HD, weights=weights).camera
    x, y = np.meshgrid(np.linspace(-52.5, 52.5, 106), np.linspace(-34.0, 34.0, 69))
    X = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    xy = truth.project(X)
    visible = np.all((xy >= 0.0) & (xy <= np.array(HD) - 1.0), axis=1)
    return np.sqrt(np.mean(np.sum(np.square(estimated.project(X[visible]) - xy[visible]), axis=1)))


def two_maps(plane, label="Middle line"):
    """Maps of the background and one class."""
    return np.stack([1.0 - plane, plane]).astype(np.float32), ("background", label)


# --- where points lie ---


def test_grid_pixels_lie_where_resizing_puts_them():
    image = np.zeros((90, 160), np.float32)
    image[40:50, 60:70] = 1.0  # centred at (64.5, 44.5)
    small = cv2.resize(image, (32, 18), interpolation=cv2.INTER_AREA)
    y, x = np.argwhere(small > 0.5).mean(axis=0)
    np.testing.assert_allclose(image_from_grid(np.array([x, y]), (32, 18), (160, 90)), (64.5, 44.5))


@any_view
def test_ridge_points_lie_on_their_segments(truth):
    step = HD[0] / GRID[0]
    for label, distance in distances(found_by(ridge_points, probabilities(band_maps(truth))), truth).items():
        assert np.median(distance) < (0.8 if label.startswith("Circle") else 0.35) * step, label


def test_a_lone_line_is_found_to_a_few_hundredths_of_a_pixel():
    truth = CAMERAS["barrel"]
    maps = band_maps(truth)
    maps[[label != "Side line top" for label in CLASSES]] = 0.0
    (distance,) = distances(found_by(ridge_points, probabilities(maps)), truth).values()
    assert np.max(distance) < 0.3  # 0.05 of the grid's pixels


@any_view
def test_the_camera_is_recovered(truth):
    assert error(found_by(ridge_points, probabilities(band_maps(truth, (640, 360)))), truth) < 0.8


@pytest.mark.slow
def test_ridges_are_more_accurate_than_skeletons():
    rng = np.random.default_rng(0)
    ridges, skeletons = [], []
    for truth in CAMERAS.values():
        for _ in range(2):
            maps = probabilities(band_maps(truth), rng, noise=0.7)
            ridges.append(error(found_by(ridge_points, maps), truth))
            skeletons.append(error(found_by(skeleton_points, maps), truth))
    assert np.median(ridges) < 0.5 * np.median(skeletons)


# --- ridge_points ---


def test_blobs_elsewhere_are_left_out():
    truth = CAMERAS["penalty area"]
    maps = band_maps(truth)
    clean = found_by(ridge_points, probabilities(maps))
    maps[CLASSES.index("Big rect. right main"), 150:155, 20:25] = 1.0
    maps[CLASSES.index("Circle right"), 160:164, 300:304] = 1.0
    spotted = found_by(ridge_points, probabilities(maps))
    for label in clean.pixels:
        np.testing.assert_allclose(spotted.pixels[label], clean.pixels[label], atol=0.5)


def test_a_line_that_players_interrupt_is_one_line():
    plane = np.zeros((180, 320))
    plane[88:91, 20:300] = 1.0
    plane[:, 100:112] = plane[:, 200:230] = 0.0
    found = ridge_points(*two_maps(plane), FIELD, (320, 180))
    x, y = found.pixels["Middle line"].T
    np.testing.assert_allclose(y, 89.0, atol=1e-6)
    assert x.min() < 40
    assert x.max() > 280


@any_view
def test_points_of_a_class_do_not_depend_on_other_classes(truth):
    maps = probabilities(band_maps(truth), np.random.default_rng(0), noise=0.7)
    together = found_by(ridge_points, maps)
    for label, xy in together.pixels.items():
        k = CLASSES.index(label)
        alone = ridge_points(maps[[0, k]], (CLASSES[0], label), FIELD, HD)
        np.testing.assert_allclose(alone.pixels[label], xy, atol=1e-6)
        np.testing.assert_allclose(alone.weights[label], together.weights[label], atol=1e-9)


def test_slices_that_the_border_cuts_are_left_out():
    plane = np.zeros((180, 320))
    for x in range(320):
        plane[max(0, x - 101) : max(0, x - 98), x] = 1.0  # y = x - 100, out of the top and the bottom
    found = ridge_points(*two_maps(plane), FIELD, (320, 180))
    x, y = found.pixels["Middle line"].T
    np.testing.assert_allclose(y, x - 100.0, atol=0.05)


def test_weights_grow_with_length_and_certainty():
    def total(columns, p):
        plane = np.zeros((180, 320))
        plane[88:91, 20 : 20 + columns] = p
        return np.mean(ridge_points(*two_maps(plane), FIELD, (320, 180)).weights["Middle line"])

    assert total(200, 1.0) == pytest.approx(0.6)
    assert total(200, 0.6) == pytest.approx(0.36, rel=1e-5)
    assert total(15, 1.0) < 0.3


@pytest.mark.parametrize("plane", [np.zeros((180, 320)), np.full((180, 320), 0.4)], ids=["nothing", "unsure"])
def test_nothing_certain_gives_nothing(plane):
    assert ridge_points(*two_maps(plane), FIELD, (320, 180)).pixels == {}


@pytest.mark.parametrize("label", ["Middle line", "Circle central"])
@pytest.mark.parametrize("shape", [(1, 320), (2, 2), (1, 5), (180, 1)])
def test_odd_shapes_do_no_harm(label, shape):
    plane = np.zeros((180, 320))
    plane[: shape[0], : shape[1]] = 1.0
    for select in (ridge_points, skeleton_points):
        found = select(*two_maps(plane, label), FIELD, (320, 180))
        assert all(np.all(np.isfinite(xy)) for xy in found.pixels.values())


def test_the_same_maps_give_the_same_points():
    maps = probabilities(band_maps(CAMERAS["midfield"]))
    first, second = found_by(ridge_points, maps), found_by(ridge_points, maps)
    for label, xy in first.pixels.items():
        np.testing.assert_array_equal(xy, second.pixels[label])


# --- skeleton_points ---


def test_the_papers_numbers_of_points_and_its_split_circle():
    found = found_by(skeleton_points, probabilities(band_maps(CAMERAS["midfield"])))
    assert len(found.pixels["Middle line"]) == 4
    assert len(found.pixels["Circle central left"]) + len(found.pixels["Circle central right"]) == 8


def test_a_skeleton_reaches_from_end_to_end():
    plane = np.zeros((180, 320))
    plane[88:91, 20:300] = 1.0
    x = skeleton_points(*two_maps(plane), FIELD, (320, 180)).pixels["Middle line"][:, 0]
    np.testing.assert_allclose(np.sort(x), [21, 113, 206, 298], atol=2.0)


# --- what does not fit ---


@pytest.mark.parametrize("select", [ridge_points, skeleton_points])
def test_maps_and_classes_must_agree(select):
    maps = np.zeros((2, 18, 32), np.float32)
    with pytest.raises(ValueError, match=r"expected probabilities of shape \(1, height, width\).*\(2, 18, 32\)"):
        select(maps, ("background",), FIELD, HD)
    with pytest.raises(ValueError, match="class 'Touch line' is not a segment of the object"):
        select(maps, ("background", "Touch line"), FIELD, HD)


def test_a_class_called_background_is_left_out():
    plane = np.zeros((180, 320), np.float32)
    plane[88:91] = 1.0
    assert ridge_points(np.stack([1.0 - plane, plane]), ("background", "background"), FIELD, HD).pixels == {}


# --- localize ---


def test_frames_of_several_sizes_are_calibrated():
    truths = [CAMERAS["penalty area"], CAMERAS["midfield"].scaled((1280, 720))]
    images = [np.zeros((*truth.image_size[::-1], 3), np.uint8) for truth in truths]
    found = localize(FIELD, images, KnownCameras(truths))
    for truth, one in zip(truths, found, strict=True):
        (calibration,) = calibrate_batch(FIELD, [one.pixels], truth.image_size, weights=[one.weights])
        assert calibration.accepted
        assert camera_difference(calibration.camera, truth, FIELD).reprojection < 12.0


def test_no_images_no_network():
    assert localize(FIELD, [], KnownCameras([])) == []


# --- a network's JSON ---


def test_an_image_alone_is_no_list_of_images():
    with pytest.raises(
        ValueError, match=r"expected a list of images, got one array of shape \(9, 16, 3\): give \[image\]"
    ):
        localize(FIELD, np.zeros((9, 16, 3), np.uint8), KnownCameras([None]))


def test_description():
    found = NetworkDescription.parse(json.dumps(DESCRIPTION))
    assert found.classes == ("background", "Middle line", "Side line top")
    assert found.input_size == (64, 36)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"classes": []}, "classes: expected a list of names"),
        ({"classes": "background"}, "classes: expected a list of names"),
        (
            {"classes": ["background", "background", "Middle line", "Middle line"]},
            "classes: 'Middle line' occurs twice",
        ),
        ({"channels": "rgb"}, 'channels: expected "RGB" or "BGR", got \'rgb\''),
        ({"input_size": [64]}, r"input_size: expected \[width, height\] in whole pixels, got \[64\]"),
        ({"mean": [0.5]}, "mean: expected three numbers"),
        ({"std": [0.5, None, 1.0]}, "std: expected three numbers"),
        ({"std": [0.5, 0.0, 1.0]}, "std: expected positive numbers"),
    ],
)
def test_description_errors(change, complaint):
    with pytest.raises(BrokenFileError, match=complaint):
        NetworkDescription.parse(json.dumps(DESCRIPTION | change))


# --- networks in ONNX ---


@pytest.mark.parametrize("batch", ["N", 1])
def test_a_network_finds_colours_where_they_are(tmp_path, batch):
    network = SegmentationNetwork.load(write_network(tmp_path, batch=batch), threads=1)
    pictures = [coloured((1280, 720)), coloured((640, 360)), coloured((48, 27))]
    maps = network([image for image, _ in pictures])
    assert maps.shape == (3, 3, 18, 32)
    np.testing.assert_allclose(maps.sum(axis=1), 1.0, atol=1e-6)
    for (image, (x, y)), found in zip(
        pictures[:2], localize(FIELD, [p for p, _ in pictures[:2]], network), strict=True
    ):
        grid_pixel = image.shape[1] / 32
        np.testing.assert_allclose(found.pixels["Middle line"][:, 0], x, atol=0.05 * grid_pixel)
        np.testing.assert_allclose(found.pixels["Side line top"][:, 1], y, atol=0.05 * grid_pixel)


@pytest.mark.parametrize("size", [(1080, 1920), (1081, 1921), (2160, 3840), (720, 1280), (540, 960)])
def test_a_smaller_image_has_means_of_pixels(size):
    """To what rounding twice does."""
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.integers(0, 256, (*size, 3), dtype=np.uint8), (0, 0), 4.0)
    exact = cv2.resize(image.astype(np.float32), (320, 192), interpolation=cv2.INTER_AREA)
    difference = resized(image, (320, 192)) - exact
    assert abs(np.mean(difference)) < 0.35  # a mean of four that ends in a half is rounded up
    assert np.sqrt(np.mean(np.square(difference))) < 0.6


def test_a_larger_image_is_interpolated():
    assert resized(np.full((20, 30, 3), 7, np.uint8), (320, 192)).shape == (192, 320, 3)
    assert np.all(resized(np.full((20, 30, 3), 7, np.uint8), (320, 192)) == 7)


def test_channels_are_the_networks(tmp_path):
    path = write_network(tmp_path)
    red = np.zeros((36, 64, 3), np.uint8)
    red[..., 2] = 255
    assert SegmentationNetwork.load(path)([red])[0, 1].min() > 0.9
    path.with_suffix(".json").write_text(json.dumps(DESCRIPTION | {"channels": "BGR"}))
    assert SegmentationNetwork.load(path)([red])[0, 1].max() < 0.1


def test_images_are_checked(tmp_path):
    with pytest.raises(ValueError, match="image must be uint8, got float64"):
        SegmentationNetwork.load(write_network(tmp_path))([np.zeros((36, 64, 3))])


def move_weight(path, location):
    """Let a network read its weight from a file beside it, or elsewhere."""
    import onnx

    model = onnx.load(path)
    (weight,) = (w for w in model.graph.initializer if w.name == "weight")
    (path.parent / location).write_bytes(weight.raw_data)
    onnx.external_data_helper.set_external_data(weight, location)
    weight.ClearField("raw_data")
    path.write_bytes(model.SerializeToString())


@pytest.mark.parametrize("location", ["../weight.bin", "link.bin"])
def test_a_network_reads_nothing_outside_its_folder(tmp_path, location):
    """A vulnerability of onnxruntime before 1.24."""
    folder = tmp_path / "model"
    folder.mkdir()
    path = write_network(folder)
    move_weight(path, "weight.bin")
    assert SegmentationNetwork.load(path).classes == tuple(DESCRIPTION["classes"])
    (tmp_path / "weight.bin").write_bytes((folder / "weight.bin").read_bytes())
    (folder / "link.bin").symlink_to(tmp_path / "weight.bin")
    move_weight(path, location)
    with pytest.raises(BrokenFileError, match="onnxruntime cannot load it"):
        SegmentationNetwork.load(path)


def test_an_output_without_a_map_for_each_class(tmp_path):
    network = SegmentationNetwork.load(write_network(tmp_path, outputs=2))
    with pytest.raises(ValueError, match=r"names 3 classes.*\(N, 3, h, w\), got \(1, 2, 18, 32\)"):
        network([np.zeros((36, 64, 3), np.uint8)])


def test_a_network_that_fails():
    class Session:
        def get_inputs(self):
            return [SimpleNamespace(name="image", shape=["N", 3, 36, 64])]

        def run(self, outputs, inputs):
            raise RuntimeError("out of memory")

    network = SegmentationNetwork(NetworkDescription.parse(json.dumps(DESCRIPTION)), Session())
    with pytest.raises(ValueError, match=r"the network fails on input of shape \(1, 3, 36, 64\): out of memory"):
        network([np.zeros((36, 64, 3), np.uint8)])


@pytest.mark.parametrize("options", [{"size": (32, 36)}, {"batch": 2}, {"kind": 10}], ids=["size", "batch", "float16"])
def test_an_input_that_the_json_does_not_describe(tmp_path, options):
    with pytest.raises(BrokenFileError, match=r"expected one float32 input of shape \(N, 3, 36, 64\), got|cannot load"):
        SegmentationNetwork.load(write_network(tmp_path, **options))


def test_missing_and_broken_files(tmp_path, monkeypatch):
    with pytest.raises(FileNotFoundError, match=r"none\.onnx does not exist: expected a network in ONNX"):
        SegmentationNetwork.load(tmp_path / "none.onnx")
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"no network")
    with pytest.raises(FileNotFoundError, match=r"broken\.json does not exist"):
        SegmentationNetwork.load(broken)
    broken.with_suffix(".json").write_text(json.dumps(DESCRIPTION))
    with pytest.raises(BrokenFileError, match="onnxruntime cannot load it"):
        SegmentationNetwork.load(broken)
    broken.with_suffix(".json").write_text("{")
    with pytest.raises(BrokenFileError, match=r"broken\.json: is no JSON"):
        SegmentationNetwork.load(broken)
    monkeypatch.setattr("fieldcalib.localize.network.SHIPPED", tmp_path / "soccer.onnx")
    with pytest.raises(FileNotFoundError, match=r"this installation has no network \(.*soccer\.onnx is missing\)"):
        SegmentationNetwork.load()


def test_the_shipped_network_is_the_default(tmp_path, monkeypatch):
    monkeypatch.setattr("fieldcalib.localize.network.SHIPPED", write_network(tmp_path))
    assert SegmentationNetwork.load().classes == tuple(DESCRIPTION["classes"])


def test_a_provider_that_is_not_there(tmp_path):
    with pytest.raises(ValueError, match=r"no 'NoExecutionProvider' here, only .*CPUExecutionProvider"):
        SegmentationNetwork.load(write_network(tmp_path), provider="NoExecutionProvider")


def test_threads(tmp_path):
    with pytest.raises(ValueError, match="threads must be a whole number from 1, got 0"):
        SegmentationNetwork.load(write_network(tmp_path), threads=0)


def test_no_more_threads_than_cores(tmp_path, monkeypatch):
    """Thousands of threads are started one by one, and hardly ever end."""
    import onnxruntime

    started = []

    def session(path, options, providers):
        started.append(options.intra_op_num_threads)
        raise RuntimeError("not started")

    monkeypatch.setattr(onnxruntime, "InferenceSession", session)
    for threads in (1, 2000):
        with pytest.raises(BrokenFileError, match="not started"):
            SegmentationNetwork.load(write_network(tmp_path), threads=threads)
    assert started == [1, os.cpu_count()]


WITHOUT_SOCKETS = """
import socket, sys
from pathlib import Path
def refuse(*arguments, **options):
    raise AssertionError("it opens a socket")
socket.socket = socket.create_connection = socket.getaddrinfo = refuse
from fieldcalib.localize import SegmentationNetwork
import numpy as np
network = SegmentationNetwork.load(sys.argv[1])
network([np.zeros((36, 64, 3), np.uint8)])
print("done")
"""


def test_onnxruntime_keeps_no_id_and_calls_nobody(tmp_path):
    """It writes its id when it is loaded, and calls its host some seconds later if it has one."""
    model, home = write_network(tmp_path), tmp_path / "home"
    home.mkdir()
    folders = {name: str(home / name) for name in ("XDG_CACHE_HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME")}
    environment = {key: value for key, value in os.environ.items() if key != "ORT_DISABLE_TELEMETRY"}
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_SOCKETS, str(model)],
        capture_output=True,
        text=True,
        env=environment | folders | {"HOME": str(home), "TMPDIR": str(home)},
        cwd=Path(fieldcalib.__file__).parents[1],
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")
    assert list(home.rglob("*")) == []


@pytest.mark.filterwarnings("ignore:Specified provider")
def test_a_provider_that_does_not_start_is_not_replaced(tmp_path, monkeypatch):
    path = write_network(tmp_path)
    import onnxruntime

    claimed = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: claimed)
    with pytest.raises(ValueError, match="'CUDAExecutionProvider' does not start"):
        SegmentationNetwork.load(path, provider="CUDAExecutionProvider")
