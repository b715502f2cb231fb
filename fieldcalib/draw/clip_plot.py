"""Plots of the cameras of a clip: angles, focal length and centre over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray, listed, number
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.draw.scene import SHIFT, Colour, draw_text, fixed_point, text_size
from fieldcalib.draw.sheet import checked_calibrations
from fieldcalib.io.image_files import Image
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F

FINER = 2  # drawn at twice the size and reduced: OpenCV's letters have rough edges
FIGURE = (1280, 1000)  # px
LEFT, RIGHT, TOP, BOTTOM, GAP = 160, 118, 44, 48, 12  # px around the panels, and between them
STRIP = 12  # px, the height of the strip of statuses
TICKS_UP, TICKS_ALONG = 5, 10  # largest numbers of ticks
WITHIN = 4.0  # interdecile ranges around the median: values further out are ignored by the scale of a panel
PADDING = 0.08  # of a panel's height above and below

PAPER: Colour = (255, 255, 255)
PANEL: Colour = (250, 247, 245)
GRID: Colour = (228, 224, 220)
INK: Colour = (50, 42, 38)
FAINT: Colour = (105, 96, 92)
LINE: Colour = (170, 90, 20)
BAND: Colour = (240, 205, 165)
REJECTED_LINE: Colour = (60, 60, 220)
NO_CAMERA: Colour = (205, 200, 196)

Box: TypeAlias = tuple[float, float, float, float]  # left, top, right, bottom

QUANTITIES = ("pan", "tilt", "roll", "focal length", "centre x", "centre y", "centre z")
UNITS = ("deg", "deg", "deg", "px", "m", "m", "m")
ACCEPTED, REJECTED, NONE = "accepted", "rejected", "no camera"
STRIP_COLOURS: dict[str, Colour] = {
    ACCEPTED: (90, 165, 70),
    "lines and matches": (90, 165, 70),
    "lines": (140, 200, 150),
    "matches": (205, 150, 60),
    "interpolated": (60, 175, 240),
    REJECTED: REJECTED_LINE,
    NONE: NO_CAMERA,
}


@dataclass(frozen=True)
class Curve:
    """One quantity of the cameras over the frames of a clip."""

    name: str
    unit: str
    values: Array
    """(T,), NaN where there is no camera."""
    low: Array
    """Lower ends of the 95 % intervals, (T,); NaN where they are not known."""
    high: Array
    shot: IntArray
    """Number of the shot of each frame, (T,)."""


def plot_sequence(calibrations: Sequence[Calibration | None], *, frames_per_second: float | None = None) -> Image:
    """Plot pan, tilt, roll, focal length and centre of the cameras of a clip over time.

    A band around each curve is the 95 % interval of each frame; its median half width is written beside it, or the
    smallest and the largest one where shots differ. Frames without camera are gaps, cameras that are not accepted are
    red. Values far from all others of their shot may lie outside their panel: a triangle at its edge points there. The
    strip on top shows the status of each frame, of an accepted one in a sequence or a video what its camera rests on.

    Parameters
    ----------
    calibrations : sequence of Calibration or None
        Of the frames in their order, e.g. a `SequenceCalibration`; None is a frame without camera. Each shot of a
        `VideoCalibration` has curves of its own.
    frames_per_second : float, optional
        Rate of the frames: with it, the time axis is in seconds, otherwise in frames.

    Returns
    -------
    (1000, 1280, 3) uint8 array
        Blue, green, red.

    Raises
    ------
    ValueError
        If there is no frame, or the rate is not positive.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_batch, soccer
    >>> cameras = [Camera.from_angles(pan, 1.35, 0.0, 1400.0, (1, 65, -16), (960, 540)) for pan in (0.2, 0.25, 0.3)]
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top")
    >>> frames = [{label: camera.project(soccer()[label].sample(9.0)) for label in labels} for camera in cameras]
    >>> picture = plot_sequence(calibrate_batch(soccer(), frames, (960, 540)), frames_per_second=25.0)
    >>> picture.shape
    (1000, 1280, 3)
    """
    if not len(listed(calibrations, "the calibrations of frames")):
        raise ValueError("expected the calibrations of at least one frame, got none")
    if frames_per_second is not None and not 0.0 < number(frames_per_second, "frames_per_second") < np.inf:
        raise ValueError(f"frames_per_second must be positive, got {frames_per_second}")
    statuses = _statuses(calibrations)
    accepted = np.array([status not in (NONE, REJECTED) for status in statuses])
    time = np.arange(len(calibrations)) / (frames_per_second or 1.0)
    canvas = Canvas.blank(FIGURE)
    step = (time[-1] - time[0]) / max(len(time) - 1, 1) or 1.0
    span = time[0] - 0.5 * step, time[-1] + 0.5 * step
    left, right = LEFT, FIGURE[0] - RIGHT
    curves = _curves(calibrations)
    top = float(TOP + STRIP + GAP)
    height = (FIGURE[1] - top - BOTTOM + GAP) / len(curves) - GAP
    ticks = nice_ticks(*span, TICKS_ALONG, whole=frames_per_second is None)

    _draw_strip(canvas, statuses, (left, TOP, right, TOP + STRIP))
    canvas.text("95 % band", (right + 12, TOP + STRIP), FAINT, 0.42)
    for curve in curves:
        panel = Panel(canvas, (left, top, right, top + height), span, value_range(curve, accepted))
        panel.draw(curve, time, accepted, ticks)
        top += height + GAP
    for tick in ticks:
        x = left + (tick - span[0]) / (span[1] - span[0]) * (right - left)
        canvas.text(tick_label(tick, ticks), (x, top - GAP + 18), INK, 0.42, align=0.5)
    label = "frame" if frames_per_second is None else "time, s"
    canvas.text(label, ((left + right) / 2.0, FIGURE[1] - 10), INK, 0.46, align=0.5)
    return canvas.reduced()


def _statuses(calibrations: Sequence[Calibration | None]) -> list[str]:
    """A key of `STRIP_COLOURS` for each frame."""
    checked_calibrations(calibrations)
    rests_on: Sequence[str] = len(calibrations) * [""]
    if isinstance(calibrations, SequenceCalibration | VideoCalibration):
        rests_on = calibrations.basis
    found = []
    for calibration, basis in zip(calibrations, rests_on, strict=True):
        if calibration is None or calibration.camera is None:
            found.append(NONE)
        else:
            found.append((str(basis) or ACCEPTED) if calibration.accepted else REJECTED)
    return found


def _curves(calibrations: Sequence[Calibration | None]) -> list[Curve]:
    """Angles, focal length and centre, with their 95 % intervals."""
    values = np.full((len(calibrations), 7), np.nan)  # pan, tilt, roll, log f, x, y, z
    half = np.full_like(values, np.nan)
    for index, calibration in enumerate(calibrations):
        if calibration is None or calibration.camera is None:
            continue
        camera = calibration.camera
        values[index] = *camera.angles, np.log(camera.focal_length), *camera.C
        if calibration.knows_errors:
            uncertainty = calibration.uncertainty
            variance = np.diagonal(uncertainty.covariance)
            sigma = np.sqrt(np.r_[variance[ANGLES], variance[LOG_F], variance[CENTER]])
            half[index] = uncertainty.radius() * sigma
    shot = calibrations.shot if isinstance(calibrations, VideoCalibration) else np.zeros(len(calibrations), np.intp)
    known = ~np.isnan(values[:, 0])
    values[known, :3] = np.unwrap(values[known, :3], axis=0)
    low, high = values - half, values + half
    for array in (values, low, high):
        array[:, :3] = np.degrees(array[:, :3])
        array[:, 3] = np.exp(np.minimum(array[:, 3], 100.0))
    return [Curve(*one, shot) for one in zip(QUANTITIES, UNITS, values.T, low.T, high.T, strict=True)]


def value_range(curve: Curve, accepted: BoolArray) -> tuple[float, float]:
    """Least and largest value of a panel: it holds all accepted values but outliers, and most of their bands."""
    shown = accepted & np.isfinite(curve.values)
    shown = shown if shown.any() else np.isfinite(curve.values)
    if not shown.any():
        return 0.0, 1.0
    of_shots = [_range_of_shot(curve, shown & (curve.shot == shot)) for shot in np.unique(curve.shot[shown])]
    low, high = min(low for low, _ in of_shots), max(high for _, high in of_shots)
    if high - low < 1e-6 * max(abs(low), abs(high), 1.0):
        low, high = low - 0.5, high + 0.5
    padding = PADDING * (high - low)
    return low - padding, high + padding


def _range_of_shot(curve: Curve, shown: BoolArray) -> tuple[float, float]:
    """Range of the values of one shot, without outliers: the true values change slowly."""
    values = curve.values[shown]
    least, middle, most = np.quantile(values, (0.1, 0.5, 0.9))
    reach = WITHIN * (most - least)
    values = values[np.abs(values - middle) <= reach]
    low, high = float(np.min(values, initial=least)), float(np.max(values, initial=most))
    known = shown & np.isfinite(curve.low) & np.isfinite(curve.high)
    if known.any():
        below, above = (curve.values - curve.low)[known], (curve.high - curve.values)[known]
        low, high = low - float(np.median(below)), high + float(np.median(above))
    return low, high


def half_widths(curve: Curve, known: BoolArray) -> list[str]:
    """Text of the median half widths of the bands of `known` frames: smallest and largest over the shots.

    Examples
    --------
    >>> values, half = np.zeros(4), np.array([0.1, 0.1, 0.3, 0.3])
    >>> half_widths(Curve("", "m", values, values - half, values + half, np.array([0, 0, 1, 1])), np.ones(4, bool))
    ['+/- 0.1', 'to 0.3 m']
    """
    half = (curve.high - curve.low) / 2.0
    medians = [np.median(half[known & (curve.shot == shot)]) for shot in np.unique(curve.shot[known])]
    least, largest = f"{min(medians):.2g}", f"{max(medians):.2g}"
    return [f"+/- {least} {curve.unit}"] if least == largest else [f"+/- {least}", f"to {largest} {curve.unit}"]


def nice_ticks(low: float, high: float, most: int, *, whole: bool = False) -> Array:
    """Multiples of 1, 2 or 5 times a power of ten between two numbers; with `whole` of at least 1.

    Examples
    --------
    >>> nice_ticks(-0.3, 1.7, 5).tolist()
    [0.0, 0.5, 1.0, 1.5]
    """
    least = (high - low) / most
    power = 10.0 ** np.floor(np.log10(least))
    step = next(power * factor for factor in (1.0, 2.0, 5.0, 10.0) if power * factor >= least)
    step = max(step, 1.0) if whole else step
    return np.asarray(step * np.arange(np.ceil(low / step), np.floor(high / step) + 1.0) + 0.0)  # no -0.0


def tick_label(tick: float, ticks: Array) -> str:
    """A tick with as many decimals as their distance needs.

    Examples
    --------
    >>> tick_label(0.5, np.array([0.0, 0.5, 1.0])), tick_label(100.0, np.array([0.0, 100.0]))
    ('0.5', '100')
    """
    step = ticks[1] - ticks[0] if len(ticks) > 1 else 1.0
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    return f"{tick:.{decimals}f}"


def _runs(index: IntArray, shot: IntArray | None = None) -> Iterator[IntArray]:
    """The runs of consecutive numbers in an increasing sequence, each in one shot."""
    ends = np.diff(index) > 1
    if shot is not None:
        ends |= np.diff(shot[index]) != 0
    yield from (run for run in np.split(index, np.flatnonzero(ends) + 1) if len(run))


@dataclass(frozen=True)
class Canvas:
    """A picture that is drawn `FINER` times as large; places and sizes are in pixels of the reduced picture."""

    picture: Image

    @classmethod
    def blank(cls, size: tuple[int, int]) -> Canvas:
        """An empty canvas for a picture of a size (width, height)."""
        width, height = size
        return cls(np.full((FINER * height, FINER * width, 3), PAPER, np.uint8))

    def reduced(self) -> Image:
        """The picture at its final size."""
        import cv2

        height, width = self.picture.shape[:2]
        small = cv2.resize(self.picture, (width // FINER, height // FINER), interpolation=cv2.INTER_AREA)
        return np.asarray(small, np.uint8)

    def part(self, box: Box) -> Canvas:
        """The canvas of a box, with coordinates of its own; drawing is clipped at its edges."""
        left, top, right, bottom = (round(FINER * side) for side in box)
        return Canvas(self.picture[top:bottom, left:right])

    def rectangle(self, box: Box, colour: Colour) -> None:
        """Draw a filled rectangle."""
        self.part(box).picture[:] = colour

    def line(self, xy: Array, colour: Colour, width: float) -> None:
        """Draw a polyline (N, 2)."""
        import cv2

        cv2.polylines(self.picture, [fixed_point(FINER * xy)], False, colour, round(FINER * width), cv2.LINE_AA, SHIFT)

    def fill(self, xy: Array, colour: Colour) -> None:
        """Fill a polygon (N, 2)."""
        import cv2

        cv2.fillPoly(self.picture, [fixed_point(FINER * xy)], colour, cv2.LINE_AA, SHIFT)

    def text(self, text: str, place: tuple[float, float], colour: Colour, scale: float, align: float = 0.0) -> None:
        """Write text on a base line; `align` 0 puts its left end at the place, 0.5 its middle, 1 its right end."""
        width, _, _ = text_size(text, FINER * scale)
        start = round(FINER * place[0] - align * width), round(FINER * place[1])
        draw_text(self.picture, text, start, FINER * scale, colour)


def _draw_strip(canvas: Canvas, statuses: Sequence[str], box: Box) -> None:
    """Draw the basis of every frame as a strip of colours, with a legend above."""
    left, top, right, bottom = box
    edges = np.linspace(left, right, len(statuses) + 1)
    kinds = np.array(statuses)
    x = left
    for name, colour in STRIP_COLOURS.items():
        frames = np.flatnonzero(kinds == name)
        if not len(frames):
            continue
        for run in _runs(frames):
            start, end = edges[run[0]], edges[run[-1] + 1]
            canvas.rectangle((start, top, max(end, start + 1.0 / FINER), bottom), colour)
        canvas.rectangle((x, top - 24, x + 12, top - 12), colour)
        canvas.text(f"{name}: {len(frames)}", (x + 18, top - 13), INK, 0.42)
        x += 150
    canvas.text("frames", (left - 12, bottom - 1), INK, 0.46, align=1.0)


@dataclass(frozen=True)
class Panel:
    """The axes of one quantity."""

    canvas: Canvas
    box: Box
    span: tuple[float, float]
    """Time at the left and right."""
    range: tuple[float, float]
    """Values at the bottom and top."""

    def place(self, time: Array, values: Array) -> Array:
        """Places (N, 2) from the panel's upper left corner; infinite values lie a few panels further."""
        left, top, right, bottom = self.box
        x = (time - self.span[0]) / (self.span[1] - self.span[0]) * (right - left)
        share = np.clip((values - self.range[0]) / (self.range[1] - self.range[0]), -5.0, 6.0)
        return np.stack([x, (1.0 - share) * (bottom - top)], axis=-1)

    def draw(self, curve: Curve, time: Array, accepted: BoolArray, ticks: Array) -> None:
        """Draw grid, band, curve and the texts beside them."""
        left, top, right, bottom = self.box
        outside, inside, middle = self.canvas, self.canvas.part(self.box), (top + bottom) / 2.0
        outside.rectangle(self.box, PANEL)
        for tick in ticks:
            inside.line(self.place(np.full(2, tick), np.array(self.range)), GRID, 0.5)
        values = nice_ticks(*self.range, TICKS_UP)
        for tick in values:
            ends = self.place(np.array(self.span), np.full(2, tick))
            inside.line(ends, GRID, 0.5)
            outside.text(tick_label(tick, values), (left - 8, top + ends[0, 1] + 4), INK, 0.4, align=1.0)
        outside.text(curve.name, (12, middle), INK, 0.5)
        outside.text(curve.unit, (12, middle + 18), FAINT, 0.42)

        known = accepted & ~np.isnan(curve.low) & ~np.isnan(curve.high)
        for t, (low, high) in self._pieces(known, curve.shot, time, curve.low, curve.high):
            inside.fill(np.concatenate([self.place(t, low), self.place(t, high)[::-1]]), BAND)
        for shown, colour in ((accepted, LINE), (~accepted, REJECTED_LINE)):
            for t, (value,) in self._pieces(shown & ~np.isnan(curve.values), curve.shot, time, curve.values):
                inside.line(self.place(t, value), colour, 1.5)
        for edge, sign in ((0, -1.0), (1, 1.0)):
            for run in _runs(np.flatnonzero(sign * (curve.values - self.range[edge]) > 0.0), curve.shot):
                tip = self.place(time[run].mean(), np.array(self.range[edge]))
                inside.fill(tip + [[0.0, 1.0], [-5.0, 8.0], [5.0, 8.0]] * np.array([1.0, sign]), REJECTED_LINE)
        if known.any():
            for row, text in enumerate(half_widths(curve, known)):
                outside.text(text, (right + 12, middle + 4 + 18 * row), FAINT, 0.42)

    def _pieces(
        self, shown: BoolArray, shot: IntArray, time: Array, *values: Array
    ) -> Iterator[tuple[Array, list[Array]]]:
        """Times and values of each run of frames; a frame between gaps becomes a piece as long as a frame."""
        half_step = 0.5 * (self.span[1] - self.span[0]) / len(time)
        for run in _runs(np.flatnonzero(shown), shot):
            if len(run) > 1:
                yield time[run], [value[run] for value in values]
            else:
                yield time[run] + half_step * np.array([-1.0, 1.0]), [np.repeat(value[run], 2) for value in values]
