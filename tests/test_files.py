"""Files of frames are found in folders and zips; a file is written whole or not at all."""

import os
import re
import stat
import zipfile

import pytest

from fieldcalib.io import files
from fieldcalib.io.files import BrokenFileError, find_files, parse_json_object, write_bytes, write_text

# --- finding and reading ---


def names_found(*inputs, **options):
    return [file.id for file in find_files(inputs, "mask", **({"prefix": "mask_", "suffix": ".png"} | options))]


def test_prefix_and_suffix_make_the_name(tmp_path):
    for name in ("mask_2.png", "mask_1.b.png", "2.png", "mask_2.jpg", "old_mask_3.png", "mask_draft.png"):
        (tmp_path / name).write_bytes(b"")
    assert names_found(tmp_path) == ["1.b", "2", "draft"]
    assert names_found(tmp_path, others=re.compile("mask_d")) == ["1.b", "2"]
    assert names_found(tmp_path, prefix="") == ["2", "mask_1.b", "mask_2", "mask_draft", "old_mask_3"]
    # a single file is taken whatever it is called
    assert names_found(tmp_path / "mask_2.jpg", tmp_path / "old_mask_3.png") == ["2", "old_mask_3"]


def test_hidden_files_and_those_of_macos_are_left_out(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for name in ("a/1.png", "a/.2.png", "__MACOSX/a/1.png", "__MACOSX/a/3.png"):
            archive.writestr(name, name)
    (file,) = find_files([tmp_path / "a.zip"], "mask", suffix=".png")
    assert (file.id, file.read()) == ("1", b"a/1.png")


def test_messages_say_what_is_looked_for(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"holds no mask: expected files named mask_<id>\.png"):
        names_found(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"missing does not exist: expected a folder, a zip or a \.png file"):
        names_found(tmp_path / "missing")
    (tmp_path / "mask_1.png").write_bytes(b"")
    with pytest.raises(BrokenFileError, match=r"are the same frame 1: rename one of them"):
        names_found(tmp_path, tmp_path / "mask_1.png")


@pytest.mark.parametrize(
    ("content", "message"),
    [("{", "is no JSON: "), (b"\xff", "is no JSON: 'utf-8' codec"), ("3", "expected a JSON object of masks, got int")],
)
def test_what_is_no_json_object(content, message):
    with pytest.raises(BrokenFileError, match=message):
        parse_json_object(content, "masks")


# --- writing ---

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
