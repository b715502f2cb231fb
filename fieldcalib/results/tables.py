"""Results as tables of pandas."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from fieldcalib._extras import imported

if TYPE_CHECKING:
    import pandas

FOR_READING_BACK = frozenset({"version", "field", "solved", "errors"})  # keys without a column


def short_table(lines: Iterable[Mapping[str, Any]]) -> pandas.DataFrame:
    """The table of the lines of ``cameras.jsonl`` with one number or text in each cell."""
    pandas = imported("pandas", "pandas", "to_pandas")
    return pandas.DataFrame([_row(line) for line in lines], columns=["id", *COLUMNS]).set_index("id")


def whole_table(lines: Iterable[Mapping[str, Any]]) -> pandas.DataFrame:
    """The table of everything that is kept of frames; nested keys are joined as "angles_degrees.pan"."""
    pandas = imported("pandas", "pandas", "to_pandas")
    rows = [{key: value for key, value in line.items() if key not in FOR_READING_BACK} for line in lines]
    table = pandas.json_normalize(rows) if rows else pandas.DataFrame(columns=["id"])
    return table.set_index("id")


def _row(line: Mapping[str, Any]) -> dict[str, Any]:
    """The cells of a frame; what it does not have is missing."""
    words = {name: line[name] for name in WORDS if name in line}
    row = {"id": line["id"], **words, "reason": line.get("reason", line["message"])}
    if line.get("field") is not None:
        row |= {f"field_{name}_m": line["field"][name] for name in ("length", "width")}
    if line.get("K") is None:
        return row
    K, angles, deviations = line["K"], line["angles_degrees"], line.get("standard_deviations")
    row |= dict(zip(("image_width_px", "image_height_px"), line["image_size"], strict=True))
    row |= {"focal_length_px": K[0][0], "principal_point_x_px": K[0][2], "principal_point_y_px": K[1][2]}
    row |= {f"{name}_degrees": angle for name, angle in angles.items()}
    row |= dict(zip(("x_m", "y_m", "z_m"), line["C"], strict=True)) | {"k1": line["dist"][0]}
    row |= {name: _number(line.get(name)) for name in ("rms_px", "probability_right_1m")}
    return row if deviations is None else row | {"focal_length_sd_px": _number(deviations["focal_length_px"])}


def _number(value: Any) -> float | None:
    """A number of JSON, where infinity is a text."""
    return None if value is None else float(value)


WORDS = ("status", "verdict", "reason", "remedy", "basis")
COLUMNS = (
    *WORDS,
    *("focal_length_px", "focal_length_sd_px", "pan_degrees", "tilt_degrees", "roll_degrees", "x_m", "y_m", "z_m"),
    *("k1", "principal_point_x_px", "principal_point_y_px", "image_width_px", "image_height_px"),
    *("rms_px", "probability_right_1m", "field_length_m", "field_width_m"),
)
