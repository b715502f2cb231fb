"""Search for the camera of a picture from a known place, and for the place that several pictures share (a tripod).

Search from a place (`search_from`). Hypotheses are cameras at the place ("views") that project lines or circles of the
field onto lines or ellipses of the picture. They are compared with the stripes by the likelihood ratio of
`fieldcalib.images.search.stripe_likelihood`, with a larger deviation than elsewhere, as place and distortion are only
known roughly. The best views that differ are pulled onto the stripes, and the best of these are refined on the picture,
with the place as a prior.

Two lines determine pan, tilt, roll and focal length: the planes through the camera and the two lines of the picture
must meet at the same angle as the planes through the place and the two lines of the field. A single line, or an
ellipse, does not determine the focal length, even of a level camera. So several are tried; for each, a direction in the
world and the ray along which it is seen give pan and tilt. The direction is the normal of the plane through a line, or
points at the centre of a circle. This gives a few thousand views, where a grid would need half a million.

Place of several pictures (`pooled_place`). Pictures whose camera is accepted in a search of its own vote for the place.
From there, all pictures are searched again, and the accepted cameras vote anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray, listed
from fieldcalib.assess.findings import Status
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import MAIN, TURN, Field, Side, side_of
from fieldcalib.fields.traits import CameraDistribution
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.rotation import angles_from_rotation, rotation_from_angles
from fieldcalib.images.camera_side import CameraSide
from fieldcalib.images.search.cameras_from_curves import LEVEL, SeenCircles, circles_of, planes_of, rays_of
from fieldcalib.images.search.court_hypotheses import Cameras, FieldLines, are_within, unit
from fieldcalib.images.search.court_ranking import (
    Curves,
    PictureStripes,
    Ranked,
    distances,
    grid_of,
    in_order,
    principal_point,
)
from fieldcalib.images.search.court_search import find_courts, refine_courts, with_errors, with_hidden_markings
from fieldcalib.images.search.ellipses import Ellipse
from fieldcalib.images.search.long_lines import Bend
from fieldcalib.images.search.stripe_likelihood import Freedom, MarkingPoints, StripeMaps, pulled
from fieldcalib.images.search.stripes import at_working_size, find_stripes
from fieldcalib.io.image_files import Image, size_of, spread
from fieldcalib.solve.request import Task
from fieldcalib.solve.sequence.tripod_position import voted_centres
from fieldcalib.solve.solver_options import ALL, DEFAULT_FLAGS, Prior

NEARBY = 3.4  # standard deviations from a place: 99 % of chi-squared with three degrees of freedom
WIDTHS = 1.96  # standard deviations between the middle and the ends of a stand's range of positions

COARSE = 8.0  # px: standard deviation of stripes from the projected markings of unrefined views
POINTS, PULLING = 300, 60  # points of the field's markings with which views are compared, and pulled
KEPT, PULLED = 2000, 40  # number of likeliest views that are kept, and of different views that are pulled
BEYOND = 1.05  # half extents of the field within which the optical axis must meet the ground
APART = 40.0  # px: views that differ by more (`apart`) are pulled separately
OTHER = 100.0  # px: cameras whose projections differ from the best one's by more, in the median, are different
LEAST_SCORE = 60.0  # of an accepted camera: views of pictures without the field had 50 at most
SURE_SCORE = 250.0  # of a camera that is sure enough to decide which markings are hidden
REFINED = 3  # cameras that are refined on the picture
RIVAL = 0.7  # share of the best score from which another camera makes it doubtful
NOTHING = "no view from the place of the camera shows the field's lines"

STEP = 9.0  # px by which the border of the picture moves from one focal length that is tried to the next
HEIGHT = 1.3  # factor by which the camera's height from the size of a circle may differ from that of the place

MOST = 24  # pictures from which the place is found
FIRST, LAST = 0.06, 0.015  # of that distance: standard deviations of a place before and after the pictures agree on it
ROUNDS = 2  # rounds of searching all pictures and voting for the place
ZOOM = 1.6  # factor by which a picture may be zoomed more or less than the pictures with accepted cameras
AGREE = 3  # accepted pictures that are needed for a place


@dataclass(frozen=True, eq=False)
class Place:
    """Position of a camera with its uncertainty, its range of zoom and its distortion."""

    C: Array
    """Position, metres, (3,)."""
    sigma: Array
    """Standard deviations of the position, metres, (3,)."""
    zoom: tuple[float, float]
    """Least and largest focal length, in widths of the picture."""
    bend: float = 0.0
    """Distortion of its pictures (`fieldcalib.images.search.long_lines.Bend`), about the same for all focal
    lengths."""

    def focal_lengths(self, width: int, step: float) -> Array:
        """Focal lengths to try, pixels, for a picture of a width; its border moves by `step` pixels between two."""
        low, high = np.log(np.array(self.zoom) * width)
        return np.asarray(np.exp(np.arange(low, high + 1e-9, 2.0 * step / width)))

    def is_near(self, camera: Camera) -> bool:
        """Whether a camera's position agrees with the place."""
        return float(np.linalg.norm((camera.C - self.C) / self.sigma)) < NEARBY

    def stand(self, field: Field) -> CameraDistribution:
        """The place as a prior: the nearest stand of the field, narrowed to the place."""
        middle = np.array([[sum(stand.x) / 2.0, sum(stand.y) / 2.0, sum(stand.z) / 2.0] for stand in field.stands])
        nearest = field.stands[int(np.argmin(np.linalg.norm(middle - self.C, axis=1)))]
        low, high = (self.C - WIDTHS * self.sigma).tolist(), (self.C + WIDTHS * self.sigma).tolist()
        x, y, z = zip(low, high, strict=True)
        return replace(nearest, name="known place", x=x, y=y, z=z)


def apart(cameras: Cameras, camera: Camera) -> Array:
    """Approximate difference in pixels (B,) between the pictures of cameras and of one camera at the same place.

    It is the shift of the middle by pan and tilt, plus the shift of the border by roll and zoom.
    """
    f, half = camera.focal_length, 0.5 * cameras.size[0]
    pan, tilt, roll = (angles_from_rotation(cameras.R) - camera.angles).T
    turn = f * np.hypot(pan * np.sin(camera.angles[1]), tilt)
    return np.asarray(turn + half * (np.abs(roll) + np.abs(np.log(cameras.f / f))))


def rank_from(place: Place, stripes: PictureStripes, field: Field) -> Ranked:
    """Rank the cameras at a place, or nearly there once pulled onto the stripes, by how well they explain a picture."""
    views = views_through(stripes.curves(field), place, field, stripes.bend.size)
    points, maps = MarkingPoints.of(field, POINTS), stripes.straight_maps
    score = StripeMaps.of(stripes.straight, COARSE).scores(views, points)
    few = _different(views.take(np.argsort(-score, kind="stable")[:KEPT]))
    freedom = Freedom(principal_point(field), float(np.max(place.sigma) / -place.C[2]))
    near = pulled(few, maps, MarkingPoints.of(field, PULLING), freedom)
    return Ranked(*in_order(maps, Cameras.joined([few, near], maps.size), points, KEPT), stripes.bend)


def _different(views: Cameras) -> Cameras:
    """Select the first `PULLED` views that differ from all selected before (`apart`)."""
    left = np.ones(len(views), dtype=bool)
    chosen: list[int] = []
    while len(chosen) < PULLED and left.any():
        chosen.append(int(np.argmax(left)))
        left &= apart(views, views.camera(chosen[-1])) > APART
    return views.take(np.array(chosen, dtype=np.intp))


def search_from(task: Task, field: Field, image: Image, place: Place) -> Calibration:
    """Search a picture for the view of a field from a known place.

    A camera that is not accepted is "probably wrong", with the reason in its message.
    """
    small = at_working_size(image)
    seen = find_stripes(small, lighter=field.lines.lighter)
    stripes = PictureStripes.of(small, seen, Bend(place.bend, size_of(small)))
    ranked = rank_from(place, stripes, field)
    if not len(ranked.cameras):
        return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, NOTHING)
    known = replace(task, prior=(place.stand(field),))
    least = min(RIVAL * ranked.score[0], ranked.score[0] - 1.0)
    cameras = [ranked.camera(k) for k in ranked.different(field, least, OTHER, REFINED, median=True)]
    refined = with_errors(known, field, image, refine_courts(known, field, image, cameras))
    found = [one.judged for one in refined]
    accepted = [one for one in found if one.accepted]
    at_place = [one for one in accepted if place.is_near(one.required_camera)]
    return _best(at_place or accepted, stripes.maps, field) if accepted else found[0]


def _best(found: Sequence[Calibration], maps: StripeMaps, field: Field) -> Calibration:
    """Choose the accepted camera with the best score; "probably wrong" if that is low, or another's nearly as high."""
    cameras = [one.required_camera.scaled(maps.size) for one in found]
    score = np.array([maps.score(camera, MarkingPoints.of(field, POINTS))[0] for camera in cameras])
    first = int(np.argmax(score))
    best = found[first]
    xy = np.array([camera.project(grid_of(field)) for camera in cameras])
    others = distances(xy, xy[first], maps.size, median=True) > OTHER
    rival, own = np.max(score[others], initial=0.0), score[first]
    doubts = {
        "its lines do not determine it": best.solved is None,
        "few of the field's lines show where the camera at the known place would see them": own < LEAST_SCORE,
        "another view from that place explains the picture nearly as well": rival > RIVAL * own,
    }
    if said := "; ".join(text for text, is_true in doubts.items() if is_true):
        return replace(best, status=Status.IMPROBABLE, message=f"{said}; {best.message}")
    return with_hidden_markings(best) if own >= SURE_SCORE else best


def views_through(curves: Curves, place: Place, field: Field, size: tuple[int, int]) -> Cameras:
    """Cameras at a place that project lines of a field onto lines of a picture, or a circle onto an ellipse.

    `curves` are those of the picture without distortion.
    """
    lines, ellipses = curves
    on_field, seen = LinesFromPlace.of(field, place), lines.seen_from(0.5 * np.array(size), float(size[0]))
    f = place.focal_lengths(size[0], STEP)
    parts = [_through_pairs(*seen, on_field, place, size), _through_lines(*seen, on_field, place, size, f)]
    parts.append(_through_ellipses(ellipses, place, field, size, f))
    views = Cameras.joined(parts, size)
    return views.take(_look_at(views, field))


def _look_at(views: Cameras, field: Field) -> BoolArray:
    """Whether cameras (B,) are level and look at the field, or just beside it, in the middle of the picture."""
    ahead, roll = views.R[:, 2], np.arctan2(views.R[:, 0, 2], views.R[:, 1, 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        at = views.C[:, :2] - views.C[:, 2:] / ahead[:, 2:] * ahead[:, :2]
    inside = np.all(np.abs(at) < BEYOND * field.half_extent, axis=1)
    return np.asarray((ahead[:, 2] > 0.0) & (np.abs(roll) < LEVEL) & inside)


@dataclass(frozen=True, eq=False)
class LinesFromPlace:
    """M lines of a field, seen from a place."""

    normal: Array
    """Unit normals of the planes through the place and each line, (M, 3)."""
    axis: IntArray
    """Axis of the field along which each line runs, 0 or 1, (M,)."""
    reach: Array
    """Least and largest coordinate on that axis of the markings on each line, metres, (M, 2)."""

    @classmethod
    def of(cls, field: Field, place: Place) -> LinesFromPlace:
        """Take the long lines of a field."""
        lines = FieldLines.of(field)
        axis = np.repeat([1, 0], [len(lines.across), len(lines.along)])
        point = np.zeros((len(axis), 3))
        point[np.arange(len(axis)), 1 - axis] = np.concatenate([lines.across, lines.along])
        normal = unit(np.cross(point - place.C, np.eye(3)[axis]))
        return cls(normal, axis, np.concatenate([lines.across_reach, lines.along_reach]))


def _through_pairs(line: Array, ends: Array, on_field: LinesFromPlace, place: Place, size: tuple[int, int]) -> Cameras:
    """Cameras that project two lines of the field onto two of the lines (L, 3) of the picture, with ends (L, 2, 2).

    With normals ``(f n, c)`` of the planes through the camera and two lines of the picture, F = f^2, and k the cosine
    between the planes through the place and two lines of the field,
    ``(n1 . n2 F + c1 c2)^2 = k^2 (F + c1^2) (F + c2^2)``, which is quadratic in F.
    """
    one, other = np.triu_indices(len(line), 1)
    pair = np.argwhere(~np.eye(len(on_field.axis), dtype=bool))
    k = np.square(np.sum(on_field.normal[pair[:, 0]] * on_field.normal[pair[:, 1]], axis=1))
    n = np.sum(line[one, :2] * line[other, :2], axis=1)[:, None]
    c1, c2 = line[one, 2][:, None], line[other, 2][:, None]
    a, b, c = n * n - k, 2.0 * n * c1 * c2 - k * (c1 * c1 + c2 * c2), (1.0 - k) * np.square(c1 * c2)
    found = []
    for sign in (-1.0, 1.0):
        with np.errstate(divide="ignore", invalid="ignore"):
            f = np.sqrt((sign * np.sqrt(b * b - 4.0 * a * c) - b) / (2.0 * a))
        p, q = np.nonzero((f > place.zoom[0]) & (f < place.zoom[1]))
        own = f[p, q]
        planes = [unit(planes_of(line[index[p]], own)) for index in (one, other)]
        normals = [on_field.normal[pair[q, 0]], on_field.normal[pair[q, 1]]]
        # squaring the cosine lost its sign, and normals have none: turn one normal so that the angle is that on the
        # field and not its supplement, and try both signs of the pair
        alike = np.sign(np.sum(planes[0] * planes[1], axis=1) * np.sum(normals[0] * normals[1], axis=1))
        planes[1] *= alike[:, None]
        for way in (1.0, -1.0):
            R = _frames(way * planes[0], way * planes[1]) @ np.swapaxes(_frames(*normals), 1, 2)
            views = Cameras.centred(own * size[0], R, place.C, size)
            good = _ends_on(views, ends[one[p]], on_field, pair[q, 0])
            good &= _ends_on(views, ends[other[p]], on_field, pair[q, 1])
            found.append(views.take(good))
    return Cameras.joined(found, size)


def _frames(a: Array, b: Array) -> Array:
    """Orthonormal bases (N, 3, 3), in columns, for N pairs of vectors: a, the part of b perpendicular to it, a x b."""
    third = unit(np.cross(a, b))
    return np.stack([a, np.cross(third, a), third], axis=2)


def _through_lines(
    line: Array, ends: Array, on_field: LinesFromPlace, place: Place, size: tuple[int, int], f: Array
) -> Cameras:
    """Cameras without roll that project a line of the field onto a line, for each focal length (F,) in pixels."""
    own, focal = (one.ravel() for one in np.indices((len(line), len(f))))
    plane = unit(planes_of(line[own], f[focal] / size[0]))
    found = []
    for k, normal in enumerate(on_field.normal):
        for way in (normal, -normal):
            views, index = _seen_in(plane, way, f[focal], place, size)
            found.append(views.take(_ends_on(views, ends[own[index]], on_field, np.full(len(index), k))))
    return Cameras.joined(found, size)


def _through_ellipses(
    ellipses: Sequence[Ellipse], place: Place, field: Field, size: tuple[int, int], f: Array
) -> Cameras:
    """Cameras without roll that project a circle of the field onto an ellipse, for each focal length (F,) in pixels."""
    found = []
    if len(ellipses):
        seen = SeenCircles.of(ellipses, f / size[0], size)
        for x, y, radius in circles_of(field).tolist():
            height = radius / seen.radius
            near = np.abs(np.log(height / -place.C[2])) < np.log(HEIGHT)
            towards = np.array([x, y, 0.0]) - place.C
            towards /= np.linalg.norm(towards)
            found.append(_seen_in(unit(seen.centre[near]), towards, seen.f[near] * size[0], place, size)[0])
    return Cameras.joined(found, size)


def _seen_in(ray: Array, towards: Array, f: Array, place: Place, size: tuple[int, int]) -> tuple[Cameras, IntArray]:
    """Cameras without roll that see a direction of the world (3,) along rays (N, 3), and the index of each one's ray.

    Focal lengths (N,) are given in pixels. With down = (0, sin t, cos t) in camera coordinates, ``ray . down`` equals
    the third coordinate of the direction, which has two solutions for the tilt t, or none; the pan follows.
    """
    _, y, z = ray.T
    with np.errstate(invalid="ignore"):
        off = np.arccos(towards[2] / np.hypot(y, z))
    tilt = np.angle(np.exp(1j * (np.arctan2(y, z) + np.array([[1.0], [-1.0]]) * off)))
    ahead = z * np.sin(tilt) - y * np.cos(tilt)
    pan = np.arctan2(towards[1], towards[0]) + np.arctan2(ahead, ray[:, 0])
    _, own = real = np.nonzero(np.isfinite(tilt))
    R = rotation_from_angles(np.column_stack([pan[real], tilt[real], np.zeros(len(own))]))
    return Cameras.centred(f[own], R, place.C, size), own


def _ends_on(views: Cameras, ends: Array, on_field: LinesFromPlace, index: IntArray) -> BoolArray:
    """Whether the ends (B, 2, 2) of a line lie on the markings of a field line `index` (B,) in each view, (B,)."""
    seen = rays_of(ends, views.f / views.size[0]) @ views.R
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(seen[..., 2] > 0.0, -views.C[:, 2:] / seen[..., 2], np.nan)
    at = views.C[:, None, :2] + depth[..., None] * seen[..., :2]
    along = np.take_along_axis(at, on_field.axis[index][:, None, None], axis=2)[..., 0]
    return are_within(np.sort(along, axis=1), on_field.reach[index])


def place_of(found: Sequence[Calibration], share: float | None = None) -> Place | None:
    """Find the place on which most accepted cameras agree; None if none is accepted.

    Its standard deviation is `share` of its distance from the middle of the field; by default `LAST` of it if at least
    `AGREE` cameras are accepted, else `FIRST`.
    """
    accepted = [one for one in found if one.accepted and one.knows_errors]
    if not accepted:
        return None
    share = share or (LAST if len(accepted) >= AGREE else FIRST)
    return _place(voted_centres(accepted, 1)[0], share, [one.required_camera for one in accepted])


def _place(C: Array, share: float, cameras: Sequence[Camera]) -> Place:
    """The place at C (3,), with zoom and distortion of cameras there."""
    zoom = [camera.focal_length / camera.image_size[0] for camera in cameras]
    bend = float(np.median([Bend.of(camera).a for camera in cameras]))
    return Place(C, np.full(3, share * float(np.linalg.norm(C))), (min(zoom) / ZOOM, max(zoom) * ZOOM), bend)


def pooled_place(
    field: Field, images: Sequence[Image], *, flags: int = DEFAULT_FLAGS, prior: Prior = ALL, side: Side | None = None
) -> Place | None:
    """Find the place of the one camera that took some pictures; None if no place gives enough accepted cameras.

    Parameters
    ----------
    field : Field
        The field that the pictures show.
    images : sequence of (height, width, 3) uint8 arrays
        Blue, green, red; `MOST` of them are used.
    flags, prior, side
        As in `calibrate_from_images`.

    Raises
    ------
    ValueError
        As `find_courts`.
    """
    task = Task(field, flags=flags, prior=prior)
    on = CameraSide.of(task, side)
    # the place is found on the main side, as searches find cameras there, and turned at the end if it is opposite
    task = replace(task, side=on.side and MAIN)
    images = [images[k] for k in spread(len(listed(images, "pictures")), MOST)]
    searched = [find_courts(image, field, flags=flags, prior=prior) for image in images]
    found = [one[0].calibration for one in searched if one]
    place = place_of(found, FIRST)
    for share in np.geomspace(FIRST, LAST, ROUNDS + 1)[1:].tolist():
        if place is None:
            return None
        found = [search_from(task, field, image, place) for image in images]
        place = place_of(found, share)
    agreeing = sum(one.accepted for one in found)
    if place is None or agreeing < min(AGREE, len(images)):
        return None
    is_there = on.side is None or side_of(place.C, field) == on.side
    return place if is_there else replace(place, C=place.C * TURN)
