"""`fieldcalib.calibrate` of all kinds of input, its results, and what they are in a folder."""

import json
import subprocess
import sys

import cv2
import numpy as np
import PIL.Image
import pytest
from commands import run
from hypothesis import given
from hypothesis import strategies as st
from networks import FIELD, Blind, KnownCameras, KnownPictures, looked_at
from strategies import examples, numbers, texts

import fieldcalib
from fieldcalib import Camera, calibrate, read, soccer
from fieldcalib.draw.scene import render_field
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.image_files import NO_IMAGE
from fieldcalib.io.soccernet import format_annotation, parse_annotation
from fieldcalib.io.videos import VideoWriter
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.results.frames import ById

SIZE = (480, 270)
TRUTHS = [Camera.from_angles(pan, 1.32, 0.0, 475.0, (1.0, 66.0, -16.0), SIZE) for pan in np.linspace(0.1, 0.4, 4)]
LABELS = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
LINES = ("cameras.jsonl", "solver.jsonl")


@pytest.fixture(scope="module")
def rendered():
    return [render_field(camera, FIELD, rng=np.random.default_rng(0)) for camera in TRUTHS]


@pytest.fixture
def knows(monkeypatch):
    """Let `calibrate` use a network that knows the cameras of the images to come, if none is given."""

    def install(cameras):
        network = KnownCameras(cameras)
        monkeypatch.setattr(SegmentationNetwork, "load", lambda: network)
        return network

    return install


def labelled(camera=TRUTHS[3], shift=0.0):
    seen = {label: camera.project(soccer()[label].sample(6.0)) + shift for label in LABELS}
    inside = {label: xy[np.all((xy >= 0.0) & (xy < SIZE), axis=1)] for label, xy in seen.items()}
    return {label: xy for label, xy in inside.items() if len(xy)}


def picture_folder(path, images):
    path.mkdir()
    for name, image in zip("dabc", images, strict=False):
        cv2.imwrite(str(path / f"{name}.png"), image)
    return path


def video_file(path, images):
    with VideoWriter(path, 25.0) as video:
        for image in images:
            video.write(image)
    return path


def assert_kept(results, folder):
    """What is saved is read back, equal, and equal again when that is saved."""
    results.save(folder)
    again = read(folder)
    assert again == results
    assert [dict(line) for line in again.lines] == [dict(line) for line in results.lines]
    assert again.verdicts == results.verdicts
    assert dict(again.cameras) == dict(results.cameras)
    again.save(folder.parent / "again")
    for path in folder.iterdir():
        assert (folder.parent / "again" / path.name).read_bytes() == path.read_bytes()
    assert read(folder.parent / "again") == results


# --- kinds of input ---


def test_pictures_of_a_folder_with_a_broken_one(rendered, knows, tmp_path):
    folder = picture_folder(tmp_path / "in", rendered)
    (folder / "b2.png").write_bytes(b"no picture")
    knows([TRUTHS[1], TRUTHS[2], TRUTHS[3], TRUTHS[0]])
    results = calibrate(folder, progress=False)
    assert list(results) == ["a", "b", "c", "d"]
    assert dict(results.broken) == {"b2": NO_IMAGE}
    for id, truth in zip("abcd", (*TRUTHS[1:], TRUTHS[0]), strict=True):
        np.testing.assert_allclose(results.cameras[id].angles, truth.angles, atol=6e-3)
    assert results.video is None
    assert_kept(results, tmp_path / "out")


def test_what_is_saved_is_what_run_writes(rendered, knows, know, tmp_path):
    folder = picture_folder(tmp_path / "in", rendered)
    knows([TRUTHS[1], TRUTHS[2], TRUTHS[3], TRUTHS[0]])
    calibrate(folder, progress=False).save(tmp_path / "python")
    know([TRUTHS[1], TRUTHS[2], TRUTHS[3], TRUTHS[0]])
    assert run("run", folder, "--out", tmp_path / "command") == 0
    written = {path.name: path.read_bytes() for path in (tmp_path / "command").iterdir()}
    ours = {path.name: path.read_bytes() for path in (tmp_path / "python").iterdir()}
    assert ours.keys() == written.keys()
    differ = {name for name in written if ours[name] != written[name]}
    assert differ <= {"run.json", "summary.json"}  # which have the options


def test_a_file_that_is_no_picture(tmp_path):
    (tmp_path / "text.jpg").write_text("no picture")
    for source in (tmp_path / "text.jpg", tmp_path, str(tmp_path / "*.jpg")):
        with pytest.raises(BrokenFileError, match=r"text.jpg: is no image that OpenCV can read: expected a JPEG, PNG"):
            calibrate(source, network=Blind(), progress=False)
    (tmp_path / "other.png").write_text("no picture")
    with pytest.raises(BrokenFileError, match=r"other.png: is no image .* nor can the other 1 be read"):
        calibrate(tmp_path, network=Blind(), progress=False)
    with pytest.raises(BrokenFileError, match=r"text.jpg: is no image that OpenCV can read: expected a JPEG, PNG"):
        fieldcalib.Editor(tmp_path / "text.jpg")
    assert run("open", tmp_path / "text.jpg", "--no-browser") == 2


@pytest.mark.slow
def test_a_clip(rendered, knows, know, tmp_path):
    video = video_file(tmp_path / "a.mp4", rendered)
    with fieldcalib.io.videos.VideoReader(video) as reader:
        decoded = list(reader)
    knows([TRUTHS[t] for t in looked_at(decoded)])
    results = calibrate(video, progress=False)
    assert list(results) == [f"{number:06d}" for number in range(4)]
    assert set(results.basis.values()) <= {"lines", "lines and matches", "matches"}
    assert [tuple(shot) for shot in results.video.shots] == [(0, 4, 0)]
    assert_kept(results, tmp_path / "out")
    again = read(tmp_path / "out")
    assert again.video.shots == results.video.shots
    assert again.video.tripods[0].shared == results.video.tripods[0].shared
    assert again.frames_per_second == 25.0
    know([TRUTHS[t] for t in looked_at(decoded)])
    assert run("run", video, "--out", tmp_path / "command") == 0
    assert read(tmp_path / "command") == results
    for name in (*LINES, "clip.jsonl", "tripods.json", "motion.png"):
        assert (tmp_path / "command" / name).read_bytes() == (tmp_path / "out" / name).read_bytes()
    np.testing.assert_array_equal(again.image("000002"), decoded[2])


@pytest.mark.slow
def test_pictures_as_a_clip_with_a_broken_one(rendered, knows, tmp_path):
    folder = picture_folder(tmp_path / "in", rendered)
    for old, new in zip("dabc", (8, 9, 10, 12), strict=True):
        (folder / f"{old}.png").rename(folder / f"f{new}.png")
    (folder / "f11.png").write_bytes(b"no picture")
    knows([TRUTHS[t] for t in looked_at(rendered)])
    results = calibrate(folder, clip=True, progress=False)
    assert list(results) == ["f8", "f9", "f10", "f12"]
    assert list(results.broken) == ["f11"]
    assert len(results.video) == 4
    assert_kept(results, tmp_path / "out")
    np.testing.assert_array_equal(read(tmp_path / "out").image("f12"), rendered[3])


def test_a_video_frame_by_frame(rendered, knows, tmp_path):
    video = video_file(tmp_path / "a.mp4", rendered)
    knows(TRUTHS[1:3])
    results = calibrate(video, clip=False, start="1f", end="3f", progress=False)
    assert list(results) == ["000001", "000002"]
    assert results.video is None
    assert_kept(results, tmp_path / "out")
    assert (tmp_path / "out" / "overlay.mp4").exists()


@pytest.mark.slow
def test_arrays(rendered, knows, tmp_path):
    for source, ids in (
        (rendered[0], ["000000"]),
        (rendered[:2], ["000000", "000001"]),
        (np.array(rendered[:2]), ["000000", "000001"]),
        (iter(rendered[:2]), ["000000", "000001"]),
        (PIL.Image.fromarray(rendered[0][..., ::-1]), ["000000"]),
    ):
        knows(TRUTHS)
        results = calibrate(source, progress=False)
        assert list(results) == ids
        np.testing.assert_allclose(results.cameras["000000"].angles, TRUTHS[0].angles, atol=6e-3)
        assert_kept(results, tmp_path / str(id(source)) / "out")
    knows([TRUTHS[1], TRUTHS[3]])
    assert list(calibrate(iter(rendered), start="1f", step=2, progress=False)) == ["000001", "000003"]
    knows([TRUTHS[t] for t in looked_at(rendered)])
    assert len(calibrate(rendered, clip=True, progress=False).video) == 4


@pytest.mark.parametrize("clip", [None, True])
def test_pictures_that_are_parts_of_frames(clip):
    """The principal point of the camera is the middle of the frame, in pixels of the pictures."""
    frame = Camera.from_angles(0.45, 1.33, 0.0, 1400.0, (5.0, 66.0, -17.0), (996, 720))
    truth = frame.cropped((288, 80), (560, 420))
    shown = render_field(truth, FIELD, rng=np.random.default_rng(0))
    network = KnownPictures([shown], [truth])
    told = {"clip": clip, "network": network, "progress": False}
    results = calibrate([shown, shown], soccer(size_known=True), crop_of="996x720+288+80", **told)
    assert results.options["crop_of"] == "996x720+288+80"
    for one in results.values():
        assert one.accepted
        assert one.camera.image_size == truth.image_size
        np.testing.assert_allclose(one.camera.principal_point, truth.principal_point, atol=8.0)
    with pytest.raises(BrokenFileError, match="does not fit, with 560 x 420 pixels, into the frame of 996x720"):
        calibrate([shown, shown], crop_of="996x720+500+80", **told)


@pytest.mark.parametrize("given", [list, iter, np.array, lambda images: images[0]])
def test_arrays_in_red_green_blue(rendered, given):
    """What the network gets is the picture in blue, green, red."""
    seen = []

    class Seeing(Blind):
        def __call__(self, images):
            seen.extend(map(np.array, images))
            return super().__call__(images)

    coloured = [rendered[0].copy()]
    coloured[0][..., 0] //= 2
    reversed_ = given([image[..., ::-1] for image in coloured])
    calibrate(reversed_, rgb=True, network=Seeing(), prior=None, progress=False)  # without a search of the field
    np.testing.assert_array_equal(seen[0], coloured[0])


def test_an_open_video_of_opencv(rendered, knows, tmp_path):
    video = cv2.VideoCapture(str(video_file(tmp_path / "a.mp4", rendered)))
    knows(TRUTHS[1:])
    assert list(calibrate(video, start="1f", progress=False)) == ["000001", "000002", "000003"]
    with pytest.raises(ValueError, match=r"the cv2\.VideoCapture is not open"):
        calibrate(cv2.VideoCapture(str(tmp_path / "none.mp4")), progress=False)


def test_a_pattern_of_paths_and_a_list_of_them(rendered, knows, tmp_path):
    folder = picture_folder(tmp_path / "in", rendered)
    knows([TRUTHS[1], TRUTHS[2]])
    assert list(calibrate(str(folder / "[ab].png"), progress=False)) == ["a", "b"]
    knows([TRUTHS[2], TRUTHS[1]])
    assert list(calibrate([folder / "b.png", folder / "a.png"], progress=False)) == ["b", "a"]
    knows([TRUTHS[1]])
    assert list(calibrate(folder / "a.png", progress=False)) == ["a"]


def test_a_name_that_looks_like_a_pattern_is_a_name(rendered, knows, tmp_path):
    path = tmp_path / "a[1].png"
    cv2.imwrite(str(path), rendered[0])
    knows(TRUTHS)
    assert list(calibrate(path, progress=False)) == ["a[1]"]


def test_labelled_pixels(annotated_folder, calibrated_folder, tmp_path):
    one = calibrate(labelled(), image_size=SIZE, progress=False)
    assert list(one) == ["000000"]
    np.testing.assert_allclose(one.cameras["000000"].C, TRUTHS[3].C, atol=3.0)
    by_id = calibrate({"x": labelled(), "y": {}}, image_size=SIZE, progress=False)
    assert by_id["x"] == one["000000"]
    assert by_id.cameras.get("y") is None
    assert list(calibrate([labelled(), labelled(TRUTHS[2])], image_size=SIZE, progress=False)) == ["000000", "000001"]
    assert_kept(by_id, tmp_path / "out")
    size = (960, 540)
    frames = {path.stem: parse_annotation(path.read_bytes(), size) for path in sorted(annotated_folder.glob("?.json"))}
    of_files = calibrate(frames, image_size=size, progress=False)
    assert of_files == read(calibrated_folder)
    of_files.save(tmp_path / "files")
    for name in LINES:
        assert (tmp_path / "files" / name).read_bytes() == (calibrated_folder / name).read_bytes()


def test_annotations_say_the_size_of_their_pictures(tmp_path):
    shapes = [
        {"label": label, "shape_type": "linestrip", "points": (xy + 0.5).tolist()}
        for label, xy in labelled().items()
        if len(xy) > 1
    ]
    record = {"imagePath": "7.jpg", "imageWidth": 480, "imageHeight": 270, "shapes": shapes}
    (tmp_path / "7.json").write_text(json.dumps(record))
    results = calibrate(fieldcalib.io.read_annotations(tmp_path / "7.json"), progress=False)
    assert results["7"].camera.image_size == SIZE
    assert calibrate(tmp_path, progress=False) == calibrate(tmp_path / "7.json", progress=False) == results
    with pytest.raises(ValueError, match="are of pictures"):
        calibrate(tmp_path, end="3f", progress=False)
    (tmp_path / "8.json").write_text("{}")  # of SoccerNet, which does not say the size
    with pytest.raises(ValueError, match=r"8\.json: .*give it \(image_size="):
        calibrate(tmp_path, progress=False)


def test_annotations_with_a_broken_file(annotated_folder, tmp_path):
    """As the command does, it goes on with the others."""
    good, bad = sorted(annotated_folder.glob("?.json"))[:2]
    (tmp_path / "a.json").write_text(bad.read_text().replace('"Side line top"', '"Side line tpo"'))
    with pytest.raises(BrokenFileError, match="a: unknown label 'Side line tpo'"):
        calibrate(tmp_path, image_size=(960, 540), progress=False)
    (tmp_path / "b.json").write_bytes(good.read_bytes())
    results = calibrate(tmp_path, image_size=(960, 540), progress=False)
    assert list(results) == ["b"]
    assert results.broken == {"a": "unknown label 'Side line tpo'; did you mean 'Side line top'?"}


def test_a_stream_is_read_up_to_its_end(rendered, knows, tmp_path, monkeypatch):
    video = video_file(tmp_path / "a.mkv", rendered)
    knows([TRUTHS[0], *TRUTHS])
    results = calibrate(f"file://{video}", end="3f", progress=False)
    assert list(results) == ["000000", "000001", "000002"]
    assert results.video is None
    assert_kept(results, tmp_path / "out")


@pytest.mark.parametrize(
    ("source", "options", "message"),
    [
        ("rtsp://host/live", {}, "give end= .* or use Tracker"),
        ("-", {}, "standard input is a stream.* use Tracker"),
        (labelled(), {}, "give image_size="),
        ({"a": {"Midle line": [(1, 2)]}}, {"image_size": SIZE}, "frame a: .*did you mean 'Middle line'"),
        (labelled(), {"image_size": SIZE, "start": 3}, "are of pictures"),
        (labelled(), {"image_size": SIZE, "crop_of": "960x540+0+0"}, "crop_of is of pictures"),
        (np.zeros((270, 480, 3), np.uint8), {"crop_of": "960x540"}, "expected WIDTHxHEIGHT.X.Y"),
        (np.zeros((270, 480, 3), np.uint8), {"image_size": SIZE}, "image_size is of labelled pixels"),
        (np.zeros((270, 480, 3)), {}, "image must be uint8"),
        ([], {}, "got nothing"),
        (iter([]), {}, "got nothing"),
        (7, {}, "expected a path, pictures .* got 7"),
        (iter([]), {"clip": True}, "an iterator only once"),
        (np.zeros((270, 480, 3), np.uint8), {"start": 1.5}, "images have no times"),
        (np.zeros((270, 480, 3), np.uint8), {"step": 0}, "step must be"),
        (np.zeros((270, 480, 3), np.uint8), {"field": "tenis"}, "tennis"),
        (np.zeros((270, 480, 3), np.uint8), {"field": 3}, "expected a Field"),
        (labelled(), {"field": dict(soccer()), "image_size": SIZE}, r"Field\(length, width, mapping\), .* got a dict$"),
        ({"Middle line": [{"x": 0.5, "y": 0.1}]}, {"image_size": SIZE}, "of files give the path, with image_size"),
        (labelled(), {"image_size": "480x270"}, "image_size must be .* got '480x270'$"),
        (np.zeros((270, 480, 3), np.uint8), {"camera": "moving"}, "camera is of clips"),
    ],
)
def test_what_cannot_be_calibrated_is_said(source, options, message):
    with pytest.raises(ValueError, match=message):
        calibrate(source, progress=False, **options)


def test_a_list_of_annotations(tmp_path):
    paths = [tmp_path / f"{number}.json" for number in range(2)]
    for path in paths:
        path.write_text(format_annotation(labelled(), SIZE), encoding="utf-8")
    found = calibrate(paths, image_size=SIZE, progress=False)
    assert list(found) == ["0", "1"]
    assert str(found[0].camera) == str(calibrate(paths[0], image_size=SIZE, progress=False)[0].camera)


def test_paths_that_are_not_there(tmp_path):
    for source in (tmp_path / "no.mp4", str(tmp_path / "*.jpg"), tmp_path / "no"):
        with pytest.raises(FileNotFoundError):
            calibrate(source, progress=False)


def test_several_videos_are_calibrated_one_by_one(rendered, tmp_path):
    for name in ("a", "b"):
        video_file(tmp_path / f"{name}.mp4", rendered[:1])
    with pytest.raises(ValueError, match=r"there are 2 videos, as a\.mp4: calibrate them one by one"):
        calibrate(tmp_path, progress=False)


@pytest.mark.slow
def test_progress_is_told_to_a_function_of_the_caller(rendered, knows, tmp_path):
    seen = []
    knows(TRUTHS)
    calibrate(rendered, progress=lambda *what: seen.append(what))
    assert seen == [(0, 4, ""), (4, 4, "")]
    seen.clear()
    knows([TRUTHS[t] for t in looked_at(rendered)])
    calibrate(rendered, clip=True, progress=lambda *what: seen.append(what))
    stages = list(dict.fromkeys(stage for *_, stage in seen))
    assert stages[:3] == ["looking", "matching", "finding lines"]
    assert {total for _, total, _ in seen} == {4}

    def stop(done, total, stage):
        if done == 2:
            raise RuntimeError("enough")

    knows(TRUTHS)
    with pytest.raises(RuntimeError, match="enough"):
        calibrate(rendered, clip=True, progress=stop)


# --- results ---


@pytest.fixture(scope="module")
def some():
    return calibrate({"x": labelled(), "y": {}, "z": labelled(TRUTHS[2])}, image_size=SIZE, progress=False)


def test_results_in_words(some):
    assert repr(some) == "Results(3 calibrations: 2 good, 1 reject)"
    assert {id: str(verdict) for id, verdict in some.verdicts.items()} == {"x": "good", "y": "reject", "z": "good"}
    html = some._repr_html_()
    assert "2 good, 1 reject" in html
    assert 'src="data:image/jpeg;base64,' in html


def test_a_rejected_camera_has_no_numbers_in_the_table():
    right = labelled()
    pixels = dict(zip(right, [*list(right.values())[1:], right[next(iter(right))]], strict=True))  # of the next label
    results = calibrate(pixels, image_size=SIZE, progress=False)
    camera = results[0].camera
    assert not results[0].accepted
    assert camera is not None
    assert f"{camera.focal_length:.1f} px" not in results._repr_html_().replace(results[0].reason, "")


def test_overlays_on_pictures_that_are_given_and_on_none(some, rendered):
    with pytest.warns(UserWarning, match="the picture of frame x is, .* give it as image=; the field is drawn on a"):
        plain, on = some.overlay("x"), some.overlay("x", rendered[3])
    assert plain.shape == on.shape == (270, 480, 3)
    assert not np.array_equal(plain, on)
    assert some.plot().any()  # without a word
    with pytest.raises(ValueError, match="say which frame: there are 3, as 'x', 'y', 'z'"):
        some.overlay()
    with pytest.raises(KeyError, match="there is no frame 'w'"):
        some.overlay("w")


def test_homographies_and_what_the_lens_leaves():
    camera = Camera.from_angles(0.3, 1.36, 0.0, 650.0, (0.0, 66.0, -16.0), SIZE, k=(0.2, 0.0))
    found = calibrate(labelled(camera), image_size=SIZE, progress=False).homographies()["000000"]
    camera = calibrate(labelled(camera), image_size=SIZE, progress=False).cameras["000000"]
    xy = np.array([[350.0, 150.0], [100.0, 250.0], [240.0, 200.0]])
    X = camera.image_to_field(xy)[:, :2]
    raw = np.column_stack([xy, np.ones(3)]) @ found.from_raw.T
    off = np.linalg.norm(raw[:, :2] / raw[:, 2:] - X, axis=1)
    assert 0.0 < off.max() <= found.largest_m
    ideal = np.column_stack([camera.normalized(xy), np.ones(3)]) @ camera.K.T
    exact = ideal @ found.from_undistorted.T
    np.testing.assert_allclose(exact[:, :2] / exact[:, 2:], X, atol=1e-9)
    assert 0.0 < found.rms_px < found.largest_px < 10.0
    assert 0.0 < found.rms_m < found.largest_m


def test_a_table_of_some_twenty_columns(some):
    table = some.to_pandas()
    assert 18 <= len(table.columns) <= 24
    assert list(table.index) == ["x", "y", "z"]
    assert table.loc["x", "pan_degrees"] == pytest.approx(np.degrees(some.cameras["x"].angles[0]))
    assert table.loc["y", "reason"] == "no labelled pixels: nothing to calibrate from"
    assert np.isnan(table.loc["y", "x_m"])
    assert len(some.to_pandas(everything=True).columns) > len(table.columns)


def test_a_table_for_arrow_has_the_cells_of_that_for_pandas(some):
    table, expected = some.to_arrow(), some.to_pandas()
    assert table.column("id").to_pylist() == list(expected.index)
    assert table.column_names == ["id", *expected.columns]
    for name in expected.columns:
        cells = expected[name].astype(object).where(expected[name].notna(), None)
        assert table.column(name).to_pylist() == list(cells), name
    nothing = table.slice(0, 0)
    assert nothing.schema == table.schema


def test_results_that_are_there_are_not_replaced_without_a_word(some, tmp_path):
    some.save(tmp_path / "out")
    with pytest.raises(FileExistsError) as error:
        some.save(tmp_path / "out")
    assert str(error.value).endswith("give overwrite=True to replace them, or another folder")
    assert "--" not in str(error.value)
    with pytest.raises(FileExistsError, match="give overwrite=True"):
        read(tmp_path / "out").save(tmp_path / "out2") or read(tmp_path / "out").save(tmp_path / "out2")
    some.save(tmp_path / "out", overwrite=True)
    read(tmp_path / "out").save(tmp_path / "out2", overwrite=True)
    assert read(tmp_path / "out2") == some


@pytest.mark.parametrize("asked", ["__getitem__", "line", "overlay", *("cameras", "verdicts", "basis", "homographies")])
def test_an_unknown_frame_is_named_with_those_that_are_there(some, asked):
    of = getattr(some, asked)
    of = of() if asked == "homographies" else of
    get = of if callable(of) else of.__getitem__
    with pytest.raises(KeyError, match=r"there is no frame 'X.jpg': ids are 'x', (?:'y', )?'z'"):
        get("X.jpg")
    with pytest.raises(KeyError, match=r"there is no frame 'x.jpg': did you mean 'x'\? ids are"):
        get("x.jpg")


def test_a_frame_is_named_by_its_number_too(some, rendered):
    assert some[0] == some.get(0) == some["x"]
    assert some[1] == some["y"]
    assert some.line(0) == some.line("x")
    np.testing.assert_array_equal(some.overlay(0, rendered[3]), some.overlay("x", rendered[3]))
    assert some.get(3) is None
    assert some[-1] == some["z"]
    assert some[np.int64(1)] == some["y"]
    assert some.cameras[0] == some.cameras["x"]
    assert some.cameras[1] == some.cameras["z"]  # the second that has one
    for number in (3, -4):
        with pytest.raises(KeyError, match=f"there is no frame {number}: ids are 'x', 'y', 'z'"):
            some[number]


def test_a_frame_without_a_camera_says_why(some):
    assert list(some.cameras) == list(some.homographies()) == ["x", "z"]
    assert some.cameras.get("y") is None
    for of in (some.cameras, some.homographies()):
        with pytest.raises(KeyError, match="frame 'y' has no camera: no labelled pixels"):
            of["y"]


def test_frames_of_a_video_have_six_digits(some):
    many = ById({f"{number:06d}": number for number in range(9)})
    with pytest.raises(KeyError, match=r"did you mean '000007'\? ids are '000000', '000001', '000002' and 6 more"):
        many[7]
    assert many.get(7) is None


def test_half_a_line_of_results_is_said(some, tmp_path):
    some.save(tmp_path / "out")
    path = tmp_path / "out" / "cameras.jsonl"
    path.write_bytes(path.read_bytes()[:-50])
    with pytest.warns(UserWarning, match=r"cameras.jsonl: its last line is incomplete and is left out"):
        assert list(read(tmp_path / "out")) == ["x", "y"]


def test_results_that_differ_are_not_equal(some):
    less = calibrate({"x": labelled(), "y": {}}, image_size=SIZE, progress=False)
    other = calibrate({"x": labelled(), "y": {}, "z": labelled(TRUTHS[2], shift=0.5)}, image_size=SIZE, progress=False)
    assert some != less
    assert some != other
    assert some != dict(some)


@examples(10)
@given(
    frames=st.dictionaries(
        texts(min_size=1, max_size=8).filter(lambda id: id.isalnum()),
        st.tuples(st.sampled_from(TRUTHS), numbers(-2.0, 2.0), st.integers(0, 5)),
        min_size=1,
        max_size=4,
    )
)
def test_any_results_are_read_back_equal(frames, tmp_path_factory):
    def of(truth, shift, count):
        return dict(list(labelled(truth, shift).items())[:count])

    results = calibrate({id: of(*what) for id, what in frames.items()}, image_size=SIZE, progress=False)
    assert_kept(results, tmp_path_factory.mktemp("any") / "out")


def test_many_frames_are_packed_and_stay_the_same(monkeypatch, tmp_path):
    frames = {f"{number}": labelled(truth, shift=0.1 * number) for number, truth in enumerate(TRUTHS)}
    plain = calibrate(frames, image_size=SIZE, progress=False)
    monkeypatch.setattr("fieldcalib.results.frames.MOST_OPEN", 1)
    packed = calibrate(frames, image_size=SIZE, progress=False)
    assert packed == plain
    assert [dict(line) for line in packed.lines] == [dict(line) for line in plain.lines]
    plain.save(tmp_path / "plain")
    packed.save(tmp_path / "packed")
    for name in LINES:
        assert (tmp_path / "packed" / name).read_bytes() == (tmp_path / "plain" / name).read_bytes()
    assert_kept(packed, tmp_path / "out")


# --- the name ---


def test_it_stays_a_function_whatever_else_is_used():
    """No module of that name may take its place, in any order."""
    code = """
import importlib, pkgutil, warnings
import fieldcalib
warnings.simplefilter("ignore")
for name in fieldcalib.__all__:
    getattr(fieldcalib, name)
    assert callable(fieldcalib.calibrate) and callable(fieldcalib.read), name
for module in pkgutil.walk_packages(fieldcalib.__path__, "fieldcalib."):
    if module.name.endswith("__main__"):
        continue
    try:
        importlib.import_module(module.name)
    except ImportError as error:
        if (error.name or "").startswith("fieldcalib"):
            raise
    assert callable(fieldcalib.calibrate) and callable(fieldcalib.read), module.name
print(fieldcalib.calibrate.__module__, fieldcalib.read.__module__)
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["fieldcalib.results.entry", "fieldcalib.results.entry"]


# --- what a detector found, in metres ---


class Detections:
    """As supervision.Detections, as far as it is read."""

    def __init__(self, xyxy):
        self.xyxy = np.asarray(xyxy, np.float32)


def test_detections_are_places_on_the_ground(some):
    X = np.array([(30.0, -10.0, 0.0), (38.0, 2.0, 0.0)])
    feet = TRUTHS[3].project(X)
    boxes = np.column_stack([feet - (5.0, 30.0), feet + (5.0, 0.0)]) + 0.5  # from the corner of the first pixel
    for detections in (feet, boxes, Detections(boxes)):
        found = some.to_field(detections, "x")
        np.testing.assert_allclose(found.X, X, atol=0.5)
        off = np.abs(found.X - X)[:, :2]
        assert np.all(off < 4.0 * found.standard_deviations)
    for wrong in ([[1.0, 2.0, 3.0]], [[1.0, 2.0, 3.0, 4.0, 0.9, 0.0]], "x", None):
        with pytest.raises(ValueError, match=r"expected boxes \(N, 4\) or pixels \(N, 2\), got"):
            some.to_field(wrong, 0)
    exact = some.to_field(feet, 0, pixel_sd=0.0)
    assert np.all(exact.standard_deviations < some.to_field(feet, 0).standard_deviations)
    assert some.to_field([], "x").X.shape == (0, 3)
    with pytest.warns(UserWarning, match="within 0..1, as shares of the picture"):
        some.to_field(boxes / (*SIZE, *SIZE), "x")
    with pytest.raises(ValueError, match="no labelled pixels"):
        some.to_field(boxes, "y")
    with pytest.raises(ValueError, match="say which frame"):
        some.to_field(boxes)
