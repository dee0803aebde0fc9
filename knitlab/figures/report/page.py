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
    """How the parts of a page are written: plain text, a link, a table, and marked text.

    Marks are the tags of HTML: h1 to h3, p, b and ul, of which the text has one item on each line.
    """

    text: Callable[[str], str]
    marked: Callable[[str, str], str]
    link: Callable[[str, str], str]
    table: Callable[[str, list[list[str]]], str]


def _marked_in_markdown(tag: str, text: str) -> str:
    if tag == "b":
        return f"**{text}**"
    opening = {"p": "", "ul": "- ", "h1": "# ", "h2": "## ", "h3": "### "}[tag]
    return "\n".join(f"{opening}{line}" for line in text.splitlines())


def _marked_in_html(tag: str, text: str) -> str:
    if tag == "ul":
        text = "".join(f"<li>{item}</li>" for item in text.splitlines())
    return f"<{tag}>{text}</{tag}>"


def _markdown_table(_: str, rows: list[list[str]]) -> str:
    lines = [" | ".join(cell.replace("|", "\\|") for cell in cells) for cells in rows]
    head, *body = (f"| {line} |" for line in lines)
    return "\n".join([head, f"|{'---|' * len(rows[0])}", *body])


def _html_table(name: str, rows: list[list[str]]) -> str:
    lines = ["<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>" for cells in rows]
    lines[0] = lines[0].replace("td>", "th>")
    return "\n".join([f'<table class="{name}">', *lines, "</table>"])


MARKDOWN = Format(
    str, _marked_in_markdown, lambda text, target: f"[{text}]({target})", _markdown_table
)
HTML = Format(
    html.escape, _marked_in_html, lambda text, target: f'<a href="{target}">{text}</a>', _html_table
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
        selections: values of the swept settings that the cubes were judged at.

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
    parts = [
        ("h1", TITLE),
        ("p", form.text(summary(judgements))),
        ("h2", "What you may rely on, and what not"),
        ("p", form.text(EXPLAINED)),
    ]
    for topic, sentences in introduction(judgements).items():
        items = [f"{form.marked('b', f'{head}:')} {form.text(said)}" for head, said in sentences]
        parts += [("h3", form.text(topic.capitalize())), ("ul", "\n".join(items))]
    written = [form.marked(tag, text) for tag, text in parts]
    for grade, heading in HEADINGS.items():
        rows: list[list[str]] = []
        for one in judgements:
            if one.result.grade is grade:
                cells = {name: form.text(text) for name, text in row(one, letters).items()}
                link = links.get(_key(one))
                cells[FIGURE] = form.link(cells[FIGURE], link) if link else ""
                rows = [*(rows or [list(cells)]), list(cells.values())]
        if rows:
            table = form.table(grade.value.replace(" ", "-"), rows)
            written += [form.marked("h2", form.text(heading)), table]
    if letters:
        items = [f"{letter}: {form.text(text)}" for text, letter in letters.items()]
        written += [form.marked("h2", "Model options"), form.marked("ul", "\n".join(items))]
    return written


def _key(one: Judgement) -> Key:
    return one.claim.figure, one.cubes


def _draw_figures(
    judgements: Sequence[Judgement], folder: Path, selections: Mapping[str, Any]
) -> tuple[dict[Key, Path], list[Fault]]:
    """Draw the figures of claims that were measured, or say why some cannot be drawn."""
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
