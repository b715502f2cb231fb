"""baselines.jiang: four points and homographies, the field warped by them, both costs, the optimisation."""

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from strategies import examples

from baselines.jiang.estimate import homographies
from baselines.jiang.four_points import (
    CANONICAL,
    CELL,
    field_drawing,
    homography_of_points,
    points_of_homography,
    warped_field,
)
from baselines.jiang.lines import LineCost
from baselines.jiang.networks import ErrorNetwork
from baselines.jiang.optimiser import optimise
from baselines.jiang.training_pairs import SIZE, augmented, overlap, perturbed
from fieldcalib import Camera, soccer
from fieldcalib.geometry.homography import ALIGNMENTS
from fieldcalib.localize import Localization
from fieldcalib.metrics import iou_whole

JIANG = ALIGNMENTS["jiang"]
IMAGE = JIANG.image_size
FIELD = soccer(*JIANG.template)

pans, tilts, focals = st.floats(-0.5, 0.5), st.floats(1.3, 1.42), st.floats(1500.0, 4500.0)


def camera_of(pan, tilt, f):
    return Camera.from_angles(pan, tilt, 0.01, f, (1.0, 78.0, -17.0), IMAGE)


def points_of(camera):
    return points_of_homography(JIANG.from_fieldcalib(camera.homography))


def up_to_scale(H):
    H = np.asarray(H)
    return H / np.linalg.norm(H, axis=(-2, -1), keepdims=True) * np.sign(H[..., 2:, 2:])


@given(pans, tilts, focals)
def test_four_points_are_a_homography(pan, tilt, f):
    camera = camera_of(pan, tilt, f)
    points = points_of(camera)
    np.testing.assert_allclose(points, camera.image_to_field((CANONICAL + 0.5) * IMAGE)[:, :2] / JIANG.template)
    H = homography_of_points(torch.tensor(points))
    expected = cv2.getPerspectiveTransform(CANONICAL.astype(np.float32), points.astype(np.float32))
    np.testing.assert_allclose(up_to_scale(H), up_to_scale(expected), rtol=1e-4, atol=1e-5)
    (back,) = homographies(torch.tensor(points)[None], (960, 540))
    scaled = camera.scaled((960, 540))
    np.testing.assert_allclose(up_to_scale(back), up_to_scale(scaled.homography), rtol=1e-9, atol=1e-9)


def test_points_on_a_line_have_no_homography():
    assert homographies(torch.tensor([[[0.0, 0.0], [0.1, 0.0], [0.2, 0.0], [0.3, 0.0]]]), IMAGE) == [None]


def test_the_homography_is_differentiable():
    points = torch.tensor(np.stack([points_of(camera_of(pan, 1.36, 2500.0)) for pan in (-0.3, 0.2)]))
    assert torch.autograd.gradcheck(homography_of_points, points.requires_grad_())


def test_the_drawing_shows_lines_grass_and_what_is_around():
    drawing = field_drawing()
    rows, columns = drawing.shape
    assert (drawing[0, 0], drawing[rows // 2, columns // 4]) == (-1.0, 0.0)
    assert drawing[rows // 2, columns // 2] > 0.9
    np.testing.assert_allclose(drawing, drawing[:, ::-1], atol=1e-3)
    np.testing.assert_allclose(drawing, drawing[::-1], atol=1e-3)


@pytest.mark.parametrize("pan", [-0.4, 0.0, 0.3])
def test_the_field_is_warped_as_opencv_does_it(pan):
    drawing = field_drawing()
    rows, columns = drawing.shape
    H = homography_of_points(torch.tensor(points_of(camera_of(pan, 1.36, 2200.0))))
    warped = warped_field(H[None], torch.tensor(drawing), 200)[0].numpy()
    from_pixels = np.array([[1 / 200, 0, 0.5 / 200 - 0.5], [0, 1 / 200, 0.5 / 200 - 0.5], [0, 0, 1]])
    length, width = JIANG.template
    to_cells = np.array([[length / CELL, 0, (columns - 1) / 2], [0, width / CELL, (rows - 1) / 2], [0, 0, 1]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    by_opencv = cv2.warpPerspective(
        drawing, to_cells @ H.numpy() @ from_pixels, (200, 200), flags=flags, borderValue=-1
    )
    difference = np.abs(warped[0] - by_opencv)
    assert difference.mean() < 2e-3  # OpenCV rounds coordinates to 1/32 of a cell
    assert difference.max() < 0.1
    inside = np.any(warped[1:] != 0.0, axis=0)
    u = (np.stack(np.meshgrid(np.arange(200), np.arange(200)), axis=-1) + 0.5) / 200 - 0.5
    x = np.concatenate([u, np.ones((200, 200, 1))], axis=-1) @ H.numpy().T
    np.testing.assert_allclose(np.moveaxis(warped[1:], 0, -1)[inside], (x[..., :2] / x[..., 2:])[inside], atol=1e-5)


def test_nothing_is_seen_above_the_horizon():
    H = homography_of_points(torch.tensor(points_of(camera_of(0.0, 1.55, 1500.0))))
    warped = warped_field(H[None], torch.tensor(field_drawing()), 64)[0]
    assert torch.all(warped[0, :20] == -1.0)
    assert torch.all(warped[1:, :20] == 0.0)


def test_the_warped_field_is_differentiable():
    x = np.linspace(-1.0, 1.0, 40)
    smooth = torch.tensor(np.add.outer(0.3 * x, 0.5 * x))  # bilinear interpolation is exact, without kinks
    points = torch.tensor(points_of(Camera.from_angles(0.0, 1.1, 0.0, 3500.0, (0.0, 35.0, -17.0), IMAGE)))[None]

    def seen(points):
        return warped_field(homography_of_points(points), smooth, 5)

    assert torch.all(seen(points)[:, 1:].abs().sum(dim=1) > 0.0)  # grass everywhere
    assert torch.autograd.gradcheck(seen, points.requires_grad_())


def test_the_predicted_error_is_differentiable_by_the_points():
    torch.manual_seed(0)
    network = ErrorNetwork(4, 48).eval()
    pictures, points = torch.rand(1, 3, 48, 48), torch.tensor(points_of(camera_of(0.2, 1.36, 2500.0))).float()[None]
    points.requires_grad_()
    network(pictures, points).sum().backward()
    assert torch.all(torch.isfinite(points.grad))
    assert torch.any(points.grad != 0.0)


def test_layers_of_the_error_network_are_spectrally_normalised():
    torch.manual_seed(0)
    network = ErrorNetwork(4, 32)
    for _ in range(30):  # power iterations
        network(torch.rand(2, 3, 32, 32), torch.tensor(0.3 * CANONICAL).float().expand(2, -1, -1))
    weights = [module.weight for module in network.modules() if isinstance(module, torch.nn.Conv2d | torch.nn.Linear)]
    assert len(weights) == 21
    for weight in weights:
        assert torch.linalg.matrix_norm(weight.detach().flatten(1), 2) == pytest.approx(1.0, abs=0.05)


@given(pans, tilts, focals, st.integers(0, 2**32))
@examples(50)
def test_the_overlap_is_iou_whole(pan, tilt, f, seed):
    truth = points_of(camera_of(pan, tilt, f))
    points = perturbed(truth, np.random.default_rng(seed))
    views = homographies(torch.tensor(np.stack([points, truth])), IMAGE)
    assert overlap(points, truth) == pytest.approx(iou_whole(*views, IMAGE), abs=0.01)


def test_a_training_picture_and_its_homography_go_together():
    H = JIANG.from_fieldcalib(camera_of(-0.2, 1.36, 2000.0).homography)
    drawing = torch.tensor(field_drawing())

    def seen(H):
        warped = warped_field(homography_of_points(torch.tensor(points_of_homography(H)))[None], drawing, SIZE)
        return np.repeat(np.uint8(100.0 * (1.0 + warped[0, 0].numpy()))[..., None], 3, axis=-1)

    for seed in range(4):
        image, of_window = augmented(seen(H), H, np.random.default_rng(seed))
        green, expected = image[..., 1].astype(float), seen(of_window)[..., 1]
        green *= 100.0 / np.median(green[expected == 100])  # grass
        assert np.abs(green - expected).mean() < 2.0  # blurred lines; 10 and more if one of the two were mirrored


def test_the_cost_of_lines_is_that_of_projected_markings():
    camera = camera_of(0.25, 1.36, 2200.0)
    pixels = {}
    for label in ("Side line top", "Big rect. right main", "Circle right", "Big rect. right top"):
        xy = camera.project(FIELD[label].sample(1.0))
        pixels[label] = xy[np.all((xy >= 0.0) & (xy <= IMAGE), axis=1)]
    found = Localization(pixels, {label: np.ones(len(xy)) for label, xy in pixels.items()})
    truth = torch.tensor(points_of(camera)).float()
    empty = Localization({}, {})
    cost = LineCost.of([found, empty], IMAGE)
    assert cost(torch.stack([truth, truth])).tolist() == pytest.approx([0.0, 0.0], abs=1e-3)
    moved = Localization({label: xy + (0.0, 4.0) for label, xy in pixels.items()}, found.weights)
    (value,) = LineCost.of([moved], IMAGE)(truth[None])
    assert 0.5 < value < 9.0 * np.log1p(1.0)  # 3 px of 960x540 across horizontal lines, less across others

    double = LineCost(*(getattr(cost, name)[:1].double() for name in ("pixels", "lines", "conics", "weights")))
    start = (truth[None] + 0.003).double().requires_grad_()
    assert torch.autograd.gradcheck(double, start)

    rng = np.random.default_rng(0)
    initial = truth + torch.tensor(rng.normal(0.0, 0.02, (4, 2))).float()
    path = optimise(LineCost.of([found], IMAGE), initial[None])
    before, after = (overlap(points.numpy(), truth.numpy()) for points in (initial, path.best[0]))
    assert before < 0.6 < 0.95 < after


def test_the_iterate_of_least_cost_is_kept():
    truth = torch.zeros(2, 4, 2)

    def cost(points):
        return (points - truth).square().sum(dim=(1, 2)).sqrt()

    path = optimise(cost, torch.stack([torch.full((4, 2), 0.0105), torch.full((4, 2), 0.3)]), steps=30)
    assert path.points.shape == (31, 2, 4, 2)
    np.testing.assert_allclose(cost(path.best), path.costs.min(dim=0).values)
    assert path.costs[-1, 0] > path.costs[:, 0].min()  # Adam overshoots
    assert path.costs[-1, 1] == path.costs[:, 1].min()
    alone = optimise(lambda points: (points - truth[:1]).square().sum(dim=(1, 2)).sqrt(), path.points[0, :1], steps=30)
    assert torch.equal(alone.points[:, 0], path.points[:, 0])  # each frame by itself
