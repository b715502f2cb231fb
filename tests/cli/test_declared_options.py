"""Options of the command line that are declared as fields of dataclasses."""

import argparse
from dataclasses import dataclass

import pytest

from fieldcalib.console.options import add_options, given, option, switch


@dataclass(frozen=True)
class Options:
    folder: str
    width: float = option("metres", default=2.0, type=float, metavar="M")
    most: int | None = option("of them", name="--at-most", type=int)
    loud: bool = switch("say more", exclusive="voice")
    silent: bool = switch("say nothing", exclusive="voice")


def parsed(*arguments, names=()):
    parser = argparse.ArgumentParser()
    add_options(parser, Options, *names)
    return parser.parse_args(arguments)


def test_what_is_not_given_has_its_default():
    assert given(Options, parsed(), folder="here") == Options("here", 2.0, None, False, False)
    assert given(Options, parsed("--width", "3"), folder="here").width == 3.0


def test_an_option_can_have_another_name_than_its_field():
    assert vars(parsed("--at-most", "5"))["most"] == 5


def test_some_of_the_options_are_added():
    assert vars(parsed(names=("width", "loud"))) == {"width": 2.0, "loud": False}
    with pytest.raises(SystemExit):
        parsed("--silent", names=("width", "loud"))


def test_some_options_exclude_each_other(capsys):
    assert parsed("--loud").loud
    with pytest.raises(SystemExit):
        parsed("--loud", "--silent")
    assert "not allowed with argument --loud" in capsys.readouterr().err


def test_other_values_replace_those_of_the_command_line():
    options = argparse.Namespace(folder="there", width=1.0, unknown=3)
    assert given(Options, options) == Options("there", 1.0)
    assert given(Options, options, folder="here").folder == "here"
