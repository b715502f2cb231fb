"""The commands on annotations of CVAT, labelme, Label Studio and COCO."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from commands import SIZE, cameras_in, lines_of, run
from killed import content_of
from networks import FIELD
from views import camera

from baselines import dlt_lines, hdecomp
from fieldcalib.draw.scene import render_field
from fieldcalib.fields.segments import Arc, Line
from fieldcalib.io.annotations import Annotation
from fieldcalib.io.formats import ANNOTATIONS, OTHER_ANNOTATIONS, read_annotations
from fieldcalib.io.soccernet import parse_annotation
from fieldcalib.run_folder import work_units

TOOLS = pytest.mark.parametrize("tool", OTHER_ANNOTATIONS)
TRUTHS = [camera(pan, 78, 1400, (0, 68, -17)) for pan in (24, -22)]


@pytest.fixture(scope="module")
def annotations(annotated_folder):
    """The four frames of `annotated_folder`."""
    files = ANNOTATIONS.find([annotated_folder])
    return [Annotation(file.id, parse_annotation(file.read(), SIZE), SIZE, f"in/{file.id}.jpg") for file in files]


def put(folder, tool, annotations):
    """The file of a tool with annotations, or the folder of its files."""
    if tool == "cvat":
        import defusedxml  # noqa: F401  without it the commands end with a message
    folder.mkdir(exist_ok=True)
    write, ending = OTHER_ANNOTATIONS[tool].write, OTHER_ANNOTATIONS[tool].suffixes[0]
    if tool == "labelme":
        for one in annotations:
            (folder / f"{one.id}.json").write_text(write([one]))
        return folder
    (folder / f"all{ending}").write_text(write(annotations))
    return folder / f"all{ending}"


def calibrate(*inputs, out, options=()):
    return run("calibrate", *inputs, "--camera-files", "--out", out, *options)


@TOOLS
def test_the_cameras_are_those_of_soccernets_files(tool, annotations, calibrated_folder, tmp_path):
    assert calibrate(put(tmp_path / "in", tool, annotations), out=tmp_path / "out") == 0
    expected, found = cameras_in(calibrated_folder), cameras_in(tmp_path / "out")
    assert found.keys() == expected.keys()
    for id, content in found.items():
        camera, other = json.loads(content), json.loads(expected[id])
        for key in camera:
            np.testing.assert_allclose(camera[key], other[key], rtol=1e-6, atol=1e-6)
    assert [line["id"] for line in lines_of(tmp_path / "out")] == [one.id for one in annotations]


@pytest.mark.slow
def test_real_frames(shared_data, tmp_path):
    """The same pixels, and so the same cameras."""
    paths = [file.path for file in ANNOTATIONS.find([shared_data / "sncalib-test-center"])[:40]]
    frames = [Annotation(path.stem, parse_annotation(path.read_bytes(), SIZE), SIZE) for path in paths]
    assert calibrate(*paths, out=tmp_path / "expected", options=["--size", "960x540"]) == 0
    assert calibrate(put(tmp_path / "in", "cvat", frames), out=tmp_path / "out") == 0
    lines = [{line["id"]: line for line in lines_of(tmp_path / name)} for name in ("expected", "out")]
    assert len(lines[1]) == 40
    rms = [[line.get("rms_px", 0.0) for line in of_run.values()] for of_run in lines]
    np.testing.assert_allclose(rms[1], rms[0], rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("tool", ["labelme", "coco"])
def test_jobs_shards_and_resuming_give_the_same(tool, annotations, tmp_path, monkeypatch):
    monkeypatch.setattr(work_units, "SMALLEST_UNIT", 2)
    monkeypatch.setattr(work_units, "LARGEST_UNIT", 2)
    path = put(tmp_path / "in", tool, annotations)
    assert calibrate(path, out=tmp_path / "whole") == 0
    for number in (1, 2):
        assert calibrate(path, out=tmp_path / str(number), options=["--shard", f"{number}/2"]) == 0
    assert run("join", tmp_path / "1", tmp_path / "2", "--out", tmp_path / "joined") == 0
    assert calibrate(path, out=tmp_path / "jobs", options=["--jobs", 2]) == 0
    (tmp_path / "jobs" / "summary.json").unlink()
    log = tmp_path / "jobs" / "cameras.jsonl"
    log.write_bytes(b"".join(log.read_bytes().splitlines(keepends=True)[:3]))
    assert calibrate(path, out=tmp_path / "jobs", options=["--resume"]) == 0
    assert content_of(tmp_path / "jobs") == content_of(tmp_path / "whole") == content_of(tmp_path / "joined")


def test_a_changed_file_is_not_resumed(annotations, tmp_path, capsys):
    path = put(tmp_path / "in", "coco", annotations)
    assert calibrate(path, out=tmp_path / "out") == 0
    put(tmp_path / "in", "coco", [*annotations[:3], Annotation("d", {}, SIZE, "in/d.jpg")])
    assert calibrate(path, out=tmp_path / "out", options=["--resume"]) == 2
    assert "the files of the input have other sizes or times" in capsys.readouterr().err


def test_images_of_several_sizes(annotations, calibrated_folder, tmp_path, capsys):
    """Each camera is that of its own image; half of the pixels make half of the focal length."""
    halves = [
        Annotation(f"{one.id} half", {k: (xy + 0.5) / 2 - 0.5 for k, xy in one.pixels.items()}, (480, 270))
        for one in annotations
    ]
    path = put(tmp_path / "in", "cvat", [*annotations, *halves])
    assert calibrate(path, out=tmp_path / "out") == 0
    lines = {line["id"]: line for line in lines_of(tmp_path / "out")}
    for one in annotations:
        whole, half = lines[one.id], lines[f"{one.id} half"]
        assert (whole["image_size"], half["image_size"]) == ([960, 540], [480, 270])
        assert half["K"][0][0] == pytest.approx(whole["K"][0][0] / 2, rel=0.02)
    shared = ["--field-size", "estimated", "--same-field"]
    assert calibrate(path, out=tmp_path / "shared", options=shared) == 2
    assert "images of several sizes are not calibrated together: there are 480x270, 960x540" in capsys.readouterr().err


@TOOLS
def test_a_size_that_the_file_contradicts(tool, annotations, tmp_path, capsys):
    path = put(tmp_path / "in", tool, annotations)
    assert calibrate(path, out=tmp_path / "same", options=["--size", "960x540"]) == 0
    assert calibrate(path, out=tmp_path / "out", options=["--size", "1920x1080"]) == 2
    said = capsys.readouterr().err
    assert said.count("is of an image of 960 x 540, not of 1920 x 1080: leave the size out, or mend it") == 1
    assert said.endswith("; nor can 3 others be read; nothing is written\n")
    assert not (tmp_path / "out").exists()
    assert calibrate(path, out=tmp_path / "strict", options=["--size", "1920x1080", "--strict"]) == 1
    assert not (tmp_path / "strict").exists()


def test_soccernets_files_need_a_size(annotated_folder, tmp_path, capsys):
    assert calibrate(annotated_folder, out=tmp_path / "out") == 2
    assert "a.json: SoccerNet's annotations do not say the size of their images: give it (image_size=, --size)" in (
        capsys.readouterr().err
    )
    assert not (tmp_path / "out").exists()


def test_labels_are_mapped_and_others_named_once(annotations, calibrated_folder, tmp_path, capsys):
    import yaml  # noqa: F401  as of defusedxml

    theirs = {"Middle line": "halfway", "Side line top": "touchline far", "Big rect. left main": "box"}
    renamed = [
        Annotation(one.id, {theirs.get(k, k): xy for k, xy in one.pixels.items()} | {"ball": np.ones((1, 2))}, SIZE)
        for one in annotations
    ]
    path = put(tmp_path / "in", "labelstudio", renamed)
    (tmp_path / "map.yaml").write_text("halfway: Middle line\ntouchline far: Side line top\nbox: Big rect. left main\n")
    assert calibrate(path, out=tmp_path / "out", options=["--labels", tmp_path / "map.yaml"]) == 0
    said = capsys.readouterr().err
    assert said.count("fieldcalib: 'ball' in 4 frames is left out: unknown; known labels: Side line top") == 1
    for line, other in zip(lines_of(tmp_path / "out"), lines_of(calibrated_folder), strict=True):
        assert line["pixel_counts"] == other["pixel_counts"]
    (tmp_path / "wrong.json").write_text('{"halfway": "Midle line"}')
    assert calibrate(path, out=tmp_path / "wrong", options=["--labels", tmp_path / "wrong.json"]) == 2
    assert "--labels maps to 'Midle line', which is no label; did you mean 'Middle line'?" in capsys.readouterr().err
    assert calibrate(path, out=tmp_path / "wrong", options=["--labels", tmp_path / "none.json"]) == 2
    assert "none.json: cannot be read" in capsys.readouterr().err


def test_a_label_that_is_mapped_to_nothing_is_not_spoken_of(annotations, tmp_path, capsys):
    path = put(tmp_path / "in", "cvat", annotations)
    box = '<box label="{}" source="manual" occluded="0" xtl="1" ytl="2" xbr="3" ybr="4" z_order="0" />\n  </image>'
    path.write_text(path.read_text().replace("</image>", box.format("player")).replace("</image>", box.format("ball")))
    (tmp_path / "map.yaml").write_text("player:\n")
    assert calibrate(path, out=tmp_path / "out", options=["--labels", tmp_path / "map.yaml"]) == 0
    said = capsys.readouterr().err
    assert "left out box of 'ball' in 4 frames\n" in said
    assert "player" not in said


def test_soccernets_labels_are_mapped_too(annotated_folder, tmp_path):
    (tmp_path / "in").mkdir()
    text = (annotated_folder / "a.json").read_text().replace("Side line top", "far touchline")
    (tmp_path / "in" / "a.json").write_text(text)
    (tmp_path / "map.json").write_text('{"far touchline": "Side line top"}')
    options = ["--size", "960x540", "--labels", tmp_path / "map.json"]
    assert calibrate(tmp_path / "in", out=tmp_path / "out", options=options) == 0
    assert "Side line top" in lines_of(tmp_path / "out")[0]["pixel_counts"]


def test_a_broken_image_does_not_spoil_its_file(annotations, tmp_path, capsys):
    path = put(tmp_path / "in", "cvat", annotations)
    path.write_text(path.read_text().replace('width="960"', 'width="wide"', 1))
    (tmp_path / "in" / "other.xml").write_text("<annotations>")
    assert calibrate(tmp_path / "in", out=tmp_path / "out") == 1
    said = capsys.readouterr().err
    assert f"fieldcalib: {path}: a: expected the size of the image as width and height in pixels, got 'wide'" in said
    assert f"fieldcalib: {tmp_path / 'in' / 'other.xml'}: is no XML: " in said
    statuses = {line["id"]: line["status"] for line in lines_of(tmp_path / "out")}
    assert statuses == dict.fromkeys("bcd", "accepted") | dict.fromkeys(("a", "other"), "broken file")


@TOOLS
def test_evaluate_reads_them(tool, annotations, annotated_folder, calibrated_folder, tmp_path, capsys):
    assert run("evaluate", calibrated_folder, annotated_folder, "--json") == 0
    expected = json.loads(capsys.readouterr().out)
    more = [replace(one, pixels=one.pixels | {"ball": np.ones((1, 2))}) for one in annotations]
    assert run("evaluate", calibrated_folder, put(tmp_path / "in", tool, more), "--json") == 0
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert found["AC"] == expected["AC"]
    assert found["frames"] == 4
    assert printed.err.count("'ball' in 4 frames is left out: unknown") == 1


def test_baselines_read_them(annotations, annotated_folder, tmp_path, capsys):
    assert dlt_lines.main([str(annotated_folder), "--size", "960x540", "--out", str(tmp_path / "expected")]) == 0
    path = put(tmp_path / "in", "coco", annotations)
    assert dlt_lines.main([str(path), "--out", str(tmp_path / "out")]) == 0
    expected, found = lines_of(tmp_path / "expected"), lines_of(tmp_path / "out")
    assert any("K" in line for line in found)
    for line, other in zip(found, expected, strict=True):
        assert line["status"] == other["status"]
        np.testing.assert_allclose(line.get("K", 0.0), other.get("K", 0.0), rtol=1e-6)
    (tmp_path / "1.homographyMatrix").write_text("1 0 0\n0 1 0\n0 0 1\n")
    assert hdecomp.main([str(tmp_path), "--homographies", "--out", str(tmp_path / "h")]) == 2
    assert "--homographies needs --size" in capsys.readouterr().err


# --- localize ---


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    folder = tmp_path_factory.mktemp("images")
    for name, truth in zip("ab", TRUTHS, strict=True):
        cv2.imwrite(str(folder / f"{name}.png"), render_field(truth, FIELD))
    return folder


@TOOLS
def test_what_localize_writes_is_calibrated(tool, images, know, tmp_path):
    know(TRUTHS)
    assert run("localize", images, "--out", tmp_path / "plain") == 0
    know(TRUTHS)
    out = tmp_path / "out"
    assert run("localize", images, "--out", out, "--format", tool) == 0
    expected = read_annotations(tmp_path / "plain", SIZE)
    found = read_annotations(out)
    assert list(found) == list(expected) == ["a", "b"]
    for id, one in found.items():
        assert one.image_size == SIZE
        assert one.pixels.keys() == expected[id].pixels.keys()
        for label, xy in one.pixels.items():
            other = expected[id].pixels[label]
            np.testing.assert_allclose(*(np.array(sorted(map(tuple, v.round(6)))) for v in (xy, other)), atol=1e-5)
    assert calibrate(out, out=tmp_path / "cameras") == 0
    assert set(cameras_in(tmp_path / "cameras")) == {"a", "b"}


@pytest.mark.parametrize("format", ["soccernet", "coco", pytest.param("labelme", marks=pytest.mark.slow)])
def test_localize_writes_the_names_that_calibrate_reads(format, images, know, tmp_path):
    names = tmp_path / "names.yaml"
    names.write_text("halfway: Middle line\nhalf: Middle line\nfar touchline: Side line top\nball:\n")
    out = {key: tmp_path / key for key in ("plain", "named")}
    for key, options in (("plain", ()), ("named", ("--labels", names))):
        know(TRUTHS)
        assert run("localize", images, "--out", out[key], "--format", format, *options) == 0
    expected, as_written = (read_annotations(out[key], SIZE) for key in out)
    found = read_annotations(out["named"], SIZE, labels=names)
    theirs = {"Middle line": "halfway", "Side line top": "far touchline"}
    assert any(theirs.keys() & one.pixels.keys() for one in expected.values())
    for id, one in expected.items():
        assert list(as_written[id].pixels) == [theirs.get(label, label) for label in one.pixels]
        for label, xy in one.pixels.items():
            np.testing.assert_array_equal(found[id].pixels[label], xy)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("halfway: Midle line", "--labels maps to 'Midle line', which is no label; did you mean 'Middle line'?"),
        (
            "Middle line: Side line top",
            "call 'Side line top' 'Middle line', so 'Middle line' needs another name: map one to it too",
        ),
    ],
)
def test_names_that_could_not_be_read_back_are_refused(names, message, images, tmp_path, capsys):
    path = tmp_path / "names.yaml"
    path.write_text(names)
    assert run("localize", images, "--out", tmp_path / "out", "--labels", path) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_labelme_finds_the_images(images, know, tmp_path):
    know(TRUTHS)
    assert run("localize", images, "--out", tmp_path / "out", "--format", "labelme") == 0
    record = json.loads((tmp_path / "out" / "a.json").read_text())
    assert (tmp_path / "out" / record["imagePath"]).resolve() == (images / "a.png").resolve()


def test_nothing_seen_and_broken_images(know, tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((54, 96, 3), np.uint8))
    (tmp_path / "b.png").write_bytes(b"no image")
    for tool in OTHER_ANNOTATIONS:
        know([None])
        assert run("localize", tmp_path, "--out", tmp_path / tool, "--format", tool) == 1
        assert "b.png: is no image that OpenCV can read" in capsys.readouterr().err
        assert [one.pixels for one in read_annotations(tmp_path / tool, (96, 54)).values()] == [{}]


def test_the_file_of_all_frames_is_the_runs_own(images, know, tmp_path):
    know(TRUTHS)
    assert run("localize", images, "--out", tmp_path, "--format", "cvat") == 0
    whole = (tmp_path / "localized.xml").read_bytes()
    (tmp_path / "localized.xml").unlink()
    (tmp_path / "summary.json").unlink()
    know(TRUTHS)
    assert run("localize", images, "--out", tmp_path, "--format", "cvat", "--resume") == 0
    assert (tmp_path / "localized.xml").read_bytes() == whole
    know(TRUTHS)
    assert run("localize", images, "--out", tmp_path, "--format", "coco", "--overwrite") == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "localized.json",
        "localized.jsonl",
        "run.json",
        "summary.json",
    ]


def test_shards_of_localize_leave_their_file_to_join(images, know, tmp_path):
    know(TRUTHS)
    assert run("localize", images, "--out", tmp_path / "whole", "--format", "coco") == 0
    for number in (1, 2):
        know(TRUTHS)
        options = ["--format", "coco", "--shard", f"{number}/2"]
        assert run("localize", images, "--out", tmp_path / str(number), *options) == 0
        assert not (tmp_path / str(number) / "localized.json").exists()
    assert run("join", tmp_path / "1", tmp_path / "2", "--out", tmp_path / "joined") == 0
    assert content_of(tmp_path / "joined") == content_of(tmp_path / "whole")


def test_points_along_lines_and_arcs():
    rng = np.random.default_rng(0)
    line = np.linspace((3.0, 9.0), (80.0, 2.0), 7)
    angle = np.linspace(2.0, 6.5, 12)  # leaves a gap across the angle 0
    arc = np.column_stack([50.0 + 40.0 * np.cos(angle), 20.0 + 5.0 * np.sin(angle)])
    for xy, segment in ((line, Line((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))), (arc, Arc((0.0, 0.0, 0.0), 1.0))):
        mixed = rng.permutation(xy)
        ordered = mixed[segment.order(mixed)]
        assert np.array_equal(ordered, xy) or np.array_equal(ordered, xy[::-1])
