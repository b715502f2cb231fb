"""The server of the page, without a browser: what it answers, and what it refuses."""

import json
import shutil
import signal
import socket
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from killed import ended, started
from starlette.testclient import TestClient
from waiting import wait_until

import fieldcalib
from fieldcalib import Camera, soccer
from fieldcalib.cli.main import main
from fieldcalib.draw.scene import render_field
from fieldcalib.editor.clip import largest_move
from fieldcalib.editor.edit import Marks
from fieldcalib.editor.editor import Editor
from fieldcalib.editor.label_files import LabelWarning
from fieldcalib.editor.saved_files import Stored
from fieldcalib.fields import tennis
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.frame_source import VideoFrames
from fieldcalib.web.guard import Hosts
from fieldcalib.web.page import Page, page_files
from fieldcalib.web.records import frame_state

TOKEN = "a-token-of-the-tests"
HOST = "127.0.0.1:8765"
BASE = f"http://{HOST}"
ORIGIN = {"Origin": BASE}
SIZE = (960, 540)
TRUTH = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), SIZE)
LINES = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top")


class Client:
    """Requests to the page of a source."""

    def __init__(self, source, out, field=None):
        self.editor = Editor(source, field, out=out)
        self.page = Page(self.editor)
        self.http = TestClient(self.page.application(TOKEN, [HOST]), base_url=BASE)

    def get(self, path, **more):
        return self.http.get(f"/{TOKEN}/{path}", **more)

    def post(self, path, body, headers=ORIGIN):
        return self.http.post(f"/{TOKEN}/{path}", json=body, headers=headers)

    def state(self, number=0):
        answer = self.get(f"api/frame/{number}")
        assert answer.status_code == 200, answer.text
        return answer.json()

    def edit(self, do, number=0, **body):
        revision = self.state(number)["revision"]
        return self.post(f"api/frame/{number}/edit", {"revision": revision, "do": do, **body})

    def close(self):
        self.page.close()


@pytest.fixture(scope="module")
def picture(tmp_path_factory):
    path = tmp_path_factory.mktemp("pictures") / "frame.png"
    cv2.imwrite(str(path), render_field(TRUTH, soccer()))
    return path


@pytest.fixture(scope="module")
def shown(picture):
    """A page that tests only look at."""
    client = Client(picture, picture.parent / "shown")
    client.state()  # its first fit is done
    yield client
    client.close()


@pytest.fixture
def client(picture, tmp_path):
    one = Client(picture, tmp_path / "out")
    yield one
    one.close()


def ends(label):
    xy = TRUTH.project(soccer()[label].sample(3.0))
    return xy[((xy > 5.0) & (xy < (955.0, 535.0))).all(axis=1)][[0, -1]].tolist()


def labelled(client):
    client.edit("clear")
    for label in LINES:
        answer = client.edit("mark", label=label, xy=ends(label))
        assert answer.status_code == 200, answer.text
    return client.state()


# --- the sport ---


COURT = Camera.from_angles(0.0, 1.15, 0.0, 1000.0, (0.0, 22.0, -9.0), SIZE)
GREY = np.full((270, 480, 3), 100, np.uint8)  # of no sport: nothing is found in it


def test_the_sport_is_changed_and_remembered(tmp_path):
    cv2.imwrite(str(tmp_path / "court.png"), render_field(COURT, tennis()))
    court = Client(tmp_path / "court.png", tmp_path / "out")
    court.state()
    assert court.get("api/project").json()["field"] == "soccer"
    answer = court.post("api/v1/field", {"name": "tennis"})
    assert answer.status_code == 200, answer.text
    assert {one["label"] for one in answer.json()["segments"]} == set(tennis())
    assert (answer.json()["length"], court.get("api/project").json()["field"]) == (23.77, "tennis")
    wait_until(lambda: court.state()["camera"] is not None)  # the court is searched for
    assert np.linalg.norm(np.subtract(court.state()["camera"]["position"], COURT.C)) < 2.0
    assert court.edit("mark", label=next(iter(tennis())), xy=[[480.0, 300.0]]).status_code == 200
    court.close()
    with Editor(tmp_path / "court.png", out=tmp_path / "out") as editor:
        assert editor.field_name == "tennis"
    with (
        pytest.warns(LabelWarning, match="the field has no 'Base line right'.*: such marks are kept"),
        Editor(tmp_path / "court.png", "soccer", out=tmp_path / "out") as editor,
    ):
        assert editor.field_name == "soccer"


def test_the_sport_stays_where_the_picture_is_gone(tmp_path):
    cv2.imwrite(str(tmp_path / "grey.png"), GREY)
    client = Client(tmp_path / "grey.png", tmp_path / "out")
    state = client.state()
    (tmp_path / "grey.png").unlink()
    assert client.post("api/v1/field", {"name": "tennis"}).status_code >= 400
    assert client.get("api/project").json()["field"] == "soccer"
    assert client.state()["revision"] == state["revision"]
    client.close()
    with Editor(GREY[None], out=tmp_path / "out") as editor:
        assert editor.field_name == "soccer"


def test_the_sport_of_labelled_frames_stays(client, tmp_path):
    labelled(client)
    answer = client.post("api/v1/field", {"name": "tennis"})
    assert answer.status_code == 400
    assert "1 frame labelled by hand on the field of soccer: remove these labels first" in answer.json()["error"]
    assert client.state()["marks"]
    assert client.post("api/v1/field", {"name": "chess"}).status_code == 400
    client.edit("automatic")
    with pytest.warns(LabelWarning, match="such marks are kept, and have no effect"):  # those of the network
        assert client.post("api/v1/field", {"name": "tennis"}).status_code == 200
    assert client.get("api/project").json()["field"] == "tennis"


def test_the_sport_of_pictures_without_a_folder_is_changed():
    page = Page(Editor([GREY]))
    with TestClient(page.unguarded()) as client:
        assert client.post("/api/v1/field", json={"name": "tennis"}).status_code == 200
        assert client.get("/api/project").json()["field"] == "tennis"
    page.close()


# --- what is answered ---


def test_what_is_opened(shown):
    project = shown.get("api/project").json()
    assert (project["title"], project["kind"], project["count"]) == ("frame.png", "pictures", 1)
    assert project["can_save"]
    assert "tennis" in project["sports"]
    field = shown.get("api/field").json()
    assert {one["label"] for one in field["segments"]} == set(soccer())
    assert len({one["key"] for one in field["segments"]}) == len(soccer())


def test_a_frame_is_calibrated_by_itself(shown):
    state = shown.state()
    assert (state["width"], state["height"], state["automatic"], state["by_hand"]) == (*SIZE, True, False)
    assert state["camera"] is not None
    assert {"paint"} <= {curve["state"] for curve in state["curves"]}
    frames = shown.get("api/frames").json()
    assert frames["verdict"] == [state["verdict"]]
    assert frames["by_hand"] == [False]
    assert abs(frames["focal_length"][0] - 1600.0) < 80.0


def test_a_frame_is_labelled_from_nothing(client):
    state = labelled(client)
    assert state["by_hand"]
    assert not state["automatic"]
    assert abs(state["camera"]["focal_length"] - 1600.0) < 16.0
    assert state["basis"] == "labelled by hand"
    assert [mark["label"] for mark in state["marks"]] == [label for label in LINES for _ in range(2)]
    assert state["next"]["label"] in soccer()
    assert all(mark["error"] < 2.0 for mark in state["marks"])
    assert client.edit("undo").json()["can_redo"]
    assert len(client.edit("redo").json()["marks"]) == 8
    assert len(client.edit("remove", numbers=[0, 1]).json()["marks"]) == 6
    relabelled = client.edit("relabel", numbers=[0], label="Middle line").json()
    assert relabelled["marks"][0]["label"] == "Middle line"
    assert client.edit("automatic").json()["automatic"]


def test_an_edit_is_drawn_before_its_verdict_is_known(client):
    before = labelled(client)
    drawn = client.edit("remove", numbers=[0]).json()
    assert not drawn["judged"]
    assert "verdict" not in drawn
    state = client.state()
    assert state["judged"]
    assert {name: state[name] for name in drawn if name not in ("judged", "milliseconds")} == {
        name: drawn[name] for name in drawn if name not in ("judged", "milliseconds")
    }
    assert drawn["curves"] != before["curves"]
    assert drawn["milliseconds"] > state["milliseconds"] > 0.0  # the fit is not made again
    assert client.state() == state

    version = client.editor.version
    client.edit("remove", numbers=[0])  # and if no page asks for the verdict
    wait_until(lambda: client.editor.version > version)
    assert client.editor.table.rows[0].verdict


def test_an_edit_that_leaves_no_camera_is_answered_with_all_that_is_known(client):
    labelled(client)
    state = client.edit("clear").json()
    assert (state["judged"], state["camera"], state["curves"]) == (True, None, [])
    assert state["message"]


def test_labels_of_a_network_that_the_camera_does_not_follow_are_said_to_be_left_out(picture, tmp_path):
    editor = Editor(picture, out=tmp_path / "out")
    found = {label: np.array(ends(label)) for label in LINES}
    found["Small rect. left main"] = np.array(ends("Small rect. left main")) + (0.0, 30.0)
    editor[0] = editor[0].with_marks(Marks.of(found, by_hand=False))
    marks = frame_state(editor, 0, editor[0])["marks"]
    assert {mark["label"] for mark in marks if mark["left_out"]} == {"Small rect. left main"}
    assert all(mark["left_out"] == (mark["error"] > 5.0) for mark in marks)
    assert not any(mark["suspect"] for mark in marks)
    editor[0] = editor[0].with_marks(Marks.of(found))  # of a person: in doubt instead
    marks = frame_state(editor, 0, editor[0])["marks"]
    assert {mark["label"] for mark in marks if mark["suspect"]} == {"Small rect. left main"}
    assert not any(mark["left_out"] for mark in marks)
    editor.close()


def test_known_values(client):
    labelled(client)
    client.edit("know", values={"focal_length": 1650.0, "position": [0.0, 68.0, -17.0], "lens": "none"})
    state = client.state()
    assert state["known"]["focal_length"] == 1650.0
    assert state["camera"]["focal_length"] == 1650.0
    assert state["camera"]["position"] == [0.0, 68.0, -17.0]
    assert client.edit("know", values={"focal_length": None}).json()["known"]["focal_length"] is None


def test_pictures_as_the_screen_shows_them(shown):
    small = shown.get("image/0?width=320")
    image = cv2.imdecode(np.frombuffer(small.content, np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (180, 320, 3)
    part = shown.get("image/0/crop?x=100&y=50&w=64&h=40")
    assert cv2.imdecode(np.frombuffer(part.content, np.uint8), cv2.IMREAD_COLOR).shape == (40, 64, 3)
    at_border = shown.get("image/0/crop?x=940&y=-10&w=64&h=40&width=10")
    assert cv2.imdecode(np.frombuffer(at_border.content, np.uint8), cv2.IMREAD_COLOR).shape == (15, 10, 3)
    assert shown.get("image/0/crop?x=2000&y=0&w=10&h=10").status_code == 400


def test_measuring(client):
    labelled(client)
    foot, other = TRUTH.project([(-40.0, 5.0, 0.0), (-40.0, -5.0, 0.0)])
    at = "x={}&y={}".format(*foot)
    ground = client.get(f"api/frame/0/ground?{at}").json()
    assert np.linalg.norm(np.subtract(ground["X"], (-40.0, 5.0))) < 0.3
    assert 0.0 < ground["rms"] < 1.0
    ruler = client.get("api/frame/0/distance?x1={}&y1={}&x2={}&y2={}".format(*foot, *other)).json()
    assert abs(ruler["metres"] - 10.0) < 0.2
    clicks = np.array([foot, other]) + 2.0 * np.random.default_rng(0).standard_normal((500, 2, 2))
    drawn = np.linalg.norm(np.diff(TRUTH.image_to_field(clicks)[..., :2], axis=1)[:, 0], axis=-1).std()
    assert 0.95 * drawn < ruler["sd"] < 1.5 * drawn
    line = client.get(f"api/frame/0/offside?{at}").json()
    assert abs(line["X"] + 40.0) < 0.3
    on_line = TRUTH.image_to_field(line["line"])
    assert np.nanmax(np.abs(on_line[:, 0] + 40.0)) < 0.3
    drawn = client.get(f"api/frame/0/offside.png?{at}")
    assert drawn.headers["content-type"] == "image/png"
    assert "attachment" in drawn.headers["content-disposition"]
    errors = client.get("api/frame/0/errors").json()
    metres, (x, y) = errors["metres"], (np.array(errors[axis])[[14, 20]] for axis in "xy")
    shown = np.array([errors["pixels"][14][14], errors["pixels"][20][20]])
    np.testing.assert_allclose(shown, TRUTH.project(np.column_stack([x, y, 0.0 * x])), atol=4.0)
    assert any(value is not None and value < 0.5 for row in metres for value in row)
    assert client.get("api/frame/0/ground?x=480&y=-4000").json() == {"X": None, "sd": None, "rms": None}
    x, y = np.mean(ends(LINES[0]), axis=0)
    assert client.get(f"api/frame/0/likely?x={x}&y={y}").json()["labels"][0] == LINES[0]


def test_saving(client, tmp_path):
    labelled(client)
    project = client.get("api/project").json()
    assert (project["unsaved"], project["has_results"]) == (1, False)
    assert client.post("api/save", {}).json()["saved"] == 1
    project = client.get("api/project").json()
    assert (project["unsaved"], project["has_results"]) == (0, True)
    out = tmp_path / "out"
    saved = fieldcalib.read(out)["frame"]
    assert saved.camera.focal_length == pytest.approx(client.state()["camera"]["focal_length"], abs=0.01)
    assert set(json.loads((out / "labels" / "frame.json").read_text())) == set(LINES)
    assert (out / "overlay_frame.jpg").exists()


def test_a_file_that_another_program_changed_is_kept(client, tmp_path):
    labelled(client)
    client.post("api/save", {})
    label_file = tmp_path / "out" / "labels" / "frame.json"
    label_file.write_text("{}")
    before = (tmp_path / "out" / "cameras.jsonl").read_bytes()
    client.edit("remove", numbers=[0])
    answer = client.post("api/save", {})
    assert answer.status_code == 409
    assert "changed by another program" in answer.json()["error"]
    assert label_file.read_text() == "{}"
    assert (tmp_path / "out" / "cameras.jsonl").read_bytes() == before
    label_file.unlink()
    assert client.post("api/save", {}).status_code == 200


def test_what_is_replaced_is_kept(client, tmp_path):
    labelled(client)
    client.post("api/save", {})
    before = (tmp_path / "out" / "labels" / "frame.json").read_bytes()
    client.edit("remove", numbers=[0])
    client.post("api/save", {})
    assert (tmp_path / "out" / "history" / "0001" / "labels" / "frame.json").read_bytes() == before


# --- two tabs ---


def test_a_stale_edit_is_refused(client):
    revision = client.state()["revision"]
    edit = {"revision": revision, "do": "mark", "label": "Middle line", "xy": [[400, 300]], "snap": False}
    assert client.post("api/frame/0/edit", edit).status_code == 200
    count = len(client.state()["marks"])
    answer = client.post("api/frame/0/edit", edit)
    assert answer.status_code == 409
    assert answer.json()["state"]["revision"] == revision + 1
    assert len(client.state()["marks"]) == count


# --- who may ask ---


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/wrong-token/api/project", {}, 404),
        ("/", {}, 404),
        (f"/{TOKEN}", {}, 404),
        (f"/{TOKEN}x/api/project", {}, 404),
        (f"/{TOKEN}/api/project", {"Host": "evil.example:8765"}, 403),
        (f"/{TOKEN}/api/project", {"Host": "127.0.0.1:80"}, 403),
        (f"/{TOKEN}/api/project", {"Origin": "http://evil.example"}, 403),
        (f"/{TOKEN}/static/..%2f..%2fapp.py", {}, 404),
        (f"/{TOKEN}/static/%2e%2e/app.py", {}, 404),
        (f"/{TOKEN}/../{TOKEN}/static/app.py", {}, 404),
        (f"/{TOKEN}/static/app.py", {}, 404),
        (f"/{TOKEN}/static/{'a' * 400}.js", {}, 414),
        (f"/{TOKEN}/api/frame/1", {}, 404),
        (f"/{TOKEN}/api/frame/-1", {}, 404),
        (f"/{TOKEN}/api/frame/0x0", {}, 404),
        (f"/{TOKEN}/api/frame/٣", {}, 404),
        (f"/{TOKEN}/image/0?width=abc", {}, 400),
        (f"/{TOKEN}/image/0/crop?x=1e400&y=0&w=1&h=1", {}, 400),
        (f"/{TOKEN}/api/frame/0/ground?x=nan&y=1", {}, 400),
        (f"/{TOKEN}/api/clip/proposed/0", {}, 400),
    ],
)
def test_a_request_that_is_refused(shown, path, headers, status):
    answer = shown.http.get(path, headers=headers)
    assert answer.status_code == status
    assert answer.json()["error"]


ANYWHERE = Hosts(frozenset({"localhost", "0.0.0.0"}), 8765, any_address=True)
HERE = Hosts(frozenset({"localhost", "127.0.0.1", "[::1]"}), 8765)


@pytest.mark.parametrize(
    ("hosts", "host", "origin", "is_answered"),
    [
        (ANYWHERE, "192.168.1.5:8765", "http://192.168.1.5:8765", True),
        (ANYWHERE, "[fd00::5]:8765", "http://[fd00::5]:8765", True),
        (ANYWHERE, "localhost:8765", "http://localhost:8765", True),
        (ANYWHERE, "evil.example:8765", "http://evil.example:8765", False),
        (ANYWHERE, "192.168.1.5.evil.example:8765", "http://192.168.1.5.evil.example:8765", False),
        (ANYWHERE, "192.168.1.5:8765", "http://192.168.1.6:8765", False),
        (ANYWHERE, "192.168.1.5:8765", "http://192.168.1.5:8766", False),
        (ANYWHERE, "192.168.1.5:8765", "http://evil.example:8765", False),
        (ANYWHERE, "192.168.1.5", "http://192.168.1.5", False),
        (ANYWHERE, "fd00::5:8765", "http://fd00::5:8765", False),
        (ANYWHERE, "[192.168.1.5]:8765", "http://[192.168.1.5]:8765", False),
        (ANYWHERE, ":8765", "http://:8765", False),
        (HERE, "[::1]:8765", "http://[::1]:8765", True),
        (HERE, "localhost:8765", "http://127.0.0.1:8765", False),
        (HERE, "192.168.1.5:8765", "http://192.168.1.5:8765", False),
        (Hosts(frozenset({"127.0.0.1"}), 80), "127.0.0.1", "http://127.0.0.1", True),
    ],
)
def test_the_hosts_of_a_page(shown, hosts, host, origin, is_answered):
    """Names can be given to any address by whoever owns them; an address in numbers cannot."""
    http = TestClient(shown.page.application(TOKEN, hosts), base_url=BASE)
    for answer in (
        http.get(f"/{TOKEN}/api/project", headers={"Host": host, "Origin": origin}),
        http.post(f"/{TOKEN}/api/clip/cancel", json={}, headers={"Host": host, "Origin": origin}),
    ):
        assert answer.status_code == (200 if is_answered else 403)
    assert http.post(f"/{TOKEN}/api/clip/cancel", json={}, headers={"Host": host}).status_code == 403


@pytest.mark.parametrize(
    ("headers", "content", "status"),
    [
        ({}, b"{}", 403),
        ({"Origin": "null"}, b"{}", 403),
        ({"Origin": "http://evil.example"}, b"{}", 403),
        ({"Origin": f"https://{HOST}"}, b"{}", 403),
        ({**ORIGIN, "Content-Type": "text/plain"}, b"{}", 415),
        ({**ORIGIN, "Content-Type": "image/png"}, b"{}", 415),  # only where a picture is calibrated
        ({**ORIGIN, "Content-Type": "application/jsonp"}, b"{}", 415),
        ({**ORIGIN, "Content-Type": "application/json"}, b"no json", 400),
        ({**ORIGIN, "Content-Type": "application/json"}, b"[1]", 400),
        ({**ORIGIN, "Content-Type": "application/json"}, b"[" * 100_000, 400),
        ({**ORIGIN, "Content-Type": "application/json"}, b"x" * 1_000_001, 413),
        ({**ORIGIN, "Content-Type": "application/json"}, iter([b"x" * 600_000] * 2), 413),
    ],
)
def test_a_body_that_is_refused(shown, headers, content, status):
    answer = shown.http.post(f"/{TOKEN}/api/frame/0/edit", content=content, headers=headers)
    assert answer.status_code == status
    assert answer.json()["error"]


def test_a_picture_may_be_larger_than_other_bodies(shown):
    noise = np.random.default_rng(0).integers(0, 255, (540, 960, 3), dtype=np.uint8)
    content = cv2.imencode(".png", noise)[1].tobytes()
    assert len(content) > 1_000_000
    for kind in ("image/png", "application/json"):
        answer = shown.http.post(
            f"/{TOKEN}/api/v1/calibrate", content=content, headers={**ORIGIN, "Content-Type": kind}
        )
        assert (answer.status_code, answer.json()["verdict"]) == (200, "reject")
    too_large = {**ORIGIN, "Content-Type": "image/png", "Content-Length": "64000001"}
    answer = shown.http.post(f"/{TOKEN}/api/v1/calibrate", content=b"", headers=too_large)
    assert (answer.status_code, answer.json()["error"]) == (413, "expected a body of at most 64000000 bytes")


def test_other_methods(shown):
    for method in ("PUT", "DELETE", "PATCH", "OPTIONS"):
        assert shown.http.request(method, f"/{TOKEN}/api/project").status_code == 405


def test_headers_of_every_answer(shown):
    for path in ("api/project", "api/frame/9", "image/0", ""):
        headers = shown.get(path).headers
        assert "default-src 'none'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "access-control-allow-origin" not in headers
    assert shown.get("api/project").headers["cache-control"] == "no-store"


def test_a_label_is_never_markup(client):
    """A label that the field does not have is refused, and what is said about it is JSON."""
    answer = client.edit("mark", label="<script>alert(1)</script>", xy=[[1, 2]])
    assert answer.status_code == 400
    assert answer.headers["content-type"] == "application/json"
    assert "unknown label" in answer.json()["error"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_names_that_are_not_utf8(picture, tmp_path):
    """Two of them that differ in such a byte alone: they are shown, edited and saved, and stay two."""
    names = ["00005", "T\udcfcrkei", "T\udcfdrkei"]
    for name in names:
        shutil.copy(picture, tmp_path / f"{name}.png")
    out = tmp_path / "out\udcff"
    one = Client(tmp_path, out)
    assert one.get("api/frames").json()["id"] == names
    assert one.get("api/project").json()["folder"] == str(out)
    for number in (1, 2):
        assert one.state(number)["id"] == names[number]
        assert one.edit("clear", number=number).status_code == 200
        for label in LINES[: number + 1]:
            answer = one.edit("mark", number=number, label=label, xy=ends(label))
            assert (answer.status_code, answer.json()["id"]) == (200, names[number])
    assert one.post("api/save", {}).json()["saved"] == 3
    for format in ("soccernet", "labelme", "cvat", "coco", "labelstudio"):
        written = one.post("api/save_labels", {"format": format})
        assert written.status_code == 200, written.text
        shutil.copytree(out, tmp_path / format)
        path = tmp_path / format / written.json()["file"]
        with Editor(tmp_path, out=tmp_path / "again" / format, labels=path) as read:
            assert [len(read[number].marks.pixels) for number in (1, 2)] == [2, 3]
        shutil.rmtree(tmp_path / format)
    one.close()
    assert sorted(line["id"] for line in map(json.loads, (out / "cameras.jsonl").read_text().splitlines())) == names
    with Editor(tmp_path, out=out) as again:
        assert [len(again[number].marks.pixels) for number in (1, 2)] == [2, 3]


def test_a_field_with_markup_as_a_label(picture, tmp_path):
    name = "<script>alert(1)</script>"
    field = fieldcalib.Field(20.0, 10.0, {name: fieldcalib.Line((0, -5, 0), (0, 5, 0))})
    one = Client([np.zeros((54, 96, 3), np.uint8)], tmp_path / "out", field)
    answer = one.edit("mark", label=name, xy=[[1, 2]], snap=False)
    assert answer.json()["marks"][0]["label"] == name
    assert answer.headers["content-type"] == "application/json"
    one.close()


TEXTS = st.text(max_size=12) | st.sampled_from(
    ["..", "../../etc/passwd", "%00", "mark", "undo", "<script>", "__class__"]
)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | TEXTS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=8,
)
EDITS = st.fixed_dictionaries(
    {},
    optional={
        "revision": VALUES,
        "do": VALUES | st.sampled_from(["mark", "move", "relabel", "remove", "know", "copy"]),
        "label": VALUES,
        "xy": VALUES,
        "to": VALUES,
        "numbers": VALUES,
        "values": VALUES,
        "snap": VALUES,
        "from": VALUES,
    },
)
PLACES = st.sampled_from(
    ["api/frame/{}", "api/frame/{}/likely", "image/{}", "image/{}/crop", "static/{}", "api/{}", "{}", "api/frame/0/{}"]
)
THERE = ("", "0", "project", "frames")
SYSTEM = ("/proc/",)  # what libraries read about the machine
opened: list[str] | None = None


def _note(event, arguments):
    """Note the files that the server opens, which answers in another thread than the test's."""
    if event == "open" and opened is not None and threading.current_thread() is not threading.main_thread():
        opened.append(str(arguments[0]))


sys.addaudithook(_note)


def odd_requests(client, data):
    """A request that asks for nothing that there is; returns the answer."""
    if data.draw(st.booleans()):
        place = data.draw(PLACES).format(data.draw(TEXTS.filter(lambda text: text not in THERE)))
        path = "".join(c if c.isprintable() else "%01" for c in place).replace("?", "%3f").replace("#", "%23")
        query = {name: str(data.draw(VALUES)) for name in data.draw(st.sets(st.sampled_from("xywh")))}
        return client.http.get(f"/{TOKEN}/{path}", params=query)
    body = json.dumps(data.draw(EDITS)).encode("utf-8", errors="surrogatepass")
    headers = {**ORIGIN, "Content-Type": "application/json"}
    path = data.draw(st.sampled_from(["api/frame/0/edit", "api/frame/7/edit", "api/clip/cuts", "api/frame/x/edit"]))
    return client.http.post(f"/{TOKEN}/{path}", content=body, headers=headers)


def check_odd_requests(shown, data):
    global opened
    state = shown.editor.revision(0)
    files = sorted(Path(shown.editor.stored.folder.parent).rglob("*"))
    opened = []
    try:
        answer = odd_requests(shown, data)
    finally:
        seen, opened = opened, None
    assert 400 <= answer.status_code < 500, (answer.status_code, answer.text)
    assert "Traceback" not in answer.text
    assert answer.json()["error"]
    assert shown.editor.revision(0) == state
    assert sorted(Path(shown.editor.stored.folder.parent).rglob("*")) == files
    read = (str(Path(fieldcalib.__file__).parent), sys.prefix, sys.base_prefix, *SYSTEM)
    assert not [path for path in seen if not path.startswith(read)]


@given(st.data())
def test_odd_requests(shown, data):
    check_odd_requests(shown, data)


@pytest.mark.slow
@settings(max_examples=500)
@given(st.data())
def test_five_hundred_odd_requests(shown, data):
    check_odd_requests(shown, data)


# --- pictures of all kinds ---


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((960, 540, 3), np.uint8),
        np.full((270, 480), 90, np.uint8),
        np.full((270, 480, 3), 20000, np.uint16),
    ],
    ids=["portrait", "grey", "16 bit"],
)
def test_unusual_pictures(image, tmp_path):
    check_picture(image, tmp_path / "one.png")


@pytest.mark.slow
def test_a_huge_picture(tmp_path):
    check_picture(np.zeros((6000, 8000, 3), np.uint8), tmp_path / "one.jpg")


def check_picture(image, path):
    cv2.imwrite(str(path), image)
    one = Client(path, path.parent / "out")
    state = one.state()
    assert (state["height"], state["width"]) == image.shape[:2]
    assert state["verdict"] != "good"
    shown = one.get("image/0?width=100")
    assert shown.headers["content-type"] == "image/jpeg"
    width = min(100, image.shape[1])
    assert cv2.imdecode(np.frombuffer(shown.content, np.uint8), cv2.IMREAD_COLOR).shape[1] == width
    assert one.edit("mark", label="Middle line", xy=[[1, 1]]).status_code == 200
    one.close()


def test_a_broken_picture(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((54, 96, 3), np.uint8))
    (tmp_path / "b.png").write_bytes(b"no picture")
    one = Client(tmp_path, tmp_path / "out")
    state = one.state(1)
    assert "no image" in state["problem"]
    assert one.get("api/frames").json()["reason"][1] == state["problem"]  # in the list too
    assert one.get("image/1").status_code == 422
    assert one.edit("mark", number=1, label="Middle line", xy=[[1, 1]]).status_code == 422
    assert one.state(0)["problem"] is None
    one.close()


def test_a_video_that_is_cut_off(tmp_path, capfd):
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (160, 90))
    rng = np.random.default_rng(0)
    for _ in range(30):
        writer.write(rng.integers(0, 255, (90, 160, 3), dtype=np.uint8))
    writer.release()
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 10])
    one = Client(path, tmp_path / "out")
    project = one.get("api/project").json()
    assert (project["kind"], project["rate"]) == ("clip", 25.0)
    assert 5 < project["count"] < 15
    assert one.state(0)["problem"] is None
    assert one.get("image/3").status_code == 200
    one.close()
    frames = VideoFrames(path, numbers=range(30))  # as results of the whole video name them
    assert frames.image(3).shape == (90, 160, 3)
    with pytest.raises(BrokenFileError, match="cut off"):
        frames.image(25)
    frames.close()


def test_a_thousand_frames(tmp_path):
    one = Client([np.zeros((54, 96, 3), np.uint8)] * 1000, tmp_path / "out", "tennis")
    frames = one.get("api/frames").json()
    assert all(len(frames[name]) == 1000 for name in frames if name != "version")
    assert one.state(999)["number"] == 999
    one.close()


def test_every_file_of_the_page_is_sent(shown):
    assert "index.html" in page_files()
    for name, content in page_files().items():
        assert shown.get(f"static/{name}").content == content


# --- fields that no network knows ---


@pytest.mark.slow
def test_courts_are_searched_for_beside_the_page(tmp_path):
    """The page is answered at once, and sees when a camera was found."""
    camera = Camera.from_angles(1.5, 1.3, 0.0, 1400.0, (-32.0, 1.0, -9.0), SIZE)
    one = Client([render_field(camera, tennis())] * 3, tmp_path / "out", "tennis")
    version = one.get("api/project").json()["version"]
    state = wait_until(lambda: (state := one.state(1))["camera"] and state)
    assert (state["revision"], state["automatic"], state["verdict"], state["marks"]) == (0, True, "good", [])
    assert state["camera"]["focal_length"] == pytest.approx(1400.0, rel=0.01)
    wait_until(lambda: one.get("api/frames").json()["verdict"] == ["good"] * 3)
    assert one.get("api/project").json()["version"] > version
    one.close()


# --- clips ---


def video(path, images):
    height, width = images[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (width, height))
    for image in images:
        writer.write(image)
    writer.release()
    return path


def solved(client):
    assert client.post("api/clip/solve", {}).status_code == 200
    job = wait_until(lambda: (job := client.get("api/clip/job").json())["state"] != "running" and job)
    assert job["state"] == "ready", job
    return job


def test_a_clip_is_solved_in_the_background(tmp_path):
    """Of frames that show nothing: what is asked and answered."""
    one = Client(
        video(tmp_path / "clip.avi", [np.full((90, 160, 3), k, np.uint8) for k in range(30)]), tmp_path / "out"
    )
    assert one.get("api/clip/job").json()["state"] == "none"
    assert one.post("api/clip/keep", {}).status_code == 400
    changes = solved(one)["changes"]
    assert changes["frames"] == list(range(30))
    assert changes["pixels"] == [None] * 30
    assert changes["good"] == [0, 0]
    assert changes["contradicted"] == {}
    assert one.get("api/clip/proposed/7").json()["camera"] is None
    assert one.post("api/clip/discard", {}).json()["state"] == "none"
    assert one.get("api/clip/proposed/7").status_code == 400
    assert one.post("api/clip/cuts", {"cuts": [10, 20]}).json()["cuts"] == [0, 10, 20]
    assert one.post("api/clip/cuts", {"cuts": [30]}).status_code == 400
    solved(one)
    assert one.post("api/clip/draw", {}).status_code == 400  # first the solution is kept or discarded
    assert one.post("api/clip/keep", {}).json()["saved"] == 30
    assert one.get("api/clip/job").json()["can_undo_keep"]
    assert one.post("api/clip/undo_keep", {}).json()["state"] == "ready"
    assert not (tmp_path / "out" / "cameras.jsonl").exists()
    assert one.post("api/clip/undo_keep", {}).status_code == 400
    assert one.post("api/clip/keep", {}).json()["saved"] == 30
    assert one.get("api/clip/next").json()["number"] == 14
    assert one.get("api/clip/job").json()["to_draw"] == []
    assert one.post("api/clip/draw", {}).status_code == 200
    assert wait_until(lambda: one.get("api/clip/job").json()["state"] == "none")
    one.close()
    assert len((tmp_path / "out" / "cameras.jsonl").read_text().splitlines()) == 30
    shots = json.loads((tmp_path / "out" / "tripods.json").read_text())["shots"]
    assert [shot["first_frame"] for shot in shots] == [0, 10, 20]
    again = Client(tmp_path / "out", None)
    assert again.get("api/project").json()["cuts"] == [0, 10, 20]
    again.close()


def test_a_clip_is_solved_once_at_a_time(tmp_path, monkeypatch):
    """Of solutions that are cancelled one after the other, each of which notices it late."""
    solving, most, go_on = [], [], threading.Event()

    def solve(editor, progress):
        solving.append(1)
        most.append(len(solving))
        go_on.wait(30.0)
        solving.pop()
        progress(1, 1, "solving")

    monkeypatch.setattr(Editor, "solve", solve)
    one = Client(video(tmp_path / "clip.avi", [np.zeros((90, 160, 3), np.uint8)] * 3), tmp_path / "out")
    for _ in range(8):
        assert one.post("api/clip/solve", {}).json()["state"] == "running"
        assert one.post("api/clip/cancel", {}).json()["state"] == "none"
    assert one.post("api/clip/solve", {}).status_code == 200
    assert one.post("api/clip/solve", {}).status_code == 400
    assert sum(thread.name == "clip" for thread in threading.enumerate()) == 1
    go_on.set()
    wait_until(lambda: one.get("api/clip/job").json()["state"] == "none")
    assert most == [1, 1]  # the first, and the last
    wait_until(lambda: all(thread.name != "clip" for thread in threading.enumerate()))
    one.close()


def test_a_page_that_ends_waits_for_what_is_being_saved(client, monkeypatch):
    labelled(client)
    begun, save, kept = threading.Event(), Stored.save, []

    def slowly(*arguments, **more):
        begun.set()
        time.sleep(0.5)
        kept.append(save(*arguments, **more))
        return kept[-1]

    monkeypatch.setattr(Stored, "save", slowly)
    saving = threading.Thread(target=client.editor.save)
    saving.start()
    assert begun.wait(30.0)
    client.page.close()
    assert kept
    saving.join()
    assert client.editor.unsaved == 0


@pytest.mark.slow
def test_a_mended_frame_holds_in_its_clip(tmp_path):
    """A pan; the labels of one frame by hand, and the frames around it follow."""
    size, count = (640, 360), 30
    cameras = [Camera.from_angles(-0.3 + 0.003 * k, 1.35, 0.0, 1066.0, (0.0, 68.0, -17.0), size) for k in range(count)]
    pitch = soccer(line_width=0.12)  # as clips take it
    images = [render_field(camera, pitch, rng=np.random.default_rng(0)) for camera in cameras]
    one = Client(video(tmp_path / "clip.avi", images), tmp_path / "out")
    one.edit("clear", number=14)
    for label in LINES:
        xy = cameras[14].project(pitch[label].sample(1.0))
        xy = xy[((xy > 5.0) & (xy < np.subtract(size, 5.0))).all(axis=1)][[0, -1]]
        assert one.edit("mark", number=14, label=label, xy=xy.tolist()).status_code == 200
    solved(one)
    assert one.post("api/clip/keep", {}).json()["saved"] == count
    frames = one.get("api/frames").json()
    assert frames["basis"][14] == "labelled by hand"
    assert frames["by_hand"] == [k == 14 for k in range(count)]
    one.close()
    found = fieldcalib.read(tmp_path / "out")
    assert max(largest_move(camera, found[f"{k:06d}"].camera) for k, camera in enumerate(cameras)) < 3.0


# --- many edits, valid and not ---

ODD_VALUES = (
    None,
    0,
    -5,
    1e9,
    "a",
    "",
    [],
    {},
    [1, 2],
    [1, 2, 3],
    [105, 680],
    [105, 68],
    [30, 20],
    [None] * 3,
    True,
    1e308,
)
KNOWN_NAMES = ("focal_length", "position", "principal_point", "lens", "field_size", "aspect", "nonsense")


def random_edit(rng):
    """An edit as a page or somebody else may send it."""
    pixels = [[float(x), float(y)] for x, y in rng.uniform(-50.0, 1000.0, (rng.integers(0, 3), 2))]
    odd = ODD_VALUES[rng.integers(len(ODD_VALUES))]
    label = str(rng.choice([*LINES, "Circle central", "Net top", "x" * 300, ""]))
    numbers = rng.integers(-1, 6, rng.integers(0, 3)).tolist()
    edits = (
        {"do": "mark", "label": label, "xy": pixels},
        {"do": "mark", "label": LINES[0], "xy": ends(LINES[0]), "snap": False},
        {"do": "mark", "label": LINES[1], "xy": odd},
        {"do": "move", "to": {str(number): [480.0, 100.0] for number in numbers}},
        {"do": "relabel", "numbers": numbers, "label": label},
        {"do": "remove", "numbers": numbers if numbers else odd},
        {"do": "know", "values": {str(rng.choice(KNOWN_NAMES)): odd}},
        {"do": "know", "values": {"field_size": rng.uniform(1.0, 300.0, 2).tolist()}},
        {"do": "know", "values": {"focal_length": float(np.exp(rng.uniform(-3.0, 16.0)))}},
        {"do": "know", "values": {"position": rng.normal(0.0, 60.0, 3).tolist()}},
        *({"do": name} for name in ("undo", "redo", "clear", "automatic", str(odd))),
    )
    return edits[rng.integers(len(edits))]


def check_random_edits(folder, picture, count, rng):
    """No frame is locked and no answer is an error of the server, and what was answered is there after reopening."""
    pictures = folder / "pictures"
    pictures.mkdir()
    for name in "ab":
        shutil.copy(picture, pictures / f"{name}.png")
    client = Client(pictures, folder / "out")
    for k in range(count):
        number = int(rng.integers(2))
        answer = client.edit(number=number, **random_edit(rng))
        assert answer.status_code in (200, 400), answer.text
        if k % 20 == 19:
            assert client.post("api/save", {}).status_code == 200
    before = [client.state(number) for number in (0, 1)]
    client.close()
    client = Client(pictures, folder / "out")
    for number, state in enumerate(before):
        assert [client.state(number)[name] for name in ("marks", "known")] == [
            state[name] for name in ("marks", "known")
        ]
    client.close()


def test_random_edits(tmp_path, picture):
    check_random_edits(tmp_path, picture, 20, np.random.default_rng(0))


@pytest.mark.slow
def test_two_thousand_random_edits(tmp_path, picture):
    check_random_edits(tmp_path, picture, 2000, np.random.default_rng(1))


# --- the process that serves it ---


@pytest.fixture
def served(picture, tmp_path):
    """Starts the command; gives the process, and host, port and token of the address that it prints."""
    runs = []

    def start(*arguments):
        runs.append(started("open", picture, "--out", tmp_path / "out", "--no-browser", *arguments))
        assert runs[0].stdout.readline() == "begun\n"
        host, _, rest = runs[0].stdout.readline().removeprefix("http://").rpartition(":")
        port, token, _ = rest.split("/")
        return runs[0], host, int(port), token

    yield start
    for run in runs:
        run.kill()
        run.communicate()


def asked(there, host, port, token, length=2, body=b"{}"):
    """A connection that has sent a request to drop the solution of the clip."""
    head = (
        f"POST /{token}/api/clip/cancel HTTP/1.1\r\nHost: {host}:{port}\r\nOrigin: http://{host}:{port}\r\n"
        f"Content-Type: application/json\r\nContent-Length: {length}\r\n\r\n"
    )
    connection = socket.create_connection((there, port), timeout=30.0)
    connection.sendall(head.encode() + body)
    return connection


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 143), pytest.param(signal.SIGINT, 0, marks=pytest.mark.slow)]
)
def test_the_page_ends_whatever_its_clients_do(served, number, code):
    """A request without its body, one whose client is gone, half a header, and pictures that nobody reads."""
    run, host, port, token = served()
    asked(host, host, port, token, length=100, body=b"{").close()
    waiting = [asked(host, host, port, token, length=100, body=b"{"), socket.create_connection((host, port))]
    waiting[1].sendall(b"POST / HT")
    for _ in range(4):
        deaf = socket.socket()
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        deaf.connect((host, port))
        for _ in range(50):
            deaf.sendall(f"GET /{token}/image/0 HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
        waiting.append(deaf)
    answered = asked(host, host, port, token)
    assert b"200 OK" in answered.recv(1000)
    run.send_signal(number)
    until = time.monotonic() + 20.0  # two seconds where nothing else runs
    assert ended(run) == (code, "fieldcalib: terminated, nothing more is written\n" if code else "")
    assert time.monotonic() < until
    for one in (*waiting, answered):
        one.close()


@pytest.mark.parametrize(
    "host", ["0.0.0.0", "::1", *(pytest.param(host, marks=pytest.mark.slow) for host in ("::", "localhost"))]
)
def test_where_the_page_listens(served, host):
    if ":" in host and not has_ipv6():
        pytest.skip("this machine has no IPv6")
    _, shown, port, token = served("--host", host)
    there = shown.strip("[]")
    assert there not in ("0.0.0.0", "::")
    for name, status in ((shown, b"200 OK"), ("evil.example", b"403 Forbidden")):
        with asked(there, name, port, token) as connection:
            assert status in connection.recv(1000)


def has_ipv6():
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        return False
    return True


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("--port", "70000"), "expected a port from 0 to 65535, got 70000"),
        (("--host", "a..b"), "expected an address or a name of this machine as the host, got 'a..b'"),
    ],
)
def test_places_where_no_page_can_listen(picture, tmp_path, capsys, arguments, problem):
    assert main(["open", str(picture), "--out", str(tmp_path / "out"), "--no-browser", *arguments]) == 2
    assert problem in capsys.readouterr().err
