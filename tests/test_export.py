"""Cameras in the formats of other tools, read back by the documented formulas of those tools and by the tools."""

import csv
import importlib.util
import io
import json
import re

import cv2
import numpy as np
import pytest
from commands import calibrate, run
from hypothesis import given, settings
from strategies import cameras
from synthetic import visible_field_points

from fieldcalib.cli.export import FORMATS
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import COEFFICIENTS
from fieldcalib.geometry.rational import RationalCamera, distort_rational
from fieldcalib.io.exports.blender import blender_error, blender_files
from fieldcalib.io.exports.colmap import colmap_files
from fieldcalib.io.exports.freed import freed_error, freed_files, freed_packet
from fieldcalib.io.exports.nerfstudio import nerfstudio_files
from fieldcalib.io.exports.opencv import opencv_files
from fieldcalib.io.exports.soccernet import gamestate_files, soccernet_files, tvcalib_files
from fieldcalib.io.exports.table import table_files
from fieldcalib.io.results import read_results
from fieldcalib.io.soccernet import parse_camera, rational_camera_from_record
from fieldcalib.io.tvcalib import parse_per_sample_output

MOST = 1e-6  # px
Z_UP = np.diag([1.0, -1.0, -1.0])
CAMERA = Camera.from_angles(0.2, 1.3, 0.01, 1500.0, (2.0, 60.0, -15.0), (960, 540), k=(0.1, -0.02))
PINHOLE = Camera.from_angles(0.2, 1.3, 0.01, 1500.0, (2.0, 60.0, -15.0), (960, 540))


def with_lens(*dist):
    return Camera(CAMERA.K, CAMERA.R, CAMERA.C, CAMERA.image_size, dist)


# What another tool makes of a file: for every id a function of world points, in our axes, to pixels of ours.


def pinhole(K, R, t, dist=(0.0,) * 12):
    def project(X):
        Xc = X @ np.asarray(R).T + t
        x = distort_rational(Xc[:, :2] / Xc[:, 2:], np.asarray(dist, dtype=float))
        return x * np.diag(K)[:2] + np.asarray(K)[:2, 2]

    return project


def by_opencv(files):
    def project(content):
        storage = cv2.FileStorage(content.decode(), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        values = [storage.getNode(key).mat() for key in ("rvec", "tvec", "camera_matrix", "distortion_coefficients")]
        return lambda X: cv2.projectPoints(X, *values)[0].reshape(-1, 2)

    return {name.removesuffix(".yml"): project(content) for name, content in files.items()}


def by_colmap(files):
    """By its documentation, "Output Format" and "Camera Models": parameters f or fx, fy, then cx, cy, then the lens."""
    order = {"PINHOLE": [], "SIMPLE_RADIAL": [0], "OPENCV": [0, 1, 2, 3], "FULL_OPENCV": list(range(8))}
    assert not any(line for line in files["points3D.txt"].decode().splitlines() if not line.startswith("#"))
    intrinsics, found = {}, {}
    for line in files["cameras.txt"].decode().splitlines():
        if not line.startswith("#"):
            number, model, _, _, *values = line.split()
            values = [float(v) for v in values]
            fx, fy, cx, cy, *lens = values[:1] + values if model == "SIMPLE_RADIAL" else values
            dist = np.zeros(12)
            dist[order[model]] = lens
            intrinsics[number] = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]]), dist
    lines = [line for line in files["images.txt"].decode().splitlines() if not line.startswith("#")]
    assert not any(lines[1::2])  # the points
    for line in lines[::2]:
        _, *pose, number, name = line.split()
        w, x, y, z, *t = (float(v) for v in pose)
        R = np.eye(3) + 2 * (w * cross(x, y, z) + cross(x, y, z) @ cross(x, y, z))
        K, dist = intrinsics[number]
        found[name.removesuffix(".jpg")] = pinhole(K, R, t, dist)
    return found


def cross(x, y, z):
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def by_nerfstudio(files):
    """Directions ((u - cx) / fx, -(v - cy) / fy, -1) turned by the pose; the first pixel's centre is (0.5, 0.5)."""

    def project(frame):
        pose = np.array(frame["transform_matrix"])
        R = Z_UP @ pose[:3, :3].T @ Z_UP
        K = [[frame["fl_x"], 0, frame["cx"] - 0.5], [0, frame["fl_y"], frame["cy"] - 0.5], [0, 0, 1]]
        dist = [frame[name] for name in ("k1", "k2", "p1", "p2", "k3")] + [0.0] * 7
        return pinhole(K, R, -R @ Z_UP @ pose[:3, 3], dist)

    return {f["file_path"].removesuffix(".jpg"): project(f) for f in json.loads(files["transforms.json"])["frames"]}


def blender_data(files):
    script = files["camera.py"].decode()
    return (json.loads(re.search(rf'^{name} = json.loads\("""(.*?)"""\)', script, re.M | re.S)[1])
            for name in ("SETTINGS", "CAMERAS"))  # fmt: skip


def by_blender(files):
    """Blender's projection: sensor_width fits the width, shifts are shares of the width, edges are half a pixel out."""
    settings, keys = blender_data(files)
    width, height = settings["image_size"]
    aspect_x, aspect_y = settings["pixel_aspect"]

    def project(key):
        w, *v = key["quaternion"]
        R = np.eye(3) + 2 * (w * cross(*v) + cross(*v) @ cross(*v))

        def pixels(X):
            x, y, z = ((X @ Z_UP - key["location"]) @ R).T
            scale = key["lens"] / settings["sensor_width"]
            ndc_x = 0.5 - key["shift"][0] + scale * x / -z  # from the left, in widths
            ndc_y = -key["shift"][1] + scale * y / -z  # up from the middle, in widths
            return np.stack([ndc_x * width, height / 2 - ndc_y * width * aspect_x / aspect_y], axis=-1) - 0.5

        return pixels

    return {f"{key['frame'] - 1:05d}": project(key) for key in keys}


def by_freed(content, image_size, sensor_width=36.0):
    """The packets, by the protocol: (camera, X -> pixels)."""
    width, height = image_size
    found = []
    for start in range(0, len(content), 29):
        packet = content[start : start + 29]
        assert packet[0] == 0xD1
        assert sum(packet) % 256 == 0x40
        signed = [int.from_bytes(packet[at : at + 3], "big", signed=True) for at in range(2, 20, 3)]
        pan, tilt, roll = np.radians(np.array(signed[:3]) / 32768)
        place = np.array(signed[3:]) / 64e3
        f = int.from_bytes(packet[20:23], "big") / 1e3 / sensor_width * width
        ahead = np.array([np.sin(pan) * np.cos(tilt), np.cos(pan) * np.cos(tilt), np.sin(tilt)])
        level = np.array([np.cos(pan), -np.sin(pan), 0.0])  # to the right
        down = np.cross(ahead, level)
        right = np.cos(roll) * level + np.sin(roll) * down  # clockwise as seen from behind
        R = np.stack([right, np.cross(ahead, right), ahead])
        K = [[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]]
        found.append(lambda X, K=K, R=R, place=place: pinhole(K, R, -R @ place)(X @ Z_UP))
    return found


def by_soccernet(files):
    return {name[len("camera_") : -len(".json")]: parse_camera(content).project for name, content in files.items()}


def by_tvcalib(files):
    return {one.id: one.camera.project for one in parse_per_sample_output(files["per_sample_output.json"])}


def by_gamestate(files):
    """Cameras of images of 1920 x 1080, whose pixels are s times ours."""
    ((_, content),) = files.items()
    found = {}
    for one in json.loads(content)["predictions"]:
        assert (one["supercategory"], one["category_id"], one["id"]) == ("camera", 6, one["image_id"] + "01")
        camera = rational_camera_from_record(one["parameters"], (1920, 1080))
        found[one["image_id"]] = camera.project
    return found


def by_table(files):
    found = {}
    for row in csv.DictReader(io.StringIO(files["cameras.csv"].decode())):
        v = {key: float(row[key]) for key in row if key not in ("id", "status", "verdict", "basis") and row[key]}
        K = np.array([[v["fx"], 0, v["cx"]], [0, v["fy"], v["cy"]], [0, 0, 1]])
        angles = np.radians([v["pan_degrees"], v["tilt_degrees"], v["roll_degrees"]])
        R = Camera.from_angles(*angles, 1.0, (0, 0, 0), (1, 1)).R
        size = int(v["width"]), int(v["height"])
        C, dist = [v[axis] for axis in "xyz"], [v[name] for name in COEFFICIENTS]
        found[row["id"]] = RationalCamera(K, R, C, dist, size).project
    return found


EXACT = {
    "opencv": (opencv_files, by_opencv),
    "colmap": (colmap_files, by_colmap),
    "nerfstudio": (nerfstudio_files, by_nerfstudio),
    "soccernet": (soccernet_files, by_soccernet),
    "tvcalib": (tvcalib_files, by_tvcalib),
    "csv": (table_files, by_table),
}


def farthest(project, camera, scale=1.0):
    """The largest distance between pixels that another tool and this package give to points in view."""
    X = visible_field_points(camera)
    return np.max(np.abs(project(X) / scale - camera.project(X)), initial=0.0)


@pytest.mark.parametrize("format", EXACT)
@given(camera=cameras())
@settings(max_examples=30)
def test_formats_that_hold_the_whole_camera(format, camera):
    write, read = EXACT[format]
    assert farthest(read(write({"00007": camera}))["00007"], camera) < MOST


@given(camera=cameras())
@settings(max_examples=30)
def test_a_game_state_is_of_1920_by_1080(camera):
    found = by_gamestate(gamestate_files({"2116000001": camera}))["2116000001"]
    assert farthest(found, camera, scale=1920 / camera.image_size[0]) < MOST


@pytest.mark.parametrize("format", EXACT)
@pytest.mark.parametrize("dist", [(0.1, -0.02, 1e-3, -2e-3), (0.1, -0.02, 1e-3, -2e-3, 0.03)])
def test_lenses_that_are_not_radial(format, dist):
    write, read = EXACT[format]
    camera = with_lens(*dist, *[0.0] * (5 - len(dist)))
    assert farthest(read(write({"00007": camera}))["00007"], camera) < MOST
    assert farthest(read(write({"00007": PINHOLE}))["00007"], camera) > 1.0  # the lens is seen


@pytest.mark.parametrize("format", ["opencv", "colmap", "soccernet", "csv"])
def test_rational_lenses(format):
    write, read = EXACT[format]
    camera = with_lens(0.1, -0.02, 1e-3, -2e-3, 0.03, 0.01, 0.02, -0.01)
    assert farthest(read(write({"00007": camera}))["00007"], camera) < MOST


@pytest.mark.parametrize(
    ("write", "dist", "message"),
    [
        (
            colmap_files,
            [0.1] + [0.0] * 7 + [0.01, 0, 0, 0],
            "frame 7: COLMAP has .*, this one has s1 = 0.01 too: undist",
        ),
        (nerfstudio_files, [0.1] + [0.0] * 4 + [0.2, 0, 0], "frame 7: nerfstudio has .*, this one has k4 = 0.2 too"),
    ],
)
def test_lenses_that_do_not_fit_are_said(write, dist, message):
    with pytest.raises(ValueError, match=message):
        write({"7": with_lens(*dist)})


def without_lens(camera):
    return Camera(camera.K, camera.R, camera.C, camera.image_size)


def without_lens_and_principal_point(camera):
    """Square pixels and the principal point in the middle, as receivers of FreeD take it to be."""
    (width, height), f = camera.image_size, camera.focal_length
    K = [[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]]
    return Camera(K, camera.R, camera.C, camera.image_size)


@given(camera=cameras(lens=False))
@settings(max_examples=30)
def test_blender_by_its_formula(camera):
    assert farthest(by_blender(blender_files({"00007": camera}))["00007"], camera) < MOST


@given(camera=cameras(lens=True))
@settings(max_examples=30)
def test_blender_has_all_but_the_lens(camera):
    assert farthest(by_blender(blender_files({"00007": camera}))["00007"], without_lens(camera)) < MOST


def test_what_blender_loses_is_said():
    assert blender_error(PINHOLE) < 1e-9
    corner = PINHOLE.K @ [*CAMERA.normalized((0.0, 0.0)), 1.0]
    assert blender_error(CAMERA) == pytest.approx(np.hypot(*corner[:2]))


@given(camera=cameras())
@settings(max_examples=30)
def test_freed_has_pose_and_zoom(camera):
    (found,) = by_freed(freed_files({"1": camera})["camera.freed"], camera.image_size)
    f, width = camera.focal_length, camera.image_size[0]
    # half a step of three angles, of the focal length and of a place 10 m away
    steps = 3 * np.radians(0.5 / 32768) * f + 0.5e-3 / (36 * f / width) * width + 1e-5 / 10 * f
    assert farthest(found, without_lens_and_principal_point(camera)) < 2 * steps


def test_what_freed_loses_is_said():
    assert freed_error(PINHOLE) == pytest.approx(
        np.hypot(0.5, 0.5)
    )  # between (w / 2, h / 2) and the middle of the pixels
    assert freed_error(CAMERA) == pytest.approx(blender_error(CAMERA), abs=1.0)


def test_the_sensor_gives_freed_its_focal_length_in_micrometres():
    assert int.from_bytes(freed_packet(PINHOLE, 9.6)[20:23], "big") == 15_000


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        (Camera(PINHOLE.K, PINHOLE.R, (0, 140, -15), (960, 540)), "positions of less than 131 m"),
        (Camera(PINHOLE.K @ np.diag([1e6, 1e6, 1]), PINHOLE.R, PINHOLE.C, (960, 540)), "does not fit into FreeD"),
    ],
)
def test_what_freed_cannot_count_is_said(camera, message):
    with pytest.raises(ValueError, match=message):
        freed_files({"1": camera})


# Gaps and order


def test_frames_without_camera():
    other = Camera.from_angles(0.3, 1.3, 0.01, 1500.0, (2.0, 60.0, -15.0), (960, 540))
    frames = {"00000": None, "00001": CAMERA, "00002": None, "00003": other}
    with_one = ["00001", "00003"]
    assert list(opencv_files(frames)) == ["00001.yml", "00003.yml"]
    assert list(soccernet_files(frames)) == ["camera_00001.json", "camera_00003.json"]
    assert list(by_colmap(colmap_files(frames))) == list(by_nerfstudio(nerfstudio_files(frames))) == with_one
    assert [
        record.camera is None for record in parse_per_sample_output(tvcalib_files(frames)["per_sample_output.json"])
    ]
    predictions = json.loads(gamestate_files(frames, "3116")["SNGS-116.json"])["predictions"]
    assert ["parameters" in one for one in predictions] == [False, True, False, True]
    rows = list(csv.DictReader(io.StringIO(table_files(frames)["cameras.csv"].decode())))
    assert [row["id"] for row in rows] == list(frames)
    assert [row["fx"] for row in rows] == ["", "1500.0", "", "1500.0"]
    assert [key["frame"] for key in list(blender_data(blender_files(frames)))[1]] == [2, 4]
    one, two = freed_packet(CAMERA, 36.0), freed_packet(other, 36.0)
    assert freed_files(frames)["camera.freed"] == one + one + one + two


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("frames", [{}, {"1": None}], ids=["nothing", "no camera"])
def test_no_camera_is_said(format, frames):
    with pytest.raises(ValueError, match=f"there is no camera to export: none of {len(frames)} frames"):
        FORMATS[format](frames)


def test_blender_counts_frames_without_numbers():
    keys = list(blender_data(blender_files({"a": None, "b": PINHOLE, "c": PINHOLE})))[1]
    assert [key["frame"] for key in keys] == [2, 3]


def test_blender_turns_the_short_way():
    """Quaternions q and -q are one rotation, and Blender interpolates their components."""
    frames = {
        f"{i}": Camera.from_angles(pan, 1.3, 0.0, 1500.0, (0, 60, -15), (960, 540))
        for i, pan in enumerate(np.linspace(-9.0, 9.0, 100))
    }
    keys = list(blender_data(blender_files(frames)))[1]
    q = np.array([key["quaternion"] for key in keys])
    assert np.all(np.sum(q[1:] * q[:-1], axis=1) > 0.99)


def test_blender_has_a_rate_and_an_aspect():
    camera = Camera(np.diag([1500.0, 1200.0, 1.0]), PINHOLE.R, PINHOLE.C, (960, 540))
    settings, _ = blender_data(blender_files({"1": camera}, fps=29.97, sensor_width=9.6))
    assert settings["fps"] / settings["fps_base"] == pytest.approx(29.97)
    assert settings["pixel_aspect"] == [1.0, 1.25]
    with pytest.raises(ValueError, match="one aspect ratio of pixels: 1 and 2 differ"):
        blender_files({"1": camera, "2": PINHOLE})
    with pytest.raises(ValueError, match="one size of images: 1 has"):
        blender_files({"1": PINHOLE, "2": PINHOLE.scaled((1920, 1080))})


def test_names_of_images():
    files = colmap_files({"7": CAMERA}, "img1/<id>.png")
    assert files["images.txt"].decode().splitlines()[2].endswith(" 1 img1/7.png")
    frames = json.loads(nerfstudio_files({"7": CAMERA}, "images/<id>.png")["transforms.json"])["frames"]
    assert frames[0]["file_path"] == "images/7.png"
    with pytest.raises(ValueError, match="expected a name with <id> in it"):
        colmap_files({"7": CAMERA}, "image.png")
    with pytest.raises(ValueError, match=r"have no blanks, got 'a b\.jpg': rename"):
        colmap_files({"a b": CAMERA})


def test_a_game_state_is_16_to_9():
    with pytest.raises(ValueError, match="this one is 960x720: not 16:9"):
        gamestate_files({"1": Camera.from_angles(0, 1.3, 0, 1500.0, (0, 60, -15), (960, 720))})
    with pytest.raises(ValueError, match="expected the digit of the split"):
        gamestate_files({"1": CAMERA}, "../3")


# The tools themselves


def test_pycolmap_projects_to_the_same_pixels(tmp_path):
    import pycolmap

    rng = np.random.default_rng(0)
    frames = {}
    for number in range(60):
        dist = [(), (0.1,), (0.1, -0.02, 1e-3, -2e-3), (0.1, -0.02, 1e-3, -2e-3, 0.03, 0.01, 0.02, -0.01)][number % 4]
        angles = rng.uniform((-0.6, 1.2, -0.05), (0.6, 1.4, 0.05))
        camera = Camera.from_angles(
            *angles, rng.uniform(800, 4000), rng.uniform((-5, 50, -20), (5, 70, -8)), (960, 540)
        )
        K = camera.K + np.array([[0, 0, 7.0], [0, 3.0 * (number % 3), -5.0], [0, 0, 0]])
        frames[f"{number:05d}"] = Camera(K, camera.R, camera.C, (960, 540), dist or (0.0, 0.0))
    for name, content in colmap_files(frames).items():
        (tmp_path / name).write_bytes(content)
    found = pycolmap.Reconstruction(str(tmp_path))
    assert {camera.model.name for camera in found.cameras.values()} == {
        "PINHOLE",
        "SIMPLE_RADIAL",
        "OPENCV",
        "FULL_OPENCV",
    }
    assert found.num_images() == len(frames)
    compared = 0
    for image in found.images.values():
        camera = frames[image.name.removesuffix(".jpg")]
        X = visible_field_points(camera)
        xy = np.array([image.project_point(one) for one in X]).reshape(-1, 2) - 0.5
        np.testing.assert_allclose(xy, camera.project(X), rtol=0, atol=MOST)
        compared += len(X)
    assert compared > 500


@pytest.mark.skipif(
    importlib.util.find_spec("bpy") is None, reason="needs bpy, Blender as a package, which is no extra"
)
@pytest.mark.filterwarnings("ignore")
def test_blender_itself_makes_the_camera():
    import bpy
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    frames = {
        f"{i:06d}": Camera(
            np.array([[f, 0, 490.0 + i], [0, 1.25 * f, 260.0 - i], [0, 0, 1]]),
            Camera.from_angles(-0.5 + 0.1 * i, 1.3 - 0.01 * i, 0.01, f, (0, 0, 0), (960, 540)).R,
            (2.0 + 0.1 * i, 60.0, -15.0),
            (960, 540),
        )
        for i, f in enumerate(np.linspace(900.0, 3000.0, 10))
        if i != 4  # a gap
    }
    exec(compile(blender_files(frames, fps=29.97)["camera.py"], "camera.py", "exec"), {"__name__": "camera"})
    scene = bpy.context.scene
    scene.frame_set(5)  # the gap, between frames 3 and 5 of ours
    assert scene.camera.location[0] == pytest.approx(2.4, abs=1e-6)  # as on a straight line
    assert scene.camera.data.lens == pytest.approx((900.0 + 2100.0 * 4 / 9) * 36 / 960, abs=1e-4)
    assert (scene.frame_start, scene.frame_end) == (1, 10)
    assert scene.render.fps / scene.render.fps_base == pytest.approx(29.97)
    errors = []
    for id, camera in frames.items():
        scene.frame_set(int(id) + 1)
        X = visible_field_points(camera)
        ndc = np.array([world_to_camera_view(scene, scene.camera, Vector(one))[:2] for one in X @ Z_UP])
        xy = np.stack([ndc[:, 0] * 960, (1.0 - ndc[:, 1]) * 540], axis=-1) - 0.5
        errors.append(np.max(np.abs(xy - camera.project(X))))
    assert max(errors) < 2e-3  # px: Blender's numbers have 24 bits


# The command


@pytest.fixture(scope="module")
def real_folder(shared_data, tmp_path_factory):
    """100 calibrated frames."""
    out = tmp_path_factory.mktemp("real")
    files = sorted(f for f in (shared_data / "sncalib-test-center").glob("*.json") if f.stem.isdigit())[:100]
    assert calibrate(out, *files) == 0
    return out


def exported(folder, out, format, *options):
    assert run("export", folder, "--format", format, "--out", out, "--keep-rejected", *options) == 0
    return {path.name: path.read_bytes() for path in out.iterdir()}


@pytest.mark.parametrize("format", [*EXACT, "gsr", "blender", "freed"])
def test_a_hundred_real_frames(real_folder, tmp_path, format, record_property):
    results = read_results(real_folder)
    expected = {id: one.camera for id, one in results.items() if one.camera is not None}
    assert len(expected) > 95
    files = exported(real_folder, tmp_path / "out", format)
    most, scale = MOST, 1.0
    if format == "blender":
        found = by_blender(files)
        expected = {id: without_lens(camera) for id, camera in expected.items()}
    elif format == "freed":
        found = dict(zip(results, by_freed(files["camera.freed"], (960, 540)), strict=True))
        expected = {id: without_lens_and_principal_point(camera) for id, camera in expected.items()}
        most = 0.05
    elif format == "gsr":
        found, scale = by_gamestate(files), 2.0
    else:
        found = EXACT[format][1](files)
    errors = [farthest(found[id], camera, scale) for id, camera in expected.items()]
    record_property("largest distance in pixels", max(errors))
    assert max(errors) < most


@pytest.mark.parametrize("format", FORMATS)
def test_the_command(format, calibrated_folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert exported(calibrated_folder, out, format)
    printed = capsys.readouterr()
    assert printed.out == f"4 cameras of 4 frames in {out}\n"
    assert ("without it the image moves by up to" in printed.err) == (format in ("blender", "freed"))
    assert run("export", calibrated_folder, "--format", format, "--out", out) == 2
    assert "already: give --overwrite" in capsys.readouterr().err
    assert run("export", calibrated_folder, "--format", format, "--out", out, "--overwrite") == 0


def test_the_command_takes_some_frames(calibrated_folder, tmp_path):
    assert list(exported(calibrated_folder, tmp_path / "1", "opencv", "--frames", "b")) == ["b.yml"]
    assert set(exported(calibrated_folder, tmp_path / "2", "opencv")) == {"a.yml", "b.yml", "c.yml", "d.yml"}


def test_the_table_has_what_the_run_says(calibrated_folder, tmp_path):
    content = exported(calibrated_folder, tmp_path / "out", "csv")["cameras.csv"].decode()
    for row in csv.DictReader(io.StringIO(content)):
        line = next(line for line in read_results(calibrated_folder).lines if line["id"] == row["id"])
        assert (row["status"], row["verdict"], float(row["rms_px"])) == (
            line["status"],
            line["verdict"],
            line["rms_px"],
        )


def test_tvcalib_gets_the_loss(calibrated_folder, tmp_path):
    records = parse_per_sample_output(
        exported(calibrated_folder, tmp_path / "out", "tvcalib")["per_sample_output.json"]
    )
    assert {one.id: one.loss_ndc_total for one in records} == {
        id: found.loss_ndc for id, found in read_results(calibrated_folder).items()
    }


def test_a_file_of_results_will_do(calibrated_folder, tmp_path):
    folder = rewritten(calibrated_folder, tmp_path / "results")
    assert run("export", folder / "cameras.jsonl", "--format", "freed") == 0
    assert len((folder / "freed" / "camera.freed").read_bytes()) == 4 * 29


def rewritten(folder, out, **changes):
    """The results of a folder with other values in the line of frame a."""
    out.mkdir()
    lines = [json.loads(line) for line in (folder / "cameras.jsonl").read_text().splitlines()]
    changed = [line | changes if line["id"] == "a" else line for line in lines]
    (out / "cameras.jsonl").write_text("".join(json.dumps(line) + "\n" for line in changed))
    return out


def test_rejected_cameras_are_gaps(calibrated_folder, tmp_path, capsys):
    folder = rewritten(calibrated_folder, tmp_path / "results", verdict="reject")
    assert run("export", folder, "--format", "opencv") == 0
    assert sorted(path.name for path in (folder / "opencv").iterdir()) == ["b.yml", "c.yml", "d.yml"]
    printed = capsys.readouterr()
    assert printed.out == f"3 cameras of 4 frames in {folder / 'opencv'}\n"
    assert '1 camera left out, whose verdict is "reject"; --keep-rejected' in printed.err
    assert "a.yml" in exported(folder, tmp_path / "all", "opencv")


def test_broken_frames_are_gaps(calibrated_folder, tmp_path):
    folder = rewritten(calibrated_folder, tmp_path / "results", status="broken file")
    assert "a.yml" not in exported(folder, tmp_path / "out", "opencv")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--format", "colmap", "--fps", "25"], "--fps is of blender, not of colmap"),
        (["--format", "csv", "--sensor-width", "9.6"], "--sensor-width is of blender and freed, not of csv"),
        (["--format", "opencv", "--frames", "a", "x", "y"], "has no frame x, y, its frames are a to d"),
        (["--format", "ply"], "invalid choice: 'ply'"),
        ([], "--format"),
        (["--format", "colmap", "--image-names", "x.png"], "expected a name with <id> in it"),
    ],
)
def test_wrong_usage_is_said(calibrated_folder, tmp_path, capsys, options, message):
    assert run("export", calibrated_folder, *options, "--out", tmp_path / "out") == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_folder_without_results_is_said(tmp_path, capsys):
    assert run("export", tmp_path, "--format", "csv") == 2
    assert "expected the folder that a run wrote" in capsys.readouterr().err


def test_an_id_that_leads_elsewhere_is_no_name_of_a_file(calibrated_folder, tmp_path, capsys):
    folder = rewritten(calibrated_folder, tmp_path / "results", id="../a")
    assert run("export", folder, "--format", "opencv", "--keep-rejected") == 2
    assert "'../a.yml' is no name of a file" in capsys.readouterr().err
