"""Reports of one file: what is in them, and how large they become."""

import base64
import json
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from commands import run
from networks import FIELD, looked_at

import fieldcalib
from fieldcalib import Camera, soccer
from fieldcalib.assess.advice import IF_ON_PAINT, NOT_SOCCER, NOT_WHOLE, OFF_PAINT, REMEDIES, SMALLER, Advice, Tool, how
from fieldcalib.assess.findings import Finding, What
from fieldcalib.draw.scene import render_field
from fieldcalib.web import report
from fieldcalib.web.pictures import Thumbnails, frames_to_show
from fieldcalib.web.report import UNREADABLE, Commands, ReportTable, bundled, one_file, write_report

TRUTHS = [Camera.from_angles(pan, 1.32, 0.0, 950.0, (1.0, 66.0, -16.0), (960, 540)) for pan in np.linspace(0.1, 0.4, 3)]
LABELS = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
GOOD = {"status": "accepted", "message": "rms 0.45 px over 5 segments", "verdict": "good"}
CHECK = {"status": "accepted", "message": "rms 0.5 px over 5 segments", "verdict": "check"}


class Page(HTMLParser):
    """The elements of a page, and the text of its scripts by id."""

    def __init__(self, path):
        super().__init__()
        self.elements, self.scripts, self._id = [], {}, None
        self.text = path.read_text(encoding="utf-8")
        self.feed(self.text)
        self.report, self.pictures = (json.loads(self.scripts[name]) for name in ("report", "pictures"))
        columns = self.report["frames"].items()
        self.frames = {
            name: [one["texts"][row] for row in one["rows"]] if isinstance(one, dict) else one for name, one in columns
        }

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self._id = dict(attrs).get("id", "") if tag == "script" else None

    def handle_endtag(self, tag):
        self._id = None

    def handle_data(self, data):
        if self._id is not None:
            self.scripts[self._id] = self.scripts.get(self._id, "") + data


def labelled(names=("one",)):
    pixels = {}
    for label in LABELS:
        xy = TRUTHS[0].project(soccer()[label].sample(3.0))
        pixels[label] = xy[np.all((xy >= 0.0) & (xy < (960, 540)), axis=1)]
    return fieldcalib.calibrate(dict.fromkeys(names, pixels), image_size=(960, 540), progress=False)


def test_the_report_of_a_run_has_its_frames_pictures_and_options(know, tmp_path):
    folder, out = tmp_path / "pictures", tmp_path / "out"
    folder.mkdir()
    rendered = [render_field(camera, FIELD) for camera in TRUTHS[:2]]
    for name, picture in zip(("a", "b"), rendered, strict=True):
        cv2.imwrite(str(folder / f"{name}.png"), picture)
    (folder / "c.png").write_bytes(b"no picture")
    know([TRUTHS[t] for t in looked_at(rendered)])
    assert run("run", folder, "--out", out, "--report") == 1
    page = Page(out / "report.html")
    frames = page.frames
    assert frames["id"] == ["a", "b", "c"]
    assert frames["verdict"][2] == "reject"
    assert frames["pan"][:2] == pytest.approx(np.degrees([one.angles[0] for one in TRUTHS[:2]]), abs=0.2)
    assert page.report["reasons"][-1]["remedy"] == UNREADABLE.text
    assert page.report["rate"] is None
    assert not page.report["plots"]
    assert page.report["about"]["version"] == fieldcalib.__version__
    assert page.report["about"]["verdict"].keys() == {"good", "check", "reject"}
    assert set(page.pictures) == set(page.report["states"]) == {"a", "b"}
    jpeg = np.frombuffer(base64.b64decode(page.pictures["a"]), np.uint8)
    assert np.mean(np.abs(cv2.imdecode(jpeg, 1).astype(float) - rendered[0])) < 4.0
    state = page.report["states"]["a"]
    assert (state["width"], state["height"]) == (960, 540)
    assert {curve["label"] for curve in state["curves"]} >= set(LABELS[1:])


@pytest.mark.slow
def test_a_finished_run_gets_its_report_later_and_of_a_clip_with_plots(know, tmp_path):
    folder, out = tmp_path / "clip", tmp_path / "out"
    folder.mkdir()
    rendered = [render_field(camera, FIELD, rng=np.random.default_rng(0)) for camera in TRUTHS]
    for number, picture in enumerate(rendered):
        cv2.imwrite(str(folder / f"{number}.png"), picture)
    know([TRUTHS[t] for t in looked_at(rendered)])
    assert run("run", folder, "--clip", "--out", out) == 0
    assert not (out / "report.html").exists()
    assert run("run", folder, "--clip", "--out", out, "--resume", "--report") == 0
    report = Page(out / "report.html").report
    assert report["plots"]
    assert report["rate"] > 0.0
    assert report["cuts"] == [0]
    assert len(report["states"]) == 3
    know([TRUTHS[t] for t in looked_at(rendered)])
    assert run("run", folder, "--clip", "--out", out, "--overwrite") == 0
    assert not (out / "report.html").exists()


def test_names_that_are_not_utf8(tmp_path):
    write_report(labelled(["T\udcfcrkei"]), tmp_path / "report.html", title="folder \udcff")
    assert Page(tmp_path / "report.html").frames["id"] == ["T\udcfcrkei"]
    assert "<title>folder \\udcff</title>" in (tmp_path / "report.html").read_text()


def test_nothing_is_fetched_and_no_text_becomes_a_tag(tmp_path):
    name = "</script><script>alert(1)</script><!--"
    write_report(labelled([name]), tmp_path / "report.html", title=name)
    page = Page(tmp_path / "report.html")
    assert page.frames["id"] == [name]
    assert [tag for tag, _ in page.elements].count("script") == 3
    assert "alert(1)" not in page.scripts[""]
    for _, attributes in page.elements:
        addresses = [attributes[key] for key in ("src", "href") if key in attributes]
        assert all(address.startswith("data:") for address in addresses)
    (policy,) = [attributes["content"] for _, attributes in page.elements if "http-equiv" in attributes]
    assert "default-src 'none'" in policy
    assert "unsafe-inline'; img" in policy  # styles
    assert "script-src 'sha256-" in policy


def test_a_report_without_pictures_and_without_frames(tmp_path):
    write_report(labelled(), tmp_path / "one.html")
    page = Page(tmp_path / "one.html")
    assert page.pictures == page.report["states"] == {}
    assert len(page.frames["view"][0]) >= 6
    (tmp_path / "cameras.jsonl").write_text("")
    write_report(fieldcalib.read(tmp_path), tmp_path / "none.html")
    assert Page(tmp_path / "none.html").frames["id"] == []


def many(count):
    """Lines of frames: every tenth one is to be checked."""
    line = json.loads(json.dumps(labelled().lines[0]))
    for number in range(count):
        beside = Finding(What.OFF_PAINT, "Side line top", (number % 7 + 3.0,))
        checked = {**CHECK, "reason": f"{beside}; rms 0.5 px", "findings": [beside.to_dict()]}
        words = checked if number % 10 == 0 else {**GOOD, "reason": "rms 0.4 px"}
        yield {
            **line,
            **words,
            "id": f"{number:06d}",
            "remedy": "",
            "probability_right_1m": 0.5 + 0.4 * (number % 10 > 0),
        }


def test_frames_with_one_reason_are_counted_together():
    lines = [*many(30), {"id": "x", "status": "broken file", "message": "is cut off"}]
    table = ReportTable.of(lines, soccer())
    assert [(one.verdict, one.count, one.remedy) for one in table.reasons] == [
        ("", 1, UNREADABLE.text),
        ("check", 3, IF_ON_PAINT.text),
    ]
    assert [one.how for one in table.reasons] == [Commands().how(one) for one in (UNREADABLE, IF_ON_PAINT)]
    assert table.reasons[0].words == "is cut off"
    assert table.reasons[1].words == "'Side line top' lies 3 to 9 px beside its paint"
    assert [table.columns["group"][number] for number in (0, 1, 10, 30)] == [1, -1, 1, 0]
    assert table.worst[:4] == [30, 0, 10, 20]


@pytest.mark.parametrize(
    "remedy", [*REMEDIES.values(), NOT_SOCCER, NOT_WHOLE, OFF_PAINT, SMALLER, IF_ON_PAINT, UNREADABLE]
)
def test_each_advice_says_what_to_type(remedy):
    said = Commands("my folder", "match.mp4").how(remedy)
    assert ("fieldcalib open my folder" in said) == (remedy != UNREADABLE)
    options = how(set(remedy.advice) - {Advice.LOOK, Advice.BY_HAND}, Tool.COMMAND)
    again = f"fieldcalib run match.mp4 --out NEW-FOLDER with {options}"
    assert (again in said) == bool(options)


def test_a_report_names_the_folder_and_the_input_of_its_run(know, tmp_path):
    folder, picture = tmp_path / "two words", tmp_path / "a.png"
    grass = np.random.default_rng(0).integers(60, 120, (270, 480, 3), np.uint8)
    cv2.imwrite(str(picture), grass)
    know([None])
    assert run("run", picture, "--out", folder, "--report") == 0
    (reason,) = Page(folder / "report.html").report["reasons"]
    assert f"fieldcalib open '{folder}' (" in reason["how"]
    assert f"fieldcalib run {picture} --out NEW-FOLDER with" in reason["how"]


@pytest.mark.parametrize(
    "most", [50_000, pytest.param(90_000, marks=pytest.mark.slow), pytest.param(10_000, marks=pytest.mark.slow)]
)
def test_the_table_keeps_to_its_bytes_and_the_worst_rows(most):
    table = ReportTable.of(many(600), soccer())
    assert table.within(1e9, []) is table
    short = table.within(most, [7, 13])
    assert len(json.dumps(short.to_record()["frames"], separators=(",", ":"))) <= most
    assert short.count == 600
    assert {"000007", "000013"} <= set(short.columns["id"])
    assert short.columns["id"] == sorted(short.columns["id"])
    kept = [
        short.columns["verdict"].count(one) / max(table.columns["verdict"].count(one), 1) for one in ("check", "good")
    ]
    assert kept[0] >= kept[1]


def test_the_parts_of_a_report_are_as_large_together_as_it_may_be():
    rest = len(bundled("report")) + sum((report.STATIC / f"{name}.css").stat().st_size for name in report.STYLES)
    parts = report.TABLE_BYTES + report.STATE_BYTES + report.PICTURE_BYTES * 4 / 3
    assert (
        0.9 * report.MOST_BYTES < parts + rest < report.MOST_BYTES - 100_000
    )  # that are left for the field and options


def test_pictures_become_smaller_and_then_fewer():
    noise = np.random.default_rng(0).integers(0, 255, (720, 1280, 3), dtype=np.uint8)
    ids = [f"{number:03d}" for number in range(40)]
    one = Thumbnails(ids, most_bytes=1e9)
    one.add(ids[0], noise)
    assert (one.width, len(one.jpegs)) == (1280, 1)
    several = Thumbnails(ids, most_bytes=800_000)
    few = Thumbnails(ids, most_bytes=300_000)
    for id in reversed(ids):
        several.add(id, noise)
        few.add(id, noise)
    several.add("another", noise)
    assert several.width < 720
    assert set(several.jpegs) == set(ids)
    assert 400_000 < several.size <= 800_000
    assert few.width == 280
    assert sorted(few.jpegs) == ids[: len(few.jpegs)]
    assert 250_000 < few.size <= 300_000


def test_pictures_are_of_the_worst_frames_and_of_all_parts():
    chosen = frames_to_show(10_000, worst=range(5000, 6000), most=100)
    assert len(chosen) == len(set(chosen)) == 100
    assert sum(5000 <= number < 6000 for number in chosen) >= 50
    others = sorted(number for number in chosen if not 5000 <= number < 6000)
    assert np.max(np.diff([0, *others, 10_000])) < 1400
    assert sorted(frames_to_show(5, worst=[3, 1, 0, 2, 4])) == [0, 1, 2, 3, 4]
    assert frames_to_show(0, worst=[]) == []


def test_a_script_of_all_modules_has_no_imports_left():
    script = bundled("report")
    assert "class FrameTable" in script
    assert "import {" not in script
    assert "\nexport " not in script


@pytest.mark.parametrize(
    "source", ["export default 3;", 'import x from "./dom.js";', "export { a };", 'await import("./dom.js");']
)
def test_other_forms_of_modules_are_refused(source, tmp_path, monkeypatch):
    (tmp_path / "one.js").write_text(source)
    (tmp_path / "dom.js").write_text("export const a = 1;")
    monkeypatch.setattr(report, "STATIC", tmp_path)
    with pytest.raises(ValueError, match=r"one\.js: expected import"):
        bundled("one")


def test_modules_in_a_circle_are_refused(tmp_path, monkeypatch):
    for one, other in (("a", "b"), ("b", "a")):
        (tmp_path / f"{one}.js").write_text(f'import {{ x }} from "./{other}.js";\n')
    monkeypatch.setattr(report, "STATIC", tmp_path)
    with pytest.raises(ValueError, match="a -> b -> a"):
        bundled("a")


def test_modules_are_made_once_and_names_may_be_changed(tmp_path, monkeypatch):
    (tmp_path / "base.js").write_text("export const one = 1;\nexport async function two() {}\n")
    (tmp_path / "left.js").write_text('import { one as first, two } from "./base.js";\nexport class Left {}\n')
    (tmp_path / "top.js").write_text('import { Left } from "./left.js";\nimport {\n  one,\n} from "./base.js";\n')
    monkeypatch.setattr(report, "STATIC", tmp_path)
    script = bundled("top")
    assert script.count("const module_base =") == 1
    assert "return { one, two };" in script
    assert "const { one: first, two } = module_base;" in script
    assert script.index("module_base") < script.index("module_left") < script.index("module_top")


def test_the_end_of_a_script_is_escaped_in_scripts_and_styles():
    text = one_file("T", "a { content: '</style>'; }", 'x = "</script><!--";', {})
    assert text.count("</script") == 1
    assert text.count("</style") == 1
    assert "<!--" not in text
