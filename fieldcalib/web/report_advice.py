"""How the advice of a report is followed: the commands to type, with the folder and the input of the run."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fieldcalib.assess.findings import Advice, Remedy, Tool, advice_from_json, how
from fieldcalib.io.results import BROKEN
from fieldcalib.results.collection import Results
from fieldcalib.run_folder.record import RunRecord

LOOK_AND_LABEL = Remedy(
    "look at the picture: if the projected markings lie on their paint, use the camera; if not, label the frame by hand"
)
UNREADABLE = Remedy("the file cannot be read: get it again, or leave it out")


def remedy_of(line: Mapping[str, Any]) -> Remedy:
    """The remedy of a frame's line of ``cameras.jsonl``."""
    if line["status"] == BROKEN:
        return UNREADABLE
    said = line.get("remedy")
    return Remedy(said, advice_from_json(line.get("advice"))) if said else LOOK_AND_LABEL


@dataclass(frozen=True)
class Commands:
    """Commands on the results of a run.

    Examples
    --------
    >>> commands = Commands("out", "match.mp4")
    >>> commands.how(Remedy("more markings in view, or labelled by hand", (Advice.BY_HAND,)))
    'fieldcalib open out (choose this frame, a marking on the map, and click along it; then Save)'
    >>> commands.how(LOOK_AND_LABEL).split(" (")[0]
    'fieldcalib open out'
    """

    folder: str = "FOLDER"
    """Of the results, as it is typed."""
    source: str = "INPUT"
    """Pictures or the video."""

    @classmethod
    def of(cls, results: Results) -> Commands:
        """Those of some results, as far as they know their folder and their input."""
        if results.folder is None:
            return cls()
        record = RunRecord.read(Path(results.folder))
        paths = () if record is None else record.source
        return cls(shlex.quote(str(results.folder)), shlex.join(paths) or cls.source)

    def how(self, remedy: Remedy) -> str:
        """What to type, and what to do there."""
        if remedy is UNREADABLE:
            return f"put the file in its place, then {self._run}"
        said = f"fieldcalib open {self.folder} (choose this frame, a marking on the map, and click along it; then Save)"
        known = how([one for one in remedy.advice if one not in (Advice.LOOK, Advice.BY_HAND)], Tool.COMMAND)
        return f"{said}; or {self._run} with {known}" if known else said

    @property
    def _run(self) -> str:
        return f"fieldcalib run {self.source} --out NEW-FOLDER"


OF_ANY = Commands()
"""Those of results whose folder is not known."""
