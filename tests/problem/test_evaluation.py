"""The segment reprojection residual and its Jacobian, for every lens and for the size of the field."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numdiff import central_differences, column_errors
from strategies import angle, cameras, examples, numbers, vectors
from synthetic import displaced, observe, random_camera, random_distorted

from fieldcalib.fields.ground import Ground, Terrain
from fieldcalib.fields.segments import Arc, Line, PointCloud
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import DISTRIBUTIONS
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import BrownConradyLens, FisheyeLens, Pinhole, RadialLens
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.layout import (
    CENTER,
    LOG_ASPECT,
    LOG_F,
    PRINCIPAL_POINT,
    Layout,
    SizeBlock,
    ZoomLaw,
    camera_from_theta,
    theta_from_camera,
)
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import Observations, pack
from fieldcalib.problem.projection import Projection

FIELD = soccer()
CIRCLE = FIELD["Circle central"]
ALL_KINDS = {
    **FIELD,
    "moved circle": PointCloud(CIRCLE.sample(0.25) + (6.0, 3.0, 0.0), ordered=True),
    "balls": PointCloud([(-30.0, -10.0, -0.1), (-10.0, 5.0, -0.1), (0.0, 0.0, -0.1), (20.0, -5.0, -0.1)]),
    "tilted hoop": Arc((-20.0, 5.0, -2.0), 3.0, u=(1.0, 0.0, 0.0), v=(0.0, 0.6, -0.8)),
}
SIZE = (960, 540)
RHO = float(np.hypot(*SIZE) / 2.0)
RADIAL = Layout.of(SIZE)
LAYOUTS = {
    "pinhole": Layout.of(SIZE, Pinhole(RHO)),
    "no radial lens": RADIAL,
    "radial lens": RADIAL,
    "Brown-Conrady lens": Layout.of(SIZE, BrownConradyLens(RHO)),
    "zoom law": Layout.of(SIZE, zoom_law=ZoomLaw(np.log(1200.0))),
    "fisheye lens": Layout.of(SIZE, FisheyeLens(RHO)),
}


def lenses(*slow):
    """Parametrize a test by lenses, some of them in the slow part."""
    return pytest.mark.parametrize(
        "lens", [pytest.param(name, marks=pytest.mark.slow if name in slow else ()) for name in LAYOUTS]
    )


quick_lenses = lenses("Brown-Conrady lens")
LAW = np.array([10.0, 10.0, 0.05, 0.1, 0.5])  # slopes of the principal point, of a1, its bend, the offset of the axes
# p1, p2, a3 to a6, s1 to s4 of a lens that bends the corner by some percent with each
OTHER_COEFFICIENTS = np.array([0.004, 0.004, 0.02, 0.01, 0.01, 0.01, 0.005, 0.005, 0.005, 0.005])
SIZES = SizeBlock(np.array([105.0, 68.0]), np.ones(2), np.array([[90.0, 45.0], [120.0, 90.0]]))
MOTION = np.concatenate([FIELD.motion, np.zeros((len(ALL_KINDS) - len(FIELD), 2, 3, 2))])

# Steps of the differences: about 1e-2 px, little against the sharpest ellipse and much against 1e-8 px, to which the
# closest points are found.
STEPS = {"x": 1e-3, "y": 1e-3, "z": 1e-3, "cx": 3e-3, "cy": 3e-3, "length": 1e-3, "width": 1e-3, "a1": 3e-6}
STEP = 1e-5  # of a1 less: its second derivative has a kink at 0


def everything(layout=RADIAL):
    return np.ones(layout.size, dtype=bool)


def at(theta, observations, layout=None):
    """What cameras see of observations, by default with a radial lens."""
    layout = Layout.of(observations.image_size) if layout is None else layout
    return evaluate(Problem(observations, layout, RobustLoss("linear", 1.0)), theta)


def jacobian(evaluation, free=None):
    """Derivatives of the residuals, (B, M, P), by default by all parameters."""
    free = everything(evaluation.problem.layout) if free is None else free
    return np.swapaxes(evaluation.derivatives(free), 1, 2)


def numeric_jacobian(evaluation, free=None, steps_by=1.0):
    """Derivatives of the residuals by the free parameters, through theta itself; rows of padding are zero."""
    problem, theta = evaluation.problem, evaluation.theta
    free = everything(problem.layout) if free is None else free
    steps = steps_by * np.array([STEPS.get(name, STEP) for name in problem.layout.names])

    def residuals(values):
        moved = theta.copy()
        moved[:, free] = values
        return evaluate(problem, moved).r * (problem.observations.weight > 0.0)

    return central_differences(residuals, theta[:, free], steps[free])


def jacobian_errors(evaluation, free=None):
    """Relative error of each column against central differences, (B, P)."""
    seen = evaluation.problem.observations.weight[..., None] > 0.0
    return column_errors(jacobian(evaluation, free) * seen, numeric_jacobian(evaluation, free), floor=1e-2)


def beside_the_segments(object_segments, camera, distance, direction=0.0):
    """What the camera sees, pixels moved by up to `distance`; by less where a curve comes near to itself.

    Where two points of a curve are equally near, the distance to it has a kink and no derivative.
    """
    frame = {}
    for label, xy in observe(object_segments, camera, per_line=2, per_curve=9).items():
        segment = object_segments[label]
        limit = np.full(len(xy), distance)
        if isinstance(segment, Arc):
            room = _room(xy, camera.project(Arc(segment.center, segment.radius, u=segment.u, v=segment.v).sample(0.01)))
            if room.min() < 2.0:  # px: seen from its edge, with two sides that are one
                continue
            limit = np.minimum(0.3 * room, distance)
        elif isinstance(segment, PointCloud):
            limit = (
                np.minimum(0.3 * _room(xy, camera.project(segment.X)), distance) if segment.ordered else limit / 10.0
            )
        moved = displaced({label: xy}, limit[:, None], direction)[label]
        if isinstance(segment, PointCloud):
            moved = moved[_decided(moved, camera.project(segment.X))]
        if len(moved):
            frame[label] = moved
    return frame


def _decided(xy, samples):
    """Which pixels are not half-way between their two nearest samples, where the residual has a kink."""
    order = np.argsort(np.linalg.norm(xy[:, None] - samples, axis=2), axis=1)  # NaN comes last
    near, next_ = samples[order[:, 0]], samples[order[:, 1]]
    along = (next_ - near) / (np.linalg.norm(next_ - near, axis=1, keepdims=True) + 1e-12)
    return np.abs(np.sum((xy - (near + next_) / 2.0) * along, axis=1)) > 0.2


def _room(xy, curve):
    """Radius of the smallest circle that touches the curve at each of its points xy and meets it elsewhere."""
    nearest = np.nanargmin(np.linalg.norm(xy[:, None] - curve, axis=2), axis=1)
    tangent = curve[(nearest + 1) % len(curve)] - curve[nearest - 1]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1) / (
        np.linalg.norm(tangent, axis=1, keepdims=True) + 1e-12
    )
    chord = curve - curve[nearest][:, None]
    across = np.abs(np.einsum("nk,nmk->nm", normal, chord))
    radius = np.sum(np.square(chord), axis=2) / (2.0 * across + 1e-12)
    away = np.linalg.norm(chord, axis=2) > 1e-9
    return np.nanmin(np.where(away, radius, np.nan), axis=1)


def through_fisheye(camera):
    """The camera with a fisheye lens that sees 140 degrees."""
    f, k = SIZE[0] / np.radians(140.0), (0.04, -0.02, 0.004, -0.001)
    return Camera.from_angles(*camera.angles, f, camera.C, SIZE, k=k, fisheye=True)


@cache
def random_evaluation(stand, lens, count, distance=20.0, seed=2, with_size=False):
    """Random cameras at what they see; `lens` is one of `LAYOUTS`."""
    rng, seen, frames, layout = np.random.default_rng(seed), [], [], LAYOUTS[lens]
    if with_size:
        layout = Layout.of(SIZE, layout.lens, SIZES, layout.zoom_law)
    while len(frames) < count:
        camera = random_camera(DISTRIBUTIONS[stand], rng)
        if lens in ("radial lens", "Brown-Conrady lens", "zoom law"):
            camera = random_distorted(camera, rng)
        if lens == "fisheye lens":
            camera = through_fisheye(camera)
        theta = layout.theta(camera)
        if lens == "Brown-Conrady lens":
            theta[layout.lens_block][2:] = OTHER_COEFFICIENTS * rng.uniform(-1.0, 1.0, size=10)
        if lens == "zoom law":
            theta[layout.zoom_law_block] = LAW * rng.uniform(-1.0, 1.0, size=len(LAW))
        frame = beside_the_segments(ALL_KINDS, layout.camera(theta), distance, rng.uniform(-np.pi, np.pi))
        if len(frame) > 3:
            seen.append(theta)
            frames.append(frame)
    return at(np.array(seen), pack(ALL_KINDS, frames, SIZE, motion=MOTION), layout)


@st.composite
def sightings(draw, lens):
    """A layout, a camera in it, and what it sees with pixels up to 50 px beside it; `lens` is one of `LAYOUTS`."""
    with_lens = lens in ("radial lens", "Brown-Conrady lens", "zoom law")
    layout, camera = LAYOUTS[lens], draw(cameras(lens=with_lens, image_sizes=(SIZE,)))
    camera = through_fisheye(camera) if lens == "fisheye lens" else camera
    layout = Layout.of(SIZE, layout.lens, draw(st.sampled_from([None, SIZES])), layout.zoom_law)
    theta = layout.theta(camera)
    if lens == "Brown-Conrady lens":
        theta[layout.lens_block][2:] = draw(vectors(-OTHER_COEFFICIENTS, OTHER_COEFFICIENTS))
    if lens == "zoom law":
        theta[layout.zoom_law_block] = draw(vectors(-LAW, LAW))
    if with_lens:  # the second derivative by a1 has a kink at 0: the differences must not straddle it
        assume(abs(layout.at_zoom(theta)[layout.lens_block.start]) > 1e-3)
    frame = beside_the_segments(ALL_KINDS, layout.camera(theta), draw(numbers(0.0, 50.0)), draw(angle(np.pi)))
    assume(len(frame) > 3)
    return layout, theta, frame


@pytest.mark.parametrize(
    "lens",
    [
        pytest.param(name, marks=pytest.mark.slow if name in ("Brown-Conrady lens", "no radial lens") else ())
        for name in LAYOUTS
    ],
)
@examples(6)
@given(data=st.data())
def test_jacobian_equals_central_differences_column_by_column(lens, data):
    layout, theta, frame = data.draw(sightings(lens))
    evaluation = at(theta[None], pack(ALL_KINDS, [frame], SIZE, motion=MOTION), layout)
    numeric, with_half_steps = (numeric_jacobian(evaluation, steps_by=steps_by)[0] for steps_by in (1.0, 0.5))
    assume(column_errors(numeric, with_half_steps, floor=1e-2).max() < 1e-6)  # else there is a kink between the steps
    worst = dict(zip(layout.names, column_errors(jacobian(evaluation)[0], numeric, floor=1e-2), strict=True))
    assert max(worst.values()) < 5e-6, worst  # less than of a column that is wrong by 1e-5, see below


@pytest.mark.parametrize("lens", ["radial lens", pytest.param("Brown-Conrady lens", marks=pytest.mark.slow)])
@pytest.mark.parametrize("a1", [-0.38, pytest.param(-0.2, marks=pytest.mark.slow)])
def test_closest_points_are_found_through_lenses_far_stronger_than_those_of_broadcasts(lens, a1):
    """Steps that leave out how the lens bends do not arrive, and derivatives where they end are wrong by up to 90 %."""
    rng, layout, compared = np.random.default_rng(0), LAYOUTS[lens], 0
    for distance in 3 * (0.0, 50.0):
        theta = layout.theta(random_camera(DISTRIBUTIONS["main center"], rng))
        theta[layout.lens_block.start] = a1
        frame = beside_the_segments(ALL_KINDS, layout.camera(theta), distance, rng.uniform(-np.pi, np.pi))
        evaluation = at(theta[None], pack(ALL_KINDS, [frame], SIZE, motion=MOTION), layout)
        numeric, with_half_steps = (numeric_jacobian(evaluation, steps_by=steps_by) for steps_by in (1.0, 0.5))
        if column_errors(numeric, with_half_steps, floor=1e-2).max() < 1e-6:  # else there is a kink between the steps
            compared += 1
            assert column_errors(jacobian(evaluation), numeric, floor=1e-2).max() < 5e-6
    assert compared > 3


@quick_lenses
def test_jacobian_by_the_size_of_the_field(lens):
    evaluation = random_evaluation("main center", lens, 3, with_size=True)
    layout = evaluation.problem.layout
    errors = jacobian_errors(evaluation)
    worst = dict(zip(layout.names, errors.max(axis=0), strict=True))
    assert max(worst.values()) < 1e-6, worst
    by_size = (
        jacobian(evaluation)[:, :, layout.field_size_block] * (evaluation.problem.observations.weight > 0)[..., None]
    )
    assert np.all(np.abs(by_size).max(axis=(0, 1)) > 1.0)  # px a metre


def test_cameras_of_a_field_of_another_size_see_the_segments_where_they_are_then():
    evaluation = random_evaluation("main left", "radial lens", 3, with_size=True)
    theta, observations = evaluation.theta.copy(), evaluation.problem.observations
    theta[:, -2:] = (101.0, 71.0)
    pitch = {**soccer(101.0, 71.0), **{label: s for label, s in ALL_KINDS.items() if label not in FIELD}}
    resized = Observations.of(pitch, observations.pixels, SIZE)
    r = evaluate(evaluation.problem, theta).r
    expected = at(theta[:, :-2], resized).r
    np.testing.assert_allclose(observations.by_label(r**2), resized.by_label(expected**2), rtol=1e-6)
    assert np.max(np.abs(r - evaluation.r)) > 10.0


class OnGround:
    """A camera that sees segments where they stand on a ground that is not level."""

    def __init__(self, camera, terrain):
        self.camera, self.terrain = camera, terrain

    def __getattr__(self, name):
        return getattr(self.camera, name)

    def project(self, X):
        return self.camera.project(self.terrain.raised(np.asarray(X, dtype=float)))


@lenses("pinhole", "no radial lens", "Brown-Conrady lens", "zoom law", "fisheye lens")
@given(data=st.data())
def test_jacobian_on_ground_that_is_not_level(lens, data):
    camera = data.draw(cameras(lens=lens not in ("pinhole", "no radial lens")))
    camera = through_fisheye(camera) if lens == "fisheye lens" else camera
    crown, fall = data.draw(numbers(0.0, 0.4)), data.draw(st.sampled_from([0.0, 0.3]))
    block = SIZES._replace(crown=soccer().crown)
    layout = Layout.of(camera.image_size, LAYOUTS[lens].lens, block, LAYOUTS[lens].zoom_law)
    theta = layout.theta(camera)[None]
    theta[:, layout.crown_block] = crown
    terrain = Ground(crown, fall).on(105.0, 68.0)
    frame = beside_the_segments(ALL_KINDS, OnGround(camera, terrain), 15.0)
    frame = {label: xy for label, xy in frame.items() if not _bends_at_the_side(ALL_KINDS[label])}
    assume(frame)
    observations = pack(ALL_KINDS, [frame], camera.image_size, motion=MOTION)
    seen = at(theta, replace(observations, terrain=Terrain(0.0, fall, 105.0, 68.0)), layout)
    errors = jacobian_errors(seen)
    assert np.max(errors) < 1e-4, dict(zip(layout.names, errors[0], strict=True))


def _bends_at_the_side(segment):
    """Whether a clicked pixel near its end may lie past the side of the field, where the ground has an edge."""
    x, y, _ = np.abs(segment.sample(0.5)).T
    return np.any(y > 33.0) or np.any(x > 51.5)


@given(camera=cameras(lens=True), crown=numbers(0.0, 0.5), fall=numbers(0.0, 0.5))
def test_pixels_of_segments_on_the_ground_have_no_residual(camera, crown, fall):
    assume(camera.C[2] < -4.0)  # a camera at the height of the ridge sees circles from their edge
    field = soccer().with_ground(Ground(crown, fall))
    frame = observe(field, OnGround(camera, field.terrain))
    found = at(theta_from_camera(camera)[None], pack(field, [frame], camera.image_size))
    seen = found.problem.observations.weight > 0.0
    np.testing.assert_allclose(found.r[seen], 0.0, atol=1e-5)
    off = found.world_points[seen][:, 2] + field.terrain.height(found.world_points[seen])
    is_marking = np.array(
        [
            abs(field[found.problem.observations.labels[k]].sample()[:, 2]).max() == 0.0
            for k in found.problem.observations.label[seen]
        ]
    )
    np.testing.assert_allclose(off[is_marking], 0.0, atol=1e-5)


@quick_lenses
def test_the_checker_finds_a_wrong_jacobian(lens):
    evaluation = random_evaluation("main center", lens, 3, with_size=True)
    J = jacobian(evaluation)
    numeric = numeric_jacobian(evaluation)
    for column in range(J.shape[2]):
        wrong = J * (evaluation.problem.observations.weight[..., None] > 0.0)
        wrong[:, :, column] *= 1.0 + 1e-5
        errors = column_errors(wrong, numeric, floor=1e-2)
        moves = np.linalg.norm(numeric[:, :, column], axis=1) > 1.0  # no frame need show what the size moves
        assert np.any(moves)
        assert errors[moves, column].min() > 5e-6
        assert np.delete(errors, column, axis=1).max() < 1e-6


@pytest.mark.parametrize("free", [[3], [0, 2], [5], [8], [10, 11], [1, 3, 6, 7, 9], [4, 12, 15], [6, -1], [-2, -1]])
@pytest.mark.parametrize("lens", ["radial lens", "Brown-Conrady lens"])
def test_jacobian_of_some_parameters_is_a_part_of_the_whole(lens, free):
    evaluation = random_evaluation("main left", lens, 3, with_size=True)
    size = evaluation.problem.layout.size
    index = np.unique(np.array([i for i in free if i < size]) % size)
    part = jacobian(evaluation, np.isin(np.arange(size), index))
    np.testing.assert_allclose(part, jacobian(evaluation)[:, :, index], rtol=1e-12, atol=1e-11)


@given(
    camera=cameras(lens=True, image_sizes=(SIZE,)),
    others=vectors(-OTHER_COEFFICIENTS, OTHER_COEFFICIENTS),
    lens=st.sampled_from([Pinhole(RHO), RadialLens(RHO), BrownConradyLens(RHO)]),
    place=vectors((0.0, 0.0, 5.0), (959.0, 539.0, 80.0)),
    direction=angle(np.pi),
)
def test_derivatives_of_a_projection_are_those_of_the_camera(camera, others, lens, place, direction):
    """Of a point that the camera sees in any pixel and at any depth, along any direction of the image."""
    layout = Layout.of(SIZE, lens, SIZES)
    theta = Layout.of(SIZE, BrownConradyLens(RHO), SIZES).theta(camera)
    theta[RADIAL.size : RADIAL.size + 10] = others
    theta = np.concatenate([theta[: RADIAL.lens_block.start + len(lens.names)], theta[-2:]])
    a1 = theta[layout.lens_block][:1]
    a1[np.abs(a1) < 1e-3] = 1e-3  # the second derivative has a kink at 0: the differences must not straddle it
    (x, y, depth), (cx, cy) = place, camera.principal_point
    X = camera.C + camera.R.T @ (depth * np.array([(x - cx) / camera.focal_length, (y - cy) / camera.focal_length, 1]))
    n = np.array([np.cos(direction), np.sin(direction)])

    projection = Projection(theta[None], layout)
    h = projection.points(X[None, None])
    J = projection.derivatives(h[:2] / h[2], 1.0 / h[2], n[:, None, None], everything(layout))[0, :, 0]
    by_name = dict(zip(layout.names, J, strict=True))
    steps = [STEPS.get(name, 1e-4 if name in layout.lens.names else 1e-5) for name in layout.names]
    for i, (name, step) in enumerate(zip(layout.names, steps, strict=True)):
        if name in ("length", "width"):
            assert by_name[name] == 0.0  # the size moves points, not the camera
            continue

        def seen(value, i=i):
            return np.array([n @ layout.camera(np.where(np.arange(layout.size) == i, value[0], theta)).project(X)])

        numeric = central_differences(seen, theta[i : i + 1], step)[0, 0]
        assert by_name[name] == pytest.approx(numeric, rel=1e-6, abs=1e-4 * RHO * 1e-2), name


@examples(10)
@given(camera=cameras(lens=True))
def test_pixels_on_their_segments_have_no_residual(camera):
    frame = observe(ALL_KINDS, camera)
    assume(frame)
    observations = pack(ALL_KINDS, [frame], camera.image_size)
    r = at(theta_from_camera(camera)[None], observations).r[0]
    np.testing.assert_allclose(r, 0.0, atol=1e-6)


@examples(10)
@given(camera=cameras(lens=True), direction=angle(np.pi), distance=numbers(0.0, 20.0))
def test_residual_is_the_distance_to_the_nearest_point_of_the_image_of_the_segment(camera, direction, distance):
    frame = beside_the_segments(FIELD.markings, camera, distance, direction)
    assume(frame)
    observations = pack(FIELD, [frame], camera.image_size)
    r = at(theta_from_camera(camera)[None], observations).r[0]
    for index, label in enumerate(observations.labels):
        rows = observations.label[0] == index
        if not rows.any():
            continue
        segment = FIELD[label]
        if isinstance(segment, Line):  # whole lines: extended far beyond their ends
            start, end = np.array(segment.start), np.array(segment.end)
            X = start + np.linspace(-1.0, 2.0, 20001)[:, None] * (end - start)
        else:
            X = Arc(segment.center, segment.radius).sample(2.0 * np.pi * segment.radius / 20000)
        image = camera.project(X)
        image = image[np.isfinite(image).all(axis=1)]
        for distance, xy in zip(np.abs(r[rows]), frame[label], strict=True):
            gaps = np.linalg.norm(image - xy, axis=1)
            nearest = int(gaps.argmin())
            if 0 < nearest < len(gaps) - 1:  # else the sampled part ends before the foot point
                spacing = np.linalg.norm(image[nearest + 1] - image[nearest - 1])
                assert gaps[nearest] - spacing**2 / (gaps[nearest] + 1e-3) - 1e-3 <= distance <= gaps[nearest] + 1e-6


def behind_the_goal_line():
    """A camera in the penalty area that looks at the goal: both touchlines pass behind it."""
    return Camera.from_angles(np.radians(-80), np.radians(86), 0.02, 700.0, (-38.0, 3.0, -2.0), (960, 540))


def test_end_points_behind_the_camera_do_not_hurt():
    camera = behind_the_goal_line()
    theta = theta_from_camera(camera)[None]
    labels = ("Side line top", "Side line bottom")
    frame = {}
    for label in labels:
        segment = FIELD[label]
        assert camera.depth(segment.start) > 0.0 > camera.depth(segment.end)
        xy = camera.project(segment.sample(0.1))
        frame[label] = xy[np.isfinite(xy).all(axis=1)][[0, 20]]
    observations = pack(FIELD, [frame], camera.image_size)
    np.testing.assert_allclose(at(theta, observations).r, 0.0, atol=1e-7)
    moved = {label: xy + (3.0, -5.0) for label, xy in frame.items()}
    observations = pack(FIELD, [moved], camera.image_size)
    free = everything()
    free[RADIAL.lens_block] = False  # pixels far outside the image: the lens has nothing to say there
    assert jacobian_errors(at(theta, observations), free).max() < 1e-6


def test_a_foot_point_at_infinity_has_a_residual_and_a_jacobian():
    camera = Camera.from_angles(0.3, 1.45, 0.0, 1200.0, (0.0, 60.0, -12.0), (960, 540))
    theta = theta_from_camera(camera)[None]
    vanishing = camera.homography @ (1.0, 0.0, 0.0)  # of the touchlines
    normal_step = np.array([0.2, 4.0])
    frame = {"Side line top": np.array([vanishing[:2] / vanishing[2], vanishing[:2] / vanishing[2] + normal_step])}
    observations = pack(FIELD, [frame], camera.image_size)
    evaluation = at(theta, observations)
    assert abs(evaluation.points.inverse_depth[0, 0]) < 1e-12
    assert abs(evaluation.r[0, 0]) < 1e-9
    free = everything()
    free[RADIAL.lens_block] = False
    assert np.all(np.isfinite(evaluation.derivatives(free)))
    assert jacobian_errors(evaluation, free).max() < 1e-6


@examples(10)
@given(camera=cameras(lens=False), offset=vectors((-9.0, -9.0), (9.0, 9.0)), share=numbers(-2.0, 2.0))
def test_sliding_along_a_line_changes_nothing(camera, offset, share):
    theta, image_size = theta_from_camera(camera), camera.image_size
    lines = {label: segment for label, segment in FIELD.items() if isinstance(segment, Line)}
    frame = observe(lines, camera)
    assume(frame)
    slid = {label: xy + offset + share * (xy[-1] - xy[0]) for label, xy in frame.items()}
    moved = {label: xy + offset for label, xy in frame.items()}
    r, r_slid = (at(theta[None], pack(FIELD, [f], image_size)).r for f in (moved, slid))
    np.testing.assert_allclose(r_slid, r, atol=1e-6)


@examples(10)
@given(camera=cameras(lens=True), direction=angle(np.pi))
def test_enlarging_the_image_enlarges_the_residuals(camera, direction):
    theta, (width, height) = theta_from_camera(camera), camera.image_size
    frame = beside_the_segments(FIELD.markings, camera, 5.0, direction)
    assume(frame)
    r = at(theta[None], pack(FIELD, [frame], (width, height))).r
    larger = theta.copy()
    larger[LOG_F] += np.log(2.0)
    larger[PRINCIPAL_POINT] *= 2.0
    doubled = {label: 2.0 * xy for label, xy in frame.items()}
    r_larger = at(larger[None], pack(FIELD, [doubled], (2 * width, 2 * height))).r
    np.testing.assert_allclose(r_larger, 2.0 * r, atol=1e-5)


@examples(10)
@given(camera=cameras(lens=False), direction=angle(np.pi))
def test_a_lens_of_zero_is_no_lens(camera, direction):
    theta, image_size = theta_from_camera(camera), camera.image_size
    frame = beside_the_segments(ALL_KINDS, camera, 10.0, direction)
    assume(frame)
    observations = pack(ALL_KINDS, [frame], image_size)
    nearly = theta.copy()
    nearly[RADIAL.lens_block.start] = 1e-13  # takes the way through the lens
    straight, bent = at(theta[None], observations), at(nearly[None], observations)
    np.testing.assert_allclose(bent.r, straight.r, atol=1e-6)
    np.testing.assert_allclose(bent.JT, straight.JT, rtol=1e-5, atol=1e-4)


def test_frames_together_or_one_by_one_have_the_same_residuals():
    evaluation = random_evaluation("main right", "no radial lens", 6)
    observations = evaluation.problem.observations
    for t in range(len(observations)):
        alone = observations.take(np.array([t]))
        seen = observations.weight[t] > 0.0
        r = at(evaluation.theta[t : t + 1], alone).r
        np.testing.assert_allclose(r[0, seen], evaluation.r[t, seen], atol=1e-9)


def test_a_point_has_two_residuals_in_pixels():
    camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    xy = camera.project(FIELD["CENTER_MARK"].X) + (3.0, -4.0)
    r = at(theta_from_camera(camera)[None], pack(FIELD, [{"CENTER_MARK": xy[None]}], (960, 540))).r
    np.testing.assert_allclose(r, [[3.0, -4.0]], atol=1e-9)


def test_an_unordered_cloud_gives_the_offset_to_its_nearest_sample():
    cloud = {"cloud": PointCloud([(-5.0, 0.0, 0.0), (5.0, 0.0, 0.0), (5.0, 5.0, -1.0)])}
    camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    xy = camera.project(cloud["cloud"].X)[[2, 0]] + (1.0, 2.0)
    observations = pack(cloud, [{"cloud": xy}], (960, 540))
    theta = theta_from_camera(camera)[None]
    np.testing.assert_allclose(at(theta, observations).r, [[1.0, 1.0, 2.0, 2.0]], atol=1e-9)
    assert jacobian_errors(at(theta, observations)).max() < 1e-6


def test_an_ordered_cloud_is_the_curve_that_it_samples():
    circle = {"circle": CIRCLE}
    cloud = {"circle": PointCloud(CIRCLE.sample(0.1), ordered=True)}
    camera = Camera.from_angles(0.1, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    xy = camera.project(CIRCLE.sample(1.0)) + (1.0, -2.0)
    theta = theta_from_camera(camera)[None]
    r, r_cloud = (at(theta, pack(o, [{"circle": xy}], (960, 540))).r for o in (circle, cloud))
    np.testing.assert_allclose(np.abs(r_cloud), np.abs(r), atol=1e-3)


def test_a_camera_in_the_plane_of_a_circle_stops_nothing():
    camera = Camera.from_angles(0.0, np.pi / 2, 0.0, 900.0, (0.0, 30.0, 0.0), (960, 540))
    frame = {"Circle central": np.array([[480.0, 280.0], [400.0, 300.0]]), "Side line top": np.array([[1.0, 2.0]])}
    evaluation = at(theta_from_camera(camera)[None], pack(FIELD, [frame], (960, 540)))
    assert np.all(np.isfinite(evaluation.r))
    assert np.all(np.isfinite(evaluation.derivatives(np.arange(RADIAL.size) < CENTER.stop)))


def test_aspect_stretches_the_rows_alone():
    theta = random_evaluation("main center", "no radial lens", 2).theta
    theta[:, LOG_ASPECT] = 0.1
    camera = camera_from_theta(theta[0], (960, 540))
    assert np.isclose(camera.K[1, 1], np.exp(0.1) * camera.K[0, 0])
    frame = observe(FIELD.markings, camera)
    r = at(theta[:1], pack(FIELD, [frame], (960, 540))).r
    np.testing.assert_allclose(r, 0.0, atol=1e-6)


def test_a_short_ordered_cloud_is_the_same_beside_a_longer_one():
    s = np.linspace(0.0, 1.0, 5)[:, None]
    short = PointCloud(np.concatenate([20.0 * s, 8.0 * s**2, 0.0 * s], axis=1), ordered=True)
    clouds = {"short": short, "long": PointCloud(CIRCLE.sample(0.5), ordered=True)}
    camera = Camera.from_angles(0.1, 1.3, 0.0, 900.0, (0.0, 60.0, -15.0), (960, 540))
    theta = theta_from_camera(camera)[None]
    past_the_end = camera.project([[21.0, 9.0, 0.0], [20.5, 8.1, 0.0], [10.0, 2.5, 0.0]])
    alone = pack(clouds, [{"short": past_the_end}], (960, 540))
    beside = pack(clouds, [{"short": past_the_end, "long": camera.project(CIRCLE.sample(5.0))}], (960, 540))
    alone, beside = at(theta, alone), at(theta, beside)
    np.testing.assert_allclose(beside.r[:, :3], alone.r, atol=1e-9)
    np.testing.assert_allclose(beside.JT[:, :, :3], alone.JT, atol=1e-6)


def test_the_distance_to_a_circle_does_not_jump_in_its_plane():
    def distances(height):
        camera = Camera.from_angles(0.0, np.pi / 2, 0.0, 900.0, (0.0, 30.0, -height), (960, 540))
        frame = {"Circle central": np.array([[480.0, 280.0], [450.0, 300.0]])}
        return np.abs(at(theta_from_camera(camera)[None], pack(FIELD, [frame], (960, 540))).r)

    np.testing.assert_allclose(distances(0.0), distances(1e-6), atol=0.1)
    assert distances(0.0).min() > 5.0
