"""A person labels a picture: clicks, strokes, drags, other labels, undo, known numbers; the camera follows."""

import re
import shutil

import cv2
import numpy as np
import pytest

from browser.driving import LABELS, SIZE, TRUTH, along, closing_windows, ending_servers, render
from fieldcalib.draw.scene import render_field
from fieldcalib.fields import tennis
from fieldcalib.geometry.camera import Camera


def largest_shift(camera, truth=TRUTH):
    """Largest distance in px of the picture's markings between a camera as the page has it and another one."""
    f, (cx, cy) = camera["focal_length"], camera["principal_point"]
    angles = np.radians([camera["pan"], camera["tilt"], camera["roll"]])
    found = Camera.from_angles(
        *angles, f, camera["position"], truth.image_size, k=camera["dist"][:2], principal_point=(cx, cy)
    )
    X = np.concatenate([truth.image_to_field(np.array([[x, y]])) for x in (100, 900, 1800) for y in (500, 700, 1000)])
    X = np.column_stack([X, np.zeros(len(X))]) if X.shape[1] == 2 else X
    return float(np.max(np.linalg.norm(found.project(X) - truth.project(X), axis=1)))


@pytest.fixture(scope="module")
def labelled_folder(chromium, compiled, picture, tmp_path_factory):
    """The results of a picture that was labelled by hand."""
    with ending_servers(tmp_path_factory.mktemp("labelled")) as start, closing_windows(chromium) as open_window:
        one = open_window(start(picture))
        one.label_by_clicks(rng=np.random.default_rng(0))
        return one.server.out


@pytest.fixture
def labelled(serve, window, picture, labelled_folder, tmp_path):
    """A picture that was labelled by hand, opened again."""
    return window(serve(picture, out=shutil.copytree(labelled_folder, tmp_path / "results")))


def test_labelling_from_nothing_reaches_the_true_camera_within_its_uncertainty(labelled):
    state = labelled.state()
    camera, sd = state["camera"], state["camera"]["sd"]
    true_angles = np.degrees(TRUTH.angles)

    assert state["verdict"] in ("good", "check")
    assert state["by_hand"]
    assert {mark["label"] for mark in state["marks"]} == set(LABELS)
    for found, truth, deviation in (
        (camera["focal_length"], TRUTH.focal_length, sd["focal_length"]),
        *zip(camera["position"], TRUTH.C, sd["position"], strict=True),
        *((camera[name], angle, sd[name]) for name, angle in zip(("pan", "tilt", "roll"), true_angles, strict=True)),
    ):
        assert abs(found - truth) < 4.0 * deviation
    assert largest_shift(camera) < 6.0
    assert labelled.page.locator("#verdict strong").inner_text() == {"good": "Good", "check": "Check"}[state["verdict"]]


SHOW_VERDICT = """async () => {
    const { VerdictCard } = await import(new URL("static/verdict.js", document.baseURI));
    const card = new VerdictCard(document.getElementById("verdict"), { here: "Here" });
    const before = card.root.clientHeight;
    card.show({ number: 0, verdict: "check", camera: {}, reason: "a reason, ".repeat(40),
                remedy: "give the known length and width of the field ".repeat(9),
                here: "type the size of the field in the tab Camera", marks: [] });
    const { words, more } = card;
    const cut = [...words.children].filter((one) => one.scrollHeight > one.clientHeight + 1).length;
    words.scrollTop = 1e4;
    const last = words.lastElementChild.getBoundingClientRect().bottom;
    const seen = { cut, jump: card.root.clientHeight - before, beyond: last - words.getBoundingClientRect().bottom,
                   focusable: words.tabIndex, text: card.root.innerText, says: !more.hidden && more.innerText };
    more.click();
    seen.higher = card.root.clientHeight - before;
    card.show({ number: 1, verdict: "good", camera: {}, reason: "rms 0.4 px", marks: [] });
    seen.stays = card.root.clientHeight - before - seen.higher;
    more.click();
    return { ...seen, after: card.root.clientHeight - before, quiet: more.hidden };
}"""


def test_a_long_reason_is_shown_whole(labelled):
    seen = labelled.page.evaluate(SHOW_VERDICT)
    assert (seen["cut"], seen["jump"], seen["focusable"]) == (0, 0, 0)
    assert seen["beyond"] < 1.0  # places are fractions of pixels
    assert seen["text"].lower().count("a reason") == 40
    assert "Here: type the size of the field in the tab Camera." in seen["text"]
    assert seen["says"] == "More"  # that words are cut, and how to see them
    assert seen["higher"] > 100
    assert (seen["stays"], seen["after"], seen["quiet"]) == (0, 0, True)


RECORD_TEXTS = """() => {
    window.texts = [];
    const { fillText } = CanvasRenderingContext2D.prototype;
    CanvasRenderingContext2D.prototype.fillText = function (text, ...rest) {
        window.texts.push(text);
        return fillText.call(this, text, ...rest);
    };
}"""


def test_metres_are_not_covered_by_the_name_of_a_marking(serve, window, picture):
    one = window(serve(picture))
    place = along("Middle line", count=5)[2]
    one.page.evaluate(RECORD_TEXTS)
    one.page.mouse.move(*one.place(place))
    one.wait("() => window.texts.includes('Middle line')")
    one.press("2")
    one.click(place)
    one.wait("() => window.texts.some((text) => text.includes('±'))")
    one.page.evaluate("() => { window.texts = [] }")
    one.page.mouse.move(*np.add(one.place(place), (1, 0)))
    one.wait("() => window.texts.some((text) => text.includes('±'))")
    assert "Middle line" not in one.page.evaluate("window.texts")


def test_a_squashed_picture_is_good_when_its_shape_is_said(serve, window, tmp_path):
    squashed, size = tmp_path / "squashed.jpg", (600, 540)
    cv2.imwrite(str(squashed), cv2.resize(render(), size, interpolation=cv2.INTER_AREA))
    one = window(serve(squashed), size=(1400, 850))
    assert "squashed or cut out" in one.text("#verdict")
    assert one.page.locator("#verdict .verdict-more").is_visible()
    one.page.get_by_role("tab", name="Camera").click()
    shape = one.page.get_by_label("Shown as (w:h)")
    before = one.revision
    shape.fill("16:9")
    shape.press("Enter")
    one.wait_for_revision(before + 1)
    one.wait("() => document.querySelector('#verdict strong')?.innerText === 'Good'")
    assert shape.input_value() == "16:9"
    assert one.state()["known"]["aspect"] == pytest.approx(16 / 9)
    truth = TRUTH.scaled(size)
    assert np.linalg.norm(np.subtract(one.state()["camera"]["position"], truth.C)) < 1.0


RECORD_REVISIONS = """() => {
    const { dataset } = document.querySelector(".picture-lines");
    window.revisions = [Number(dataset.revision)];
    const seen = new MutationObserver(() => window.revisions.push(Number(dataset.revision)));
    seen.observe(document.querySelector(".picture-lines"), { attributeFilter: ["data-revision"] });
}"""


def test_an_answer_that_an_edit_has_overtaken_is_not_shown(labelled):
    """The page asks what may have changed elsewhere; an answer from before a click does not undo the click."""
    held, armed = [], []
    places = along("Middle line", count=9)

    def hold(route):
        if armed and not held:
            held.append((route, route.fetch()))
        else:
            route.continue_()

    labelled.page.route("**/api/frame/0", hold)
    for number in range(1, 7):  # until the page asks after the verdict on a click is there
        armed.clear()
        labelled.mark("Middle line", places[number : number + 1])
        armed.append(True)
        labelled.page.wait_for_timeout(1000)
        if held:
            break
    labelled.mark("Middle line", places[number + 1 : number + 2])
    labelled.page.evaluate(RECORD_REVISIONS)
    route, answer = held[0]
    route.fulfill(response=answer)
    labelled.page.wait_for_timeout(500)
    revisions = labelled.page.evaluate("window.revisions")
    assert revisions == sorted(revisions)


SHOW_LEFT_OUT = """async () => {
    const load = (name) => import(new URL(`static/${name}.js`, document.baseURI));
    const [{ VerdictCard }, { MarkList }] = [await load("verdict"), await load("marks")];
    const mark = (label, error, left_out) => ({ label, error, left_out, x: 9, y: 9, by_hand: false, suspect: false });
    const marks = [mark("Side line top", 12.4, true), mark("Side line top", 1.0, false),
                   mark("Middle line", 0.5, false), mark("Circle left", 9.1, true)];
    const frame = { number: 0, verdict: "good", camera: {}, reason: "rms 0.99 px over 8 segments", marks };
    const actions = { select() {}, choose() {}, remove() {} };
    new VerdictCard(document.getElementById("verdict")).show(frame);
    new MarkList(document.getElementById("marks"), actions).show(frame, new Set(), null);
    return [document.getElementById("verdict").innerText, document.getElementById("marks").innerText];
}"""


def test_labels_that_were_left_out_are_named(labelled):
    card, marks = labelled.page.evaluate(SHOW_LEFT_OUT)
    assert "Left out of the camera as stray: Side line top (1 of 2 marks, 12 px off), Circle left (9 px off)." in card
    assert "The rms is of the pixels that it was fitted to." in card
    assert marks.count("Left out of the camera as stray") == 2
    assert "Left out of the camera as stray: 1 of 2." in marks


def test_clicks_snap_to_the_paint_unless_a_key_says_no(serve, window, picture):
    one = window(serve(picture))
    one.clear()
    true = along("Middle line", count=3)[1]
    one.choose("Middle line")

    one.click(true + (4.0, 0.0))
    one.wait_for_revision(2)
    one.page.keyboard.down("Alt")
    one.click(true + (4.0, 60.0))
    one.page.keyboard.up("Alt")
    one.wait_for_revision(3)

    snapped, loose = (np.array([mark["x"], mark["y"]]) for mark in one.state()["marks"])
    direction = np.diff(along("Middle line"), axis=0)[0]
    normal = np.array([-direction[1], direction[0]]) / np.linalg.norm(direction)
    assert abs((snapped - true) @ normal) < 1.0
    assert np.linalg.norm(loose - true - (4.0, 60.0)) < 1.0


def test_a_stroke_along_a_marking_sets_marks_along_it(serve, window, picture):
    one = window(serve(picture))
    one.clear()
    one.choose("Side line top")
    start, end = along("Side line top")

    one.drag(start, end, steps=8)
    one.wait_for_revision(2)

    marks = one.state()["marks"]
    assert 3 <= len(marks) <= 6
    assert {mark["label"] for mark in marks} == {"Side line top"}
    assert np.ptp([mark["x"] for mark in marks]) > 0.9 * abs(end[0] - start[0])


def test_a_stray_label_is_seen_and_mended(labelled):
    stray = along("Big rect. left main", count=4)[1:3] + (180.0, 90.0)
    labelled.mark("Small rect. left main", stray)
    labelled.press("Escape")

    doubted = [number for number, mark in enumerate(labelled.state()["marks"]) if mark["suspect"]]
    assert doubted
    assert {labelled.state()["marks"][number]["label"] for number in doubted} == {"Small rect. left main"}
    row = labelled.page.locator(".mark-row", has_text="Small rect. left main")
    assert "In doubt" in row.inner_text()
    assert len(doubted) == 2  # of one label
    labelled.page.get_by_text(re.compile("1 label in doubt")).wait_for()

    revision = labelled.revision
    row.locator(".mark-name").click()
    labelled.press("Delete")
    labelled.wait_for_revision(revision + 1)

    assert not any(mark["suspect"] for mark in labelled.state()["marks"])
    assert largest_shift(labelled.state()["camera"]) < 6.0


def test_another_label_is_proposed_and_taken(labelled):
    """Marks on the middle line, labelled as another one: the middle line is the first proposal."""
    labelled.mark("Side line right", along("Middle line", count=5)[1:4])
    labelled.press("Escape")
    count = len(labelled.state()["marks"])
    labelled.click(along("Middle line", count=5)[2])

    options = labelled.page.locator("#selection select")
    labelled.wait("() => document.querySelector('#selection select').options[0]?.text.includes('likely')")
    assert options.locator("option").first.get_attribute("value") == "Middle line"
    revision = labelled.revision
    options.select_option("Middle line")
    labelled.wait_for_revision(revision + 1)

    assert len(labelled.state()["marks"]) == count
    assert [mark["label"] for mark in labelled.state()["marks"][-3:]].count("Middle line") == 1


def test_a_rubber_band_selects_marks_that_move_together(labelled):
    marks = labelled.state()["marks"]
    xy = np.array([[mark["x"], mark["y"]] for mark in marks])
    inside = np.flatnonzero(np.all(np.abs(xy - xy[0]) < 250.0, axis=1))

    labelled.page.keyboard.down("Shift")
    labelled.drag(np.maximum(xy[0] - 250.0, 1.0), xy[0] + 250.0)
    labelled.page.keyboard.up("Shift")
    assert labelled.text("#selection > span").startswith(f"{len(inside)} mark")

    revision = labelled.revision
    labelled.page.keyboard.down("Alt")
    labelled.drag(xy[0], xy[0] + (12.0, 9.0))
    labelled.page.keyboard.up("Alt")
    labelled.wait_for_revision(revision + 1)

    moved = np.array([[mark["x"], mark["y"]] for mark in labelled.state()["marks"]]) - xy
    assert np.allclose(moved[inside], (12.0, 9.0), atol=1.5)
    assert not np.delete(moved, inside, axis=0).any()


def test_beginning_to_label_is_progress_in_a_narrow_window_too(serve, window, picture):
    one = window(serve(picture), size=(390, 844))
    edges = one.page.eval_on_selector_all(
        ".top button, .tools button", "all => all.map(one => one.getBoundingClientRect().right)"
    )
    assert max(edges) <= 390.0
    one.clear()
    assert one.text("#verdict strong") == "Begin"
    one.mark(LABELS[0], along(LABELS[0]))
    assert one.text(".verdict-title") == "Go on\n3 more markings for a camera"
    assert "sure" not in one.text("#verdict")


def test_undo_goes_twenty_steps_back_and_forth(serve, window, picture):
    one = window(serve(picture))
    one.clear()
    places = [xy for label in LABELS[:4] for xy in along(label, count=5)]
    for label in LABELS[:4]:
        one.mark(label, along(label, count=5))
    assert len(places) == len(one.state()["marks"]) == 20
    after = one.state()["marks"]

    one.press(*["Control+z"] * 20)
    one.wait_for_revision(41)
    assert one.state()["marks"] == []
    assert one.text("#verdict strong") == "Begin"

    one.press(*["Control+Shift+z"] * 20)
    one.wait_for_revision(61)
    assert one.state()["marks"] == after


def test_marks_are_dragged_at_400_percent_to_a_quarter_of_a_pixel(labelled):
    mark = labelled.state()["marks"][0]
    labelled.page.mouse.move(*labelled.place((mark["x"], mark["y"])))
    for _ in range(60):
        labelled.page.mouse.wheel(0, -50)
        if float(labelled.canvas.get_attribute("data-view").split(",")[2]) >= 4.0:
            break
    assert "4" in labelled.text(".zoom-words")

    revision = labelled.revision
    labelled.page.keyboard.down("Alt")
    labelled.drag((mark["x"], mark["y"]), (mark["x"] + 2.25, mark["y"] - 1.5))
    labelled.page.keyboard.up("Alt")
    labelled.wait_for_revision(revision + 1)

    moved = labelled.state()["marks"][0]
    assert moved["x"] - mark["x"] == pytest.approx(2.25, abs=0.26)
    assert moved["y"] - mark["y"] == pytest.approx(-1.5, abs=0.26)


def test_arrow_keys_move_marks_by_a_pixel_and_by_a_tenth(labelled):
    mark = labelled.state()["marks"][2]
    labelled.click((mark["x"], mark["y"]))
    revision = labelled.revision
    labelled.press("Control+ArrowRight")
    labelled.wait_for_revision(revision + 1)
    labelled.press("Control+Shift+ArrowUp")
    labelled.wait_for_revision(revision + 2)
    moved = labelled.state()["marks"][2]
    assert (moved["x"] - mark["x"], moved["y"] - mark["y"]) == pytest.approx((1.0, -0.1), abs=0.02)


def test_a_marking_is_chosen_on_the_map(serve, window, picture):
    one = window(serve(picture))
    one.page.locator('[data-label="Middle line"]').hover(force=True, position={"x": 1, "y": 20})
    assert one.text("#map .map-caption b") == "Middle line"
    one.page.locator('[data-label="Goal left crossbar"]').focus()
    one.press("Enter")
    assert one.text("#chosen b") == "Goal left crossbar"
    assert one.page.locator('[data-label="Goal left crossbar"]').get_attribute("aria-pressed") == "true"
    one.press("Escape")
    assert one.page.locator("#chosen.shown").count() == 0
    one.press("ArrowRight", "Enter")  # from marking to marking
    assert one.text("#chosen b") == list(one.keys)[list(one.keys).index("Goal left crossbar") + 1]


def test_a_typed_focal_length_is_held_and_let_go(labelled):
    labelled.page.get_by_role("tab", name="Camera").click()
    focal = labelled.page.get_by_label("Focal length (px)")
    revision = labelled.revision
    focal.fill("2700")
    focal.press("Enter")
    labelled.wait_for_revision(revision + 1)
    assert labelled.state()["camera"]["focal_length"] == pytest.approx(2700.0)
    assert labelled.state()["known"]["focal_length"] == 2700.0

    labelled.page.get_by_role("button", name="Focal length: held").click()
    labelled.wait_for_revision(revision + 2)
    assert labelled.state()["known"]["focal_length"] is None
    assert labelled.state()["camera"]["focal_length"] == pytest.approx(TRUTH.focal_length, rel=0.02)

    focal.fill("many")
    focal.press("Enter")
    assert focal.get_attribute("aria-invalid") == "true"
    labelled.page.get_by_role("button", name="Position: estimated").click()
    labelled.wait_for_revision(revision + 3)
    assert labelled.state()["known"]["position"] == pytest.approx(labelled.state()["camera"]["position"], abs=1e-3)


def test_the_next_mark_is_shown_and_a_click_on_it_sets_it(labelled):
    proposed = labelled.state()["next"]
    revision, count = labelled.revision, len(labelled.state()["marks"])
    labelled.click((proposed["x"], proposed["y"]))
    labelled.wait_for_revision(revision + 1)
    marks = labelled.state()["marks"]
    assert len(marks) == count + 1
    assert marks[-1]["label"] == proposed["label"]


def test_keyboard_help_opens_and_closes(serve, window, picture):
    one = window(serve(picture))
    one.press("?")
    assert "Select with a rubber band" in one.text("dialog.help")
    one.press("Escape")
    assert not one.page.locator("dialog.help").is_visible()


def test_a_label_named_like_a_script_is_text(serve, window, tmp_path):
    """Of a field of one's own, and of a file's name."""
    path = tmp_path / "<img src=x onerror=window.hit=1>.png"
    cv2.imwrite(str(path), render())
    field = tmp_path / "field.yaml"
    field.write_text(
        "length: 105\nwidth: 68\nsegments:\n"
        "  '<script>window.hit=1</script>': {kind: Line, start: [-52.5, -34, 0], end: [52.5, -34, 0]}\n"
        "  Left: {kind: Line, start: [-52.5, -34, 0], end: [-52.5, 34, 0]}\n"
        "  Right: {kind: Line, start: [52.5, -34, 0], end: [52.5, 34, 0]}\n"
        "stands:\n  - {name: seats, pan: [-40, 40], tilt: [50, 88], roll: [-5, 5], fov: [15, 70], "
        "x: [-14, 14], y: [40, 80], z: [-25, -8]}\n"
    )
    one = window(serve(path, "--field", field))
    one.page.locator('[data-label="<script>window.hit=1</script>"]').focus()
    one.press("Enter")
    assert one.text("#chosen b") == "<script>window.hit=1</script>"
    one.click(along("Side line top", count=3)[1])
    one.wait_for_revision(1)
    assert one.page.locator(".mark-label").first.inner_text() == "<script>window.hit=1</script>"
    assert path.name in one.text("#title")
    assert one.page.evaluate("window.hit") is None


def test_a_court_that_no_network_knows_appears_when_it_is_found(serve, window, tmp_path):
    court = Camera.from_angles(1.5, 1.3, 0.0, 2800.0, (-32.0, 1.0, -9.0), SIZE)
    cv2.imwrite(str(tmp_path / "court.png"), render_field(court, tennis()))
    one = window(serve(tmp_path / "court.png", "--field", "tennis"))
    one.wait("() => document.querySelector('#verdict strong')?.innerText === 'Good'")
    assert abs(one.state()["camera"]["focal_length"] - 2800.0) < 30.0
    assert one.state()["automatic"]


def test_the_sport_is_chosen_above_the_map(serve, window, tmp_path, shoot):
    court = Camera.from_angles(1.5, 1.3, 0.0, 2800.0, (-32.0, 1.0, -9.0), SIZE)
    cv2.imwrite(str(tmp_path / "court.png"), render_field(court, tennis()))
    server = serve(tmp_path / "court.png")
    one, other = window(server), window(server, size=(820, 1180))
    for each in (one, other):
        each.wait_for_frame(0)
    sport = one.page.get_by_role("combobox", name="Sport")
    assert sport.input_value() == "soccer"
    sport.select_option("tennis")
    for each in (one, other):  # the other window sees it too
        each.page.locator(".sport").get_by_text("23.77").wait_for()
        each.wait("() => document.querySelector('#verdict strong')?.innerText === 'Good'")
    shoot(other, "page-sport-narrow")
    other.mark(next(iter(tennis())), [(900.0, 500.0)])
    sport.select_option("padel")
    one.page.get_by_text("1 frame labelled by hand on the field of tennis").wait_for()
    assert sport.input_value() == "tennis"
