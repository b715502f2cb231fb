"""TVCalib (Theiner, Ewerth, WACV 2023): a loss in normalised device coordinates, minimised by AdamW from a mean camera.

Loss, camera distributions and details are those of the public code, so that the published numbers can be reproduced.
To calibrate, use `fieldcalib.calibrate_batch`. The camera is

    phi = (pan, tilt, roll, field of view, x, y, z) = mean + sigma z-score,

in radians and metres, with the principal point in the image's centre and no lens. In normalised device coordinates,
where both axes of the image run from -1 to 1, it projects by ``P = diag(fx, fy, 1) R [I | -C]``,
``fx = 1 / tan(fov / 2)`` and ``fy = fx width / height``. The gradient is analytic: every distance is differentiated by
P, and P by phi.

    python -m baselines.tvcalib INPUT --size 960x540 --out DIR [--initial-cameras center|stacked|argmin] [--tau 0.019]

writes what `fieldcalib calibrate` writes.

The distances are not differentiable where pixels lie on their segments, and large steps near such points are chaotic:
initial cameras that differ by 1e-12 lead to different results, and AC@5 over a hundred frames changes by half a point.

Tensors are T frames x S segments x N pixels as in the paper; padding has weight 0.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from baselines.adamw import minimise
from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.findings import Status
from fieldcalib.assess.ndc import cloud_samples
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import (
    add_input_and_output,
    add_run_options,
    add_sized_field,
    annotation_reader,
    field_of,
    positive,
    run_options,
)
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.fields.segments import Segment
from fieldcalib.fields.traits import MAIN_CENTER, MAIN_LEFT, MAIN_RIGHT, CameraDistribution, focal_length_from_fov
from fieldcalib.geometry.homography import TINY, homogenize
from fieldcalib.geometry.rotation import rotation_axes, rotation_from_angles
from fieldcalib.io.soccernet import CAMERA_TYPES, DISTRIBUTIONS_OF_TYPE, read_camera_types
from fieldcalib.problem.labelled_pixels import Pixels, split_circles
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F, PRINCIPAL_POINT, ROLL, Layout, camera_from_theta
from fieldcalib.run_folder.labelled_frames import CalibratedFrame, calibrate_folder
from fieldcalib.run_folder.work_units import in_groups
from fieldcalib.solve.from_homography import judged_camera
from fieldcalib.solve.from_segments import NOTHING_LABELLED

FOV = LOG_F  # phi has the order of theta, with the field of view instead of the logarithm of the focal length
STEPS = 2000
LINE_PIXELS = 4  # at most, per segment (paper, section "Hyperparameters")
CIRCLE_PIXELS = 8
SEED = 0  # for the random choice where a segment has more pixels
SIGMA = 1.96 / np.sqrt(
    12.0
)  # standard deviation for a range of length 1 in the public code; the paper's text suggests 1 / (2 x 1.96)
CHUNK = 64  # frames that are optimised together: their arrays fit into the processor's cache

# The range of x is that of the public code; in its place the paper's appendix repeats the range of z.
DISTRIBUTIONS: Mapping[str, CameraDistribution] = {
    d.name: d for d in (replace(MAIN_CENTER, x=(-12.0, 12.0)), MAIN_LEFT, MAIN_RIGHT)
}


def calibrate(
    field: ObjectSegments,
    frames: Sequence[Pixels],
    image_size: tuple[int, int],
    *,
    steps: int = STEPS,
    tau: float | None = None,
    distributions: Sequence[str] = ("main center",),
) -> list[Calibration]:
    """Calibrate many independent frames by the paper's method.

    Parameters
    ----------
    field : mapping of str to segment
        The calibration object, e.g. `soccer()`.
    frames : sequence of dicts of str to (N, 2) array
        Pixels by label, as `check_segments` returns them.
    image_size : (int, int)
        Width and height of every frame, pixels.
    steps : int
        Number of steps of AdamW.
    tau : float, optional
        Reject frames with a larger loss; 0.019 in the paper. Rejected frames keep their cameras.
    distributions : sequence of str
        Keys of `DISTRIBUTIONS` whose means are the initial cameras; the result with the least loss is taken (paper,
        section "Multiple Initialization").

    Returns
    -------
    list of Calibration
        In the order of `frames`. `loss_ndc` is the minimised loss, over at most 4 visible pixels of a line and 8 of a
        circle.

    Raises
    ------
    ValueError
        An unknown distribution, or fewer than three steps.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> truth = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (960, 540))
    >>> labels = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left")
    >>> pixels = {label: truth.project(soccer()[label].sample(7.0)) for label in labels}
    >>> (calibration,) = calibrate(soccer(), [pixels], (960, 540), tau=0.019)
    >>> str(calibration.status), calibration.loss_ndc < 0.01
    ('accepted', True)
    """
    unknown = [name for name in distributions if name not in DISTRIBUTIONS]
    if unknown or not distributions:
        raise ValueError(f"distributions must name some of {', '.join(DISTRIBUTIONS)}, got {tuple(distributions)}")
    empty = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, NOTHING_LABELLED)
    calibrations = [empty] * len(frames)
    for chunk in _chunks(field, frames):
        members = [frames[t] for t in chunk]
        tensors = pack_tensors(field, members, image_size)
        trials = [_optimise(tensors, DISTRIBUTIONS[name], steps) for name in distributions]
        phis, losses = (np.array(values) for values in zip(*trials, strict=True))
        best = np.argmin(losses, axis=0), np.arange(len(members))
        thetas = theta_from_phi(phis[best], image_size)
        results = _results(field, members, image_size, thetas, losses[best], tau)
        for t, calibration in zip(chunk, results, strict=True):
            calibrations[t] = calibration
    return calibrations


def _chunks(field: ObjectSegments, frames: Sequence[Pixels]) -> Iterator[IntArray]:
    """Indices of the frames with pixels, in chunks with similar numbers of segments, which need little padding."""
    circles = np.array([sum(not field[label].is_straight for label in frame) for frame in frames], dtype=np.intp)
    segments = np.array([len(frame) for frame in frames], dtype=np.intp)
    order = np.lexsort((segments, circles))
    order = order[segments[order] > 0]
    for begin in range(0, len(order), CHUNK):
        yield order[begin : begin + CHUNK]


def _optimise(tensors: Tensors, distribution: CameraDistribution, steps: int) -> tuple[Array, Array]:
    """Minimise from the mean of a distribution: cameras phi (T, 7) and their losses (T,)."""
    d = distribution
    low, high = np.array([*np.radians([d.pan, d.tilt, d.roll, d.fov]), d.x, d.y, d.z]).T
    mean, sigma = (low + high) / 2.0, SIGMA * (high - low)

    def gradient(z: Array) -> Array:
        _, dloss_dphi = loss_with_gradient(mean + sigma * z, tensors)
        return np.asarray(dloss_dphi * sigma)

    phi = mean + sigma * minimise(gradient, np.zeros((len(tensors.lines.X), len(mean))), steps)
    loss, _ = loss_with_gradient(phi, tensors)
    return phi, loss


def _results(
    field: ObjectSegments,
    frames: list[Pixels],
    image_size: tuple[int, int],
    thetas: Array,
    losses: Array,
    tau: float | None,
) -> list[Calibration]:
    """Calibrations of cameras theta, rejected where the loss is above tau."""
    results = []
    for frame, theta, loss in zip(frames, thetas, losses.tolist(), strict=True):
        camera = camera_from_theta(theta, image_size)
        message = f"the loss in NDC is {loss:.4f}"
        result = replace(judged_camera(camera, field, frame, message), _loss=loss)
        if tau is not None and not loss <= tau:
            result = replace(result, status=Status.REJECTED, message=f"{message}, above tau = {tau:g}")
        results.append(result)
    return results


def theta_from_phi(phi: Array, image_size: tuple[int, int]) -> Array:
    """Convert cameras phi (T, 7) to parameter vectors (T, n).

    A negative focal length turns the image by 180 degrees: it is replaced by a positive one and a roll of 180 degrees.
    """
    f = focal_length_from_fov(phi[:, FOV], image_size[0])
    theta = np.zeros((len(phi), Layout.of(image_size).size))
    theta[:, ANGLES], theta[:, CENTER] = phi[:, ANGLES], phi[:, CENTER]
    theta[:, ROLL] += np.where(f < 0.0, np.pi, 0.0)
    theta[:, LOG_F] = np.log(np.abs(f))
    theta[:, PRINCIPAL_POINT] = np.divide(image_size, 2.0)
    return theta


# --- the tensors ---


@dataclass(frozen=True)
class Packed:
    """Pixels on lines or on circles: T frames, padded to S segments of N pixels each."""

    X: Array
    """Homogeneous world vectors of the segments, (T, 4, S, K): start and direction of lines, or samples of circles."""
    p: Array
    """Pixels in normalised device coordinates, (2, T, S, N)."""
    weight: Array
    """One over the number of these pixels in the frame, (T, S, N); 0 for padding and outside the image."""


@dataclass(frozen=True)
class Tensors:
    """Input of the loss for T frames."""

    lines: Packed
    circles: Packed
    aspect: float
    """Width over height of the image."""


def pack_tensors(field: ObjectSegments, frames: Sequence[Pixels], image_size: tuple[int, int]) -> Tensors:
    """Pack frames as the paper does: a few pixels in the image per segment, the centre circle split into halves.

    Points and clouds are packed with the circles. Pixels are chosen at random with a fixed seed.
    """
    split = [split_circles(field, frame, image_size) for frame in frames]
    segments = [[(field[label], xy) for label, xy in frame.items()] for frame in split]
    lines, circles = (
        [[(segment, xy) for segment, xy in frame if segment.is_straight == straight] for frame in segments]
        for straight in (True, False)
    )
    line_tensors = _pack(lines, LINE_PIXELS, image_size)
    # N is the first axis in memory, so that the innermost loops run over T x S
    p, weight = (np.moveaxis(np.moveaxis(a, -1, 0).copy(), 0, -1) for a in (line_tensors.p, line_tensors.weight))
    return Tensors(
        replace(line_tensors, p=p, weight=weight),
        _pack(circles, CIRCLE_PIXELS, image_size),
        image_size[0] / image_size[1],
    )


def _pack(frames: list[list[tuple[Segment, Array]]], pixels: int, image_size: tuple[int, int]) -> Packed:
    """Pack lines or circles with at most `pixels` pixels each."""
    geometry = {segment: _homogeneous(segment) for frame in frames for segment, _ in frame}
    T, S = len(frames), max(map(len, frames), default=0)
    K = max((len(vectors) for vectors in geometry.values()), default=1)
    X, p, visible = np.zeros((T, S, K, 4)), np.zeros((T, S, pixels, 2)), np.zeros((T, S, pixels), dtype=bool)
    for t, frame in enumerate(frames):
        rng = np.random.default_rng(SEED)  # for each frame, so that its pixels do not depend on the other frames
        for s, (segment, xy) in enumerate(frame):
            chosen = rng.choice(xy, pixels, replace=False) if len(xy) > pixels else xy
            vectors = geometry[segment]
            X[t, s] = vectors[np.minimum(np.arange(K), len(vectors) - 1)]
            p[t, s, : len(chosen)] = 2.0 * chosen / image_size - 1.0
            visible[t, s, : len(chosen)] = _in_image(chosen, image_size)
    weight = visible / np.maximum(np.sum(visible, axis=(1, 2), keepdims=True), 1)
    return Packed(np.moveaxis(X, -1, 1).copy(), np.moveaxis(p, -1, 0).copy(), weight)


def _in_image(xy: Array, image_size: tuple[int, int]) -> BoolArray:
    """Mask of the pixels in the image; as in the public code, y = 0 is outside."""
    x, y = xy.T
    width, height = image_size
    return np.asarray((x >= 0.0) & (x < width) & (y > 0.0) & (y < height))


def _homogeneous(segment: Segment) -> Array:
    """Start and direction of a line (2, 4), or samples of any other segment (K, 4)."""
    if segment.is_straight:
        return np.column_stack([segment.vectors, (1.0, 0.0)])
    return homogenize(cloud_samples(segment))


# --- the loss and its gradient ---


def loss_with_gradient(phi: Array, tensors: Tensors) -> tuple[Array, Array]:
    """Loss of T frames and its derivative by their cameras.

    The loss is the mean distance of the pixels on lines to their infinite lines plus the mean distance of the pixels on
    circles to the nearest samples; an absent kind counts 0 (`fieldcalib.assess.ndc`, "tvcalib"). With ``M = diag(f) R``
    and ``P = M [I | -C]``, f = (fx, fy, 1),

        dM = dP_123 - dP_4 C^T,    dC = -M^T dP_4,    dR = diag(f) dM,    dangle = -axis . sum_j R_j x dR_j,

    where d stands for the derivative of the loss, R_j and P_j for columns, and the axes are those of `rotation_axes`.

    Parameters
    ----------
    phi : (T, 7) array
        Pan, tilt, roll, field of view (radians), x, y, z (metres).
    tensors : Tensors
        Pixels of T frames.

    Returns
    -------
    loss : (T,) array
    dloss_dphi : (T, 7) array
        A one-sided derivative where there is no other: where a pixel lies on its line, or is as near to one sample as
        to another.
    """
    R, C = rotation_from_angles(phi[:, ANGLES]), phi[:, CENTER]
    fx = 1.0 / np.tan(0.5 * phi[:, FOV])
    f = np.array([fx, tensors.aspect * fx, np.ones_like(fx)]).T[..., None]
    M = f * R
    P = np.concatenate([M, -M @ C[..., None]], axis=2)
    line_loss, line_dP = _lines(P, tensors.lines)
    circle_loss, circle_dP = _circles(P, tensors.circles)
    dP = line_dP + circle_dP

    dM = dP[..., :3] - dP[..., 3:] * C[:, None]
    df = np.sum(dM * R, axis=2)
    turn = R @ np.swapaxes(f * dM, 1, 2)
    moment = np.array([turn[:, 1, 2] - turn[:, 2, 1], turn[:, 2, 0] - turn[:, 0, 2], turn[:, 0, 1] - turn[:, 1, 0]]).T
    dphi = np.empty_like(phi)
    dphi[:, ANGLES] = -(rotation_axes(phi[:, ANGLES], R) @ moment[..., None])[..., 0]
    dphi[:, FOV] = -0.5 * (1.0 + np.square(fx)) * (df[:, 0] + tensors.aspect * df[:, 1])
    dphi[:, CENTER] = -(np.swapaxes(M, 1, 2) @ dP[..., 3:])[..., 0]
    return line_loss + circle_loss, dphi


def _lines(P: Array, lines: Packed) -> tuple[Array, Array]:
    """Mean distance (T,) to the image lines ``l = (P X) x (P D)``, and its derivative by P, (T, 3, 4)."""
    T, _, S, _ = lines.X.shape
    if S == 0:
        return np.zeros(T), np.zeros_like(P)
    X = lines.X.reshape(T, 4, 2 * S)
    h = np.ascontiguousarray(np.moveaxis((P @ X).reshape(T, 3, S, 2), (1, 3), (0, 1)))
    (ax, dx), (ay, dy), (az, dz) = h
    lx, ly, lz = ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx
    scale = 1.0 / (np.sqrt(lx * lx + ly * ly) + TINY)
    nx, ny = lx * scale, ly * scale
    px, py = lines.p
    signed = nx[..., None] * px + ny[..., None] * py + (lz * scale)[..., None]
    side = np.copysign(lines.weight, signed)
    distance = np.sum(side * signed, axis=2)  # weighted sum per segment
    # the derivative of the distance by l is scale (p - signed n, 1)
    gx = scale * (np.sum(side * px, axis=2) - nx * distance)
    gy = scale * (np.sum(side * py, axis=2) - ny * distance)
    gz = scale * np.sum(side, axis=2)
    # with l = a x d and the derivative g by l: d x g by a, g x a by d
    dh = np.empty((T, 3, S, 2))
    dh[:, 0, :, 0], dh[:, 0, :, 1] = dy * gz - dz * gy, gy * az - gz * ay
    dh[:, 1, :, 0], dh[:, 1, :, 1] = dz * gx - dx * gz, gz * ax - gx * az
    dh[:, 2, :, 0], dh[:, 2, :, 1] = dx * gy - dy * gx, gx * ay - gy * ax
    return np.sum(distance, axis=1), dh.reshape(T, 3, 2 * S) @ np.swapaxes(X, 1, 2)


def _circles(P: Array, circles: Packed) -> tuple[Array, Array]:
    """Mean distance (T,) to the nearest samples, and its derivative by P, (T, 3, 4)."""
    T, _, S, K = circles.X.shape
    if S == 0:
        return np.zeros(T), np.zeros_like(P)
    px, py = circles.p
    # |s - p|^2 - |p|^2 has the same minimum and is (s, |s|^2) . (-2 p, 1), one product of matrices. Computed in place:
    # with temporary arrays, which are returned to the system in every step, this takes six times as long.
    h = (P @ circles.X.reshape(T, 4, S * K)).reshape(T, 3, S, K)
    h[:, 2] = _inverse(h[:, 2])
    h[:, :2] *= h[:, 2:]
    np.einsum("tcsk,tcsk->tsk", h[:, :2], h[:, :2], out=h[:, 2])
    pixels = np.array([-2.0 * px, -2.0 * py, np.ones_like(px)])
    nearest = np.argmin(np.moveaxis(pixels, 0, -1) @ np.swapaxes(h, 1, 2), axis=3)

    X = np.take_along_axis(circles.X, nearest[:, None], axis=3).reshape(T, 4, -1)
    hx, hy, hz = np.moveaxis(P @ X, 1, 0).reshape(3, *nearest.shape)
    inverse_depth = _inverse(hz)
    sx, sy = hx * inverse_depth, hy * inverse_depth
    dx, dy = sx - px, sy - py
    distance = np.sqrt(dx * dx + dy * dy)
    scale = circles.weight * inverse_depth
    gx, gy = scale * (dx / (distance + TINY)), scale * (dy / (distance + TINY))
    dh = np.array([gx, gy, -(gx * sx + gy * sy)]).reshape(3, T, -1)
    return np.sum(circles.weight * distance, axis=(1, 2)), np.swapaxes(dh, 0, 1) @ np.swapaxes(X, 1, 2)


def _inverse(depth: Array) -> Array:
    """Inverse depths. A sample in the camera's plane has no image: its depth is replaced by 1e-9."""
    return np.asarray(1.0 / np.where(np.abs(depth) < 1e-9, 1e-9, depth))


# --- the command line ---


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m baselines.tvcalib", description=__doc__.splitlines()[0])
    add_input_and_output(parser)
    add_sized_field(parser)
    parser.add_argument(
        "--initial-cameras",
        choices=["center", "stacked", "argmin"],
        default="center",
        help=f"start from the main camera in the centre; from where {CAMERA_TYPES} in INPUT says that each frame's "
        f"camera stands, else the centre; or from the centre, left and right, with the least loss taken (center)",
    )
    parser.add_argument("--steps", type=int, default=STEPS, metavar="N", help=f"of the optimiser ({STEPS})")
    parser.add_argument("--tau", type=positive, metavar="T", help="reject frames whose loss is above, e.g. 0.019 (off)")
    add_run_options(parser)
    parser.set_defaults(run=_run, command="baselines.tvcalib")
    return run_command(parser.parse_args(arguments))


def _run(options: argparse.Namespace) -> int:
    field = field_of(options)
    types = read_camera_types(options.input) if options.initial_cameras == "stacked" else {}
    method = _Method(field, options.steps, options.tau, options.initial_cameras == "argmin", types)
    reader = annotation_reader(options, field)
    return calibrate_folder(run_options(options), options.input, reader, method, more=types)


@dataclass(frozen=True)
class _Method:
    """Calibrates annotated frames."""

    field: Field
    steps: int
    tau: float | None
    tries_all: bool
    types: Mapping[str, str]
    """Types of the frames' cameras."""

    def __call__(self, frames: dict[str, Pixels], size: tuple[int, int]) -> list[CalibratedFrame]:
        def of_distributions(names: tuple[str, ...], ids: Sequence[str]) -> list[Calibration]:
            members = [frames[id] for id in ids]
            return calibrate(self.field, members, size, steps=self.steps, tau=self.tau, distributions=names)

        return list(map(CalibratedFrame, in_groups(list(frames), self._distributions_of, of_distributions)))

    def _distributions_of(self, id: str) -> tuple[str, ...]:
        if self.tries_all:
            return tuple(DISTRIBUTIONS)
        known = DISTRIBUTIONS_OF_TYPE.get(self.types.get(id, ""), ())
        return known if set(known) <= set(DISTRIBUTIONS) and known else (MAIN_CENTER.name,)


if __name__ == "__main__":
    from baselines.tvcalib import main as main_of_module  # other processes find its classes there

    raise SystemExit(main_of_module())
