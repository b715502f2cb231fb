"""The paper's tables: the published numbers, and measured ones on synthetic frames."""

import io
import json
from contextlib import redirect_stdout

import cv2
import numpy as np
import pytest
from synthetic import random_frames

from baselines import tables
from baselines.chen.cameras import DRAWS
from baselines.chen.database import Database
from baselines.chen.features import Siamese
from baselines.methods import read_dataset, run_methods
from baselines.published import (
    ANNOTATED,
    CHEN,
    CHEN_WIDER,
    DLT,
    FAR,
    JIANG,
    OURS,
    PNLCALIB,
    ROWS,
    TAU,
    TVCALIB,
    hdecomp,
)
from fieldcalib.draw.scene import render_field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.pnlcalib import keypoint_field, keypoint_name
from fieldcalib.io.soccernet import format_annotation
from fieldcalib.io.wc14 import format_homography
from fieldcalib.metrics import compound_score

COUNT = 4
STEPS = ("--steps", "20")


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.dataset} {row.evaluated} {row.method} {row.segments}")
def test_published_scores_follow_from_published_accuracies(row):
    """Guards against misprints: CS is a function of the other numbers, rounded to 0.1."""
    if np.isnan(row.cs):
        pytest.skip("the paper prints no CS for this row")
    accuracies, share = np.array([row.ac5, row.ac10, row.ac20]) / 100.0, tables.SHARES[row.dataset]
    assert 100.0 * compound_score(accuracies, row.cr / 100.0, "tables", share=share) == pytest.approx(row.cs, abs=0.11)


def test_published_rows_are_told_apart():
    keys = [(row.dataset, row.evaluated, row.method, row.segments, row.tau) for row in ROWS]
    assert len(set(keys)) == len(keys) == 45


def write_frames(path, size, *, homographies):
    frames, cameras = random_frames(COUNT, seed=5, noise=0.5, stands=("main center",), image_size=size)
    for index, (frame, camera) in enumerate(zip(frames, cameras, strict=True)):
        (path / f"{index}.json").write_text(format_annotation(frame, size))
        if homographies:
            H = camera.homography
            (path / f"{index}.homographyMatrix").write_text(format_homography(H, image_size=size))
            for alignment in ("chen", "jiang"):
                (path / alignment).mkdir(exist_ok=True)
                text = format_homography(H, alignment, image_size=size)
                (path / alignment / f"{index}.homographyMatrix").write_text(text)
    return path


@pytest.fixture(scope="module")
def sncalib(tmp_path_factory):
    return write_frames(tmp_path_factory.mktemp("sncalib"), (960, 540), homographies=False)


@pytest.fixture(scope="module")
def wc14(tmp_path_factory):
    return write_frames(tmp_path_factory.mktemp("wc14"), (1280, 720), homographies=True)


def run(capsys, *arguments):
    assert tables.main([str(argument) for argument in arguments]) == 0
    return capsys.readouterr().out


def rows_of(text):
    return {
        (row["dataset"], row["evaluated"], row["method"], row["segments"], row["tau"]): row
        for row in json.loads(text)["rows"]
    }


@pytest.fixture(scope="module")
def everything(sncalib, wc14):
    """Rows of a run on all that the tables can use."""
    arguments = ["--sncalib", sncalib, "--sncalib-pred", sncalib, "--wc14", wc14, "--wc14-pred", wc14]
    arguments += ["--chen", wc14 / "chen", "--jiang", wc14 / "jiang", *STEPS, "--json"]
    with redirect_stdout(io.StringIO()) as printed:
        assert tables.main([str(argument) for argument in arguments]) == 0
    return rows_of(printed.getvalue())


def test_every_published_row_is_there_with_its_numbers(everything):
    for row in ROWS:
        record = everything[row.dataset, row.evaluated, row.method, row.segments, row.tau]
        assert record["published"]["AC@5"] == row.ac5
        assert record["published"]["CR"] == row.cr
        assert (record["values"] is None) == (record["reason"] is not None)


def test_perfect_homographies_score_perfectly(everything):
    for method in (ANNOTATED, CHEN, JIANG, hdecomp(ANNOTATED), hdecomp(CHEN), hdecomp(JIANG)):
        values = everything["WC14-test", "homography", method, "-", None]["values"]
        assert values["CR"] == 100.0
        assert values["AC@20"] > 90.0  # stubs of lines at the border are not annotated
        assert values["IoU_part mean"] == pytest.approx(100.0, abs=0.1)


def test_what_can_be_measured_is(everything):
    measured = {key[2:] for key, row in everything.items() if row["values"] is not None}
    for method in (OURS, TVCALIB):
        assert {(method, segments, tau) for segments in ("GT", "pred") for tau in (TAU, None)} <= measured
    assert {(DLT, "GT", None), (hdecomp(DLT), "pred", None), (hdecomp(DLT) + ", zeta = 1000", "GT", None)} <= measured
    ours = everything["WC14-test", "camera", OURS, "GT", None]
    assert ours["values"]["AC@20"] > 90.0
    assert ours["milliseconds"] > 0.0


def test_scores_of_sncalib_count_completeness_as_the_tables_do(everything):
    row = everything["SN-Calib-test-center", "camera", OURS, "GT", None]["values"]
    accuracies = np.array([row["AC@5"], row["AC@10"], row["AC@20"]]) / 100.0
    assert row["CS"] == pytest.approx(100.0 * compound_score(accuracies, 1.0, "tables", share=1454 / 2719))


def test_predicted_segments_score_as_what_they_are(everything):
    """Here they are the annotations themselves."""
    gt, pred = (
        everything["SN-Calib-test-center", "camera", OURS, segments, None]["values"] for segments in ("GT", "pred")
    )
    assert gt == pred


def test_rows_that_cannot_be_measured_say_why(sncalib, capsys):
    text = run(capsys, "--sncalib", sncalib, *STEPS)
    assert "TVCalib (pred): needs segments that a network found: --sncalib-pred DIR" in text
    assert "Chen and Little (U_FoV + U_xyz) (GT): needs their database: --chen-database FILE" in text
    assert "WC14-test" not in text.split("SN-Calib-test-center, 960x540")[1]
    rows = rows_of(run(capsys, "--sncalib", sncalib, *STEPS, "--json"))
    unmeasured = [row for row in rows.values() if row["values"] is None]
    assert unmeasured
    assert all(row["reason"] for row in unmeasured)


@pytest.mark.slow
def test_text_and_markdown(wc14, capsys):
    plain = run(capsys, "--wc14", wc14, *STEPS)
    markdown = run(capsys, "--wc14", wc14, *STEPS, "--markdown")
    assert "\n### WC14-test, 1280x720: cameras\n" in markdown
    (row,) = [line for line in markdown.splitlines() if line.startswith("| HDecomp + annotated H  ")][:1]
    assert "(48.1)" in row
    assert "(90.9)" in row
    assert "(48.1)" in plain
    for block in markdown.split("\n\n"):
        if block.startswith("|"):
            assert len({line.count("|") for line in block.splitlines()}) == 1


def test_only_the_main_camera_counts_where_types_are_known(sncalib, tmp_path):
    for path in sncalib.glob("*.json"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    types = {str(index): "Main camera center" for index in range(COUNT)} | {"1": "Main camera left"}
    (tmp_path / "match_info_cam_gt.json").write_text(
        json.dumps({f"{id}.jpg": {"camera": name} for id, name in types.items()})
    )
    dataset = read_dataset("SN-Calib-test-center", tmp_path, (960, 540))
    assert list(dataset.annotations) == ["0", "2", "3"]
    statistics = tables.dataset_statistics(dataset)
    assert statistics["images"] == 3
    assert statistics["camera_types_percent"] == {"Main camera center": 75.0, "Main camera left": 25.0}


def test_broken_files_stop_it(sncalib, tmp_path, capsys):
    for path in sncalib.glob("*.json"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "2.json").write_text("no JSON")
    assert tables.main(["--sncalib", str(tmp_path)]) == 2
    assert "2.json" in capsys.readouterr().err


def test_something_must_be_given(capsys):
    with pytest.raises(SystemExit):
        tables.main([])
    assert "--sncalib" in capsys.readouterr().err


@pytest.mark.slow
def test_figures(sncalib, wc14, tmp_path, capsys):
    from matplotlib.image import imread

    run(capsys, "--sncalib", sncalib, "--wc14", wc14, *STEPS, "--figures", tmp_path / "new")
    for name in ("loss_per_frame", "accuracy_against_completeness"):
        image = imread(tmp_path / "new" / f"{name}.png")[..., :3]
        assert image.shape[0] > 400
        assert 255.0 * image.std() > 5.0


def test_zeta_100_rejects_what_zeta_1000_takes(tmp_path):
    """An image cut out far from the principal point: the decomposition, which has it in the middle, is 200 px off."""
    camera = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (1280, 720))
    shifted = np.array([[1.0, 0.0, 900.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) @ camera.homography
    (tmp_path / "0.json").write_text('{"Middle line": [{"x": 0.1, "y": 0.2}, {"x": 0.2, "y": 0.3}]}')
    (tmp_path / "0.homographyMatrix").write_text(format_homography(shifted))
    runs = run_methods(read_dataset("WC14-test", tmp_path, (1280, 720)), soccer(), steps=3)
    assert runs[hdecomp(ANNOTATED), "-"].predictions == [None]
    assert runs[hdecomp(ANNOTATED) + FAR, "-"].predictions != [None]


@pytest.mark.slow
def test_chens_method_runs_with_a_database(wc14, tmp_path, capsys):
    for name, extract in (("chen", Siamese.shipped()), ("uniform", None)):
        Database.made(soccer(), name, DRAWS[name], extract, count=1500).write(tmp_path / f"{name}.npz")
    options = ["--chen-database", tmp_path / "chen.npz", "--chen-database", tmp_path / "uniform.npz"]
    rows = rows_of(run(capsys, "--wc14", wc14, *STEPS, "--json", *options))
    for method in (CHEN, CHEN_WIDER):
        row = rows["WC14-test", "homography", method, "GT", None]
        assert row["values"]["CR"] == 100.0
        assert row["values"]["IoU_part mean"] > 50.0
        assert row["milliseconds"] > 0.0
        assert rows["WC14-test", "camera", hdecomp(method), "GT", None]["values"] is not None
        assert ("WC14-test", "camera", method, "GT", None) not in rows
    assert rows["WC14-test", "homography", CHEN, "GT", None]["published"]["AC@5"] == 61.2
    reasons = {key[2:4]: row["reason"] for key, row in rows.items()}
    assert "--wc14-pred DIR --chen-database FILE" in reasons[CHEN, "pred"]
    assert "--chen DIR" in reasons[CHEN, "-"]


def detections_of(camera):
    """What PnLCalib's networks would find without errors: some of its points, and one line."""
    width, height = camera.image_size
    field, found = keypoint_field(soccer()), {}
    for id in range(1, 58):
        x, y = camera.project(np.array(field[keypoint_name(id)].X))
        if 0.0 <= x < width and 0.0 <= y < height:
            found[str(id)] = {"x": x / width, "y": y / height, "p": 0.9}
    return json.dumps({"kp": found, "lines": {}})


@pytest.mark.slow
def test_pictures_and_detections_have_rows_of_their_own(wc14, tmp_path, capsys):
    """Three of four frames have a picture, drawn and squashed; the table of pictures counts these alone."""
    _, cameras = random_frames(COUNT, seed=5, noise=0.5, stands=("main center",), image_size=(1280, 720))
    pictures, detections = tmp_path / "pictures", tmp_path / "detections"
    pictures.mkdir()
    detections.mkdir()
    (detections / "legend.json").write_text('{"points": []}')  # of no frame
    for index, camera in enumerate(cameras):
        (detections / f"{index}.json").write_text(detections_of(camera))
        if index < 3:
            cv2.imwrite(str(pictures / f"{index}.png"), cv2.resize(render_field(camera, soccer()), (640, 640)))
    options = ["--wc14-images", pictures, "--wc14-pnlcalib", detections]
    text = run(capsys, "--wc14", wc14, *options, *STEPS, "--json")
    rows, sizes = rows_of(text), {one["dataset"]: one["images"] for one in json.loads(text)["datasets"]}
    assert sizes == {"WC14-test": COUNT, "WC14-test, pictures": 3}
    found = rows["WC14-test", "camera", OURS, "PnLCalib", None]
    assert found["values"]["CR"] == 100.0
    assert found["values"]["AC@20"] > 85.0
    assert rows["WC14-test", "camera", PNLCALIB, "PnLCalib", None]["published"]["AC@5"] == 73.9
    seen = rows["WC14-test, pictures", "homography", OURS, "images", None]
    assert seen["values"]["CR"] > 60.0
    assert seen["values"]["IoU_part mean"] > 90.0
    assert seen["milliseconds"] > 0.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--wc14-images", "."], "--wc14-images needs --wc14"),
        (["--sncalib-images", "."], "--sncalib-images needs --sncalib"),
    ],
)
def test_pictures_need_their_annotations(wc14, sncalib, capsys, options, message):
    other = ["--sncalib", sncalib] if "--wc14-images" in options else ["--wc14", wc14]
    with pytest.raises(SystemExit):
        tables.main([str(one) for one in [*other, *options]])
    assert message in capsys.readouterr().err


def test_a_folder_without_pictures_of_the_frames_is_refused(wc14, tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "another.png"), np.zeros((36, 64, 3), np.uint8))
    assert tables.main(["--wc14", str(wc14), "--wc14-images", str(tmp_path), *STEPS]) == 2
    assert "expected pictures of the annotated frames" in capsys.readouterr().err


@pytest.mark.slow
def test_a_database_of_another_field_is_refused(wc14, tmp_path, capsys):
    Database.made(soccer(100.0, 64.0), "chen", DRAWS["chen"], None, count=10).write(tmp_path / "small.npz")
    options = ["--wc14", wc14, *STEPS, "--chen-database", tmp_path / "small.npz"]
    assert tables.main([str(option) for option in options]) != 0
    said = capsys.readouterr().err
    assert "of another field" in said
    assert OURS not in said.replace("fieldcalib: ", "")  # nothing has been run
