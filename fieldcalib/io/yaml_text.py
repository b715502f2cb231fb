"""YAML, as far as JSON could hold it too: without aliases, and without keys that are given twice."""

from __future__ import annotations

from typing import Any

import yaml

from fieldcalib.io.files import BrokenFileError, without_repeats


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Refuses aliases, a few of which stand for more values than there is memory for, and repeated keys."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise BrokenFileError(f"has the alias *{self.peek_event().anchor}: write its values out")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        without_repeats([(self.construct_object(key, deep=True), None) for key, _ in node.value])
        return super().construct_mapping(node, deep)


def parse_yaml(content: bytes | str) -> Any:
    """Parse YAML.

    Raises
    ------
    BrokenFileError
        If it is no YAML, has aliases, or a mapping in it has a key twice.

    Examples
    --------
    >>> parse_yaml("length: 20")
    {'length': 20}
    """
    try:
        return yaml.load(content, _Loader)
    except BrokenFileError:
        raise
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:  # TypeError: of a key that is a list
        raise BrokenFileError(f"is no YAML: {error}") from None
