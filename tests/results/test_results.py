"""Results that are kept: as dicts and JSON, pickled, copied, compared, written to a folder and read back."""

import copy
import dataclasses
import json
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import examples, numbers, texts

from fieldcalib import (
    Arc,
    Calibration,
    Camera,
    Field,
    Line,
    Point,
    PointCloud,
    Status,
    calibrate_batch,
    calibrate_from_points,
    calibrate_from_segments,
    calibrate_sequence,
    read,
    soccer,
)
from fieldcalib.assess.camera_errors import KnownErrors
from fieldcalib.assess.findings import Finding, SuspectLabel, Verdict, What
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.assess.result import with_findings
from fieldcalib.assess.sequence_calibration import SequenceCalibration, with_doubts
from fieldcalib.assess.video import Shape, Shot, VideoCalibration
from fieldcalib.cli.main import main
from fieldcalib.draw import draw_calibration, draw_field, draw_minimap, render_field
from fieldcalib.fields.records import field_from_record, field_to_record
from fieldcalib.fields.traits import LineLook, ProbabilityModel, SizePrior
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.images.refinement import refine_on_image
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.formats import ANNOTATIONS
from fieldcalib.io.image_files import checked_image
from fieldcalib.io.soccernet import format_annotation, format_camera, parse_annotation, parse_camera
from fieldcalib.problem import RobustLoss
from fieldcalib.problem.picture_shape import Declared, Placement
from fieldcalib.results.collection import Results
from fieldcalib.results.frames import KeptFrames
from fieldcalib.solve import estimate_field_size

SIZE = (960, 540)
LABELS = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
TRUTH = Camera.from_angles(0.3, 1.36, 0.01, 1300.0, (1.0, 66.0, -16.0), SIZE, k=(0.1, 0.0))
LARGEST_PICKLE = 8192


def labelled(camera=TRUTH, labels=LABELS, spacing=6.0, shift=(0.0, 0.0)):
    pixels = {label: camera.project(soccer()[label].sample(spacing)) + shift for label in labels}
    inside = {label: xy[np.all((xy >= 0.0) & (xy < SIZE), axis=1)] for label, xy in pixels.items()}
    return {label: xy for label, xy in inside.items() if len(xy)}


def through_json(calibration):
    return Calibration.from_dict(json.loads(json.dumps(calibration.to_dict(), allow_nan=False)))


def through_pickle(calibration):
    return pickle.loads(pickle.dumps(calibration))


WAYS = pytest.mark.parametrize("kept", [through_json, through_pickle, copy.deepcopy, copy.copy])


def assert_same(found, calibration):
    """Equal, and everything that follows from it is as before."""
    assert found == calibration
    assert found.camera == calibration.camera
    assert (found.status, found.verdict, found.reason) == (
        calibration.status,
        calibration.verdict,
        calibration.reason,
    )
    assert bool(found) == bool(calibration)
    np.testing.assert_equal(found.rms_as_labelled, calibration.rms_as_labelled)
    if calibration.has_probability:
        for metres in (0.2, 1.0):
            assert found.probability(metres) == pytest.approx(calibration.probability(metres), rel=1e-6, nan_ok=True)
    if calibration.solved is None:
        return
    scale = np.sqrt(np.diagonal(calibration.covariance))
    with np.errstate(invalid="ignore"):
        np.testing.assert_allclose(
            found.covariance / np.outer(scale, scale), calibration.covariance / np.outer(scale, scale), atol=1e-6
        )
    for one, other in zip(found.std_deviations, calibration.std_deviations, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)
    xy = np.array([[480.0, 300.0], [100.0, 500.0]])
    np.testing.assert_allclose(
        found.field_uncertainty(xy).covariance, calibration.field_uncertainty(xy).covariance, rtol=1e-5
    )
    information = [direction.information for direction in calibration.observability]
    np.testing.assert_allclose(
        [direction.information for direction in found.observability], information, rtol=1e-4, atol=1e-6
    )
    if np.min(np.diff(information), initial=np.inf) > 1e-4:  # what the labels tell alike has no order
        assert str(found.uncertainty) == str(calibration.uncertainty)
    assert found.uncertainty.distance(TRUTH) == pytest.approx(calibration.uncertainty.distance(TRUTH), rel=1e-5)


FRAMES = (
    labelled(),
    {**labelled(spacing=4.0), "Small rect. right top": labelled(labels=("Small rect. right main",)).popitem()[1]},
    labelled(labels=LABELS[:2]),  # too few
    {},
)


@pytest.fixture(scope="module")
def batch():
    return calibrate_batch(soccer(), FRAMES, SIZE)


@WAYS
def test_what_was_kept_is_the_same(batch, kept):
    for calibration in batch:
        assert_same(kept(calibration), calibration)


@WAYS
@pytest.mark.parametrize(
    "how",
    [
        {"prior": None},
        {"prior": "main center", "loss": RobustLoss("huber", 2.5)},
        {"tau": 1e-9},
        {"weights": {"Side line top": 0.3, "Circle right": 2.0}},
    ],
)
def test_however_it_was_calibrated(kept, how):
    calibration = calibrate_from_segments(soccer(size_known="prior" in how), labelled(shift=(0.4, -0.3)), SIZE, **how)
    assert_same(kept(calibration), calibration)


@WAYS
def test_of_points_and_of_fields_that_are_none(kept):
    corners = [(0.0, 0.0), (10.0, 5.0), (-8.0, 4.0), (3.0, -12.0), (9.0, -7.0), (2.0, 8.0)]
    X = np.column_stack([corners, [0.0, 0.0, -2.0, 0.0, -1.0, -3.0]])
    camera = Camera.from_angles(0.0, 1.3, 0.0, 1300.0, (0.0, 40.0, -14.0), SIZE)
    calibration = calibrate_from_points(X, camera.project(X).round(), SIZE)
    found = kept(calibration)
    assert found == calibration
    np.testing.assert_allclose(found.covariance, calibration.covariance, rtol=1e-6)
    plain = dict(soccer())
    curve = PointCloud(plain["Circle right"].sample(1.0), ordered=True)
    plain |= {"curve": curve, "dots": PointCloud(curve.points[::3])}
    pixels = labelled(labels=LABELS[:4]) | {"curve": TRUTH.project(curve.X[3:8]), "dots": TRUTH.project(curve.X[3:9:3])}
    calibration = calibrate_from_segments(plain, pixels, SIZE, prior=soccer().stands)
    assert calibration.field is None
    assert_same(kept(calibration), calibration)


def test_a_free_field_size_is_kept():
    size = estimate_field_size(soccer(), [labelled(), labelled(spacing=4.0)], SIZE)
    for calibration in size.calibrations:
        assert_same(through_json(calibration), calibration)


finite = numbers(-1e6, 1e6)
errors = st.floats(allow_nan=True, allow_infinity=True)
names = texts(min_size=1, max_size=12)
angles = st.tuples(numbers(-3.0, 3.0), numbers(0.1, 3.0), numbers(-1.0, 1.0))
some_cameras = st.builds(
    lambda angles, f, C, k: Camera.from_angles(*angles, f, C, SIZE, k=k),
    angles,
    numbers(1.0, 1e5),
    st.tuples(finite, finite, finite),
    st.lists(numbers(-1.0, 1.0), min_size=2, max_size=2) | st.lists(numbers(-1.0, 1.0), min_size=12, max_size=12),
)
suspects = st.lists(st.builds(SuspectLabel, names, st.none() | names, st.floats(allow_nan=False)), max_size=2).map(
    tuple
)


@st.composite
def calibrations(draw):
    """Any, but without a solved problem."""
    camera = draw(st.none() | some_cameras)
    per_segment = draw(st.dictionaries(names, errors, max_size=4))
    return Calibration(
        camera,
        draw(st.sampled_from(Status)),
        draw(texts()),
        draw(errors),
        draw(errors),
        per_segment,
        draw(suspects),
        draw(st.lists(some_cameras, max_size=2).map(tuple)) if camera is not None else (),
        draw(st.lists(st.builds(Finding, st.just(What.STRAY), texts(), st.tuples(finite)), max_size=2).map(tuple)),
        {label: draw(st.integers(1, 9)) for label in per_segment},
        draw(st.none() | st.builds(soccer, numbers(90.0, 120.0), numbers(45.0, 90.0), size_known=st.booleans())),
    )


@given(calibrations())
def test_any_calibration_survives_json_and_pickle(calibration):
    for found in (through_json(calibration), through_pickle(calibration)):
        assert found == calibration
        assert found.camera == calibration.camera
        assert found.field == calibration.field
        for one in dataclasses.fields(Calibration):
            np.testing.assert_equal(getattr(found, one.name), getattr(calibration, one.name))


@examples(15)
@given(
    angles=st.tuples(numbers(-0.4, 0.4), numbers(1.25, 1.45), numbers(-0.03, 0.03)),
    f=numbers(900.0, 2500.0),
    noise=st.lists(numbers(-1.5, 1.5), min_size=10, max_size=10),
    labels=st.sets(st.sampled_from([*LABELS, "Middle line", "Circle central", "Side line left"]), min_size=1),
)
def test_any_solved_frame_survives_json(angles, f, noise, labels):
    camera = Camera.from_angles(*angles, f, (2.0, 64.0, -15.0), SIZE)
    frame = labelled(camera, sorted(labels))
    frame = {label: xy + np.resize(noise, xy.shape) for label, xy in frame.items()}
    calibration = calibrate_from_segments(soccer(), frame, SIZE)
    assert_same(through_json(calibration), calibration)


segments = st.one_of(
    st.builds(Point, st.tuples(finite, finite, finite)),
    st.builds(lambda X, d: Line(X, (X[0] + d, *X[1:])), st.tuples(finite, finite, finite), numbers(1.0, 9.0)),
    st.builds(Arc, st.tuples(finite, finite, finite), numbers(0.1, 50.0), numbers(0.0, 3.0), numbers(3.0, 6.0)),
    st.builds(PointCloud, st.lists(st.tuples(finite, finite, finite), min_size=3, max_size=5), ordered=st.booleans()),
)
positive = numbers(0.01, 1e3)
fields_of_others = st.builds(
    Field,
    positive,
    positive,
    st.dictionaries(names.map(str.strip).filter(bool), segments, min_size=1, max_size=3),
    stands=st.sampled_from([(), soccer().stands, soccer().stands[2:4]]),
    farthest_camera=positive | st.just(np.inf),
    scale=positive | st.just(np.nan),
    lines=st.builds(LineLook, positive, st.booleans(), positive, positive, positive | st.just(np.inf)),
    size_model=st.none() | st.just(soccer().size_model),
    size_known=st.booleans(),
    probability=st.none() | st.builds(ProbabilityModel, st.tuples(*5 * [finite]), st.none() | st.floats(0.0, 1.0)),
)


@given(fields_of_others)
def test_any_field_survives_json_and_pickle(field):
    assert field_from_record(json.loads(json.dumps(field_to_record(field), allow_nan=False))) == field
    assert pickle.loads(pickle.dumps(field)) == field


def test_a_soccer_field_is_kept_by_its_size_and_one_that_was_changed_as_a_whole():
    field = soccer(101.5, 66.0, size_known=True)
    assert len(pickle.dumps(field)) < 200
    assert pickle.loads(pickle.dumps(field)) == field
    more = field.with_segments({"flag": Point((1.0, 2.0, -1.5))})
    for found in (pickle.loads(pickle.dumps(more)), field_from_record(field_to_record(more))):
        assert found == more
        assert found != field
    assert field_from_record(field_to_record(more)).size_model == soccer().size_model


def court(length, width):
    """A field that this package does not build."""
    line = Line((0.0, -width / 2.0, 0.0), (0.0, width / 2.0, 0.0))
    around = ((length, length + 1.0), (width, width + 1.0))
    return Field(length, width, {"Middle line": line}, size_model=SizePrior(around, around, build=court))


def test_a_function_of_somebody_else_is_pickled_but_not_written():
    field = court(28.0, 15.0)
    assert pickle.loads(pickle.dumps(field)) == field
    found = field_from_record(json.loads(json.dumps(field_to_record(field))))
    assert found == dataclasses.replace(field, size_model=None)


def test_equality_sees_every_part(batch):
    one = batch[0]
    assert one == calibrate_batch(soccer(), FRAMES, SIZE)[0]
    nothing = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")  # NaN is NaN
    assert nothing == Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")
    others = {
        "camera": TRUTH,
        "status": Status.IMPROBABLE,
        "message": "",
        "rms": 9.0,
        "_loss": 9.0,
        "per_segment_errors": {},
        "suspect_labels": (SuspectLabel("Middle line", None, 9.0),),
        "alternatives": (TRUTH,),
        "_found": (Finding(What.SEARCHED),),
        "pixel_counts": {},
        "field": soccer(100.0, 64.0),
        "errors": KnownErrors(batch[1].uncertainty.layout, batch[1].uncertainty.theta, batch[1].covariance),
        "markings": (MarkingInView("Middle line", 300.0, 25, 0.1, 21.4),),
        "are_annotated": False,
        "declared": Declared.FRAME,
    }
    assert set(others) == {one.name for one in dataclasses.fields(Calibration)}
    for name, value in others.items():
        assert dataclasses.replace(one, **{name: value}) != one, name
    assert one != one.to_dict()


def test_a_dict_of_another_version_or_of_something_else_is_refused(batch):
    record = batch[0].to_dict()
    for version in (2, None, "1"):
        with pytest.raises(ValueError, match="expected a calibration of version 1, got"):
            Calibration.from_dict({**record, "version": version})
    with pytest.raises(ValueError, match="the key 'K' is missing"):
        Calibration.from_dict({key: value for key, value in record.items() if key != "K"})
    for broken in ({"status": "splendid"}, {"K": [1.0]}, {"solved": {"problem": 3}}, {"field": {"builder": "eval"}}):
        with pytest.raises(ValueError, match="is no calibration"):
            Calibration.from_dict(record | broken)
    assert Calibration.from_dict({**record, "key of somebody": 1}) == batch[0]


def test_a_pickle_is_small_and_knows_nothing_of_the_other_frames(shared_data):
    files = ANNOTATIONS.find([shared_data / "sncalib-test-center"])[:40]
    frames = [parse_annotation(file.read(), SIZE) for file in files]
    for calibration in calibrate_batch(soccer(), frames, SIZE):
        assert calibration.verdict in Verdict  # what was computed meanwhile is not in it
        data = pickle.dumps(calibration)
        assert len(data) <= LARGEST_PICKLE
        assert pickle.loads(data) == calibration


def test_asdict(batch):
    for calibration in batch:
        found = dataclasses.asdict(calibration)
        assert list(found) == [one.name for one in dataclasses.fields(Calibration)]
        if calibration.camera is not None:
            np.testing.assert_array_equal(found["camera"]["K"], calibration.camera.K)
            assert found["field"]["length"] == 105.0


def test_html_for_notebooks(batch):
    html = batch[0]._repr_html_()
    assert f"<td>{batch[0].verdict}</td>" in html
    assert f"{batch[0].camera.focal_length:.1f} px" in html
    assert "&lt;script&gt;" in Calibration.without_camera(Status.DEGENERATE, "<script>")._repr_html_()


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder that `calibrate` wrote, with a broken file among its frames."""
    source, out = tmp_path_factory.mktemp("annotations"), tmp_path_factory.mktemp("results")
    for index, frame in enumerate(FRAMES):
        (source / f"{index}.json").write_text(format_annotation(frame, SIZE))
    (source / "9.json").write_text("{")
    assert main(["calibrate", str(source), "--out", str(out), "--size", "960x540"]) == 1
    return out


def test_results_are_read_back(written):
    results = read(written)
    assert list(results) == ["0", "1", "2", "3"]
    assert list(results.broken) == ["9"]
    assert [line["id"] for line in results.lines] == ["0", "1", "2", "3", "9"]
    again = [parse_annotation(format_annotation(frame, SIZE), SIZE) for frame in FRAMES]
    for found, calibration in zip(results.values(), calibrate_batch(soccer(), again, SIZE), strict=True):
        assert_same(found, calibration)
    assert list(read(str(written / "cameras.jsonl"))) == list(results)
    assert repr(results.cameras) == "<3 by id: '0', '1', '2'>"


def test_results_as_a_table(written):
    table = read(written).to_pandas(everything=True)
    import pandas

    assert isinstance(table, pandas.DataFrame)
    assert list(table.index) == ["0", "1", "2", "3", "9"]
    results = read(written)
    assert table.loc["0", "angles_degrees.pan"] == pytest.approx(np.degrees(results["0"].camera.angles[0]))
    assert table.loc["9", "status"] == "broken file"
    assert table.loc["1", "image_size"] == list(SIZE)
    label = next(iter(results["1"].pixel_counts))
    assert table.loc["1", f"pixel_counts.{label}"] == results["1"].pixel_counts[label]
    assert table.loc["0", "rms_px"] == results["0"].rms
    assert not any("solved" in column for column in table.columns)
    assert json.loads(table.to_json(orient="index"))["1"]["C"] == pytest.approx(results["1"].camera.C.tolist())
    table.to_parquet(written / "table.parquet")
    again = pandas.read_parquet(written / "table.parquet")
    assert again.loc["1", "K"][0][0] == results["1"].camera.K[0, 0]
    assert list(again.columns) == list(table.columns)


def test_without_pandas_the_message_says_how_to_get_it(written, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r"pip install 'fieldcalib\[pandas\]'"):
        read(written).to_pandas()


@pytest.mark.parametrize(
    ("name", "value"), [("K", 1.5), ("K", [[1.0] * 3] * 2), ("R", 2), ("R", [[1.0] * 3] * 4), ("C", 1e9), ("K", "abc")]
)
def test_cameras_that_are_none(tmp_path, name, value):
    rows = [[1.0] * 3] * 3
    line = {"id": "b", "status": "accepted", "message": "", "version": 2, "image_size": [9, 9], "dist": []}
    line |= {"K": rows, "R": rows, "C": [0.0] * 3, name: value}
    (tmp_path / "cameras.jsonl").write_text(f"{json.dumps(line)}\n")
    with pytest.raises(BrokenFileError, match="line 1: a camera needs 'K' and 'R', each three rows"):
        read(tmp_path).cameras["b"]


def test_results_that_are_none(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"cameras\.jsonl does not exist"):
        read(tmp_path)
    path = tmp_path / "cameras.jsonl"
    good = {"id": "a", "status": "broken file", "message": ""}
    for line, message in (
        ("{", "is no JSON"),
        ("[]", "expected a JSON object"),
        ('{"id": "b"}', "needs the key 'status'"),
        ('{"id": "b", "status": "accepted", "message": ""}', "of version 3 .or 1, 2., got None"),
    ):
        path.write_text(f"{json.dumps(good)}\n{line}\n")
        with pytest.raises(BrokenFileError, match=f"line 2: .*{message}"):
            read(tmp_path)["b"]
    path.write_text("")
    assert len(read(tmp_path)) == 0


def test_what_parse_camera_reads_is_drawn():
    image = render_field(TRUTH, soccer())
    camera = parse_camera(format_camera(TRUTH), SIZE)
    np.testing.assert_array_equal(draw_field(image, camera, soccer()), draw_field(image, TRUTH, soccer()))
    difference = draw_minimap(camera, soccer()).astype(int) - draw_minimap(TRUTH, soccer())
    assert np.mean(difference != 0) < 1e-3  # rounding


class Blind:
    classes = ("background", "Middle line")

    def __call__(self, images):
        return np.zeros((len(images), 2, 90, 160), np.float32)


class Picture:
    """As PIL.Image.Image: its array is red, green, blue."""

    def __init__(self, array, mode="RGB"):
        self.array, self.mode = array, mode

    def getbands(self):
        return tuple(self.mode)

    def convert(self, mode):
        assert mode == "RGB"
        return Picture(np.repeat(self.array, 3, axis=-1) if self.mode == "L" else self.array)

    def __array__(self, dtype=None, copy=None):
        return np.array(self.array, dtype=dtype)


def test_pictures_of_pil_are_images():
    rgb = np.random.default_rng(0).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    np.testing.assert_array_equal(checked_image(Picture(rgb)), rgb[..., ::-1])
    grey = Picture(rgb[..., :1], "L")
    np.testing.assert_array_equal(checked_image(grey), np.repeat(rgb[..., :1], 3, axis=-1))


@pytest.mark.parametrize(
    ("image", "message"),
    [
        ("frame.jpg", r"got the path 'frame\.jpg'; cv2\.imread reads it"),
        (np.zeros, "got "),
        ((row for row in ()), "got generator"),
        (None, "image is None"),
        (np.zeros((3, 54, 96), np.uint8), r"got shape \(3, 54, 96\); image.transpose\(1, 2, 0\) makes it so"),
        (np.zeros((0, 0, 3), np.uint8), "a picture with pixels makes it so"),
    ],
)
def test_what_is_no_image_is_named(batch, image, message):
    for call in (
        lambda: checked_image(image),
        lambda: draw_calibration(image, batch[0], soccer()),
        lambda: refine_on_image(soccer(), image, batch[0]),
        lambda: calibrate_from_images(soccer(), [image], Blind()),
    ):
        with pytest.raises(ValueError, match=message):
            call()


def test_images_and_frames_may_be_generated(batch):
    black = np.zeros((540, 960, 3), np.uint8)
    assert len(calibrate_from_images(soccer(), (black for _ in range(2)), Blind())) == 2
    assert len(calibrate_from_images(soccer(), [Picture(black)], Blind())) == 1
    assert calibrate_batch(soccer(), iter(FRAMES), SIZE, weights=({} for _ in FRAMES)) == batch
    for images in ("frame.jpg", black, Picture(black), 3):
        with pytest.raises(ValueError, match="expected a list of images, got"):
            calibrate_from_images(soccer(), images, Blind())
    for frames in ("frames", 3, None):
        with pytest.raises(ValueError, match="expected mappings of labels"):
            calibrate_batch(soccer(), frames, SIZE)


NUMBERS = {  # of findings that have some
    **dict.fromkeys((What.OFF_PAINT, What.PAST_END, What.WIDE_PAINT, What.MISFIT, What.REPEATS, What.STRAY), (3.5,)),
    What.OUTSIDE: (3.5,),
    What.RECOGNISED: (3.5,),
    **dict.fromkeys((What.CONTRADICTED, What.INACCURATE, What.NOT_LEVEL, What.SHARED_MISFIT), (0.25,)),
    **dict.fromkeys((What.IMPROBABLE, What.OTHER_SIZE, What.SUSPECTS, What.MISSED), (1.0, 2.0)),
    **dict.fromkeys((What.OTHER_PICTURE, What.EXCHANGED_SIZE, What.EXPLAINED), (960.0, 540.0)),
    What.ONE_OF: (6.0,),
    What.RAISED: (0.46, 0.05),
    What.LITTLE_PAINT: (44.0,),
    What.TWO_WIDTHS: (8.23, 10.97, 13.7, 10.5),
    **dict.fromkeys((What.BORDER, What.OTHER_PLACE, What.TOO_FEW_LABELS), (1.0, 2.0, 3.0)),
}


@pytest.mark.parametrize("what", What)
def test_every_finding_has_a_sentence_and_is_read_back(what):
    about = "log f" if what in (What.UNUSUAL, What.CONTRADICTED) else "Middle line"
    found = Finding(what, about, NUMBERS.get(what, ()))
    assert len(str(found)) > 10
    assert Finding.from_dict(json.loads(json.dumps(found.to_dict()))) == found
    if found.numbers:
        with pytest.raises(ValueError, match="expected a finding with its numbers"):
            Finding.from_dict({"what": str(what), "about": about})


def test_slices_are_mappings_of_their_frames(batch):
    results = Results(KeptFrames(["a", "b", "c"], batch[:2], {"b": "is cut off"}))
    assert list(results[1:]) == ["c"]
    assert results[1:]["c"] is results["c"]
    assert dict(results[:]) == dict(results)


def test_a_long_reason_ends_at_a_word():
    said = repr(Calibration.without_camera(Status.TOO_FEW_SEGMENTS, " ".join(["labelled"] * 20)))
    assert said == f"Calibration(reject, no camera: {' '.join(['labelled'] * 6)} [...])"


def test_findings_follow_their_calibration(batch):
    one = with_findings(batch[0], Finding(What.STRAY, "Middle line", (9.0,)), Finding(What.SEARCHED))
    assert one.verdict == "check"
    assert [found.what for found in one.findings][-2:] == [What.STRAY, What.SEARCHED]  # notes come last
    assert "'Middle line' is marked 9 px beside its projection; rms" in one.reason
    assert Calibration.from_dict(json.loads(json.dumps(one.to_dict()))).findings == one.findings
    assert with_findings(batch[0], Finding(What.SEARCHED)).verdict == batch[0].verdict  # a note is no evidence


def test_the_other_side_halves_the_probability_once(batch):
    open_side = with_findings(batch[0], *2 * [Finding(What.OTHER_SIDE)])
    assert open_side.probability() == pytest.approx(batch[0].probability() / 2.0)
    assert open_side.reason.count("turned by 180 degrees") == 1  # nothing is said twice


def test_words_of_earlier_versions_are_kept(batch):
    record = {name: value for name, value in batch[0].to_dict().items() if name != "found"}
    read = Calibration.from_dict({**record, "complaints": ["2 of 7 labels are suspect"]})
    assert read.verdict == "check"
    assert "2 of 7 labels are suspect; rms" in read.reason


def test_clips_of_earlier_versions_are_read():
    """Without findings of their own, with doubts and complaints in words."""
    nothing = calibrate_sequence(soccer(), [{}, {}], SIZE)
    doubted = with_doubts(nothing, [1], Finding(What.SAID, "it may be mixed"))
    shape = Shape(Placement.whole(SIZE), (Finding(What.SAID, "not 16:9"),))
    video = VideoCalibration((doubted,), (Shot(0, 2, 0),), np.zeros(2, dtype=int), np.arange(2), shape=shape)
    record = json.loads(json.dumps(video.to_dict()))
    del record["findings"], record["shape"]["findings"]
    record["shape"]["complaints"] = ["not 16:9"]
    record["tripods"][0]["frames"]["doubts"] = [[1, "it may be mixed"]]
    assert VideoCalibration.from_dict(record).to_dict() == video.to_dict()


def test_doubts_of_a_sequence_are_findings():
    nothing = calibrate_sequence(soccer(), [{}, {}], SIZE)
    mixed = Finding(What.MIXED)
    found = with_doubts(with_doubts(nothing, [1], mixed), [0, 1], Finding(What.ENLARGED))
    assert found.frames.doubts == {1: (mixed, Finding(What.ENLARGED)), 0: (Finding(What.ENLARGED),)}
    assert SequenceCalibration.from_dict(json.loads(json.dumps(found.to_dict()))).frames.doubts == found.frames.doubts
