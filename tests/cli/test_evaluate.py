"""The command `fieldcalib evaluate`: anybody's files in, a table or JSON out."""

import json
import zipfile

import numpy as np
import pytest
from synthetic import observe, random_frames, whole_circle_markings

from fieldcalib import soccer
from fieldcalib.cli.evaluate import GroundTruth, evaluate, table
from fieldcalib.cli.main import main
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.soccernet import camera_to_record, format_annotation
from fieldcalib.io.tvcalib import TVCalibRecord, format_per_sample_output
from fieldcalib.io.wc14 import format_homography
from fieldcalib.metrics import compound_score, evaluate_segments, iou_part, iou_whole, projection_error
from fieldcalib.run_folder.predictions import Predictions

SIZE, WC14 = (960, 540), (1280, 720)
MARKINGS = whole_circle_markings(soccer())
NAMES = ("a", "b", "c", "d")


def run(*arguments):
    """Exit code of the command line."""
    try:
        return main(["evaluate", *(str(argument) for argument in arguments)])
    except SystemExit as error:  # argparse ends so
        return error.code


def report_of(capsys, *arguments, code=0):
    """The JSON that is printed, and stderr; it must be strict."""

    def no_constant(name):
        raise AssertionError(f"{name} is no JSON")

    capsys.readouterr()
    assert run(*arguments, "--json") == code
    printed = capsys.readouterr()
    return json.loads(printed.out, parse_constant=no_constant), printed.err


def write_cameras(folder, cameras):
    folder.mkdir(exist_ok=True)
    for name, camera in cameras.items():
        (folder / f"camera_{name}.json").write_text(json.dumps(camera_to_record(camera), indent=2))
    return folder


def write_annotations(folder, frames, size=SIZE):
    folder.mkdir(exist_ok=True)
    for name, frame in frames.items():
        (folder / f"{name}.json").write_text(format_annotation(frame, size))
    return folder


def write_homographies(folder, homographies):
    folder.mkdir(exist_ok=True)
    for name, H in homographies.items():
        (folder / f"{name}.homographyMatrix").write_text(format_homography(H))
    return folder


@pytest.fixture(scope="module")
def frames():
    """Annotations of four frames and their cameras: (frames, cameras) by name."""
    found, cameras = random_frames(4, seed=3, noise=3.0, stands=("main center",))
    return dict(zip(NAMES, found, strict=True)), dict(zip(NAMES, cameras, strict=True))


@pytest.fixture
def truth(frames, tmp_path):
    return write_annotations(tmp_path / "truth", frames[0])


@pytest.fixture
def cameras(frames, tmp_path):
    """A folder of the cameras of three of the four frames."""
    return write_cameras(tmp_path / "cameras", {name: frames[1][name] for name in "abc"})


# --- what is reported ---


def test_the_report(frames, truth, cameras, capsys):
    report, error = report_of(capsys, cameras, truth)
    assert error == ""
    expected = evaluate_segments([frames[1][name] if name != "d" else None for name in NAMES], frames[0].values(), SIZE)
    assert (report["frames"], report["cameras"], report["CR"]) == (4, 3, 75.0)
    assert (report["size"], report["planar"]) == ([960, 540], False)
    for name, values in (("AC", expected.accuracy), ("precision", expected.precision), ("recall", expected.recall)):
        assert list(report[name]) == ["5", "10", "20"]
        np.testing.assert_allclose(list(report[name].values()), 100.0 * values)
    for kind in ("printed", "tables"):
        assert report["CS"][kind] == pytest.approx(100.0 * compound_score(expected.accuracy, 0.75, kind))
    labels = expected.per_label(5.0)
    assert set(report["segments"]) == set(labels)
    for label, row in report["segments"].items():
        assert row["AC"]["5"] == pytest.approx(100.0 * labels[label].accuracy)
        distances = expected.segment_errors(20.0).get(label)
        assert ("points" in row) == (distances is not None)
        if distances is not None:
            assert row["points"] == len(distances)
            assert row["median_px"] == pytest.approx(np.median(distances))
            assert row["rms_px"] == pytest.approx(np.sqrt(np.mean(distances**2)))
    assert "against_homographies" not in report


def test_the_table(truth, cameras, capsys):
    report, _ = report_of(capsys, cameras, truth)
    assert run(cameras, truth) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    lines = printed.out.splitlines()
    assert lines[0] == "4 frames at 960x540, 3 with a prediction"
    assert lines[2].split() == ["@5", "@10", "@20", "px"]
    for name in ("AC", "precision", "recall"):
        (line,) = (line for line in lines if line.startswith(name) and "segment" not in line)
        assert line.split()[1:] == [f"{value:.2f}" for value in report[name].values()]
    assert "CR                           75.00" in lines
    assert f"{'CS as printed':26s}{report['CS']['printed']:8.2f}" in lines
    for label, row in report["segments"].items():
        (line,) = (line for line in lines if line.startswith(label + " "))
        expected = [*row["AC"].values(), *([row["median_px"]] if "points" in row else [])]
        assert line.removeprefix(label).split()[: len(expected)] == [f"{value:.2f}" for value in expected]


def test_thresholds(truth, cameras, capsys):
    report, _ = report_of(capsys, cameras, truth, "--thresholds", "30,20,2.5,7,20")
    assert list(report["AC"]) == ["2.5", "7", "20", "30"]
    assert report["AC"]["2.5"] < report["AC"]["20"]
    assert "CS" not in report
    assert run(cameras, truth, "--thresholds", "20,2.5") == 0
    assert "@2.5" in capsys.readouterr().out


def test_planar(frames, truth, cameras, capsys):
    report, _ = report_of(capsys, cameras, truth, "--planar")
    assert report["planar"]
    assert not any("Goal" in label for label in report["segments"])
    assert run(cameras, truth, "--planar") == 0
    assert "segments on the ground only" in capsys.readouterr().out


def test_labels_that_say_nothing_count_as_missed(frames, cameras, tmp_path, capsys):
    frames = {name: frame | {"Line unknown": [(1.0, 2.0)]} for name, frame in frames[0].items()}
    report, _ = report_of(capsys, cameras, write_annotations(tmp_path / "unknown", frames))
    row = report["segments"]["Line unknown"]
    assert row["AC"] == row["recall"] == {"5": 0.0, "10": 0.0, "20": 0.0}
    assert row["precision"] == {"5": None, "10": None, "20": None}


# --- whose predictions ---


def test_zips_and_single_files(truth, cameras, tmp_path, capsys):
    expected, _ = report_of(capsys, cameras, truth)
    for name, folder in (("cameras.zip", cameras), ("truth.zip", truth)):
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            for path in sorted(folder.iterdir()):
                archive.write(path, f"test/{path.name}")
    report, error = report_of(capsys, tmp_path / "cameras.zip", tmp_path / "truth.zip")
    assert (report, error) == (expected, "")
    one, error = report_of(capsys, cameras / "camera_a.json", truth / "a.json")
    assert (one["frames"], one["cameras"], error) == (1, 1, "")


def test_tvcalibs_output(frames, truth, cameras, tmp_path, capsys):
    expected, _ = report_of(capsys, cameras, truth)
    records = [TVCalibRecord(name, frames[1][name] if name != "d" else None) for name in NAMES]
    path = tmp_path / "per_sample_output.json"
    path.write_text(format_per_sample_output(records))
    report, error = report_of(capsys, path, truth)
    assert error == ""
    for name in ("frames", "cameras", "AC", "CR", "size"):
        assert report[name] == pytest.approx(expected[name])
    # its homographies, where there are no cameras or where they are asked for
    both = [TVCalibRecord(name, frames[1][name], frames[1][name].homography) for name in NAMES]
    alone = [TVCalibRecord(name, None, frames[1][name].homography) for name in NAMES]
    planar, _ = report_of(capsys, write_cameras(tmp_path / "all", frames[1]), truth, "--planar")
    for records, options in ((both, ["--homographies"]), (alone, ["--size", "960x540"])):
        path.write_text(format_per_sample_output(records))
        report, _ = report_of(capsys, path, truth, "--size", "960x540", *options)
        assert report["planar"]
        assert report["AC"] == pytest.approx(planar["AC"])
    path.write_text(format_per_sample_output(both))
    assert not report_of(capsys, path, truth)[0]["planar"]


def test_tvcalibs_homographies_know_the_size_of_their_images_or_need_one(frames, truth, tmp_path, capsys):
    planar, _ = report_of(capsys, write_cameras(tmp_path / "cameras", frames[1]), truth, "--planar")
    large = {name: frames[1][name].scaled((1920, 1080)).homography for name in NAMES}
    path = tmp_path / "per_sample_output.json"
    path.write_text(
        format_per_sample_output(TVCalibRecord(n, homography=H, image_size=(1920, 1080)) for n, H in large.items())
    )
    report, _ = report_of(capsys, path, truth, "--size", "960x540")
    assert report["AC"] == pytest.approx(planar["AC"])
    assert report_of(capsys, path, truth)[0]["size"] == [1920, 1080]
    path.write_text(format_per_sample_output(TVCalibRecord(n, homography=H) for n, H in large.items()))
    assert run(path, truth) == 2
    assert "--size" in capsys.readouterr().err


def test_broken_lines_of_tvcalibs_output_are_named_and_the_others_scored(frames, truth, tmp_path, capsys):
    path = tmp_path / "per_sample_output.json"
    text = format_per_sample_output(TVCalibRecord(name, frames[1][name]) for name in NAMES)
    path.write_text(text.replace('"b.jpg"', "7"))
    report, error = report_of(capsys, path, truth, code=1)
    assert report["cameras"] == 3
    assert f"{path}: line 2: " in error


def test_a_principal_point_between_pixels_is_that_of_an_image_of_even_size(frames, truth, tmp_path, capsys):
    camera = frames[1]["a"]
    K = camera.K - np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.0, 0.0]])
    path = write_cameras(tmp_path / "cameras", {"a": Camera(K, camera.R, camera.C, SIZE)})
    assert report_of(capsys, path, truth)[0]["size"] == [960, 540]


@pytest.mark.parametrize("point", [1e300, -5.0, 0.0])
def test_absurd_principal_points_say_nothing_about_the_size(point, truth, cameras, frames, capsys):
    record = json.loads((cameras / "camera_a.json").read_text())
    (cameras / "camera_a.json").write_text(json.dumps({**record, "principal_point": [point, 270.0]}))
    report, error = report_of(capsys, cameras, truth, "--size", "960x540")
    assert (report["cameras"], error) == (3, "")
    assert run(cameras, truth) == 2
    assert "--size" in capsys.readouterr().err


def test_homographies(frames, truth, tmp_path, capsys):
    """They are those of 1280 x 720 images, whatever the size at which they are scored."""
    large = {name: camera.scaled(WC14) for name, camera in frames[1].items()}
    homographies = write_homographies(tmp_path / "H", {name: camera.homography for name, camera in large.items()})
    expected, _ = report_of(capsys, write_cameras(tmp_path / "large", large), truth, "--planar")
    report, error = report_of(capsys, homographies, truth)
    assert error == ""
    assert (report["size"], report["planar"]) == ([1280, 720], True)
    assert report["AC"] == pytest.approx(expected["AC"])
    small, _ = report_of(capsys, write_cameras(tmp_path / "small", frames[1]), truth, "--planar")
    report, _ = report_of(capsys, homographies, truth, "--size", "960x540")
    assert report["AC"] == pytest.approx(small["AC"])
    # cameras beside them go first, unless the homographies are asked for
    write_cameras(homographies, large)
    assert not report_of(capsys, homographies, truth)[0]["planar"]
    assert report_of(capsys, homographies, truth, "--homographies")[0]["planar"]
    assert report_of(capsys, homographies / "a.homographyMatrix", truth)[0]["cameras"] == 1


def test_against_true_homographies(frames, tmp_path, capsys):
    """IoU and metres, also where the size is not that of the homographies."""
    moved = {
        name: Camera.from_angles(*(c.angles + (0.004, 0.0, 0.0)), c.K[0, 0], c.C, SIZE) for name, c in frames[1].items()
    }
    truth = write_annotations(tmp_path / "truth", frames[0])
    write_homographies(truth, {name: frames[1][name].scaled(WC14).homography for name in "abc"})
    report, error = report_of(capsys, write_cameras(tmp_path / "moved", {name: moved[name] for name in "bcd"}), truth)
    assert error == ""
    found = report["against_homographies"]
    assert found["frames"] == 2
    pairs = [(moved[name], frames[1][name].homography) for name in "bc"]
    for name, values, scale in (
        ("IoU_part", [iou_part(*pair, SIZE) for pair in pairs], 100.0),
        ("IoU_whole", [iou_whole(*pair, SIZE) for pair in pairs], 100.0),
        ("IoU_whole_image", [iou_whole(*pair, SIZE, kind="image") for pair in pairs], 100.0),
        ("projection_error_m", [projection_error(*pair, SIZE).mean for pair in pairs], 1.0),
    ):
        assert found[name]["mean"] == pytest.approx(scale * np.mean(values), rel=1e-3)
        assert found[name]["median"] == pytest.approx(scale * np.median(values), rel=1e-3)
    assert run(tmp_path / "moved", truth) == 0
    assert f"IoU_part                  {found['IoU_part']['mean']:8.2f} mean" in capsys.readouterr().out
    # the same files on both sides agree at any size
    for size in ("1280x720", "640x360"):
        report, _ = report_of(capsys, truth, truth, "--size", size)
        assert report["against_homographies"]["IoU_whole"]["mean"] == 100.0
        assert report["against_homographies"]["projection_error_m"]["mean"] < 1e-9


def test_real_homographies(shared_data, tmp_path, capsys):
    """The World Cup 2014's annotated homographies: the paper has 54.1 / 82.9 / 92.4 on twice as many frames."""
    for path in (shared_data / "wc14-test").glob("*.json"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    report, _ = report_of(capsys, shared_data / "wc14-test", tmp_path)
    assert (report["frames"], report["CR"]) == (93, 100.0)
    np.testing.assert_allclose(list(report["AC"].values()), (54.1, 82.9, 92.4), atol=2.5)


# --- sizes ---


def test_cameras_of_another_size_are_scored_as_they_are(frames, truth, cameras, capsys):
    report, error = report_of(capsys, cameras, truth, "--size", "1280x720")
    assert report["size"] == [1280, 720]
    assert report["AC"]["20"] < 50.0
    assert error == (
        "fieldcalib: cameras for images of 960x540 are scored at 1280x720 as they are: SoccerNet's evaluation does not "
        "rescale\n"
    )


def test_cameras_of_several_sizes_need_one(frames, truth, cameras, capsys):
    write_cameras(cameras, {"d": frames[1]["d"].scaled(WC14)})
    assert run(cameras, truth) == 2
    assert "of several sizes: say by --size" in capsys.readouterr().err
    assert run(cameras, truth, "--size", "960x540") == 0
    assert "cameras for images of 1280x720 are scored at 960x540" in capsys.readouterr().err


# --- camera types ---


def test_camera_type(frames, truth, cameras, tmp_path, capsys):
    types = {"a": "Main camera center", "b": "Close-up", "d": "Main camera center", "z": "Spider camera"}
    write_homographies(truth, {name: frames[1][name].scaled(WC14).homography for name in "ab"})
    center = ("--camera-type", "Main camera center")
    assert run(cameras, truth, *center) == 2
    assert f"{truth} has no match_info_cam_gt.json" in capsys.readouterr().err
    (truth / "match_info_cam_gt.json").write_text(
        json.dumps({f"{id}.jpg": {"camera": name} for id, name in types.items()})
    )
    with zipfile.ZipFile(tmp_path / "truth.zip", "w") as archive:
        for path in sorted(truth.iterdir()):
            archive.write(path, f"test/{path.name}")
    for path in (truth, tmp_path / "truth.zip"):
        report, _ = report_of(capsys, cameras, path, *center)
        assert (report["frames"], report["cameras"]) == (2, 1)
        accuracies = np.array(list(report["AC"].values())) / 100.0
        expected = compound_score(accuracies, 0.5, "tables", share=0.5)  # two of the four annotated frames
        assert report["CS"]["tables"] == pytest.approx(100.0 * expected)
        assert report["against_homographies"]["frames"] == 1  # b is of another type
    assert run(cameras, truth, "--camera-type", "main") == 2
    error = capsys.readouterr().err
    assert "no frame is of type 'main'; there are Close-up, Main camera center, Spider camera" in error
    (truth / "match_info_cam_gt.json").write_text("[]")
    assert run(cameras, truth, *center) == 2
    assert f"{truth / 'match_info_cam_gt.json'}: expected a JSON object of images" in capsys.readouterr().err


# --- no NaN, whatever comes ---


def test_cameras_that_see_nothing(frames, truth, tmp_path, capsys):
    """Nothing is projected: no precision, no reprojection errors, no metres."""
    away = Camera.from_angles(0.0, 2.2, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE)  # into the sky
    write_homographies(truth, {name: frames[1][name].scaled(WC14).homography for name in NAMES})
    predictions = write_cameras(tmp_path / "away", dict.fromkeys(NAMES, away))
    report, _ = report_of(capsys, predictions, truth)
    nothing = {"5": None, "10": None, "20": None}
    assert report["AC"] == report["recall"] == {"5": 0.0, "10": 0.0, "20": 0.0}
    assert report["precision"] == nothing
    assert all(row["precision"] == nothing and "points" not in row for row in report["segments"].values())
    assert report["against_homographies"]["IoU_part"]["mean"] == 0.0
    assert "projection_error_m" not in report["against_homographies"]
    assert run(predictions, truth) == 0
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("precision"))
    assert line.split() == ["precision", "-", "-", "-"]


def test_segments_that_are_never_right(tmp_path, capsys):
    """All is seen and annotated, and wrong: no recall."""
    view = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE)
    wrong = dict.fromkeys(("Middle line", "Circle central"), np.array([[900.0, 500.0]]))
    path, annotations = write_cameras(tmp_path / "c", {"a": view}), write_annotations(tmp_path / "t", {"a": wrong})
    report, _ = report_of(capsys, path, annotations)
    assert report["AC"] == report["precision"] == {"5": 0.0, "10": 0.0, "20": 0.0}
    assert report["recall"] == {"5": None, "10": None, "20": None}
    assert run(path, annotations) == 0


def test_a_label_on_one_side_at_one_threshold_alone(tmp_path, capsys):
    """Seven pixels off: at 5 px a tie, which the labels of the other side win, at 10 px its own."""
    view = Camera.from_angles(-0.7, 1.35, 0.0, 1500.0, (0.0, 60.0, -15.0), SIZE)
    frame = {label: xy for label, xy in observe(MARKINGS, view).items() if label == "Big rect. left main"}
    (xy,) = frame.values()
    direction = (xy[-1] - xy[0]) / np.linalg.norm(xy[-1] - xy[0])
    frame = {"Big rect. left main": xy[1:-1] + 7.0 * direction[::-1] * (1, -1)}
    path, annotations = write_cameras(tmp_path / "c", {"a": view}), write_annotations(tmp_path / "t", {"a": frame})
    report, _ = report_of(capsys, path, annotations)
    assert report["segments"]["Big rect. right main"]["AC"] == {"5": 0.0, "10": None, "20": None}
    assert report["segments"]["Big rect. left main"]["AC"] == {"5": 0.0, "10": 100.0, "20": 100.0}
    assert run(path, annotations) == 0
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("Big rect. right main"))
    assert line.split()[-3:] == ["0.00", "-", "-"]


@pytest.mark.parametrize("annotations", [{}, {"a": {"Middle line": np.array([[1.0, 2.0]])}}])
def test_no_prediction_at_all(annotations):
    """Not by the command, which refuses it, but by whoever calls it."""
    report = evaluate({}, GroundTruth(annotations, {}), SIZE)
    json.dumps(report, allow_nan=False)
    assert report["AC"] == {"5": None, "10": None, "20": None}
    assert report["CS"] == {"printed": None, "tables": None}
    assert report["CR"] == (0.0 if annotations else None)
    assert f"{'AC':26s}       -       -       -" in table(report)


def test_absurd_cameras(frames, truth, cameras, capsys):
    """Numbers that no camera has: they are scored as SoccerNet's evaluation scores them, without a warning."""
    write_homographies(truth, {name: frames[1][name].scaled(WC14).homography for name in NAMES})
    record = camera_to_record(frames[1]["a"])
    for name, change in (
        ("a", {"x_focal_length": 0.0, "y_focal_length": 0.0}),
        ("b", {"x_focal_length": 1e300, "radial_distortion": [1e200] * 6}),
        ("c", {"position_meters": [0.0, 0.0, 0.0]}),
        ("d", {"position_meters": [1e300, -1e300, 1e300], "pan_degrees": 1e300}),
    ):
        (cameras / f"camera_{name}.json").write_text(json.dumps(record | change))
    report, error = report_of(capsys, cameras, truth)
    assert error == ""
    assert report["cameras"] == 4
    assert report["AC"]["20"] < 50.0


# --- broken files and wrong usage ---


def test_broken_files_are_named_and_the_others_scored(frames, truth, cameras, capsys):
    (cameras / "camera_b.json").write_text('{"pan_degrees": 1')
    (truth / "c.json").write_text('{"Midle line": [{"x": 0.5, "y": 0.5}]}')
    write_homographies(truth, {"a": frames[1]["a"].scaled(WC14).homography})
    (truth / "d.homographyMatrix").write_text("1 2 3")
    report, error = report_of(capsys, cameras, truth, code=1)
    assert (report["frames"], report["cameras"]) == (3, 1)
    assert report["against_homographies"]["frames"] == 1
    errors = error.splitlines()
    assert len(errors) == 3
    for path, line in zip(("cameras/camera_b.json", "truth/c.json", "truth/d.homographyMatrix"), errors, strict=True):
        assert line.startswith(f"fieldcalib: {truth.parent / path}: ")
    assert run(cameras, truth) == 1
    assert "3 frames at 960x540, 1 with a prediction" in capsys.readouterr().out


def test_annotations_that_are_too_much_are_broken(frames, truth, cameras, capsys):
    dense = {label: np.resize(xy, (10_001, 2)) for label, xy in list(frames[0]["c"].items())[:2]}
    (truth / "c.json").write_text(format_annotation(dense, SIZE))
    (truth / "d.json").write_bytes((truth / "d.json").read_bytes() + b" " * 2_000_000)
    report, error = report_of(capsys, cameras, truth, "--max-megabytes", 2, code=1)
    assert report["frames"] == 2
    assert f"{truth / 'c.json'}: has 20002 labelled pixels: up to 20000 are evaluated\n" in error
    assert f"{truth / 'd.json'}: has more than 2 MB; --max-megabytes of a command allows more\n" in error


def test_files_that_are_skipped_are_named(frames, truth, cameras, capsys):
    write_homographies(truth, {"a": frames[1]["a"].scaled(WC14).homography})
    for path in (cameras / "00001.json", cameras / "summary.json", truth / "camera_a.json", truth / "a.jpg"):
        path.write_text("{}")
    report, error = report_of(capsys, cameras, truth)
    assert report["against_homographies"]["frames"] == 1
    assert (
        error
        == "fieldcalib: skipped 1 .json (00001.json)\nfieldcalib: skipped 1 .jpg (a.jpg), 1 .json (camera_a.json)\n"
    )


def test_nothing_but_broken_files(truth, tmp_path, capsys):
    """They are named although there is nothing to print."""
    predictions = tmp_path / "broken"
    predictions.mkdir()
    (predictions / "camera_a.json").write_text("{}")
    assert run(predictions, truth, "--json") == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    lines = printed.err.splitlines()
    assert lines[0] == f"fieldcalib: {predictions / 'camera_a.json'}: a camera needs the key 'pan_degrees'"
    assert lines[1] == f"fieldcalib: {predictions} holds no prediction that can be evaluated"


def test_frames_that_do_not_meet(frames, truth, tmp_path, capsys):
    predictions = write_cameras(tmp_path / "other", {f"frame_{name}": camera for name, camera in frames[1].items()})
    assert run(predictions, truth, "--json") == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == (
        f"fieldcalib: {predictions} has the frames frame_a, frame_b, frame_c and 1 more, "
        f"{truth} has the frames a, b, c and 1 more: no frame in common, do the ids agree?\n"
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "holds no prediction that can be evaluated"),
        ("{\n", "per_sample_output.json: line 1: is no JSON"),
        ('{"image_ids": "a.jpg"}\n', "holds no prediction that can be evaluated"),
        ('{"image_ids": "a.jpg"}\n{"image_ids": ["a.png"]}\n', "per_sample_output.json: frame a has several records"),
    ],
)
def test_broken_outputs_of_tvcalib(truth, tmp_path, capsys, content, message):
    (tmp_path / "per_sample_output.json").write_text(content)
    assert run(tmp_path / "per_sample_output.json", truth) == 2
    assert message in capsys.readouterr().err


def test_what_a_run_wrote(truth, tmp_path, capsys):
    """Its lines count where it has no files of cameras, with what it withholds; and lines of another width are told."""
    options = ["calibrate", str(truth), "--size", "960x540", "--tau", "0.014", "--line-width", "0.12", "--out"]
    assert main([*options, str(tmp_path / "lines")]) == 0
    assert main([*options, str(tmp_path / "files"), "--camera-files"]) == 0
    assert not list((tmp_path / "lines").glob("camera_*"))
    assert 0 < len(list((tmp_path / "files").glob("camera_*"))) < 4
    lines, files = (report_of(capsys, tmp_path / name, truth) for name in ("lines", "files"))
    assert lines == files
    assert "scored on a field with lines of 0 m: --line-width 0.12 scores them on theirs" in lines[1]
    same = report_of(capsys, tmp_path / "lines", truth, "--line-width", "0.12")
    assert same[1] == ""
    assert same[0] != lines[0]


def test_wrong_paths(truth, cameras, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    (tmp_path / "none.zip").write_bytes(b"no zip")
    nothing = (
        "holds no prediction: expected camera_<id>.json, <id>.homographyMatrix, what run or calibrate wrote, "
        "or TVCalib's per_sample_output.json"
    )
    for arguments, message in (
        ((tmp_path / "missing", truth), f"{tmp_path / 'missing'} does not exist"),
        ((tmp_path / "missing.json", truth), f"{tmp_path / 'missing.json'} does not exist"),
        ((tmp_path / "empty", truth), f"{tmp_path / 'empty'} {nothing}"),
        ((cameras, truth, "--homographies"), f"{cameras} holds no homography"),
        ((tmp_path / "none.zip", truth), "not a zip file"),
        ((cameras, tmp_path / "missing"), "does not exist"),
        ((cameras, tmp_path / "empty"), "holds no annotation"),
        ((cameras, cameras), "holds no annotation"),
    ):
        assert run(*arguments) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        (line,) = printed.err.splitlines()
        assert line.startswith("fieldcalib: ")
        assert message in line


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--size", "960"], "argument --size: expected WIDTHxHEIGHT, as 960x540, got '960'"),
        (["--thresholds", "5,-1"], "argument --thresholds: expected a positive number, got '-1'"),
        (["--thresholds", ""], "argument --thresholds: expected a positive number, got ''"),
    ],
)
def test_wrong_options(truth, cameras, capsys, options, message):
    assert run(cameras, truth, *options) == 2
    assert message in capsys.readouterr().err


def test_help(capsys):
    assert run("--help") == 0
    printed = capsys.readouterr().out
    for word in ("--size", "--thresholds", "--planar", "--homographies", "--camera-type", "camera_<id>.json"):
        assert word in printed


# --- several processes ---


@pytest.mark.parametrize("size", ["1280x720", pytest.param(None, marks=pytest.mark.slow)])
def test_the_report_is_the_same_with_any_number_of_jobs(truth, cameras, capsys, monkeypatch, size):
    monkeypatch.setattr("fieldcalib.run_folder.predictions.READ_AT_ONCE", 2)
    monkeypatch.setattr("fieldcalib.metrics.accuracy.CHUNK", 3)
    (cameras / "camera_a.json").write_text("{")
    (truth / "d.json").write_text("{")
    options = [] if size is None else ["--size", size]
    alone = report_of(capsys, cameras, truth, *options, code=1)
    assert report_of(capsys, cameras, truth, *options, "--jobs", 2, code=1) == alone
    assert alone[0]["frames"] == 3


def test_a_principal_point_that_is_far_off_is_no_other_size_where_a_run_says_the_size():
    K = np.array([[1000.0, 0.0, 410.0], [0.0, 1000.0, 270.0], [0.0, 0.0, 1.0]])
    by_frame = {"1": Camera(K, np.eye(3), np.zeros(3), (960, 540), checked=False)}
    assert Predictions(by_frame, (960, 540)).of_other_sizes == [(820, 540)]
    assert Predictions(by_frame, (960, 540), made_for=(960, 540)).of_other_sizes == []
    assert Predictions(by_frame, (1280, 720), made_for=(960, 540)).of_other_sizes == [(960, 540)]
