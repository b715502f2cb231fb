"""The command line: `fieldcalib calibrate` and `fieldcalib demo`."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import fieldcalib
from fieldcalib.calibrate import calibrate_batch
from fieldcalib.field import Field, soccer
from fieldcalib.io.files import write_text
from fieldcalib.io.soccernet import AnnotationFile, camera_to_record, find_annotations, parse_annotation
from fieldcalib.ndc import ndc_loss
from fieldcalib.options import ALL
from fieldcalib.parameters import DISTRIBUTIONS, theta_from_camera
from fieldcalib.result import Calibration, Status
from fieldcalib.segments import Pixels, check_segments

BROKEN = "broken file"
AT_ONCE = 256  # frames between two steps of the progress bar


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 1 something was broken, 2 wrong usage."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.run(options))
    except KeyboardInterrupt:
        print("fieldcalib: interrupted, nothing more is written", file=sys.stderr)
        return 130
    except (OSError, ValueError) as error:
        print(f"fieldcalib: {error}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="fieldcalib", description="Calibrate cameras from the markings of a sports field."
    )
    parser.add_argument("--version", action="version", version=f"fieldcalib {fieldcalib.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    calibrate = commands.add_parser(
        "calibrate",
        help="calibrate annotated frames",
        description="Calibrate frames from SoccerNet annotations (<id>.json: label -> normalised points). Writes "
        "camera_<id>.json in SoccerNet's format, cameras.jsonl with one line a frame, and summary.json.",
    )
    calibrate.add_argument(
        "input", nargs="+", type=Path, metavar="INPUT", help="a folder, a zip of one, or single files"
    )
    calibrate.add_argument("--size", required=True, type=image_size, metavar="WxH", help="of the images, e.g. 960x540")
    calibrate.add_argument("--out", required=True, type=Path, metavar="DIR", help="where the results go")
    calibrate.add_argument(
        "--field-length", type=_positive, default=105.0, metavar="M", help="touchline in metres (105)"
    )
    calibrate.add_argument("--field-width", type=_positive, default=68.0, metavar="M", help="goal line in metres (68)")
    calibrate.add_argument(
        "--prior",
        default=ALL,
        choices=[ALL, *DISTRIBUTIONS, "none"],
        metavar="NAME",
        help=f"where the camera stands: {', '.join([ALL, *DISTRIBUTIONS])}, or none to solve without a prior (all)",
    )
    calibrate.add_argument(
        "--tau", type=_positive, metavar="T", help="reject frames whose NDC loss is above; the paper's is 0.019 (off)"
    )
    calibrate.add_argument("--lens", choices=["none"], default="none", help="lens model (none)")
    calibrate.add_argument("--strict", action="store_true", help="stop at the first broken file, write nothing")
    calibrate.set_defaults(run=_calibrate)

    demo = commands.add_parser(
        "demo",
        help="calibrate a synthetic pan over a pitch and draw it",
        description="Render a pan over a pitch with known cameras, calibrate it from noisy pixels, print the errors "
        "and write overlays. Needs no data and no network.",
    )
    demo.add_argument("--out", required=True, type=Path, metavar="DIR", help="where the pictures go")
    demo.set_defaults(run=_demo)
    return parser


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not 0.0 < value < np.inf:
        raise argparse.ArgumentTypeError(f"expected a positive number, got {text!r}")
    return value


def image_size(text: str) -> tuple[int, int]:
    """(width, height) of "WIDTHxHEIGHT", for argparse."""
    try:
        width, height = (int(v) for v in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT, as 960x540, got {text!r}") from None
    if min(width, height) < 1:
        raise argparse.ArgumentTypeError(f"expected positive numbers, got {text!r}")
    return width, height


def _demo(options: argparse.Namespace) -> int:
    from fieldcalib.demo import run_demo

    run_demo(options.out)
    return 0


def _calibrate(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    began = time.perf_counter()
    field = soccer(options.field_length, options.field_width)
    prior = None if options.prior == "none" else options.prior
    files = find_annotations(options.input)
    frames: dict[str, Pixels] = {}
    broken: dict[str, str] = {}
    for file in files:
        try:
            frames[file.id] = check_segments(field, parse_annotation(file.read(), options.size), options.size)
        except ValueError as error:
            print(f"fieldcalib: {file.path}: {error}", file=sys.stderr)
            if options.strict:
                return 1
            broken[file.id] = str(error)
    options.out.mkdir(parents=True, exist_ok=True)

    calibrations: dict[str, Calibration] = {}
    eq3: dict[str, float] = {}
    calibrating = time.perf_counter()
    ids = list(frames)
    with tqdm(total=len(ids), unit="frame", disable=None) as progress:  # None: only on a terminal
        for begin in range(0, len(ids), AT_ONCE):
            part = ids[begin : begin + AT_ONCE]
            found = calibrate_batch(field, [frames[id] for id in part], options.size, prior=prior, tau=options.tau)
            calibrations.update(zip(part, found, strict=True))
            eq3.update(_eq3_losses(field, frames, dict(zip(part, found, strict=True)), options.size))
            progress.update(len(part))
    seconds = time.perf_counter() - calibrating

    written = _write_cameras(options.out, files, calibrations)
    lines = [_line(file.id, calibrations.get(file.id), eq3.get(file.id), broken.get(file.id)) for file in files]
    write_text(options.out / "cameras.jsonl", "".join(json.dumps(line) + "\n" for line in lines))
    summary = {
        "frames": len(files),
        "cameras": written,
        "completeness": 100.0 * written / len(files),
        "status": dict(Counter(line["status"] for line in lines)),
        "seconds": {"calibration": seconds, "total": time.perf_counter() - began},
        "milliseconds_per_frame": 1e3 * seconds / max(len(ids), 1),
        "options": {
            "input": [str(path) for path in options.input],
            "size": list(options.size),
            "field_length": options.field_length,
            "field_width": options.field_width,
            "prior": options.prior,
            "tau": options.tau,
            "lens": options.lens,
        },
        "version": fieldcalib.__version__,
    }
    write_text(options.out / "summary.json", json.dumps(summary, indent=2) + "\n")
    statuses = ", ".join(
        f"{count} {status}" for status, count in Counter(line["status"] for line in lines).most_common()
    )
    print(f"{written} cameras of {len(files)} frames in {options.out}: {statuses}")
    return 1 if broken else 0


def _write_cameras(out: Path, files: list[AnnotationFile], calibrations: dict[str, Calibration]) -> int:
    """Write camera_<id>.json of every frame that has a camera and was not rejected; remove an earlier run's others."""
    written = 0
    for file in files:
        path = out / f"camera_{file.id}.json"
        calibration = calibrations.get(file.id)
        if calibration is None or calibration.camera is None or calibration.status is Status.REJECTED:
            path.unlink(missing_ok=True)
        else:
            write_text(path, json.dumps(camera_to_record(calibration.camera), indent=2) + "\n")
            written += 1
    return written


def _eq3_losses(
    field: Field, frames: dict[str, Pixels], calibrations: dict[str, Calibration], image_size: tuple[int, int]
) -> dict[str, float]:
    """The loss that the paper prints, for the frames that have a camera."""
    cameras = {id: calibration.camera for id, calibration in calibrations.items() if calibration.camera is not None}
    if not cameras:
        return {}
    theta = np.array([theta_from_camera(camera) for camera in cameras.values()])
    losses = ndc_loss(theta, field, [frames[id] for id in cameras], image_size, kind="eq3")
    return dict(zip(cameras, losses.tolist(), strict=True))


def _line(id: str, calibration: Calibration | None, eq3: float | None, broken: str | None) -> dict[str, Any]:
    """One frame's line of cameras.jsonl."""
    if calibration is None:
        return {"id": id, "status": BROKEN, "message": broken}
    line: dict[str, Any] = {"id": id, "status": str(calibration.status), "message": calibration.message}
    camera = calibration.camera
    if camera is not None:
        angles = dict(zip(("pan", "tilt", "roll"), np.degrees(camera.angles).tolist(), strict=True))
        line |= {
            "K": camera.K.tolist(),
            "dist": [*camera.k.tolist(), 0.0, 0.0, 0.0],
            "R": camera.R.tolist(),
            "C": camera.C.tolist(),
            "angles_degrees": angles,
            "rms_px": calibration.rms,
            "segment_errors_px": dict(calibration.per_segment_errors),
            "loss_ndc": calibration.loss_ndc,
            "loss_ndc_eq3": eq3,
        }
    return line


if __name__ == "__main__":
    sys.exit(main())
