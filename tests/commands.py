"""The command line as the tests call it, and what it writes."""

import json

from fieldcalib.cli.main import main

SIZE = (960, 540)
CAMERA_KEYS = ["K", "dist", "R", "C", "angles_degrees"]
FITTED_KEYS = ["rms_px", "segment_errors_px", "suspect_labels", "loss_ndc", "alternatives"]
KEPT_KEYS = ["complaints", "pixel_counts", "image_size", "field", "solved", "version"]  # for reading results back
ACCURACY_KEYS = [
    "rms_as_labelled_px",
    "loss_ndc_eq3",
    "standard_deviations",
    "probability_right_0.5m",
    "probability_right_1m",
]
SIZE_KEYS = ["field_length", "field_width", "field_standard_deviations", "field_from_labels"]
BROKEN_KEYS = ["id", "status", "message"]
LINE_KEYS = [*BROKEN_KEYS, "verdict", "reason", "remedy"]
WITHOUT_CAMERA = LINE_KEYS + [key for key in FITTED_KEYS if key not in ("rms_px", "loss_ndc")] + KEPT_KEYS
WITH_CAMERA = LINE_KEYS + CAMERA_KEYS + FITTED_KEYS + KEPT_KEYS[:-1] + ["are_annotated", "version"] + ACCURACY_KEYS


def run(*arguments):
    """Exit code of the command line."""
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as error:  # argparse ends so
        return error.code


def calibrate(out, *inputs, options=()):
    return run("calibrate", *inputs, "--size", "960x540", "--out", out, *options)


def lines_of(out):
    def no_constant(name):
        raise AssertionError(f"{name} is no JSON")

    text = (out / "cameras.jsonl").read_text()
    assert text.endswith("\n")
    return [json.loads(line, parse_constant=no_constant) for line in text.splitlines()]


def summary_of(out):
    return json.loads((out / "summary.json").read_text())


def cameras_in(out):
    return {path.stem.removeprefix("camera_"): path.read_bytes() for path in out.glob("camera_*.json")}
