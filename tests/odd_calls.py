"""Calls of all public functions, classes and methods, some of whose arguments are replaced by odd values.

The names are those of the reference, `docs/reference/api.md`. A call is a right one, with right arguments by the names
of its parameters, some of which are replaced.
"""

import dis
import importlib.util
import inspect
import re
import types
from collections.abc import Callable
from dataclasses import dataclass, is_dataclass
from functools import cache, reduce
from pathlib import Path

import numpy as np
from networks import Blind, KnownCameras
from synthetic import whole_circle_markings

import fieldcalib
from fieldcalib import (
    Camera,
    Editor,
    Point,
    PointCloud,
    SegmentationNetwork,
    Status,
    Tracker,
    calibrate,
    calibrate_from_segments,
    calibrate_sequence,
    calibrate_video,
    soccer,
)
from fieldcalib.assess import Advice, Tool
from fieldcalib.draw import overhead_camera
from fieldcalib.draw.scene import render_field
from fieldcalib.fields import DISTRIBUTIONS, Ground, field_homography
from fieldcalib.geometry import ALIGNMENTS
from fieldcalib.images.background.matches import Matches
from fieldcalib.io import key_points
from fieldcalib.localize import BACKGROUND, Localization
from fieldcalib.metrics import Confusion, ProjectionError, evaluate_segments
from fieldcalib.plot import soccer_pitch
from fieldcalib.problem import RobustLoss
from fieldcalib.processes import Processes
from fieldcalib.solve import camera_from_homography, estimate_field_size

API = Path(__file__).parents[1] / "docs" / "reference" / "api.md"
# Enumerations, a protocol, a film, what only the library makes, and what ends the objects that the other calls need.
NOT_CALLED = {"Status", "Verdict", "CalibrationFlags", "assess.Advice", "assess.Tool", "assess.What"}
NOT_CALLED |= {"localize.Network", "images.LiveFrame", "sample", "assess.Finding", "editor.FrameEditor"}
NOT_CALLED |= {"Editor.close", "Tracker.close", "processes.Processes.shutdown", "web.app"}  # its threads would go on
HAS_PITCHES = importlib.util.find_spec("mplsoccer") is not None

SIZE = (480, 270)
CAMERA = Camera.from_angles(-0.3, 1.35, 0.0, 800.0, (0.0, 68.0, -17.0), SIZE)
TURNED = Camera.from_angles(np.pi - 0.5, 1.35, 0.0, 500.0, (-30.0, -66.0, -16.0), SIZE)
FIELD = soccer()
LABELS = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left")
PIXELS = {label: CAMERA.project(FIELD[label].sample(7.0)) for label in LABELS}
X = np.array([point.X for name, point in FIELD.points.items() if name.startswith("L_PENALTY")])
XY = CAMERA.project(X)
H = CAMERA.homography
CLASSES = (BACKGROUND, *whole_circle_markings(FIELD))
IMAGE = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
LIMIT = 60.0  # seconds of a call: most take milliseconds


@cache
def calibration():
    return calibrate_from_segments(FIELD, PIXELS, SIZE)


@cache
def turned():
    """A camera on the other side of the field."""
    pixels = {label: TURNED.project(FIELD[label].sample(7.0)) for label in LABELS}
    return calibrate_from_segments(FIELD, pixels, SIZE)


@cache
def sequence():
    return calibrate_sequence(FIELD, [PIXELS, PIXELS], SIZE)


@cache
def video():
    return calibrate_video(FIELD, [IMAGE, IMAGE], Blind())


@cache
def results():
    return calibrate([scene()], network=KnownCameras([CAMERA]), progress=False)


@cache
def scene():
    """A picture of the field by the camera."""
    return render_field(CAMERA, FIELD, rng=np.random.default_rng(0))


@cache
def pitch():
    return soccer_pitch(FIELD)


@cache
def right_arguments():
    """Arguments by the names of parameters; those of one callable have its name before theirs."""
    return {
        "K": CAMERA.K,
        "R": CAMERA.R,
        "C": CAMERA.C,
        "H": H,
        "X": X,
        "xy": XY,
        "detections": XY,
        "points": XY,
        "object_points": X,
        "image_points": XY,
        "camera": CAMERA,
        "overhead": overhead_camera(FIELD),
        "prediction": CAMERA,
        "truth": CAMERA,
        "predictions": [CAMERA],
        "annotations": [PIXELS],
        "image_size": SIZE,
        "field": FIELD,
        "object_segments": FIELD,
        "segments": dict(FIELD),
        "extra": {"mine": FIELD["Middle line"]},
        "image_segments": PIXELS,
        "frames": [PIXELS, PIXELS],
        "calibration": calibration(),
        "calibrations": [calibration()],
        "image": scene(),
        "images": [IMAGE, IMAGE],
        "pictures": [IMAGE],
        "captions": ["one"],
        "views": [(IMAGE, CAMERA)],
        "first": scene(),
        "second": np.roll(scene(), 3, axis=1),
        "network": Blind(),
        "wait": True,
        "progress": lambda *_: None,
        "probability": np.full((len(CLASSES), 9, 16), 1.0 / len(CLASSES), np.float32),
        "classes": CLASSES,
        "label": "Middle line",
        "length": 105.0,
        "width": 68.0,
        "ground": Ground(0.3),
        "crown": 0.3,
        "fall": 0.1,
        "terrain": FIELD.terrain,
        "source": [PIXELS],
        "calibrate image_size": SIZE,
        "calibrate_video source": [IMAGE, IMAGE],
        "Editor source": [IMAGE],
        "number": 0,
        "other": 0,
        "cuts": [],
        "changed": Editor([IMAGE])[0],
        "proposal": None,
        "format": "soccernet",
        "status": Status.DEGENERATE,
        "message": "none",
        "markings": [],
        "SequenceCalibration.seen_in_images markings": {},
        "Camera.from_dict record": CAMERA.to_dict(),
        "Calibration.from_dict record": calibration().to_dict(),
        "SequenceCalibration.from_dict record": sequence().to_dict(),
        "VideoCalibration.from_dict record": video().to_dict(),
        "least": 0.5,
        "run": np.zeros(2, int),
        "longest": 3,
        "others": {},
        "doubts": {},
        "parts": [video()],
        "id": "000000",
        "folder": "none",
        "Results.save folder": "saved",
        "calibrate_rig sources": {"left": scene()},
        "assess.joint_covariance calibrations": [calibration(), turned()],
        "assess.triangulate calibrations": [calibration(), turned()],
        "assess.triangulate pixels": [CAMERA.project((-40.0, 0.0, -2.0)), TURNED.project((-40.0, 0.0, -2.0))],
        "Camera.save path": "saved.json",
        "path": "none.json",
        "name": "soccer",
        "problem.RobustLoss name": "cauchy",
        "jobs": 1,
        "function": len,
        "executor": None,
        "items": [[1]],
        "results": results(),
        "web.write_report path": "report.html",
        "advice": (Advice.LOOK,),
        "tool": Tool.PYTHON,
        "result": np.ones((32, 3)),
        "pan": -0.3,
        "tilt": 1.35,
        "roll": 0.0,
        "focal_length": 800.0,
        "rvec": np.zeros(3),
        "tvec": np.zeros(3),
        "camera_matrix": CAMERA.K,
        "dist_coeffs": None,
        "offset": (10, 10),
        "template": (105.0, 68.0),
        "signs": (1.0, -1.0, 1.0),
        "start": (0.0, 0.0, 0.0),
        "end": (1.0, 0.0, 0.0),
        "center": (0.0, 0.0, 0.0),
        "radius": 9.15,
        "straight": 1.0,
        "bent": 1.0,
        "spacing": 1.0,
        "phi": np.zeros(2),
        "count": 3,
        "pixels": 3,
        "squared": np.ones(3),
        "scale": 3.0,
        "labels": LABELS,
        "threshold": 5.0,
        "accuracies": (0.5, 0.6, 0.7),
        "completeness": 1.0,
        "pitch": pitch() if HAS_PITCHES else None,
        "ax": pitch().draw()[1] if HAS_PITCHES else None,
        "trails": [X[:, :2]],
        "covariance": np.broadcast_to(np.eye(2), (len(X), 2, 2)),
        "assess.SpacePoint errors": np.ones(2),
        "assess.height_above_ground foot": CAMERA.project((-40.0, 0.0, 0.0)),
        "assess.height_above_ground top": CAMERA.project((-40.0, 0.0, -2.0)),
    }


@cache
def instances():
    """Objects of the public classes, of which methods are called."""
    return {
        "geometry.Alignment": ALIGNMENTS["wc14"],
        "Arc": FIELD["Circle left"],
        "Calibration": calibration(),
        "Camera": CAMERA,
        "fields.CameraDistribution": DISTRIBUTIONS["main center"],
        "solve.Decomposition": camera_from_homography(H, SIZE),
        "Editor": Editor([IMAGE]),
        "Field": FIELD,
        "fields.FieldHomography": field_homography(CAMERA, FIELD),
        "solve.FieldSize": estimate_field_size(FIELD, [PIXELS], SIZE),
        "io.KeyPoints": key_points(np.ones((32, 3))),
        "Line": FIELD["Middle line"],
        "images.Matches": Matches(XY, XY, np.eye(3), 1.0, 1.0),
        "Point": FIELD["CENTER_MARK"] if "CENTER_MARK" in FIELD else Point((0.0, 0.0, 0.0)),
        "PointCloud": PointCloud(X),
        "processes.Processes": Processes(1),
        "Results": results(),
        "problem.RobustLoss": RobustLoss("cauchy", 3.0),
        "SegmentationNetwork": SegmentationNetwork.load(),
        "SequenceCalibration": sequence(),
        "Tracker": Tracker(FIELD, Blind(), wait=True),
        "VideoCalibration": video(),
        "localize.Localization": Localization(PIXELS, {label: np.ones(len(xy)) for label, xy in PIXELS.items()}),
        "metrics.Confusion": Confusion(1, 2, 3),
        "metrics.ProjectionError": ProjectionError(1.0, 1.0, 1.0, 0.0),
        "metrics.SegmentEvaluation": evaluate_segments([CAMERA], [PIXELS], SIZE),
    }


@dataclass(frozen=True)
class Right:
    """A call that is right."""

    function: Callable
    arguments: dict
    parameters: tuple

    def __call__(self, **replaced):
        """The call with some arguments replaced."""
        given = inspect.signature(self.function).bind_partial()
        given.arguments |= {**self.arguments, **replaced}
        given.arguments = {name: given.arguments[name] for name in self.parameters if name in given.arguments}
        return self.function(*given.args, **given.kwargs)


def right_call(name, function, fields=None):
    """The right call of a function of a name; `fields` are the right arguments of a class that the library fills."""
    right, arguments = {**right_arguments(), **(fields or {})}, {}
    parameters = inspect.signature(function).parameters
    named = [one.name for one in parameters.values() if one.kind not in (one.VAR_KEYWORD, one.VAR_POSITIONAL)]
    for parameter in named:
        if (own := f"{name} {parameter}") in right:
            arguments[parameter] = right[own]
        elif parameters[parameter].default is inspect.Parameter.empty or parameter in ("network", "progress", "wait"):
            arguments[parameter] = right[parameter]
    return Right(function, arguments, tuple(named))


@cache
def right_calls():
    """The right calls of everything in the reference, by name."""
    found = {}

    def add(name, function, fields=None):
        if name not in NOT_CALLED and callable(function) and not isinstance(function, types.ModuleType):
            found[name] = right_call(name, function, fields)

    for name in re.findall(r"^    ([A-Za-z_.]+)$", API.read_text(), re.MULTILINE):
        public, one = reduce(getattr, name.split("."), fieldcalib), instances().get(name)
        if HAS_PITCHES or not name.startswith("plot."):
            add(name, public, vars(one) if is_dataclass(one) else None)
        for method, of_class in vars(public).items() if one is not None else ():
            if not method.startswith("_") and isinstance(of_class, types.FunctionType | classmethod | staticmethod):
                add(f"{name}.{method}", getattr(one, method))
    return found


def is_told(error):
    """Whether an error is one of a wrong argument or of a file that the library raises itself, in its own words."""
    last = error.__traceback__
    while last.tb_next:
        last = last.tb_next
    code = last.tb_frame.f_code
    raised = dis.opname[code.co_code[last.tb_lasti]] == "RAISE_VARARGS"
    told = raised and isinstance(error, ValueError | TypeError | OSError | ImportError | LookupError)
    return told and Path(fieldcalib.__file__).parent in Path(code.co_filename).parents


ODD = [
    *(None, True, False, 0, 1, -1, 2, 0.5, -0.5, 1e-300, 1e308, np.nan, np.inf, -np.inf, 10**30, -(10**30), 1j),
    *("", "soccer", "a", "1", "\0", "é", b"", b"x", Path("none"), Path("."), Ellipsis, NotImplemented, slice(None)),
    *([], (), {}, set(), [[]], [[1, 2], [3]], [None], ["a"], [1, 2], [1, 2, 3], [[1, 2]], [1, "a", None], range(3)),
    *((960, 540), (0, 0), (-1, 5), (1.5, 2), (1e9, 1e9), (10**9, 10**9), (960,), (960, 540, 3), ("960", "540")),
    *(np.zeros(0), np.zeros((0, 2)), np.zeros((3, 3)), np.eye(3), np.eye(3) * np.nan, np.zeros((2, 2, 2))),
    *(np.zeros((4, 2)), np.ones((4, 3)), np.full((7, 2), np.inf), np.array(3.0), np.zeros((3, 3), complex)),
    *(np.array("a"), np.array([None, 1]), np.array(["a", "b"]), np.datetime64("2020-01-01"), np.float32(3), np.int8(3)),
    *(
        np.zeros((270, 480), np.uint8),
        np.zeros((0, 0, 3), np.uint8),
        np.zeros((5, 5, 3)),
        np.zeros((5, 5, 4), np.uint8),
    ),
    *(object(), lambda *_, **__: None, iter([]), np.random.default_rng(0)),
    *({"a": 1}, {1: [[1, 2]]}, {"x": XY}, [PIXELS], [None, PIXELS], [CAMERA, None], [IMAGE, None], [np.eye(3)] * 2),
    *({"Side line left": value} for value in (None, 5, [], [[1, 2]], [[1, 2], [3, 4]], "a")),
    *({**PIXELS, "Circle left": PIXELS["Circle left"] * scale} for scale in (np.nan, np.inf, 1e300, 1j)),
    *(IMAGE, CAMERA, FIELD, dict(PIXELS), X, XY, H),  # a copy: calibrate_video writes to its `parts`
    *(10**400, -(10**400), -1e308, 2**63, -(2**63), np.datetime64("NaT"), "é" * 300, Path("é" * 300), "\ud800", "-"),
    *(np.full(shape, value) for shape in ((3, 3), (7, 2), (4, 3)) for value in (1e308, -1e308)),
    *(
        [10**400],
        [b""],
        [""],
        [[]] * 3,
        [[1e308, 1e308]] * 3,
        np.full((3, 2), 10**400, object),
        {None: 1},
        {(1, 2): XY},
    ),
    *(np.zeros((540, 960, 3)), np.full((5, 5, 3), np.nan), np.zeros((270, 480, 3), bool), np.zeros((3, 0))),
    *(np.zeros((270, 480, 3), "M8[D]"), np.array([IMAGE, None], object), np.zeros(3, [("a", int)]), np.ma.masked),
    *({"Side line left": {"a": 1}}, {"": XY}, frozenset([1]), [IMAGE, IMAGE[:5]], IMAGE[:, ::-2], memoryview(b"abc")),
]
