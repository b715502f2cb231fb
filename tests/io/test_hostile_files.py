"""Files of others that would take all memory, or that say one thing twice."""

import zipfile
from zipfile import ZIP_BZIP2, ZIP_DEFLATED, ZIP_LZMA

import pytest

from fieldcalib.io.field_files import read_field
from fieldcalib.io.files import BrokenFileError, find_files

SIZE = "length: 20\nwidth: 10\n"
MARK = "segments: {mark: {kind: Point, X: [0, 0, 0]}}\n"
BOMB = "a0: &a0 [x, x]\n" + "".join(f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]\n" for k in range(1, 60))
MB = 2**20


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (SIZE + "width: 11\n" + MARK, "the key 'width' is given twice"),
        (SIZE + MARK.replace("}}", "}, mark: {kind: Point, X: [1, 0, 0]}}"), "the key 'mark' is given twice"),
        (BOMB + "length: *a59\n", "has the alias *a0: write its values out"),
        ("length: 0x" + "F" * 5000 + "\nwidth: 10\n" + MARK, "length: int too large"),
        ("length: .inf\nwidth: 10\n" + MARK, "length"),
        ("length: true\nwidth: 10\n" + MARK, "length: expected a number"),
        ("builder: []\n" + SIZE, "builder must be one of"),
        (SIZE + "segments: []\n", "segments: expected labels with values"),
        (SIZE + "segments: {mark: {kind: [], X: [0, 0, 0]}}\n", "segments: mark: expected a kind"),
        ("? [1, 2]\n: 3\n", "is no YAML"),
    ],
)
def test_wrong_fields_are_named(tmp_path, text, problem):
    path = tmp_path / "field.yaml"
    path.write_text(text)
    with pytest.raises(BrokenFileError) as error:
        read_field(path)
    assert str(error.value).startswith(f"{path}: ")
    assert problem in str(error.value)


@pytest.fixture(
    params=[ZIP_DEFLATED, ZIP_BZIP2, pytest.param(ZIP_LZMA, marks=pytest.mark.slow)], ids=["deflate", "bzip2", "lzma"]
)
def zipped(request, tmp_path):
    """A zip with 100 MB of zeros, and a small member."""
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w", request.param) as archive:
        with archive.open("large.json", "w", force_zip64=True) as file:
            for _ in range(100):
                file.write(bytes(MB))
        archive.writestr("small.json", b"small " * 1000)
    return path


def peak_of(function, *arguments):
    import tracemalloc

    tracemalloc.start()
    try:
        return function(*arguments), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_members_of_zips_are_unpacked_part_by_part(zipped):
    large, small = find_files([zipped], "file", suffix=".json")
    assert small.read() == b"small " * 1000
    beginning, peak = peak_of(large.read_beginning, 10)
    assert beginning == bytes(10)
    assert peak < 90 * MB  # LZMA unpacks 4 kB as a whole
    with pytest.raises(BrokenFileError, match="has more than 1 MB"):
        large.read(1e6)


def test_a_zip_that_states_too_little(zipped):
    stated, less = (100 * MB).to_bytes(4, "little"), (1000).to_bytes(4, "little")
    zipped.write_bytes(zipped.read_bytes().replace(stated, less))
    large, small = find_files([zipped], "file", suffix=".json")

    def problem():
        with pytest.raises(BrokenFileError) as error:
            large.read(10 * MB)
        return str(error.value)

    _, peak = peak_of(problem)
    assert peak < 90 * MB
    assert small.read() == b"small " * 1000


@pytest.mark.parametrize("damage", [10, -60])
def test_damaged_members_are_named(tmp_path, damage):
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w", ZIP_BZIP2) as archive:
        archive.writestr("a.json", bytes(range(256)) * 100)
    content = bytearray(path.read_bytes())
    content[60 + damage if damage > 0 else damage - 200] ^= 255
    path.write_bytes(content)
    (file,) = find_files([path], "file", suffix=".json")
    with pytest.raises(BrokenFileError, match="cannot be read"):
        file.read()
