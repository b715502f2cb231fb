"""Chen and Little's method: edge images, features, the database, refinement, and the command line."""

import importlib.util
import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baselines.chen import command
from baselines.chen.cameras import DRAWS, IMAGE_SIZE, Cameras, cameras_of_chen, nearby
from baselines.chen.database import Database
from baselines.chen.edges import (
    EDGE_SIZE,
    edge_images,
    edges_of_mask,
    edges_of_pixels,
    edges_of_probabilities,
    ground_pieces,
    is_on_ground,
    scaling,
)
from baselines.chen.features import Hog, Siamese
from baselines.chen.search import PUBLISHED, WIDER, homography
from fieldcalib import Camera, soccer
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.soccernet import camera_from_record, format_annotation
from fieldcalib.io.wc14 import parse_homography
from fieldcalib.metrics import iou_part

FIELD = soccer()
PIECES = ground_pieces(FIELD)
HAS_TORCH = importlib.util.find_spec("torch") is not None
seeds = st.integers(0, 10_000)


def camera_of(cameras, index=0):
    """One of several as a camera of its own."""
    return Camera.from_angles(*cameras.angles[index], cameras.focal_length[index], cameras.C[index], IMAGE_SIZE)


def central(count, seed):
    """Cameras that see the centre circle or a penalty area well."""
    rng = np.random.default_rng(seed)
    cameras = cameras_of_chen(count, rng)
    angles = cameras.angles.copy()
    angles[:, 0] = np.radians(rng.uniform(-28.0, 28.0, count))
    angles[:, 1] = np.radians(rng.uniform(77.0, 82.0, count))
    return Cameras(angles, np.clip(cameras.focal_length, 1800.0, 3000.0), cameras.C)


def annotation(camera, size=IMAGE_SIZE):
    """The labelled pixels of all that a camera sees on the ground."""
    frame = {}
    for label, segment in FIELD.markings.items():
        if is_on_ground(segment) and label not in FIELD.half_labels:
            xy = camera.project(segment.sample(0.5))
            inside = np.all((xy >= 0.0) & (xy <= np.subtract(size, 1)), axis=1)
            if np.count_nonzero(inside) > 1:
                frame[label] = xy[inside]
    return frame


@pytest.fixture(scope="module")
def database():
    """A small one, around which the cameras of the tests lie."""
    return Database.made(FIELD, "chen", DRAWS["chen"], Siamese.shipped(), count=4000, seed=1)


@pytest.fixture(scope="module")
def file(database, tmp_path_factory):
    path = tmp_path_factory.mktemp("database") / "chen.npz"
    database.write(path)
    return path


@given(seeds)
def test_homographies_are_those_of_cameras(seed):
    cameras = cameras_of_chen(3, np.random.default_rng(seed))
    for index, H in enumerate(cameras.homographies):
        np.testing.assert_allclose(H, camera_of(cameras, index).homography, rtol=1e-9, atol=1e-6)


@given(seeds, st.sampled_from([-3.0, -1.0, 0.01, 1.0]))
def test_lines_of_an_edge_image_are_where_the_camera_projects_them(seed, scale):
    cameras = DRAWS["uniform"](2, np.random.default_rng(seed))
    for index, image in enumerate(edge_images(scale * cameras.homographies, PIECES)):
        resized = scaling(EDGE_SIZE)
        X = np.concatenate([segment.sample(0.2) for segment in FIELD.markings.values() if is_on_ground(segment)])
        camera = camera_of(cameras, index)
        xy = camera.project(X[camera.depth(X) > 1.0]) @ resized[:2, :2] + resized[:2, 2]
        inside = np.all((xy >= 1.0) & (xy <= np.subtract(EDGE_SIZE, 2)), axis=1)
        distance = cv2.distanceTransform((image < 60).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        column, row = np.rint(xy[inside]).astype(int).T
        assert np.all(distance[row, column] <= 2.0)


def test_what_is_behind_the_camera_is_not_drawn():
    camera = Camera.from_angles(
        0.0, np.radians(80.0), 0.0, 800.0, (0.0, 0.0, -10.0), IMAGE_SIZE
    )  # above the centre mark
    behind = np.array([[[-20.0, 5.0], [20.0, 5.0]]])
    across = np.array([[[5.0, -30.0], [5.0, 30.0]]])  # begins before the camera and ends behind it
    assert not edge_images(camera.homography[None], behind).any()
    drawn = np.argwhere(edge_images(camera.homography[None], across)[0])[:, ::-1]
    start, horizon = (camera.project((5.0, y, 0.0)) / 4.0 for y in (-30.0, -1e5))
    assert np.all(drawn[:, 1] > horizon[1])  # not above the horizon
    assert np.abs(drawn - start).sum(axis=1).min() < 2.0


def test_uniform_cameras_stand_in_their_ranges():
    cameras = DRAWS["uniform"](1000, np.random.default_rng(0))
    assert np.all(np.abs(cameras.C[:, 0]) <= 16.5)
    assert np.all((cameras.C[:, 2] >= -40.0) & (cameras.C[:, 2] <= -5.0))
    fov = np.degrees(2.0 * np.arctan(0.5 * IMAGE_SIZE[0] / cameras.focal_length))
    assert fov.min() < 12.0 < 80.0 < fov.max()


def test_pixels_masks_and_probabilities_of_a_view_give_its_edge_image():
    cameras = central(4, 2)
    for index, view in enumerate(edge_images(cameras.homographies, PIECES)):
        from_pixels = edges_of_pixels(FIELD, annotation(camera_of(cameras, index)), IMAGE_SIZE)
        thick = cv2.dilate(cv2.resize(view, (256, 256), interpolation=cv2.INTER_LINEAR), np.ones((5, 5), np.uint8))
        mask = np.where(thick > 80, 255, 0).astype(np.uint8)
        line = mask[None].astype(np.float32) / 255.0
        maps = np.concatenate([1.0 - line, line])
        from_maps = edges_of_probabilities(maps, ("background", "Middle line"), FIELD)
        assert np.array_equal(from_maps, edges_of_mask(mask))
        for edges, least in ((from_pixels, 0.95), (from_maps, 0.9)):
            to_view, to_edges = (
                cv2.distanceTransform((e < 60).astype(np.uint8), cv2.DIST_L2, 5) for e in (view, edges)
            )
            assert np.mean(to_view[edges > 60] < 2.0) > least
            assert np.mean(to_edges[view > 60] < 2.5) > least


def test_posts_are_not_in_a_map_of_lines():
    maps = np.zeros((2, 90, 160), np.float32)
    maps[1, 20:60, 80:84] = 1.0
    assert not edges_of_probabilities(maps, ("background", "Goal left crossbar"), FIELD).any()


@pytest.mark.slow
def test_features_of_a_pair_are_nearer_than_those_of_others():
    rng = np.random.default_rng(5)
    cameras = central(200, 5)
    pairs = nearby(cameras, rng)
    views, others = (edge_images(each.homographies, PIECES) for each in (cameras, pairs))
    for extract in (Siamese.shipped(), Hog.fitted(edge_images(cameras_of_chen(600, rng).homographies, PIECES))):
        a, b = extract(views), extract(others)
        distance = np.linalg.norm(a[:, None] - b[None], axis=2)
        assert np.mean(np.argmin(distance, axis=1) == np.arange(200)) > 0.5
        assert np.median(np.diagonal(distance)) < 0.5 * np.median(distance)


def test_features_refuse_other_sizes():
    with pytest.raises(ValueError, match=r"edges must be \(N, 180, 320\)"):
        Siamese.shipped()(np.zeros((1, 90, 160), np.uint8))


@pytest.mark.slow
def test_nearest_are_those_of_a_search_one_by_one(database):
    rng = np.random.default_rng(3)
    for feature in rng.normal(size=(5, 16)).astype(np.float32):
        order = np.argsort(np.linalg.norm(database.features - feature, axis=1))
        assert database.nearest(feature, 10).tolist() == order[:10].tolist()


@pytest.mark.slow
def test_a_database_finds_its_own_cameras(database):
    chosen = np.arange(0, 4000, 400)
    views = edge_images(database.cameras[chosen].homographies, database.pieces)
    assert [int(database.nearest(f)[0]) for f in database.extract(views)] == chosen.tolist()


@pytest.mark.slow
def test_refinement_brings_the_homography_home(database):
    cameras = central(12, 11)
    views = edge_images(cameras.homographies, PIECES)
    by_recipe = {}
    for name, recipe in (("published", PUBLISHED), ("wider", WIDER)):
        found = [homography(database, view, IMAGE_SIZE, recipe) for view in views]
        by_recipe[name] = [iou_part(H, true, IMAGE_SIZE) for H, true in zip(found, cameras.homographies, strict=True)]
    assert np.median(by_recipe["wider"]) > 0.98
    assert np.mean(by_recipe["wider"]) > np.mean(by_recipe["published"])


def assert_same_view(H, other, image_size):
    """Homographies of one view: OpenCV's ECC adds in float32, in an order that differs from call to call, so that what
    is hardly determined differs by 0.2 percent, and the pixels of what is in view by 0.002."""
    xy = np.stack(np.meshgrid(*(np.linspace(0, length - 1, 9) for length in image_size)), axis=-1).reshape(-1, 1, 2)
    there = cv2.perspectiveTransform(xy, H @ np.linalg.inv(other))
    np.testing.assert_allclose(there, xy, atol=0.1)


def test_the_homography_is_for_images_of_the_given_size(database):
    view = edge_images(central(1, 4).homographies, PIECES)[0]
    large, small = (homography(database, view, size) for size in (IMAGE_SIZE, (640, 360)))
    assert_same_view(scaling((640, 360)) @ large, small, (640, 360))


def test_no_line_no_homography(database):
    assert homography(database, np.zeros((180, 320), np.uint8), IMAGE_SIZE) is None


@pytest.mark.slow
@pytest.mark.parametrize("extract", [None, Siamese.shipped()], ids=["hog", "siamese"])
def test_a_database_is_read_back(extract, tmp_path):
    made = Database.made(FIELD, "uniform", DRAWS["uniform"], extract, count=700, seed=2)
    made.write(tmp_path / "some.npz")
    read = Database.read(tmp_path / "some.npz")
    view = edge_images(made.cameras.homographies[:1], PIECES)[0]
    assert read.distribution == "uniform"
    np.testing.assert_array_equal(read.features, made.features)
    np.testing.assert_array_equal(read.extract(view[None]), made.extract(view[None]))
    assert_same_view(*(homography(one, view, IMAGE_SIZE) for one in (read, made)), IMAGE_SIZE)
    assert [path.name for path in tmp_path.iterdir()] == ["some.npz"]


def test_databases_that_are_none(tmp_path, database, file):
    with pytest.raises(FileNotFoundError, match=r"baselines\.chen database"):
        Database.read(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("no arrays")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    (tmp_path / "cut.npz").write_bytes(file.read_bytes()[:5000])
    for name in ("text", "other", "cut"):
        with pytest.raises(BrokenFileError, match=f"{name}.npz is no database"):
            Database.read(tmp_path / f"{name}.npz")
    with pytest.raises(ValueError, match="of another field"):
        database.check_field(soccer(100.0, 64.0))


# --- the command line ---


def run(*arguments):
    try:
        return command.main([str(argument) for argument in arguments])
    except SystemExit as error:
        return error.code


@pytest.mark.parametrize("alignment", ["wc14", pytest.param("chen", marks=pytest.mark.slow)])
def test_annotations_to_homographies_and_cameras(alignment, database, file, tmp_path):
    cameras = central(5, 21)
    (tmp_path / "in").mkdir()
    frames = [annotation(camera_of(cameras, index)) for index in range(5)]
    for index, frame in enumerate(frames):
        (tmp_path / "in" / f"{index}.json").write_text(format_annotation(frame, IMAGE_SIZE))
    (tmp_path / "in" / "post.json").write_text('{"Goal left crossbar": [{"x": 0.5, "y": 0.5}, {"x": 0.6, "y": 0.5}]}')
    options = ["--size", "1280x720", "--database", file, "--alignment", alignment]
    assert run(tmp_path / "in", *options, "--camera-files", "--out", tmp_path / "out") == 0
    overlaps, found = [], 0
    for index, frame in enumerate(frames):
        H = parse_homography((tmp_path / "out" / f"{index}.homographyMatrix").read_text(), alignment)
        expected = homography(database, edges_of_pixels(FIELD, frame, IMAGE_SIZE), IMAGE_SIZE)
        assert iou_part(H, expected, IMAGE_SIZE) > 0.999
        overlaps.append(iou_part(H, cameras.homographies[index], IMAGE_SIZE))
        path = tmp_path / "out" / f"camera_{index}.json"
        if overlaps[-1] > 0.97 and path.exists():
            found += 1
            camera = camera_from_record(json.loads(path.read_text()))
            assert camera.focal_length == pytest.approx(cameras.focal_length[index], rel=0.2)
    assert np.median(overlaps) > 0.95
    assert found >= 2
    statuses = [json.loads(line)["status"] for line in (tmp_path / "out" / "cameras.jsonl").read_text().splitlines()]
    assert statuses[5] == "too few segments"
    assert not (tmp_path / "out" / "post.homographyMatrix").exists()


@pytest.mark.slow
def test_jobs_give_the_same_homographies_but_for_rounding(file, tmp_path):
    (tmp_path / "in").mkdir()
    cameras = central(1, 22)
    (tmp_path / "in" / "a.json").write_text(format_annotation(annotation(camera_of(cameras)), IMAGE_SIZE))
    found = []
    for jobs in ("1", "2"):
        out = tmp_path / jobs
        assert run(tmp_path / "in", "--size", "1280x720", "--database", file, "--out", out, "--jobs", jobs) == 0
        found.append(parse_homography((out / "a.homographyMatrix").read_text()))
    assert iou_part(*found, IMAGE_SIZE) > 0.999


def test_masks_of_any_size_to_homographies(file, tmp_path):
    cameras = central(5, 31)
    (tmp_path / "in").mkdir()
    for index, view in enumerate(edge_images(cameras.homographies, PIECES, (1280, 720))):
        thick = cv2.dilate(view, np.ones((9, 9), np.uint8))
        cv2.imwrite(str(tmp_path / "in" / f"{index}.png"), cv2.resize(thick, (256, 256), interpolation=cv2.INTER_AREA))
    (tmp_path / "in" / "broken.png").write_text("no image")
    options = ["--size", "640x360", "--database", file, "--from", "masks", "--out", tmp_path / "out"]
    assert run(tmp_path / "in", *options) == 1  # one file is broken
    found = [parse_homography((tmp_path / "out" / f"{index}.homographyMatrix").read_text()) for index in range(5)]
    overlaps = [iou_part(H, true, IMAGE_SIZE) for H, true in zip(found, cameras.homographies, strict=True)]
    assert np.median(overlaps) > 0.95


def test_errors_of_the_command_line(file, tmp_path, capsys):
    (tmp_path / "a.png").write_bytes(cv2.imencode(".png", np.zeros((20, 20, 3), np.uint8))[1].tobytes())
    common = [tmp_path, "--out", tmp_path / "out"]
    assert run(*common, "--database", file, "--from", "masks") != 0
    assert "--from masks needs --size" in capsys.readouterr().err
    assert run(*common, "--database", tmp_path / "no.npz", "--size", "640x360") != 0
    assert "python -m baselines.chen database" in capsys.readouterr().err
    assert run(*common, "--database", file, "--size", "640x360", "--field-length", "100") != 0
    assert "of another field" in capsys.readouterr().err
    assert run("database", tmp_path / "x.npz", "--features", "hog", "--model", "m.onnx") != 0
    assert "--model is about --features siamese" in capsys.readouterr().err


@pytest.mark.slow
def test_a_database_is_made_by_a_command(tmp_path, capsys):
    path = tmp_path / "small.npz"
    assert run("database", path, "--cameras", "uniform", "--features", "hog", "--count", "600") == 0
    assert "600 cameras" in capsys.readouterr().out
    database = Database.read(path)
    assert database.distribution == "uniform"
    assert database.features.shape == (600, 64)


@pytest.mark.slow
@pytest.mark.skipif(not HAS_TORCH, reason="training needs torch: pip install 'fieldcalib[train]'")
def test_a_trained_network_gives_features(tmp_path):
    model = tmp_path / "siamese.onnx"
    assert run("train", model, "--steps", "3") == 0
    extract = Siamese(model.read_bytes())
    features = extract(edge_images(central(3, 1).homographies, PIECES))
    assert features.shape == (3, 16)
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1.0, atol=1e-5)
