"""Writing the explorer of cubes into a file."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import xarray as xr

from knitlab.cube.schema import Status
from knitlab.explorer.colours import colour_maps
from knitlab.explorer.cube_content import cube_content
from knitlab.explorer.page import Content, page_of
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import fault

SUFFIX = ".html"


def check_suffix(output: Path) -> None:
    """Check the format of an explorer.

    Raises:
        BadInput: if its suffix is not ``.html``.
    """
    if output.suffix.lower() != SUFFIX:
        raise fault(f"output {output}", f"is not a page; give it the suffix {SUFFIX}")


def content_of(cubes: Sequence[xr.Dataset]) -> Content:
    """What the page of cubes shows, as JSON can hold it."""
    described = [cube_content(cube) for cube in cubes]
    _tell_apart(described)
    return {
        "statuses": [status.name.replace("_", " ") for status in Status],
        "colours": colour_maps(),
        "cubes": described,
    }


def _tell_apart(cubes: Sequence[Content]) -> None:
    """Number the cubes that have the same name, for links name a cube."""
    seen: Counter[str] = Counter()
    for cube in cubes:
        name = cube["name"]
        seen[name] += 1
        if seen[name] > 1:
            cube["name"] = f"{name} ({seen[name]})"


def write_explorer(cubes: Sequence[xr.Dataset], output: Path) -> Path:
    """Write the explorer of cubes: one file that opens in a browser without a network.

    Args:
        cubes: the cubes.
        output: the file, with the suffix ``.html``.

    Returns:
        The file.

    Raises:
        BadInput: if there is no cube, or the suffix is another one.
        CannotWrite: if the file cannot be written.
    """
    check_suffix(output)
    if not cubes:
        raise fault("cubes", "are missing; give one or several")
    content = content_of(cubes)
    names = ", ".join(dict.fromkeys(each["name"] for each in content["cubes"]))
    with atomic_write(output) as temporary:
        temporary.write_text(page_of(f"knitlab explorer: {names}", content), encoding="utf-8")
    return output
