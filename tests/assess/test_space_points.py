"""Points in space from several cameras: their errors are as large as they say; what cannot be located is refused."""

from itertools import pairwise

import numpy as np
import pytest

from data_tools.rigs import errors_of
from data_tools.simulated import observe
from fieldcalib import Camera, calibrate, calibrate_batch, calibrate_from_homography, calibrate_rig, soccer
from fieldcalib.assess import height_above_ground, joint_covariance, triangulate
from fieldcalib.assess.advice import NoCameraError
from fieldcalib.draw.scene import render_field

FIELD, SIZE = soccer(), (960, 540)
INSIDE = 7.815  # 95 % of the squared distances of three coordinates, in standard deviations


def camera_at(C, X, focal_length):
    """A camera that looks at a point."""
    x, y, z = np.subtract(X, C)
    pan, tilt = np.arctan2(x, -y), np.pi / 2.0 - np.arctan2(z, np.hypot(x, y))
    return Camera.from_angles(pan, tilt, 0.0, focal_length, C, SIZE)


def rig(rng, X):
    """Two to six cameras on both sides of the field, near whose optical axes a point lies."""
    cameras = []
    for _ in range(rng.integers(2, 7)):
        C = np.array([rng.uniform(-40, 40), rng.uniform(50, 80) * rng.choice([1, -1]), -rng.uniform(8, 25)])
        cameras.append(camera_at(C, X + rng.normal(0.0, 5.0, 3) * (1.0, 1.0, 0.0), rng.uniform(700.0, 1500.0)))
    return cameras


@pytest.mark.parametrize("count", [12, pytest.param(100, marks=pytest.mark.slow)])
def test_points_lie_in_their_regions(count):
    rng, inside, points = np.random.default_rng(2), 0, 0
    for _ in range(count):
        X = np.array([rng.uniform(-45, 45), rng.uniform(-28, 28), -rng.uniform(0, 5)])
        cameras = rig(rng, X)
        found = calibrate_batch(FIELD, [observe(camera, FIELD, rng, 1.0) for camera in cameras], SIZE)
        good = [(one, camera) for one, camera in zip(found, cameras, strict=True) if one.verdict == "good"]
        if len(good) > 1:
            xy = [camera.project(X) + rng.normal(0.0, 2.0, 2) for _, camera in good]
            point = triangulate([one for one, _ in good], xy)
            off = point.X - X
            inside += off @ np.linalg.solve(point.covariance, off) < INSIDE
            points += 1
    assert points > 0.8 * count
    assert 0.9 * points <= inside
    assert np.linalg.norm(point.errors) < 20.0


def exact(*places):
    """Calibrations without errors of cameras at some places that look at the centre mark."""
    cameras = [camera_at(np.array(C), np.zeros(3), 1200.0) for C in places]
    return [calibrate_from_homography(camera.homography, SIZE) for camera in cameras], cameras


def test_exact_cameras_give_the_exact_point():
    found, cameras = exact((-30.0, 60.0, -15.0), (30.0, 60.0, -15.0), (0.0, -70.0, -12.0))
    X = np.array([3.0, -4.0, -2.0])
    xy = [camera.project(X) for camera in cameras]
    point, wider = triangulate(found, xy, pixel_sd=1.0), triangulate(found, xy, pixel_sd=3.0)
    np.testing.assert_allclose(point.X, X, atol=1e-3)
    np.testing.assert_allclose(wider.covariance, 9.0 * point.covariance, rtol=1e-3)  # the cameras have no errors


def test_what_cannot_be_located_is_refused():
    found, cameras = exact((-30.0, 60.0, -15.0), (30.0, 60.0, -15.0))
    beside, _ = exact((-30.0, 60.0, -15.0), (-30.2, 60.0, -15.0))
    xy = [camera.project((3.0, -4.0, -2.0)) for camera in cameras]
    with pytest.raises(ValueError, match=r"the rays are nearly parallel \(0\.\d+ degrees\)"):
        triangulate(beside, [(480.0, 270.0)] * 2)
    with pytest.raises(ValueError, match="calibrations, two or more"):
        triangulate(found[:1], xy[:1])
    with pytest.raises(ValueError, match="a finite pixel"):
        triangulate(found, xy[:1])
    with pytest.raises(ValueError, match=r"the pixel \(x, y\) of one foot and of one top"):
        height_above_ground(found[0], [xy[0], xy[0]], [xy[1], xy[1]])
    with pytest.raises(ValueError, match="do not meet in front"):
        triangulate(found, [(-5000.0, 270.0), (9000.0, 270.0)])
    with pytest.raises(NoCameraError):
        triangulate([found[0], calibrate({}, image_size=SIZE, progress=False)[0]], xy)


def test_heights_from_one_camera_are_as_sure_as_they_say():
    rng, inside, count = np.random.default_rng(5), 0, 0
    places = [np.array([rng.uniform(-45, 45), rng.uniform(-28, 28), 0.0]) for _ in range(40)]
    cameras = [rig(rng, X)[0] for X in places]
    found = calibrate_batch(FIELD, [observe(camera, FIELD, rng, 1.0) for camera in cameras], SIZE)
    for one, camera, X in zip(found, cameras, places, strict=True):
        if one.verdict == "good":
            height = rng.uniform(0.5, 3.0)
            foot, top = (camera.project(X - (0.0, 0.0, z)) + rng.normal(0.0, 2.0, 2) for z in (0.0, height))
            told, deviation = height_above_ground(one, foot, top)
            inside, count = inside + (abs(told - height) < 1.96 * deviation), count + 1
    assert count > 30
    assert 0.85 * count <= inside
    (exact_one, _), (camera, _) = exact((-30.0, 60.0, -15.0), (30.0, 60.0, -15.0))
    feet = [camera.project((3.0, -4.0, z)) for z in (0.0, -1.8)]
    assert height_above_ground(exact_one, *feet, pixel_sd=1.0)[0] == pytest.approx(1.8, abs=1e-3)
    with pytest.raises(ValueError, match="no ground is seen at the foot"):
        height_above_ground(exact_one, (480.0, -4000.0), (480.0, -4100.0))


@pytest.mark.parametrize("count", [8, pytest.param(60, marks=pytest.mark.slow)])
def test_cameras_on_a_field_of_unknown_size_lie_in_their_regions_and_so_do_their_points(count):
    found = list(errors_of("labels", count, np.random.default_rng(3)))
    for kind, least in (("accepted cameras", 0.9), ("points from accepted cameras", 0.85)):
        inside = [is_inside for name, is_inside, _ in found if name == kind]
        assert len(inside) >= 0.9 * count
        assert np.mean(inside) >= least


def test_cameras_have_the_error_of_the_size_of_their_field_in_common():
    rng, pitch = np.random.default_rng(0), soccer(101.0, 66.0)
    cameras = [camera_at(np.array([x, 62.0, -15.0]), (x, 0.0, 0.0), 600.0) for x in (-20.0, 5.0, 20.0)]
    pixels = {f"{number}": observe(camera, pitch, rng, 0.5) for number, camera in enumerate(cameras)}
    rig = [one[0] for one in calibrate_rig(pixels, image_size=SIZE, progress=False).values()]
    joint = joint_covariance(rig)
    np.testing.assert_allclose(joint, joint.T, atol=1e-9 * joint.max())
    assert np.linalg.eigvalsh(joint).min() > -1e-9 * joint.max()
    ends = np.cumsum([0, *(one.uncertainty.layout.size for one in rig)])
    blocks = [slice(*pair) for pair in pairwise(ends)]
    for one, block in zip(rig, blocks, strict=True):
        np.testing.assert_allclose(joint[block, block], one.uncertainty.covariance, atol=1e-9 * joint.max())
    names = rig[0].uncertainty.layout.names
    size = [block.start + np.array([names.index("length"), names.index("width")]) for block in blocks]
    for other in size[1:]:  # all have the same size
        np.testing.assert_allclose(joint[np.ix_(size[0], other)], joint[np.ix_(size[0], size[0])], rtol=1e-6)
    left, right = (block.start + names.index("x") for block in (blocks[0], blocks[2]))
    assert joint[left, right] < 0.0  # on a longer field both stand farther out

    known = calibrate_rig(pixels, soccer(101.0, 66.0, size_known=True), image_size=SIZE, progress=False)
    apart = joint_covariance([one[0] for one in known.values()])
    first = known["0"][0].uncertainty.layout.size
    assert not np.any(apart[:first, first:])


def test_pictures_of_a_rig_share_size_and_ground():
    pitch = soccer(100.0, 73.0)
    cameras = {
        "left": camera_at(np.array([-8.0, 70.0, -18.0]), (-28.0, 2.0, 0.0), 640.0),
        "right": camera_at(np.array([8.0, 68.0, -18.0]), (26.0, 4.0, 0.0), 640.0),
        "middle": camera_at(np.array([0.0, 72.0, -20.0]), (-4.0, 0.0, 0.0), 560.0),
    }
    pictures = {
        name: [render_field(camera, pitch, rng=np.random.default_rng(number))]
        for number, (name, camera) in enumerate(cameras.items())
    }
    found = {name: results[0] for name, results in calibrate_rig(pictures, progress=False).items()}
    field = found["left"].field
    assert all(one.field == field for one in found.values())
    assert (field.length, field.width) == pytest.approx((100.0, 73.0), abs=0.6)
    for name, camera in cameras.items():
        assert found[name].verdict == "good"
        assert np.linalg.norm(found[name].camera.C - camera.C) < 1.5
    nominal = calibrate(pictures["left"], estimate_size=False, progress=False)[0].field
    assert (nominal.length, nominal.width, nominal.terrain.crown) == (105.0, 68.0, 0.0)


def test_a_rig_shares_the_size_of_its_field():
    rng, pitch = np.random.default_rng(0), soccer(100.0, 64.0)
    cameras = {
        "left": camera_at(np.array([-15.0, 62.0, -15.0]), (-25.0, 0.0, 0.0), 500.0),
        "right": camera_at(np.array([15.0, 62.0, -15.0]), (25.0, 0.0, 0.0), 500.0),
        "far": camera_at(np.array([0.0, -60.0, -14.0]), (0.0, 0.0, 0.0), 500.0),
    }
    pixels = {name: observe(camera, pitch, rng, 0.5) for name, camera in cameras.items()}
    found = calibrate_rig(pixels, image_size=SIZE, progress=False)
    fields = [results[0].field for results in found.values()]
    assert fields[0] == fields[1] == fields[2]
    assert (fields[0].length, fields[0].width) == pytest.approx((100.0, 64.0), abs=1.0)
    for name, camera in cameras.items():
        assert np.linalg.norm(found[name][0].camera.C - camera.C) < 1.5
    fixed = calibrate_rig(pixels, soccer(100.0, 64.0, size_known=True), image_size=SIZE, progress=False)
    assert (fixed["far"][0].field.length, fixed["far"][0].field.width) == (100.0, 64.0)
