"""A server of the page, and a window that a test drives as a person would."""

import functools
import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from fieldcalib.draw.scene import render_field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera

ROOT = Path(__file__).parents[2]
FIELD = soccer()
SIZE = (1920, 1080)
TRUTH = Camera.from_angles(*np.radians([-17.0, 77.0, 0.3]), 2600.0, (1.5, 66.0, -16.0), SIZE, k=(-0.04, 0.0))
LABELS = ("Side line top", "Side line left", "Big rect. left main", "Big rect. left top", "Circle left", "Middle line")
SECONDS = 30.0  # that a test waits: a busy machine is no property of the page


@functools.cache
def render(camera=TRUTH):
    """The picture that a camera sees."""
    return render_field(camera, FIELD, rng=np.random.default_rng(0))


def along(label, camera=TRUTH, count=2, margin=25.0):
    """Pixels evenly along the part of a marking in view."""
    xy = camera.project(FIELD[label].sample(0.5))
    xy = xy[np.all((xy > margin) & (xy < np.subtract(camera.image_size, 1 + margin)), axis=1)]
    return xy[np.linspace(0, len(xy) - 1, count).round().astype(int)]


class Server:
    """`fieldcalib open` in a process of its own."""

    def __init__(self, source, out, *arguments):
        self.command = [sys.executable, "-m", "fieldcalib", "open", source, "--no-browser", "--out", out, *arguments]
        self.out = out
        self.start()

    def start(self):
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
        log = self.out.with_suffix(".log")
        command = [str(part) for part in self.command]
        with log.open("w") as errors:
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment)
        self.address = self.process.stdout.readline().strip()
        assert self.address.startswith("http://127.0.0.1:"), log.read_text()

    @property
    def processor_seconds(self):
        """Processor time that it has used; NaN where the system does not tell."""
        path = Path(f"/proc/{self.process.pid}/stat")
        if not path.exists():
            return float("nan")
        numbers = path.read_text().rpartition(")")[2].split()  # after the name; see proc(5)
        return (int(numbers[11]) + int(numbers[12])) / os.sysconf("SC_CLK_TCK")

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()


class Window:
    """A window of the page; places are pixels of the picture."""

    def __init__(self, page, server):
        self.page, self.server = page, server
        self.errors, self.requests = [], []
        page.set_default_timeout(1e3 * SECONDS)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda message: self._console(message))
        page.on("request", lambda request: self.requests.append(request.url))
        page.goto(server.address)

    def _console(self, message):
        """The browser itself says which requests failed: those are looked at where they matter."""
        if message.type == "error" and "Failed to load resource" not in message.text:
            self.errors.append(message.text)

    # Waiting

    @property
    def canvas(self):
        return self.page.locator("canvas.picture-lines")

    def wait(self, expression, argument=None):
        self.page.wait_for_function(expression, arg=argument)

    def wait_for_frame(self, number=None):
        """Until a frame, whatever it is, and its picture are on the screen."""
        self.wait(
            "number => { const canvas = document.querySelector('.picture-lines'); "
            "const { frame, revision } = canvas?.dataset ?? {}; "
            "return revision !== undefined && (number === null || frame === String(number)) "
            "&& !document.querySelector('#page.loading') }",
            number,
        )

    def wait_for_revision(self, revision):
        """Until the answers to all edits are on the screen with the verdict, and there were so many of them."""
        self.wait(
            "revision => { const { dataset } = document.querySelector('.picture-lines'); "
            "return dataset.pending === '0' && dataset.judged === 'true' && Number(dataset.revision) >= revision }",
            revision,
        )

    def wait_for_cuts(self, cuts):
        """Until the timeline shows these first frames of shots."""
        self.wait("cuts => document.querySelector('canvas.timeline').dataset.cuts === cuts", " ".join(map(str, cuts)))

    @property
    def revision(self):
        return int(self.canvas.get_attribute("data-revision"))

    # What is there

    def get(self, path):
        """What the server answers to a request of the page."""
        return self.page.evaluate("path => fetch(path).then(answer => answer.json())", path)

    def state(self, number=0):
        return self.get(f"api/frame/{number}")

    @functools.cached_property
    def keys(self):
        return {one["label"]: one["key"] for one in self.get("api/field")["segments"]}

    def text(self, selector):
        return self.page.locator(selector).inner_text()

    # What a person does

    def place(self, xy):
        """Pixels of the window at which pixels of the picture are."""
        x, y, zoom = map(float, self.canvas.get_attribute("data-view").split(","))
        box = self.canvas.bounding_box()
        return (
            box["x"] + box["width"] / 2 + (xy[0] - x) * zoom,
            box["y"] + box["height"] / 2 + (xy[1] - y) * zoom,
        )

    def click(self, xy, **options):
        self.page.mouse.click(*self.place(xy), **options)

    def drag(self, start, end, steps=5, **options):
        start, end = self.place(start), self.place(end)
        self.page.mouse.move(*start)
        self.page.mouse.down(**options)
        self.page.mouse.move(*end, steps=steps)
        self.page.mouse.up(**options)

    def press(self, *keys):
        for key in keys:
            self.page.keyboard.press(key)

    def point(self, xy):
        """Move the pointer of the keyboard to pixels of the picture."""
        zoom = float(self.canvas.get_attribute("data-view").split(",")[2])
        there = map(float, self.canvas.get_attribute("data-cursor").split(","))
        keys = (("ArrowLeft", "ArrowRight"), ("ArrowUp", "ArrowDown"))
        for left, (back, on) in zip(zoom * np.subtract(xy, list(there)), keys, strict=True):
            name = back if left < 0.0 else on
            tens, ones = divmod(round(abs(left)), 10)
            self.press(*[name] * tens, *[f"Shift+{name}"] * ones)

    def choose(self, label):
        """Choose a marking by its key."""
        self.page.keyboard.type(self.keys[label])
        self.page.locator("#chosen b").get_by_text(label, exact=True).wait_for()

    def mark(self, label, xy):
        """Choose a marking and click at pixels, one after the other; until they are answered."""
        self.choose(label)
        before = self.revision
        for one in xy:
            self.click(one)
        self.wait_for_revision(before + len(xy))

    def clear(self):
        """Take the labels away that were found automatically."""
        before = self.revision
        self.page.get_by_role("button", name="Remove all marks").click()
        self.wait_for_revision(before + 1)

    def label_by_clicks(self, labels=LABELS, count=2, camera=TRUTH, rng=None, noise=2.0):
        """Label a picture from nothing, with hands that are `noise` pixels off."""
        self.clear()
        for label in labels:
            xy = along(label, camera, max(count, 2 + 2 * FIELD[label].is_arc))
            self.mark(label, xy if rng is None else xy + rng.normal(scale=noise, size=xy.shape))
        self.press("Escape")


@contextmanager
def ending_servers(folder):
    """Start servers, `start(source, *arguments)`, with their results in a folder; they end with the block."""
    servers = []

    def start(source, *arguments, out=None):
        servers.append(Server(source, out or folder / "results", *arguments))
        return servers[-1]

    try:
        yield start
    finally:
        for server in servers:
            server.kill()


@contextmanager
def closing_windows(chromium):
    """Open windows of the page, `open_window(server)`; no script may fail, and nothing be fetched from elsewhere."""
    contexts, windows = [], []

    def open_window(server, size=(1280, 800), context=None, wait=True):
        if context is None:
            context = chromium.new_context(viewport=dict(zip(("width", "height"), size, strict=True)))
            contexts.append(context)
        windows.append(Window(context.new_page(), server))
        if wait:
            windows[-1].wait_for_frame()
        return windows[-1]

    yield open_window
    for context in contexts:
        context.close()
    assert [error for one in windows for error in one.errors] == []
    assert [address for one in windows for address in one.requests if "//127.0.0.1:" not in address] == []
