"""What other tools make of exported files, by their documented formulas, and how far that is off.

Readers give for every id a function of world points, in our axes, to pixels of ours.
"""

import csv
import io
import json
import re
import tomllib

import cv2
import numpy as np
from synthetic import visible_field_points

from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens.brown_conrady import brown_conrady
from fieldcalib.geometry.lens.model import COEFFICIENTS
from fieldcalib.io.exports.colmap import colmap_files
from fieldcalib.io.exports.nerfstudio import nerfstudio_files
from fieldcalib.io.exports.opencv import opencv_files
from fieldcalib.io.exports.soccernet import soccernet_files, tvcalib_files
from fieldcalib.io.exports.table import table_files
from fieldcalib.io.exports.toml import toml_files
from fieldcalib.io.soccernet import camera_from_record, parse_camera
from fieldcalib.io.tvcalib import parse_per_sample_output

MOST = 1e-6  # px
Z_UP = np.diag([1.0, -1.0, -1.0])


def pinhole(K, R, t, dist=(0.0,) * 12):
    def project(X):
        Xc = X @ np.asarray(R).T + t
        x = brown_conrady((Xc[:, :2] / Xc[:, 2:]).T, np.asarray(dist, dtype=float)).T
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


def by_toml(files):
    """cv2's projection in a world with z up; caliscope's file has the same cameras as that of Pose2Sim and anipose."""
    sections, numbered = (tomllib.loads(files[name].decode()) for name in ("calibration.toml", "camera_array.toml"))
    assert sections.pop("metadata") == {"adjusted": False, "error": 0.0}
    found = {}
    for section, other in zip(sections.values(), numbered["cameras"].values(), strict=True):
        assert all(section[key] == value for key, value in other.items() if key != "cam_id")
        K, dist, rvec, tvec = (np.array(section[key]) for key in ("matrix", "distortions", "rotation", "translation"))
        found[section["name"]] = pinhole(K, cv2.Rodrigues(rvec)[0] @ Z_UP, tvec, np.pad(dist, (0, 12 - len(dist))))
    return found


def blender_data(files):
    """SETTINGS and CAMERAS of the script."""
    script = files["camera.py"].decode()
    texts = (
        re.search(rf'^{name} = json.loads\("""(.*?)"""\)', script, re.M | re.S) for name in ("SETTINGS", "CAMERAS")
    )
    return [json.loads(text[1]) for text in texts]


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
        camera = camera_from_record(one["parameters"], (1920, 1080), checked=False)
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
        found[row["id"]] = Camera(K, R, C, size, dist, checked=False).project
    return found


EXACT = {
    "opencv": (opencv_files, by_opencv),
    "colmap": (colmap_files, by_colmap),
    "nerfstudio": (nerfstudio_files, by_nerfstudio),
    "soccernet": (soccernet_files, by_soccernet),
    "tvcalib": (tvcalib_files, by_tvcalib),
    "csv": (table_files, by_table),
    "toml": (toml_files, by_toml),
}


def farthest(project, camera, scale=1.0):
    """The largest distance between pixels that another tool and this package give to points in view."""
    X = visible_field_points(camera)
    return np.max(np.abs(project(X) / scale - camera.project(X)), initial=0.0)


def without_lens(camera):
    return Camera(camera.K, camera.R, camera.C, camera.image_size)


def without_lens_and_principal_point(camera):
    """Square pixels and the principal point in the middle, as receivers of FreeD take it to be."""
    (width, height), f = camera.image_size, camera.focal_length
    K = [[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]]
    return Camera(K, camera.R, camera.C, camera.image_size)
