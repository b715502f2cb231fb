"""The commands of the benchmarks: those of the page are among them, and what they print is kept."""

import re
from pathlib import Path

from data_tools import benchmarks

PAGE = Path(__file__).parents[2] / "docs/benchmarks.md"
TOOL = re.compile(r"^    python -m ((?:baselines|data_tools)\.\w+(?: [a-z]+\b(?!\|))?)", re.MULTILINE)


def test_the_commands_of_the_page_are_among_them():
    of_the_page = set(TOOL.findall(PAGE.read_text())) - {"data_tools.probability fit"}  # which prints coefficients
    texts = "\n".join(command for _, command in benchmarks.commands())
    assert len(of_the_page) > 30
    assert {tool for tool in of_the_page if tool not in texts} == set()
    names = [name for name, _ in benchmarks.commands()]
    assert len(set(names)) == len(names)


def test_what_a_command_prints_is_kept_and_a_failed_one_is_run_again(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(benchmarks, "COMMANDS", "say-WORD: echo WORD INDEX in $MADE\nbroken: echo no && exit 3\n")
    monkeypatch.setattr(benchmarks, "EACH", {"WORD": "one two"})
    assert benchmarks.main([str(tmp_path), "--data", str(tmp_path)]) == 1
    assert {path.name: path.read_text() for path in tmp_path.glob("*.txt")} == {
        "say-one.txt": "one 0 in MADE\n",
        "say-two.txt": "two 1 in MADE\n",
    }
    assert capfd.readouterr().out.split("\n")[2] == "broken: failed, 0 s"
    monkeypatch.setattr(benchmarks, "COMMANDS", "say-WORD: echo again\nother: exit 1")
    assert benchmarks.main([str(tmp_path), "say"]) == 0
    assert (tmp_path / "say-two.txt").read_text() == "two 1 in MADE\n"
    assert capfd.readouterr().out == ""


def test_a_word_of_no_name_and_a_folder_that_is_not_there_are_told(tmp_path, capsys):
    assert benchmarks.main([str(tmp_path), "nosuch", "--data", str(tmp_path)]) == 2
    assert "no command has 'nosuch' in its name" in capsys.readouterr().err
    assert benchmarks.main([str(tmp_path / "out"), "tables", "--data", str(tmp_path / "none")]) == 2
    assert "none is no folder" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
