"""The page of claims: what a user may rely on, the table of claims, and their figures."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from knitlab.figures.report.figures import draw_claims
from knitlab.figures.report.html import one_file
from knitlab.figures.report.introduction import introduction
from knitlab.figures.report.markdown import markdown
from knitlab.figures.report.table import Page, options_of, sections
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import Fault, fault
from knitlab.validation.judgement import Judgement, summary

SUFFIXES = (".md", ".html")
TITLE = "The paper's claims"


def check_suffix(page: Path) -> None:
    """Check the format of a page.

    Raises:
        BadInput: if its suffix is of no known format.
    """
    if page.suffix.lower() not in SUFFIXES:
        raise fault(f"output {page}", f"has no suffix of {', '.join(SUFFIXES)}; give one")


def write_page(
    judgements: Sequence[Judgement], page: Path, selections: Mapping[str, Any] = {}
) -> tuple[list[Path], list[Fault]]:
    """Write the claims as a page.

    An HTML page is one file with embedded figures; those of a Markdown page are in a folder beside
    it.

    Args:
        judgements: the claims and their verdicts.
        page: file to write, Markdown or HTML by its suffix.
        selections: values of the coordinates that the cubes were sliced by.

    Returns:
        The files, and why some figures could not be drawn.

    Raises:
        BadInput: if the suffix is of no known format.
    """
    check_suffix(page)
    options = options_of(judgements)
    table = sections(judgements, options)
    content = Page(TITLE, summary(judgements), introduction(judgements), table, options)
    if page.suffix.lower() == ".md":
        folder = page.with_suffix("")
        figures, faults = draw_claims(judgements, folder, selections)
        links = {key: f"{folder.name}/{path.name}" for key, path in figures.items()}
        _write(page, markdown(content, links))
        return [page, *figures.values()], faults
    with TemporaryDirectory() as drawn:
        figures, faults = draw_claims(judgements, Path(drawn), selections)
        _write(page, one_file(content, figures))
    return [page], faults


def _write(page: Path, text: str) -> None:
    with atomic_write(page) as temporary:
        temporary.write_text(text, encoding="utf-8")
