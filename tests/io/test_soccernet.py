"""SoccerNet's annotations and cameras, and what is said of files that are neither."""

import json
import re
import zipfile

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import IMAGE_SIZES, cameras, pixel_arrays, unchecked_cameras
from synthetic import in_image, visible_field_points

from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import DISTRIBUTIONS
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.formats import ANNOTATIONS, CAMERAS
from fieldcalib.io.soccernet import (
    DISTRIBUTIONS_OF_TYPE,
    BrokenFileError,
    camera_from_record,
    camera_to_record,
    camera_types,
    format_annotation,
    parse_annotation,
    parse_camera,
)

FIELD = soccer()
SIZE = (960, 540)


# --- annotations ---


@given(
    # pixels may lie somewhat outside the image
    normalised=st.dictionaries(st.sampled_from(sorted(FIELD.markings)), pixel_arrays((-0.3, -0.3), (1.3, 1.3))),
    image_size=st.sampled_from(IMAGE_SIZES),
)
def test_annotations_come_back(normalised, image_size):
    pixels = {label: xy * image_size for label, xy in normalised.items()}
    found = parse_annotation(format_annotation(pixels, image_size), image_size)
    assert list(found) == list(pixels)
    for label, xy in pixels.items():
        assert found[label].shape == xy.shape
        np.testing.assert_allclose(found[label], xy, rtol=0, atol=1e-9)


def test_the_last_pixel_is_at_1():
    corners = np.array([(0.0, 0.0), (959.0, 539.0)])
    written = json.loads(format_annotation({"Side line top": corners}, SIZE))
    assert written == {"Side line top": [{"x": 0.0, "y": 0.0}, {"x": 1.0, "y": 1.0}]}
    np.testing.assert_array_equal(parse_annotation(json.dumps(written), SIZE)["Side line top"], corners)


@pytest.mark.parametrize("label", ["Goal left post left", "Goal left post left ", " Goal left post left"])
def test_one_label_has_a_blank_at_its_end(label):
    content = json.dumps({label: [{"x": 0.5, "y": 0.5}]})
    pixels = parse_annotation(content, SIZE)
    assert list(pixels) == ["Goal left post left"]
    assert list(json.loads(format_annotation(pixels, SIZE))) == ["Goal left post left "]


def test_no_other_label_has():
    pixels = {label: np.zeros((1, 2)) for label in FIELD.markings}
    written = list(json.loads(format_annotation(pixels, SIZE)))
    assert [label for label in written if label != label.strip()] == ["Goal left post left "]


@pytest.mark.parametrize("label", ["Line unknown", "Goal unknown", "Line unknown "])
def test_unknown_lines_are_left_out(label):
    content = {label: [{"x": 0.5, "y": 0.5}], "Middle line": [{"x": 0.1, "y": 0.2, "confidence": 0.9}]}
    assert list(parse_annotation(json.dumps(content), SIZE)) == ["Middle line"]


def test_unknown_lines_are_kept_for_evaluation():
    labels = ["Goal unknown", "Line unknown", "Middle line"]
    content = json.dumps({label: [{"x": 0.5, "y": 1.0}] for label in labels} | {"Side line top": []})
    pixels = parse_annotation(content, SIZE, unknown=True)
    assert list(pixels) == labels
    np.testing.assert_array_equal(pixels["Line unknown"], [(479.5, 539.0)])
    assert list(parse_annotation(format_annotation(pixels, SIZE), SIZE, unknown=True)) == labels


@pytest.mark.parametrize("points", [[], None])
def test_labels_without_points_are_left_out(points):
    assert parse_annotation(json.dumps({"Middle line": points}), SIZE) == {}
    assert parse_annotation("{}", SIZE) == {}


@pytest.mark.parametrize("content", [b'\xef\xbb\xbf{"Middle line": []}', '{"Middle line": []}'.encode("utf-16")])
def test_other_encodings_of_json(content):
    assert parse_annotation(content, SIZE) == {}


def points(x, y):
    return f'{{"Middle line": [{{"x": 0.5, "y": 0.5}}, {{"x": {x}, "y": {y}}}]}}'


A_LIST = """'Middle line': expected a list of points {"x": ..., "y": ...}"""


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is no JSON: "),
        ("{", "is no JSON: "),
        ("lines: []", "is no JSON: "),
        ('{"Middle line": [{"x": 0.5, "y": 0.5}]', "is no JSON: "),
        (b'{"Gr\xc3', "is no JSON: 'utf-8' codec"),
        (b"\x89PNG\r\n\x1a\n", "is no JSON: 'utf-8' codec"),
        ("[" * 100_000, "is no JSON: "),
        ("1" * 10_000, "is no JSON: Exceeds the limit"),
        ("[]", "expected a JSON object of labels, got list"),
        ('"Middle line"', "expected a JSON object of labels, got str"),
        ("null", "expected a JSON object of labels, got NoneType"),
        ('{"Middle line": 3}', A_LIST),
        ('{"Middle line": "0.5, 0.5"}', A_LIST),
        ('{"Middle line": {"x": 0.5, "y": 0.5}}', A_LIST),
        ('{"Middle line": [0.5, 0.5]}', A_LIST),
        ('{"Middle line": [[0.5, 0.5]]}', A_LIST),
        ('{"Middle line": [{"x": 0.5}]}', A_LIST),
        ('{"Middle line": [{"x": 0.5, "y": 0.5}, {}]}', A_LIST),
        ('{"Middle line": [{"x": 0.5, "y": 0.5}, null]}', A_LIST),
        (points('"left"', 0.5), A_LIST),
        (points("null", 0.5), A_LIST),
        (points("[0.5]", "[0.5]"), A_LIST),
        ('{"Middle line": [{"x": [0.5], "y": [0.5]}]}', A_LIST),
        (points("1" + 400 * "0", 0.5), A_LIST),
        (points("NaN", 0.5), "'Middle line': a coordinate is not finite"),
        (points(0.5, "-Infinity"), "'Middle line': a coordinate is not finite"),
        (points(0.5, "1e999"), "'Middle line': a coordinate is not finite"),
        (points(480.0, 270.0), "'Middle line': coordinates up to 480 are not normalised to 0..1"),
        (points(0.5, -12), "'Middle line': coordinates up to 12 are not normalised to 0..1"),
        (
            '{"Goal left post left": [{"x": 0.5, "y": 0.5}], "Goal left post left ": [{"x": 0.1, "y": 0.5}]}',
            "'Goal left post left' is given twice",
        ),
    ],
)
def test_broken_annotations(content, message):
    for encoded in (content, content.encode() if isinstance(content, str) else content):
        with pytest.raises(BrokenFileError, match=re.escape(message)):
            parse_annotation(encoded, SIZE)


# --- where annotations are found ---

CONTENT = json.dumps({"Middle line": [{"x": 0.5, "y": 0.0}, {"x": 0.5, "y": 1.0}]})
OTHERS = (
    "match_info.json",
    "match_info_cam_gt.json",
    "test_match_info_cam_gt.json",
    "per_match_info.json",
    "camera_00001.json",
    "summary.json",
    "per_sample_output.json",
)


def fill(folder, *names):
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).write_text(CONTENT)
    return folder


def make_zip(path, *names):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names:
            archive.writestr(name, CONTENT)
    return path


def ids(*inputs):
    return [file.id for file in ANNOTATIONS.find(inputs)]


def test_a_folder_in_the_order_of_names(tmp_path):
    folder = fill(tmp_path, "00010.json", "00002.json", "b.json", "00001.json")
    assert ids(folder) == ["00001", "00002", "00010", "b"]
    assert all(file.read() == CONTENT.encode() for file in ANNOTATIONS.find([folder]))


def test_what_else_lies_in_a_folder_is_no_frame(tmp_path):
    files = ("00001.json", "00001.jpg", "00001.homographyMatrix", "cameras.jsonl", "._00001.json", ".hidden.json")
    folder = fill(tmp_path, *files, *OTHERS)
    fill(tmp_path / "deeper", "00002.json")
    assert ids(folder) == ["00001"]


@pytest.mark.parametrize("name", ["test.zip", "TEST.ZIP"])
def test_a_zip_with_a_folder_in_it(tmp_path, name):
    members = [f"test/{other}" for other in ("00002.json", "00001.json", "00001.jpg", ".00003.json", *OTHERS)]
    path = make_zip(tmp_path / name, "test/", *members, "__MACOSX/test/._00001.json", "__MACOSX/test/00001.json")
    files = ANNOTATIONS.find([path])
    assert [file.id for file in files] == ["00001", "00002"]
    assert str(files[0].path) == f"{path}/test/00001.json"
    assert files[0].read() == CONTENT.encode()


def test_folders_in_a_zip_may_be_called_as_they_like(tmp_path):
    assert ids(make_zip(tmp_path / "a.zip", "summary/camera_left/00001.json")) == ["00001"]


def test_inputs_in_their_order(tmp_path):
    folder = fill(tmp_path / "folder", "2.json")
    single = fill(tmp_path, "3.json", "frame.txt")
    archive = make_zip(tmp_path / "a.zip", "1.json")
    assert ids(single / "3.json", folder, archive, single / "frame.txt") == ["3", "2", "1", "frame"]


def test_an_input_that_does_not_exist(tmp_path):
    with pytest.raises(
        FileNotFoundError, match=r"missing does not exist: expected a folder, a zip or a \.json or \.xml file"
    ):
        ANNOTATIONS.find([fill(tmp_path, "1.json"), tmp_path / "missing"])


def test_inputs_without_annotation(tmp_path):
    for path in (fill(tmp_path / "folder", *OTHERS), make_zip(tmp_path / "a.zip", "readme.txt", *OTHERS)):
        with pytest.raises(FileNotFoundError, match=f"{path.name} holds no annotation: expected files named <id>"):
            ANNOTATIONS.find([path])


def test_two_files_of_one_frame(tmp_path):
    folder, archive = fill(tmp_path / "folder", "1.json"), make_zip(tmp_path / "a.zip", "test/1.json")
    with pytest.raises(BrokenFileError, match=r"a\.zip/test/1\.json and .*1\.json are the same frame 1: rename one"):
        ANNOTATIONS.find([folder, archive])
    with pytest.raises(BrokenFileError, match="are the same frame 1"):
        ANNOTATIONS.find([folder, folder / "1.json"])


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"no zip at all"])
def test_a_zip_that_is_none(tmp_path, content):
    (tmp_path / "a.zip").write_bytes(content)
    with pytest.raises(BrokenFileError, match=r"a\.zip: .*zip"):
        ANNOTATIONS.find([tmp_path / "a.zip"])


def test_a_zip_whose_content_is_damaged(tmp_path):
    path = make_zip(tmp_path / "a.zip", "1.json", "2.json")
    content = bytearray(path.read_bytes())
    name = content.index(b"1.json")
    content[name + 6 : name + 20] = bytes(14)  # the deflated data behind the name
    path.write_bytes(content)
    damaged, whole = ANNOTATIONS.find([path])
    with pytest.raises(BrokenFileError, match="cannot be read: "):
        damaged.read()
    assert whole.read() == CONTENT.encode()


def test_an_encrypted_zip(tmp_path):
    path = make_zip(tmp_path / "a.zip", "1.json")
    content = bytearray(path.read_bytes())
    content[6] |= 1  # the flags of the local and of the central header
    content[content.index(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(content)
    (file,) = ANNOTATIONS.find([path])
    with pytest.raises(BrokenFileError, match=r"cannot be read: .*encrypted"):
        file.read()


def test_a_file_that_vanished_and_a_folder_that_looks_like_a_file(tmp_path):
    fill(tmp_path, "1.json")
    fill(tmp_path / "2.json")
    files = ANNOTATIONS.find([tmp_path])
    (tmp_path / "1.json").unlink()
    for file in files:
        with pytest.raises(BrokenFileError, match="cannot be read: "):
            file.read()


def test_cameras_of_folders_and_zips(tmp_path):
    names = ("camera_00002.json", "camera_00001.json", "camera_left.json", "00001.json", ".camera_3.json", "a.json")
    folder, archive = fill(tmp_path / "folder", *names), make_zip(tmp_path / "a.zip", *(f"out/{n}" for n in names))
    for path in (folder, archive):
        assert [file.id for file in CAMERAS.find([path])] == ["00001", "00002", "left"]
        assert CAMERAS.find([path])[0].read() == CONTENT.encode()
    assert [file.id for file in CAMERAS.find([folder / "camera_00002.json"])] == ["00002"]


def test_paths_without_cameras(tmp_path):
    folder = fill(tmp_path / "folder", "00001.json")
    with pytest.raises(FileNotFoundError, match=r"folder holds no camera: expected files named camera_<id>\.json"):
        CAMERAS.find([folder])
    with pytest.raises(FileNotFoundError, match=r"missing does not exist: expected a folder, a zip or a \.json file"):
        CAMERAS.find([tmp_path / "missing"])


# --- cameras ---


def soccernets_rotation(pan, tilt, roll):
    """Z X Z rotations of the camera in the world, transposed; angles in degrees."""
    pan, tilt, roll = np.radians([pan, tilt, roll])
    about_z = [np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]) for a in (pan, roll)]
    about_x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    return (about_z[0] @ about_x @ about_z[1]).T


def soccernets_projection(record, X):
    """SoccerNet's project_point: one world point, all of its lens coefficients."""
    rotation = soccernets_rotation(record["pan_degrees"], record["tilt_degrees"], record["roll_degrees"])
    x, y, z = rotation @ (X - np.array(record["position_meters"]))
    assert z > 1e-3
    x, y = x / z, y / z
    r = np.hypot(x, y)
    k, p, s = (record[f"{name}_distortion"] for name in ("radial", "tangential", "thin_prism"))
    factor = (1 + k[0] * r**2 + k[1] * r**4 + k[2] * r**6) / (1 + k[3] * r**2 + k[4] * r**4 + k[5] * r**6)
    x, y = (
        x * factor + 2 * p[0] * x * y + p[1] * (r**2 + 2 * x**2) + s[0] * r**2 + s[1] * r**4,
        y * factor + 2 * p[1] * x * y + p[0] * (r**2 + 2 * y**2) + s[2] * r**2 + s[3] * r**4,
    )
    cx, cy = record["principal_point"]
    return np.array([x * record["x_focal_length"] + cx, y * record["y_focal_length"] + cy])


@given(camera=cameras())
def test_records_project_as_soccernet_does(camera):
    X = np.concatenate([visible_field_points(camera, count=5, z=z) for z in (0.0, -2.44)])
    assume(len(X))
    record = json.loads(json.dumps(camera_to_record(camera)))
    expected = np.array([soccernets_projection(record, point) for point in X])
    assert in_image(expected, camera.image_size).all()
    np.testing.assert_allclose(camera.project(X), expected, atol=1e-6)


@given(camera=cameras())
def test_records_come_back(camera):
    found = camera_from_record(json.loads(json.dumps(camera_to_record(camera))), camera.image_size)
    assert found.image_size == camera.image_size
    np.testing.assert_array_equal(found.K, camera.K)
    np.testing.assert_array_equal(found.k, camera.k)
    np.testing.assert_array_equal(found.C, camera.C)
    np.testing.assert_allclose(found.R, camera.R, atol=1e-12)


@given(camera=cameras(lens=False))
def test_the_size_of_the_image_is_twice_the_principal_point(camera):
    assert camera_from_record(camera_to_record(camera)).image_size == camera.image_size


def record(**changes):
    camera = Camera.from_angles(0.2, 1.3, 0.01, 1500.0, (2.0, 60.0, -15.0), SIZE, k=(0.1, -0.02))
    return {**camera_to_record(camera), **changes}


def test_keys_and_lengths():
    found = record()
    assert sorted(found) == [
        "pan_degrees",
        "position_meters",
        "principal_point",
        "radial_distortion",
        "roll_degrees",
        "tangential_distortion",
        "thin_prism_distortion",
        "tilt_degrees",
        "x_focal_length",
        "y_focal_length",
    ]
    assert [len(found[f"{name}_distortion"]) for name in ("radial", "tangential", "thin_prism")] == [6, 2, 4]


@pytest.mark.parametrize(
    ("name", "index"),
    [*(("radial", i) for i in range(2, 6)), *(("tangential", i) for i in range(2)), ("thin_prism", 3)],
)
def test_other_lens_coefficients_come_back(name, index):
    other = record()
    other[f"{name}_distortion"][index] = 1e-6
    camera = camera_from_record(other)
    assert np.sum(camera.dist == 1e-6) == 1
    assert camera_to_record(camera)[f"{name}_distortion"] == other[f"{name}_distortion"]


@pytest.mark.parametrize("key", record())
def test_missing_keys_are_named(key):
    other = record()
    del other[key]
    with pytest.raises(BrokenFileError, match=f"a camera needs the key '{key}'"):
        camera_from_record(other)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("pan_degrees", "left"),
        ("pan_degrees", None),
        ("tilt_degrees", [80.0]),
        ("roll_degrees", float("nan")),
        ("position_meters", [1.0, 2.0]),
        ("position_meters", [1.0, 2.0, float("inf")]),
        ("position_meters", {"x": 1.0}),
        ("x_focal_length", -1500.0),
        ("y_focal_length", 0.0),
        ("x_focal_length", 10**400),
        ("principal_point", [480.0]),
        ("principal_point", 480.0),
        ("principal_point", [float("nan"), 270.0]),
        ("principal_point", [0.0, 0.0]),
        ("radial_distortion", []),
        ("radial_distortion", [0.1]),
        ("radial_distortion", None),
        ("radial_distortion", [float("nan"), 0.0]),
        ("tangential_distortion", ["a", 0.0]),
    ],
)
def test_values_that_are_no_cameras(key, value):
    with pytest.raises(BrokenFileError, match=r"is no camera: ."):
        camera_from_record(record(**{key: value}))


# --- cameras of others ---


@given(camera=unchecked_cameras())
def test_any_lens_comes_back(camera):
    found = parse_camera(json.dumps(camera_to_record(camera)), camera.image_size)
    assert found.image_size == camera.image_size
    np.testing.assert_array_equal(found.K, camera.K)
    np.testing.assert_array_equal(found.dist, camera.dist)
    np.testing.assert_array_equal(found.C, camera.C)
    np.testing.assert_allclose(found.R, camera.R, atol=1e-12)


def test_coefficients_stand_where_soccernet_has_them():
    # 6 radial, 2 tangential, 4 thin prism -> OpenCV's k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4
    other = record(
        radial_distortion=[1, 2, 3, 4, 5, 6], tangential_distortion=[7, 8], thin_prism_distortion=[9, 10, 11, 12]
    )
    assert camera_from_record(other, checked=False).dist.tolist()[0] == [1, 2, 7, 8, 3, 4, 5, 6, 9, 10, 11, 12]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("x_focal_length", -1e-9),
        ("y_focal_length", 0.0),
        ("tilt_degrees", 1e9),
        ("position_meters", [1e12, 0.0, 5.0]),
        ("radial_distortion", [-1e6, 1e9, 0.0, 1.0, 2.0, 3.0]),
    ],
)
def test_absurd_cameras_are_read_for_evaluation(key, value):
    camera = camera_from_record(record(**{key: value}), checked=False)
    assert not np.isinf(camera.project([(0.0, 0.0, 0.0), (30.0, 20.0, -2.44)])).any()


@pytest.mark.parametrize("principal_point", [[-5.0, 270.0], [1e-9, 270.0]])
def test_an_absurd_principal_point_needs_the_size(principal_point):
    other = record(principal_point=principal_point)
    assert camera_from_record(other, SIZE, checked=False).image_size == SIZE
    with pytest.raises(BrokenFileError, match="is no camera: image_size must be"):
        camera_from_record(other, checked=False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pan_degrees": float("inf")}, "is no camera: R must be a finite array"),
        ({"x_focal_length": "wide"}, "is no camera: could not convert string to float"),
        ({"radial_distortion": [0.1, 0.2]}, "is no camera: radial_distortion must have 6 coefficients, got 2"),
        ({"thin_prism_distortion": [0.0] * 5}, "is no camera: thin_prism_distortion must have 4 coefficients, got 5"),
        ({"tangential_distortion": [0.0, float("nan")]}, "is no camera: k must be a finite array"),
    ],
)
def test_records_without_numbers(changes, message):
    with pytest.raises(BrokenFileError, match=message):
        camera_from_record(record(**changes), checked=False)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is no JSON: "),
        ("[1, 2]", "expected a JSON object of camera parameters, got list"),
        ("{}", "a camera needs the key 'pan_degrees'"),
    ],
)
def test_broken_camera_files(content, message):
    with pytest.raises(BrokenFileError, match=message):
        parse_camera(content)


# --- camera types ---


def test_types_are_read():
    types = {"00001": "Main camera center", "00007": "Spider camera", "a.b": "Main behind the goal"}
    content = json.dumps({f"{id}.jpg": {"camera": name} for id, name in types.items()})
    assert camera_types(content) == types
    assert camera_types('{"00001.jpg": {"camera": "Public", "match": "a - b", "league": "c", "half": 1}}') == {
        "00001": "Public"
    }


def test_types_have_distributions():
    assert DISTRIBUTIONS_OF_TYPE["Main camera center"] == ("main center",)
    assert DISTRIBUTIONS_OF_TYPE["Main camera left"] == ("main left",)
    assert DISTRIBUTIONS_OF_TYPE["Main camera right"] == ("main right",)
    assert set(DISTRIBUTIONS_OF_TYPE["Main behind the goal"]) == {"behind left goal", "behind right goal"}
    assert all(name in DISTRIBUTIONS for names in DISTRIBUTIONS_OF_TYPE.values() for name in names)
    assert DISTRIBUTIONS_OF_TYPE.get("Spider camera") is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[]", "expected a JSON object of images, got list"),
        ("", "is no JSON: "),
        ('{"00001.jpg": "Main camera center"}', '\'00001.jpg\': expected an object with "camera": "<type>"'),
        ('{"00001.jpg": {"league": "a"}}', "'00001.jpg': expected an object with \"camera\""),
        ('{"00001.jpg": {"camera": null}}', "'00001.jpg': expected an object with \"camera\""),
    ],
)
def test_broken_camera_types(content, message):
    with pytest.raises(BrokenFileError, match=message):
        camera_types(content)
