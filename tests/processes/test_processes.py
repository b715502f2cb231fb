"""An executor of processes, and results in order by any executor."""

import os
import signal
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import cache, partial
from multiprocessing import get_context

import cv2
import numpy as np
import pytest
from networks import CLASSES, FIELD, band_maps, probabilities
from synthetic import random_frames
from views import camera
from waiting import wait_until

from fieldcalib import calibrate_batch, calibrate_from_images, soccer
from fieldcalib.draw.scene import render_field
from fieldcalib.localize import localize
from fieldcalib.processes.jobs import Processes, in_order
from fieldcalib.processes.other_process import ProcessEndedError
from fieldcalib.processes.threads import ONE_THREAD

TRUTH = camera(24, 78, 700, (0, 68, -17)).scaled((480, 270))


def square(number):
    return number * number


def late_square(number):
    time.sleep(0.02 * (number % 3))
    return number * number


def unless_seven(number):
    if number == 7:
        os._exit(3)
    return number


def wait_for_the_kill(folder):
    (folder / str(os.getpid())).touch()
    time.sleep(60)


@pytest.fixture(scope="module")
def processes():
    with Processes(2) as executor:
        yield executor


def test_tasks_run_in_so_many_other_processes(processes):
    pids = {future.result() for future in [processes.submit(os.getpid) for _ in range(20)]}
    assert os.getpid() not in pids
    assert 1 <= len(pids) <= 2


def test_libraries_use_one_thread(processes):
    assert processes.submit(cv2.getNumThreads).result() == 1
    for name in ONE_THREAD:
        assert processes.submit(os.getenv, name).result() == "1"


def test_a_task_raises_its_error_and_the_next_ones_run(processes):
    with pytest.raises(ValueError, match="invalid literal"):
        processes.submit(int, "three").result()
    assert processes.submit(int, "3").result() == 3


def test_a_process_that_ends_takes_only_its_task_with_it(processes):
    futures = [processes.submit(unless_seven, number) for number in range(20)]
    with pytest.raises(ProcessEndedError) as raised:
        futures[7].result()
    assert raised.value.exit_code == 3
    assert [future.result() for number, future in enumerate(futures) if number != 7] == [*range(7), *range(8, 20)]


def test_a_process_that_is_killed(processes, tmp_path):
    future = processes.submit(wait_for_the_kill, tmp_path)
    wait_until(lambda: any(tmp_path.iterdir()))
    (said,) = tmp_path.iterdir()
    os.kill(int(said.name), signal.SIGKILL)
    with pytest.raises(ProcessEndedError, match="exit code -9"):
        future.result(timeout=60)
    assert processes.submit(square, 3).result() == 9


def test_an_error_ends_the_processes_at_once():
    began = time.monotonic()

    def interrupted():
        with Processes(1) as executor:
            future = executor.submit(time.sleep, 60)
            executor.submit(time.sleep, 60)
            wait_until(future.running)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - began < 20.0


def test_the_end_waits_for_what_is_done():
    with Processes(1) as executor:
        future = executor.submit(late_square, 2)
    assert future.result() == 4


def test_no_processes():
    with pytest.raises(ValueError, match="jobs must be a whole number from 1, got 0"):
        Processes(0)


# --- in order ---


EXECUTORS = {
    "here": None,
    "threads": partial(ThreadPoolExecutor, 3),
    "multiprocessing": partial(ProcessPoolExecutor, 2, get_context("spawn")),
    "ours": partial(Processes, 2),
}


@pytest.mark.parametrize(
    "make",
    [
        pytest.param(make, id=name, marks=pytest.mark.slow if name == "multiprocessing" else ())
        for name, make in EXECUTORS.items()
    ],
)
def test_results_are_in_order_whatever_the_executor(make):
    numbers = range(40)
    if make is None:
        assert list(in_order(None, late_square, numbers)) == [n * n for n in numbers]
        return
    with make() as executor:
        assert list(in_order(executor, late_square, numbers, ahead=5)) == [n * n for n in numbers]


@pytest.mark.slow
def test_dask():
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True) as cluster,
        Client(cluster) as client,
    ):
        executor = client.get_executor()
        assert list(in_order(executor, late_square, range(20), ahead=5)) == [n * n for n in range(20)]
        frames, _ = random_frames(3, seed=13, noise=1.0)
        found = calibrate_batch(soccer(), frames, (960, 540), executor=executor)
        assert found == calibrate_batch(soccer(), frames, (960, 540))


def test_what_is_no_executor():
    with pytest.raises(ValueError, match=r"expected an executor, as fieldcalib.processes.Processes\(2\), got 4"):
        list(in_order(4, square, [1]))


def test_only_some_items_are_taken_in_advance():
    taken = []

    def items():
        for number in range(1000):
            taken.append(number)
            yield number

    with ThreadPoolExecutor(2) as executor:
        results = in_order(executor, square, items(), ahead=4)
        assert [next(results) for _ in range(10)] == [n * n for n in range(10)]
        assert len(taken) <= 10 + 4
        results.close()
    assert len(taken) <= 10 + 4


def test_what_a_process_could_not_do_is_rescued():
    with Processes(2) as executor:
        rescue = lambda item, error: (item, error.exit_code)  # noqa: E731
        assert list(in_order(executor, unless_seven, range(5, 10), rescue=rescue)) == [5, 6, (7, 3), 8, 9]
        with pytest.raises(ProcessEndedError):
            list(in_order(executor, unless_seven, range(5, 10)))


def test_other_errors_are_raised():
    with ThreadPoolExecutor(2) as executor:
        results = in_order(executor, int, ["1", "2", "three", "4"])
        assert [next(results), next(results)] == [1, 2]
        with pytest.raises(ValueError, match="three"):
            next(results)


# --- what is calibrated with an executor ---


@cache
def seen():
    return probabilities(band_maps(TRUTH))


class Seeing:
    """A network that finds the same camera in every image, wherever it runs."""

    classes = CLASSES

    def __call__(self, images):
        return np.stack([seen()] * len(images))


@pytest.fixture(scope="module")
def images():
    """A batch of two images, and one more."""
    image = render_field(TRUTH, FIELD, rng=np.random.default_rng(0))
    with pytest.MonkeyPatch.context() as patch:
        for module in ("images.from_images", "localize.network"):
            patch.setattr(f"fieldcalib.{module}.IMAGES_AT_ONCE", 2)
        yield [np.roll(image, shift, axis=0) for shift in range(0, 6, 2)]


@pytest.fixture(scope="module")
def calibrated_here(images):
    return calibrate_from_images(FIELD, images, Seeing())


@pytest.fixture(scope="module")
def localized_here(images):
    return localize(FIELD, images, Seeing())


@pytest.mark.slow
@pytest.mark.parametrize("make", [partial(ThreadPoolExecutor, 2), partial(Processes, 2)], ids=["threads", "processes"])
def test_images_are_calibrated_the_same_by_any_executor(images, calibrated_here, localized_here, make):
    assert calibrated_here[0].accepted
    with make() as executor:
        assert calibrate_from_images(FIELD, images, Seeing(), executor=executor) == calibrated_here
        localized = localize(FIELD, images, Seeing(), executor=executor)
    assert len(localized) == len(images)
    assert [one.pixels.keys() for one in localized] == [one.pixels.keys() for one in localized_here]
