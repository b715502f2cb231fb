"""Speed and memory of all that runs frame by frame: `pytest tests/bench_speed.py -n0`. Not in the default run.

Frames are synthetic, or SoccerNet's annotations where they lie beside the checkout.
"""

import os
import resource
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path

import cv2
import numpy as np
import pytest
from commands import PEAK
from networks import CLASSES, band_maps, probabilities
from synthetic import random_frames
from views import BROADCAST

from fieldcalib import SegmentationNetwork, calibrate_batch, calibrate_from_images, calibrate_from_segments, soccer
from fieldcalib.draw.scene import render_field
from fieldcalib.images import refine_on_image
from fieldcalib.io.image_files import parse_image
from fieldcalib.io.soccernet import format_annotation, parse_annotation
from fieldcalib.localize import ridge_points
from fieldcalib.metrics import evaluate_segments
from fieldcalib.processes import Processes
from fieldcalib.solve import compute_errors
from fieldcalib.solve.solver_options import PINHOLE_FLAGS, CalibrationFlags

FIELD, SIZE = soccer(), (960, 540)


@pytest.fixture(autouse=True)
def _one_process(request):
    if hasattr(request.config, "workerinput"):
        pytest.fail("pytest-xdist runs tests side by side, which is no measurement of speed: add -n0")


@pytest.fixture(scope="module")
def frames():
    return random_frames(500, seed=0, noise=1.0, stands=("main center",))[0]


@pytest.fixture(scope="module")
def annotated(shared_data):
    files = sorted(f for f in (shared_data / "sncalib-test-center").glob("*.json") if f.stem.isdigit())
    return [parse_annotation(f.read_text(), SIZE) for f in files]


@pytest.fixture(scope="module")
def images(shared_data):
    """Frames of many matches, enlarged to 1920x1080."""
    files = sorted((shared_data / "sncalib-images").rglob("*.jpg"))[:40]
    return [cv2.resize(parse_image(file.read_bytes()), (1920, 1080)) for file in files]


@pytest.fixture
def say(request, capsys):
    """Print a result although pytest captures what tests print."""

    def print_result(result):
        with capsys.disabled():
            print(f"\n{request.node.name}: {result}")

    return print_result


def milliseconds_a_frame(benchmark, count):
    return 1e3 * benchmark.stats.stats.median / count


@pytest.mark.parametrize("count", [1, 10, 100, 1000, 5000])
def test_batch(benchmark, frames, count, say):
    many = [frames[t % len(frames)] for t in range(count)]
    benchmark.pedantic(calibrate_batch, (FIELD, many, SIZE), rounds=1 if count > 500 else 5, warmup_rounds=1)
    say(f"{milliseconds_a_frame(benchmark, count):.2f} ms a frame")


def test_annotated_batch_with_all_starts(benchmark, annotated, say):
    benchmark.pedantic(calibrate_batch, (FIELD, annotated, SIZE), rounds=5, warmup_rounds=1)
    taken = milliseconds_a_frame(benchmark, len(annotated))
    say(f"{taken:.2f} ms a frame")
    assert taken <= 6.0


def test_annotated_batch_by_two_processes(benchmark, annotated, say):
    with Processes(2) as executor:
        how = {"executor": executor}
        benchmark.pedantic(calibrate_batch, (FIELD, annotated, SIZE), how, rounds=5, warmup_rounds=2)
    say(f"{milliseconds_a_frame(benchmark, len(annotated)):.2f} ms a frame")


def test_errors_of_an_annotated_batch(benchmark, annotated, say):
    """Uncertainty, probability and verdict of every frame."""

    def calibrated():
        return (calibrate_batch(FIELD, annotated, SIZE),), {}

    benchmark.pedantic(compute_errors, setup=calibrated, rounds=3, warmup_rounds=1)
    say(f"{milliseconds_a_frame(benchmark, len(annotated)):.2f} ms a frame")


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("count", [100, 1000, 10_000, 100_000])
def test_command_line(frames, count, jobs, tmp_path, say):
    """Time of a frame and peak memory of `calibrate`, everything written."""
    (tmp_path / "in").mkdir()
    contents = [format_annotation(frame, SIZE) for frame in frames]
    for number in range(count):
        (tmp_path / "in" / f"{number:06d}.json").write_text(contents[number % len(contents)])
    command = [sys.executable, "-c", PEAK, "fieldcalib.cli.main", "calibrate", tmp_path / "in", "--size", "960x540"]
    start = time.perf_counter()
    done = subprocess.run(
        [*map(str, command), "--out", str(tmp_path / "out"), "--jobs", str(jobs)],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[1],
    )
    taken, peak = 1e3 * (time.perf_counter() - start) / count, float(done.stdout.splitlines()[-1])
    say(f"{taken:.2f} ms a frame, {peak:.0f} MiB")
    assert peak < 500.0


@pytest.fixture(scope="module")
def environment(shared_data, tmp_path_factory):
    """The environment of commands after a first run: what Python and Numba compile is on the disk, as users have it."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    picture = next((shared_data / "offside-stills").glob("*.jpg"))
    command = [sys.executable, "-m", "fieldcalib", "run", str(picture), "--out", str(tmp_path_factory.mktemp("first"))]
    subprocess.run(command, capture_output=True, check=True, cwd=Path(__file__).parents[1], env=kept)
    return kept


@pytest.mark.parametrize("draws", [False, True], ids=["", "drawn"])
@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("clips/city-united.mp4", 268),  # 1280x720
        ("clips/roma.mp4", 211),  # 1920x1080
        ("sncalib-images", 47),  # 960x540
        ("offside-stills", 51),  # 1920x1080
    ],
)
def test_run_command(shared_data, environment, source, count, draws, tmp_path, say):
    """Time and processor time of a frame with `run`, from a cold start of Python to the last file."""
    options = ["--out", str(tmp_path / "out"), *([] if draws else ["--no-pictures"])]
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "fieldcalib", "run", str(shared_data / source), *options]
    subprocess.run(command, capture_output=True, check=True, cwd=Path(__file__).parents[1], env=environment)
    taken, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    say(f"{1e3 * taken / count:.0f} ms a frame, {1e3 * processor / count:.0f} ms of a processor")


def test_one_cold_frame(benchmark, frames):
    calls = iter(frames)
    benchmark.pedantic(
        lambda frame: calibrate_from_segments(FIELD, frame, SIZE),
        setup=lambda: ((next(calls),), {}),
        rounds=100,
        warmup_rounds=3,
    )
    assert benchmark.stats.stats.median <= 0.030


@pytest.mark.parametrize("pixels", [5.0, 20.0])
def test_one_frame_from_a_given_start(benchmark, frames, pixels):
    """A start whose image is off by some pixels, as the camera of an earlier frame would be."""
    flags = PINHOLE_FLAGS | CalibrationFlags.CALIB_USE_INTRINSIC_GUESS | CalibrationFlags.CALIB_USE_EXTRINSIC_GUESS
    rng = np.random.default_rng(0)
    starts = []
    for frame in frames[:110]:
        _, K, dist, rvec, tvec = calibrate_from_segments(FIELD, frame, SIZE, flags=PINHOLE_FLAGS)
        turn = rng.normal(size=3)
        turn *= pixels / K[0, 0] / np.linalg.norm(turn)
        starts.append((frame, K, dist, rvec + turn[:, None], tvec))
    calls = iter(starts)
    benchmark.pedantic(
        lambda frame, K, dist, rvec, tvec: calibrate_from_segments(
            FIELD, frame, SIZE, K, dist, rvec, tvec, flags=flags
        ),
        setup=lambda: (next(calls), {}),
        rounds=100,
        warmup_rounds=3,
    )
    if pixels <= 5.0:
        assert benchmark.stats.stats.median <= 0.012


def test_points_on_ridges(benchmark):
    """26 classes at 256x144."""
    maps = probabilities(band_maps(BROADCAST, (256, 144)), np.random.default_rng(0), noise=0.5)
    benchmark.pedantic(ridge_points, (maps, CLASSES, FIELD, SIZE), rounds=50, warmup_rounds=3)
    assert benchmark.stats.stats.median <= 0.005


def test_refinement_in_full_hd(benchmark):
    truth = BROADCAST.scaled((1920, 1080))
    image = render_field(truth, FIELD, rng=np.random.default_rng(0))
    found = ridge_points(probabilities(band_maps(truth)), CLASSES, FIELD, truth.image_size)
    start = calibrate_from_segments(FIELD, found.pixels, truth.image_size, weights=found.weights)
    benchmark.pedantic(refine_on_image, (FIELD, image, start), rounds=20, warmup_rounds=2)
    assert benchmark.stats.stats.median <= 0.060


@pytest.mark.parametrize("processes", [1, 2])
def test_images_in_full_hd(benchmark, images, processes, one_thread, say):
    """Images that have nothing to do with one another, network and refinement included."""
    network = SegmentationNetwork.load(threads=1)
    with nullcontext() if processes == 1 else Processes(processes) as executor:
        how = {"executor": executor}
        benchmark.pedantic(calibrate_from_images, (FIELD, images, network), how, rounds=3, warmup_rounds=1)
    say(f"{milliseconds_a_frame(benchmark, len(images)):.1f} ms an image")


def test_evaluation_of_728_frames(benchmark, say):
    """As many as the half of SN-Calib-test-center; SoccerNet's evaluation takes about 0.3 s a frame."""
    frames, cameras = random_frames(364, seed=0, noise=3.0, stands=("main center",))
    benchmark.pedantic(evaluate_segments, (2 * cameras, 2 * frames, SIZE), rounds=3, warmup_rounds=1)
    say(f"{milliseconds_a_frame(benchmark, 728):.2f} ms a frame")
    assert benchmark.stats.stats.median <= 5.0


def test_memory_of_5000_frames(benchmark, say):
    """Peak memory of a fresh process that calibrates 5000 frames, in MiB."""
    script = (
        f"import resource, sys; sys.path[:0] = [{str(Path(__file__).parent)!r}]\n"
        "from bench_speed import FIELD, SIZE, calibrate_batch, random_frames\n"
        "frames = random_frames(200, seed=0, noise=1.0)[0]\n"
        "calibrate_batch(FIELD, 25 * frames, SIZE)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)\n"
    )

    def peak():
        run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
        return int(run.stdout)

    peak_mib = benchmark.pedantic(peak, rounds=1)
    say(f"{peak_mib} MiB")
    assert peak_mib < 1024
