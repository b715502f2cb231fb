"""Odd calls of everything public, made from the signatures: each works, or says in words of its own what is wrong."""

import signal
import warnings
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from odd_calls import LIMIT, NOT_CALLED, ODD, is_told, right_arguments, right_calls

import fieldcalib
from fieldcalib import Editor, Tracker
from fieldcalib.fields import field_named

# What is right, but for what it is called of: pictures that are no clip, an editor without a folder, no file.
TOLD = {
    "Editor.keep": "expected a folder to save to",
    "Editor.next_to_mend": "expected a clip",
    "Editor.save": "expected a folder to save to",
    "Editor.save_labels": "expected a folder to save to",
    "Editor.set_cuts": "expected a clip",
    "Editor.solve": "expected a clip",
    "Editor.undo_keep": "expected a solution that was kept last",
    "Editor.with_marks_of": "has no marks to copy|no background in common",
    "read": "none does not exist",
    "io.read_annotations": "none.json does not exist",
}
VALUES = st.one_of(
    st.sampled_from(range(len(ODD))).map(ODD.__getitem__), st.floats(), st.integers(), st.text(max_size=4)
)


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path_factory, monkeypatch):
    monkeypatch.chdir(tmp_path_factory.mktemp("empty"))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # names that are private now are called too
def test_right_calls_work():
    """Otherwise odd ones would be refused for another reason."""
    calls = right_calls()
    assert {"calibrate", "Camera.project", "draw.draw_field", "metrics.iou_part"} <= set(calls)
    public = {name for name in dir(fieldcalib) if callable(getattr(fieldcalib, name)) and not name.startswith("_")}
    assert public - NOT_CALLED <= set(calls)
    for name, call in calls.items():
        if name in TOLD:
            with pytest.raises((ValueError, OSError), match=TOLD[name]):
                call()
        else:
            call()


@contextmanager
def limited(seconds):
    """End the block with a TimeoutError if it takes longer."""

    def late(*_):
        raise TimeoutError(f"more than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def told_or_made(call, replaced):
    """Make a call with some arguments replaced; raises what it raises, unless the library tells it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # that the library tells
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            with limited(LIMIT):
                made = call(**replaced)
            if isinstance(made, Tracker | Editor):
                made.close()
        except Exception as error:
            if not is_told(error):
                error.add_note(f"{call.function.__qualname__} with {replaced}")
                raise


def odd_call(data):
    """Make one odd call."""
    calls = right_calls()
    name = data.draw(st.sampled_from(sorted(name for name in calls if calls[name].parameters)), "function")
    names = data.draw(st.lists(st.sampled_from(calls[name].parameters), min_size=1, max_size=2, unique=True), "which")
    replaced = {parameter: data.draw(value_of(parameter), parameter) for parameter in names}
    told_or_made(calls[name], replaced)


def value_of(parameter):
    """Odd values of a parameter, and a right one where one is known: of an option, it leads further into the call."""
    known = right_arguments()
    return st.one_of(VALUES, st.just(known[parameter])) if parameter in known else VALUES


ODDLY = settings(suppress_health_check=[HealthCheck.too_slow], deadline=None)


@ODDLY
@given(st.data())
def test_odd_calls_are_told(data):
    odd_call(data)


@pytest.mark.slow
@settings(ODDLY, max_examples=2000)
@given(st.data())
def test_two_thousand_odd_calls_are_told(data):
    odd_call(data)


PLAIN = (
    None,
    -1,
    np.inf,
    1j,
    "a",
    [],
    [None],
    np.zeros((2, 2, 2)),
    np.array("a"),
    object(),
    {"a": 1},
    10**30,
    (1.5, 2),
)


@pytest.mark.slow
def test_each_argument_by_itself_is_told():
    for call in right_calls().values():
        for parameter in call.parameters:
            for value in PLAIN:
                told_or_made(call, {parameter: value})


def test_what_is_not_told_is_found():
    with pytest.raises(ValueError, match="none") as told:
        field_named("none")
    with pytest.raises(ValueError, match="none") as untold:
        int("none")
    assert is_told(told.value)
    assert not is_told(untold.value)
