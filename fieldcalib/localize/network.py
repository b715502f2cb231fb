"""A segmentation network in ONNX: images to class probabilities, from which points are selected (`localize`).

Its only input is (N, 3, height, width) float32: images resized to that size, whatever their aspect ratio, channels in
the order given by its JSON file (`fieldcalib.localize.network`), values in 0..1 with `mean` subtracted and divided
by `std`. Its first output is (N, K, h, w): logits of the K classes on a grid of equal cells that covers the image.

A network takes pictures of any shape, squashed or stretched to its input. A 9:16 window of a broadcast, stretched to
three times its width, shows markings at angles that no broadcast has. So upright pictures have an input size of their
own if the network takes two, and `Padded` continues narrow pictures on both sides.

The JSON file beside a network in ONNX: what input the network expects and what its outputs mean.

{"classes": ["background", "Side line top", ...], "input_size": [width, height], "upright_input_size": [width, height],
 "mean": [0.485, 0.456, 0.406], "std": [0.229, 0.224, 0.225], "channels": "RGB"}
"""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from importlib.resources import as_file, files
from itertools import chain, groupby
from pathlib import Path
from typing import Any, Protocol, Self, TypeAlias

import numpy as np

from fieldcalib._types import Float32, file_path, named, whole_number
from fieldcalib.fields.field import ObjectSegments
from fieldcalib.geometry.camera import checked_image_size
from fieldcalib.io.files import BrokenFileError, named_in_errors, parse_json_object
from fieldcalib.io.image_files import IMAGES_AT_ONCE, Image, checked_image, each_checked, in_parts, size_of
from fieldcalib.localize.point_selection import BACKGROUND, Localization, ridge_points
from fieldcalib.problem.labelled_pixels import check_object
from fieldcalib.processes.jobs import in_order

CPU = "CPUExecutionProvider"
SHIPPED = files("fieldcalib") / "models" / "soccer.onnx"
UPRIGHT = "upright_input_size"  # key of the JSON file
HALVED = 4  # times the network's input: larger images are halved first, which changes grey values by 0.2 in the mean
# Of 35 frames of a 9:16 window, stretched 1 has an accepted camera, continued to 4:5, 1:1, 4:3 and 16:9 it is 6 to 10.
SHAPE = 4.0 / 3.0  # width by height, to which narrower pictures are continued
EDGE = 8  # px at a side, whose mean continues it: single pixels of players and paint would make long stripes
PointSelection: TypeAlias = Callable[[Float32, Sequence[str], ObjectSegments, tuple[int, int]], Localization]


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
    upright_size: tuple[int, int] | None = None
    """Width and height of the input for pictures that are higher than wide, if it is another one."""

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
            classes, mean, std = _classes(record), _three(record, "mean"), _three(record, "std")
            size, upright = _size(record, "input_size"), _size(record, UPRIGHT) if UPRIGHT in record else None
        except KeyError as error:
            raise BrokenFileError(f"lacks the key {error}") from None
        if channels not in ("RGB", "BGR"):
            raise BrokenFileError(f'channels: expected "RGB" or "BGR", got {channels!r}')
        if min(std) <= 0.0:
            raise BrokenFileError(f"std: expected positive numbers, got {record['std']!r}")
        return cls(classes, size, mean, std, channels, upright)


def _classes(record: Mapping[str, Any]) -> tuple[str, ...]:
    names = record["classes"]
    if not (isinstance(names, list) and names and all(isinstance(name, str) for name in names)):
        raise BrokenFileError(f"classes: expected a list of names, got {names!r}")
    classes = tuple(name.strip() for name in names)
    twice = [name for name, count in Counter(classes).items() if count > 1 and name != BACKGROUND]
    if twice:
        raise BrokenFileError(f"classes: {twice[0]!r} occurs twice")
    return classes


def _size(record: Mapping[str, Any], key: str) -> tuple[int, int]:
    size = record[key]
    try:
        return checked_image_size(size)
    except ValueError:
        raise BrokenFileError(f"{key}: expected [width, height] in whole pixels, got {size!r}") from None


def _three(record: Mapping[str, Any], key: str) -> tuple[float, ...]:
    try:
        values = tuple(float(value) for value in record[key])
    except (TypeError, ValueError):
        values = ()
    if len(values) != 3 or not np.all(np.isfinite(values)):
        raise BrokenFileError(f"{key}: expected three numbers, one per channel, got {record[key]!r}")
    return values


@dataclass(frozen=True)
class NetworkSource:
    """Files and settings that a network was loaded with."""

    model: Path | None
    """The ONNX file; None for the one that comes with the package."""
    provider: str
    threads: int
    digest: str
    """SHA-256 of the ONNX file and its JSON file."""


@dataclass(frozen=True, repr=False)
class SegmentationNetwork:
    """A segmentation network, ready to run.

    A pickle holds the paths of its files only. Another process loads them when it first runs the network, once for all
    pickles of it, to run in one thread; the files must exist there and be unchanged. Copies are the network itself.
    """

    description: NetworkDescription
    session: Any
    """onnxruntime's InferenceSession."""
    source: NetworkSource | None = None
    """None if the session was not made by `load`: such a network cannot be pickled."""

    @classmethod
    def load(cls, model: Path | str | None = None, *, provider: str = CPU, threads: int = 2) -> SegmentationNetwork:
        """Load a network.

        Parameters
        ----------
        model : Path or str, optional
            The ONNX file, with its JSON beside it; by default the network that comes with the package.
        provider : str
            Execution provider, by onnxruntime's name: "CPUExecutionProvider", "CUDAExecutionProvider", ...
        threads : int
            Largest number of CPU threads; never more than there are cores.

        Raises
        ------
        FileNotFoundError
            If the ONNX file or its JSON file does not exist.
        BrokenFileError
            If they cannot be read, or contradict each other.
        ValueError
            If the provider is not available or does not start (it is never replaced by another), or `threads` < 1.

        Examples
        --------
        >>> SegmentationNetwork.load("no.onnx")
        Traceback (most recent call last):
            ...
        FileNotFoundError: no.onnx does not exist: expected a network in ONNX
        """
        if model is None and not SHIPPED.is_file():
            raise FileNotFoundError(f"this installation has no network ({SHIPPED} is missing): give the path of one")
        with as_file(SHIPPED) if model is None else nullcontext(file_path(model, "a network")) as path:
            if not path.is_file():
                raise FileNotFoundError(f"{path} does not exist: expected a network in ONNX")
            beside = path.with_suffix(".json")
            if not beside.is_file():
                raise FileNotFoundError(f"{beside} does not exist: expected the description of {path.name}")
            json = beside.read_bytes()
            with named_in_errors(beside):
                description = NetworkDescription.parse(json)
            digest = hashlib.sha256(path.read_bytes() + json).hexdigest()
            session = _session(path, provider, threads)
            for size in (description.input_size, description.upright_size or description.input_size):
                _check_input(session, path, size)
        source = NetworkSource(None if model is None else Path(model).absolute(), provider, threads, digest)
        return cls(description, session, source)

    def __copy__(self) -> Self:
        return self  # its session may be run by several threads at once

    def __deepcopy__(self, memo: object) -> Self:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        if self.source is None:
            raise TypeError("this network cannot be pickled: SegmentationNetwork.load gives one that can")
        source = replace(self.source, threads=1)
        return SegmentationNetwork, (self.description, _LateSession(source), source)

    def __repr__(self) -> str:
        size = "{} x {}".format(*self.description.input_size)
        model = "" if self.source is None else f", {self.source.model or 'the one of the package'}"
        return f"SegmentationNetwork({len(self.classes)} classes, {size} px{model})"

    @property
    def classes(self) -> tuple[str, ...]:
        """Class of each probability map."""
        return self.description.classes

    def __call__(self, images: Sequence[Image]) -> Float32:
        """Class probabilities of N images, of any sizes: (N, K, h, w), summing to 1 over the K classes.

        If all are upright, the input has the size for such pictures, and the grid has its shape.

        Raises
        ------
        ValueError
            If an image is not such an array, or the network fails or does not return one map per class.
        """
        images = list(map(checked_image, images))
        batch = self._prepared(images, all(map(is_upright, images)))
        (node,) = self.session.get_inputs()
        step = node.shape[0] if isinstance(node.shape[0], int) else len(batch)
        try:
            logits = [self.session.run(None, {node.name: batch[i : i + step]})[0] for i in range(0, len(batch), step)]
        except Exception as error:  # onnxruntime's errors have no common base class
            raise ValueError(f"the network fails on input of shape {batch.shape}: {error}") from error
        return softmax(self._checked(logits[0] if len(logits) == 1 else np.concatenate(logits)))

    def _prepared(self, images: Sequence[Image], are_upright: bool) -> Float32:
        """The network's input, (N, 3, height, width)."""
        import cv2

        width, height = (are_upright and self.description.upright_size) or self.description.input_size
        order = slice(None, None, -1) if self.description.channels == "RGB" else slice(None)
        batch = np.empty((len(images), 3, height, width), np.float32)
        mean, std = (np.array(v, np.float32) for v in (self.description.mean, self.description.std))
        scale, offset = np.float32(1.0) / (np.float32(255.0) * std), mean / std
        for planes, image in zip(batch, images, strict=True):
            channels = cv2.split(resized(image, (width, height)))[order]
            for c, channel in enumerate(channels):
                np.multiply(channel, scale[c], out=planes[c])
                planes[c] -= offset[c]
        return batch

    def _checked(self, logits: Any) -> Float32:
        if logits.ndim != 4 or logits.shape[1] != len(self.classes):
            raise ValueError(
                f"the network's JSON names {len(self.classes)} classes, so its output should be "
                f"(N, {len(self.classes)}, h, w), got {logits.shape}"
            )
        return np.asarray(logits, dtype=np.float32)


@dataclass(frozen=True)
class _LateSession:
    """A session that is loaded when first run: errors during unpickling would end the processes of an executor."""

    source: NetworkSource

    def get_inputs(self) -> Any:
        return _session_of_process(self.source, os.getpid()).get_inputs()

    def run(self, *arguments: Any) -> Any:
        return _session_of_process(self.source, os.getpid()).run(*arguments)


@lru_cache
def _session_of_process(source: NetworkSource, process: int) -> Any:
    """The session of an unpickled network, one per process: its threads do not survive a fork."""
    try:
        network = SegmentationNetwork.load(source.model, provider=source.provider, threads=source.threads)
    except (OSError, ValueError) as error:
        raise type(error)(f"a network of another process cannot be loaded here: {error}") from error
    if network.source != source:
        raise BrokenFileError(f"{source.model or SHIPPED} is not the network that was pickled: it has changed")
    return network.session


def resized(image: Image, size: tuple[int, int]) -> Image:
    """An image in another width and height; where it shrinks, a pixel is the mean of those that it covers.

    A large one is halved first, which OpenCV does ten times as fast as other shrinking.
    """
    import cv2

    while min(image.shape[0] / size[1], image.shape[1] / size[0]) >= HALVED and not any(n % 2 for n in image.shape[:2]):
        halved = image.shape[1] // 2, image.shape[0] // 2
        image = np.asarray(cv2.resize(image, halved, interpolation=cv2.INTER_AREA), np.uint8)
    shrinks = image.shape[0] >= size[1] and image.shape[1] >= size[0]
    how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size, interpolation=how), np.uint8)


def softmax(logits: Float32) -> Float32:
    """Probabilities (N, K, h, w) of logits over the K classes.

    Examples
    --------
    >>> softmax(np.log(np.array([1.0, 3.0], np.float32)).reshape(1, 2, 1, 1)).ravel().round(3)
    array([0.25, 0.75], dtype=float32)
    """
    p = np.empty_like(logits)
    for one, given in zip(p, logits, strict=True):  # one by one: the maps of an image fit into the processor's cache
        np.exp(np.subtract(given, np.max(given, axis=0), out=one), out=one)
        one /= np.sum(one, axis=0)
    return p


def _session(path: Path, provider: str, threads: int) -> Any:
    """An InferenceSession on that provider, or an error: onnxruntime would silently fall back to the CPU."""
    # onnxruntime (from 1.29 on) writes an id to the user's cache and looks up a telemetry host; this is read on import
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    threads = whole_number(threads, "threads", 1)
    available = onnxruntime.get_available_providers()
    if not isinstance(provider, str) or provider not in available:
        raise ValueError(
            f"onnxruntime has no {provider!r} here, only {', '.join(available)}; CUDA needs onnxruntime-gpu"
        )
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = min(threads, os.cpu_count() or 1)
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # no quicker here, and takes a core
    options.log_severity_level = 3  # errors
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=[provider])
    except Exception as error:  # onnxruntime's errors have no common base class
        raise BrokenFileError(f"{path}: onnxruntime cannot load it: {error}") from error
    if provider not in session.get_providers():
        raise ValueError(f"{provider!r} does not start: are its driver and libraries installed?")
    return session


def _check_input(session: Any, path: Path, size: tuple[int, int]) -> None:
    """Raise a BrokenFileError unless the network takes float32 images of that size, one or any number at once."""
    came = [(node.shape, node.type) for node in session.get_inputs()]
    shape = (1, 3, size[1], size[0])
    match came:
        case [([_, _, _, _] as given, "tensor(float)")]:
            if all(n == m for n, m in zip(given, shape, strict=True) if isinstance(n, int)):
                return
    raise BrokenFileError(f"{path}: expected one float32 input of shape (N, 3, {size[1]}, {size[0]}), got {came}")


@dataclass(frozen=True)
class Padded:
    """A network for pictures with square pixels that pads narrow ones on both sides, unless they have their own input.

    Examples
    --------
    >>> class Bright:
    ...     classes = ("background", "Middle line")
    ...     def __call__(self, images):
    ...         mean = np.array([image.reshape(90, 4, 160, -1, 3).mean(axis=(1, 3, 4)) for image in images]) / 255.0
    ...         return np.stack([1.0 - mean, mean], axis=1).astype(np.float32)
    >>> portrait = np.zeros((360, 240, 3), np.uint8)
    >>> portrait[:, :120] = 255  # the network sees 480 columns
    >>> Padded(Bright())([portrait])[0, 1, 0, [0, -1]].round(1)
    array([1., 0.], dtype=float32)
    """

    network: Network

    @property
    def classes(self) -> Sequence[str]:
        """Class of each probability map."""
        return self.network.classes

    @staticmethod
    def missing(size: tuple[int, int]) -> int:
        """Columns that are added to a picture of a width and height; 0 unless it is narrow."""
        return max(round(SHAPE * size[1]) - size[0], 0)

    def __call__(self, images: Sequence[Image]) -> Float32:
        """Class probabilities of images of one size, on a grid that covers each of them."""
        width = images[0].shape[1]
        missing = self.missing(size_of(images[0]))
        of_upright = isinstance(self.network, SegmentationNetwork) and self.network.description.upright_size
        if not missing or (of_upright and is_upright(images[0])):
            return self.network(images)
        left, whole = missing // 2, width + missing
        found = self.network([continued(image, left, missing - left) for image in images])
        columns = found.shape[-1]
        kept = -(-columns * width // whole)
        x = columns / whole * (left + width * (np.arange(kept) + 0.5) / kept) - 0.5
        below = np.clip(np.floor(x).astype(np.intp), 0, columns - 2)
        share = (x - below).astype(np.float32)
        return np.asarray((1.0 - share) * found[..., below] + share * found[..., below + 1], dtype=np.float32)


def is_upright(image: Image) -> bool:
    """Whether a picture is higher than wide."""
    return bool(image.shape[0] > image.shape[1])


def continued(image: Image, left: int, right: int) -> Image:
    """A picture with columns added at both sides."""
    sides = (np.mean(image[:, part], axis=1, keepdims=True).round() for part in (slice(None, EDGE), slice(-EDGE, None)))
    first, last = (np.repeat(side, count, axis=1) for side, count in zip(sides, (left, right), strict=True))
    return np.concatenate([first, image, last], axis=1).astype(np.uint8)


class Network(Protocol):
    """`SegmentationNetwork`, or anything else that gives class probabilities of images."""

    @property
    def classes(self) -> Sequence[str]:
        """Class of each probability map: a segment of the object or "background"."""

    def __call__(self, images: Sequence[Image]) -> Float32:
        """Probabilities (N, K, h, w) of the K classes, on a grid that covers each of N images."""


def as_frames(network: Network | None) -> Network | None:
    """A network that looks at upright pictures as at frames, at the same input size."""
    if not isinstance(network, SegmentationNetwork) or network.description.upright_size is None:
        return network
    return replace(network, description=replace(network.description, upright_size=None))


def check_network(network: object) -> None:
    """Raise a ValueError if an object is no `Network`."""
    if isinstance(network, type) or not callable(network) or not hasattr(network, "classes"):
        raise ValueError(f"expected a network, as SegmentationNetwork.load(path) returns it, got {network!r}")


def localize(
    object_segments: ObjectSegments,
    images: Iterable[Image],
    network: Network,
    *,
    select: PointSelection = ridge_points,
    executor: Executor | None = None,
) -> list[Localization]:
    """Labelled pixels of images.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object that the network was trained for, e.g. `soccer()`.
    images : iterable of (height, width, 3) uint8 arrays
        Blue, green, red; of any sizes. The network gets up to `IMAGES_AT_ONCE` of them in one call, either all or none
        of them upright.
    network : Network
        A `SegmentationNetwork`, or any other source of class probabilities.
    select : callable
        `ridge_points`, or `skeleton_points` as in the paper.
    executor : concurrent.futures.Executor, optional
        Runs the work on the images, as in `calibrate_from_images`.

    Returns
    -------
    list of Localization
        One per image; empty where nothing is detected.

    Raises
    ------
    ValueError
        If an image is not such an array, the images are not in a list, a class is not a segment of the object, or
        `object_segments` or `network` has a wrong type.

    Examples
    --------
    >>> import numpy as np
    >>> from fieldcalib import soccer
    >>> class Blind:
    ...     classes = ("background", "Middle line")
    ...     def __call__(self, images):
    ...         return np.zeros((len(images), 2, 90, 160), np.float32)
    >>> localize(soccer(), [np.zeros((540, 960, 3), np.uint8)], Blind())
    [Localization(pixels={}, weights={})]
    """
    check_object(object_segments)
    check_network(network)
    if not callable(select):
        raise ValueError(f"select must be a function, as fieldcalib.localize.ridge_points, got {named(select)}")
    of_part = partial(_localized, object_segments, network=network, select=select)
    parts = in_parts(each_checked(images), IMAGES_AT_ONCE, lambda image: image.shape[0] * image.shape[1])
    return [found for part in in_order(executor, of_part, parts) for found in part]


def _localized(
    object_segments: ObjectSegments, images: Sequence[Image], *, network: Network, select: PointSelection
) -> list[Localization]:
    """Labelled pixels of the images that the network gets in one call."""
    probabilities = chain.from_iterable(network(list(alike)) for _, alike in groupby(images, is_upright))
    return [
        select(probability, network.classes, object_segments, size_of(image))
        for image, probability in zip(images, probabilities, strict=True)
    ]
