"""Fields in files of one's own: what is read is what was written, and errors say what is wrong with what."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
import yaml

from fieldcalib import soccer
from fieldcalib.fields import FIELDS, field_named
from fieldcalib.fields.records import field_from_record, field_to_record
from fieldcalib.fields.segments import Point
from fieldcalib.fields.sports.rugby_union import rugby_union
from fieldcalib.fields.traits import Paint, stands_beside
from fieldcalib.io.field_files import read_field, write_field
from fieldcalib.io.files import BrokenFileError

COURT = """
length: 28.0
width: 15
segments:
  Middle line: {kind: Line, start: [0, -7.65, 0], end: [0, 7.65, 0]}
  Circle central: {kind: Arc, center: [0, 0, 0], radius: 1.775}
  Three-point arc right: {kind: Arc, center: [12.425, 0, 0], radius: 6.725, start: 1.75, stop: 4.53}
  Centre: {kind: Point, X: [0, 0, 0]}
  Logo: {kind: PointCloud, points: [[0, 0, 0], [1, 0.1, 0], [2, 0.4, 0]], ordered: true}
stands:
  - {name: seats, pan: [-40, 40], tilt: [50, 88], roll: [-5, 5], fov: [15, 70], x: [-14, 14], y: [12, 35], z: [-12, -2]}
farthest_camera: 60
lines: {width: 0.05, ground_difference: inf}
paint:
  Middle line: {width: 0.1, colour: "#c8102e", dashes: [0.5, 0.25]}
  Logo: {width: 0, outwards: 0.3}
surface: wood
size_known: true
"""


@pytest.mark.parametrize(
    ("name", "suffix"),
    [
        ("soccer", ".yml"),
        *((name, ".yaml") for name in FIELDS),
        *(pytest.param(name, ".json", marks=() if name == "soccer" else pytest.mark.slow) for name in FIELDS),
    ],
)
def test_every_field_is_read_as_it_was_written(tmp_path, name, suffix):
    field, path = field_named(name), tmp_path / f"field{suffix}"
    for one in [field, replace(field, size_model=None)][: 1 + (field.size_model is not None)]:
        write_field(path, one)
        assert read_field(path) == one


def test_what_is_written_is_an_example_with_everything(tmp_path):
    path = tmp_path / "field.yaml"
    write_field(path, soccer())
    record = yaml.safe_load(path.read_text())
    assert list(record["segments"]) == list(soccer())
    assert record["segments"]["Middle line"] == {"kind": "Line", "start": [0.0, -34.0, 0.0], "end": [0.0, 34.0, 0.0]}
    record["segments"]["Middle line"]["start"] = [0.0, -35.0, 0.0]
    path.write_text(yaml.safe_dump(record))
    mine = read_field(path)
    assert mine["Middle line"].start == (0.0, -35.0, 0.0)
    assert mine.stands == soccer().stands
    assert not mine.moves_with_size


@pytest.mark.parametrize("in_goal", [10.0, 8.0])
def test_a_field_of_rugby_keeps_its_in_goal(tmp_path, in_goal):
    field = rugby_union(98.0, 69.0, in_goal=in_goal)
    assert field.resized(100.0, 70.0) == rugby_union(in_goal=in_goal)
    assert field.motion[list(field).index("Dead-ball line right"), 0, 0].tolist() == [0.5, 0.0]
    short = field_to_record(field)
    assert short["builder"] == "rugby-union"
    moved = field.with_segments({"mine": Point((0.0, 0.0, 0.0))})
    write_field(tmp_path / "field.json", moved)
    for again in (field_from_record(json.loads(json.dumps(short))), pickle.loads(pickle.dumps(field))):
        assert again == field
        assert (
            again.resized(100.0, 70.0)["Dead-ball line right"] == rugby_union(in_goal=in_goal)["Dead-ball line right"]
        )
    assert read_field(tmp_path / "field.json") == moved
    with pytest.raises(
        ValueError, match="unknown in_gaol: expected builder, length, width, size_known, ground, in_goal"
    ):
        field_from_record({**short, "in_gaol": 8.0})


def test_a_court_of_ones_own(tmp_path):
    path = tmp_path / "court.yaml"
    path.write_text(COURT)
    field = read_field(path)
    assert (field.length, field.width, field.farthest_camera, field.size_known) == (28.0, 15.0, 60.0, True)
    assert list(field) == ["Middle line", "Circle central", "Three-point arc right", "Centre", "Logo"]
    assert field["Three-point arc right"].radius == 6.725
    assert field.stands[0].y == (12, 35)
    assert (field.lines.width, field.lines.ground_difference, field.lines.lighter) == (0.05, np.inf, True)
    assert field.paint_of("Middle line") == Paint(0.1, "#c8102e", (0.5, 0.25))
    assert field.paint_of("Circle central") == Paint(0.05)
    assert (field.paint_of("Logo").width, field.paint_of("Centre").width, field.surface) == (0.0, 0.0, "wood")
    assert field.scale == pytest.approx(0.32 * np.hypot(28.0, 15.0))


def test_segments_in_parts_are_each_followed_by_their_images():
    end, side = ({"kind": "Line", "start": start, "end": [10, 5, 0]} for start in ([10, -5, 0], [-10, 5, 0]))
    together = {"End line right": end, "Side line bottom": side}
    apart = [{label: one} for label, one in together.items()]
    court = {"length": 20, "width": 10, "mirrored": True}
    ends, sides = ["End line right", "End line left"], ["Side line bottom", "Side line top"]
    assert list(field_from_record({**court, "segments": apart})) == ends + sides
    assert list(field_from_record({**court, "segments": together})) == [ends[0], *sides, ends[1]]
    whole = field_from_record({"length": 20, "width": 10, "segments": apart})
    assert dict(whole) == {label: field_from_record({**court, "segments": together})[label] for label in together}
    with pytest.raises(ValueError, match="segments: expected labels with values, got a int"):
        field_from_record({**court, "segments": [together, 3]})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("length: 28.0", "", "expected length$"),
        ("length: 28.0", "lenght: 28.0", "unknown lenght: expected length$"),
        ("length: 28.0", "length: long", "length: could not convert string to float: 'long'"),
        ("length: 28.0", "length: [1, 2]", "length: expected a number"),
        ("length: 28.0", "length: -28.0", "a Field needs a positive length in metres, got -28.0"),
        ("width: 15", "witdh: 15", "expected width$"),
        ("size_known: true", "colour: red", "unknown colour: expected length, width, segments, stands"),
        ("size_known: true", "size_known: 1", "size_known: expected true or false, got 1"),
        (
            "kind: Line",
            "kind: Lin",
            "segments: Middle line: expected a kind that is one of Point, Line, Arc, PointCloud",
        ),
        (", end: [0, 7.65, 0]", "", "segments: Middle line: expected end$"),
        ("[0, 7.65, 0]", "[0, 7.65]", "segments: Middle line: the end of a Line needs three finite coordinates"),
        ("[0, 7.65, 0]", "[0, -7.65, 0]", "segments: Middle line: a Line needs two different end points"),
        ("radius: 1.775", "radius: round", "segments: Circle central: "),
        (
            "radius: 1.775",
            "radius: 1.775, colour: red",
            "segments: Circle central: unknown colour: expected center, radius",
        ),
        ("pan: [-40, 40], ", "", "stands: stand 1: expected pan$"),
        ("pan: [-40, 40]", "pan: 40", "stands: stand 1: "),
        ("width: 0.05", "width: 0", "lines: the width of a LineLook must be positive"),
        ("#c8102e", "red", "paint: Middle line: expected a colour as "),
        ("dashes: [0.5, 0.25]", "dashes: [0.0, 0.25]", "paint: Middle line: expected the length of dashes"),
        ("width: 0.1", "width: -0.1", "paint: Middle line: expected finite numbers"),
        ("Logo: {width", "Loggia: {width", "paint: 'Loggia' is none of the segments, and none begins with it"),
        ("size_known: true", "mirrored: 1", "mirrored: expected true or false, got 1"),
        ("surface: wood", "surface: parquet", "surface must be one of grass, turf, ice"),
        ("length: 28.0", "length: [28.0", "is no YAML"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, old, new, message):
    assert_refused(tmp_path, COURT, old, new, message)


def assert_refused(tmp_path, court, old, new, message):
    """A file in which `new` stands for `old` is refused with a message, which begins with its path."""
    path = tmp_path / "court.yaml"
    assert old in court
    path.write_text(court.replace(old, new, 1))
    with pytest.raises(BrokenFileError, match=message) as raised:
        read_field(path)
    assert str(raised.value).startswith(f"{path}: ")


SHORT = """
length: 20
width: 10
mirrored: true
segments:
  End line right: {kind: Line, start: [10, -5, 0], end: [10, 5, 0]}
  Side line bottom: {kind: Line, start: [-10, 5, 0], end: [10, 5, 0]}
  Mark right bottom: {kind: Point, X: [8, 4, 0]}
  Logo: {kind: Point, X: [3, 0, 0]}
paint: {Mark: {width: 0.2}}
stands: {away: [3, 30], up: [2, 15], principal_point: 0.3}
"""


def test_a_quarter_of_a_court_and_stands_around_it(tmp_path):
    path = tmp_path / "court.yaml"
    path.write_text(SHORT)
    field = read_field(path)
    assert field["End line left"].start == (-10.0, -5.0, 0.0)
    assert field["Side line top"].start == (-10.0, -5.0, 0.0)
    assert sorted(field) == sorted(
        [f"End line {side}" for side in ("left", "right")]
        + [f"Side line {side}" for side in ("top", "bottom")]
        + [f"Mark {x} {y}" for x in ("left", "right") for y in ("top", "bottom")]
        + ["Logo"]
    )
    assert {field.paint_of(label).width for label in field if label.startswith("Mark")} == {0.2}
    assert field.stands == stands_beside(20.0, 10.0, away=(3.0, 30.0), up=(2.0, 15.0), principal_point=0.3)
    write_field(path, field)  # whole
    assert read_field(path) == field


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("away: [3, 30], ", "", "stands: expected away$"),
        ("away: [3, 30]", "away: 3", r"stands: away: expected \[least, largest\], got 3"),
        ("up: [2, 15]", "up: [2, high]", "stands: up: could not convert"),
        ("up: [2, 15]", "up: [15, 2]", "stands: 'main center': z must be"),
        ("up: [2, 15]", "up: [2, 15], far: 3", "stands: unknown far: expected away, up, principal_point"),
    ],
)
def test_what_is_wrong_of_stands_is_said(tmp_path, old, new, message):
    assert_refused(tmp_path, SHORT, old, new, message)


@pytest.mark.parametrize(("name", "content"), [("a.yaml", ""), ("a.yaml", "- 1"), ("a.json", "[1]"), ("a.json", "{")])
def test_what_is_no_field(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    with pytest.raises(BrokenFileError, match=r"a\.yaml: expected|a\.json: "):
        read_field(tmp_path / name)


def test_what_a_field_is_written_to(tmp_path):
    with pytest.raises(ValueError, match=r"expected a name that ends in .yaml or .json, got 'field.txt'"):
        write_field(tmp_path / "field.txt", soccer())
    assert list(tmp_path.iterdir()) == []
    write_field(tmp_path / "field.json", soccer(100, 64))
    assert json.loads((tmp_path / "field.json").read_text())["width"] == 64.0


def test_python_objects_in_yaml_are_not_made(tmp_path):
    path = tmp_path / "court.yaml"
    path.write_text("!!python/object/apply:os.system ['true']")
    with pytest.raises(BrokenFileError, match="is no YAML"):
        read_field(path)
