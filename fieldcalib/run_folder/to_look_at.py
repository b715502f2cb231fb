"""Frames of a run that a user should look at: the first few with their reasons, and where to find the others."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from dataclasses import field as attribute

from fieldcalib._messages import counted
from fieldcalib.assess.findings import Advice, Remedy, Tool, Verdict, how

NAMED = 5  # number of stretches that are named


@dataclass(frozen=True)
class Stretch:
    """Consecutive frames with the same reason, up to its numbers."""

    first: str
    """Id of the first frame."""
    verdict: str
    reason: str
    """Reason of the first frame."""
    kind: str = ""
    """What is against the camera, without numbers: frames with the same are told together."""
    count: int = 1

    def __str__(self) -> str:
        """Format for stderr."""
        others = f" and {self.count - 1} after it" if self.count > 1 else ""
        return f"{self.first}{others}: {self.verdict}, {self.reason}"


@dataclass
class ToLookAt:
    """Collects the frames of a run whose verdict is not good.

    Examples
    --------
    >>> from fieldcalib.assess.findings import Finding, What
    >>> seen = ToLookAt()
    >>> seen.add("000000", "good", "rms 0.45 px over 5 segments")
    >>> for id, px in ("000001", 9.0), ("000002", 7.0):
    ...     found = Finding(What.OFF_PAINT, "Middle line", (px,))
    ...     seen.add(id, "check", f"{found}; rms 0.5 px over 5 segments", kind="off paint Middle line")
    >>> print(seen.message("out/cameras.jsonl"))
    2 frames to look at (all reasons and remedies: out/cameras.jsonl):
      000001 and 1 after it: check, 'Middle line' lies 9 px beside its paint
    >>> seen.add("000003", "reject", "too few", "more markings in view, or labelled by hand", [Advice.BY_HAND])
    >>> print(seen.message("out/cameras.jsonl").splitlines()[-1])
      what would help: more markings in view, or labelled by hand; on the command line: fieldcalib open
    >>> seen.add("000004", "check", "a softer picture", "the whole frame")
    >>> print(seen.message("out/cameras.jsonl").splitlines()[-1])
      what would help 000004: the whole frame
    """

    stretches: list[Stretch] = attribute(default_factory=list)
    """The first stretches of such frames."""
    count: int = 0
    """Number of all such frames."""
    named: int = 0
    """Number of frames in `stretches`."""
    remedies: dict[Remedy, dict[str, None]] = attribute(default_factory=dict)
    """Remedies of the frames in `stretches`, in their order, with the first frames of these stretches."""
    _is_next: bool = False

    def add(
        self, id: str, verdict: str, reason: str, remedy: str = "", advice: Iterable[Advice] = (), kind: str = ""
    ) -> None:
        """Add the next frame; a frame without a verdict, which could not be read, is skipped."""
        if not verdict or verdict == Verdict.GOOD:
            self._is_next = False
            return
        self.count += 1
        last = self.stretches[-1] if self._is_next else None
        if last is not None and (last.verdict, last.kind) == (verdict, kind):
            self.stretches[-1] = replace(last, count=last.count + 1)
        elif len(self.stretches) < NAMED:
            self.stretches.append(Stretch(id, verdict, reason.partition("; ")[0], kind))
        else:
            self._is_next = False
            return
        self._is_next = True
        self.named += 1
        if remedy:
            self.remedies.setdefault(Remedy(remedy, tuple(advice)), {})[self.stretches[-1].first] = None

    def message(self, *where: str) -> str:
        """Message with the frames, and where all are to be found; empty if all are good."""
        if not self.count:
            return ""
        head = f"{counted(self.count, 'frame')} to look at (all reasons and remedies: {', '.join(where)}):"
        rest = [f"and {self.count - self.named} more"] if self.count > self.named else []
        help = []
        for remedy, ids in self.remedies.items():
            whom = f" {', '.join(ids)}" if len(self.remedies) > 1 else ""
            said = how(remedy.advice, Tool.COMMAND)
            help.append(f"what would help{whom}: {remedy.text}{f'; on the command line: {said}' if said else ''}")
        return "\n  ".join([head, *map(str, self.stretches), *rest, *help])
