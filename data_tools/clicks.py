"""Pictures labelled from nothing by clicks as of a person, until the camera is good.

    python -m data_tools.clicks PICTURES RESULTS [--names NAME...] [--repeats N] [--noise PX] [--width PX] [--out DIR]
        [--squash WxH] [--shape-known] [--whole-frame] [--field-size LxW]

RESULTS is a folder that `fieldcalib run` wrote of the pictures. Its cameras tell where the markings are, so look at
their overlays first: name the pictures (--names) whose markings lie on their paint. In each picture markings are
clicked one after the other, with errors of --noise pixels along x and y before the editor snaps the click to paint:
first the longest painted ones, at both ends of a line and at three places of an arc; as soon as there is a camera, the
mark that the editor advises, if the picture shows it. A mark that the page shows far from its marking is dragged onto
it, with another error of that size; that counts as a click. The person stops when the verdict is good, or at 16 clicks.
With --width wider pictures are reduced to that width first: the errors of the clicks stay, in pixels. With --squash
pictures of 16:9 are squashed to that size, and with --shape-known the person knows it. With
--whole-frame and --field-size the person knows that nothing is cut off the pictures, and the size of the field.

Printed: for each picture the clicks of each repeat, with the verdict where it is not good; then how many of all are
good within 12 clicks; how many cameras that are called good put a point of the field in view more than a metre from
where the camera of RESULTS puts it, the median displacement taken off; and the CPU time from a click to the camera with
its verdict and the next advice, for pictures of 1920 x 1080 with 7 to 12 marks. With --out the cameras of the first
repeat are written there.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as attribute
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from fieldcalib import read
from fieldcalib._types import Array
from fieldcalib._whole_files import write_text
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.probability import ground_in_view
from fieldcalib.assess.result import Calibration
from fieldcalib.console.arguments import count, image_size
from fieldcalib.console.program import run_command
from fieldcalib.draw.scene import image_curves
from fieldcalib.editor.edit import Known
from fieldcalib.editor.fitting import is_stray, mark_errors
from fieldcalib.editor.frame import FrameEditor
from fieldcalib.fields.field import Field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.formats import CAMERAS, IMAGES
from fieldcalib.io.image_files import at_most_wide, size_of
from fieldcalib.io.results import LINES
from fieldcalib.problem.picture_shape import BROADCAST_SHAPE
from fieldcalib.run_folder.record import calibration_line

GOAL, MOST = 12, 16  # clicks
LARGEST = 1.0  # m: error of a right camera
BORDER = 0.015  # of width and height: nobody clicks there
LEAST_LENGTH, STEP = 30.0, 2.0  # px: of a marking in view, and between the places on it
LEAST_PAINT = 0.3  # share of the places along a marking that show paint: a person sees those
ON_LINE, ON_ARC = (0.1, 0.9), (0.1, 0.5, 0.9)  # where a marking is clicked, as a share of its length in view
TIMED = (1920, 1080)
TIMED_MARKS = (7, 12)


@dataclass
class Labelling:
    """What came of one picture."""

    editor: FrameEditor
    seen: Calibration
    """It tells where the markings are."""
    clicks: int = 0
    seconds: list[float] = attribute(default_factory=list)
    """From each click to what the page shows."""

    @property
    def verdict(self) -> str:
        """The verdict on the camera."""
        return str(self.editor.calibration.verdict)

    @property
    def difference(self) -> float:
        """Largest distance of ground in view from where `seen` has it, less the median displacement, metres."""
        camera, seen = self.editor.calibration.camera, self.seen.required_camera
        if camera is None:
            return float("nan")
        X = ground_in_view(seen, self.seen.field or self.editor.field)
        moved = camera.image_to_field(seen.project(X)) - X
        return float(np.nanmax(np.linalg.norm(moved - np.nanmedian(moved, axis=0), axis=1)))


def visible_markings(seen: Calibration, field: Field) -> dict[str, Array]:
    """Places (N, 2) along the markings that a person sees, by label, the longest marking first."""
    camera, shares = seen.required_camera, {one.label: one.share for one in seen.markings}
    found = {}
    for label in field.markings:
        if label in field.half_labels:
            continue
        curves = [_places(curve, camera.image_size) for curve in image_curves(camera, field[label])]
        places = np.concatenate([np.empty((0, 2)), *curves])
        if STEP * len(places) > LEAST_LENGTH and shares.get(label, 1.0) > LEAST_PAINT:
            found[label] = places
    return dict(sorted(found.items(), key=lambda pair: (-len(pair[1]), pair[0])))


def _places(curve: Array, image_size: tuple[int, int]) -> Array:
    """Places along a polyline, as far as they lie in the image and not at its border."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    at = np.arange(0.0, s[-1], STEP)
    places = np.column_stack([np.interp(at, s, x) for x in curve.T])
    size = np.array(image_size)
    return np.asarray(places[np.all((places > BORDER * size) & (places < (1.0 - BORDER) * size), axis=1)])


def first_clicks(markings: dict[str, Array], field: Field) -> Iterator[tuple[str, Array]]:
    """What a person clicks who gets no advice."""
    for label, places in markings.items():
        for share in ON_LINE if field[label].is_straight else ON_ARC:
            yield label, places[round(share * (len(places) - 1))]


class Click(NamedTuple):
    """A mark that a person sets, or drags."""

    label: str
    place: Array
    """Pixel (2,) that is meant."""
    number: int | None = None
    """Number of the mark that is dragged there; None for a new one."""


def next_click(editor: FrameEditor, markings: Mapping[str, Array], plan: Iterator[tuple[str, Array]]) -> Click | None:
    """What a person does next: drag a mark that the page shows as stray, follow the advice, or go on by `plan`."""
    camera, marks = editor.calibration.camera, editor.marks
    if camera is not None and editor.calibration.accepted:
        (errors,) = mark_errors(editor.calibration.field or editor.field, marks, [camera])
        number = int(np.argmax(errors))
        if is_stray(errors[number], camera.image_size):
            mark = marks.all[number]
            return Click(mark.label, nearest(markings[mark.label], (mark.x, mark.y)), number)
        advice = editor.next_mark
        if advice is not None and advice.label in markings:
            return Click(advice.label, nearest(markings[advice.label], advice.xy))
    own = next(plan, None)
    return None if own is None else Click(*own)


def nearest(places: Array, xy: tuple[float, float]) -> Array:
    """The place (2,) of several (N, 2) that is nearest to a pixel."""
    return np.asarray(places[np.argmin(np.linalg.norm(places - xy, axis=1))])


def labelled(begin: FrameEditor, seen: Calibration, noise: float, rng: np.random.Generator) -> Labelling:
    """Label a picture until the camera is good; `seen` is the camera that tells where the markings are."""
    markings = visible_markings(seen, seen.field or begin.field)
    plan = first_clicks(markings, begin.field)
    found = Labelling(begin, seen)
    while found.clicks < MOST and found.verdict != Verdict.GOOD:
        click = next_click(found.editor, markings, plan)
        if click is None:
            break
        began = time.process_time()
        label, place, number = click
        xy = place + rng.normal(0.0, noise, 2)
        found.editor = found.editor.mark(label, xy) if number is None else found.editor.move({number: xy})
        _ = found.verdict, found.editor.calibration.accepted and found.editor.next_mark
        found.seconds.append(time.process_time() - began)
        found.clicks += 1
    return found


def run(options: argparse.Namespace) -> int:
    """Label all pictures and print what came of it; returns the exit code."""
    results, field = read(options.results), soccer()
    aspect = BROADCAST_SHAPE if options.shape_known else None
    known = Known(principal_point=options.whole_frame, field_size=options.field_size, aspect=aspect)
    files = {file.id: file for file in IMAGES.find([options.pictures])}
    found: dict[str, list[Labelling]] = {}
    for name in options.names or [id for id in files if id in results and results[id].verdict == Verdict.GOOD]:
        if name not in files or name not in results or results[name].camera is None:
            raise ValueError(f"expected a picture {name!r} in {options.pictures}, and its camera in {options.results}")
        image = IMAGES.read(files[name].read())
        image = image if options.width is None else at_most_wide(image, options.width)
        if options.squash is not None:
            image = cv2.resize(image, options.squash, interpolation=cv2.INTER_AREA).astype(np.uint8)
        begin = FrameEditor.of(image, field, known=known)
        seen = replace(results[name], camera=results[name].required_camera.scaled(size_of(image)))
        rngs = map(np.random.default_rng, range(options.repeats))
        found[name] = [labelled(begin, seen, options.noise, rng) for rng in rngs]
        words = (f"{one.clicks}{'' if one.verdict == Verdict.GOOD else f' ({one.verdict})'}" for one in found[name])
        print(f"{name}: {', '.join(words)}", flush=True)
    print(json.dumps(summary([one for several in found.values() for one in several])))
    if options.out is not None:
        write(options.out, {name: several[0].editor.calibration for name, several in found.items()})
    return 0


def summary(found: Sequence[Labelling]) -> dict[str, object]:
    """Statistics of all labellings, see the module."""
    first, last = TIMED_MARKS
    seconds = [s for one in found if size_of(one.editor.image) == TIMED for s in one.seconds[first - 1 : last]]
    right = [one.difference <= LARGEST for one in found if one.verdict == Verdict.GOOD]
    good = [one.clicks for one in found if one.verdict == Verdict.GOOD]
    return {
        "labelled": len(found),
        f"good within {GOAL} clicks": sum(clicks <= GOAL for clicks in good),
        f"good, but more than {LARGEST:g} m from RESULTS": right.count(False),
        "median clicks of the good ones": float(np.median(good)) if good else None,
        "CPU ms a click, median and 95 %": np.round(1e3 * np.quantile(seconds, (0.5, 0.95)), 1).tolist()
        if seconds
        else None,
    }


def write(out: Path, calibrations: Mapping[str, Calibration]) -> None:
    """Write cameras and their verdicts as `fieldcalib run` does."""
    out.mkdir(parents=True, exist_ok=True)
    for name, calibration in calibrations.items():
        if calibration.camera is not None:
            write_text(out / CAMERAS.file_name(name), CAMERAS.write(calibration.camera) + "\n")
    lines = [json.dumps(calibration_line(name, one, None)) + "\n" for name, one in calibrations.items()]
    write_text(out / LINES, "".join(lines))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", type=Path, help="folder of pictures")
    parser.add_argument("results", type=Path, help="folder that `fieldcalib run` wrote of them")
    parser.add_argument("--names", nargs="+", metavar="NAME", help="pictures; by default those whose camera is good")
    parser.add_argument("--repeats", type=count, default=1, metavar="N", help="labellings of each picture (1)")
    parser.add_argument("--noise", type=float, default=2.0, metavar="PX", help="standard deviation of a click (2)")
    parser.add_argument(
        "--whole-frame", action="store_true", help="the person knows that nothing is cut off the pictures"
    )
    parser.add_argument(
        "--field-size", type=image_size, metavar="LxW", help="and that the field is of this size, metres"
    )
    parser.add_argument("--width", type=count, metavar="PX", help="reduce wider pictures to that width")
    parser.add_argument("--squash", type=image_size, metavar="WxH", help="squash pictures of 16:9 to that size")
    parser.add_argument("--shape-known", action="store_true", help="the person knows that they were squashed from 16:9")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where the cameras go")
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
