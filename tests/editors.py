"""Editors for tests, which are closed after each, and labels to set in them."""

import numpy as np
import pytest

from fieldcalib import Camera, Editor, soccer

SIZE = (960, 540)
CENTRE = (0.0, 68.0, -17.0)
TRUTH = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, CENTRE, SIZE)
PANNED = Camera.from_angles(-0.27, 1.352, 0.0, 1620.0, CENTRE, SIZE)
LINES = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top")
BLANK = np.zeros((54, 96, 3), np.uint8)


def ends(label, camera=TRUTH):
    xy = camera.project(soccer()[label].sample(1.0))
    return xy[((xy > 5.0) & (xy < (955.0, 535.0))).all(axis=1)][[0, -1]]


OPENED = []


@pytest.fixture(autouse=True)
def _close_editors():
    yield
    while OPENED:
        OPENED.pop().close()


def edited(*arguments, **options):
    """An editor, which is closed after the test."""
    OPENED.append(Editor(*arguments, **options))
    return OPENED[-1]


def marked(editor, count, number=0):
    for k in range(count):
        editor[number] = editor[number].mark("Net top", (float(k), 1.0), snap=False)
    return editor


def opened(path, out):
    return edited(path, "tennis", out=out)


def labelled(editor, number=0, camera=TRUTH):
    editor[number] = editor.begun(number).clear()
    for label in LINES:
        editor[number] = editor[number].mark(label, ends(label, camera))
    return editor
