"""Items that a thread reads in advance."""

import threading
import time

import pytest

from fieldcalib.io.image_files import AHEAD, MOST_WAITING, Newest, read_ahead


class Source:
    """Numbers, which remember how many were asked for."""

    def __init__(self, count, error=None):
        self.count, self.error, self.asked, self.closed = count, error, 0, False

    def __iter__(self):
        try:
            for number in range(self.count):
                self.asked += 1
                yield number
            if self.error is not None:
                raise self.error
        finally:
            self.closed = True


def settled(source, least=0):
    """How many items were asked for when no more are, after at least so many."""
    end, before = time.monotonic() + 5.0, -1
    while (source.asked < least or source.asked != before) and time.monotonic() < end:
        before = source.asked
        time.sleep(0.05)
    return source.asked


@pytest.fixture(autouse=True)
def no_thread_is_left():
    before = set(threading.enumerate())
    yield
    left = [thread for thread in threading.enumerate() if thread not in before]
    for thread in left:
        thread.join(10.0)
    assert not any(thread.is_alive() for thread in left)


@pytest.mark.parametrize("count", [0, 1, AHEAD, 500])
def test_the_same_items_in_order(count):
    source = Source(count)
    assert list(read_ahead(source)) == list(range(count))
    assert source.closed


def test_items_that_look_like_an_end_are_items():
    assert list(read_ahead([None, False, 0, None])) == [None, False, 0, None]
    assert next(iter(read_ahead([ValueError("an item")]))).args == ("an item",)


@pytest.mark.parametrize("error", [ValueError("broken frame"), KeyboardInterrupt(), SystemExit(3), MemoryError()])
def test_exceptions_come_after_the_items_before_them(error):
    items = read_ahead(Source(10, error))
    assert [next(items) for _ in range(10)] == list(range(10))
    with pytest.raises(type(error)) as raised:
        next(items)
    assert raised.value is error


def test_what_cannot_be_iterated_is_an_error():
    with pytest.raises(TypeError, match="not iterable"):
        list(read_ahead(5))


@pytest.mark.parametrize("count", [1, 3, AHEAD])
def test_no_more_than_so_many_are_in_memory(count):
    source = Source(1000)
    items = read_ahead(source, count)
    assert settled(source) == 0  # nothing is read before the first one is wanted
    for taken in range(1, 6):
        next(items)
        least = taken + count
        assert least <= settled(source, least) <= least + 1  # the reader holds one that does not fit yet
    items.close()


def test_closing_early_stops_the_reader():
    source = Source(10**9)
    items = read_ahead(source, 2)
    assert next(items) == 0
    items.close()
    asked = source.asked
    assert asked <= 4
    assert settled(source) == asked
    assert list(items) == []


def test_an_error_in_the_consumer_stops_the_reader():
    source = Source(10**9)

    def consume():
        for item in read_ahead(source, 2):
            if item == 3:
                raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        consume()
    assert settled(source) <= 8


def test_the_newest_items_are_kept_in_order_and_the_others_are_counted():
    came = threading.Event()

    def items():
        yield from range(20)
        came.set()

    newest = Newest(items())
    seen = []
    for item, arrived in newest:
        assert came.wait(60.0)
        assert arrived <= time.monotonic()
        seen.append(item)
    assert seen[-MOST_WAITING:] == list(range(20 - MOST_WAITING, 20))
    assert seen == sorted(seen)
    assert newest.dropped == 20 - len(seen) >= 20 - MOST_WAITING - 1


def test_an_error_of_a_camera_comes_after_what_came_before():
    def items():
        yield 0
        raise ZeroDivisionError("the cable")

    seen = []
    with pytest.raises(ZeroDivisionError, match="the cable"):
        seen.extend(item for item, _ in Newest(items()))
    newest = iter(Newest(items()))
    assert next(newest)[0] == 0
    with pytest.raises(ZeroDivisionError, match="the cable"):
        next(newest)
