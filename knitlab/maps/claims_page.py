"""The table of claims: as text, and as a Markdown or HTML page with the figures that show them."""

import html
from collections.abc import Callable, Sequence
from pathlib import Path

from knitlab.maps.claim_tests import Verdict
from knitlab.maps.claims import Judgement, counted, records
from knitlab.maps.figures import draw_figure
from knitlab.sweep.faults import BadInput, Fault, fault
from knitlab.sweep.files import written_whole

SUFFIXES = (".md", ".html")
COLUMNS = {
    "verdict": "verdict",
    "text": "what the paper says",
    "place": "where",
    "measured": "what was measured",
    "figure": "figure",
}
TITLE = "The paper's claims"


def listed(judgements: Sequence[Judgement]) -> str:
    """The table for a terminal: verdict, claim and figures, and how many hold."""
    lines = [
        f"{its['verdict']:12}  {its['claim']}: {its['measured']}" for its in records(judgements)
    ]
    return "\n".join([*lines, summary(judgements)])


def summary(judgements: Sequence[Judgement]) -> str:
    """How many claims hold, fail and are not measured."""
    return ", ".join(f"{count} {verdict}" for verdict, count in counted(judgements).items())


def check_suffix(page: Path) -> None:
    """Refuse a page that is of no known format.

    Raises:
        BadInput: if its suffix is of none.
    """
    if page.suffix.lower() not in SUFFIXES:
        raise fault(f"-o {page}", f"has no suffix of {', '.join(SUFFIXES)}; give one")


def write_page(
    judgements: Sequence[Judgement], page: Path, selections: Sequence[str] = ()
) -> tuple[list[Path], list[Fault]]:
    """Write the table as a page, its figures in a folder beside it.

    Args:
        judgements: the claims and what was found.
        page: file to write, Markdown or HTML by its suffix.
        selections: texts ``NAME=VALUE`` that the cubes were sliced by.

    Returns:
        The files, and why a figure could not be drawn.

    Raises:
        BadInput: if the suffix is of neither.
    """
    check_suffix(page)
    folder = page.with_suffix("")
    files: list[Path] = []
    faults: list[Fault] = []
    links: dict[tuple[str | None, tuple[Path, ...]], str] = {}
    for its in judgements:
        kind, key = its.claim.words.figure, (its.claim.words.figure, its.cubes)
        if not kind or its.finding.verdict is Verdict.not_measured or key in links:
            continue
        label = "-".join(its.cubes[0].parts[-2:]).removesuffix(".nc")
        output = folder / (f"{label}-{kind}.png" if len(its.cubes) == 1 else f"{kind}.png")
        try:
            files.append(draw_figure(kind, its.cubes, output, selections))
        except BadInput as error:
            faults += [Fault(f"figure {kind}", entry.problem) for entry in error.faults]
        else:
            links[key] = f"{folder.name}/{output.name}"
    rows = [
        row | {"link": links.get((its.claim.words.figure, its.cubes), "")}
        for its, row in zip(judgements, records(judgements), strict=True)
    ]
    write = _markdown if page.suffix.lower() == ".md" else _html
    with written_whole(page) as temporary:
        temporary.write_text(write(rows, summary(judgements)), encoding="utf-8")
    return [page, *files], faults


Row = dict[str, str]


def _markdown(rows: Sequence[Row], said: str) -> str:
    def linked(row: Row) -> str:
        return f"[{row['figure']}]({row['link']})" if row["link"] else ""

    head = [f"# {TITLE}", "", said, "", *_table_head()]
    return "\n".join([*head, *(_cells(row, linked, _bar) for row in rows), ""])


def _table_head() -> list[str]:
    return [f"| {' | '.join(COLUMNS.values())} |", f"|{'---|' * len(COLUMNS)}"]


def _bar(text: str) -> str:
    return text.replace("|", "\\|")


def _cells(row: Row, linked: Callable[[Row], str], escaped: Callable[[str], str]) -> str:
    texts = [linked(row) if name == "figure" else escaped(row[name]) for name in COLUMNS]
    return f"| {' | '.join(texts)} |"


STYLE = """
body { font: 15px/1.4 sans-serif; margin: 2em auto; max-width: 75em; }
table { border-collapse: collapse; } td, th { padding: .3em .6em; text-align: left;
vertical-align: top; border-bottom: 1px solid #ccc; }
.holds { color: #00664b; font-weight: bold; } .fails { color: #a63603; font-weight: bold; }
"""


def _html(rows: Sequence[Row], said: str) -> str:
    head = "".join(f"<th>{name}</th>" for name in COLUMNS.values())
    lines = []
    for row in rows:
        cells = [
            f'<td class="{html.escape(row[name])}">{html.escape(row[name])}</td>'
            for name in COLUMNS
            if name != "figure"
        ]
        link = f'<a href="{html.escape(row["link"])}">{html.escape(row["figure"])}</a>'
        lines.append(f"<tr>{''.join(cells)}<td>{link if row['link'] else ''}</td></tr>")
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{TITLE}</title>'
        f"<style>{STYLE}</style><h1>{TITLE}</h1><p>{html.escape(said)}</p>"
        f"<table><tr>{head}</tr>\n{chr(10).join(lines)}\n</table></html>\n"
    )
