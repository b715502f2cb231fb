"""The options of `fieldcalib calibrate`: thresholds, priors, the field and its size, squashed and cropped pictures."""

import json

import numpy as np
import pytest
import views
from commands import SIZE, SIZE_KEYS, WITH_CAMERA, WITHOUT_CAMERA, calibrate, cameras_in, lines_of, run, summary_of
from synthetic import in_image, observe, whole_circle_markings

import fieldcalib
from fieldcalib.cli.main import main
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.soccernet import camera_from_record, format_annotation


def test_tau_withholds_cameras_and_removes_those_of_an_earlier_run(
    annotated_folder, calibrated_folder, tmp_path, capsys
):
    assert calibrate(tmp_path, annotated_folder) == 0
    (tmp_path / "camera_other.json").write_text("not of this run")
    losses = {line["id"]: line["loss_ndc"] for line in lines_of(calibrated_folder)}
    tau = float(np.median(list(losses.values())))
    assert calibrate(tmp_path, annotated_folder, options=["--tau", tau, "--overwrite"]) == 0
    kept = {name for name, loss in losses.items() if loss <= tau}
    assert 0 < len(kept) < 4
    assert set(cameras_in(tmp_path)) == kept | {"other"}
    assert capsys.readouterr().err.endswith(f"fieldcalib: 1 camera in {tmp_path} is not of this run\n")
    assert {line["id"] for line in lines_of(tmp_path) if line["status"] == "rejected by tau"} == set("abcd") - kept
    assert summary_of(tmp_path)["cameras"] == len(kept)
    assert summary_of(tmp_path)["options"]["tau"] == tau


def test_improbable_cameras_are_withheld_on_request(annotated_folder, calibrated_folder, tmp_path):
    probabilities = {line["id"]: line["probability_right_1m"] for line in lines_of(calibrated_folder)}
    least = float(np.median(list(probabilities.values())))
    assert calibrate(tmp_path, annotated_folder, options=["--least-probability", least]) == 0
    kept = {name for name, p in probabilities.items() if p >= least}
    assert 0 < len(kept) < 4
    assert set(cameras_in(tmp_path)) == kept
    improbable = [line for line in lines_of(tmp_path) if line["status"] == "probably wrong"]
    assert {line["id"] for line in improbable} == set("abcd") - kept
    assert all(f"{probabilities[line['id']]:.2f}" in line["message"] for line in improbable)


def test_a_frame_says_how_sure_it_is(calibrated_folder, annotated_frames):
    for line in lines_of(calibrated_folder):
        camera, sigma = annotated_frames[line["id"]][1], line["standard_deviations"]
        assert np.all(np.abs(camera.C - line["C"]) < 5.0 * np.array(sigma["C"]))
        assert abs(camera.focal_length - line["K"][0][0]) < 5.0 * sigma["focal_length_px"]
        assert 0.0 <= line["probability_right_0.5m"] <= line["probability_right_1m"] <= 1.0


def test_the_other_side_is_written_where_it_fits(tmp_path):
    camera = fieldcalib.Camera.from_angles(0.0, 1.35, 0.0, 900.0, (0.0, 65.0, -16.0), SIZE)
    frame = {label: camera.project(soccer()[label].sample(1.0)) for label in ("Middle line", "Circle central")}
    inside = {label: xy[np.all((xy >= 0.0) & (xy < SIZE), axis=1)] for label, xy in frame.items()}
    (tmp_path / "a.json").write_text(format_annotation(inside, SIZE))
    assert calibrate(tmp_path / "out", tmp_path) == 0
    (line,) = lines_of(tmp_path / "out")
    (other,) = line["alternatives"]
    np.testing.assert_allclose(np.multiply(other["C"], (-1.0, -1.0, 1.0)), line["C"])
    assert line["probability_right_1m"] <= 0.5


def test_the_prior_matters(annotated_folder, calibrated_folder, tmp_path):
    found = {"all": cameras_in(calibrated_folder)}
    for prior in ("main center", "none", "opposite tribune"):
        assert calibrate(tmp_path / prior, annotated_folder, options=["--prior", prior]) == 0
        assert summary_of(tmp_path / prior)["options"]["prior"] == prior
        found[prior] = cameras_in(tmp_path / prior)
    assert found["none"] != found["all"]
    assert found["opposite tribune"] != found["all"]


def test_main_center_finds_the_true_cameras(annotated_folder, annotated_frames, tmp_path):
    assert calibrate(tmp_path, annotated_folder, options=["--prior", "main center"]) == 0
    for line in lines_of(tmp_path):
        assert np.linalg.norm(annotated_frames[line["id"]][1].C - line["C"]) < 4.0


def test_the_size_of_the_field(annotated_frames, tmp_path):
    """Annotations of a field of 90 x 60 m fit it better than they fit the default."""
    markings = whole_circle_markings(soccer(90.0, 60.0))
    for name, (_, camera) in annotated_frames.items():
        (tmp_path / f"{name}.json").write_text(format_annotation(observe(markings, camera), SIZE))
    size = ["--field-length", 90, "--field-width", 60]
    for out, options in (("default", []), ("true", size), ("length", size[:2]), ("width", size[2:])):
        assert calibrate(tmp_path / out, tmp_path, options=[*options, "--lens", "none"]) == 0
    rms = {out: [line["rms_px"] for line in lines_of(tmp_path / out)] for out in ("default", "true", "length", "width")}
    assert max(rms["true"]) < 0.1
    assert all(min(np.mean(rms[out]) for out in ("default", "length", "width")) > 5.0 * value for value in rms["true"])
    assert summary_of(tmp_path / "true")["options"]["field_length"] == 90.0
    assert summary_of(tmp_path / "true")["options"]["field_width"] == 60.0


@pytest.fixture
def small_pitch(annotated_frames, tmp_path):
    """Annotations of the four cameras on a field of 101 x 65 m, and a frame without any."""
    path, rng = tmp_path / "small", np.random.default_rng(0)
    path.mkdir()
    markings = whole_circle_markings(soccer(101.0, 65.0))
    for name, (_, camera) in annotated_frames.items():
        (path / f"{name}.json").write_text(format_annotation(observe(markings, camera, rng, 0.5), SIZE))
    (path / "empty.json").write_text("{}")
    return path


def sizes_in(out):
    return np.array([(line["field_length"], line["field_width"]) for line in lines_of(out)])


SAME_FIELD = ["--field-size", "estimated", "--same-field"]


def test_one_size_of_the_field_for_all_frames(small_pitch, tmp_path, capsys):
    assert calibrate(tmp_path / "free", small_pitch, options=SAME_FIELD) == 0
    printed = capsys.readouterr().out.splitlines()
    lines = lines_of(tmp_path / "free")
    for line in lines:
        assert list(line) == (WITH_CAMERA if "K" in line else WITHOUT_CAMERA) + SIZE_KEYS
        assert {key: line[key] for key in SIZE_KEYS} == {key: lines[0][key] for key in SIZE_KEYS}
    (length, width), *_ = sizes_in(tmp_path / "free")
    deviations = np.array(lines[0]["field_standard_deviations"])
    assert np.all(np.abs((length - 101.0, width - 65.0)) < 3.0 * deviations)
    assert np.all(deviations < 0.5)
    assert min(lines[0]["field_from_labels"]) > 0.95
    assert printed[0].startswith(f"length: {length:.2f} ± {deviations[0]:.2f} m from the labels; width: {width:.2f} ± ")
    assert printed[1].startswith("4 cameras of 5 frames")
    assert summary_of(tmp_path / "free")["options"]["same_field"] is True
    # from there on it is as if the size had been known
    known = ["--field-length", length, "--field-width", width]
    for out, options in (("known", known), ("default", [])):
        assert calibrate(tmp_path / out, small_pitch, options=options) == 0
    assert cameras_in(tmp_path / "free") == cameras_in(tmp_path / "known")
    for key in ("rms_px", "loss_ndc", "loss_ndc_eq3"):
        free, known, default = (
            [line[key] for line in lines_of(tmp_path / out) if "K" in line] for out in ("free", "known", "default")
        )
        assert free == known
        assert np.mean(free) < 0.8 * np.mean(default)


def test_a_size_of_the_field_for_each_frame(small_pitch, tmp_path, capsys):
    assert calibrate(tmp_path / "all", small_pitch, options=["--field-size", "estimated"]) == 0
    assert capsys.readouterr().out.startswith("4 cameras of 5 frames")
    sizes = sizes_in(tmp_path / "all")
    assert len(set(map(tuple, sizes))) == 5
    ids = [line["id"] for line in lines_of(tmp_path / "all")]
    np.testing.assert_array_equal(sizes[ids.index("empty")], (105.0, 68.0))
    for id in ("a", "d"):
        assert calibrate(tmp_path / id, small_pitch / f"{id}.json", options=SAME_FIELD) == 0
        assert lines_of(tmp_path / id) == [lines_of(tmp_path / "all")[ids.index(id)]]


def test_cameras_on_a_free_field_are_doubted_too(small_pitch, tmp_path):
    options = [*SAME_FIELD, "--least-probability", 1]
    assert calibrate(tmp_path, small_pitch, options=options) == 0
    assert cameras_in(tmp_path) == {}


def test_the_size_of_the_field_is_sought_near_the_given_one(small_pitch, tmp_path):
    known = ["--field-length", 99, "--field-width", 67]
    assert calibrate(tmp_path, small_pitch / "empty.json", options=["--field-size", "estimated", *known]) == 0
    np.testing.assert_array_equal(sizes_in(tmp_path), [(99.0, 67.0)])


def test_the_size_of_the_images(annotated_folder, calibrated_folder, tmp_path):
    """Annotations are relative: in larger images focal lengths are longer, everything else stays."""
    assert run("calibrate", annotated_folder, "--size", "1920X1080", "--out", tmp_path) == 0
    for small, large in zip(lines_of(calibrated_folder), lines_of(tmp_path), strict=True):
        assert large["K"][0][0] == pytest.approx(2.0 * small["K"][0][0], rel=5e-3)
        assert [large["K"][i][2] for i in range(2)] == pytest.approx(
            [2.0 * small["K"][i][2] for i in range(2)], abs=4.0
        )
        np.testing.assert_allclose(large["C"], small["C"], atol=0.5)


def test_a_field_of_known_size_and_ground_is_trusted_more(annotated_folder, calibrated_folder, tmp_path):
    assert calibrate(tmp_path, annotated_folder, options=["--field-size", "known", "--crown", "0"]) == 0
    assert summary_of(tmp_path)["options"]["field_size"] == "known"
    for nominal, known in zip(lines_of(calibrated_folder), lines_of(tmp_path), strict=True):
        np.testing.assert_allclose(known["C"], nominal["C"], rtol=1e-9)
        assert np.all(np.array(known["standard_deviations"]["C"]) < nominal["standard_deviations"]["C"])
        assert known["probability_right_1m"] > nominal["probability_right_1m"]


# --- squashed and cropped pictures ---

WHOLE = views.camera(24, 78, 1400, (0, 68, -17), k=(0.06, 0.0))  # of 960 x 540
HALF, SQUARE = (480, 540), (640, 640)
DECLARED = {  # the camera of the picture, and what is said of it
    "squashed": (WHOLE.scaled(SQUARE), ["--display-size", "960x540"]),
    "right half": (WHOLE.cropped((480, 0), HALF), ["--crop-of", "960x540+480+0"]),
    "both": (
        WHOLE.cropped((480, 0), HALF).scaled(SQUARE),
        ["--display-size", "480x540", "--crop-of", "960x540+480+0"],
    ),
}


@pytest.mark.parametrize(("true_camera", "declaration"), DECLARED.values(), ids=DECLARED)
def test_squashed_and_cropped_pictures(true_camera, declaration, tmp_path, capsys):
    width, height = true_camera.image_size
    pixels = observe(whole_circle_markings(soccer()), true_camera, np.random.default_rng(0), 0.3, per_line=9)
    shown = {label: xy[in_image(xy, true_camera.image_size)] for label, xy in pixels.items()}
    (tmp_path / "a.json").write_text(format_annotation(shown, true_camera.image_size))
    options = ["--size", f"{width}x{height}", "--prior", "main center"]
    assert (
        run("calibrate", tmp_path / "a.json", *options, *declaration, "--camera-files", "--out", tmp_path / "out") == 0
    )
    assert "nearly square" not in capsys.readouterr().err
    (line,) = lines_of(tmp_path / "out")
    found = camera_from_record(json.loads((tmp_path / "out" / "camera_a.json").read_text()), true_camera.image_size)
    np.testing.assert_allclose(found.K, line["K"])
    sigma = line["standard_deviations"]
    assert abs(found.focal_length - true_camera.focal_length) < 3.0 * sigma["focal_length_px"]
    assert np.all(np.abs(found.C - true_camera.C) < 3.0 * np.array(sigma["C"]))
    assert found.K[1, 1] / found.K[0, 0] == pytest.approx(true_camera.K[1, 1] / true_camera.K[0, 0])
    np.testing.assert_allclose(found.principal_point, true_camera.principal_point, atol=30.0)
    X = soccer()["Big rect. right main"].sample(1.0)
    visible = in_image(true_camera.project(X), true_camera.image_size)
    assert np.count_nonzero(visible) > 20
    np.testing.assert_allclose(found.project(X)[visible], true_camera.project(X)[visible], atol=0.6)
    assert line["loss_ndc_eq3"] < 0.005
    assert line["verdict"] == "good"


@pytest.mark.parametrize(
    ("options", "is_asked"),
    [
        ([], "was squashed or cut out"),
        (["--aspect", "square"], ""),  # right wherever its principal point is
        (["--crop-of", "720x540+0+0"], ""),
        (["--aspect", "square", "--crop-of", "720x540+0+0"], ""),
    ],
)
def test_a_whole_picture_of_another_shape_is_asked_about_until_that_is_said(options, is_asked, tmp_path):
    camera = views.camera(24, 78, 1400, (0, 68, -17)).cropped((120, 0), (720, 540))
    labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top")
    pixels = observe(whole_circle_markings(soccer()), camera, np.random.default_rng(0), 1.5, per_line=4)
    (tmp_path / "a.json").write_text(format_annotation({label: pixels[label] for label in labels}, (720, 540)))
    assert run("calibrate", tmp_path / "a.json", "--size", "720x540", *options, "--out", tmp_path / "out") == 0
    (line,) = lines_of(tmp_path / "out")
    asked = [words for words in ("was squashed or cut out", "may be a part of a frame") if words in line["reason"]]
    assert asked == ([is_asked] if is_asked else [])
    assert ("what the picture is of" in line["remedy"]) is bool(is_asked)


def test_labels_of_a_declared_part_end_where_it_ends(tmp_path):
    """Those of a left half: its last column is no doubt that the size is right."""
    left = WHOLE.cropped((0, 0), HALF)
    pixels = observe(whole_circle_markings(soccer()), left, np.random.default_rng(0), 0.0, per_line=200)
    (tmp_path / "a.json").write_text(format_annotation(pixels, HALF))
    declared = ["--size", "480x540", "--crop-of", "960x540+0+0", "--out", tmp_path / "out"]
    assert run("calibrate", tmp_path / "a.json", *declared) == 0
    assert "the labels end at column" not in lines_of(tmp_path / "out")[0]["reason"]


NOTE = "1 of 1 frame is nearly square: pictures of broadcasts of that shape were squashed, which --aspect declares"


@pytest.mark.parametrize(
    ("size", "options", "is_said"),
    [
        (SQUARE, [], False),  # its labels tell that it was squashed
        (SQUARE, ["--aspect", "square"], False),
        ((1440, 1080), [], False),  # 4:3
        (SQUARE, ["--crop-of", "960x640+0+0"], False),
    ],
)
def test_pictures_that_are_nearly_square_are_asked_about(size, options, is_said, tmp_path, capsys):
    pixels = observe(whole_circle_markings(soccer()), WHOLE.scaled(size))
    (tmp_path / "a.json").write_text(format_annotation(pixels, size))
    command = ["calibrate", tmp_path / "a.json", "--size", "{}x{}".format(*size), "--out", tmp_path / "out", *options]
    assert run(*command) == 0
    assert (NOTE in capsys.readouterr().err) is is_said
    assert run(*command, "--resume") == 0
    assert (NOTE in capsys.readouterr().err) is is_said


def test_a_size_that_squashes_the_frames_is_doubted(tmp_path, capsys):
    """Width and height swapped: annotations are normalised, so that only the geometry tells."""
    frames = tmp_path / "frames"
    frames.mkdir()
    pans = np.linspace(-0.4, 0.4, 6)
    for number, pan in enumerate(pans):
        camera = Camera.from_angles(pan, 1.3, 0.0, 900.0, (0.0, 66.0, -16.0), (960, 540))
        seen = observe(whole_circle_markings(soccer()), camera)
        points = {label: [{"x": x / 959.0, "y": y / 539.0} for x, y in xy.tolist()] for label, xy in seen.items()}
        (frames / f"{number}.json").write_text(json.dumps(points))
    assert main(["calibrate", str(frames), "--size", "960x540", "--out", str(tmp_path / "right")]) == 0
    assert "not square" not in capsys.readouterr().err
    assert main(["calibrate", str(frames), "--size", "540x960", "--out", str(tmp_path / "swapped")]) == 0
    assert "show pixels that are not square: is the size right?" in capsys.readouterr().err
    found, by_function = (
        fieldcalib.read(tmp_path / "swapped"),
        fieldcalib.calibrate(frames, image_size=(540, 960), progress=False),
    )
    for id, one in found.items():
        assert (one.verdict, one.reason) == (by_function[id].verdict, by_function[id].reason)
        assert one.reason.startswith("are width and height exchanged? 540x960 is upright")
        assert one.verdict == "check"


@pytest.mark.parametrize("free", [SAME_FIELD, SAME_FIELD[:2]], ids=["one", "each"])
def test_a_size_of_a_field_whose_crown_is_known(small_pitch, tmp_path, free):
    """The crown is in the field, and not among what the labels tell."""
    assert calibrate(tmp_path, small_pitch, options=[*free, "--crown", 0.2]) == 0
    lines = [line for line in lines_of(tmp_path) if "K" in line]
    assert [line["field"]["ground"]["crown"] for line in lines] == 4 * [0.2]
    assert all("field_crown_m" not in line for line in lines)
    assert np.all(np.array([line["field_length"] for line in lines]) < 104.0)
