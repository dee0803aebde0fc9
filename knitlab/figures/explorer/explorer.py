"""The explorer of cubes: content, styles and modules as one HTML file that asks for nothing else.

An import map holds the modules of ``page/``, and a content security policy allows no request.
"""

import base64
import hashlib
import html
import json
import re
from collections import Counter
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.colors import to_hex

from knitlab.cubes.normalised import naming_missing
from knitlab.figures.explorer.cube_content import cube_content
from knitlab.figures.style import SEQUENCE_COLOURS, STRAIN_COLOURS
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import invalid
from knitlab.io.names import check_suffix
from knitlab.observables.status import Status

PAGE = files("knitlab.figures.explorer").joinpath("page")
PREFIX = "explorer/"  # what the names of modules begin with in their imports
STYLES = ("theme.css", "layout.css", "views.css", "tables.css", "narrow.css")
"""In the order in which they apply."""
COLOUR_MAPS = {
    "sequence": mpl.colormaps[SEQUENCE_COLOURS],
    "signed": STRAIN_COLOURS,
}
"""Of numbers of one sign and of both, as in all figures."""
SHADES = 33


def write_explorer(cubes: Sequence[xr.Dataset], output: Path) -> Path:
    """Write the explorer of cubes, an ``.html`` file that opens in a browser without a network."""
    check_suffix(output, (".html",), "a page")
    if not cubes:
        raise invalid("cubes", "are missing; give one or several")
    with naming_missing("pages", cubes):
        described = [cube_content(cube) for cube in cubes]
    names = ", ".join(dict.fromkeys(cube["name"] for cube in described))
    # Links name a cube: those of the same name are numbered.
    seen: Counter[str] = Counter()
    for cube in described:
        name = cube["name"]
        seen[name] += 1
        if seen[name] > 1:
            cube["name"] = f"{name} ({seen[name]})"
    content = {
        "statuses": [status.name.replace("_", " ") for status in Status],
        "colours": colour_maps(),
        "cubes": described,
    }
    with atomic_write(output) as temporary:
        temporary.write_text(page_text(f"knitlab explorer: {names}", content), encoding="utf-8")
    return output


def colour_maps() -> dict[str, list[str]]:
    """Colours as ``#rrggbb``, from the lowest value to the highest, by the name of their map."""
    levels = np.linspace(0, 1, SHADES)
    return {name: list(map(to_hex, colours(levels))) for name, colours in COLOUR_MAPS.items()}


def page_text(title: str, content: dict[str, Any]) -> str:
    """The page with a title and a content that JSON can hold."""
    modules = {
        f"{PREFIX}{file.name.removesuffix('.js')}": "data:text/javascript;base64,"
        + base64.b64encode(file.read_bytes()).decode("ascii")
        for file in sorted(PAGE.iterdir(), key=lambda file: file.name)
        if file.name.endswith(".js")
    }
    imports = json.dumps({"imports": modules})
    start = f'import "{PREFIX}main";'
    styles = "".join(map(_text, STYLES))
    policy = (
        f"default-src 'none'; script-src {_hash(imports)} {_hash(start)} data:;"
        f" style-src {_hash(styles)}; img-src data:; base-uri 'none'; form-action 'none'"
    )
    contents = {
        "policy": html.escape(policy),
        "title": html.escape(title),
        "styles": styles,
        "imports": imports,
        "content": as_script_data(content),
        "start": start,
    }
    return re.sub(r"{{(\w+)}}", lambda named: contents[named[1]], _text("page.html"))


def as_script_data(content: Any) -> str:
    """JSON that can stand within ``<script>``: no text of it can end the element. No NaN."""
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _text(name: str) -> str:
    return PAGE.joinpath(name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode("utf-8")).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"
