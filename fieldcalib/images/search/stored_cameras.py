"""Pictures that are recognised as those of a stored camera, by their paint: no network, no search.

A camera on a tripod, as of a court, a hall or a scouting feed, takes the same picture every day. Across the projected
markings of each stored camera lines are looked for in a picture, and a motion of the picture is fitted to them: a
shift, an enlargement and a turn. The camera is taken of which most places show a line where the markings then are. If
it has not moved, it is the camera of the picture as it is, with its errors; otherwise, it is fitted to the lines once
more, under its place as a prior. The paint of the picture then decides: a camera that is not good is not recognised.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, expect
from fieldcalib.assess.findings import Finding, Verdict, What
from fieldcalib.assess.result import Calibration, found_of
from fieldcalib.fields.field import Field, Side, side_of
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.rotation import rotation_from_vector
from fieldcalib.images.camera_side import with_twin
from fieldcalib.images.paint.detected_lines import calibrate_on_lines, detected_lines
from fieldcalib.images.paint.line_profiles import Markings, Profiles, Strips, profiles_along
from fieldcalib.images.refinement import Refined, looked_at
from fieldcalib.images.search.court_ranking import first_apart, grid_of
from fieldcalib.images.search.court_search import with_hidden_markings
from fieldcalib.images.search.place_search import Place
from fieldcalib.io.image_files import Image, size_of, spread
from fieldcalib.problem.layout import CENTER, PRINCIPAL_POINT
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import Prior, pixel_unit

MOST, DIFFERENT = 300, 24  # frames that are read, and cameras that are kept: each costs a picture a millisecond
# Lengths are in pixels of a 960 x 540 image and grow with the image.
SAME = 3.0  # px: cameras whose projections of the field differ by less are one
RANGE = 12.0  # px to both sides of a marking in which lines are looked for
NEAR = 3.0  # px from where the motion moves a marking: a place shows its line no more
ROUNDS = 4  # of fitting the motion, each without the lines that are not near after the one before
LEAST_LINES = 8  # from which a motion is fitted
# Share of the places: at most 0.38 where one of 95 broadcast pictures is compared with the camera of another stadium,
# and 0.5 to 0.9 where the picture of a fixed camera is compared with that.
LEAST_SHARE = 0.4
STILL = 0.5  # px: the lines of a picture tell to about 0.1 px how far a camera has moved
LEAST_METRES, LEAST_OFF = 0.05, 0.002  # least standard deviations of place, and of principal point, widths


class Seen(NamedTuple):
    """What a picture shows of a stored camera."""

    share: float
    """Share of the places that show a line where a motion moves the markings."""
    moved: float
    """How far that is, pixels."""
    motion: Array
    """Shift to the right and down, pixels, enlargement and turn, radians, about the middle of the picture, (4,)."""


@dataclass(frozen=True, eq=False)
class StoredCamera:
    """The good camera of an earlier picture."""

    id: str
    """That of the picture."""
    calibration: Calibration
    field: Field
    """The field, in the size that it has there."""

    @property
    def camera(self) -> Camera:
        """The camera."""
        return self.calibration.required_camera

    @cached_property
    def profiles(self) -> Profiles:
        """Places across its markings at which a picture is looked at."""
        return profiles_along(self.camera, Markings.of(self.field))

    @property
    def prior(self) -> Prior:
        """Its place and its principal point, with their errors; None on a field of which no stands are known."""
        if not self.field.stands:
            return None
        sigma, size = np.sqrt(np.diagonal(self.calibration.covariance)), self.camera.image_size
        stand = Place(self.camera.C, np.maximum(sigma[CENTER], LEAST_METRES), (0.0, 0.0)).stand(self.field)
        x, y = np.round(np.divide(size, 2.0) - self.camera.principal_point).astype(int).tolist()
        off = max(float(np.max(sigma[PRINCIPAL_POINT])) / size[0], LEAST_OFF)
        return (replace(stand, principal_point=off, frame=(size, (x, y))),)

    def seen_in(self, image: Image) -> Seen:
        """Look for its markings in a picture of its size."""
        strips, xy = Strips.of(image, self.profiles, RANGE), self.profiles.xy
        (x, y), one = (xy - np.divide(size_of(image), 2.0)).T, np.ones(len(xy))
        ways = np.array([[one, 0.0 * one], [0.0 * one, one], [x, y], [-y, x]])
        across = np.einsum("kdn,nd->nk", ways, self.profiles.normal)
        lines, near, motion = strips.lines(RANGE), NEAR * strips.unit, np.zeros(len(ways))
        off = np.where(np.isfinite(lines), 0.0, np.inf)
        for _ in range(ROUNDS):
            if np.count_nonzero(off < near) < LEAST_LINES:
                return Seen(0.0, np.inf, motion)
            motion = np.linalg.lstsq(across[off < near], lines[off < near], rcond=None)[0]
            off = np.nan_to_num(np.abs(lines - across @ motion), nan=np.inf)
        share = np.mean(np.maximum(1.0 - off / near, 0.0)[~strips.is_blind])
        moved = np.sum(np.square(np.tensordot(motion, ways, axes=1)), axis=0)
        return Seen(float(share), float(np.sqrt(np.mean(moved))), motion)

    def moved(self, motion: Array) -> Camera:
        """The camera, turned and zoomed as a motion of its picture wants."""
        camera, (right, down, larger, turn), K = self.camera, motion.tolist(), self.camera.K.copy()
        K[:2, :2] *= 1.0 + larger
        f = camera.focal_length
        R = rotation_from_vector(np.array([-down / f, right / f, turn])) @ camera.R
        return Camera(K, R, camera.C, camera.image_size, camera.dist, fisheye=camera.fisheye)

    def found_in(self, task: Task, image: Image, seen: Seen) -> Calibration | None:
        """The camera of a picture that shows its markings; None if the paint there does not leave it good."""
        found, profiles, markings = self.calibration, self.profiles, Markings.of(self.field)
        notes, moved = found_of(found), 0.0
        if seen.moved > STILL * pixel_unit(self.camera.image_size):
            task, moved = replace(task, object_segments=self.field, prior=self.prior), seen.moved
            start = self.moved(seen.motion)
            lines = detected_lines(image, profiles_along(start, markings), markings)
            (fitted,) = calibrate_on_lines(task, [lines], start.image_size, [start])
            if not fitted.accepted:
                return None
            found = with_twin(fitted, self.field) if found.alternatives else fitted
            notes, profiles = (*notes, *found_of(fitted)), profiles_along(fitted.required_camera, markings)
        recognised = Finding(What.RECOGNISED, self.id, (moved,))
        notes = (*(one for one in notes if one.what is not What.RECOGNISED), recognised)
        found = replace(found, message=str(recognised), _found=notes)
        found = with_hidden_markings(looked_at(Refined(found, seen.share), image, profiles, markings).judged)
        return found if found.verdict is Verdict.GOOD else None


@dataclass(frozen=True, eq=False)
class StoredCameras:
    """The good cameras of earlier pictures, those that are alike once."""

    cameras: Sequence[StoredCamera]

    @classmethod
    def of(cls, results: Mapping[str, Calibration], field: Field, side: Side | None = None) -> StoredCameras:
        """Take the good cameras of results, at most `DIFFERENT` of them.

        Raises
        ------
        ValueError
            If none is good, or one is of another field, or of another size of it, where that is known; or on another
            side than the one that is given.
        """
        ids = list(results)
        every = {ids[k]: expect(results[ids[k]], Calibration, "in results") for k in spread(len(ids), MOST)}
        good = [
            StoredCamera(id, one, one.field)
            for id, one in every.items()
            if one.verdict is Verdict.GOOD and one.field is not None and one.knows_errors
        ]
        if not good:
            raise ValueError("no camera of the results is good: pictures cannot be recognised by them")
        for one in good:
            _check_field(one.field, field)
            if side is not None and side != side_of(one.camera.C, field):
                raise ValueError(f"side={side!r}, but the camera of {one.id!r} is on the other: leave one of them out")
        found = list[StoredCamera]()
        for size in dict.fromkeys(one.camera.image_size for one in good):
            some = [one for one in good if one.camera.image_size == size]
            xy, apart = np.array([one.camera.project(grid_of(field)) for one in some]), SAME * pixel_unit(size)
            found += [some[k] for k in first_apart(xy, range(len(some)), size, apart, median=False)]
        return cls([found[k] for k in spread(len(found), DIFFERENT)])

    def recognised(self, task: Task, image: Image) -> Calibration | None:
        """The camera of a picture, if it is one of these, perhaps moved a little; else None."""
        some = [one for one in self.cameras if one.camera.image_size == size_of(image)]
        every = [(one.seen_in(image), one) for one in some]
        enough = [pair for pair in every if pair[0].share >= LEAST_SHARE]
        seen, best = max(enough, key=lambda pair: pair[0].share, default=(None, None))
        return None if seen is None or best is None else best.found_in(task, image, seen)


def _check_field(its: Field, field: Field) -> None:
    """Raise a ValueError unless a stored camera is of the field, and of its size where that is fixed or known."""
    may_differ = field.moves_with_size and not field.size_known
    size, its_size = (field.length, field.width), (its.length, its.width)
    if its.keys() != field.keys() or not (may_differ or np.allclose(size, its_size, atol=0.01)):
        of = "a camera of the results is of another field, {:g} x {:g} m, than that of {:g} x {:g} m which is asked for"
        raise ValueError(of.format(*its_size, *size))
