"""Frames that no keyframe is matched with, tied to the frames right before them.

In a fast pan or zoom a frame may show too little of the keyframe before it, or too blurred, while it still matches its
neighbour. Errors add up along a chain of such frames, so that it is used only where nothing else ties frames, and only
as a whole: from a tied frame to the next one, or to the first one of the next piece, which is then no new piece.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from fieldcalib.images.frame import Frame, VideoFrame, likeness, shared_view
from fieldcalib.images.keyframes import LEAST_IN_VIEW, LEAST_LIKENESS, LEAST_LIKENESS_OF_KEY, TiedFrame
from fieldcalib.images.matches import Matches, match_background
from fieldcalib.io.image import Image

LONGEST_CHAIN = 25  # frames, a second


@dataclass
class _Chain:
    """Frames in a row that nothing else ties, after a tied one."""

    first: VideoFrame
    last: VideoFrame
    links: list[Matches] = field(default_factory=list)
    """Matches of each frame with the one before it."""
    waiting: list[tuple[Image, TiedFrame]] = field(default_factory=list)

    def takes(self, view: VideoFrame, moving: bool) -> bool:
        """Link the next frame; returns whether it shows what the last one shows."""
        found = match_background(self.last.frame, view.frame, moving=moving)
        if found is None or likeness(self.last, view, found.homography) < LEAST_LIKENESS_OF_KEY:
            return False
        self.links.append(found)
        self.last = view
        return True

    @property
    def is_of_one_shot(self) -> bool:
        """Whether both ends show the same scene, unlike those of a dissolve; they count as the same if far apart."""
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
    """Tie frames that nothing ties to the frames before them, where these connect tied ones.

    Parameters
    ----------
    frames : iterable of (image, TiedFrame)
        As `fieldcalib.images.keyframes.tied_frames` yields them.
    moving : bool
        As in `match_background`.

    Yields
    ------
    image, tied
        The same frames in order, up to 25 of them later. Pieces that a chain connects have the number of the first.
    """
    chain: _Chain | None = None
    joined = 0  # numbers by which later pieces are lower
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
