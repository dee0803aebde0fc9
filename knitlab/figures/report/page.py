"""The page of claims, as Markdown or HTML, with its figures."""

import base64
import html
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from knitlab.figures.drawing import draw_figure
from knitlab.figures.report.content import (
    EXPLAINED,
    FIGURE,
    HEADINGS,
    cube_name,
    introduction,
    letters_of_options,
    row,
)
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import BadInput, Fault, fault
from knitlab.validation.judgement import Judgement, summary

SUFFIXES = (".md", ".html")
TITLE = "The paper's claims"
STYLE = """
body { font: 15px/1.4 sans-serif; margin: 2em auto; max-width: 90em; padding: 0 1em; }
p, ul { max-width: 60em; } table { border-collapse: collapse; } img { max-width: 100%; }
td, th { padding: .3em .6em; text-align: left; vertical-align: top; border-bottom: 1px solid #ccc; }
td:first-child { font-weight: bold; white-space: nowrap; }
.holds td:first-child { color: #00664b; } .fails td:first-child { color: #a63603; }
.near-miss td:first-child { color: #8a6100; }
"""
Key = tuple[str | None, tuple[Path, ...]]
"""Kind of figure and cubes, which identify the figure of a claim."""


class Format(NamedTuple):
    """How the parts of a page are written; all but ``text`` take what is already written.

    Attributes:
        text: plain text.
        strong: emphasis.
        heading: a heading of a level.
        paragraph: a paragraph.
        items: a list.
        link: a link to a target.
        table: a table of a class, of a head and rows of cells.
    """

    text: Callable[[str], str]
    strong: Callable[[str], str]
    heading: Callable[[int, str], str]
    paragraph: Callable[[str], str]
    items: Callable[[Sequence[str]], str]
    link: Callable[[str, str], str]
    table: Callable[[str, Sequence[Sequence[str]]], str]


def _markdown_table(_: str, rows: Sequence[Sequence[str]]) -> str:
    lines = [" | ".join(cell.replace("|", "\\|") for cell in cells) for cells in rows]
    head, *body = (f"| {line} |" for line in lines)
    return "\n".join([head, f"|{'---|' * len(rows[0])}", *body])


def _html_table(name: str, rows: Sequence[Sequence[str]]) -> str:
    head, *body = rows
    lines = [f"<tr>{''.join(f'<th>{cell}</th>' for cell in head)}</tr>"]
    lines += [f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>" for cells in body]
    return f'<table class="{name}">{chr(10).join(lines)}</table>'


MARKDOWN = Format(
    text=str,
    strong=lambda text: f"**{text}**",
    heading=lambda level, text: f"{'#' * level} {text}",
    paragraph=str,
    items=lambda items: "\n".join(f"- {item}" for item in items),
    link=lambda text, target: f"[{text}]({target})",
    table=_markdown_table,
)
HTML = Format(
    text=html.escape,
    strong=lambda text: f"<b>{text}</b>",
    heading=lambda level, text: f"<h{level}>{text}</h{level}>",
    paragraph=lambda text: f"<p>{text}</p>",
    items=lambda items: f"<ul>{''.join(f'<li>{item}</li>' for item in items)}</ul>",
    link=lambda text, target: f'<a href="{target}">{text}</a>',
    table=_html_table,
)


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
    if page.suffix.lower() == ".md":
        folder = page.with_suffix("")
        figures, faults = _draw_figures(judgements, folder, selections)
        links = {key: f"{folder.name}/{path.name}" for key, path in figures.items()}
        _write(page, "\n\n".join(_parts(judgements, MARKDOWN, links)) + "\n")
        return [page, *figures.values()], faults
    with TemporaryDirectory() as drawn:
        figures, faults = _draw_figures(judgements, Path(drawn), selections)
        links = {key: f"#figure-{number}" for number, key in enumerate(figures, start=1)}
        parts = [*_parts(judgements, HTML, links), *(["<h2>Figures</h2>"] if figures else [])]
        parts += [_embedded(key, links[key], path) for key, path in figures.items()]
        head = f'<meta charset="utf-8"><title>{TITLE}</title><style>{STYLE}</style>'
        body = "\n".join(parts)
        _write(page, f'<!doctype html><html lang="en">{head}\n{body}\n</html>\n')
    return [page], faults


def _write(page: Path, text: str) -> None:
    with atomic_write(page) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _parts(judgements: Sequence[Judgement], form: Format, links: Mapping[Key, str]) -> list[str]:
    """The parts of a page from its title to its last table, with links to figures."""
    letters = letters_of_options(judgements)
    parts = [form.heading(1, form.text(TITLE)), form.paragraph(form.text(summary(judgements)))]
    parts.append(form.heading(2, "What you may rely on, and what not"))
    parts.append(form.paragraph(form.text(EXPLAINED)))
    for topic, sentences in introduction(judgements).items():
        parts.append(form.heading(3, form.text(topic.capitalize())))
        items = [f"{form.strong(f'{opening}:')} {form.text(said)}" for opening, said in sentences]
        parts.append(form.items(items))
    for grade, heading in HEADINGS.items():
        rows: list[list[str]] = []
        for one in judgements:
            if one.result.grade is grade:
                cells = {name: form.text(text) for name, text in row(one, letters).items()}
                link = links.get(_key(one))
                cells[FIGURE] = form.link(cells[FIGURE], link) if link else ""
                rows = rows or [list(cells)]
                rows.append(list(cells.values()))
        if rows:
            parts.append(form.heading(2, form.text(heading)))
            parts.append(form.table(grade.value.replace(" ", "-"), rows))
    if letters:
        parts.append(form.heading(2, "Model options"))
        items = [f"{letter}: {form.text(text)}" for text, letter in letters.items()]
        parts.append(form.items(items))
    return parts


def _key(one: Judgement) -> Key:
    return one.claim.statement.figure, one.cubes


def _draw_figures(
    judgements: Sequence[Judgement], folder: Path, selections: Mapping[str, Any]
) -> tuple[dict[Key, Path], list[Fault]]:
    """Draw the figures of all claims that were measured, each once for its cubes.

    Returns the files, and why some figures could not be drawn.
    """
    files: dict[Key, Path] = {}
    faults: list[Fault] = []
    keys = [_key(one) for one in judgements if one.result.margin is not None]
    for kind, cubes in dict.fromkeys(keys):
        if not kind:
            continue
        label = cube_name(cubes[0]).replace("/", "-")
        name = f"{label}-{kind}.png" if len(cubes) == 1 else f"{kind}.png"
        try:
            files[kind, cubes] = draw_figure(kind, cubes, folder / name, selections)
        except BadInput as error:
            faults += [Fault(f"figure {kind}", entry.problem) for entry in error.faults]
    return files, faults


def _embedded(key: Key, link: str, path: Path) -> str:
    """A figure within an HTML page."""
    kind, cubes = key
    caption = html.escape(f"{kind}: {', '.join(map(cube_name, cubes))}")
    content = base64.b64encode(path.read_bytes()).decode("ascii")
    return (
        f'<figure id="{link.removeprefix("#")}"><figcaption>{caption}</figcaption>'
        f'<img alt="{caption}" src="data:image/png;base64,{content}"></figure>'
    )
