"""Labelled pixels: what is refused, how the centre circle is split, how frames are packed."""

import re

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import numbers, pixel_arrays, vectors

from fieldcalib.fields import padel, tennis
from fieldcalib.fields.segments import Arc, ArcRows, Line, LineRows, Point, PointCloud
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.problem.labelled_pixels import PixelTable, check_segments, check_weights, split_circles
from fieldcalib.problem.observations import Observations, pack

SIZE = (960, 540)
FIELD = soccer()
LINE = [(480.0, 100.0), (480.0, 400.0)]

KINDS = ("lines", "arcs", "curves", "points", "clouds")
OBJECT = {
    "post": Line((1.0, 2.0, 0.0), (1.0, 2.0, -2.44)),
    "dot": Point((4.0, 5.0, 6.0)),
    "arc": Arc((0.0, 1.0, 0.0), 9.15, u=(0.0, 1.0, 0.0), v=(0.0, 0.0, -1.0)),
    "long curve": PointCloud(np.arange(15.0).reshape(5, 3) ** 2, ordered=True),
    "short curve": PointCloud(np.arange(9.0).reshape(3, 3), ordered=True),
    "side": Line((0.0, 0.0, 0.0), (3.0, 0.0, 0.0)),
    "cloud": PointCloud(np.arange(12.0).reshape(4, 3)),
    "pair": PointCloud([(7.0, 7.0, 7.0), (8.0, 8.0, 8.0)]),
    "other dot": Point((0.0, 0.0, -1.0)),
}
KIND_OF = {
    "post": "lines",
    "side": "lines",
    "arc": "arcs",
    "long curve": "curves",
    "short curve": "curves",
    "dot": "points",
    "other dot": "points",
    "cloud": "clouds",
    "pair": "clouds",
}


def check(frame, image_size=SIZE):
    return check_segments(FIELD, frame, image_size)


# --- what comes in ---


def test_good_pixels_come_back_as_float_arrays_by_stripped_label():
    pixels = check({"Middle line": [(480, 100), (480, 400)], "Goal left post left ": np.array([[1.5, 2.5]])})
    assert set(pixels) == {"Middle line", "Goal left post left"}
    assert pixels["Middle line"].dtype == float
    np.testing.assert_array_equal(pixels["Middle line"], LINE)
    np.testing.assert_array_equal(pixels["Goal left post left"], [[1.5, 2.5]])


def test_segments_without_pixels_count_as_not_given():
    assert set(check({"Middle line": LINE, "Side line top": [], "Circle left": np.zeros((0, 2))})) == {"Middle line"}
    assert check({}) == {}


def test_blanks_that_belong_to_a_label_are_kept():
    object_segments = {"post ": OBJECT["post"], "side": OBJECT["side"]}
    assert set(check_segments(object_segments, {"post ": LINE, " side": LINE}, SIZE)) == {"post ", "side"}


@pytest.mark.parametrize(
    ("label", "nearest"),
    [
        ("Midle line", "Middle line"),
        ("middle line", "Middle line"),
        ("Big rect left top", "Big rect. left top"),
        ("Circle center", "Circle central"),
        ("Goal left post left_", "Goal left post left"),
    ],
)
def test_an_unknown_label_names_the_nearest_known_one(label, nearest):
    with pytest.raises(ValueError, match=f"^unknown label '{label}'; did you mean '{nearest}'\\?$"):
        check({label: LINE})


def test_labels_of_another_field_are_said_to_be_of_it():
    with pytest.raises(ValueError, match="; all labels are of the field soccer or soccer-9v9: is it"):
        check_segments(tennis(), {"Circle central": LINE, "Side line right": LINE}, SIZE)
    with pytest.raises(ValueError, match="unknown label 'Side line top'; did you mean '"):  # many fields have both
        check_segments(padel(), {"Side line top": LINE, "Side line bottom": LINE}, SIZE)


def test_what_is_no_mapping_is_refused():
    with pytest.raises(ValueError, match="expected a mapping of labels to \\(N, 2\\) pixels, got list"):
        check([LINE])
    with pytest.raises(ValueError, match="expected a field, as soccer\\(\\), or a mapping"):
        check_segments(soccer, {"Middle line": LINE}, (960, 540))
    with pytest.raises(ValueError, match=r"got 'tennis'; did you mean fieldcalib.field\('tennis'\)"):
        check_segments("tennis", {"Middle line": LINE}, (960, 540))


def test_pixels_of_a_larger_image_are_refused():
    xs = np.linspace(1500.0, 1900.0, 8)
    with pytest.raises(ValueError, match=r"% of the pixels lie far outside an image of 960 x 540, up to 1900"):
        check({"Side line top": np.stack([xs, 0.1 * xs], axis=1)})


def test_a_pixel_that_can_be_none_is_named():
    with pytest.raises(ValueError, match=r"'Middle line': pixel 1 at \(480.0, 1e\+160\) is far outside the image"):
        check({"Middle line": [(480.0, 100.0), (480.0, 1e160)]})


def test_the_side_of_a_slanted_middle_line_counts():
    line = np.array([(100.0, 200.0), (800.0, 300.0)])
    circle = np.array([(450.0, 260.0), (450.0, 240.0)])  # below and above it
    split = split_circles(FIELD, {"Middle line": line, "Circle central": circle}, SIZE)
    np.testing.assert_array_equal(split[LEFT], circle[:1])
    np.testing.assert_array_equal(split[RIGHT], circle[1:])


def test_a_label_unlike_any_other_gets_the_list_of_known_ones():
    with pytest.raises(ValueError, match=r"unknown label 'xyz'; known labels: Side line top.* and 57 more"):
        check({"xyz": LINE})


def test_normalised_coordinates_are_refused_with_how_to_mend_them():
    with pytest.raises(
        ValueError, match=r"image of 960 x 540, got coordinates between 0\.1 and 1\.02, .* normalised; mul"
    ):
        check({"Middle line": [(0.5, 0.1), (0.52, 0.9)], "Side line top": [(-0.0 + 0.3, 0.1), (1.02, 0.2)]})


def test_pixels_in_the_corner_of_the_image_are_not_taken_for_normalised_ones():
    check({"Middle line": [(0.5, 0.1), (3.5, 0.9)]})
    check({"CENTER_MARK": [(1.0, 1.0)]})  # one pixel proves nothing


@given(st.integers(0, 5), st.sampled_from([np.nan, np.inf, -np.inf]), st.integers(0, 1))
def test_a_number_that_is_not_finite_is_named_by_label_and_index(index, number, axis):
    xy = np.full((6, 2), 100.0)
    xy[index, axis] = xy[5, 1] = number
    with pytest.raises(
        ValueError, match=rf"^'Side line top': pixel {index} is not finite: .*(nan|inf).*; leave it out"
    ):
        check({"Middle line": LINE, "Side line top": xy})


def test_swapped_image_size_is_recognised():
    frame = {"Side line top": [(x, 100.0 + 0.1 * x) for x in range(0, 960, 60)]}
    check(frame, (960, 540))
    advice = r"give image_size as \(width, height\), and pixels as \(x, y\), not as \(row, column\)"
    with pytest.raises(ValueError, match=rf"image_size = \(540, 960\) leaves \d+ % .* {advice}"):
        check(frame, (540, 960))


def test_annotations_somewhat_outside_the_image_are_accepted():
    check({"Middle line": [(480.0, -100.0), (480.0, 640.0)], "Side line top": [(-200.0, 80.0), (1150.0, 90.0)]})


@pytest.mark.parametrize(
    ("values", "shape"),
    [
        ([480.0, 100.0], r"\(2,\); reshape\(-1, 2\) makes them so"),
        ([(480.0, 100.0, 1.0)], r"\(1, 3\)"),
        (np.zeros((4, 1, 2)), r"\(4, 1, 2\); reshape\(-1, 2\) makes them so"),
        (480.0, r"\(\)"),
    ],
)
def test_wrong_shapes_are_refused_by_label(values, shape):
    with pytest.raises(ValueError, match=rf"^'Middle line': expected pixels of shape \(N, 2\), got {shape}$"):
        check({"Middle line": values})


@pytest.mark.parametrize(
    "values", [[(480.0, 100.0), (480.0,)], [{"x": 0.5, "y": 0.1}, {"x": 0.5, "y": 0.9}], [("a", "b")]], ids=str
)
def test_what_is_no_array_of_numbers_is_refused_by_label(values):
    """Ragged lists, and the dictionaries of SoccerNet's annotation files."""
    with pytest.raises(ValueError, match=r"'Middle line'.*\(N, 2\)"):
        check({"Middle line": values})


def test_one_label_given_twice_with_and_without_a_blank_is_refused():
    with pytest.raises(ValueError, match="'Goal left post left' is given twice, with and without surrounding blanks"):
        check({"Goal left post left": LINE, "Goal left post left ": LINE})


def test_the_input_is_left_alone():
    xy = np.array(LINE)
    frame = {"Middle line": xy, "Goal left post left ": [(1.0, 2.0)]}
    check(frame)
    assert list(frame) == ["Middle line", "Goal left post left "]
    np.testing.assert_array_equal(xy, LINE)


# --- the centre circle ---

LEFT, RIGHT = "Circle central left", "Circle central right"


def rows_of(*arrays):
    """All pixels in an order that does not depend on how they were split."""
    xy = np.concatenate([np.asarray(a).reshape(-1, 2) for a in arrays])
    return xy[np.lexsort(xy.T)]


@given(
    lean=numbers(-0.95, 0.95),
    x_top=numbers(300.0, 600.0),
    ys=st.lists(numbers(0.0, 540.0), min_size=2, max_size=4),
    # left or right of the line, how far, and the row
    places=st.lists(st.tuples(st.sampled_from([-1.0, 1.0]), numbers(1.0, 200.0), numbers(100.0, 400.0)), min_size=1),
)
def test_circle_is_split_by_the_middle_line_whatever_its_slant(lean, x_top, ys, places):
    """The line leans by `lean` px per row."""
    assume(np.ptp(ys) > 10.0)
    line = np.column_stack([x_top + lean * np.array(ys), ys])
    side, distance, rows = np.array(places).T
    circle, left = np.column_stack([x_top + lean * rows + side * distance, rows]), side < 0.0
    split = split_circles(FIELD, {"Circle central": circle, "Middle line": line}, SIZE)
    np.testing.assert_array_equal(split.get(LEFT, np.empty((0, 2))), circle[left])
    np.testing.assert_array_equal(split.get(RIGHT, np.empty((0, 2))), circle[~left])
    assert "Circle central" not in split


pixels = pixel_arrays((0.0, 0.0), (500.0, 500.0))


@given(
    circle=pixels,
    middle=st.sampled_from(["slanted", "flat", "single", "none"]),
    halves=st.none() | st.tuples(pixels, pixels),
)
def test_splitting_conserves_every_pixel_and_the_other_labels(circle, middle, halves):
    frame = {"Side line top": np.array([(3.0, 4.0), (480.0, 20.0)]), "Circle central": circle}
    if middle != "none":
        line = {"slanted": [(400, 50), (500, 450)], "flat": [(50, 200), (900, 260)], "single": [(400, 50)]}[middle]
        frame["Middle line"] = np.array(line, dtype=float)
    if halves is not None:
        frame |= {LEFT: halves[0], RIGHT: halves[1]}
    before = {label: xy.copy() for label, xy in frame.items()}
    split = split_circles(FIELD, frame, SIZE)
    found = [split[label] for label in (LEFT, RIGHT) if label in split]
    given_halves = [before[label] for label in (LEFT, RIGHT) if label in before]
    np.testing.assert_array_equal(rows_of(*found), rows_of(before["Circle central"], *given_halves))
    assert set(split) - {LEFT, RIGHT} == set(before) - {LEFT, RIGHT, "Circle central"}
    assert all(len(xy) for xy in split.values())
    assert list(frame) == list(before)  # the input is left alone
    for label, xy in frame.items():
        np.testing.assert_array_equal(xy, before[label])


@pytest.mark.parametrize(("x", "half"), [(200.0, RIGHT), (700.0, LEFT)])
@pytest.mark.parametrize(
    "middle_line",
    [None, [(480.0, 300.0)], [(0.0, 300.0), (960.0, 280.0)], [(480.0, 300.0), (480.0, 300.0)]],
    ids=["absent", "one pixel", "flat, from behind a goal", "no length"],
)
def test_without_a_middle_line_the_half_is_that_towards_the_middle_of_the_image(middle_line, x, half):
    frame = {"Circle central": x + np.array([[-20.0, 200.0], [0.0, 210.0], [20.0, 230.0]])}
    frame |= {} if middle_line is None else {"Middle line": np.array(middle_line)}
    split = split_circles(FIELD, frame, SIZE)
    np.testing.assert_array_equal(split[half], frame["Circle central"])
    assert not {LEFT, RIGHT, "Circle central"} & set(split) - {half}


def test_a_frame_without_the_circle_comes_back_as_a_copy():
    frame = {"Middle line": np.array(LINE)}
    split = split_circles(FIELD, frame, SIZE)
    assert split == frame
    assert split is not frame


# --- packing ---


# one to four frames: one to eight pixels on some of the segments, perhaps on none, in any order
some_frames = st.lists(st.dictionaries(st.sampled_from(sorted(OBJECT)), pixels), min_size=1, max_size=4)


def rows_by_kind(observations):
    *kinds, ends = observations.rows
    assert not ends
    return {rows.name: rows for rows in kinds}


@given(some_frames)
def test_every_pixel_is_packed_under_its_label_and_kind(frames):
    packed = pack(OBJECT, frames, SIZE)
    assert len(packed) == len(frames)
    assert packed.labels == tuple(OBJECT)
    assert packed.image_size == SIZE
    for kind, rows in rows_by_kind(packed).items():
        for t, frame in enumerate(frames):
            found = {packed.labels[i] for i in rows.label[t] if i >= 0}
            assert found == {label for label in frame if KIND_OF[label] == kind}
            for label in found:
                np.testing.assert_array_equal(rows.xy[t, rows.label[t] == packed.labels.index(label)], frame[label])


@given(some_frames)
def test_weights_of_a_segment_sum_to_one_and_padding_has_none(frames):
    for rows in rows_by_kind(pack(OBJECT, frames, SIZE)).values():
        np.testing.assert_array_equal(rows.weight > 0.0, rows.label >= 0)
        np.testing.assert_array_equal(rows.weight[rows.label < 0], 0.0)
        for t in range(len(frames)):
            for label in set(rows.label[t][rows.label[t] >= 0]):
                weight = rows.weight[t][rows.label[t] == label]
                assert weight.sum() == pytest.approx(1.0)
                assert np.ptp(weight) == 0.0


@given(some_frames)
def test_padding_stands_at_the_end_and_is_no_longer_than_the_fullest_frame_asks(frames):
    for kind, rows in rows_by_kind(pack(OBJECT, frames, SIZE)).items():
        counts = [sum(len(xy) for label, xy in frame.items() if KIND_OF[label] == kind) for frame in frames]
        assert rows.xy.shape == (len(frames), max(counts), 2)
        assert bool(rows) == (max(counts) > 0)
        for t, count in enumerate(counts):
            assert np.all(rows.label[t, :count] >= 0)
            assert np.all(rows.label[t, count:] == -1)


@given(some_frames)
def test_padding_has_finite_geometry_with_a_direction(frames):
    packed = pack(OBJECT, frames, SIZE)
    for rows in rows_by_kind(packed).values():
        assert np.all(np.isfinite(rows.geometry))
    for rows in (packed.of_kind(LineRows), packed.of_kind(ArcRows)):
        assert np.all(np.linalg.norm(rows.geometry[:, :, 1], axis=-1) > 0.0)


@given(some_frames)
def test_packing_a_batch_equals_packing_frame_by_frame_up_to_padding(frames):
    packed = rows_by_kind(pack(OBJECT, frames, SIZE))
    for t, frame in enumerate(frames):
        for kind, one in rows_by_kind(pack(OBJECT, [frame], SIZE)).items():
            n = one.xy.shape[1]
            for name in ("xy", "weight", "label"):
                np.testing.assert_array_equal(getattr(packed[kind], name)[t, :n], getattr(one, name)[0])
            depth = one.geometry.shape[2]
            geometry = packed[kind].geometry[t, :n]
            np.testing.assert_array_equal(geometry[:, :depth], one.geometry[0])
            # in company of a longer curve a curve repeats its last point
            np.testing.assert_array_equal(
                geometry[:, depth:], np.repeat(geometry[:, depth - 1 : depth], geometry.shape[1] - depth, axis=1)
            )


def test_geometry_by_hand():
    packed = pack(OBJECT, [{label: np.array([[1.0, 2.0]]) for label in OBJECT}], SIZE)

    def geometry(label):
        rows = rows_by_kind(packed)[KIND_OF[label]]
        return rows.geometry[0, list(rows.label[0]).index(packed.labels.index(label))]

    np.testing.assert_array_equal(geometry("post"), [(1.0, 2.0, 0.0), (0.0, 0.0, -2.44)])
    np.testing.assert_array_equal(geometry("side"), [(0.0, 0.0, 0.0), (3.0, 0.0, 0.0)])
    np.testing.assert_array_equal(geometry("arc"), [(0.0, 1.0, 0.0), (0.0, 9.15, 0.0), (0.0, 0.0, -9.15)])
    np.testing.assert_array_equal(geometry("dot"), [(4.0, 5.0, 6.0)])
    np.testing.assert_array_equal(geometry("long curve"), OBJECT["long curve"].X)
    np.testing.assert_array_equal(geometry("short curve"), OBJECT["short curve"].X[[0, 1, 2, 2, 2]])
    np.testing.assert_array_equal(geometry("pair"), OBJECT["pair"].X[[0, 1, 1, 1]])


@given(some_frames, st.lists(st.integers(0, 10), max_size=6))
def test_take_picks_frames_in_order_and_repeats_them(frames, index):
    index = np.array([i % len(frames) for i in index], dtype=np.intp)
    packed = pack(OBJECT, frames, SIZE)
    taken = packed.take(index)
    assert len(taken) == len(index)
    assert (taken.labels, taken.image_size) == (packed.labels, packed.image_size)
    for kind, rows in rows_by_kind(taken).items():
        for name in ("xy", "weight", "label", "geometry"):
            np.testing.assert_array_equal(getattr(rows, name), getattr(rows_by_kind(packed)[kind], name)[index])
    np.testing.assert_array_equal(taken.weight, packed.weight[index])


@given(some_frames)
def test_observations_give_the_table_that_they_were_packed_from(frames):
    table = PixelTable.of(OBJECT, frames)
    found = Observations.of(OBJECT, table, SIZE).pixels
    for name in ("labels", "count", "frame", "label", "xy", "weight"):
        np.testing.assert_array_equal(getattr(found, name), getattr(table, name))


@given(some_frames, st.sampled_from(sorted(OBJECT)), st.sampled_from([None, *sorted(OBJECT)]))
def test_relabelled_pixels_stand_where_their_new_label_would(frames, label, other):
    packed = pack(OBJECT, frames, SIZE)
    index, new = packed.labels.index(label), -1 if other is None else packed.labels.index(other)
    found = packed.relabelled(np.where(packed.pixels.label == index, new, packed.pixels.label))
    expected = []
    for frame in frames:
        parts = {}
        for one, xy in frame.items():
            if (name := other if one == label else one) is not None:
                parts.setdefault(name, []).append(xy)
        expected.append({name: np.concatenate(xy) for name, xy in parts.items()})
    assert len(found) == len(frames)
    for t, frame in enumerate(expected):
        table = found.pixels.of_frames([t])
        pixels = table.by_label(0)
        assert pixels.keys() == frame.keys()
        for name, xy in frame.items():  # the pixels of two labels keep the order of their kinds
            np.testing.assert_array_equal(np.sort(pixels[name], axis=0), np.sort(xy, axis=0))
            weight = table.weight[table.label == packed.labels.index(name)]
            np.testing.assert_array_equal(weight, np.full(len(xy), 1.0 / len(xy)))


@given(some_frames)
def test_points_and_unordered_clouds_have_two_residuals_a_pixel(frames):
    packed = pack(OBJECT, frames, SIZE)
    lines, arcs, curves, points, clouds, _ = packed.rows
    order = [lines, arcs, curves, points, points, clouds, clouds]
    np.testing.assert_array_equal(packed.weight, np.concatenate([rows.weight for rows in order], axis=1))
    np.testing.assert_array_equal(packed.label, np.concatenate([rows.label for rows in order], axis=1))
    assert packed.label.dtype == np.intp


def test_frames_without_any_pixel_pack_to_nothing():
    packed = pack(OBJECT, [{}, {}], SIZE)
    assert len(packed) == 2
    assert packed.weight.shape == (2, 0)
    assert not any(rows_by_kind(packed).values())


def test_the_whole_field_can_be_packed():
    rng = np.random.default_rng(0)
    packed = pack(FIELD, [{label: rng.uniform(0, 500, size=(2, 2)) for label in FIELD}], SIZE)
    counts = {kind: rows.xy.shape[1] for kind, rows in rows_by_kind(packed).items()}
    assert counts == {"lines": 2 * 23, "arcs": 2 * 5, "curves": 0, "points": 2 * 39, "clouds": 0}


# --- weights ---

WEIGHTED = {"Middle line": np.array(LINE), "CENTER_MARK": np.array([(480.0, 250.0)])}


def shares_of(weights, frame=WEIGHTED):
    return check_weights(FIELD, frame, weights)[1]


def test_without_weights_nothing_changes():
    assert check_weights(FIELD, WEIGHTED, None) == (WEIGHTED, None)


def test_a_number_is_shared_by_the_pixels_and_what_has_none_weighs_one():
    shares = shares_of({"Middle line ": 3.0, "Circle left": 7.0})
    assert {label: share.tolist() for label, share in shares.items()} == {
        "Middle line": [1.5, 1.5],
        "CENTER_MARK": [1.0],
    }


def test_each_pixel_may_have_its_own_weight():
    shares = shares_of({"Middle line": [1.0, 3.0], "CENTER_MARK": [0.5]})
    assert {label: share.tolist() for label, share in shares.items()} == {
        "Middle line": [0.5, 1.5],
        "CENTER_MARK": [0.5],
    }


def test_pixels_of_weight_zero_are_left_out_and_the_others_weigh_what_they_did():
    pixels, shares = check_weights(FIELD, WEIGHTED, {"Middle line": [0.0, 1.0], "CENTER_MARK": 0.0})
    assert {label: xy.tolist() for label, xy in pixels.items()} == {"Middle line": [[480.0, 400.0]]}
    assert {label: share.tolist() for label, share in shares.items()} == {"Middle line": [0.5]}
    assert list(WEIGHTED) == ["Middle line", "CENTER_MARK"]  # the input is left alone


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ([1.0], "expected a mapping of labels to weights, got list"),
        ({"Midle line": 1.0}, "unknown label 'Midle line'; did you mean 'Middle line'?"),
        ({"Middle line": "a"}, "'Middle line': expected a weight, or one for each pixel, got 'a'"),
        ({"Middle line": None}, "'Middle line': a weight must be finite and not negative, got nan"),
        ({"Middle line": -1.0}, "'Middle line': a weight must be finite and not negative, got -1.0"),
        ({"Middle line": [1.0, np.inf]}, "'Middle line': a weight must be finite and not negative, got inf"),
        ({"Circle left": np.nan}, "'Circle left': a weight must be finite and not negative, got nan"),
        ({"Middle line": [1.0] * 3}, "'Middle line': expected one weight or 2, one for each pixel, got shape (3,)"),
        (
            {"Middle line": [[1.0, 1.0]]},
            "'Middle line': expected one weight or 2, one for each pixel, got shape (1, 2)",
        ),
        ({"Circle left": [1.0]}, "'Circle left': expected one weight or 0, one for each pixel, got shape (1,)"),
        ({"Middle line": 1.0, "Middle line ": 1.0}, "'Middle line' has two weights, with and without surrounding"),
        ({"Middle line": 0.0, "CENTER_MARK": 0.0}, "every label has the weight 0: nothing is left to calibrate from"),
    ],
)
def test_weights_that_cannot_be_are_refused(weights, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        shares_of(weights)


def test_a_frame_without_pixels_has_no_weights_to_be_wrong():
    assert check_weights(FIELD, {}, {"Middle line": 0.0}) == ({}, {})


@given(some_frames, vectors([0.1] * 8, [5.0] * 8))
def test_weights_are_packed_beside_their_pixels(frames, weights):
    given_weights = [{label: weights[: len(xy)] for label, xy in frame.items()} for frame in frames]
    checked = [check_weights(OBJECT, *pair) for pair in zip(frames, given_weights, strict=True)]
    packed = pack(OBJECT, frames, SIZE, [shares for _, shares in checked])
    plain = pack(OBJECT, frames, SIZE)
    for kind, rows in rows_by_kind(packed).items():
        without = rows_by_kind(plain)[kind]
        for name in ("xy", "label", "geometry"):
            np.testing.assert_array_equal(getattr(rows, name), getattr(without, name))
        for t, weights in enumerate(given_weights):
            for label, weight in weights.items():
                if KIND_OF[label] == kind:
                    mine = rows.label[t] == packed.labels.index(label)
                    np.testing.assert_allclose(rows.weight[t, mine], weight * without.weight[t, mine], rtol=1e-12)
        np.testing.assert_array_equal(rows.weight[rows.label < 0], 0.0)


def test_frames_with_and_without_weights_are_packed_together():
    packed = pack(FIELD, [WEIGHTED, WEIGHTED], SIZE, [shares_of({"Middle line": 4.0}), None])
    np.testing.assert_array_equal(packed.of_kind(LineRows).weight, [[2.0, 2.0], [0.5, 0.5]])


# --- points of one's own ---


def test_a_field_with_more_segments_is_a_field():
    mine = {"my point": Point((1.0, 2.0, 0.0)), "second mark": Point((0.0, 0.0, 0.0))}
    field = FIELD.with_segments(mine)
    assert (field.length, field.width) == (FIELD.length, FIELD.width)
    assert dict(field) == {**FIELD, **mine}
    assert "my point" not in FIELD
    assert set(check_segments(field, {"my point": [(3.0, 400.0)]}, SIZE)) == {"my point"}
    # a point without a counterpart has none, and the field's own names stay what they were
    assert dict(field.symmetric) == {**FIELD.symmetric, "second mark": "CENTER_MARK"}


@pytest.mark.parametrize("name", ["CENTER_MARK", " CENTER_MARK"])
def test_a_name_of_the_field_cannot_be_given_twice(name):
    with pytest.raises(ValueError, match="the field has a segment 'CENTER_MARK' already: give yours another name"):
        FIELD.with_segments({name: Point((1.0, 2.0, 0.0))})


def test_angles_of_an_arc_in_degrees_are_refused():
    with pytest.raises(ValueError, match="got 90 to 270: degrees"):
        Arc((8.0, 0.0, 0.0), 3.0, 90.0, 270.0)
    assert Arc((8.0, 0.0, 0.0), 3.0, np.pi / 2, 5 * np.pi / 2).is_whole
