"""Players on the field, frame by frame, as `fieldcalib project` writes them."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fieldcalib._types import Array
from fieldcalib.io.boxes import FRAME_COLUMNS
from fieldcalib.io.coordinates import OWN_SYSTEMS
from fieldcalib.io.files import BrokenFileError

POINT = ("field_x", "field_y")
SYSTEM = "field_system"  # name of the coordinate system; the package's own where it is missing
# columns that tell players apart, in the order of preference
GROUPS = ("team", "team_id", "class", "class_name", "role")
TRACKS = ("track_id", "tracker_id", "player_id", "id")

NO_TRACK = ("-1", "-1.0", "nan", "None")  # values of trackers for no track


@dataclass(frozen=True)
class Player:
    """A row: one player in one frame."""

    X: tuple[float, float]
    """Metres; NaN where there is no point."""
    group: str
    """The group, such as the team; empty if unknown."""
    track: str
    """Name of the track, equal in all frames; empty if unknown."""


@dataclass(frozen=True)
class Players:
    """The players of many frames."""

    frames: Mapping[str, Sequence[Player]]
    """Players by the names of their frames, as written; in the order of the file."""
    group_column: str | None
    """Column of `Player.group`."""
    track_column: str | None

    @property
    def groups(self) -> list[str]:
        """All groups but the empty one, numbers by their size."""
        found = {player.group for players in self.frames.values() for player in players}
        return sorted(found - {""}, key=lambda name: (len(name), name) if name.isdecimal() else (0, name))

    @property
    def X(self) -> Array:
        """All points, (N, 2)."""
        return np.array([player.X for players in self.frames.values() for player in players]).reshape(-1, 2)


def read_players(path: Path | str, group_column: str | None = None) -> Players:
    """Players from the table of `fieldcalib project`, or any with a frame and a point in each row.

    Parameters
    ----------
    path : path
        A CSV file with the columns `frame` (or another of `fieldcalib.io.boxes.FRAME_COLUMNS`), `field_x`
        and `field_y`, metres from the centre mark. `field_system`, if present, is "fieldcalib" or "soccernet".
    group_column : str, optional
        Column that tells players apart; default: the first of team, team_id, class, class_name and role that is there.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    BrokenFileError
        If a column is missing, a row is malformed, or its point is in another coordinate system; the message begins
        with the path and the line.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "players.csv"
    ...     _ = path.write_text("frame,id,team,field_x,field_y\\n0,7,left,11.8,-8.7\\n0,9,right,,\\n")
    ...     players = read_players(path)
    >>> players.frames["0"][0]
    Player(X=(11.8, -8.7), group='left', track='7')
    >>> players.groups, players.track_column
    (['left', 'right'], 'id')
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist: expected the table that fieldcalib project wrote")
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file, strict=True)
        try:
            columns = [name.strip() for name in next(reader, [])]
            frame, group, track = _columns(columns, group_column)
            x, y = (columns.index(name) for name in POINT)
            system = columns.index(SYSTEM) if SYSTEM in columns else None
            frames: dict[str, list[Player]] = {}
            for values in reader:
                if len(values) not in (0, len(columns)):
                    raise BrokenFileError(f"expected {len(columns)} columns, got {len(values)}")
                if values:
                    _check_system("" if system is None else values[system].strip())
                    said = ["" if column is None else values[column].strip() for column in (group, track)]
                    X = _number(values[x]), _number(values[y])
                    player = Player(X, said[0], "" if said[1] in NO_TRACK else said[1])
                    frames.setdefault(values[frame].strip(), []).append(player)
        except UnicodeDecodeError:
            raise BrokenFileError(f"{path}: is no text in UTF-8") from None
        except (csv.Error, BrokenFileError) as error:
            raise BrokenFileError(f"{path}, line {max(reader.line_num, 1)}: {error}") from None
    return Players(frames, *(None if column is None else columns[column] for column in (group, track)))


def _columns(columns: Sequence[str], group_column: str | None) -> tuple[int, int | None, int | None]:
    """Places of the frame, of the group and of the track."""
    lower = [name.lower() for name in columns]
    frame, group, track = (
        next((lower.index(name) for name in names if name in lower), None) for names in (FRAME_COLUMNS, GROUPS, TRACKS)
    )
    missing = [name for name in POINT if name not in columns]
    if frame is None or missing:
        wanted = "frame" if frame is None else missing[0]
        raise BrokenFileError(f"expected a column {wanted!r}, as project writes it, got {', '.join(columns)}")
    if group_column is not None:
        if group_column not in columns:
            raise BrokenFileError(f"expected a column {group_column!r}, got {', '.join(columns)}")
        group = columns.index(group_column)
    return frame, group, track


def _check_system(system: str) -> None:
    if system and system not in OWN_SYSTEMS:
        raise BrokenFileError(
            f"the points are in the coordinates of {system!r}, expected those of {OWN_SYSTEMS[0]!r}, metres from the "
            f"centre mark: write the table again, without --to"
        )


def _number(text: str) -> float:
    try:
        return float(text) if text.strip() else np.nan
    except ValueError:
        raise BrokenFileError(f"expected metres, got {text!r}") from None
