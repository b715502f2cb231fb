"""Homographies for other tools: exact from undistorted pixels, and honest about the lens from those of the picture."""

import csv
import io
import warnings

import cv2
import numpy as np
import pytest
from commands import run
from hypothesis import given
from strategies import cameras
from synthetic import visible_field_points

from fieldcalib import Camera, calibrate, soccer
from fieldcalib.fields import Ground, field_homography
from fieldcalib.geometry.homography import dehomogenize, homogenize
from fieldcalib.io.exports.homography import homography_files

SEEN = ("Side line top", "Middle line", "Circle central", "Big rect. right main", "Big rect. right top")
BENT = Camera.from_angles(0.2, 1.35, 0.01, 1400.0, (0.0, 65.0, -16.0), (960, 540), k=(0.08, 0.0))


def mapped(H, xy):
    return dehomogenize(homogenize(np.asarray(xy)) @ np.asarray(H).T)


@given(cameras(lens=True))
def test_undistorted_pixels_are_mapped_exactly_and_raw_ones_within_what_is_said(camera):
    found = field_homography(camera, soccer())
    X = visible_field_points(camera)
    xy = camera.project(X)
    undistorted = cv2.undistortPoints(xy[:, None], camera.K, camera.dist, P=camera.K)[:, 0]
    near = np.linalg.norm(X[:, :2] - camera.C[:2], axis=1) < 80.0  # the rest is metres to a tenth of a pixel
    np.testing.assert_allclose(mapped(found.from_undistorted, undistorted)[near], X[near, :2], atol=1e-2)
    if not np.any(camera.dist):
        np.testing.assert_array_equal(found.from_raw, found.from_undistorted)


def test_the_lens_costs_what_is_said():
    found = field_homography(BENT, soccer())
    axes = (np.arange(0.0, size, 30.0) for size in BENT.image_size)
    xy = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    X = BENT.image_to_field(xy)[:, :2]
    inside = np.all(np.abs(X) <= (52.5, 34.0), axis=1)
    missed = np.linalg.norm(mapped(found.from_raw, xy[inside]) - X[inside], axis=1)
    assert 0.3 * found.largest_m < missed.max() <= 1.05 * found.largest_m


def test_the_ground_costs_what_is_said_up_to_the_border(tmp_path, capsys):
    field = soccer().with_ground(Ground(crown=0.3))
    camera = Camera.from_angles(0.2, 1.37, 0.01, 1100.0, (0.0, 65.0, -16.0), (960, 540))
    X = np.stack(np.meshgrid(np.linspace(-52.5, 52.5, 400), np.linspace(-34.0, 34.0, 270)), axis=-1).reshape(-1, 2)
    xy = camera.project(field.terrain.raised(np.pad(X, ((0, 0), (0, 1)))))
    inside = np.all((xy >= 0.0) & (xy <= (959.0, 539.0)), axis=1)
    found = field_homography(camera, field)
    missed = np.linalg.norm(mapped(found.from_raw, xy[inside]) - X[inside], axis=1).max()
    assert 0.98 * found.largest_m < missed < 1.02 * found.largest_m
    pixels = {label: camera.project(field.terrain.raised(field[label].sample(5.0))) for label in SEEN}
    calibrate(pixels, field, image_size=(960, 540), progress=False).save(tmp_path / "r")
    assert run("export", tmp_path / "r", "--format", "homography", "--keep-rejected") == 0
    assert "the ground is not: from_raw is up to " in capsys.readouterr().err


def test_the_command_writes_a_table_and_arrays(calibrated_folder, tmp_path):
    out = tmp_path / "H"
    assert run("export", calibrated_folder, "--format", "homography", "--out", out, "--keep-rejected") == 0
    rows = list(csv.DictReader(io.StringIO((out / "homographies.csv").read_text())))
    arrays = np.load(out / "homographies.npz")
    assert [row["id"] for row in rows] == arrays["ids"].tolist() == ["a", "b", "c", "d"]
    for row, H in zip(rows, arrays["from_raw"], strict=True):
        cells = [float(row[f"from_raw_{i}{j}"]) for i in "123" for j in "123"]
        np.testing.assert_array_equal(np.reshape(cells, (3, 3)), H)
        assert float(row["from_raw_largest_m"]) >= float(row["from_raw_rms_m"]) >= 0.0


def test_frames_without_a_camera_are_gaps():
    files = homography_files({"a": None, "b": BENT}, {"b": soccer()})
    first = files["homographies.csv"].decode().splitlines()[1]
    assert set(first.removeprefix("a")) == {","}
    assert np.isnan(np.load(io.BytesIO(files["homographies.npz"]))["from_raw"][0]).all()


def test_the_homography_of_a_camera_with_a_lens_warns_and_names_both_maps():
    with pytest.warns(UserWarning, match=r"up to \d+\.\d px.*pinhole_homography.*from_raw"):
        assert BENT.homography.shape == (3, 3)
    with pytest.warns(UserWarning, match="undistorted"):
        assert BENT.inverse_homography.shape == (3, 3)
    weak = Camera(BENT.K, BENT.R, BENT.C, BENT.image_size, (0.001, 0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(weak.homography, BENT.pinhole_homography)
    assert 0.0 < weak.lens_shift < 1.0 < BENT.lens_shift
