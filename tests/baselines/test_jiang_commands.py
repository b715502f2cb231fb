"""python -m baselines.jiang: it trains, runs and scores, others read what it writes, and it is not installed."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from commands import lines_of

from baselines.jiang.__main__ import main
from baselines.jiang.estimate import Estimator
from baselines.jiang.networks import ErrorNetwork
from baselines.jiang.training import ERROR, save
from baselines.methods import read_dataset
from baselines.published import JIANG
from data_tools.homography_frames import main as make_frames
from fieldcalib import soccer
from fieldcalib.geometry.homography import ALIGNMENTS
from fieldcalib.io.formats import HOMOGRAPHIES
from fieldcalib.io.soccernet import format_annotation

PROJECT = Path(__file__).parents[2]
SIZE = (1280, 720)


def run(*arguments):
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as error:  # argparse ends so
        return error.code


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    """Three frames with homographies, made like one that is given, and annotations of them."""
    folder = tmp_path_factory.mktemp("frames")
    like = folder / "like"
    like.mkdir()
    H = ALIGNMENTS["wc14"].from_fieldcalib(_camera().homography)
    np.savetxt(like / "1.homographyMatrix", H)
    assert make_frames([str(folder / "made"), "--like", str(like), "--count", "3"]) == 0
    for path in (folder / "made").glob("*.homographyMatrix"):
        H = HOMOGRAPHIES.read(path.read_bytes())
        X = soccer()["Side line top"].sample(5.0)
        xyw = np.column_stack([X[:, :2], np.ones(len(X))]) @ H.T
        xy = xyw[:, :2] / xyw[:, 2:]
        xy = xy[np.all((xy >= 0.0) & (xy <= np.subtract(SIZE, 1)), axis=1)]
        path.with_suffix(".json").write_text(format_annotation({"Side line top": xy} if len(xy) else {}, SIZE))
    return folder / "made"


def _camera():
    from fieldcalib import Camera

    return Camera.from_angles(0.1, 1.36, 0.0, 2000.0, (0.0, 78.0, -17.0), SIZE)


@pytest.fixture(scope="module")
def weights(frames, tmp_path_factory):
    out = tmp_path_factory.mktemp("weights")
    more = ("--width", 2, "--picture-size", 64, "--steps", 2, "--batch", 2)
    assert run("train", out, "--pictures", frames, "--homographies", frames, "--synthetic", frames, *more) == 0
    return out


def test_frames_are_those_of_their_homographies(frames):
    assert sorted(path.stem for path in frames.glob("*.jpg")) == ["0000000", "0000001", "0000002"]
    for path in frames.glob("*.jpg"):
        assert cv2.imread(str(path)).shape == (256, 256, 3)
        H = HOMOGRAPHIES.read(path.with_suffix(".homographyMatrix").read_bytes())
        middle = np.linalg.solve(H, [640.0, 500.0, 1.0])
        assert np.all(np.abs(middle[:2] / middle[2]) < (60.0, 40.0))


def test_training_writes_weights_and_log(weights):
    assert {path.name for path in weights.iterdir()} == {"guess.pt", "guess.jsonl", "error.pt", "error.jsonl"}
    (row,) = [json.loads(line) for line in (weights / "error.jsonl").read_text().splitlines()]
    assert row["step"] == 2
    assert 0.0 < row["loss"] < 1.0


@pytest.mark.parametrize("cost", ["learned", "lines"])
def test_a_run_writes_homographies_that_others_read(cost, frames, weights, tmp_path, capsys):
    images = tmp_path / "images"
    images.mkdir()
    for path in frames.glob("*.jpg"):
        (images / path.name).write_bytes(path.read_bytes())
    (images / "broken.jpg").write_bytes(b"no picture")
    out = tmp_path / "out"
    more = ("--size", "1280x720", "--weights", weights, "--cost", cost, "--steps", 3)
    assert run(images, "--out", out, *more) == 1
    assert "broken.jpg" in capsys.readouterr().err
    lines = {line["id"]: line for line in lines_of(out)}
    assert set(lines) == {"0000000", "0000001", "0000002", "broken"}
    first = lines["0000000"]
    assert first["cost"] <= first["cost_of_guess"]
    dataset = read_dataset("WC14-test", frames, SIZE, others={JIANG: out})
    estimator = Estimator.load(weights, cost)
    picture = cv2.imread(str(frames / "0000000.jpg"))
    from baselines.jiang.estimate import homographies

    (expected,) = homographies(estimator([picture], SIZE, 3).best, SIZE)
    found = dataset.homographies[JIANG][0]
    np.testing.assert_allclose(found / found[2, 2], expected / expected[2, 2], rtol=1e-3, atol=1e-3)


@pytest.mark.slow
def test_score_and_figure(frames, weights, tmp_path, capsys):
    trace = tmp_path / "trace.json"
    more = ("--weights", weights, "--steps", 10, "--trace", trace)
    assert run("score", frames, frames, *more) == 0
    row = json.loads(capsys.readouterr().out)
    assert row["frames"] == 3
    assert set(row["guess"]) == set(row["after 10 steps"]) >= {"IoU_part", "IoU_whole", "AC@5"}
    kept = json.loads(trace.read_text())
    assert np.shape(kept["cost_at_step"]) == (11, 3)
    assert np.shape(kept["iou_whole_at_step"]) == np.shape(kept["iou_part_at_step"]) == (2, 3)
    assert run("figure", tmp_path / "figure.png", trace, trace) == 0
    assert cv2.imread(str(tmp_path / "figure.png")).shape[1] > 1000


def test_spectral_normalisation_is_of_the_training(weights):
    network = ErrorNetwork(2, 64)
    kept = torch.load(weights / ERROR, weights_only=True)
    network.load_state_dict(kept["state"])
    pictures, points = torch.rand(2, 3, 64, 64), 0.3 * torch.rand(2, 4, 2)
    loaded = Estimator.load(weights).error
    torch.testing.assert_close(loaded(pictures, points), network.eval()(pictures, points))


def test_other_files_are_no_weights(weights, tmp_path, capsys):
    assert run(tmp_path, "--out", tmp_path / "out", "--weights", tmp_path) == 2
    assert "baselines.jiang train makes them" in capsys.readouterr().err
    save(ErrorNetwork(2, 32), tmp_path / "guess.pt")
    assert run(tmp_path, "--out", tmp_path / "out", "--weights", tmp_path) == 2
    assert "is no GuessNetwork" in capsys.readouterr().err
    (tmp_path / "guess.pt").write_bytes(b"something else")
    assert run(tmp_path, "--out", tmp_path / "out", "--weights", tmp_path) == 2
    assert "is no GuessNetwork" in capsys.readouterr().err


def test_pictures_without_homographies_are_no_training_data(tmp_path, capsys):
    assert run("train", tmp_path / "out", "--pictures", tmp_path, "--homographies", tmp_path) == 2
    assert "homographyMatrix" in capsys.readouterr().err
