"""The command line as the tests call it, and what it writes."""

import json

from synthetic import random_frames

from fieldcalib.cli.main import main
from fieldcalib.io.soccernet import format_annotation

SIZE = (960, 540)
BROKEN_KEYS = ["id", "status", "message", "verdict", "reason"]
HEAD_KEYS = [*BROKEN_KEYS, "findings", "remedy", "advice", "version", "field", "image_size"]
CAMERA_KEYS = ["K", "dist", "R", "C", "angles_degrees", "rms_px", "loss_ndc", "standard_deviations"]
PROBABILITY_KEYS = ["probability_right_0.5m", "probability_right_1m"]
FITTED_KEYS = ["segment_errors_px", "suspect_labels", "alternatives", "found", "pixel_counts", "solved"]
SIZE_KEYS = ["field_length", "field_width", "field_standard_deviations", "field_from_labels"]
WITHOUT_CAMERA = HEAD_KEYS + FITTED_KEYS  # in both files of lines
WITH_CAMERA = [*HEAD_KEYS, *CAMERA_KEYS, *PROBABILITY_KEYS, *FITTED_KEYS]
WITH_CAMERA += ["are_annotated", "rms_as_labelled_px", "loss_ndc_eq3"]

PEAK = """
import resource, sys
from importlib import import_module
from pathlib import Path
from fieldcalib.run_folder import work_units
work_units.LARGEST_UNIT = 64  # so that a few hundred frames are several units of the same size
code = import_module(sys.argv[1]).main(sys.argv[2:])
status = Path("/proc/self/status")  # Linux counts what the process that started this one had, but not here
if status.exists():
    print(next(int(line.split()[1]) / 2**10 for line in status.read_text().splitlines() if line.startswith("VmHWM")))
else:
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10))
raise SystemExit(code)
"""


def run(*arguments):
    """Exit code of the command line."""
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as error:  # argparse ends so
        return error.code


def write_two_annotations(folder):
    """A new folder with the annotations 0.json and 1.json."""
    folder.mkdir()
    for number, frame in enumerate(random_frames(2, seed=3, noise=0.5)[0]):
        (folder / f"{number}.json").write_text(format_annotation(frame, SIZE))
    return folder


def calibrate(out, *inputs, options=()):
    return run("calibrate", *inputs, "--size", "960x540", "--camera-files", "--out", out, *options)


def lines_of(out):
    """Everything that is kept of each frame, by the two files of lines."""

    def no_constant(name):
        raise AssertionError(f"{name} is no JSON")

    main, solver = ((out / name).read_text() for name in ("cameras.jsonl", "solver.jsonl"))
    assert main.endswith("\n")
    assert solver.endswith("\n")
    assert 0 <= len(solver.splitlines()) - len(main.splitlines()) <= 1  # that of the solver comes first
    pairs = zip(main.splitlines(), solver.splitlines(), strict=False)
    whole = ([json.loads(line, parse_constant=no_constant) for line in pair] for pair in pairs)
    return [{**first, **second} for first, second in whole]


def summary_of(out):
    return json.loads((out / "summary.json").read_text())


def cameras_in(out):
    return {path.stem.removeprefix("camera_"): path.read_bytes() for path in out.glob("camera_*.json")}
