"""Evidence for cameras that were searched for: odds, probabilities, stripes that are no paint."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pictures import picture

from data_tools.score_courts import fitted
from fieldcalib import Camera, calibrate_from_segments
from fieldcalib.assess.findings import Verdict
from fieldcalib.fields import tennis
from fieldcalib.fields.catalogue import field_named
from fieldcalib.images.paint.line_profiles import Markings, find_lines, profiles_along
from fieldcalib.images.refinement import Refined
from fieldcalib.images.search import court_search
from fieldcalib.images.search.court_hypotheses import Cameras
from fieldcalib.images.search.court_ranking import PictureToSearch, Ranked, Rivals, grid_of
from fieldcalib.images.search.court_search import CourtEvidence, Searched, explained, is_promising, probabilities
from fieldcalib.images.search.long_lines import Bend
from fieldcalib.solve.request import Task

SIZE = (1280, 720)
TENNIS = Camera.from_angles(np.radians(92), np.radians(76), 0.01, 2300.0, (-38.0, 1.0, -10.0), SIZE)
EVIDENCE = CourtEvidence(500.0, 2.5, 0.95, 0.6, 0.9, 0.7, 8, 0, 0.4, False, 20.0, False)


@pytest.mark.property
@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=8), st.integers(0, 2**32 - 1))
def test_probabilities_of_cameras_that_differ_add_up_to_less_than_one(odds, seed):
    apart = probabilities(np.array(odds), np.eye(len(odds), dtype=bool))
    assert np.all(apart >= 0.0)
    assert np.sum(apart) == pytest.approx(np.sum(odds) / (1.0 + np.sum(odds)))
    groups = np.random.default_rng(seed).integers(0, 2, len(odds))
    alike = probabilities(np.array(odds), groups[:, None] == groups)
    assert np.all(alike >= apart - 1e-12)
    assert np.all(alike < 1.0)


@pytest.mark.parametrize(
    "worse",
    [
        {"mean": 1.0},
        {"explained": 0.6},
        {"runner_up": 1.0},
        {"runner_up": 0.7},
        {"confirmed": 2},
        {"off": 2},
        {"is_above": True},
        {"furniture": 5.0},
        {"has_edges": True},
    ],
    ids=str,
)
def test_worse_evidence_has_smaller_odds(worse):
    assert replace(EVIDENCE, **worse).odds < EVIDENCE.odds
    assert EVIDENCE.odds > 10.0


def test_of_cameras_that_share_a_probability_that_with_the_most_evidence_comes_first(monkeypatch):
    def court(odds, accepted=True):
        of_search = SimpleNamespace(accepted=accepted)
        return SimpleNamespace(calibration=of_search, evidence=SimpleNamespace(odds=odds))

    monkeypatch.setattr(court_search, "_court", lambda candidate, probability, every: candidate)
    rough, close, refused, undetermined = court(0.14), court(4.08), court(9.0, accepted=False), court(np.nan, False)
    found = Searched([undetermined, rough, close, refused], [0.0, 0.87, 0.86, 0.86])  # rough is like one camera more
    assert found.courts == [close, rough, refused, undetermined]


def test_that_there_is_no_rival_at_all_says_little():
    assert replace(EVIDENCE, runner_up=0.0).odds == replace(EVIDENCE, runner_up=0.4).odds > 3.0 * EVIDENCE.odds


def test_furniture_that_is_not_found_is_no_evidence():
    assert replace(EVIDENCE, furniture=-50.0).odds == replace(EVIDENCE, furniture=0.0).odds


def test_furniture_orders_cameras_and_makes_rivals():
    court = tennis()
    aside = TENNIS.moved(TENNIS.R, TENNIS.C + (0.0, 0.0, 2.0))
    ranked = Ranked(Cameras.of([aside, TENNIS], SIZE), np.array([300.0, 290.0]), Bend(0.0, SIZE))
    best = ranked.with_furniture(PictureToSearch(picture(TENNIS, court)).stripes(lighter=True).maps, court)
    np.testing.assert_array_equal(best.cameras.C, [TENNIS.C, aside.C])
    assert best.score.tolist() == [290.0, 300.0]  # that of the ground alone
    assert best.furniture[0] > best.furniture[1] + 10.0
    rivals, away = Rivals.of(best, court, {}), [np.zeros_like(grid_of(court)[:, :2])]
    assert rivals.best_score(away) == 300.0
    assert rivals.best_score(away, 5.0) == 305.0 - max(5.0 - best.furniture[1], 0.0)  # up to that of another camera
    assert rivals.best_score(away, 40.0) == max(best.score + best.furniture)


def test_a_camera_that_was_refined_further_along_stands_for_the_moved_one():
    field = field_named("rugby-league")
    right = Camera.from_angles(0.1, 1.3, 0.0, 1000.0, (4.0, 80.0, -28.0), SIZE, k=(0.3, 0.0))
    straight = Camera(right.K, right.R, right.C, SIZE)
    wrong = straight.moved(straight.R, straight.C + (field.repeats, 0.0, 0.0))
    maps = PictureToSearch(picture(right, field)).stripes(lighter=True).maps
    alike = court_search._further_along(wrong, field, maps, [wrong, right])
    assert sum(one is right for one in alike) == 1
    assert not any(one is wrong for one in alike)


@pytest.mark.parametrize(("paint", "found"), [(230, True), (20, True), (120, False)])
def test_a_net_is_found_lighter_or_darker_where_lines_are_darker_than_the_ground(paint, found):
    field = field_named("beach-volleyball")
    camera = Camera.from_angles(np.radians(-35), np.radians(65), 0.0, 1300.0, (2.0, 15.0, -8.0), SIZE)
    image = np.full((*SIZE[::-1], 3), 120, np.uint8)
    for label in ("Net upper edge", "Side line top"):
        ends = np.round(camera.project([field[label].start, field[label].end])).astype(int)
        cv2.line(image, *ends, (paint,) * 3, 4, cv2.LINE_AA)
    markings = Markings.of(field)
    profiles = profiles_along(camera, markings)
    share = {
        label: np.mean(np.isfinite(find_lines(image, profiles, 4.0)[profiles.member == markings.labels.index(label)]))
        for label in ("Net upper edge", "Side line top")
    }
    assert (share["Net upper edge"] > 0.7) == found
    assert (share["Side line top"] > 0.7) == (paint < 120)


@pytest.mark.parametrize("label", ["Goal left post top", "Goal left post bottom"])
def test_a_camera_does_not_rest_on_one_post_which_may_be_the_other_one(label):
    field, size = field_named("rugby-league"), (960, 540)
    stand = Camera.from_angles(0.1, 1.25, 0.0, 1494.0, (-44.0, 89.0, -29.0), size, k=(0.14, 0.0))

    def seen(name):
        xy = stand.project(field[name].sample(1.0))
        return xy[np.all((xy > 0.0) & (xy < size), axis=1)]  # without those behind the camera

    lines = ["Touchline top", "Goal line left", "Dead-ball line left", *(f"{k}0-metre line left" for k in range(1, 5))]
    ground = {name: seen(name) for name in lines}
    posts = {name: seen(name) for name in ("Goal left post top", "Goal left post bottom")}
    lone, both = (
        calibrate_from_segments(field, ground | raised, size)
        for raised in ({"Goal left post top": posts[label]}, posts)
    )
    assert lone.probability() > 0.8  # as nothing contradicts it, right or wrong
    without = court_search._without_unseen(Task(field), Refined(lone, 0.5)).calibration
    assert without.pixel_counts.keys() == ground.keys()
    assert without.probability() < 0.2
    assert court_search._without_unseen(Task(field), Refined(both, 0.5)).calibration is both


@pytest.mark.parametrize(
    ("probability", "verdict"), [(0.5, Verdict.REJECT), (0.6, Verdict.CHECK), (0.7, Verdict.GOOD)], ids=str
)
def test_a_camera_that_is_hardly_likelier_than_not_is_to_be_checked(probability, verdict):
    court = tennis()
    seen = {label: TENNIS.project(court[label].sample(0.5)) for label in court if "ine" in label}
    found = Refined(calibrate_from_segments(court, seen, SIZE), 0.9)
    judged = court_search._judged(found, EVIDENCE, probability, court_search.LEAST_PROBABILITY)
    assert judged.verdict is verdict


@pytest.mark.parametrize(("places", "counts"), [(range(8, 11), False), (range(3, 27), True)])
def test_a_camera_does_not_rest_on_a_net_that_hardly_shows(places, counts):
    """Three lines leave the focal length open; a few lines near the net that is projected may be anything."""
    court = field_named("beach-volleyball")
    seen = Camera.from_angles(0.3, 0.95, 0.0, 1670.0, (-1.2, 16.7, -13.6), (960, 540), k=(0.43, 0.0))

    def along(label):
        xy = seen.project(court[label].sample(0.25))
        return xy[np.all((xy > 0.0) & (xy < seen.image_size), axis=1)]

    ground = {label: along(label) for label in ("Side line top", "Side line bottom", "End line right")}
    net = {label: along(label)[list(places)] for label in ("Net upper edge", "Net lower edge")}
    found = calibrate_from_segments(court, ground | net, seen.image_size)
    rests = court_search._without_unseen(Task(court), Refined(found, 0.5)).calibration
    assert (rests is found) is counts
    assert counts or rests.pixel_counts.keys() == ground.keys()


def test_a_goal_in_view_tells_how_far_along_a_field_a_camera_is():
    field = field_named("american-football-nfl")
    stand = Camera.from_angles(0.0, 1.25, 0.0, 1500.0, (40.0, 75.0, -22.0), SIZE)
    maps = PictureToSearch(picture(stand, field)).stripes(lighter=True).maps
    level = replace(field, segments={label: one for label, one in field.items() if not label.startswith("Goal right")})
    assert court_search._further_along(stand, level, maps, [stand])
    assert not court_search._further_along(stand, field, maps, [stand])


def test_the_fit_recovers_coefficients():
    rng, truth = np.random.default_rng(0), np.array([-1.0, 2.0, -1.5])
    pictures = []
    for _ in range(1000):
        features = np.column_stack([np.ones(3), rng.normal(size=(3, 2))])
        odds = np.exp(features @ truth)
        right = rng.choice(4, p=np.append(odds, 1.0) / (1.0 + odds.sum()))
        pictures.append((features, np.arange(3) == right))
    np.testing.assert_allclose(fitted(pictures), truth, atol=0.15)


def seen_in(image):
    """The stripes of a picture, all of them of long lines."""
    found = PictureToSearch(image).stripes(lighter=True)
    vars(found)["on_lines"] = [np.ones(len(found.seen.xy), dtype=bool)]
    return found


def test_the_grain_of_a_floor_counts_by_its_contrast():
    court = tennis()
    image = picture(TENNIS, court)
    clean = explained(seen_in(image), court, TENNIS)
    grain = image.copy()
    for row in range(300, 700, 16):
        grain[row : row + 3] = np.clip(grain[row : row + 3].astype(int) + 14, 0, 255).astype(np.uint8)
    with_grain = seen_in(grain)
    unexplained = np.count_nonzero(np.abs((with_grain.seen.xy[:, 1] - 301.0) % 16.0) < 2.0)
    assert unexplained > 0.25 * len(with_grain.seen.xy)
    assert explained(with_grain, court, TENNIS) > 0.97
    assert clean > 0.97


def test_few_lines_are_enough_if_the_markings_show_their_paint():
    assert EVIDENCE.is_enough
    assert replace(EVIDENCE, score=180.0).is_enough
    assert not replace(EVIDENCE, score=180.0, paint=0.3).is_enough
    assert replace(EVIDENCE, paint=0.3).is_enough


def test_a_camera_is_refined_if_its_markings_lie_on_stripes():
    court = tennis()
    seen = seen_in(picture(TENNIS, court))
    beside = TENNIS.moved(TENNIS.R, TENNIS.C + (0.0, 2.0, 0.0))
    rivals = Rivals.of(Ranked(Cameras.of([TENNIS], SIZE), np.array([300.0]), Bend(0.0, SIZE)), court, {})
    assert is_promising(seen, rivals, court, TENNIS)
    assert not is_promising(seen, rivals, court, beside)
