"""A dict that cannot be written to."""

from __future__ import annotations

from typing import Any, NoReturn, TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")


class ReadOnlyDict(dict[Key, Value]):
    """A dict of a frozen dataclass. As a dict it equals others, is JSON, and is taken by `dataclasses.asdict`.

    Examples
    --------
    >>> import json
    >>> numbers = ReadOnlyDict({"Middle line": 1.5})
    >>> json.dumps(numbers), numbers == {"Middle line": 1.5}
    ('{"Middle line": 1.5}', True)
    >>> numbers["Middle line"] = 0.0
    Traceback (most recent call last):
        ...
    TypeError: this dict is read-only: change a copy, dict(...)
    """

    def _refuse(self, *args: Any, **kwargs: Any) -> NoReturn:
        raise TypeError("this dict is read-only: change a copy, dict(...)")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[type[ReadOnlyDict[Key, Value]], tuple[dict[Key, Value]]]:
        return type(self), (dict(self),)
