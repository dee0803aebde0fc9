"""The page: content, styles and modules as one HTML file that asks for nothing else.

The modules of ``page/`` are put into an import map as data, so that they import each other by name
from a file as well. A content security policy allows no request, and no script but these.
"""

import base64
import hashlib
import html
import json
from importlib.resources import files
from typing import Any

Content = dict[str, Any]
"""What a page shows, as JSON can hold it."""
PREFIX = "explorer/"
"""What the names of modules begin with in their imports."""
START = "main"
TEMPLATE = "page.html"
STYLES = ("theme.css", "layout.css", "views.css", "tables.css", "narrow.css")
"""In the order in which they apply."""


def page_of(title: str, content: Content) -> str:
    """Write the page.

    Args:
        title: its title.
        content: what it shows, see :func:`knitlab.explorer.explorer.content_of`.
    """
    imports = json.dumps({"imports": _modules()})
    start = f'import "{PREFIX}{START}";'
    styles = "".join(map(_text, STYLES))
    policy = "; ".join(
        [
            "default-src 'none'",
            f"script-src {_hash(imports)} {_hash(start)} data:",
            f"style-src {_hash(styles)}",
            "img-src data:",
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )
    parts = {
        "policy": html.escape(policy),
        "title": html.escape(title),
        "styles": styles,
        "imports": imports,
        "content": as_script_data(content),
        "start": start,
    }
    text = _text(TEMPLATE)
    # Split first: what is put in is never searched for places itself.
    pieces = text.split("{{")
    filled = [pieces[0]]
    for piece in pieces[1:]:
        name, rest = piece.split("}}", 1)
        filled += [parts[name], rest]
    return "".join(filled)


def as_script_data(content: Any) -> str:
    """JSON that can stand within ``<script>``: no text of it can end the element.

    Args:
        content: what JSON can hold; NaN is refused.
    """
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _modules() -> dict[str, str]:
    """The modules as data, by the names that they import each other by."""
    found = sorted(
        (file for file in files("knitlab.explorer").joinpath("page").iterdir()),
        key=lambda file: file.name,
    )
    return {
        f"{PREFIX}{file.name.removesuffix('.js')}": "data:text/javascript;base64,"
        + base64.b64encode(file.read_bytes()).decode("ascii")
        for file in found
        if file.name.endswith(".js")
    }


def _text(name: str) -> str:
    return files("knitlab.explorer").joinpath("page", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode("utf-8")).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"
