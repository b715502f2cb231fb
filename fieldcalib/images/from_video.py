"""From a video to cameras: every frame of a shot follows from all of them.

    frames -> matches with keyframes -> markings in the keyframes -> cameras of the keyframes, one by one
           -> all frames of a tripod together -> lines at the markings of every frame -> all frames together again

The video is read twice: a line is found in a frame where the camera is known to some pixels, and that the other frames
tell. Keyframes and what ties frames to them come from `fieldcalib.images.keyframes`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.sequence import SequenceCalibration
from fieldcalib.assess.video import NO_TRIPOD, Shot, VideoCalibration
from fieldcalib.calibrate.options import ALL, DEFAULT_FLAGS, Prior, pixel_unit
from fieldcalib.calibrate.sequence import calibrate_sequence
from fieldcalib.calibrate.ties import LEAST_CELLS, thinned
from fieldcalib.calibrate.together import labels_of
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.frame_lines import as_given, frame_lines
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.images.keyframes import EVERY, tied_frames
from fieldcalib.images.line_profiles import Markings
from fieldcalib.images.refinement import LOSS_SCALE
from fieldcalib.images.same_tripod import grouped
from fieldcalib.io.image import Image
from fieldcalib.io.images import IMAGES_AT_ONCE, read_ahead
from fieldcalib.io.videos import VideoReader
from fieldcalib.localize import Network
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.problem.labelled_pixels import Pixels, PixelWeights
from fieldcalib.problem.losses import RobustLoss

SIGMAS = 3.0  # of the predicted error of a marking, within which its line is searched
LONGEST_GAP = 25  # frames without a camera in a row that are interpolated: a second
LEAST_SHARE = 0.3  # of the profiles of a shot must show a line where its cameras have markings

Lines = tuple[Pixels, PixelWeights]


def calibrate_video(
    object_segments: ObjectSegments,
    source: str | Path | Iterable[Image],
    network: Network | None = None,
    *,
    flags: int = DEFAULT_FLAGS,
    prior: Prior = ALL,
    every: int = EVERY,
) -> VideoCalibration:
    """Calibrate the frames of a video together.

    The frames of a shot share the centre of the camera, the law by which its principal point and lens follow the zoom,
    and the size of the field; shots of the same tripod are recognised and share them too. The network looks at
    keyframes only. Matches of the static background tie every frame to these, and lines are searched at the projected
    markings of every frame.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object that the network was trained for, e.g. `soccer()`.
    source : path, or iterable of (height, width, 3) uint8 arrays
        A video, or its frames: blue, green, red, all of one size. It is read twice.
    network : Network, optional
        Finds the markings; by default the one that comes with the package.
    flags, prior
        As in `calibrate_from_images`.
    every : int
        Frames from one keyframe to the next, at most.

    Returns
    -------
    VideoCalibration
        Each frame says what it rests on: lines, matches, or both (`VideoCalibration.basis`). A camera is accepted as
        long as the field in view is known to 1 m.

    Raises
    ------
    FileNotFoundError, BrokenFileError
        As `fieldcalib.io.videos.VideoReader`.
    ValueError
        If the frames are of several sizes or an iterator, which can be read once only, or as `calibrate_from_images`.

    Examples
    --------
    >>> import numpy as np
    >>> from fieldcalib import soccer
    >>> black = [np.zeros((540, 960, 3), np.uint8)] * 2
    >>> [str(frame.status) for frame in calibrate_video(soccer(), black)]
    ['too few segments', 'too few segments']
    """
    network = SegmentationNetwork.load() if network is None else network
    if isinstance(source, str | Path):
        path = Path(source)
        return _calibrated(object_segments, lambda: VideoReader(path), network, flags, prior, every)
    if isinstance(source, Iterator):
        raise ValueError("expected a path or a sequence of images, got an iterator: the frames are read twice")
    return _calibrated(object_segments, lambda: _open(source), network, flags, prior, every)


@contextmanager
def _open(images: Iterable[Image]) -> Iterator[Iterable[Image]]:
    yield images


def _calibrated(
    object_segments: ObjectSegments,
    opened: Callable[[], AbstractContextManager[Iterable[Image]]],
    network: Network,
    flags: int,
    prior: Prior,
    every: int,
) -> VideoCalibration:
    clip = _Clip(object_segments, flags, prior)
    with opened() as images:
        clip.read(read_ahead(images), network, every)
    shots = {piece: clip.together([piece], clip.seen) for piece in clip.pieces}
    groups = [
        _Tripod(pieces, clip.together(pieces, clip.seen) if len(pieces) > 1 else shots[pieces[0]])
        for pieces in grouped(shots)
    ]
    groups.sort(key=lambda tripod: -len(tripod.calibration))
    clip.join_the_others(groups)
    with opened() as images:
        lines = clip.lines_in(read_ahead(images), groups)
    return clip.finished(groups, lines)


@dataclass
class _Tripod:
    """Pieces of a video from one tripod."""

    pieces: list[int]
    calibration: SequenceCalibration
    """Of their frames, in order."""


class _Clip:
    """The frames of a video while they are calibrated."""

    def __init__(self, object_segments: ObjectSegments, flags: int, prior: Prior) -> None:
        self.object_segments = object_segments
        self.flags = flags
        self.prior = prior
        self.size = (0, 0)
        self.piece: list[int] = []  # of each frame
        self.matches: dict[tuple[int, int], tuple[Array, Array]] = {}
        self.seen: dict[int, Lines] = {}  # in keyframes whose camera was accepted
        self.doubtful: dict[int, Lines] = {}  # in the others

    @property
    def pieces(self) -> list[int]:
        """Their numbers."""
        return sorted(set(self.piece))

    def frames(self, pieces: Sequence[int]) -> IntArray:
        """The frames of some pieces, in order."""
        return np.flatnonzero(np.isin(self.piece, pieces))

    def read(self, images: Iterable[Image], network: Network, every: int) -> None:
        """Matches of all frames, and the markings that are found in keyframes."""
        keys: list[int] = []
        held: list[Image] = []

        def look() -> None:
            found = calibrate_from_images(self.object_segments, held, network, flags=self.flags, prior=self.prior)
            for key, calibration in zip(keys, found, strict=True):
                if calibration.solved is not None:
                    labels = labels_of(calibration.solved.alone.evaluation)
                    (self.seen if calibration.accepted else self.doubtful)[key] = as_given(labels)
            keys.clear()
            held.clear()

        for image, tied in tied_frames(images, every=every):
            self.size = image.shape[1], image.shape[0]
            self.piece.append(tied.piece)
            ties = {key: thinned(matches.first, matches.second, self.size) for key, matches in tied.ties}
            ties = {key: both for key, both in ties.items() if len(both[0]) >= LEAST_CELLS}
            self.matches.update({(key, tied.index): both for key, both in ties.items()})
            if tied.is_key or not ties:  # what nothing ties must tell its camera by itself
                keys.append(tied.index)
                held.append(image)
                if len(held) == IMAGES_AT_ONCE:
                    look()
        look()

    def together(
        self, pieces: Sequence[int], lines: Mapping[int, Lines], start: SequenceCalibration | None = None
    ) -> SequenceCalibration:
        """All frames of some pieces, from the lines in some of them and from matches."""
        frames = self.frames(pieces).tolist()
        number = {t: k for k, t in enumerate(frames)}
        found = [lines.get(t, ({}, {})) for t in frames]
        return calibrate_sequence(
            self.object_segments,
            [pixels for pixels, _ in found],
            self.size,
            flags=None if self.flags == DEFAULT_FLAGS else self.flags,
            prior=self.prior,
            loss=RobustLoss("cauchy", LOSS_SCALE * pixel_unit(self.size)),
            trust_labels=True,
            weights=[weights for _, weights in found],
            start=start,
            matches={
                (number[i], number[j]): both for (i, j), both in self.matches.items() if i in number and j in number
            },
        )

    def join_the_others(self, groups: list[_Tripod]) -> None:
        """Pieces that tell no place by themselves, with the tripod from which they show what was found in them."""
        for tripod in groups:
            others = [p for p in self.pieces if not any(p in group.pieces for group in groups)]
            frames = set(self.frames(others).tolist())
            doubtful = {t: lines for t, lines in self.doubtful.items() if t in frames}
            if not doubtful:
                return
            pieces = sorted([*tripod.pieces, *{self.piece[t] for t in doubtful}])
            calibration = self.together(pieces, {**self.seen, **doubtful})
            members = self.frames(pieces)
            accepted = calibration.accepted
            fitting = [p for p in pieces if np.any(accepted[np.array(self.piece)[members] == p])]
            if set(fitting) > set(tripod.pieces):
                tripod.pieces, tripod.calibration = fitting, self.together(fitting, {**self.seen, **doubtful})

    def lines_in(self, images: Iterable[Image], groups: Sequence[_Tripod]) -> dict[int, Lines]:
        """The lines at the projected markings of every frame; groups lose pieces that show hardly any."""
        cameras, markings = {}, []
        for tripod in groups:
            field = tripod.calibration.field
            markings.append(Markings.of(self.object_segments if field is None else field))
            for t, calibration in zip(self.frames(tripod.pieces).tolist(), tripod.calibration, strict=True):
                cameras[t] = calibration, markings[-1]
        lines: dict[int, Lines] = {}
        count = np.zeros((2, 1 + max(self.piece, default=0)))  # of profiles with a line and of all, by piece
        for t, image in enumerate(images):
            if t not in cameras:
                continue
            calibration, of_field = cameras.pop(t)
            if calibration.camera is None:
                continue
            sigma = calibration.camera.focal_length * np.sqrt(np.max(np.diagonal(calibration.covariance)[:2]))
            lines[t], profiles = frame_lines(image, calibration.camera, of_field, float(sigma))
            count[:, self.piece[t]] += sum(map(len, lines[t][0].values())), profiles
        share = count[0] / np.maximum(count[1], 1.0)
        for tripod in groups:
            tripod.pieces = [p for p in tripod.pieces if share[p] >= LEAST_SHARE]
        return lines

    def finished(self, groups: Sequence[_Tripod], lines: Mapping[int, Lines]) -> VideoCalibration:
        """All frames of every tripod, from the lines in all of them."""
        tripod, number = np.full(len(self.piece), NO_TRIPOD), np.zeros(len(self.piece), dtype=np.intp)
        calibrations: list[SequenceCalibration] = []
        for group in groups:
            if not group.pieces:
                continue
            frames = self.frames(group.pieces)
            tripod[frames], number[frames] = len(calibrations), np.arange(len(frames))
            before = group.calibration if len(group.calibration) == len(frames) else None
            calibration = self.together(group.pieces, lines, before)
            calibrations.append(calibration.interpolated(np.array(self.piece)[frames], LONGEST_GAP))
        shots = [(frames[0], frames[-1] + 1) for p in self.pieces if len(frames := self.frames([p]))]
        return VideoCalibration(
            tuple(calibrations),
            tuple(Shot(int(start), int(stop), int(tripod[start])) for start, stop in shots),
            tripod,
            number,
        )
