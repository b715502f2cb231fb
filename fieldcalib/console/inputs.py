"""INPUT of a command line: paths, lists of paths in text files, streams."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from fieldcalib.io.streams import Input, Stream

LIST = "@"  # prefix of the name of a text file that lists inputs


def add_inputs(parser: argparse.ArgumentParser, help: str, *, streams: bool = False) -> None:
    """INPUT..., with lists."""
    action = _WithStreams if streams else _Inputs
    more = f"; {LIST}FILE: the paths in a text file, one a line, relative to its folder"
    parser.add_argument("input", nargs="+", action=action, metavar="INPUT", help=help + more)


class _Inputs(argparse.Action):
    """Turns texts into paths and streams, and reads lists of them."""

    streams = False

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        try:
            setattr(namespace, self.dest, list(_listed(values, self.streams)))
        except (OSError, ValueError) as error:
            parser.error(str(error))


class _WithStreams(_Inputs):
    streams = True


def _listed(texts: Sequence[str], streams: bool) -> Iterator[Input]:
    for text in texts:
        if not text:  # as of an unset shell variable
            raise ValueError("expected a path, got nothing; . is this folder")
        if not text.startswith(LIST):
            yield _input(text, Path(), streams)
            continue
        path = Path(text.removeprefix(LIST))
        if not path.exists():
            raise ValueError(f"{path} does not exist: expected a text file with a path on each line")
        lines = path.read_text("utf-8-sig", errors="surrogateescape").splitlines()
        paths = [line.strip() for line in lines if line.strip()]
        if not paths:
            raise ValueError(f"{path} lists nothing: expected a path on each line")
        for line in paths:
            yield _input(line, path.parent, streams)


def _input(text: str, folder: Path, streams: bool) -> Input:
    return Stream(text) if streams and Stream.recognises(text) else folder / text
