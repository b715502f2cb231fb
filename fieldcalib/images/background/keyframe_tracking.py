"""Matching of all frames of a video to keyframes by the static background, in one pass.

A frame is "tied" to a keyframe if enough of the background matches. Each frame is matched with a keyframe directly, so
that errors do not add up from frame to frame, and keyframes are matched with earlier keyframes. Frames that matches
connect form a "piece". A new piece begins where frames match one another but no keyframe before them: after a cut, or a
pan too fast to follow. Two pieces may therefore show the same scene.

Corners that two shots seem to share, or that are seen through a dissolve, must not tie shots together. So two pictures
must also be alike as a whole (`likeness` in `fieldcalib.images.background.matching_frame`), and more so before a frame
becomes a keyframe: of two shots that are mixed, at most one makes up more than half of the contrast.

In a fast pan or zoom a frame may show too little of the keyframe before it, or be too blurred, while it still matches
the frame before. `linked_frames` then matches successive frames with one another. Errors add up along such a chain, so
it is used only where nothing else ties frames, and only as a whole: from a tied frame to the next tied one, or to the
first frame of the next piece, which then belongs to the same piece.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from fieldcalib._types import Array
from fieldcalib.images.background.matches import Matches, match_background, match_far
from fieldcalib.images.background.matching_frame import (
    MOST_CORNERS,
    Frame,
    VideoFrame,
    likeness,
    same_picture,
    shared_view,
)
from fieldcalib.io.image_files import Image

EVERY = 12  # frames from one keyframe to the next: half a second
BACK = (1, 2, 4)  # a keyframe is matched with the first, second and fourth keyframe before it
CORNERS = 150  # corners of a keyframe that are followed to an ordinary frame
LEAST_IN_VIEW = 0.6  # share of a keyframe: with less of it in view the next keyframe is made
FEW_MATCHES = 40  # with fewer matches the next keyframe is made
CONFIRMED = 8  # frames, tied to one another but not to the piece before, that make a new piece; graphics are shorter
LOST_FOR = 30  # frames, a second, for which the piece may go on after its last tied frame

# Likeness in seven clips of pictures 12 frames apart: 0.77 or more; 24 to 48 apart 0.7 or more; with 30 % of another
# shot mixed in 0.46 to 0.78, with 50 % 0.1 to 0.61
LEAST_LIKENESS = 0.62  # of a frame and its keyframe, and of a new keyframe and those of the last `MIXED_FOR` frames
MIXED_FOR = 50  # frames, the longest dissolve, which could be crossed in small steps from keyframe to keyframe
MOSTLY_IN_VIEW = (
    0.75  # share of an earlier keyframe in view from which a new one must be like it: with less, H is not known well
)
LEAST_LIKENESS_OF_KEY = 0.68  # of matched keyframes, and of frames that make a new piece
KEPT = 12  # last keyframes of a piece that are kept: no more are made during a dissolve

REDUCED = (32, 18)  # pixels of frames that are passed,
LEAST_CORRELATION = 0.9  # and of one and the next, below which there may be a cut

LONGEST_CHAIN = 25  # frames, a second, that are linked one by one


@dataclass(frozen=True, eq=False)
class TiedFrame:
    """A frame of a video, with its piece and the keyframes that it is tied to."""

    index: int
    """Number of the frame, from 0."""
    piece: int
    """Number of the piece, the run of frames that matches connect, from 0 and ascending."""
    key: int
    """Index of the keyframe that it is tied to: its own for a keyframe, the last keyframe's for an untied frame."""
    ties: tuple[tuple[int, Matches], ...]
    """Indices of keyframes, with the matches from each of them to this frame.

    An ordinary frame is tied to `key`, or to none. A keyframe is tied to the keyframes 1, 2 and 4 before it in its
    piece, as far as they match; the first keyframe of a piece is tied to none.
    """
    duplicate: bool
    """Whether the picture equals that of the frame before: the stream repeats a frame, or is frozen."""
    unmatched: tuple[KeyframePair, ...] = ()
    """Pairs of this keyframe and earlier ones that `KeyframeTracker` has left unmatched (`leave_pairs`)."""
    is_passed: bool = False
    """Whether it was not matched, as the tracker was told to leave its piece (`KeyframeTracker.leave`)."""

    @property
    def is_key(self) -> bool:
        """Whether it is a keyframe."""
        return self.index == self.key


class KeyframeTracker:
    """Ties the frames of a video to keyframes as they come.

    A frame that is tied to the current piece is returned at once. Any other frame waits until `CONFIRMED` frames make a
    new piece, or it is clear that they do not: at most ``CONFIRMED - 1`` frames. The pictures of the last keyframes are
    kept, reduced and grey.

    Parameters
    ----------
    every : int
        Frames from one keyframe to the next, at most.
    leave_pairs : bool
        Whether the caller matches keyframes with one another (`TiedFrame.unmatched`), since that takes as long as three
        ordinary frames. A keyframe is then tied to the one before it only.
    moving : bool
        As in `match_background`.

    Examples
    --------
    >>> noise = np.random.default_rng(0).integers(0, 255, (540, 960), np.uint8)
    >>> tracker = KeyframeTracker()
    >>> [tied.is_key for tied in tracker.update(noise)]
    [True]
    >>> tracker.update(noise)[0].duplicate
    True
    """

    def __init__(self, every: int = EVERY, *, leave_pairs: bool = False, moving: bool = False) -> None:
        if not isinstance(every, int | np.integer) or every < 1:
            raise ValueError(f"every must be 1 or more frames, got {every}")
        self._options = _PieceOptions(every, leave_pairs, moving)
        self._count = 0
        self._number = 0  # of the piece that begins when there is none
        self._is_left = False  # whether the piece is followed no more
        self._passed: Array | None = None  # the last frame of it, reduced
        self._last: VideoFrame | None = None  # the last frame that is no duplicate
        self._piece: _Piece | None = None
        self._lost = 0  # number of frames since the last frame that was tied to the piece
        self._candidate: _Piece | None = None  # frames that may become a new piece
        self._waiting: list[TiedFrame] = []  # frames of the candidate

    def leave(self, piece: int) -> None:
        """Match no further frames of the current piece, if that is its number: a cut ends it, or `begin_anew`."""
        if self._piece is not None and self._piece.number == piece and not self._lost:
            self._is_left = True

    def begin_anew(self) -> None:
        """Begin a new piece after one that was left."""
        if self._is_left and self._piece is not None:
            self._number, self._piece, self._passed, self._is_left = self._piece.number + 1, None, None, False

    def _is_passed(self, image: Image) -> bool:
        """Whether a frame goes on with the piece that was left."""
        before, self._passed = self._passed, _reduced(image)
        return before is None or bool(np.corrcoef(before, self._passed)[0, 1] >= LEAST_CORRELATION)

    def update(self, image: Image) -> list[TiedFrame]:
        """Take the next frame; return the frames that are now known to belong to a piece, in order.

        Raises
        ------
        ValueError
            If its size is not that of the frames before, or as `fieldcalib.images.background.matching_frame.Frame.of`.
        """
        if self._is_left and self._piece is not None:
            if self._is_passed(image):
                self._count += 1
                return [TiedFrame(self._count - 1, self._piece.number, self._piece.key.index, (), False, (), True)]
            self.begin_anew()
        frame = Frame.of(image)
        if self._last is not None and frame.image_size != self._last.frame.image_size:
            (width, height), (w, h) = frame.image_size, self._last.frame.image_size
            raise ValueError(f"frame {self._count} has {width} x {height} pixels, those before it {w} x {h}")
        view = VideoFrame(self._count, frame, self._last is not None and same_picture(self._last.frame, frame))
        self._count += 1
        if not view.duplicate:
            self._last = view
        if self._piece is None:
            self._piece = _Piece(view, self._number, self._options)
            return [self._piece.first]
        tied = self._piece.tied(view) if self._lost == 0 else None
        if tied is None and self._lost < LOST_FOR and not (view.duplicate and self._lost):
            tied = self._piece.found_again(view, self._lost)
        if tied is not None:
            self._lost = 0
            return [*self._untied(), tied]
        self._lost += 1
        # frames that are not tied to the piece may begin a new one: they wait until enough are tied to one another
        tied = self._candidate.tied(view, LEAST_LIKENESS_OF_KEY) if self._candidate is not None else None
        if tied is None:
            untied = self._untied()
            self._candidate = _Piece(view, self._piece.number + 1, self._options)
            self._waiting = [self._candidate.first]
            return untied
        self._waiting.append(tied)
        if len(self._waiting) < CONFIRMED:
            return []
        new = self._waiting
        self._piece, self._candidate, self._waiting, self._lost = self._candidate, None, [], 0
        return new

    def finish(self) -> list[TiedFrame]:
        """Return the frames that still wait at the end of the video; two or more of them make a short piece."""
        if len(self._waiting) == 1:
            return self._untied()
        new, self._waiting = self._waiting, []
        return new

    def _untied(self) -> list[TiedFrame]:
        """Give the waiting frames back as untied frames of the current piece."""
        assert self._piece is not None  # nothing waits before the first frame
        piece, waiting = self._piece, self._waiting
        self._candidate, self._waiting = None, []
        return [replace(tied, piece=piece.number, key=piece.key.index, ties=()) for tied in waiting]


def tied_frames(
    images: Iterable[Image], *, every: int = EVERY, moving: bool = False, tracker: KeyframeTracker | None = None
) -> Iterator[tuple[Image, TiedFrame]]:
    """Tie the frames of a video to keyframes, in one pass.

    Parameters
    ----------
    images : iterable of (height, width, 3) or (height, width) uint8 arrays
        The frames, in order and of one size.
    every : int
        Frames from one keyframe to the next, at most.
    moving : bool
        As in `match_background`.
    tracker : KeyframeTracker, optional
        Takes the place of `every` and `moving`: one that the caller may tell to leave pieces.

    Yields
    ------
    image, tied
        Each frame and its `TiedFrame`, in order. The generator is at most 8 frames ahead of what it yields.

    Raises
    ------
    ValueError
        If the frames are of several sizes or no uint8 pictures.

    Notes
    -----
    The first frame of a piece is a keyframe. Further keyframes follow every `every` frames, or earlier if little of the
    keyframe is still in view or few matches are left. An ordinary frame is matched with the keyframe before it. The
    search starts from the motion of the last frames; else from the motion since the frame before; else from descriptors
    (`match_far`), also of earlier keyframes. Flashes, wipes and the like stay untied. The piece goes on if a frame is
    tied to it within 30 frames, unless before that 8 frames in a row are tied to one another: these are a new piece.

    Examples
    --------
    >>> import cv2
    >>> noise = np.random.default_rng(0).integers(0, 255, (68, 120), np.uint8)
    >>> scene = cv2.resize(noise, (960, 540), interpolation=cv2.INTER_CUBIC)
    >>> pan = [cv2.warpAffine(scene, np.array([[1.0, 0.0, 2.0 * i], [0.0, 1.0, 0.0]]), (960, 540)) for i in range(20)]
    >>> cut = [*pan, *(picture[::-1] for picture in pan)]
    >>> [tied.index for _, tied in tied_frames(cut) if tied.is_key]
    [0, 12, 20, 32]
    >>> [tied.piece for _, tied in tied_frames(cut)] == 20 * [0] + 20 * [1]
    True
    """
    waiting = deque[Image]()
    tracker = tracker or KeyframeTracker(every, moving=moving)
    for image in images:
        waiting.append(image)
        for tied in tracker.update(image):
            yield waiting.popleft(), tied
    for tied in tracker.finish():
        yield waiting.popleft(), tied


def _reduced(image: Image) -> Array:
    """A picture as a few grey pixels."""
    import cv2

    small = cv2.resize(image, REDUCED, interpolation=cv2.INTER_AREA)
    return np.asarray(small if small.ndim == 2 else small.mean(axis=2), float).ravel()


@dataclass(frozen=True, eq=False)
class KeyframePair:
    """A keyframe and an earlier keyframe of its piece, still to be matched."""

    first: VideoFrame
    second: VideoFrame
    H: Array
    """Homography from the first to the second, to a few pixels."""
    moving: bool
    """Whether the camera moves, see `match_background`."""

    @property
    def indices(self) -> tuple[int, int]:
        """Indices of the earlier frame and of the later one."""
        return self.first.index, self.second.index

    def matches(self) -> Matches | None:
        """Match the first with the second; None if they do not show the same scene."""
        found = _matched(self.first, self.second, self.H, MOST_CORNERS, self.moving)
        return None if found is None or found[1] < LEAST_LIKENESS_OF_KEY else found[0]


@dataclass(frozen=True)
class _PieceOptions:
    """The arguments of `KeyframeTracker`."""

    every: int
    leave_pairs: bool
    moving: bool


class _Piece:
    """The piece that is being tracked: its last keyframes, its last frame and the last motion of the camera."""

    def __init__(self, view: VideoFrame, number: int, options: _PieceOptions) -> None:
        self.number = number
        self.first = TiedFrame(view.index, number, view.index, (), view.duplicate)
        self._options = options
        self._keys = deque([(view, np.eye(3))], maxlen=KEPT)  # each with the homography from it to the newest
        self._last = view
        self._matches: Matches | None = None  # from the newest keyframe to the last frame; None if they are the same
        self._motion: Array = np.eye(3)  # homography from the last frame but one to the last

    @property
    def key(self) -> VideoFrame:
        return self._keys[-1][0]

    @property
    def _H(self) -> Array:
        """Homography from the newest keyframe to the last frame."""
        return np.eye(3) if self._matches is None else self._matches.homography

    def tied(self, view: VideoFrame, least: float = LEAST_LIKENESS) -> TiedFrame | None:
        """Tie the frame after the last one to the newest keyframe; None if that fails."""
        if view.duplicate and self._matches is not None:
            return self._ordinary(view, self._matches)
        corners = MOST_CORNERS if self._options.leave_pairs and self._is_due(view) else CORNERS
        found = _matched(self.key, view, self._motion @ self._H, corners, self._options.moving)
        if found is None and self._matches is not None:
            step = match_background(self._last.frame, view.frame, corners=CORNERS, moving=self._options.moving)
            H = None if step is None else step.homography @ self._H
            found = None if H is None else _matched(self.key, view, H, CORNERS, self._options.moving)
        if found is None or found[1] < least:
            return None
        if not view.duplicate:
            self._motion = found[0].homography @ np.linalg.inv(self._H)
        return self._added(view, *found)

    def found_again(self, view: VideoFrame, missed: int) -> TiedFrame | None:
        """Tie a frame to the newest keyframe or to earlier ones, after `missed` untied frames; None if that fails."""
        for start in (np.linalg.matrix_power(self._motion, missed + 1) @ self._H, self._H):
            found = _matched(self.key, view, start, CORNERS, self._options.moving)
            if found is not None and found[1] >= LEAST_LIKENESS_OF_KEY:
                return self._added(view, *found)
        back = BACK[missed % len(BACK)]  # one earlier keyframe per frame, since this takes long
        if back > len(self._keys):
            return None
        older, to_newest = self._keys[-back]
        far = match_far(older.frame, view.frame, moving=self._options.moving)
        if far is None or likeness(older, view, far.homography) < LEAST_LIKENESS_OF_KEY:
            return None
        self._motion = np.eye(3)
        return self._keyframe(view, far.homography @ np.linalg.inv(to_newest))

    def _is_due(self, view: VideoFrame) -> bool:
        return view.index - self.key.index >= self._options.every

    def _added(self, view: VideoFrame, matches: Matches, likeness: float) -> TiedFrame:
        due = self._is_due(view) or len(matches) < FEW_MATCHES
        due = due or shared_view(matches.homography, view.frame.image_size) < LEAST_IN_VIEW
        key = None
        if due and likeness >= LEAST_LIKENESS_OF_KEY and not view.duplicate:
            key = self._keyframe(view, matches.homography, matches)
        return self._ordinary(view, matches) if key is None else key

    def _ordinary(self, view: VideoFrame, matches: Matches) -> TiedFrame:
        self._last, self._matches = view, matches
        return TiedFrame(view.index, self.number, self.key.index, ((self.key.index, matches),), view.duplicate)

    def _keyframe(self, view: VideoFrame, H: Array, matches: Matches | None = None) -> TiedFrame | None:
        """Make a frame the next keyframe; None if it is unlike earlier ones.

        `H` maps the newest keyframe to it; `matches` are its matches with the newest keyframe, if it was already tied
        to that one as an ordinary frame.
        """
        size = view.frame.image_size
        for older, to_newest in self._keys:
            recent = view.index - older.index <= MIXED_FOR and shared_view(H @ to_newest, size) >= MOSTLY_IN_VIEW
            if recent and likeness(older, view, H @ to_newest) < LEAST_LIKENESS:
                return None
        earlier = [self._keys[-back] for back in BACK if back <= len(self._keys)]
        pairs = tuple(KeyframePair(older, view, H @ to_newest, self._options.moving) for older, to_newest in earlier)
        if self._options.leave_pairs and matches is not None:
            ties: tuple[tuple[int, Matches], ...] = ((self.key.index, matches),)
            unmatched = pairs[1:]
        else:
            ties = tuple((pair.indices[0], found) for pair in pairs if (found := pair.matches()) is not None)
            unmatched = ()
        if not ties:
            return None
        moved = [(older, H @ to_newest) for older, to_newest in self._keys]
        self._keys = deque([*moved, (view, np.eye(3))], maxlen=KEPT)
        self._last, self._matches = view, None
        return TiedFrame(view.index, self.number, view.index, ties, view.duplicate, unmatched)


def _matched(
    first: VideoFrame, second: VideoFrame, start: Array, corners: int, moving: bool
) -> tuple[Matches, float] | None:
    """Match two frames; returns the matches and the frames' likeness, None if they do not show the same scene."""
    matches = match_background(first.frame, second.frame, start=start, corners=corners, moving=moving)
    if matches is None:
        return None
    alike = likeness(first, second, matches.homography)
    return None if alike < LEAST_LIKENESS else (matches, alike)


@dataclass
class _Chain:
    """Untied frames in a row after a tied frame, each matched with the frame before it."""

    first: VideoFrame
    last: VideoFrame
    links: list[Matches] = field(default_factory=list)
    """Matches of each frame with the one before it."""
    waiting: list[tuple[Image, TiedFrame]] = field(default_factory=list)
    """Frames of the chain, kept back until it is known whether it ends at a tied frame."""

    def takes(self, view: VideoFrame, moving: bool) -> bool:
        """Link the next frame to the last one; returns whether both show the same scene."""
        found = match_background(self.last.frame, view.frame, moving=moving)
        if found is None or likeness(self.last, view, found.homography) < LEAST_LIKENESS_OF_KEY:
            return False
        self.links.append(found)
        self.last = view
        return True

    @property
    def is_of_one_shot(self) -> bool:
        """Whether both ends of the chain show the same scene, unlike those of a dissolve.

        If little of one end is in view in the other, they cannot be compared, and this is true.
        """
        H = np.eye(3)
        for link in self.links:
            H = link.homography @ H
        if shared_view(H, self.last.frame.image_size) < LEAST_IN_VIEW:
            return True
        return likeness(self.first, self.last, H) >= LEAST_LIKENESS

    @property
    def linked(self) -> list[tuple[Image, TiedFrame]]:
        """The waiting frames, each tied to the one before it."""
        return [
            (image, replace(tied, ties=((tied.index - 1, link),)))
            for (image, tied), link in zip(self.waiting, self.links, strict=False)
        ]


def linked_frames(
    frames: Iterable[tuple[Image, TiedFrame]], *, moving: bool = False
) -> Iterator[tuple[Image, TiedFrame]]:
    """Tie untied frames to the frames before them, where such a chain connects two tied frames.

    Parameters
    ----------
    frames : iterable of (image, TiedFrame)
        As `fieldcalib.images.background.keyframe_tracking.tied_frames` yields them.
    moving : bool
        As in `match_background`.

    Yields
    ------
    image, tied
        The same frames in order, delayed by up to 25 frames. Pieces that a chain connects get the number of the first.
    """
    chain: _Chain | None = None
    joined = 0  # by how much the numbers of later pieces decrease, as pieces were joined
    piece = 0

    for image, tied in frames:
        is_end = tied.is_key or bool(tied.ties)
        view = VideoFrame(tied.index, Frame.of(image), tied.duplicate)
        linked: list[tuple[Image, TiedFrame]] = []
        if chain is not None and (chain.waiting or not tied.ties):
            is_linked = len(chain.waiting) < LONGEST_CHAIN and chain.takes(view, moving)
            if is_linked and not is_end:
                chain.waiting.append((image, replace(tied, piece=piece)))
                continue
            if is_linked and chain.is_of_one_shot:
                linked = chain.linked
                if not tied.ties:
                    joined = tied.piece - piece
                    tied = replace(tied, ties=((tied.index - 1, chain.links[-1]),))
            yield from linked or chain.waiting
        piece = tied.piece - joined
        yield image, replace(tied, piece=piece)
        chain = _Chain(view, view) if is_end else None
    if chain is not None:
        yield from chain.waiting
