"""Pictures of all kinds, and many frames: the list, keys, sizes, files that are broken."""

import cv2
import numpy as np
import pytest

from browser.driving import TRUTH, along, render
from fieldcalib.geometry.camera import Camera


def write(path, image):
    cv2.imwrite(str(path), image)
    return path


@pytest.fixture(scope="module")
def thousand(tmp_path_factory):
    """A folder of a thousand small pictures."""
    folder = tmp_path_factory.mktemp("thousand")
    content = cv2.imencode(".jpg", cv2.resize(render(), (320, 180)))[1].tobytes()
    for number in range(1000):
        (folder / f"frame-{number:04d}.jpg").write_bytes(content)
    return folder


def test_a_list_of_a_thousand_frames_has_the_rows_in_view_only(serve, window, thousand):
    one = window(serve(thousand))
    assert one.text("#frame-name") == "frame-0000 · 1 of 1,000"
    rows = one.page.locator(".frame-row")
    assert 10 < rows.count() < 60

    one.press("End")
    one.wait_for_frame(999)
    assert rows.last.inner_text().startswith("frame-0999")
    assert 10 < rows.count() < 60
    assert one.page.locator(".frame-row[aria-selected=true] .frame-name").inner_text() == "frame-0999"

    one.press("ArrowLeft", "ArrowLeft", "ArrowLeft")
    one.wait_for_frame(996)
    one.press("PageUp")
    one.wait_for_frame(986)
    one.press("Home")
    one.wait_for_frame(0)
    one.page.locator(".frame-row").nth(3).click()
    one.wait_for_frame(3)
    assert one.page.evaluate("location.hash") == "#3"
    one.page.reload()
    one.wait_for_frame(3)


def test_the_worst_frames_come_first_on_request_and_verdicts_are_hidden(serve, window, tmp_path):
    good, poor = render(), np.full((1080, 1920, 3), (60, 140, 60), np.uint8)
    for name, image in {"a": good, "b": poor, "c": good}.items():
        write(tmp_path / f"{name}.jpg", image)
    one = window(serve(tmp_path, out=tmp_path / "results"))
    one.press("ArrowRight")
    one.wait_for_frame(1)
    one.press("ArrowRight")
    one.wait_for_frame(2)
    names = one.page.locator(".frame-name")
    one.wait("() => document.querySelectorAll('.frame-row .verdict-good').length === 2")
    assert names.all_inner_texts() == ["a", "b", "c"]

    one.press("Shift+W")
    assert names.first.inner_text() == "b"
    one.page.locator(".frame-count", has=one.page.locator(".verdict-good")).click()
    assert names.all_inner_texts() == ["b"]


SHAPES = {
    "8000 x 6000": lambda image: cv2.resize(image, (8000, 6000), interpolation=cv2.INTER_LINEAR),
    "portrait": lambda image: np.ascontiguousarray(image[:, 400:1007]),
    "grey": lambda image: cv2.cvtColor(image, cv2.COLOR_BGR2GRAY),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_pictures_of_all_shapes_are_shown_and_labelled(serve, window, tmp_path, shape):
    image = SHAPES[shape](render())
    one = window(serve(write(tmp_path / "picture.png", image)))
    state = one.state()
    assert (state["width"], state["height"]) == image.shape[1::-1]

    one.clear()
    one.choose("Middle line")
    middle = np.multiply(image.shape[1::-1], (0.7, 0.8))
    one.click(middle)
    one.wait_for_revision(2)
    one.press("9")  # 100 %
    assert one.text(".zoom-words") == "100 %"
    one.wait("() => document.querySelector('.picture-pixels').dataset.crops !== undefined")
    one.page.keyboard.down("Alt")
    centre = np.divide(image.shape[1::-1], 2.0) + (30.0, 40.0)
    one.click(centre)
    one.page.keyboard.up("Alt")
    one.wait_for_revision(3)

    marks = [(mark["x"], mark["y"]) for mark in one.state()["marks"]]
    unit = max(image.shape) / 960  # clicks snap over some pixels of a small picture
    assert np.linalg.norm(marks[0] - middle) < 10.0 * unit
    assert np.linalg.norm(marks[1] - centre) < 1.0


def test_a_large_picture_is_fetched_in_crops_at_full_resolution(serve, window, tmp_path):
    image = cv2.resize(render(), (8000, 4500))
    one = window(serve(write(tmp_path / "large.png", image)))
    whole = [address for address in one.requests if "/image/0?" in address]
    assert whole
    assert all(int(address.split("width=")[1]) < 2000 for address in whole)

    one.press("9")
    one.wait("() => Number(document.querySelector('.picture-pixels').dataset.crops) > 0")
    crops = [address for address in one.requests if "/crop?" in address]
    assert len(crops) == 1
    query = dict(part.split("=") for part in crops[0].split("?")[1].split("&"))
    assert int(query["w"]) < 2500
    assert int(query["width"]) == int(query["w"])


def test_a_picture_that_is_cut_off_says_so(serve, window, tmp_path):
    content = cv2.imencode(".jpg", render())[1].tobytes()
    (tmp_path / "a.jpg").write_bytes(content)
    (tmp_path / "b.jpg").write_bytes(content[:200])
    one = window(serve(tmp_path, out=tmp_path / "results"))
    one.press("ArrowRight")
    one.page.get_by_text("No picture here.").wait_for()
    assert "b" in one.text("#frame-name")
    assert one.text("#stage-empty p")
    one.press("ArrowLeft")
    one.wait_for_frame(0)
    assert not one.page.locator("#stage-empty").is_visible()


def test_a_video_that_is_cut_off_shows_the_frames_that_are_there(serve, window, tmp_path):
    whole = tmp_path / "whole.avi"
    writer = cv2.VideoWriter(str(whole), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (640, 360))
    for number in range(30):
        camera = Camera.from_angles(*np.radians([-17.0 + 0.1 * number, 77, 0]), 870.0, (0, 66, -16), (640, 360))
        writer.write(
            cv2.resize(render(), (640, 360)) if number % 2 else np.full((360, 640, 3), int(camera.C[1]), np.uint8)
        )
    writer.release()
    part = tmp_path / "part.avi"
    part.write_bytes(whole.read_bytes()[: whole.stat().st_size * 6 // 10])

    one = window(serve(part))
    assert one.page.locator("#timeline canvas").is_visible()
    one.press("End")
    last = one.get("api/project")["count"] - 1
    one.wait(
        "last => document.querySelector('.picture-lines').dataset.frame === String(last) "
        "|| !document.querySelector('#stage-empty').hidden",
        last,
    )
    one.press("Home")
    one.wait_for_frame(0)
    assert not one.page.locator("#stage-empty").is_visible()


def test_metres_are_measured(serve, window, picture):
    """A foot, a distance and an offside line, at places whose metres are known."""
    one = window(serve(picture))
    one.label_by_clicks()
    foot, other = (TRUTH.project(np.array([x, y, 0.0])) for x, y in ((-20.0, 5.0), (-12.0, 11.0)))

    one.press("2")
    one.click(foot)
    one.page.locator(".measure-row", has_text="Foot").get_by_text("±").wait_for()
    x, y = one.text(".measure-value").split(" m")[0].replace("−", "-").split(", ")
    assert (float(x), float(y)) == pytest.approx((-20.0, 5.0), abs=0.3)

    one.press("3")
    one.drag(foot, other)
    distance = one.page.locator(".measure-row", has_text="Distance").locator(".measure-value")
    distance.get_by_text("±").wait_for()
    assert float(distance.inner_text().split(" m")[0]) == pytest.approx(10.0, abs=0.3)

    one.press("4")
    one.click(foot)
    line = one.page.locator(".measure-row", has_text="Offside")
    line.get_by_text("from the goal line").wait_for()
    with one.page.expect_download() as download:
        line.get_by_text("Save picture").click()
    image = cv2.imread(str(download.value.path()))
    assert image.shape == (1080, 1920, 3)


def drawn_share(one):
    """Share of the picture that has something drawn over it."""
    return one.canvas.evaluate(
        "canvas => { const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height); "
        "return data.filter((value, k) => k % 4 === 3 && value > 0).length / (data.length / 4) }"
    )


def test_the_error_map_is_shown_over_the_field(serve, window, picture):
    one = window(serve(picture))
    one.label_by_clicks()
    plain = drawn_share(one)
    one.press("Shift+E")
    one.page.locator(".heat-scale").wait_for()
    assert drawn_share(one) > plain + 0.2
    low, high = (float(part.split(" m")[0]) for part in one.text(".heat-scale").split("m\n"))
    assert 0.0 < low < high
    assert one.page.locator(".map-heat rect").count() > 50
    one.press("Shift+E")
    one.page.get_by_role("combobox", name="Sport").wait_for()
    assert one.page.locator(".map-heat rect").count() == 0
    assert drawn_share(one) == plain


def test_marks_beside_the_picture_are_not_set(serve, window, picture):
    one = window(serve(picture))
    one.clear()
    one.choose("Side line top")
    box = one.canvas.bounding_box()
    one.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 40)
    one.click(along("Side line top")[0])
    one.wait_for_revision(2)
    assert len(one.state()["marks"]) == 1
