"""Which frame of a clip to mend next: one that helps as many others as possible."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fieldcalib.assess.findings import Verdict
from fieldcalib.editor.fitting import network_marks
from fieldcalib.editor.table import Row
from fieldcalib.fields.field import Field
from fieldcalib.io.files import BrokenFileError
from fieldcalib.localize import Network
from fieldcalib.run_folder.numbered_frames import NumberedFrames

LOOKED_AT = 9  # frames of a stretch in which markings are counted
BESIDE_MENDED = 5  # frames around one that was mended already, whose view is nearly the same


def next_frame(frames: NumberedFrames, rows: Sequence[Row], field: Field, network: Network | None) -> int | None:
    """The frame to mend next; None if all are good.

    It is in the stretch of frames whose cameras are not good that gives most cause for concern in all, and there the
    one that shows most markings: its labels determine the camera, and matches hand it on to its neighbours. Without a
    network it is in the middle.
    """
    stretches = sorted(_stretches(rows), key=lambda stretch: -sum(rows[n].concern for n in stretch))
    if not stretches:
        return None
    mended = np.array([n for n, row in enumerate(rows) if row.by_hand])
    far: list[int] = [n for n in stretches[0] if not len(mended) or np.min(np.abs(mended - n)) > BESIDE_MENDED]
    candidates = far or [*stretches[0]]
    middle: int = candidates[len(candidates) // 2]
    if network is None:
        return middle
    spread = np.linspace(0, len(candidates) - 1, min(len(candidates), LOOKED_AT)).round().astype(int)
    counts: dict[int, int] = {candidates[k]: _markings(frames, candidates[k], field, network) for k in spread.tolist()}
    return max(counts, key=lambda n: (counts[n], -abs(n - middle)))


def _stretches(rows: Sequence[Row]) -> Iterator[list[int]]:
    """Runs of frames that were not mended and whose cameras are not good."""
    run: list[int] = []
    for n, row in enumerate(rows):
        if row.verdict == Verdict.GOOD or row.by_hand:
            if run and row.verdict == Verdict.GOOD:
                yield run
                run = []
        else:
            run.append(n)
    if run:
        yield run


def _markings(frames: NumberedFrames, number: int, field: Field, network: Network) -> int:
    """How many markings the network finds in a frame; none where it cannot be read."""
    try:
        return len(network_marks(field, frames.image(number), network).pixels)
    except BrokenFileError:
        return 0
