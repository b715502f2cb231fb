"""A file is written whole or not at all."""

import os
import stat

import pytest

from fieldcalib.io import files
from fieldcalib.io.files import write_bytes, write_text

both = pytest.mark.parametrize(("write", "content"), [(write_text, "new"), (write_bytes, b"new")])


@both
def test_content_replaces_what_was_there(tmp_path, write, content):
    path = tmp_path / "a.json"
    path.write_text("a much longer content of old")
    write(path, content)
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_text_is_written_in_utf8_with_its_own_line_ends(tmp_path):
    write_text(tmp_path / "a.txt", "Größe\n20°\r\n")
    assert (tmp_path / "a.txt").read_bytes() == b"Gr\xc3\xb6\xc3\x9fe\n20\xc2\xb0\r\n"


@both
def test_who_reads_the_old_file_keeps_on_reading_it(tmp_path, write, content):
    path = tmp_path / "a.json"
    path.write_text("old")
    with path.open() as reader:
        write(path, content)
        assert reader.read() == "old"


def failing(*arguments):
    raise OSError("no space left on device")


def interrupted(*arguments):
    raise KeyboardInterrupt


@both
@pytest.mark.parametrize("step", ["fdopen", "chmod", "replace"])
@pytest.mark.parametrize("failure", [failing, interrupted])
def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, write, content, step, failure):
    path = tmp_path / "a.json"
    path.write_text("old")
    original = getattr(files.os, step)

    def fail(handle, *arguments):
        if step == "fdopen":  # the file opens, and writing to it fails
            with original(handle, *arguments) as file:
                file.write(b"ne")
        failure()

    monkeypatch.setattr(files.os, step, fail)
    with pytest.raises((OSError, KeyboardInterrupt)):
        write(path, content)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("write", "content"), [(write_text, "half \ud800"), (write_bytes, "no bytes")])
def test_content_that_cannot_be_written(tmp_path, write, content):
    path = tmp_path / "a.json"
    path.write_text("old")
    with pytest.raises((UnicodeEncodeError, TypeError)):
        write(path, content)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_missing_folder_is_not_made(tmp_path):
    with pytest.raises(FileNotFoundError):
        write_text(tmp_path / "missing" / "a.json", "new")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def umask():
    """Sets the umask, and puts the old one back."""
    old = os.umask(0o022)
    yield os.umask
    os.umask(old)


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX permissions")
@both
@pytest.mark.parametrize(("mask", "mode"), [(0o022, 0o644), (0o027, 0o640), (0o002, 0o664), (0o077, 0o600)])
def test_permissions_follow_the_umask(tmp_path, umask, write, content, mask, mode):
    umask(mask)
    write(tmp_path / "a.json", content)
    assert stat.S_IMODE((tmp_path / "a.json").stat().st_mode) == mode
    assert umask(0o022) == mask  # writing did not change it
