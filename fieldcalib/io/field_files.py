"""Fields of users in YAML or JSON files, with the names that `Field` has."""

from __future__ import annotations

import json
from pathlib import Path

from fieldcalib._whole_files import write_text
from fieldcalib.fields.field import Field
from fieldcalib.fields.records import field_from_record, whole_record
from fieldcalib.io.files import YAML, BrokenFileError, read_json_or_yaml

JSON = (".json",)


def is_field_file(name: str) -> bool:
    """Whether a name is that of a file with a field, by its ending."""
    return Path(name).suffix.lower() in (*JSON, *YAML)


def read_field(path: Path | str) -> Field:
    """A field from a file: its length, width and segments, and what else `Field` takes.

    Parameters
    ----------
    path : path
        A ``.yaml``, ``.yml`` or ``.json`` file with these names: `length` and `width` (metres), `segments` (label ->
        `kind`, which is Point, Line, Arc or PointCloud, and what that takes), and, where they are not as by default,
        `stands` and `more_stands` (lists of what `CameraDistribution` takes; or of all stands around the field `away`
        and `up`, ranges of their distance and height), `farthest_camera`, `scale`, `lines` (what `LineLook` takes),
        `paint` (label, or beginning of labels -> what `Paint` takes), `surface`, `halves` and `size_known`. With
        ``mirrored: true`` segments with "right" and "bottom" in their labels are followed by their mirror images.

    Raises
    ------
    BrokenFileError
        If it cannot be read, or is no field; the message begins with the path.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "court.json"
    ...     _ = path.write_text('{"length": 20, "width": 10, "segments": {"mark": {"kind": "Point", "X": [0, 0, 0]}}}')
    ...     read_field(path)["mark"]
    Point(X=(0.0, 0.0, 0.0))
    """
    path = Path(path)
    try:
        return field_from_record(read_json_or_yaml(path))
    except (BrokenFileError, ValueError) as error:
        raise BrokenFileError(f"{path}: {error}") from None


def write_field(path: Path | str, field: Field) -> None:
    """Write a field with all its segments, for `read_field`; also a template for a field of one's own.

    Raises
    ------
    ValueError
        If the file's name ends neither in .json nor in .yaml.
    """
    path = Path(path)
    if not is_field_file(path.name):
        raise ValueError(f"expected a name that ends in .yaml or .json, got {path.name!r}")
    record = json.dumps(whole_record(field), indent=2, allow_nan=False)
    if path.suffix.lower() in JSON:
        write_text(path, record + "\n")
        return
    import yaml

    plain = json.loads(record)  # lists for tuples
    write_text(path, yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, width=120))
