"""The JSON file beside a network in ONNX: what input the network expects and what its outputs mean.

{"classes": ["background", "Side line top", ...], "input_size": [width, height],
 "mean": [0.485, 0.456, 0.406], "std": [0.229, 0.224, 0.225], "channels": "RGB"}
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fieldcalib.geometry.camera import checked_image_size
from fieldcalib.io.files import BrokenFileError, parse_json_object
from fieldcalib.localize.grid import BACKGROUND


@dataclass(frozen=True)
class NetworkDescription:
    """Content of the JSON file beside a network."""

    classes: tuple[str, ...]
    input_size: tuple[int, int]
    """Width and height."""
    mean: tuple[float, ...]
    """Mean of each channel, in the network's order, for values in 0..1; `std` likewise."""
    std: tuple[float, ...]
    channels: str
    """"RGB" or "BGR"."""

    @classmethod
    def parse(cls, content: bytes | str) -> NetworkDescription:
        """The description in a JSON file.

        Raises
        ------
        BrokenFileError
            If it is not a JSON object, a key is missing, or a value has the wrong type.

        Examples
        --------
        >>> NetworkDescription.parse('{"classes": ["background"]}')
        Traceback (most recent call last):
            ...
        fieldcalib.io.files.BrokenFileError: lacks the key 'channels'
        """
        record = parse_json_object(content, "a network's classes, input_size, mean, std and channels")
        try:
            channels = record["channels"]
            classes, size, mean, std = _classes(record), _size(record), _three(record, "mean"), _three(record, "std")
        except KeyError as error:
            raise BrokenFileError(f"lacks the key {error}") from None
        if channels not in ("RGB", "BGR"):
            raise BrokenFileError(f'channels: expected "RGB" or "BGR", got {channels!r}')
        if min(std) <= 0.0:
            raise BrokenFileError(f"std: expected positive numbers, got {record['std']!r}")
        return cls(classes, size, mean, std, channels)


def _classes(record: Mapping[str, Any]) -> tuple[str, ...]:
    names = record["classes"]
    if not (isinstance(names, list) and names and all(isinstance(name, str) for name in names)):
        raise BrokenFileError(f"classes: expected a list of names, got {names!r}")
    classes = tuple(name.strip() for name in names)
    twice = [name for name, count in Counter(classes).items() if count > 1 and name != BACKGROUND]
    if twice:
        raise BrokenFileError(f"classes: {twice[0]!r} occurs twice")
    return classes


def _size(record: Mapping[str, Any]) -> tuple[int, int]:
    size = record["input_size"]
    try:
        return checked_image_size(size)
    except ValueError:
        raise BrokenFileError(f"input_size: expected [width, height] in whole pixels, got {size!r}") from None


def _three(record: Mapping[str, Any], key: str) -> tuple[float, ...]:
    try:
        values = tuple(float(value) for value in record[key])
    except (TypeError, ValueError):
        values = ()
    if len(values) != 3 or not np.all(np.isfinite(values)):
        raise BrokenFileError(f"{key}: expected three numbers, one per channel, got {record[key]!r}")
    return values
