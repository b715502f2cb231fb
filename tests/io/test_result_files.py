"""The files of results: schemas of what is written, sizes, older formats, and folders that are not whole."""

import json
import re
import resource
import time

import numpy as np
import pytest
from commands import calibrate, run
from networks import FIELD, looked_at
from schemas import SCHEMAS, problems

import fieldcalib
from fieldcalib import Camera, read, soccer
from fieldcalib.draw.scene import render_field
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.results import MAIN_KEYS, joined_line, split_line
from fieldcalib.io.videos import VideoWriter

LARGEST_LINE = 2000  # bytes
CAMERAS = [Camera.from_angles(pan, 1.32, 0.0, 475.0, (1.0, 66.0, -16.0), (480, 270)) for pan in (0.1, 0.2, 0.3)]


def records(folder):
    """What lies in a folder, each record with the name of its schema."""
    for name in ("cameras", "solver", "clip"):
        path = folder / f"{name}.jsonl"
        for line in path.read_text().splitlines() if path.exists() else ():
            yield name, json.loads(line)
    for name in ("run", "summary", "tripods"):
        path = folder / f"{name}.json"
        if path.exists():
            yield name, json.loads(path.read_text())


@pytest.fixture(scope="module")
def clip_folder(tmp_path_factory):
    """What `run` writes of a clip."""
    from networks import KnownCameras

    folder = tmp_path_factory.mktemp("clip")
    images = [render_field(camera, FIELD, rng=np.random.default_rng(0)) for camera in CAMERAS]
    with VideoWriter(folder / "a.mp4", 25.0) as video:
        for image in images:
            video.write(image)
    with pytest.MonkeyPatch.context() as patch:
        network = KnownCameras([CAMERAS[t] for t in looked_at(images)])
        patch.setattr("fieldcalib.cli.clips.load_network", lambda options: network)
        assert run("run", folder / "a.mp4", "--out", folder / "out") == 0
    return folder / "out"


@pytest.fixture(scope="module")
def broken_folder(annotated_folder, tmp_path_factory):
    """What `calibrate` writes of frames one of which is broken, and one without labels."""
    source, out = tmp_path_factory.mktemp("in"), tmp_path_factory.mktemp("out")
    for name in "ab":
        (source / f"{name}.json").write_bytes((annotated_folder / f"{name}.json").read_bytes())
    (source / "empty.json").write_text("{}")
    (source / "bad.json").write_text("{")
    assert calibrate(out, source) == 1
    return out


# --- schemas ---


def test_what_is_written_is_as_the_schemas_say(clip_folder, broken_folder, calibrated_folder):
    seen = set()
    for folder in (clip_folder, broken_folder, calibrated_folder):
        for name, record in records(folder):
            seen.add(name)
            assert problems(record, SCHEMAS[name]) == [], (name, folder)
    assert seen == set(SCHEMAS) == {"cameras", "solver", "clip", "run", "summary", "tripods"}


def test_the_schemas_know_every_key(clip_folder, calibrated_folder):
    for name, schema in SCHEMAS.items():
        assert schema["additionalProperties"] is False, name
        for key, part in schema["properties"].items():
            assert part.get("description"), (name, key)
    assert set(SCHEMAS["cameras"]["properties"]) == set(MAIN_KEYS)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"status": "fine"}, "'fine' is none of"),
        ({"K": [[1, 0], [0, 1]]}, "K has 2 items"),
        ({"zoom": 3}, "'zoom' is not in the schema"),
        ({"rms_px": "large"}, "rms_px: 'large'"),
    ],
)
def test_the_schemas_refuse_other_things(calibrated_folder, change, message):
    line = json.loads((calibrated_folder / "cameras.jsonl").read_text().splitlines()[0])
    found = problems(line | change, SCHEMAS["cameras"])
    assert any(message in one for one in found)
    assert problems({key: line[key] for key in line if key != "id"}, SCHEMAS["cameras"]) == ["$ has no 'id'"]


# --- sizes ---


def longest_line(folder):
    return max(map(len, (folder / "cameras.jsonl").read_bytes().splitlines(keepends=True)))


def test_lines_of_rendered_frames_are_short(clip_folder, calibrated_folder, broken_folder):
    for folder in (clip_folder, calibrated_folder, broken_folder):
        assert longest_line(folder) <= LARGEST_LINE


def test_lines_of_a_field_of_ones_own_are_short(tmp_path):
    field = dict(soccer())
    own = fieldcalib.Field(105.0, 68.0, {label: field[label] for label in list(field)[:20]})
    pixels = {label: CAMERAS[2].project(own[label].sample(6.0)) for label in list(own)[:6]}
    results = fieldcalib.calibrate(pixels, own, image_size=(480, 270), prior=None, progress=False)
    results.save(tmp_path / "out")
    assert longest_line(tmp_path / "out") <= LARGEST_LINE
    assert read(tmp_path / "out")["000000"].field == own


@pytest.mark.slow
def test_lines_of_real_frames_are_short(shared_data, tmp_path):
    """Annotated frames, among them some that are doubted for several reasons."""
    (tmp_path / "in").mkdir()
    for path in sorted((shared_data / "sncalib-test-center").glob("0*.json"))[::40]:
        (tmp_path / "in" / path.name).write_bytes(path.read_bytes())
    assert calibrate(tmp_path / "out", tmp_path / "in", options=["--field-size", "estimated"]) == 0
    assert longest_line(tmp_path / "out") <= LARGEST_LINE
    assert len(read(tmp_path / "out")) > 10


# --- an hour ---


def test_an_hour_opens_at_once(clip_folder, tmp_path):
    """A tenth of it here, in a tenth of two seconds of the processor; nothing but ids and places is in memory."""
    for name in ("cameras.jsonl", "solver.jsonl"):
        lines = (clip_folder / name).read_bytes().splitlines(keepends=True)
        lines = [re.sub(rb'^\{"id": "\d+"', b"", line) for line in lines]
        with (tmp_path / name).open("wb") as file:
            for number in range(9000):
                file.write(b'{"id": "%06d"' % number + lines[number % len(lines)])
    before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    results = read(tmp_path)
    assert time.process_time() - start < 0.2
    assert len(results) == 9000
    assert results["008999"].camera == results.cameras["008999"] == read(clip_folder).cameras["000002"]
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # kB; the files have 120 MB


# --- older formats, and folders that are not whole ---


@pytest.fixture
def old_folder(calibrated_folder, tmp_path):
    """The folder as format 1 had it: everything in cameras.jsonl, and no format in run.json."""
    out = tmp_path / "old"
    out.mkdir()
    for path in calibrated_folder.iterdir():
        (out / path.name).write_bytes(path.read_bytes())
    pairs = zip(*((out / name).read_text().splitlines() for name in ("cameras.jsonl", "solver.jsonl")), strict=True)
    lines = [json.dumps(joined_line(*map(json.loads, pair))) + "\n" for pair in pairs]
    (out / "cameras.jsonl").write_text("".join(lines))
    (out / "solver.jsonl").unlink()
    record = json.loads((out / "run.json").read_text())
    del record["format"], record["source"]
    (out / "run.json").write_text(json.dumps(record))
    return out


def test_folders_of_format_1_are_read(old_folder, calibrated_folder):
    assert read(old_folder) == read(calibrated_folder)
    assert run("export", old_folder, "--format", "csv") == 0


def test_a_run_of_format_1_is_not_gone_on_with(old_folder, annotated_folder, capsys):
    (old_folder / "summary.json").unlink()
    assert calibrate(old_folder, annotated_folder, options=["--resume"]) == 2
    said = capsys.readouterr().err
    assert "its files are of format 1, this fieldcalib writes format 3; --overwrite begins anew" in said


def test_a_format_of_the_future_is_named(calibrated_folder, tmp_path):
    text = (calibrated_folder / "cameras.jsonl").read_text().replace('"version": 3', '"version": 4')
    (tmp_path / "cameras.jsonl").write_text(text)
    with pytest.raises(BrokenFileError, match=r"line 1: expected .* of version 3 \(or 1, 2\), got 4.*calibrate again"):
        read(tmp_path)


def test_without_the_second_file_there_are_cameras_and_verdicts(calibrated_folder, tmp_path):
    (tmp_path / "cameras.jsonl").write_bytes((calibrated_folder / "cameras.jsonl").read_bytes())
    results, whole = read(tmp_path), read(calibrated_folder)
    assert dict(results.cameras) == dict(whole.cameras)
    assert results.verdicts == whole.verdicts
    with pytest.raises(BrokenFileError, match=r"line 2: solver\.jsonl lies not beside it"):
        results["b"]


def test_files_of_different_runs_are_not_mixed(calibrated_folder, broken_folder, tmp_path):
    (tmp_path / "cameras.jsonl").write_bytes((calibrated_folder / "cameras.jsonl").read_bytes())
    lines = (calibrated_folder / "solver.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "solver.jsonl").write_bytes(b"".join(reversed(lines)))
    with pytest.raises(BrokenFileError, match=r"solver\.jsonl has frame 'd' here, not 'a'"):
        read(tmp_path)["a"]


def test_a_line_and_its_parts():
    line = {"id": "1", "status": "accepted", "message": "", "field": {"length": 9, "width": 5, "size_known": True}}
    line |= {"version": 1, "solved": None, "markings": [1]}
    line["field"]["segments"] = {"a": 1}
    main, solver = split_line(line)
    assert main["field"] == {"length": 9, "width": 5, "size_known": True}
    whole = joined_line(main, solver)
    assert whole == line
    assert split_line(whole) == (main, solver)
    assert [list(part) for part in split_line(whole)] == [list(main), list(solver)]
