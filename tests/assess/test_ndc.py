"""The paper's losses against their definition, written out pixel by pixel."""

from math import cos, hypot, sin

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import angle, cameras, labelled_frames, numbers
from synthetic import displaced, observe, whole_circle_markings

from fieldcalib.assess.ndc import ndc_loss
from fieldcalib.fields.segments import Arc, Line
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.layout import LOG_ASPECT, LOG_F, PRINCIPAL_POINT, Layout, camera_from_theta, theta_from_camera

FIELD = soccer()
MARKINGS = whole_circle_markings(FIELD)
kinds = st.sampled_from(["tvcalib", "eq3"])


# --- the definition ---


def definition(theta, frame, image_size, kind):
    """Section "Segment Reprojection Loss", equations 2 and 3, with the pixels of both axes scaled to [-1, 1]."""
    camera = camera_from_theta(theta, image_size)
    lines, circles, segments = [], [], []
    for label, pixels in split_in_halves(frame, image_size, camera).items():
        segment = FIELD[label]
        distances = []
        for pixel in pixels:
            p = ndc(without_lens(camera, pixel), image_size)
            if isinstance(segment, Line):
                distance = line_distance(
                    p, ndc(pinhole(camera, segment.start), image_size), ndc(pinhole(camera, segment.end), image_size)
                )
                lines.append(distance)
            else:
                samples = circle_samples(segment) if isinstance(segment, Arc) else [segment.X]
                distance = min(
                    hypot(p[0] - q[0], p[1] - q[1]) for q in (ndc(pinhole(camera, X), image_size) for X in samples)
                )
                circles.append(distance)
            distances.append(distance)
        segments.append(mean(distances))
    return mean(lines) + mean(circles) if kind == "tvcalib" else mean(segments)


def mean(values):
    return sum(values) / len(values) if values else 0.0


def ndc(pixel, image_size):
    return 2.0 * pixel[0] / image_size[0] - 1.0, 2.0 * pixel[1] / image_size[1] - 1.0


def pinhole(camera, X):
    """Pixel of a world point without lens and with square pixels."""
    Xc = [sum(camera.R[row][i] * (X[i] - camera.C[i]) for i in range(3)) for row in range(3)]
    f, (cx, cy) = camera.focal_length, camera.principal_point
    return f * Xc[0] / Xc[2] + cx, f * Xc[1] / Xc[2] + cy


def without_lens(camera, pixel):
    """Where a camera without lens and with square pixels would see it: the radius by bisection."""
    f, (cx, cy), (k1, k2) = camera.focal_length, camera.principal_point, camera.k
    x, y = (pixel[0] - cx) / camera.K[0, 0], (pixel[1] - cy) / camera.K[1, 1]
    radius = hypot(x, y)
    low, high = 0.0, 2.0 * radius
    for _ in range(100):
        middle = (low + high) / 2.0
        bent = middle * (1.0 + k1 * middle**2 + k2 * middle**4)
        low, high = (middle, high) if bent < radius else (low, middle)
    scale = low / radius if radius > 0.0 else 1.0
    return f * scale * x + cx, f * scale * y + cy


def line_distance(p, a, b):
    """Equation 2."""
    (ux, uy), (vx, vy) = (b[0] - a[0], b[1] - a[1]), (a[0] - p[0], a[1] - p[1])
    return abs(ux * vy - uy * vx) / hypot(ux, uy)


def circle_samples(arc):
    """128 points from one end of an arc to the other."""
    for i in range(128):
        phi = arc.start + (arc.stop - arc.start) * i / 127
        yield [arc.center[j] + arc.radius * (cos(phi) * arc.u[j] + sin(phi) * arc.v[j]) for j in range(3)]


def split_in_halves(frame, image_size, camera):
    """Section "Modeling the Soccer Field": pixels left of the middle line belong to the left half.

    The paper has the main stand in mind. From the opposite one left is right, from behind a goal there are no halves.
    """
    facing = cos(camera.angles[0])
    if "Circle central" not in frame or abs(facing) < 0.5:
        return frame
    halves = {"Circle central left": [], "Circle central right": []}
    circle = frame["Circle central"]
    ends = sorted(frame.get("Middle line", []), key=lambda pixel: pixel[1])
    steep = len(ends) > 1 and ends[-1][1] - ends[0][1] > 0.05 * abs(ends[-1][0] - ends[0][0])
    for x, y in circle:
        if steep:
            (x0, y0), (x1, y1) = ends[0], ends[-1]
            left = x < x0 + (y - y0) * (x1 - x0) / (y1 - y0)
        else:  # the circle right of the image's centre: the left half of the field is in view
            left = mean([pixel[0] for pixel in circle]) > image_size[0] / 2.0
        halves["Circle central left" if left == (facing > 0.0) else "Circle central right"].append((x, y))
    return {label: xy for label, xy in {**frame, **halves}.items() if label != "Circle central" and len(xy)}


# --- the losses ---


@st.composite
def labelled(draw, lens):
    """Cameras as (theta, image_size), and pixels of some of the markings that they see, up to 20 px off."""
    camera = draw(cameras(lens))
    frame = draw(labelled_frames(observe(MARKINGS, camera), numbers(0.0, 20.0)))
    return theta_from_camera(camera), camera.image_size, frame


def loss_of(theta, frame, image_size, kind="tvcalib"):
    (loss,) = ndc_loss([camera_from_theta(theta, image_size)], FIELD, [frame], kind)
    return float(loss)


@pytest.mark.parametrize("lens", [False, True], ids=["pinhole", "lens"])
@given(data=st.data(), kind=kinds)
def test_losses_are_what_the_paper_defines(lens, data, kind):
    theta, image_size, frame = data.draw(labelled(lens))
    expected = definition(theta, frame, image_size, kind)
    assert loss_of(theta, frame, image_size, kind) == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("kind", ["tvcalib", "eq3"])
def test_a_known_displacement(kind):
    """48 of 960 pixels across are 0.1, 27 of 540 pixels down are 0.1."""
    camera = Camera.from_angles(0.0, 0.0, 0.0, 900.0, (0.0, 0.0, -90.0), (960, 540))  # straight down, 10 px a metre
    frame = {
        "Middle line": np.array([(480.0, 100.0), (480.0, 400.0), (528.0, 300.0)]),  # 0, 0 and 0.1
        "CENTER_MARK": np.array([(480.0, 297.0)]),  # 0.1
    }
    theta = theta_from_camera(camera)
    expected = {"tvcalib": 0.1 / 3.0 + 0.1, "eq3": (0.1 / 3.0 + 0.1) / 2.0}
    assert loss_of(theta, frame, (960, 540), kind) == pytest.approx(expected[kind])


def one_of_each_kind(rng):
    camera = Camera.from_angles(-0.4, 1.35, 0.0, 1100.0, (-8.0, 66.0, -16.0), (960, 540))
    frame = observe(MARKINGS, camera, rng, noise=5.0)
    lines = {label: xy for label, xy in frame.items() if isinstance(FIELD[label], Line)}
    circles = {label: xy for label, xy in frame.items() if isinstance(FIELD[label], Arc)}
    assert len(lines) > 3
    assert len(circles) > 0
    return theta_from_camera(camera), lines, circles


def test_an_absent_kind_counts_nothing():
    theta, lines, circles = one_of_each_kind(np.random.default_rng(0))
    size = (960, 540)
    alone = loss_of(theta, lines, size), loss_of(theta, circles, size)
    assert min(alone) > 1e-3
    assert loss_of(theta, {**lines, **circles}, size) == pytest.approx(sum(alone))


def test_in_equation_3_every_segment_counts_alike():
    theta, lines, circles = one_of_each_kind(np.random.default_rng(1))
    size = (960, 540)
    alone = [loss_of(theta, {label: xy}, size, "eq3") for label, xy in {**lines, **circles}.items()]
    assert loss_of(theta, {**lines, **circles}, size, "eq3") == pytest.approx(mean(alone))
    label, xy = next(iter(lines.items()))
    repeated = {**lines, **circles, label: np.repeat(xy, 7, axis=0)}
    assert loss_of(theta, repeated, size, "eq3") == pytest.approx(mean(alone))
    assert abs(loss_of(theta, repeated, size) - loss_of(theta, {**lines, **circles}, size)) > 1e-4


@pytest.mark.parametrize("kind", ["tvcalib", "eq3"])
def test_no_pixels_no_loss(kind):
    theta, lines, _ = one_of_each_kind(np.random.default_rng(2))
    assert loss_of(theta, {}, (960, 540), kind) == 0.0
    together = ndc_loss([camera_from_theta(theta, (960, 540))] * 2, FIELD, [{}, lines], kind)
    assert together[0] == 0.0
    assert together[1] == pytest.approx(loss_of(theta, lines, (960, 540), kind))


def test_the_centre_circle_is_compared_with_its_half():
    camera = Camera.from_angles(0.0, 0.0, 0.0, 1080.0, (0.0, 0.0, -90.0), (960, 540))  # 12 px a metre
    theta, size = theta_from_camera(camera), (960, 540)
    middle_line = camera.project([(0.0, -20.0, 0.0), (0.0, 20.0, 0.0)])
    circle = camera.project([(9.15, 0.0, 0.0)])  # on the right half
    half = {side: loss_of(theta, {f"Circle central {side}": circle}, size) for side in ("left", "right")}
    assert half["right"] < 0.006  # half of the distance between samples
    assert half["left"] > 0.2
    assert loss_of(theta, {"Middle line": middle_line, "Circle central": circle}, size) == pytest.approx(half["right"])
    moved = middle_line + (150.0, 0.0)  # beyond the pixel
    expected = 150.0 / 480.0 + half["left"]
    assert loss_of(theta, {"Middle line": moved, "Circle central": circle}, size) == pytest.approx(expected)


@given(drawn=labelled(lens=True), kind=kinds, scale=st.sampled_from([0.5, 2.0, 3.0]))
def test_the_size_of_the_image_does_not_matter(drawn, kind, scale):
    theta, (width, height), frame = drawn
    scaled = theta.copy()
    scaled[LOG_F] += np.log(scale)
    scaled[PRINCIPAL_POINT] *= scale
    size = (int(scale * width), int(scale * height))
    found = loss_of(scaled, {label: scale * xy for label, xy in frame.items()}, size, kind)
    assert found == pytest.approx(loss_of(theta, frame, (width, height), kind), rel=1e-9)


main_cameras = cameras(lens=True, stands=("main tribune",), image_sizes=((1280, 720),))


@given(drawn=st.lists(main_cameras, min_size=2, max_size=5), direction=angle(np.pi), kind=kinds)
def test_frames_together_or_one_by_one(drawn, direction, kind):
    image_size = drawn[0].image_size
    theta = np.array([theta_from_camera(camera) for camera in drawn])
    frames = [displaced(observe(MARKINGS, camera), 5.0, direction) for camera in drawn]
    together = ndc_loss(drawn, FIELD, frames, kind)
    alone = [loss_of(t, frame, image_size, kind) for t, frame in zip(theta, frames, strict=True)]
    np.testing.assert_allclose(together, alone, rtol=1e-12, atol=1e-15)


@given(drawn=labelled(lens=True), kind=kinds)
def test_a_known_lens_is_taken_out(drawn, kind):
    theta, image_size, frame = drawn
    theta[LOG_ASPECT] = 0.0
    frame.pop("Circle central", None)  # bent or straight, the middle line may split it elsewhere
    straight = theta.copy()
    layout, c = Layout.of(image_size), theta[PRINCIPAL_POINT]
    b = theta[layout.lens_block]
    straight[layout.lens_block] = 0.0
    straightened = {label: c + layout.lens.undistort((xy - c).T, b[:, None]).T for label, xy in frame.items()}
    expected = loss_of(straight, straightened, image_size, kind)
    assert loss_of(theta, frame, image_size, kind) == pytest.approx(expected, rel=1e-9)


@given(camera=cameras(lens=True), kind=kinds)
def test_pixels_without_noise_lie_on_their_lines(camera, kind):
    lines = {label: segment for label, segment in FIELD.items() if isinstance(segment, Line)}
    frame = observe(lines, camera)
    assume(frame)
    assert loss_of(theta_from_camera(camera), frame, camera.image_size, kind) < 1e-8
