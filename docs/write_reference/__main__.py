"""Write the pages of the reference from the code: ``python docs/write_reference [FOLDER]``.

What stands above ``MARKER`` on a page of ``docs/reference`` is kept, the rest is written.
"""

import sys
from pathlib import Path

import command_line
import figures
import python_names
import settings
import variables

PAGES = {
    "command_line": command_line.page,
    "figures": figures.page,
    "python": python_names.page,
    "settings": settings.page,
    "variables": variables.page,
}
REFERENCE = Path(__file__).parents[1] / "reference"
MARKER = "<!-- Below this line, python docs/write_reference writes this page. -->"


def write(folder: Path) -> None:
    """Write every page into a folder."""
    for name, page in PAGES.items():
        own = (REFERENCE / f"{name}.md").read_text(encoding="utf-8").split(MARKER)[0]
        text = f"{own}{MARKER}\n\n{page().rstrip()}\n"
        (folder / f"{name}.md").write_text(text, encoding="utf-8", newline="\n")


write(Path(sys.argv[1]) if len(sys.argv) > 1 else REFERENCE)
