"""A file of lines that grows, and is repaired after an end at any moment."""

import os

import pytest

from fieldcalib.io.output_folder import LineLog, whole_lines


@pytest.mark.parametrize("cut", range(0, 13))
def test_a_torn_line_is_removed(tmp_path, cut):
    path, content = tmp_path / "log", b"one\nzwei\ndrei\n"
    path.write_bytes(content[:cut])
    whole = content[:cut].rpartition(b"\n")[0]
    with LineLog(path) as log:
        log.append("vier")
    assert path.read_bytes().split() == [*whole.split(), b"vier"]
    assert path.read_bytes().endswith(b"\nvier\n") or not whole


def test_so_many_lines_are_kept(tmp_path):
    path = tmp_path / "log"
    path.write_text("one\ntwo\nthree\nfo")
    with LineLog(path, 2):
        pass
    assert path.read_text() == "one\ntwo\n"
    assert list(whole_lines(path)) == [b"one\n", b"two\n"]


def test_a_line_is_there_at_once(tmp_path):
    path = tmp_path / "log"
    with LineLog(path) as log:
        log.append("é" * 50_000)
        assert path.read_text() == "é" * 50_000 + "\n"


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX limits")
def test_nothing_of_a_line_that_has_no_room_is_left(tmp_path):
    import resource
    import signal

    path = tmp_path / "log"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with LineLog(path) as log:
            log.append("a" * 600)
            with pytest.raises(OSError, match="File too large"):
                log.append("b" * 600)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert path.read_text() == "a" * 600 + "\n"
