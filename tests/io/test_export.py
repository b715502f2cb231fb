"""Cameras in the formats of other tools, read back by the documented formulas of those tools and by the tools."""

import csv
import importlib.util
import io
import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from other_tools import (
    EXACT,
    MOST,
    Z_UP,
    blender_data,
    by_blender,
    by_colmap,
    by_freed,
    by_gamestate,
    by_nerfstudio,
    farthest,
    without_lens,
    without_lens_and_principal_point,
)
from strategies import cameras, examples
from synthetic import visible_field_points

from fieldcalib.cli.export import FORMATS
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.exports.blender import blender_error, blender_files
from fieldcalib.io.exports.colmap import colmap_files
from fieldcalib.io.exports.freed import freed_error, freed_files, freed_packet
from fieldcalib.io.exports.nerfstudio import nerfstudio_files
from fieldcalib.io.exports.opencv import opencv_files
from fieldcalib.io.exports.soccernet import gamestate_files, soccernet_files, tvcalib_files
from fieldcalib.io.exports.table import table_files
from fieldcalib.io.tvcalib import parse_per_sample_output

CAMERA = Camera.from_angles(0.2, 1.3, 0.01, 1500.0, (2.0, 60.0, -15.0), (960, 540), k=(0.1, -0.02))
PINHOLE = Camera.from_angles(0.2, 1.3, 0.01, 1500.0, (2.0, 60.0, -15.0), (960, 540))


def with_lens(*dist):
    return Camera(CAMERA.K, CAMERA.R, CAMERA.C, CAMERA.image_size, dist)


@pytest.mark.parametrize("format", EXACT)
@given(camera=cameras())
@examples(30)
def test_formats_that_hold_the_whole_camera(format, camera):
    write, read = EXACT[format]
    assert farthest(read(write({"00007": camera}))["00007"], camera) < MOST


FISHEYE = Camera.from_angles(
    0.2, 1.3, 0.01, 400.0, (2.0, 60.0, -15.0), (960, 540), k=(0.1, -0.02, 0.01, -0.001), fisheye=True
)


def test_a_fisheye_lens_is_that_of_colmap_and_nerfstudio():
    X = visible_field_points(CAMERA)
    expected, pose = FISHEYE.project(X), (X - FISHEYE.C) @ FISHEYE.R.T
    model, *numbers = colmap_files({"7": FISHEYE})["cameras.txt"].decode().splitlines()[-1].split()[1:]
    assert (model, numbers[:2]) == ("OPENCV_FISHEYE", ["960", "540"])
    fx, fy, cx, cy, *k = map(float, numbers[2:])
    ours = {"fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "k1": k[0], "k2": k[1], "k3": k[2], "k4": k[3]}
    record = json.loads(nerfstudio_files({"7": FISHEYE})["transforms.json"])
    assert record["camera_model"] == "OPENCV_FISHEYE"
    assert {name: record["frames"][0][name] for name in ours} == ours
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    xy, _ = cv2.fisheye.projectPoints(pose[:, None], np.zeros(3), np.zeros(3), K, np.array(k))
    np.testing.assert_allclose(xy[:, 0] - 0.5, expected, rtol=0.0, atol=1e-6)  # their first pixel is at 0.5
    with pytest.raises(ValueError, match="one model for all frames"):
        nerfstudio_files({"7": FISHEYE, "8": CAMERA})


@pytest.mark.parametrize("write", [soccernet_files, gamestate_files, table_files])
def test_formats_without_a_fisheye_lens_say_so(write):
    with pytest.raises(ValueError, match="the lens is a fisheye, which has no coefficients k1, k2, p1"):
        write({"2116000001": FISHEYE})


@given(camera=cameras())
@examples(30)
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


@given(camera=cameras(lens=False))
@examples(30)
def test_blender_by_its_formula(camera):
    assert farthest(by_blender(blender_files({"00007": camera}))["00007"], camera) < MOST


@given(camera=cameras(lens=True))
@examples(30)
def test_blender_has_all_but_the_lens(camera):
    assert farthest(by_blender(blender_files({"00007": camera}))["00007"], without_lens(camera)) < MOST


def test_what_blender_loses_is_said():
    assert blender_error(PINHOLE) < 1e-9
    corner = PINHOLE.K @ [*CAMERA.normalized((0.0, 0.0)), 1.0]
    assert blender_error(CAMERA) == pytest.approx(np.hypot(*corner[:2]))


@given(camera=cameras())
@examples(30)
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
    assert [key["frame"] for key in blender_data(blender_files(frames))[1]] == [2, 4]
    one, two = freed_packet(CAMERA, 36.0), freed_packet(other, 36.0)
    assert freed_files(frames)["camera.freed"] == one + one + one + two


@pytest.mark.parametrize("format", sorted(FORMATS.keys() - {"rerun"}))  # which is given fields too
@pytest.mark.parametrize("frames", [{}, {"1": None}], ids=["nothing", "no camera"])
def test_no_camera_is_said(format, frames):
    with pytest.raises(ValueError, match=f"there is no camera to export: none of {len(frames)} frames"):
        FORMATS[format](frames)


def test_blender_counts_frames_without_numbers():
    keys = blender_data(blender_files({"a": None, "b": PINHOLE, "c": PINHOLE}))[1]
    assert [key["frame"] for key in keys] == [2, 3]


def test_blender_turns_the_short_way():
    """Quaternions q and -q are one rotation, and Blender interpolates their components."""
    frames = {
        f"{i}": Camera.from_angles(pan, 1.3, 0.0, 1500.0, (0, 60, -15), (960, 540))
        for i, pan in enumerate(np.linspace(-9.0, 9.0, 100))
    }
    keys = blender_data(blender_files(frames))[1]
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
