"""What the README shows must run and say what it says there."""

import re
from pathlib import Path

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_the_example_runs_and_prints_what_is_written_beside_it(capsys):
    code, questions = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    names = {}
    exec(compile(code, "README.md", "exec"), names)
    for question in questions.splitlines():
        eval(question.split("  #")[0], names)
    assert round(names["calibration"].probability(), 2) == float(re.findall(r"# (0\.\d+): that no point", questions)[0])
    printed = capsys.readouterr().out.splitlines()
    (promised,) = re.findall(r"# (accepted rms .*)", code)
    assert printed[0] == promised
    assert printed[1].startswith("Camera(f=2")
    assert printed[2].startswith("[19.7")


def test_links_point_to_files():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert (Path(__file__).parents[1] / target).is_file(), target
