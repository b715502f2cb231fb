"""Damaged files of results: each is read, or the error names the file and the line; nothing else comes out."""

import json
import pickle
import shutil
import warnings
from copy import deepcopy
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import FIELD, KnownCameras, looked_at
from odd_calls import is_told
from synthetic import random_frames

from fieldcalib import Camera, calibrate, read
from fieldcalib.draw.scene import render_field
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.parquet import write_parquet

CAMERAS = [Camera.from_angles(pan, 1.32, 0.0, 475.0, (1.0, 66.0, -16.0), (480, 270)) for pan in (0.1, 0.2, 0.3)]
LINES = ("cameras.jsonl", "solver.jsonl", "clip.jsonl")
DEEP = '"deep"'  # a text in JSON in the place of which lists come that lie in one another
VALUES = (
    *(0, 1, -1, 0.5, 1e308, -1e308, 1e-308, 1e160, np.nan, np.inf, 10**400, None, True, "", "x", "inf", "\0"),
    *([], {}, [[]], [0], [1e308], {"a": 1}, json.loads(DEEP)),
)
DIGITS = st.sampled_from([b"[", b"{", b"0", b'"', b"\0", b"\xff", b"e", b"9", b"\n", b","])


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Results of labelled pixels, of pictures, of a clip, and as a table."""
    home = tmp_path_factory.mktemp("results")
    pictures = [render_field(camera, FIELD, rng=np.random.default_rng(0)) for camera in CAMERAS]
    frames = random_frames(2, seed=0, noise=0.5, stands=("main center",))[0]
    calibrate(frames, image_size=(960, 540), progress=False).save(home / "labels")
    calibrate(pictures, network=KnownCameras(CAMERAS), progress=False).save(home / "pictures", overlays=False)
    looked = KnownCameras([CAMERAS[t] for t in looked_at(pictures)])
    calibrate(pictures, clip=True, network=looked, progress=False).save(home / "clip", overlays=False)
    shutil.copytree(home / "labels", home / "table")
    lines = zip(*(lines_of(home / "table" / name) for name in LINES[:2]), strict=True)
    write_parquet([(main + b"\n", solver + b"\n") for main, solver in lines], home / "table" / "cameras.parquet")
    for name in LINES[:2]:
        (home / "table" / name).unlink()
    return home


@pytest.fixture(scope="module")
def damaged(tmp_path_factory):
    """The folder whose files are damaged, again and again."""
    return tmp_path_factory.mktemp("damaged") / "results"


def lines_of(path):
    return path.read_bytes().splitlines()


def parts_of(value, way=()):
    """The ways to all parts of a value in JSON."""
    yield way
    for key, part in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from parts_of(part, (*way, key))


def changed(record, data):
    """A record with one of its parts replaced, or left out."""
    record = deepcopy(record)
    depth = data.draw(st.integers(1, 5), "depth")
    way = data.draw(st.sampled_from([way for way in parts_of(record) if way and len(way) <= depth]), "part")
    parent = record
    for key in way[:-1]:
        parent = parent[key]
    if data.draw(st.integers(0, 4), "left out") == 0:
        del parent[way[-1]]
    else:
        parent[way[-1]] = data.draw(st.sampled_from(VALUES), "value")
    return json.dumps(record).encode().replace(DEEP.encode(), b"[" * 100_000)


def damage(path, others, data):
    """Damage a file."""
    content = path.read_bytes()
    how = data.draw(st.sampled_from(["byte", "cut", "swapped", "deep", "lines", "value", "value", "value"]), "damage")
    place = data.draw(st.integers(0, len(content) - 1), "place")
    if how == "byte":
        content = content[:place] + data.draw(DIGITS, "byte") + content[place + 1 :]
    elif how == "cut":
        content = content[:place]
    elif how == "deep":
        content = b"[" * 200_000
    elif how == "swapped":
        content = data.draw(st.sampled_from(others), "other").read_bytes()
    elif path.suffix == ".json":
        content = changed(json.loads(content), data)
    elif path.suffix == ".jsonl":
        lines = content.splitlines()
        number = data.draw(st.integers(0, len(lines) - 1), "line")
        if how == "value":
            lines[number] = changed(json.loads(lines[number]), data)
        else:
            lines = data.draw(st.permutations(lines), "order")[: data.draw(st.integers(0, len(lines)), "count")]
        content = b"".join(line + b"\n" for line in lines)
    path.write_bytes(content)


def everything(folder):
    """The errors of looking at all that results have."""

    def attempt(look):
        try:
            return look()
        except Exception as error:
            errors.append(error)
            return None

    errors = []
    results = attempt(lambda: read(folder))
    if results is None:
        return errors
    for look in (
        *(lambda: repr(results), lambda: dict(results.verdicts), lambda: dict(results.broken), lambda: results.notes),
        *(lambda: dict(results.cameras), lambda: dict(results.basis), lambda: dict(results.homographies())),
        *(lambda: results.to_pandas(), lambda: results.to_pandas(everything=True)),
    ):
        attempt(look)
    found = [one for one in (attempt(lambda id=id: results[id]) for id in results) if one is not None]
    video = attempt(lambda: results.video)
    if video is not None:
        found += video
        attempt(lambda: (video.shots, video.remarks, [tripod.shared for tripod in video.tripods], video.basis))
    for calibration in found:
        attempt(partial(look_into, calibration))
    return errors


def look_into(calibration):
    """All that a calibration computes when it is asked."""
    _ = calibration.verdict, calibration.reason, calibration.remedy, calibration.rms_as_labelled
    if calibration.camera is not None and calibration.knows_errors:
        _ = calibration.std_deviations, calibration.probability(0.5), calibration._repr_html_()


def read_damaged(folders, folder, data):
    """Damage a file of results, and look at them."""
    shutil.rmtree(folder, ignore_errors=True)
    kind = data.draw(st.sampled_from(["labels", "pictures", "clip", "table"]), "kind")
    shutil.copytree(folders / kind, folder)
    others = sorted(path for path in folders.glob("*/*.*") if not path.name.startswith("camera_"))
    paths = [path for path in others if path.parent == folders / kind]
    paths += 3 * [path for path in paths if path.name in LINES]  # most damages where most is read
    damage(folder / data.draw(st.sampled_from(paths), "file").name, others, data)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*its last line is incomplete")
        for error in everything(folder):
            assert is_told(error), error
            assert isinstance(error, ValueError | FileNotFoundError), error
            if isinstance(error, BrokenFileError):
                assert str(error).startswith(str(folder)), error


@given(st.data())
def test_damaged_results_are_told(folders, damaged, data):
    read_damaged(folders, damaged, data)


@pytest.mark.slow
@settings(max_examples=500)
@given(st.data())
def test_five_hundred_damaged_results_are_told(folders, damaged, data):
    read_damaged(folders, damaged, data)


def test_nested_lists_without_end(folders, damaged):
    shutil.rmtree(damaged, ignore_errors=True)
    shutil.copytree(folders / "labels", damaged)
    (damaged / "cameras.jsonl").write_bytes(b"[" * 200_000)
    with pytest.warns(UserWarning, match="its last line is incomplete"):
        assert len(read(damaged)) == 0
    (damaged / "cameras.jsonl").write_bytes(b"[" * 200_000 + b"\n")
    with pytest.raises(BrokenFileError, match=r"cameras\.jsonl, line 1: is no JSON"):
        read(damaged)


@pytest.mark.parametrize(
    ("way", "value", "problem"),
    [
        (("solved", "problem", "observations", "ends", "xy"), 0, r"'ends', 'xy'"),
        (("solved", "theta", 3), 1e308, "'theta': expected finite numbers"),
        (("solved", "theta", 3), 700.0, "'theta': expected parameters of a camera"),
        (("solved", "problem", "layout", "lens", "rho"), 1e-300, "'rho': expected half the diagonal"),
        (("solved", "problem", "layout", "roles"), [1], "'roles': expected those of pan"),
        (("found",), [3], "is no calibration"),
        (("pixel_counts",), {"x": 3}, "'segment_errors_px' of all labels"),
    ],
)
def test_values_of_the_solution_are_checked(folders, damaged, way, value, problem):
    shutil.rmtree(damaged, ignore_errors=True)
    shutil.copytree(folders / "labels", damaged)
    first, *rest = lines_of(damaged / "solver.jsonl")
    record = part = json.loads(first)
    for key in way[:-1]:
        part = part[key]
    part[way[-1]] = value
    (damaged / "solver.jsonl").write_bytes(b"\n".join([json.dumps(record).encode(), *rest, b""]))
    results = read(damaged)
    with pytest.raises(BrokenFileError, match=rf"cameras\.jsonl, line 1: .*{problem}"):
        results[next(iter(results))]


@pytest.mark.parametrize(
    ("line", "key", "value", "problem"),
    [
        (0, "shots", [[0, 2, 0]], "'shots': expected shots that follow one another"),
        (0, "tripod", [0, 1, 0], "'tripod': expected whole numbers from -1 to 0"),
        (0, "number", [0, 1, 3], "'number': expected whole numbers from 0 to 2"),
        (0, "frames_per_second", -1, "frames_per_second must be"),
        (1, "values", [1e308], "'values': expected finite numbers"),
        (1, "considered", {"shape": [1], "type": "<f8", "values": [1]}, "is no calibration of a video"),
    ],
)
def test_values_of_a_clip_are_checked(folders, damaged, line, key, value, problem):
    shutil.rmtree(damaged, ignore_errors=True)
    shutil.copytree(folders / "clip", damaged)
    records = [json.loads(text) for text in lines_of(damaged / "clip.jsonl")]
    records[line][key] = value
    (damaged / "clip.jsonl").write_text("".join(json.dumps(record) + "\n" for record in records))
    with pytest.raises(BrokenFileError, match=rf"clip\.jsonl: .*{problem}"):
        _ = read(damaged).video


@pytest.mark.parametrize("kind", ["labels", "pictures", "clip", "table"])
def test_results_that_were_read_survive_pickle(folders, kind):
    results = read(folders / kind)
    assert pickle.loads(pickle.dumps(results)) == results
    first = next(iter(results))
    looked_into = results[first].verdict, results.video, results.lines[0], results.pictures.has(first)
    again = pickle.loads(pickle.dumps(results))
    assert again == results
    assert again[first].verdict == looked_into[0]


@pytest.mark.parametrize("clip", [False, True])
def test_results_of_now_survive_pickle(clip):
    pictures = [render_field(camera, FIELD, rng=np.random.default_rng(0)) for camera in CAMERAS]
    network = KnownCameras([CAMERAS[t] for t in looked_at(pictures)] if clip else CAMERAS)
    results = calibrate(pictures, clip=clip, network=network, progress=False)
    overlay = results.overlay("000001")
    again = pickle.loads(pickle.dumps(results))
    assert again == results
    assert np.array_equal(again.overlay("000001"), overlay)
