"""Players of `fieldcalib project` in pictures of the field: their positions, colours and trails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np

from fieldcalib._progress import counted
from fieldcalib._types import Array
from fieldcalib.cli.frame_cameras import Cameras
from fieldcalib.console.arguments import count
from fieldcalib.console.options import option
from fieldcalib.draw.ground import COLOURS, Colour
from fieldcalib.fields.field import Field
from fieldcalib.io.players import Player, Players, read_players

SHIRTS = COLOURS["players"]
SYNONYMS = {"purple": "violet"}
ONE, NO_GROUP = "red", (150, 150, 150)  # colours where there are no groups, and of players without one


@dataclass(frozen=True)
class PlayerOptions:
    """Options of commands that draw players."""

    trails: int = option("draw where each player came from, over N frames (none)", default=0, type=count, metavar="N")
    colour_by: str | None = option(
        "of the table, whose values get colours: team, class, id (the first there is of team, class, role)",
        metavar="COLUMN",
    )
    frame_offset: int = option("added to the numbers of frames, as of project (0)", default=0, type=int, metavar="N")


class PlayersOnMaps:
    """Players by the ids of frames in a folder of results.

    Parameters
    ----------
    path : Path or None
        What `project` wrote; None for no players.
    cameras : Cameras
    field : Field
    options : PlayerOptions

    Raises
    ------
    ValueError
        If no frame is among the results, there are no tracks for trails, or most players are off the field.
    """

    def __init__(self, path: Path | None, cameras: Cameras, field: Field, options: PlayerOptions) -> None:
        self._order = {id: index for index, id in enumerate(cameras.ids)}
        self._at: dict[int, list[Player]] = {}
        self._count = options.trails
        if path is None:
            self._table = Players({}, None, None)
            self._colours: dict[str, str] = {}
            return
        self._table = read_players(path, options.colour_by)
        if self._count and self._table.track_column is None:
            raise ValueError(f"{path} has no column track_id, tracker_id or id: --trails needs one")
        for frame, players in self._table.frames.items():
            id = cameras.id_of(frame, options.frame_offset)
            if id is not None:
                self._at.setdefault(self._order[id], []).extend(players)
        if not self._at:
            frame = next(iter(self._table.frames), "none")
            raise ValueError(f"no frame of {path} is among those of {cameras.path}: {cameras.naming_hint(frame)}")
        _check_on_field(self._table.X, field, path)
        self._colours = colours_of(self._table.groups)

    @property
    def ids(self) -> list[str]:
        """The frames of the results from the first to the last one with players; all if no players are given."""
        ids = list(self._order)
        return ids[min(self._at) : max(self._at) + 1] if self._at else ids

    def missing(self, id: str) -> str:
        """A line of output if the table has no row of a frame, but of others; empty if it has some."""
        if not self._at or self._order[id] in self._at:
            return ""
        has = f"the table has {counted(len(self._at), 'frame')}, {self.ids[0]} to {self.ids[-1]}"
        return f"no players: they are those of {id}, the last frame that is drawn, and {has}"

    def of(self, id: str) -> tuple[Array, list[Colour], list[Array]]:
        """Points (N, 2) of the players in a frame, their colours, and their trails; NaN where there is no point."""
        place = self._order[id]
        players = self._at.get(place, [])
        points = np.array([player.X for player in players]).reshape(-1, 2)
        colours = [self._colour(player) for player in players] or [SHIRTS[ONE]]  # nobody needs it, but drawing does
        if not self._count:
            return points, colours, []
        past = [
            {player.track: player.X for player in self._at.get(index, ()) if player.track}
            for index in range(max(place - self._count, 0), place + 1)
        ]
        trails = [np.array([there.get(player.track, (np.nan, np.nan)) for there in past]) for player in players]
        return points, colours, trails

    def _colour(self, player: Player) -> Colour:
        if not self._colours:
            return SHIRTS[ONE]
        return SHIRTS[self._colours[player.group]] if player.group else NO_GROUP

    @property
    def legend(self) -> str:
        """A line of output that explains the colours; empty if there is only one."""
        # not "blue is blue"
        other = [(group, colour) for group, colour in self._colours.items() if group.lower() != colour]
        groups = [f"{group} is {colour}" for group, colour in other[: len(SHIRTS)]]
        more = ", ..." if len(other) > len(SHIRTS) else ""
        return f"{self._table.group_column}: {', '.join(groups)}{more}" if groups else ""


def colours_of(groups: Sequence[str]) -> dict[str, str]:
    """Choose a colour for each group: its own name if that is a colour, or else one that no group is named after.

    Examples
    --------
    >>> colours_of(["home", "Red", "purple", "away"])
    {'home': 'blue', 'Red': 'red', 'purple': 'violet', 'away': 'yellow'}
    """
    called = {group: SYNONYMS.get(group.lower(), group.lower()) for group in groups}
    own = {group: name for group, name in called.items() if name in SHIRTS}
    others = cycle([name for name in SHIRTS if name not in own.values()] or list(SHIRTS))
    return {group: own[group] if group in own else next(others) for group in groups}


def _check_on_field(X: Array, field: Field, path: Path) -> None:
    X = X[np.isfinite(X).all(axis=-1)]
    if len(X) and np.mean(np.any(np.abs(X) > field.half_extent, axis=-1)) > 0.5:
        raise ValueError(
            f"most points of {path} are off a field of {field.length:g} x {field.width:g} m: expected metres from the "
            f"centre mark, as project writes them without --to"
        )
