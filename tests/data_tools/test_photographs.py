"""Rendered pictures as people take them, and what is said of them."""

from __future__ import annotations

import json

import numpy as np
import pytest

from data_tools import photographs
from data_tools.probability import fitted_coefficients
from data_tools.score_courts import in_view
from data_tools.synthetic.games import game_named
from fieldcalib.assess.probability import log_odds_of_paint, probability_given_paint
from fieldcalib.fields import tennis
from fieldcalib.fields.catalogue import field_named


@pytest.mark.parametrize("name", ["soccer", "tennis"])
def test_people_stand_outside_the_field(name):
    field = field_named(name)
    for where, stand in photographs.kinds(field).items():
        beyond_end = max(stand.x) < -0.5 * field.length
        assert beyond_end == where.startswith(("behind", "corner"))
        assert (min(stand.y) > 0.5 * field.width) == where.startswith(("beside", "corner"))
        assert (min(stand.z) > -2.5) == where.endswith("hand")


def test_photographs_are_those_of_their_seed_and_show_enough():
    game = game_named("tennis")
    both = [next(photographs.photographs(game, kind, 1, 3)) for kind in ("behind, in the hand", photographs.STANDS)]
    again, later = photographs.photographs(game, "behind, in the hand", 2, 3)
    np.testing.assert_array_equal(again.image, both[0].image)
    assert later.seed == 4
    assert [one.camera.image_size for one in (again, later)] == [photographs.SIZES[3], photographs.SIZES[0]]
    for one in both:
        assert np.mean(in_view(one.camera, one.field)[1]) >= photographs.LEAST_VIEW
        assert one.image.shape[1::-1] == one.camera.image_size


@pytest.mark.parametrize("kind", [photographs.ACTION, photographs.DRONE])
def test_action_cameras_are_wide_and_drones_look_down(kind):
    for shown in photographs.photographs(game_named("tennis"), kind, 2, 3):
        degrees, tilt = np.degrees([shown.camera.field_of_view, shown.camera.angles[1]])
        assert shown.camera.fisheye == (100.0 <= degrees <= 150.0) == (kind == photographs.ACTION)
        assert (tilt <= 45.0) == (kind == photographs.DRONE)
        assert np.mean(in_view(shown.camera, shown.field)[1]) >= photographs.LEAST_VIEW


@pytest.mark.slow
def test_what_is_taken_is_judged_again(tmp_path, capsys):
    file = tmp_path / "evidence.jsonl"
    kind = ["--field", "tennis", "--kind", "behind, raised", "--frames", "2"]
    assert photographs.main(["take", *kind, "--evidence", str(file)]) == 0
    said = capsys.readouterr().out
    assert photographs.main(["judge", str(file)]) == 0
    assert capsys.readouterr().out == said
    first, *_ = map(json.loads, said.splitlines())
    assert first["pictures"] == "behind, raised"
    assert first["good and right"] <= first["right"] <= first["count"] == 2
    records = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    found = [one for one in records if "terms" in one]
    assert all(0.0 < photographs.probability_of(one, tennis()) < 1.0 for one in found)
    assert found


def test_a_fit_takes_known_log_odds_and_weights():
    rng = np.random.default_rng(0)
    features = np.column_stack([np.ones(4000), rng.normal(0.0, 1.0, (4000, 4))])
    errors = np.exp(features[:, 1] + rng.logistic(size=4000) / 2.0)
    free, moved, doubled = (
        fitted_coefficients(features, errors, 1.0),
        fitted_coefficients(features, errors, 1.0, known=np.full(4000, 0.7)),
        fitted_coefficients(features, errors, 1.0, weight=2.0),
    )
    np.testing.assert_allclose(free[:2], (0.0, -2.0), atol=0.15)
    np.testing.assert_allclose(moved - free, (-0.7, 0.0, 0.0, 0.0, 0.0), atol=1e-3)
    np.testing.assert_allclose(doubled, free, atol=1e-3)
    heavy = np.where(features[:, 2] > 0.0, 1.0, 0.0)
    some = fitted_coefficients(features[heavy > 0.0], errors[heavy > 0.0], 1.0)
    np.testing.assert_allclose(fitted_coefficients(features, errors, 1.0, weight=heavy), some, atol=1e-3)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.89, 0.95])
def test_missing_paint_takes_its_log_odds(share):
    p = probability_given_paint(0.8, share)
    assert np.log(p / (1.0 - p)) == pytest.approx(np.log(4.0) + log_odds_of_paint(share))
