"""data_tools.train: it learns, goes on as if it had not been interrupted, and what it writes runs elsewhere."""

import json
from copy import deepcopy
from dataclasses import asdict
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch
from torch import nn

from data_tools import score_images
from data_tools.labelled import clip_of, labelled_frames
from data_tools.network import MarkingsNet
from data_tools.onnx_model import read_network, write_model
from data_tools.simulated import observe
from data_tools.synthetic import CLASSES, SIZE, frame
from data_tools.synthetic.cache import write_cache
from data_tools.synthetic.cameras import BROADCAST
from data_tools.synthetic.frames import seen_from
from data_tools.synthetic.games import game_named
from data_tools.synthetic.hard import OVERHEAD
from data_tools.train import (
    LEARNING_RATE,
    PACKAGE,
    Training,
    _going_on,
    intersection_over_union,
    learning_rate,
    main,
)
from data_tools.training_data import (
    LOWEST_PART,
    NARROWED,
    Batches,
    mirrored_sample,
    narrowed,
    normalised,
    once_small,
    part,
    stacked,
    whole,
    window,
)
from fieldcalib import Arc, Calibration, Camera, Field, Line, Status, calibrate_from_segments, soccer
from fieldcalib.assess.findings import Verdict
from fieldcalib.cli.main import main as fieldcalib
from fieldcalib.draw.scene import render_field
from fieldcalib.fields.field import turned_camera
from fieldcalib.io.field_files import write_field
from fieldcalib.io.image_files import write_image
from fieldcalib.run_folder.record import RunRecord

STEPS = 3
SMALL = (160, 96)
MODEL = Path(__file__).parents[2] / "fieldcalib" / "models" / "soccer.onnx"
CPU = torch.device("cpu")


def advanced(training, batches, until):
    return [training.advance(*batches[step], STEPS) for step in range(training.step, until)]


def test_the_network_is_small():
    assert 0.3e6 < sum(p.numel() for p in MarkingsNet(27).parameters()) < 1.5e6


@pytest.mark.slow
def test_steps_lower_the_loss():
    training, batch = Training.begin(0, CPU), Batches(0, 2, SMALL)[0]
    losses = [training.advance(*batch, 1000) for _ in range(4)]
    assert losses[-1] < losses[0]


@pytest.mark.slow
def test_an_interrupted_training_goes_on_as_if_it_had_not_been(tmp_path):
    batches = [Batches(3, 2, SMALL)[step] for step in range(STEPS)]
    straight = Training.begin(0, CPU)
    losses = advanced(straight, batches, STEPS)

    first = Training.begin(0, CPU)
    advanced(first, batches, 1)
    first.save(tmp_path / "checkpoint.pt")
    second = Training.begin(1, CPU)
    second.load(tmp_path / "checkpoint.pt")
    assert advanced(second, batches, STEPS) == losses[1:]
    for name in ("network", "averaged"):
        expected, found = (getattr(training, name).state_dict() for training in (straight, second))
        assert all(torch.equal(expected[key], found[key]) for key in expected)


@pytest.mark.slow
def test_a_checkpoint_in_half_precision_is_small_and_nearly_the_same(tmp_path):
    first = Training.begin(0, CPU)
    first.rate = 0.5 * LEARNING_RATE
    advanced(first, [Batches(3, 2, SMALL)[step] for step in range(2)], 2)
    first.save(tmp_path / "checkpoint.pt", half=True)
    assert (tmp_path / "checkpoint.pt").stat().st_size < 10e6
    second = Training.begin(1, CPU)
    second.load(tmp_path / "checkpoint.pt")
    assert (second.step, second.rate) == (2, first.rate)
    for name in ("network", "averaged"):
        expected, found = (getattr(training, name).state_dict() for training in (first, second))
        for key, value in expected.items():
            assert found[key].dtype == value.dtype
            torch.testing.assert_close(found[key], value, rtol=1e-3, atol=1e-5)
    moments = [training.optimizer.state_dict()["state"][0] for training in (first, second)]
    torch.testing.assert_close(moments[1]["exp_avg_sq"], moments[0]["exp_avg_sq"], rtol=1e-2, atol=0.0)


def test_the_rate_of_learning_rises_and_falls():
    rates = [learning_rate(step, 1000) for step in range(1000)]
    assert np.argmax(rates) == pytest.approx(200, abs=40)
    assert rates[-1] < 1e-3 * max(rates)


@pytest.mark.slow
def test_the_command(tmp_path, monkeypatch):
    seeds = range(1_000_000_000, 1_000_000_002)
    monkeypatch.setattr("data_tools.train.VALIDATION_SEEDS", seeds)
    write_cache(tmp_path / "frames", range(2), processes=1)
    out = tmp_path / "out"
    common = [
        str(out),
        "--cache",
        str(tmp_path / "frames"),
        "--batch",
        "2",
        "--size",
        "160x96",
        "--workers",
        "0",
        "--minutes",
        "0",
    ]
    assert main(common) == 0
    assert main([*common, "--resume"]) == 0
    rows = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert [row["step"] for row in rows] == [1, 2]
    assert all(0.0 <= row["iou_synthetic"] <= 1.0 for row in rows)

    about = json.loads((out / "model.json").read_text())
    assert about["classes"] == ["background", *CLASSES]
    assert about["input_size"] == [160, 96]
    assert about["channels"] == "RGB"

    import onnxruntime

    session = onnxruntime.InferenceSession(out / "model.onnx", providers=["CPUExecutionProvider"])
    images, _ = stacked([(frame(seed).image, frame(seed).mask) for seed in seeds], SMALL)
    pixels = images.numpy().astype(np.float32).transpose(0, 2, 3, 1) / 255.0
    image = ((pixels - about["mean"]) / about["std"]).transpose(0, 3, 1, 2).astype(np.float32)
    (logits,) = session.run(["logits"], {"image": image})
    assert logits.shape == (2, 27, 48, 80)
    training = Training.begin(0, CPU)
    training.load(out / "checkpoint.pt")
    with torch.inference_mode():
        expected = training.averaged.module.eval()(normalised(images)).numpy()
    assert np.abs(logits - expected).max() < 1e-4 * max(1.0, np.abs(expected).max())


@pytest.mark.slow
def test_a_network_of_another_field(tmp_path, monkeypatch, capsys):
    """From synthetic frames to annotations by the command line."""
    monkeypatch.setattr("data_tools.train.VALIDATION_SEEDS", range(1_000_000_000, 1_000_000_002))
    frames, out, found = tmp_path / "frames", tmp_path / "out", tmp_path / "found"
    write_cache(frames, range(2), processes=1, name="tennis", truth=True)
    common = ["--batch", "2", "--size", "160x96", "--workers", "0", "--minutes", "0"]
    assert main([str(out), "--field", "tennis", "--cache", str(frames), *common]) == 0
    about = json.loads((out / "model.json").read_text())
    assert about["classes"] == ["background", *game_named("tennis").classes]
    images = sorted(map(str, frames.glob("*.jpg")))
    command = ["localize", *images, "--field", "tennis", "--model", str(out / "model.onnx"), "--out", str(found)]
    assert fieldcalib(command) == 0
    assert {path.stem for path in frames.glob("*.jpg")} <= {path.stem for path in found.glob("*.json")}
    capsys.readouterr()
    assert score_images.main(["frames", str(frames), "--field", "tennis", "--model", str(out / "model.onnx")]) == 0
    row = json.loads(capsys.readouterr().out)
    assert row["frames"] == len(list(frames.glob("camera_*.json")))
    assert row["frames"] + row["without_field"] == 2

    for wrong, message in (
        (["--field", "handball", "--cache", str(frames)], "frames of the field tennis"),
        (["--field", "tennis", "--labelled", str(frames)], "labelled points are of soccer"),
    ):
        with pytest.raises(SystemExit):
            main([str(out), *wrong, *common])
        assert message in capsys.readouterr().err


def test_a_folder_without_pictures_cannot_be_scored(tmp_path, capsys):
    assert score_images.main(["homographies", str(tmp_path), str(tmp_path)]) == 2
    assert "expected pictures named <id>.png, found none" in capsys.readouterr().err


@pytest.mark.slow
def test_views_are_scored_by_kind(monkeypatch, capsys):
    monkeypatch.setattr("data_tools.score_images.KINDS", (BROADCAST, OVERHEAD))
    assert score_images.main(["views", "--frames", "3", "--seed", "5"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [(row["view"], row["frames"]) for row in rows] == [("broadcast", 3), ("overhead", 3)]
    assert rows[0]["right"] > 50.0
    assert all(row["good_wrong"] <= row["accepted_wrong"] <= 100.0 - row["right"] for row in rows)


def test_a_camera_turned_with_the_field_is_right():
    made = seen_from(BROADCAST, 0)
    assert made.camera is not None
    for camera, expected in ((made.camera, True), (turned_camera(made.camera), True), (None, False)):
        found = Calibration(camera, Status.ACCEPTED if camera else Status.REJECTED, "", 0.0, 0.0, {}, field=made.field)
        assert score_images._is_right(found, made) == expected
    off = Camera(made.camera.K, made.camera.R, made.camera.C + (3.0, 0.0, 0.0), made.camera.image_size)
    assert not score_images._is_right(Calibration(off, Status.ACCEPTED, "", 0.0, 0.0, {}, field=made.field), made)


# data


def test_batches_are_functions_of_their_number():
    images, classes = Batches(0, 2, SMALL)[5]
    assert images.shape == (2, 3, 96, 160)
    assert images.dtype == torch.uint8
    assert classes.shape == (2, 48, 80)
    assert torch.equal(Batches(0, 2, SMALL)[5][0], images)
    assert not torch.equal(Batches(0, 2, SMALL)[6][0], images)
    assert not torch.equal(Batches(1, 2, SMALL)[5][0], images)


def test_markings_count_where_pixels_become_one():
    mask = np.zeros((4, 6), np.uint8)
    mask[1, 2], mask[3, 5] = 7, 3
    _, (classes,) = stacked([(np.zeros((4, 6, 3), np.uint8), mask)], (6, 4))
    assert classes.tolist() == [[0, 7, 0], [0, 0, 3]]


def test_images_are_rgb():
    image = np.zeros((2, 2, 3), np.uint8)
    image[..., 0] = 255  # blue
    images, _ = stacked([(image, np.zeros((2, 2), np.uint8))], (2, 2))
    assert images[0, :, 0, 0].tolist() == [0, 0, 255]


@pytest.mark.parametrize(
    ("behind_goal", "other"), [(False, "Goal right post right"), (True, "Goal left post right")], ids=["main", "goal"]
)
def test_mirroring_swaps_labels(behind_goal, other):
    mask = np.zeros((2, 3), np.uint8)
    mask[0, 0] = 1 + CLASSES.index("Goal left post left")
    image = np.arange(18, dtype=np.uint8).reshape(2, 3, 3)
    picture, swapped = mirrored_sample(image, mask, behind_goal=behind_goal)
    assert np.array_equal(picture[:, 0], image[:, 2])
    assert CLASSES[swapped[0, 2] - 1] == other
    assert np.count_nonzero(swapped) == 1


def test_what_is_no_mirror_image_of_itself_is_not_mirrored(tmp_path):
    path = tmp_path / "court.yaml"
    write_field(path, Field(8.0, 4.0, {"far": Line((-4.0, -2.0, 0.0), (4.0, -2.0, 0.0)), "hoop": Arc((2.0, 0, 0), 1)}))
    image, mask = np.arange(18, dtype=np.uint8).reshape(2, 3, 3), np.eye(2, 3, dtype=np.uint8)
    picture, same = mirrored_sample(image, mask, behind_goal=False, name=str(path))
    assert np.array_equal(picture, image)
    assert np.array_equal(same, mask)


def test_a_narrow_part_is_continued_as_the_network_sees_it():
    rows, columns = np.mgrid[:96, :160]
    image = np.stack([columns, rows, columns], axis=-1).astype(np.uint8)
    mask = columns.astype(np.uint8)
    seen = []
    for seed in range(20):
        picture, classes = narrowed(image, mask, np.random.default_rng(seed))
        assert picture.shape[:2] == classes.shape == (96, 128)  # 4:3
        (inside,) = np.nonzero(classes[0])
        part = classes[0, inside]
        assert np.array_equal(part, np.arange(part[0], part[0] + len(part)))
        assert np.array_equal(picture[:, inside, 0], classes[:, inside])
        assert abs(inside[0] - (127 - inside[-1])) <= 1
        assert np.array_equal(picture[..., 1], rows[:, :128])  # what is continued stays in its row
        seen.append(len(part) / 96)
    assert NARROWED[0] - 0.02 < min(seen) < 0.7 < 1.0 < max(seen) < NARROWED[1] + 0.02


def test_a_part_is_upright_or_about_square_and_its_classes_are_cut_with_it():
    rows, columns = np.mgrid[:96, :200]
    image, mask = np.stack([columns, rows, columns], axis=-1).astype(np.uint8), columns.astype(np.uint8)
    corners, shapes = [], []
    for seed in range(40):
        picture, classes = part(image, mask, np.random.default_rng(seed), lowest=LOWEST_PART)
        (height, width), (y, x) = classes.shape, picture[0, 0, 1::-1]
        assert np.array_equal(picture, image[y : y + height, x : x + width])
        assert np.array_equal(classes, mask[y : y + height, x : x + width])
        assert LOWEST_PART * 96 - 1 < height <= 96
        corners.append((x, y))
        shapes.append(width / height)
    assert NARROWED[0] - 0.02 < min(shapes) < 0.6 < 1.1 < max(shapes) < NARROWED[1] + 0.02
    assert np.all(np.ptp(corners, axis=0) > (100, 15))
    picture, _ = part(image, mask, np.random.default_rng(0))
    assert len(picture) == 96


@pytest.mark.parametrize(("size", "is_part"), [((96, 128), True), ((128, 96), False)], ids=["narrow", "4:3"])
def test_a_network_with_a_narrow_input_is_shown_parts_of_frames(size, is_part, tmp_path):
    write_cache(tmp_path, range(1), processes=1)
    batches = Batches(0, 2, size, sorted(tmp_path.glob("*.jpg")))
    assert batches.are_narrow == is_part
    assert batches[0][0].shape == (2, 3, *size[::-1])
    shapes = [mask.shape for _, mask in (batches._sample(np.random.default_rng(seed)) for seed in range(8))]
    are_narrow = [width < (NARROWED[1] + 0.02) * height for height, width in shapes]
    assert all(are_narrow) if is_part else not any(are_narrow)


def test_a_thumbnail_is_coarser_and_in_its_place():
    image = np.full((288, 512, 3), 40, np.uint8)
    image[100:103, 200:202] = 255
    picture = once_small(image, np.random.default_rng(0))
    assert picture.shape == image.shape
    assert 60 < picture.max() < 255
    light = picture[..., 0] - 40.0
    assert light.sum(axis=0) @ np.arange(512) / light.sum() == pytest.approx(200.5, abs=1.5)


def test_the_measure_is_one_for_a_perfect_network():
    made = frame(1)

    def knowing(images):
        _, classes = stacked([(made.image, made.mask)], SIZE)
        return torch.nn.functional.one_hot(classes, 27).permute(0, 3, 1, 2)

    knowing.eval = lambda: None
    values = intersection_over_union(knowing, [(made.image, made.mask)], SIZE, CPU)
    assert np.nanmin(values) == 1.0
    assert np.isfinite(values).sum() == len(np.unique(made.mask)) - 1


# real frames


def test_clips():
    assert clip_of(Path("folder/video_1_120_png_jpg.rf.ab.jpg")) == "video_1"
    assert clip_of(Path("folder/worldcup2_10_jpg.rf.ab.jpg")) == "worldcup2"


@pytest.mark.slow
def test_real_frames_have_cameras_that_their_points_agree_on(shared_data):
    frames = list(labelled_frames(shared_data / "pitch-keypoints" / "valid"))
    assert len(frames) > 40
    image, mask = whole(frames[0])
    assert image.shape == (288, 512, 3)
    assert len(np.unique(mask)) > 3
    image, mask = window(frames[0], np.random.default_rng(0))
    assert image.shape == (288, 512, 3)


# going on from a network that is there


@pytest.fixture(scope="module")
def shipped():
    """The network of the package rebuilt on some images, and these."""
    noise = torch.from_numpy(np.random.default_rng(0).normal(size=(4, 3, 96, 160)).astype(np.float32))
    images = 3.0 * torch.nn.functional.avg_pool2d(noise, 5, 1, 2)
    return *read_network(MODEL, images), images


def test_the_network_of_the_package_is_rebuilt(shipped):
    network, classes, images = shipped
    assert tuple(classes) == CLASSES
    session = onnxruntime.InferenceSession(str(MODEL))
    others = torch.nn.functional.interpolate(images[:2], size=(192, 320))
    (expected,) = session.run(None, {"image": others.numpy()})
    with torch.inference_mode():
        found = network.eval()(others).numpy()
    assert np.abs(expected).max() > 1.0
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_normalising_by_the_batch_it_was_measured_on_changes_nothing(shipped):
    network, _, images = shipped
    copy = deepcopy(network)
    with torch.no_grad():
        expected, found = copy.eval()(images), copy.train()(images)
    np.testing.assert_allclose(found.numpy(), expected.numpy(), atol=1e-3)


def test_every_weight_of_a_rebuilt_network_learns(shipped):
    network, _, images = shipped
    copy = deepcopy(network).train()
    copy(images).square().mean().backward()
    assert all(float(p.grad.abs().max()) > 0.0 for p in copy.parameters())


@pytest.mark.slow
def test_a_network_of_another_field_begins_with_the_features_of_the_package(shipped):
    network, _, _ = shipped
    classes = game_named("tennis").classes
    training = _going_on(PACKAGE, classes, SMALL, "tennis", CPU, 0)
    assert training.network.head.out_channels == 1 + len(classes)
    assert training.rate == LEARNING_RATE
    begun, of_package = training.network.state_dict(), network.state_dict()
    convolutions = [key for key, value in begun.items() if value.ndim == 4 and not key.startswith("head.")]
    assert len(convolutions) > 40
    for key in convolutions:
        torch.testing.assert_close(begun[key], of_package[key])


def test_another_network_is_not_rebuilt(tmp_path):
    write_model(nn.Conv2d(3, 27, 1).eval(), tmp_path / "other.onnx", CLASSES, SMALL)
    with pytest.raises(ValueError, match="is no network of data_tools"):
        read_network(tmp_path / "other.onnx", torch.zeros(1, 3, 64, 96))


def test_good_pictures_of_a_folder_of_results_are_labelled_frames(tmp_path):
    camera = Camera.from_angles(0.1, 1.3, 0.0, 900.0, (0.0, 60.0, -16.0), (480, 270))
    pixels = observe(camera, soccer(), np.random.default_rng(0), 0.3, (10, 10))
    good = calibrate_from_segments(soccer(), pixels, camera.image_size)
    unsure = Calibration(camera, Status.ACCEPTED, "", 0.0, 0.0, {}, field=soccer())
    assert (good.verdict, unsure.verdict) == (Verdict.GOOD, Verdict.CHECK)
    results = {}
    for name, one in (("a", good), ("b", unsure)):
        write_image(tmp_path / f"{name}.png", render_field(camera, soccer(), rng=np.random.default_rng(0)))
        results[name] = {"id": name, **one.to_dict(), "verdict": one.verdict}
    folder = tmp_path / "results"
    folder.mkdir()
    (folder / "cameras.jsonl").write_text("".join(json.dumps(one) + "\n" for one in results.values()))
    source = [str(tmp_path / f"{name}.png") for name in "ab"]
    record = RunRecord("run", {}, 2, "", "", 1, None, (), source=source)
    (folder / "run.json").write_text(json.dumps(asdict(record)))
    frames = list(labelled_frames(folder))
    assert [one.image.name for one in frames] == ["a.png"]
    image, mask = whole(frames[0])
    assert image.shape[:2] == mask.shape
    assert mask.any()


def test_a_folder_without_pictures_is_told(tmp_path):
    with pytest.raises(ValueError, match="expected results of fieldcalib open, or"):
        list(labelled_frames(tmp_path))
