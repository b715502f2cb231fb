"""How the site is built: ``python -m sphinx -W docs docs/_build``, with the extra ``docs`` and without a network."""

import contextlib
import io
import json
import os
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # the checkout is documented, whatever is installed

import fieldcalib  # noqa: E402
from fieldcalib.cli.commands import COMMANDS, command_parser  # noqa: E402

# What the commands say of their options is part of the reference.
HELP = Path(__file__).parent / "reference" / "generated"
HELP.mkdir(exist_ok=True)
os.environ["COLUMNS"] = "96"
for command in COMMANDS:
    with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.suppress(SystemExit):
        command_parser([command]).parse_args([command, "--help"])
    (HELP / f"{command}.txt").write_text(said.getvalue(), encoding="utf-8")

# So are the keys of the files of results, from their schemas.
for schema in sorted((Path(__file__).parent / "schemas").glob("*.schema.json")):
    keys = json.loads(schema.read_text(encoding="utf-8")).get("properties", {})
    rows = [f"| `{key}` | {says.get('description', '').replace('|', chr(92) + '|')} |" for key, says in keys.items()]
    table = ["| key | meaning |", "|---|---|", *rows, ""]
    (HELP / schema.name.replace(".schema.json", ".inc")).write_text("\n".join(table), encoding="utf-8")

project = "fieldcalib"
author = "fieldcalib developers"
copyright = author
version = release = fieldcalib.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "sphinx_copybutton",
]
exclude_patterns = ["_build", "examples", "**/GALLERY_HEADER.rst"]
templates_path = ["_templates"]

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 4  # the anchors that GitHub gives to headings
highlight_language = "text"
copybutton_exclude = ".linenos, .gp, .go"

default_role = "autolink"  # `names` in docstrings are links, where they are names of this reference
autosummary_generate = True
autosummary_ignore_module_all = False
autodoc_typehints = "none"  # numpydoc's sections say types
autodoc_default_options = {"members": True, "member-order": "bysource"}
numpydoc_show_class_members = False  # the template of a class lists them

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",  # every example is executed
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_signature": False,
    "min_reported_time": 10**6,
    "abort_on_example_error": True,
    "write_computation_times": False,  # a page that loads scripts from elsewhere
    "remove_config_comments": True,
    "matplotlib_animations": False,
    "capture_repr": ("_repr_html_",),  # not what functions of matplotlib return
}

html_theme = "pydata_sphinx_theme"
html_title = "fieldcalib"
html_theme_options = {
    "header_links_before_dropdown": 7,
    "show_prev_next": False,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
}
html_context = {"default_mode": "auto"}
html_sidebars = {page: [] for page in ("index", "benchmarks", "rivals", "gallery/index")}  # without pages below them
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
