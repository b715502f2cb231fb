"""Faint lines in small, compressed pictures, traced through labels of a person."""

import cv2
import numpy as np
import pytest
from views import camera

from fieldcalib.draw.scene import render_field
from fieldcalib.editor.fitting import is_stray
from fieldcalib.editor.frame import FrameEditor
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.images.paint.detected_lines import FEW, with_traced
from fieldcalib.images.paint.line_profiles import Markings, Strips, profiles_along
from fieldcalib.images.paint.paint_evidence import paint_evidence, wide_strips, with_lines

FIELD, SMALL = soccer(), (600, 338)
MARKINGS = Markings.of(FIELD)
TRUTH = camera(12, 78, 1000, (0, 80, -17), k=(0.1, 0.0)).scaled(SMALL)
LABEL = "Big rect. right main"


@pytest.fixture(scope="module")
def image():
    """A picture of 600 x 338 with noise, much compressed: lines far off are narrower than a pixel."""
    large = render_field(TRUTH.scaled((1800, 1014)), FIELD, rng=np.random.default_rng(0))
    small = cv2.resize(large, SMALL, interpolation=cv2.INTER_AREA).astype(float)
    small += np.random.default_rng(1).normal(0.0, 14.0, (*small.shape[:2], 1))
    _, coded = cv2.imencode(".jpg", np.clip(small, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 50])
    return cv2.imdecode(coded, cv2.IMREAD_COLOR)


def strips_of(image, moved):
    """Samples across the markings as a camera projects them that is `moved` pixels down the picture."""
    other = TRUTH.cropped((0.0, -moved), SMALL)
    return Strips.of(image, profiles_along(other, MARKINGS), 12.0)


def ends(label, down=0.0):
    """Two pixels on a line, so many pixels down the picture."""
    xy = TRUTH.project(FIELD[label].sample(1.0))
    return xy[((xy > 15.0) & (xy < np.subtract(SMALL, 16.0))).all(axis=1)][[0, -1]] + (0.0, down)


def traced(strips, labelled):
    lines = strips.lines(4.0)
    at = strips.profiles.member == MARKINGS.labels.index(LABEL)
    return lines[at], with_traced(strips, lines, MARKINGS, labelled)[at], strips.profiles.normal[at][:, 1]


@pytest.mark.parametrize("moved", [-3.0, 0.0, 3.0])
@pytest.mark.parametrize("down", [-2.0, 2.0])
def test_a_faint_line_is_traced_where_it_is(image, moved, down):
    lines, found, normal = traced(strips_of(image, moved), {LABEL: ends(LABEL, down)})
    assert np.mean(np.isfinite(lines)) < FEW
    assert np.mean(np.isfinite(found)) > 0.6
    np.testing.assert_allclose(np.nanmedian(found * np.sign(normal)), -moved, atol=0.6)


@pytest.mark.parametrize("labelled", [{}, {"Middle line": np.array([[300.0, 200.0]])}, {LABEL: ends(LABEL, 30.0)}])
def test_nothing_is_traced_away_from_labels(image, labelled):
    lines, found, _ = traced(strips_of(image, 0.0), labelled)
    np.testing.assert_array_equal(found, lines)


def test_no_line_is_traced_on_bare_ground():
    bare = np.full((*SMALL[::-1], 3), (60, 140, 60), np.uint8)
    bare = (bare + np.random.default_rng(0).normal(0.0, 14.0, bare.shape)).clip(0, 255).astype(np.uint8)
    assert not np.any(np.isfinite(traced(strips_of(bare, 0.0), {LABEL: ends(LABEL)})[1]))


def test_a_traced_line_is_paint_of_its_marking(image):
    wide = wide_strips(image, profiles_along(TRUTH, MARKINGS))
    before = paint_evidence(image, profiles_along(TRUTH, MARKINGS), MARKINGS)
    lines = with_traced(wide, wide.lines(4.0), MARKINGS, {LABEL: ends(LABEL)})
    after = with_lines(before, MARKINGS, wide, lines, {LABEL})
    for old, new in zip(before.markings, after.markings, strict=True):
        assert (new.share > old.share + 0.1 and new.offset == 0.0) if new.label == LABEL else new == old
    assert with_lines(before, MARKINGS, wide, lines, set()).markings == before.markings


@pytest.mark.parametrize("seed", range(3))
def test_a_small_picture_is_labelled_by_clicks(image, seed):
    """Nine clicks, 2 px off."""
    rng, editor = np.random.default_rng(seed), FrameEditor.of(image)
    for label in ("Side line bottom", LABEL, "Circle central", "Middle line"):
        xy = TRUTH.project(FIELD[label].sample(0.5))
        xy = xy[((xy > 10.0) & (xy < np.subtract(SMALL, 11.0))).all(axis=1)]
        shares = np.linspace(0.1, 0.9, 3 if "Circle" in label else 2)
        for place in xy[(shares * (len(xy) - 1)).astype(int)]:
            editor = editor.mark(label, place + rng.normal(0.0, 2.0, 2))
    calibration = editor.calibration
    assert calibration.accepted
    assert abs(calibration.camera.focal_length / TRUTH.focal_length - 1.0) < 0.05
    X = np.array([(0.0, -34.0, 0.0), (20.0, -20.0, 0.0), (36.0, -20.0, 0.0), (9.15, 0.0, 0.0)])
    assert np.max(np.linalg.norm(calibration.camera.project(X) - TRUTH.project(X), axis=1)) < 2.0


def test_clicks_in_small_pictures_are_no_more_exact():
    assert not is_stray(7.0, SMALL)
    assert is_stray(9.0, SMALL)
    assert not is_stray(15.0, (1920, 1080))
