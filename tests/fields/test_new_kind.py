"""A kind of segment that the package does not have: what has to be written for it, and what works then."""

from dataclasses import dataclass

import numpy as np
import pytest

from fieldcalib import Camera, calibrate_batch, calibrate_from_segments, soccer
from fieldcalib.draw import draw_field
from fieldcalib.fields.segments import ArcRows, Line, Segment
from fieldcalib.fields.segments.segment import mirrored_point
from fieldcalib.problem.evaluation import evaluate_camera

SIZE = (960, 540)
CAMERA = Camera.from_angles(0.1, 1.3, 0.01, 900.0, (1.0, 60.0, -15.0), SIZE)


@dataclass(frozen=True)
class Ellipse(Segment):
    """An ellipse on the ground, axes along x and y: rows of arcs measure any ``A + cos(phi) U + sin(phi) V``."""

    center: tuple[float, float, float]
    a: float
    b: float

    @property
    def rows(self):
        return ArcRows

    @property
    def vectors(self):
        return np.array([self.center, (self.a, 0.0, 0.0), (0.0, self.b, 0.0)])

    @property
    def span(self):
        return np.pi, np.pi

    def sample(self, spacing=1.0):
        phi = np.linspace(0.0, 2.0 * np.pi, int(2.0 * np.pi * max(self.a, self.b) / spacing) + 2)[:, None]
        center, u, v = self.vectors
        return center + np.cos(phi) * u + np.sin(phi) * v

    def equations(self, pixels):
        return min(pixels, 5)

    def mirrored(self, signs):
        return Ellipse(mirrored_point(self.center, signs), self.a, self.b)


SEGMENTS = {
    "track": Ellipse((0.0, 0.0, 0.0), 30.0, 18.0),
    "middle": Line((0.0, -30.0, 0.0), (0.0, 30.0, 0.0)),
    "near": Line((-30.0, 20.0, 0.0), (30.0, 20.0, 0.0)),
    "far": Line((-30.0, -22.0, 0.0), (30.0, -22.0, 0.0)),
}


def pixels_of(segments):
    seen = {label: CAMERA.project(segment.sample(2.0)) for label, segment in segments.items()}
    return {label: xy[np.all((xy >= 0.0) & (xy < SIZE), axis=1)] for label, xy in seen.items()}


def test_its_pixels_lie_on_it():
    assert np.max(np.abs(evaluate_camera(CAMERA, SEGMENTS, pixels_of(SEGMENTS)).r)) < 1e-6


@pytest.mark.parametrize("together", [False, True])
def test_cameras_are_calibrated_from_it(together):
    pixels = pixels_of(SEGMENTS)
    if together:
        (found,) = calibrate_batch(SEGMENTS, [pixels], SIZE, prior=None)
    else:
        found = calibrate_from_segments(SEGMENTS, pixels, SIZE, prior=None)
    assert found.accepted, found.message
    np.testing.assert_allclose(found.camera.C, CAMERA.C, atol=1e-3)
    assert found.per_segment_errors["track"] < 1e-4


def test_it_is_drawn():
    black = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    drawn = draw_field(black, CAMERA, {"track": SEGMENTS["track"]})
    x, y = np.rint(pixels_of(SEGMENTS)["track"]).astype(int).T
    assert np.mean(drawn[y, x].any(axis=-1)) > 0.95


def test_a_field_has_it_too():
    field = soccer()
    wider = type(field)(105.0, 68.0, {**field.segments, "track": SEGMENTS["track"]})
    assert "track" in wider.markings
    assert "track" in wider.self_symmetric
