"""What is given to be read: paths, lists of them and streams, and which of them are run by themselves."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.streams import Stream

Input: TypeAlias = Path | Stream

OF_IMAGES = "images"  # folder of their results, beside those of videos
LIST = "@"  # what the name of a text file begins with that lists inputs


def add_inputs(parser: argparse.ArgumentParser, help: str, *, streams: bool = False) -> None:
    """INPUT..., with lists."""
    action = _WithStreams if streams else _Inputs
    more = f"; {LIST}FILE: the paths in a text file, one a line, relative to its folder"
    parser.add_argument("input", nargs="+", action=action, metavar="INPUT", help=help + more)


class _Inputs(argparse.Action):
    """Makes paths of what is given, and reads lists."""

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
        if not text.startswith(LIST):
            yield _input(text, Path(), streams)
            continue
        path = Path(text.removeprefix(LIST))
        lines = path.read_text("utf-8-sig", errors="surrogateescape").splitlines()
        paths = [line.strip() for line in lines if line.strip()]
        if not paths:
            raise ValueError(f"{path} lists nothing: expected a path on each line")
        for line in paths:
            yield _input(line, path.parent, streams)


def _input(text: str, folder: Path, streams: bool) -> Input:
    return Stream(text) if streams and Stream.recognises(text) else folder / text


def runs_of(options: argparse.Namespace) -> list[argparse.Namespace]:
    """The options of each run: one for each video and stream, and one for all images.

    Where there are several, or they come from a folder, each has its own folder in ``options.out``, by the name of its
    video.

    Raises
    ------
    ValueError
        If two of them have the same name.
    """
    inputs = [part for one in options.input for part in _parts(one)]
    images = [one for one in inputs if not _is_video(one)]
    groups = [(one.stem if isinstance(one, Path) else one.name, [one]) for one in inputs if _is_video(one)]
    if images:
        groups.insert(0, (OF_IMAGES, images))
    if len(groups) == 1 and inputs == options.input:  # one video of a folder may be joined by others
        return [argparse.Namespace(**{**vars(options), "input": groups[0][1]})]
    seen: dict[str, Sequence[Input]] = {}
    for name, (first, *_) in groups:
        other = seen.setdefault(name.casefold(), [first])[0]
        if other is not first:
            raise ValueError(f"{other} and {first} would both write to {options.out / name}: run them one by one")
    return [argparse.Namespace(**{**vars(options), "input": part, "out": options.out / name}) for name, part in groups]


def _is_video(one: Input) -> bool:
    return isinstance(one, Stream) or VIDEOS.recognises(one)


def _parts(one: Input) -> list[Input]:
    """The videos of a folder that has videos and no images; otherwise the input itself."""
    if isinstance(one, Stream) or not one.is_dir():
        return [one]
    files = sorted(path for path in one.iterdir() if path.is_file())
    if any(map(IMAGES.recognises, files)):
        return [one]
    return [path for path in files if VIDEOS.recognises(path)] or [one]
