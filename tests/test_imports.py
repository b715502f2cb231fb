"""Imports go down: every module of the package stands on a floor and imports from its own or from lower ones."""

import ast
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import fieldcalib

PACKAGE = Path(fieldcalib.__file__).parent
FACE = "fieldcalib"  # fieldcalib/__init__.py: what users import

FLOORS = {
    "_types": -1,
    "rotation": 0,
    "projective": 0,
    "distortion": 0,
    "field": 1,
    "image": 1,
    "camera": 1,
    "rational": 1,
    "homography": 1,
    "segments": 2,
    "parameters": 2,
    "losses": 2,
    "options": 3,
    "residuals": 3,
    "starts": 3,
    "solver": 4,
    "resection": 4,
    "ndc": 5,
    "result": 5,
    "verify": 5,
    "labels": 5,
    "ends": 5,
    "mirror": 5,
    "uncertainty": 5,
    "confidence": 5,
    "calibrate": 5,
    "calibrate_homography": 5,
    "calibrate_points": 5,
    "field_size": 5,
    # leaves, and the public face that names what they and the floors offer
    "metrics": 6,
    "render": 6,
    "draw": 6,
    "calibrate_images": 6,
    "localize": 6,
    "profiles": 6,
    "refine": 6,
    "hypotheses": 6,
    "io": 6,
    "demo": 6,
    "commands": 6,
    "cli": 6,
    "__main__": 6,
    FACE: 6,
}
FORBIDDEN = ("baselines", "data_tools", "tests")  # they import the package, never the reverse
HEAVY = ("cv2", "skimage", "onnxruntime", "scipy.optimize")  # imported by what needs them, when it runs


def modules_of(package):
    """Dotted name inside the package -> file; packages inside it go by their own name."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name or FACE] = path
    return found


def imported_names(path, module):
    """Absolute dotted names that a file imports, wherever in it: in functions and for type checkers too."""
    parts = [FACE, *module.split(".")] if module != FACE else [FACE]
    if path.name != "__init__.py":
        parts.pop()  # relative imports start at the package that holds the module
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = parts[: len(parts) - node.level + 1] if node.level else []
            base = ".".join([*base, *([node.module] if node.module else [])])
            yield from (f"{base}.{alias.name}" for alias in node.names)


def module_of(name, known):
    """The module of the package that a dotted name belongs to: the longest that is known."""
    parts = name.split(".")[1:]
    while parts and ".".join(parts) not in known:
        parts.pop()
    return ".".join(parts) or FACE


def violations(package):
    """What breaks the order, one sentence each."""
    modules = modules_of(package)
    known = set(modules) | set(FLOORS)
    found, level = [], {}
    for module, path in modules.items():
        floor = FLOORS.get(module.split(".")[0])
        if floor is None:
            found.append(f"{module} has no floor: add it to the table of tests/test_imports.py")
            continue
        level[module] = set()
        for name in imported_names(path, module):
            top = name.split(".")[0]
            if top in FORBIDDEN:
                found.append(f"{module} imports {top}")
            if top != FACE:
                continue
            other = module_of(name, known)
            other_floor = FLOORS.get(other.split(".")[0], floor)
            if other_floor > floor:
                found.append(f"{module} (floor {floor}) imports {other} (floor {other_floor})")
            elif other_floor == floor and other != module:
                level[module].add(other)
    try:
        TopologicalSorter(level).prepare()
    except CycleError as error:
        found.append(f"cycle: {' <- '.join(error.args[1])}")
    return found


def test_imports_go_down():
    assert violations(PACKAGE) == []


def test_every_module_below_the_leaves_is_seen():
    assert {"_types", "rotation", "camera", "segments", "residuals", "solver", FACE} <= set(modules_of(PACKAGE))


# the checker itself, on packages made up for it


def made_up(tmp_path, files):
    package = tmp_path / FACE
    for name, text in {"__init__.py": "", **files}.items():
        path = package / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return package


@pytest.mark.parametrize(
    "files",
    [
        {"camera.py": "import numpy as np\nfrom fieldcalib.rotation import f", "rotation.py": "import numpy"},
        {"camera.py": "from fieldcalib.field import f", "field.py": ""},
        {"camera.py": "from . import rotation\nfrom .rotation import f", "rotation.py": ""},
        {
            "io/__init__.py": "from fieldcalib.io.a import f",
            "io/a.py": "from fieldcalib.camera import Camera",
            "camera.py": "",
        },
        {"__init__.py": "from fieldcalib.camera import Camera", "camera.py": ""},
        {"cli.py": "from fieldcalib import __version__"},
    ],
    ids=["down", "same floor", "relative", "package", "face", "leaf"],
)
def test_checker_lets_good_packages_pass(tmp_path, files):
    assert violations(made_up(tmp_path, files)) == []


@pytest.mark.parametrize(
    ("files", "complaint"),
    [
        ({"camera.py": "from fieldcalib.residuals import f"}, "camera (floor 1) imports residuals (floor 3)"),
        ({"camera.py": "import fieldcalib.residuals"}, "camera (floor 1) imports residuals (floor 3)"),
        ({"camera.py": "from fieldcalib import residuals"}, "camera (floor 1) imports residuals (floor 3)"),
        ({"camera.py": "from .residuals import f"}, "camera (floor 1) imports residuals (floor 3)"),
        ({"camera.py": "from . import residuals"}, "camera (floor 1) imports residuals (floor 3)"),
        ({"camera.py": "def f():\n    from fieldcalib.io.x import g"}, "camera (floor 1) imports io (floor 6)"),
        ({"_types.py": "from fieldcalib.rotation import f"}, "_types (floor -1) imports rotation (floor 0)"),
        ({"camera.py": "from fieldcalib import Camera"}, "camera (floor 1) imports fieldcalib (floor 6)"),
        ({"camera.py": "import fieldcalib"}, "camera (floor 1) imports fieldcalib (floor 6)"),
        ({"camera.py": "import baselines.hdecomp"}, "camera imports baselines"),
        ({"io/x.py": "from data_tools import synthetic"}, "io.x imports data_tools"),
        ({"magic.py": ""}, "magic has no floor: add it to the table of tests/test_imports.py"),
        ({"camera.py": "import fieldcalib.field", "field.py": "import fieldcalib.camera"}, "cycle: "),
        ({"io/a.py": "from . import b", "io/b.py": "from .a import f"}, "cycle: "),
        ({"__init__.py": "from fieldcalib.cli import f", "cli.py": "from fieldcalib import g"}, "cycle: "),
    ],
)
def test_checker_catches_bad_packages(tmp_path, files, complaint):
    found = violations(made_up(tmp_path, files))
    assert len(found) == 1
    assert found[0].startswith(complaint)


# what `import fieldcalib` costs


def loaded_by(statement):
    """Which of the heavy modules a fresh interpreter has loaded after a statement."""
    code = f"import sys\n{statement}\nprint([name for name in {HEAVY!r} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PACKAGE.parent)
    return ast.literal_eval(run.stdout.splitlines()[-1])


def test_importing_the_package_loads_nothing_heavy():
    assert loaded_by("import fieldcalib") == []


def test_what_is_loaded_would_be_seen():
    assert loaded_by("import cv2, scipy.optimize") == ["cv2", "scipy.optimize"]
