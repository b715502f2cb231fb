"""Files of frames are found in folders and zips; a file is written whole or not at all."""

import os
import re
import stat
import tracemalloc
import zipfile

import numpy as np
import pytest

from fieldcalib._whole_files import write_bytes, write_text
from fieldcalib.io import files
from fieldcalib.io.files import BrokenFileError, files_beside, find_files, parse_json_object
from fieldcalib.io.formats import IMAGES
from fieldcalib.io.image_files import write_image
from fieldcalib.io.output_folder import LineLog
from fieldcalib.io.videos import VideoReader

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


def test_images_that_differ_in_their_ending_are_different_frames(tmp_path):
    for name in ("a.jpg", "a.png", "b.jpg", "c.JPG", "c.jpg"):
        (tmp_path / name).write_bytes(b"")
    assert [file.id for file in IMAGES.find([tmp_path])] == ["a.jpg", "a.png", "b", "c.JPG", "c.jpg"]
    assert [file.id for file in IMAGES.find([tmp_path / "b.jpg", tmp_path / "a.jpg"])] == ["b", "a"]
    with pytest.raises(BrokenFileError, match=r"are the same frame b: rename one of them"):
        IMAGES.find([tmp_path, tmp_path / "b.jpg"])
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "b.png").write_bytes(b"")
    with pytest.raises(BrokenFileError, match=r"are the same frame b: rename one of them"):
        IMAGES.find([tmp_path, tmp_path / "other"])


def test_a_zip_may_name_its_members_as_it_likes(tmp_path):
    """The standard library's `zipfile.Path` never ends on a name with two slashes in front."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for name in ("//x.png", "/y.png", "../../z.png", "folder.png/", ".."):
            archive.writestr(name, name)
    found = find_files([tmp_path / "a.zip"], "mask", suffix=".png")
    assert {file.id: file.read() for file in found} == {"x": b"//x.png", "y": b"/y.png", "z": b"../../z.png"}
    assert all(str(file.path).startswith(str(tmp_path / "a.zip")) for file in found)


def test_what_is_not_used_is_known(tmp_path):
    for name in ("mask_1.png", "2.png", "mask_3.gif", ".hidden"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "deeper").mkdir()
    with zipfile.ZipFile(tmp_path / "in.zip", "w") as archive:
        for name in ("a/mask_4.png", "a/b.heic", "__MACOSX/a/b.heic"):
            archive.writestr(name, "")
    inputs = [tmp_path, tmp_path / "in.zip"]
    found = find_files(inputs, "mask", prefix="mask_", suffix=".png")
    beside = [str(path.relative_to(tmp_path)) for path in files_beside(inputs, found)]
    assert beside == ["2.png", "in.zip", "mask_3.gif", "in.zip/a/b.heic"]
    assert files_beside([tmp_path / "2.png"], []) == []


@pytest.mark.timeout(20)  # a pipe would be waited for
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_only_regular_files_are_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "endless.png").symlink_to("/dev/zero")
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "regular.png").write_bytes(b"content")
    (tmp_path / "link.png").symlink_to("regular.png")
    contents = {}
    for file in find_files([tmp_path], "mask", suffix=".png"):
        try:
            contents[file.id] = file.read()
        except BrokenFileError as error:
            contents[file.id] = str(error)
    nothing = dict.fromkeys(("pipe", "endless", "folder"), "cannot be read: it is no regular file")
    assert contents == {"regular": b"content", "link": b"content", **nothing}
    os.mkfifo(tmp_path / "pipe.zip")
    with pytest.raises(BrokenFileError, match="it is no regular file"):
        find_files([tmp_path / "pipe.zip"], "mask", suffix=".png")[0].read()


METHODS = {"deflate": zipfile.ZIP_DEFLATED, "bzip2": zipfile.ZIP_BZIP2, "lzma": zipfile.ZIP_LZMA}


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_a_corrupt_member_is_broken_whatever_packed_it(tmp_path, method):
    noise = np.random.default_rng(0).bytes(5000)
    with zipfile.ZipFile(tmp_path / "a.zip", "w", method) as archive:
        archive.writestr("1.png", noise)
        archive.writestr("2.png", b"whole")
    content = bytearray((tmp_path / "a.zip").read_bytes())
    content[60:1060] = bytes(1000)
    (tmp_path / "a.zip").write_bytes(content)
    corrupt, whole = find_files([tmp_path / "a.zip"], "mask", suffix=".png")
    with pytest.raises(BrokenFileError, match=r"cannot be read: \w"):
        corrupt.read()
    assert whole.read() == b"whole"


@pytest.mark.parametrize(
    "method",
    [
        pytest.param(method, id=name, marks=pytest.mark.slow if name in ("bzip2", "lzma") else ())
        for name, method in {"stored": zipfile.ZIP_STORED, **METHODS}.items()
    ],
)
def test_files_are_read_up_to_a_size(tmp_path, method):
    bomb = bytes(30_000_000)
    with zipfile.ZipFile(tmp_path / "a.zip", "w", method) as archive:
        archive.writestr("1.png", bomb)
    (tmp_path / "2.png").write_bytes(bomb)
    for file in find_files([tmp_path / "a.zip", tmp_path / "2.png"], "mask", suffix=".png"):
        tracemalloc.start()
        with pytest.raises(BrokenFileError, match=r"has more than 20 MB; --max-megabytes of a command allows more"):
            file.read(20_000_000)
        assert tracemalloc.get_traced_memory()[1] < 10_000_000  # nothing of it was unpacked
        tracemalloc.stop()
        assert file.read(30_000_000) == bomb


def test_a_zip_that_understates_its_member_is_not_believed(tmp_path):
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("1.png", bytes(1_000_000))
    content = bytearray(path.read_bytes())
    directory = content.index(b"PK\x01\x02")
    content[directory + 24 : directory + 28] = (1000).to_bytes(4, "little")
    path.write_bytes(content)
    (file,) = find_files([path], "mask", suffix=".png")
    with pytest.raises(BrokenFileError, match="cannot be read"):
        file.read(2000)


def test_names_that_no_result_could_have(tmp_path):
    for length, good in ((240, True), (241, False)):
        path = tmp_path / f"{'a' * length}.png"
        path.write_bytes(b"content")
        (file,) = find_files([path], "mask", suffix=".png")
        if good:
            assert file.read() == b"content"
            for name in (f"overlay_{file.id}.jpg", f"camera_{file.id}.json"):
                write_text(tmp_path / name, "")  # by way of a temporary file, which has a name too
        else:
            with pytest.raises(BrokenFileError, match="the name has more than 240 bytes"):
                file.read()


@pytest.mark.parametrize("content", ['{"a": 1, "b": 2, "a": 1}', '{"c": [{"a": 1, "a": 2}]}'])
def test_a_key_twice_is_no_json_object(content):
    with pytest.raises(BrokenFileError, match="the key 'a' is given twice"):
        parse_json_object(content, "masks")


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


def test_a_link_is_replaced_and_not_followed(tmp_path):
    (tmp_path / "outside.txt").write_text("untouched")
    (tmp_path / "a.json").symlink_to("outside.txt")
    write_text(tmp_path / "a.json", "new")
    assert (tmp_path / "outside.txt").read_text() == "untouched"
    assert (tmp_path / "a.json").read_text() == "new"
    assert not (tmp_path / "a.json").is_symlink()


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


def test_a_picture_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    def fail(*paths):
        raise OSError("disk full")

    monkeypatch.setattr(files.os, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        write_image(tmp_path / "a.png", np.zeros((4, 4, 3), np.uint8))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.timeout(20)
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_files_that_only_look_regular_are_not_waited_for(tmp_path, monkeypatch):
    """As ``/proc/kmsg``: by its status a regular file of 0 bytes, and whoever has read all of it waits for more."""
    os.mkfifo(tmp_path / "x.jpg")
    writer = os.open(tmp_path / "x.jpg", os.O_RDWR)
    monkeypatch.setattr(files.stat, "S_ISREG", lambda mode: True)
    os.write(writer, b"what is there")
    (file,) = find_files([tmp_path], "image", suffix=".jpg")
    assert file.read() == b"what is there"
    assert file.read_beginning(10) == b""
    os.close(writer)
    (tmp_path / "x.mp4").write_bytes(b"")
    with pytest.raises(BrokenFileError, match=r"x\.mp4: is no video"):
        VideoReader(tmp_path / "x.mp4")


@pytest.fixture
def small_files():
    """Lets files have no more than ten bytes, as `ulimit -f` does."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.skipif(os.name == "nt", reason="has no limits of files")
def test_files_that_cannot_grow_are_named(tmp_path, small_files):
    with LineLog(tmp_path / "lines") as log, pytest.raises(OSError, match=r"File too large: '.*lines'"):
        log.append("more than ten letters")
    assert (tmp_path / "lines").read_bytes() == b""
    with pytest.raises(OSError, match=r"File too large: '.*whole'"):
        write_bytes(tmp_path / "whole", b"more than ten bytes")
    assert not (tmp_path / "whole").exists()
