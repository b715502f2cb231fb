"""Annotations of CVAT, labelme, Label Studio and COCO: what is read, written, and said of broken files."""

import json
import pickle
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import SIZE
from hypothesis import given
from hypothesis import strategies as st
from strategies import texts

import fieldcalib
from fieldcalib.io.annotations import Annotation
from fieldcalib.io.files import BrokenFileError, FrameFile
from fieldcalib.io.formats import (
    ANNOTATIONS,
    OTHER_ANNOTATIONS,
    AnnotatedFrame,
    frames_in,
    read_annotations,
    read_labels,
    tool_of,
)
from fieldcalib.io.soccernet import format_annotation, parse_annotation

OF_MANY = ("cvat", "labelstudio", "coco")
TOOLS = pytest.mark.parametrize("tool", OTHER_ANNOTATIONS)


@pytest.fixture(scope="module")
def real_frames(shared_data):
    """A hundred frames that people have annotated."""
    files = ANNOTATIONS.find([shared_data / "sncalib-test-center"])[:100]
    return [Annotation(file.id, parse_annotation(file.read(), SIZE), SIZE, f"{file.id}.jpg") for file in files]


def written(tool, annotations):
    """The files that a tool needs for annotations, as text."""
    write = OTHER_ANNOTATIONS[tool].write
    return [write(annotations)] if tool in OF_MANY else [write([one]) for one in annotations]


def read(tool, *contents):
    return [annotation for content in contents for annotation in OTHER_ANNOTATIONS[tool].read(content)]


def assert_same(annotations, expected, atol=1e-9):
    assert [one.id for one in annotations] == [one.id for one in expected]
    for one, other in zip(annotations, expected, strict=True):
        assert one.problem == ""
        assert one.image_size == other.image_size
        assert list(one.pixels) == list(other.pixels)
        for label, xy in other.pixels.items():
            np.testing.assert_allclose(one.pixels[label], xy, rtol=0.0, atol=atol)


# --- there and back ---


@TOOLS
def test_real_frames_come_back(tool, real_frames):
    assert len(real_frames) == 100
    assert_same(read(tool, *written(tool, real_frames)), real_frames)


COORDINATES = st.integers(-10_000_000, 10_000_000).map(lambda number: number / 1000)  # px
LABELS = texts(min_size=1).map(str.strip).filter(bool)
SEGMENTS = st.lists(st.tuples(COORDINATES, COORDINATES), min_size=1, max_size=5, unique=True).map(np.array)


@TOOLS
@given(pixels=st.dictionaries(LABELS, SEGMENTS, min_size=1, max_size=4), size=st.tuples(*[st.integers(1, 9999)] * 2))
def test_any_labels_and_pixels_come_back(tool, pixels, size):
    annotation = Annotation("7", pixels, size, "7.png")
    found = read(tool, *written(tool, [annotation]))
    assert_same(found, [annotation], atol=1e-6)


@TOOLS
def test_text_and_bytes_are_the_same(tool):
    (content,) = written(tool, [Annotation("é", {"Middle line": np.ones((2, 2)) * [[1], [9]]}, SIZE, "é.jpg")])
    assert_same(read(tool, content.encode()), read(tool, content))
    assert [one.id for one in read(tool, content)] == ["é"]


@TOOLS
def test_what_cannot_be_written(tool):
    with pytest.raises(ValueError, match="a pixel is not finite"):
        written(tool, [Annotation("7", {"Middle line": np.array([[np.nan, 0.0]])}, SIZE)])
    with pytest.raises(ValueError, match="7: the file needs the size of the image"):
        written(tool, [Annotation("7", {"Middle line": np.array([[1.0, 0.0]])})])


# --- what the other tools write ---

CVAT = """<?xml version="1.0" encoding="utf-8"?>
<annotations><version>1.1</version><meta><task><name>a</name></task></meta>
 <image id="0" name="match/00001.jpg" width="1920" height="1080">
  <polyline label="Middle line" source="manual" occluded="0" points="100.50,200.50;110.50,300.50" z_order="0"/>
  <polyline label="Middle line" source="manual" occluded="0" points="120.50,400.50;130.50,500.50" z_order="0"/>
  <polygon label=" Circle central " source="manual" occluded="0" points="1.5,2.5;3.5,4.5;5.5,6.5" z_order="0"></polygon>
  <points label="CENTER_MARK" source="manual" occluded="0" points="960.5,540.5"></points>
  <skeleton label="pitch"><points label="L_PENALTY_MARK" outside="0" points="7.5,8.5"/>
   <points label="R_PENALTY_MARK" outside="1" points="0.5,0.5"/></skeleton>
  <box label="player" xtl="1" ytl="2" xbr="3" ybr="4"/>
 </image>
 <image id="1" name="match/00002.jpg" width="1280" height="720"/>
</annotations>"""

LABELME = {
    "version": "5.4.1",
    "flags": {},
    "shapes": [
        {"label": "Middle line", "points": [[100.5, 200.5], [110.5, 300.5]], "shape_type": "line", "group_id": None},
        {"label": "Middle line", "points": [[120.5, 400.5], [130.5, 500.5]], "shape_type": "linestrip"},
        {"label": "Circle central", "points": [[1.5, 2.5], [3.5, 4.5], [5.5, 6.5]], "shape_type": "polygon"},
        {"label": "CENTER_MARK", "points": [[960.5, 540.5]], "shape_type": "point"},
        {"label": "L_PENALTY_MARK", "points": [[7.5, 8.5]], "shape_type": "point"},
        {"label": "player", "points": [[1, 2], [3, 4]], "shape_type": "rectangle"},
    ],
    "imagePath": "..\\frames\\00001.jpg",
    "imageData": None,
    "imageHeight": 1080,
    "imageWidth": 1920,
}


def region(kind, **value):
    size = {"original_width": 1920, "original_height": 1080, "image_rotation": 0}
    return {"id": "a", "type": kind, "from_name": "l", "to_name": "img", "value": value, **size}


def percents(*points):
    return [[(x + 0.5) * 100 / 1920, (y + 0.5) * 100 / 1080] for x, y in points]


def vertices(*points):
    return [{"x": x, "y": y, "id": "a", "isBezier": False} for x, y in percents(*points)]


REGIONS = [
    region("polygonlabels", points=percents((100, 200), (110, 300)), closed=True, polygonlabels=["Middle line"]),
    region("vectorlabels", vertices=vertices((120, 400), (130, 500)), closed=False, vectorlabels=["Middle line"]),
    region("polygon", points=percents((1, 2), (3, 4), (5, 6))),
    region("labels", points=percents((1, 2), (3, 4), (5, 6)), labels=["Circle central"]),
    region("keypointlabels", x=96050 / 1920, y=54050 / 1080, width=0.3, keypointlabels=["CENTER_MARK"]),
    region("keypointlabels", x=750 / 1920, y=850 / 1080, width=0.3, keypointlabels=["L_PENALTY_MARK"]),
    region("rectanglelabels", x=1, y=2, width=3, height=4, rectanglelabels=["player"]),
    {"type": "relation", "from_id": "a", "to_id": "b"},
]
LABEL_STUDIO = [
    {
        "id": 1,
        "data": {"image": "/data/upload/3/0a1b2c3d-00001.jpg"},
        "annotations": [
            {"was_cancelled": False, "result": []},
            {"was_cancelled": False, "result": REGIONS},
            {"was_cancelled": True, "result": []},
        ],
        "predictions": [{"result": []}],
    },
    {"id": 2, "data": {"image": "/data/local-files/?d=match%2F00002.jpg"}, "annotations": []},
]

COCO = {
    "info": {},
    "images": [
        {"id": 5, "file_name": "match/00001.jpg", "width": 1920, "height": 1080},
        {"id": 9, "file_name": "match/00002.jpg", "width": 1280, "height": 720},
    ],
    "annotations": [
        {"id": 1, "image_id": 5, "category_id": 1, "segmentation": [[100.5, 200.5, 110.5, 300.5], [120.5, 400.5] * 2]},
        {"id": 2, "image_id": 5, "category_id": 1, "segmentation": [[130.5, 500.5]]},
        {"id": 3, "image_id": 5, "category_id": 2, "segmentation": [[1.5, 2.5, 3.5, 4.5, 5.5, 6.5]], "iscrowd": 0},
        {"id": 4, "image_id": 5, "category_id": 3, "keypoints": [960, 540, 2, 7, 8, 1, 0, 0, 0], "num_keypoints": 2},
        {"id": 5, "image_id": 5, "category_id": 4, "bbox": [1, 2, 3, 4]},
    ],
    "categories": [
        {"id": 1, "name": "Middle line"},
        {"id": 2, "name": "Circle central"},
        {"id": 3, "name": "pitch", "keypoints": ["CENTER_MARK", "L_PENALTY_MARK", "R_PENALTY_MARK"]},
        {"id": 4, "name": "player"},
    ],
}
AS_WRITTEN = {"cvat": CVAT, "labelme": LABELME, "labelstudio": LABEL_STUDIO, "coco": COCO}
EXPECTED = {
    "Middle line": [[100, 200], [110, 300], [120, 400], [130, 500]],
    "Circle central": [[1, 2], [3, 4], [5, 6]],
    "CENTER_MARK": [[960, 540]],
    "L_PENALTY_MARK": [[7, 8]],
}


def text_of(tool, change=lambda record: None):
    """What a tool writes, changed."""
    if tool == "cvat":
        return CVAT
    record = json.loads(json.dumps(AS_WRITTEN[tool]))
    change(record)
    return json.dumps(record)


@TOOLS
def test_what_a_tool_writes_is_read(tool):
    first, *others = read(tool, text_of(tool))
    assert (first.id, first.image_size, first.problem) == ("00001", (1920, 1080), "")
    assert list(first.pixels) == list(EXPECTED)
    for label, xy in EXPECTED.items():
        np.testing.assert_allclose(first.pixels[label], xy, atol=1e-9)
    assert [one.id for one in others] == (["00002"] if tool in OF_MANY else [])
    assert all(one.pixels == {} and one.problem == "" for one in others)


@pytest.mark.parametrize(
    ("image", "id"),
    [
        ("https://somewhere.org/match/00001.jpg?token=a/b.c", "00001"),
        ("s3://bucket/match/frame%201.jpg", "frame 1"),
        ("/data/upload/3/0a1b2c3d-00001.jpg", "00001"),
        ("/data/local-files/?d=match%2Fa%231%26b.jpg", "a#1&b"),
        ("match/a#1.jpg", "a#1"),
        ("C:\\match\\00001.jpg", "00001"),
        ("http://[", "["),
        ("data:image/png;base64,AAAA", "task-1"),
    ],
)
def test_names_of_images_in_label_studio(image, id):
    content = text_of("labelstudio", lambda tasks: tasks[0]["data"].update(image=image))
    assert read("labelstudio", content)[0].id == id
    (again,) = read("labelstudio", *written("labelstudio", [Annotation(id, {}, SIZE, f"match/{id}.jpg")]))
    assert again.id == id


def test_shapes_that_are_no_lines_are_named():
    found = {tool: read(tool, text_of(tool))[0].left_out for tool in ("cvat", "labelme", "coco")}
    found = {tool: tuple(map(str, shapes)) for tool, shapes in found.items()}
    assert found == dict.fromkeys(("cvat", "coco"), ("box of 'player'",)) | {"labelme": ("rectangle of 'player'",)}


@TOOLS
def test_whose_file_it_is_is_found_out(tool, tmp_path):
    path = tmp_path / f"a{OTHER_ANNOTATIONS[tool].suffixes[0]}"
    assert tool_of(text_of(tool), path) == tool
    assert tool_of(format_annotation({"Middle line": [[1.0, 2.0]]}, SIZE), tmp_path / "a.json") == ""


def test_the_annotation_that_is_taken_of_several():
    def shown(**more):
        def change(tasks):
            tasks[0]["annotations"][0] |= {"result": REGIONS[4:5], **more}

        return list(read("labelstudio", text_of("labelstudio", change))[0].pixels)

    assert shown() == list(EXPECTED)  # the last
    assert shown(ground_truth=True) == ["CENTER_MARK"]


# --- broken files ---


@TOOLS
def test_truncated_files(tool):
    content = text_of(tool)
    for length in range(0, len(content.rstrip()) - 1, 37):
        with pytest.raises(BrokenFileError, match=r"is no (JSON|XML): "):
            read(tool, content[:length])


@TOOLS
@given(data=st.data())
def test_values_of_wrong_types_are_no_accident(tool, data):
    """Whatever stands in the place of a value: an annotation, or what is wrong."""
    if tool == "cvat":
        parts = CVAT.split('"')
        parts[data.draw(st.integers(7, len(parts) - 2))] = data.draw(st.sampled_from(["", "a", "1", "nan", "1,2", ";"]))
        content = '"'.join(parts)
    else:
        wrong = data.draw(st.sampled_from([None, True, -1, 1e999, "", "a", [], [[]], {}, [None], [{}], {"a": 1}]))
        record = json.loads(text_of(tool))
        place = record
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            key = data.draw(st.sampled_from(keys))
            if isinstance(place[key], dict | list) and place[key] and data.draw(st.booleans()):
                place = place[key]
                continue
            place[key] = wrong
            break
        content = json.dumps(record)
    try:
        annotations = read(tool, content)
    except BrokenFileError:
        return
    for one in annotations:
        assert not (one.problem and one.pixels)
        assert all(xy.ndim == 2 and xy.shape[1] == 2 and np.all(np.isfinite(xy)) for xy in one.pixels.values())


@pytest.mark.parametrize(
    ("tool", "content", "message"),
    [
        ("cvat", "<html/>", "expected the <annotations> of CVAT, got <html>"),
        ("cvat", "<annotations/>", "holds no <image>: export it from CVAT as 'CVAT for images 1.1'"),
        ("cvat", '<annotations><track id="0"/></annotations>', "holds the tracks of a video: export it"),
        ("cvat", "<annotations><image width='9' height='9'/></annotations>", "image 1: expected the name of the image"),
        ("labelme", "[]", "expected a JSON object of labelme's shapes, got list"),
        ("labelme", '{"shapes": []}', "imagePath: expected the name of the image, got nothing"),
        ("labelstudio", "[]", "holds no tasks"),
        ("labelstudio", '[{"image": "a.jpg"}]', "task 1: expected an object with 'data': export as JSON, not as JSON-"),
        ("coco", "{}", "the file: expected a list 'images', got nothing"),
        ("coco", '{"images": [], "annotations": [], "categories": []}', "holds no images"),
        ("coco", '{"images": [{}], "annotations": [], "categories": []}', "images: expected objects with an id of"),
        ("coco", text_of("coco", lambda c: c["annotations"][0].pop("image_id")), "annotations: expected the image_id"),
    ],
)
def test_what_is_wrong_with_a_file(tool, content, message):
    with pytest.raises(BrokenFileError) as caught:
        read(tool, content)
    assert message in str(caught.value)


def _remove_size(tool, record):
    if tool == "labelstudio":
        del record[0]["annotations"][1]["result"][0]["original_width"]
    else:
        del (record["images"][0] if tool == "coco" else record)["width" if tool == "coco" else "imageWidth"]


@TOOLS
def test_a_missing_size_is_said_of_its_image(tool):
    content = text_of(tool, lambda record: _remove_size(tool, record)).replace('width="1920"', "")
    first, *others = read(tool, content)
    assert first.problem.startswith("expected the size of the image as width and height in pixels, got nothing and ")
    assert not any(one.problem for one in others)


@pytest.mark.parametrize(
    ("tool", "change", "message"),
    [
        ("labelme", lambda r: r["shapes"][0].update(points=[[1, "x"]]), "'Middle line': expected points (x, y), got"),
        ("labelme", lambda r: r["shapes"][0].update(points=[[1, 1e999]]), "'Middle line': a coordinate is not finite"),
        ("labelme", lambda r: r["shapes"][0].update(label=7), "expected the label of a shape, got 7"),
        ("labelme", lambda r: r.update(shapes={}), "the file: expected a list 'shapes', got {}"),
        ("coco", lambda r: r["annotations"][0].update(segmentation=[[1.0]]), "expected a list of 2 numbers for each"),
        ("coco", lambda r: r["annotations"][0].update(category_id=77), "expected the category_id of one of the categ"),
        ("coco", lambda r: r["categories"][2].update(keypoints=["a"]), "'pitch': its category does not name its 3 key"),
        ("labelstudio", lambda r: REGIONS and r[0]["annotations"][1]["result"][0].update(image_rotation=90), "rotated"),
        ("labelstudio", lambda r: r[0]["annotations"][1]["result"][0].update(original_width=7), "are of images of"),
        ("labelstudio", lambda r: r[0]["annotations"][1].update(result=None), "the task: expected a list 'result'"),
    ],
)
def test_what_is_wrong_with_an_image(tool, change, message):
    first = read(tool, text_of(tool, change))[0]
    assert message in first.problem
    assert first.pixels == {}


@pytest.mark.parametrize(
    "prolog",
    [
        '<!DOCTYPE a [<!ENTITY x "aaaaaaaaaa"><!ENTITY y "&x;&x;&x;&x;&x;&x;&x;"><!ENTITY z "&y;&y;&y;&y;&y;&y;">]>',
        '<!DOCTYPE a [<!ENTITY z SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE a SYSTEM "http://127.0.0.1:9/a.dtd">',
    ],
    ids=["expansion", "a file", "a document type elsewhere"],
)
def test_entities_are_not_read(prolog):
    content = f'{prolog}<annotations><image name="&z;.jpg" width="9" height="9"/></annotations>'
    with pytest.raises(BrokenFileError, match="has a document type or entities, which are not read"):
        read("cvat", content)


# --- files, sizes and labels ---


def put(folder, tool, annotations):
    """The files of annotations in a new folder."""
    folder.mkdir(parents=True, exist_ok=True)
    ending = OTHER_ANNOTATIONS[tool].suffixes[0]
    contents = written(tool, annotations)
    for content, one in zip(contents, annotations, strict=False):
        (folder / (f"{one.id}{ending}" if len(contents) > 1 else f"annotations{ending}")).write_text(content)
    return folder


@TOOLS
def test_folders_and_zips(tool, real_frames, tmp_path):
    folder = put(tmp_path / "in", tool, real_frames[:5])
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for path in folder.iterdir():
            archive.write(path, f"annotations/{path.name}")
    for path in (folder, tmp_path / "a.zip"):
        found = fieldcalib.io.read_annotations(path)
        assert_same(list(found.values()), real_frames[:5])


def test_frames_go_to_other_processes():
    frame = AnnotatedFrame("7", Path(__file__), None, Annotation("7", {"Middle line": np.ones((1, 2))}, SIZE))
    again = pickle.loads(pickle.dumps(frame))
    assert (again.id, again.annotation.image_size) == ("7", SIZE)
    np.testing.assert_array_equal(again.annotation.pixels["Middle line"], np.ones((1, 2)))


def test_a_frame_twice(tmp_path):
    one = Annotation("7", {}, SIZE, "7.jpg")
    put(tmp_path, "cvat", [replace(one, image="a/7.jpg"), replace(one, image="b/7.png")])
    with pytest.raises(BrokenFileError, match=r"annotations\.xml have the same frame 7: rename one of them"):
        read_annotations(tmp_path)


def test_the_size_of_soccernets_files_must_be_given(tmp_path):
    (tmp_path / "7.json").write_text(format_annotation({"Middle line": np.ones((2, 2))}, SIZE))
    with pytest.raises(BrokenFileError, match=r"7\.json: SoccerNet's annotations do not say the size"):
        read_annotations(tmp_path)
    assert read_annotations(tmp_path, SIZE)["7"].image_size == SIZE


def test_beginnings_of_soccernets_files(shared_data, tmp_path):
    """They are known by a few bytes, so that they are read when they are calibrated, not before."""
    files = ANNOTATIONS.find([shared_data / "sncalib-test-center"])
    assert all(type(frame) is FrameFile for frame in frames_in(files, most_bytes=0).frames)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", '["a"]', "expected their labels, each with one of ours or null"),
        ("a.yaml", "a: [1]", "expected their labels, each with one of ours or null"),
        ("a.yaml", "a: [", "is no YAML: "),
        ("a.json", "{", "is no JSON: "),
    ],
)
def test_mappings_that_are_none(name, text, message, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(BrokenFileError, match=message):
        read_labels(tmp_path / name)


def test_a_mapping_in_yaml_and_json(tmp_path):
    (tmp_path / "a.yaml").write_text("halfway: Middle line\nball:\n")
    (tmp_path / "a.json").write_text('{"halfway": "Middle line", "ball": null}')
    assert (
        read_labels(tmp_path / "a.yaml") == read_labels(tmp_path / "a.json") == {"halfway": "Middle line", "ball": None}
    )
