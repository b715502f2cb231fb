"""The page in another application: `fieldcalib.web.app`."""

import json

import cv2
import numpy as np
import pytest
from schemas import DOCS, problems
from starlette.applications import Starlette
from starlette.testclient import TestClient

import fieldcalib.web
from fieldcalib import Camera, soccer
from fieldcalib.draw.scene import render_field

SCHEMA = json.loads((DOCS / "schemas/api/camera.schema.json").read_text())
TRUTH = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (960, 540))
X = np.array([(-40.0, -5.0, 0.0), (-20.0, 5.0, 0.0)])


@pytest.fixture(scope="module")
def picture():
    return cv2.imencode(".png", render_field(TRUTH, soccer(), rng=np.random.default_rng(0)))[1].tobytes()


@pytest.fixture
def client(picture, tmp_path):
    (tmp_path / "a.png").write_bytes(picture)
    page = fieldcalib.web.app(tmp_path / "a.png", out=tmp_path / "out")
    site = Starlette()
    site.mount("/calibration", page)
    yield TestClient(site)
    page.state.page.close()


def test_the_page_lies_under_an_address_of_the_other_application(client, tmp_path):
    assert "fieldcalib" in client.get("/calibration/").text
    assert client.get("/calibration/static/app.js").status_code == 200
    state = client.get("/calibration/api/frame/0").json()
    assert problems(state, SCHEMA) == []
    assert state["verdict"] == "good"
    body = {"revision": 0, "do": "mark", "label": "Side line top", "xy": [[480.0, 90.0]]}
    assert client.post("/calibration/api/frame/0/edit", json=body).status_code == 200
    stale = client.post("/calibration/api/frame/0/edit", json=body)
    assert (stale.status_code, stale.json()["code"]) == (409, "StaleEdit")
    assert client.post("/calibration/api/save", json={}).json()["saved"] == 1
    assert list(fieldcalib.read(tmp_path / "out")) == ["a"]


def test_a_picture_that_is_sent_is_calibrated(client, picture):
    points = ";".join(f"{x:.3f},{y:.3f}" for x, y in TRUTH.project(X))
    found = client.post("/calibration/api/v1/calibrate", params={"points": points}, content=picture).json()
    assert problems(found, SCHEMA) == []
    assert found["verdict"] == "good"
    np.testing.assert_allclose(found["metres"]["X"], X, atol=0.3)
    assert np.all(np.array(found["metres"]["sd"]) < 0.5)
    assert np.linalg.norm(np.subtract(found["camera"]["position"], TRUTH.C)) < 2.0


def test_what_is_sent_wrong_has_a_code(client, picture):
    broken = client.post("/calibration/api/v1/calibrate", content=b"no picture")
    assert (broken.status_code, broken.json()["code"]) == (422, "BrokenFileError")
    odd = client.post("/calibration/api/v1/calibrate", params={"points": "a,b"}, content=picture)
    assert (odd.status_code, odd.json()["code"]) == (400, "ValueError")
    none = client.get("/calibration/api/frame/7")
    assert (none.status_code, none.json()["code"]) == (404, "NoSuchFrame")
    nothing = cv2.imencode(".png", np.zeros((540, 960, 3), np.uint8))[1].tobytes()
    found = client.post("/calibration/api/v1/calibrate", params={"points": "1,2"}, content=nothing).json()
    assert problems(found, SCHEMA) == []
    assert (found["verdict"], found["camera"], found["metres"]) == ("reject", None, None)
