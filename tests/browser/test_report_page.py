"""The report of a run, opened from its file."""

import contextlib
import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

import fieldcalib
from fieldcalib import Camera
from fieldcalib.cli.main import main
from fieldcalib.draw.scene import render_field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.image_files import write_image
from fieldcalib.io.videos import VideoWriter
from fieldcalib.web.report import write_report

SIZE = (1280, 720)
# a picture, or that there is none
SHOWN = """() => document.querySelector(".picture-lines").dataset.frame !== undefined
  || !document.querySelector(".report-none").hidden"""
GREY = np.full((720, 1280, 3), 90, np.uint8)


def seen(pan, f=1450.0):
    camera = Camera.from_angles(np.radians(pan), np.radians(77.0), 0.0, f, (1.5, 66.0, -16.0), SIZE)
    return render_field(camera, soccer(), rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def pictures_report(tmp_path_factory):
    """The report of six pictures: two without a field, and a file that is no picture."""
    folder = tmp_path_factory.mktemp("pictures")
    for name, picture in {
        "left": seen(-22.0),
        "right": seen(24.0),
        "middle": seen(1.0),
        "wide": seen(8.0, 1000.0),
    }.items():
        write_image(folder / f"{name}.jpg", picture)
    for name in ("grey 1", "grey 2"):
        write_image(folder / f"{name}.png", GREY)
    (folder / "<b>broken.jpg").write_bytes(b"no picture")
    out = folder / "results"
    assert main(["run", str(folder), "--out", str(out), "--report"]) == 1
    return out / "report.html"


@pytest.fixture(scope="module")
def clip_report(tmp_path_factory):
    """The report of a clip that pans and zooms, after some frames without a field."""
    folder = tmp_path_factory.mktemp("clip")
    with VideoWriter(folder / "pan.mp4", 25.0) as video:
        for picture in [GREY] * 4 + [seen(-22.0 + 1.2 * k, 1450.0 + 12.0 * k) for k in range(26)]:
            video.write(picture)
    with contextlib.chdir(folder):  # its name is in commands of the report
        assert main(["run", "pan.mp4", "--out", "results", "--report"]) == 0
    return folder / "results" / "report.html"


@pytest.fixture
def opened(chromium):
    """Open reports from their files; nothing may be fetched, and no script may fail."""
    contexts, messages, requests = [], [], []

    def open_report(path, size=(1280, 800)):
        context = chromium.new_context(viewport=dict(zip(("width", "height"), size, strict=True)), offline=True)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: messages.append(message.text))
        page.on("pageerror", lambda error: messages.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri())
        page.wait_for_function(SHOWN)
        return page

    yield open_report
    for context in contexts:
        context.close()
    assert messages == []
    assert [address for address in requests if not address.startswith(("file:", "data:"))] == []
    assert sum(address.startswith("file:") for address in requests) == len(contexts)


def rows(page, column="id"):
    """The cells of a column, from the top."""
    cells = page.locator(f".table-body .table-row .table-{column}")
    return cells.all_inner_texts()


def painted(page, selector):
    """Number of different colours on a canvas."""
    return page.evaluate(
        """(selector) => {
          const canvas = document.querySelector(selector);
          const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
          return new Set(new Uint32Array(data.buffer)).size;
        }""",
        selector,
    )


def keep(page, name):
    """Take a screenshot, for the docs if a folder for them is named."""
    folder = os.environ.get("FIELDCALIB_SCREENSHOTS")
    page.mouse.move(2, 2)
    page.wait_for_timeout(200)
    kind = {"path": Path(folder) / name} if folder else {}
    return page.screenshot(type="jpeg", quality=80, **kind)


def test_the_worst_frames_come_first_and_every_column_sorts(pictures_report, opened):
    page = opened(pictures_report)
    assert page.title() == "results"
    names = rows(page)
    assert len(names) == 7
    assert "<b>broken" in names[:3]
    assert set(rows(page, "concern")[3:]) == {"Good"}
    assert "Good" not in rows(page, "concern")[:3]
    page.get_by_role("button", name="Frame", exact=True).click()
    assert rows(page) == sorted(names, key=lambda name: name.strip("<"))
    page.get_by_role("button", name="Pan").click()
    pans = [float(text.rstrip("°").replace("−", "-")) for text in rows(page, "pan") if text != "–"]
    assert len(pans) == 4
    assert pans == sorted(pans)
    page.get_by_role("button", name="Pan").click()
    assert rows(page)[0] == "right"
    assert rows(page, "pan")[-3:] == ["–"] * 3  # what has no value comes last


def test_a_report_of_good_frames_names_the_least_sure_one(opened, tmp_path):
    truth = Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
    labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
    pixels = {label: truth.project(soccer()[label].sample(9.0)).round() for label in labels}
    fewer = {label: xy + 0.5 for label, xy in pixels.items() if label != "Circle right"}
    results = fieldcalib.calibrate({"many": pixels, "fewer": fewer}, image_size=(960, 540), progress=False)
    assert set(results.verdicts.values()) == {"good"}
    write_report(results, tmp_path / "report.html")
    least = min(results, key=lambda id: results[id].probability())
    sure = int(100 * round(results[least].probability(), 3))
    said = opened(tmp_path / "report.html").locator(".report-reasons").inner_text()
    assert said == f"All frames are good. The least sure one is {least}, {sure} % within 1 m."


def test_a_picture_its_map_and_its_numbers_are_shown(pictures_report, opened):
    page = opened(pictures_report)
    page.get_by_text("right", exact=True).click()
    page.wait_for_function("document.querySelector('.report-name').textContent.startsWith('right')")
    page.wait_for_timeout(300)
    assert painted(page, ".picture-pixels") > 1000
    assert painted(page, ".picture-lines") > 20
    view = page.locator(".map-view").get_attribute("points").split()
    assert len(view) > 20
    assert page.locator(".report-numbers").inner_text().startswith("pan\n23.9")
    assert page.locator(".report-verdict").get_attribute("data-verdict") == "good"


def test_keys_wheel_and_dragging_move_it(pictures_report, opened):
    page = opened(pictures_report)
    names = rows(page)
    for expected in names[1:4]:
        page.keyboard.press("ArrowDown")
        assert page.locator(".report-name").inner_text().startswith(expected)
    page.keyboard.press("ArrowUp")
    assert page.locator(".report-name").inner_text().startswith(names[2])
    page.get_by_text("middle", exact=True).click()
    page.wait_for_timeout(300)
    before = page.locator(".report-stage").screenshot()
    box = page.locator(".report-stage").bounding_box()
    page.mouse.move(box["x"] + 300, box["y"] + 200)
    page.mouse.wheel(0, -600)
    page.wait_for_timeout(200)
    closer = page.locator(".report-stage").screenshot()
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + 150)
    page.mouse.up()
    page.wait_for_timeout(200)
    moved = page.locator(".report-stage").screenshot()
    assert len({before, closer, moved}) == 3
    page.mouse.dblclick(box["x"] + 200, box["y"] + 150)
    page.wait_for_timeout(200)
    there, here = (
        cv2.imdecode(np.frombuffer(one, np.uint8), cv2.IMREAD_COLOR).astype(int)
        for one in (before, page.locator(".report-stage").screenshot())
    )
    assert np.mean(np.abs(here - there)) < 0.01  # levels: browsers round the same picture differently


def test_reasons_choose_their_frames_and_verdicts_theirs(pictures_report, opened):
    page = opened(pictures_report)
    reason = page.locator(".report-reason").filter(has_text="labelled by hand").first
    count = int(reason.locator(".report-many").inner_text())
    reason.click()
    assert len(rows(page)) == count
    reason.click()
    assert len(rows(page)) == 7
    page.locator(".report-count").filter(has_text="good").click()
    assert "Good" not in rows(page, "concern")


def test_what_the_run_was_is_told(pictures_report, opened):
    page = opened(pictures_report)
    page.get_by_role("button", name="About this run").click()
    about = page.locator(".report-about").inner_text()
    assert json.loads((pictures_report.parent / "summary.json").read_text())["version"] in about
    assert "The table has all 7 frames." in about
    assert "6 frames have a picture" in about
    page.keyboard.press("Escape")
    page.keyboard.press("ArrowDown")
    assert page.locator(".report-about").is_hidden()


def test_a_clip_has_plots_over_time_that_choose_frames(clip_report, opened):
    page = opened(clip_report)
    assert painted(page, ".timeline") > 50
    box = page.locator(".timeline").bounding_box()
    page.mouse.click(box["x"] + 0.8 * box["width"], box["y"] + 0.5 * box["height"])
    number = int(page.locator(".report-name").inner_text()[:6])
    assert 19 <= number <= 26
    page.keyboard.press("ArrowRight")
    assert page.locator(".report-name").inner_text()[:6] == f"{number + 1:06d}"
    page.wait_for_timeout(300)
    assert len(keep(page, "report.jpg")) > 30_000
    assert "lines" in page.locator(".report-name").inner_text()


@pytest.mark.parametrize("size", [(1280, 800), (3840, 2160), (1024, 700)])
def test_nothing_overlaps_or_leaves_the_window(clip_report, opened, size):
    page = opened(clip_report, size)
    page.wait_for_timeout(300)
    names = ("top", "list", "stage", "facts", "map", "timeline")
    boxes = [page.locator(f".report-{name}").bounding_box() for name in names]
    boxes = [(box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"]) for box in boxes]
    for k, (left, top, right, bottom) in enumerate(boxes):
        assert left >= 0
        assert right <= size[0] + 0.5
        assert bottom <= size[1] + 0.5
        assert min(right - left, bottom - top) > 30
        for other in boxes[k + 1 :]:
            assert (
                right <= other[0] + 0.5 or other[2] <= left + 0.5 or bottom <= other[1] + 0.5 or other[3] <= top + 0.5
            )


def test_narrow_windows_have_the_picture_above_the_frames(pictures_report, opened):
    page = opened(pictures_report, size=(390, 844))
    stage, frames = (page.locator(one).bounding_box() for one in (".report-stage", ".report-list"))
    assert stage["width"] > 350.0
    assert stage["y"] + stage["height"] < frames["y"]
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.evaluate("getComputedStyle(document.body).colorScheme") == "light"
