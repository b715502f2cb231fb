"""Bundling of the page's JavaScript modules into one script, and of all its parts into one HTML file.

The JavaScript modules of `fieldcalib.web` use only these forms: ``import { a, b as c } from "./other.js";``, and
``export`` before a function, a class or a constant. Each module becomes a function that is called once and returns its
exports.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Mapping
from hashlib import sha256
from html import escape
from pathlib import Path
from typing import Any

from fieldcalib.io.files import escaped

STATIC = Path(__file__).with_name("static")
IMPORT = re.compile(r'^import\s*\{([^}]*)\}\s*from\s*"\./([\w-]+)\.js";', re.MULTILINE)
EXPORT = re.compile(r"^export (?=(?:async )?(?:function\*?|class|const|let) +(\w+))", re.MULTILINE)
PICTURE = re.compile(r'url\("([\w-]+\.svg)"\)')
OTHER = re.compile(r"^(?:import|export)\b.*|\bimport\(.*", re.MULTILINE)

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="referrer" content="no-referrer">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{title}</title>
<link rel="icon" href="{icon}">
<style>
{style}
</style>
</head>
<body>
{data}
<script>{script}</script>
</body>
</html>
"""


def bundled(entry: str) -> str:
    """Bundle a module of the page, and the modules that it imports, into one script.

    Raises
    ------
    ValueError
        If a module imports or exports in another form, or modules import each other in a circle.
    """
    parts: dict[str, str] = {}
    _add(entry, parts, ())
    return '"use strict";\n' + "\n".join(parts.values())


def _add(name: str, parts: dict[str, str], importers: tuple[str, ...]) -> None:
    """Add a module after the modules that it imports."""
    if name in importers:
        raise ValueError(f"modules import each other: {' -> '.join((*importers, name))}")
    if name in parts:
        return
    source = (STATIC / f"{name}.js").read_text(encoding="utf-8")
    for found in IMPORT.finditer(source):
        _add(found[2], parts, (*importers, name))
    exported = ", ".join(found[1] for found in EXPORT.finditer(source))
    body = EXPORT.sub("", IMPORT.sub(_taken, source))
    if other := OTHER.search(body):
        raise ValueError(f"{name}.js: expected import {{ }} from and export of declarations, got {other[0]!r}")
    parts[name] = f"const {_variable(name)} = (() => {{\n{body}\nreturn {{ {exported} }};\n}})();"


def _taken(found: re.Match[str]) -> str:
    names = re.sub(r"(\w+)\s+as\s+(\w+)", r"\1: \2", found[1].strip())
    return f"const {{ {names} }} = {_variable(found[2])};"


def styles(*names: str) -> str:
    """Join style sheets of the page, with their pictures inlined."""
    text = "\n".join((STATIC / f"{name}.css").read_text(encoding="utf-8") for name in names)
    return PICTURE.sub(lambda found: f'url("{_inlined(found[1])}")', text)


def _inlined(svg: str) -> str:
    content = base64.b64encode((STATIC / svg).read_bytes()).decode()
    return f"data:image/svg+xml;base64,{content}"


def _variable(module: str) -> str:
    return f"module_{module.replace('-', '_')}"


def one_file(title: str, style: str, script: str, data: Mapping[str, Any]) -> str:
    """Make an HTML file that contains its style, script and data, and may fetch nothing.

    Parameters
    ----------
    title : str
    style, script : str
        CSS and JavaScript.
    data : mapping of str to JSON
        Values by the ids of the HTML elements from which the script reads them.

    Examples
    --------
    >>> '<script type="application/json" id="data">["\\\\u003c/b>"]' in one_file("Title", "", "", {"data": ["</b>"]})
    True
    """
    script = "\n" + script.strip("\n").replace("</script", "<\\/script").replace("<!--", "<\\!--") + "\n"
    digest = base64.b64encode(sha256(script.encode()).digest()).decode()
    policy = (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; img-src data: blob:; "
        f"base-uri 'none'; form-action 'none'"
    )
    elements = [f'<script type="application/json" id="{id}">{as_json(value)}</script>' for id, value in data.items()]
    return PAGE.format(
        policy=policy,
        title=escape(escaped(title)),
        icon=_inlined("icon.svg"),
        style=style.replace("</", "<\\/"),
        data="\n".join(elements),
        script=script,
    )


def as_json(value: Any) -> str:
    """Format JSON so that it may stand in HTML: no tag and no comment can begin in it."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
