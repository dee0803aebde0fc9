"""The page of claims as one HTML file with embedded figures."""

import base64
import html
from collections.abc import Mapping
from pathlib import Path

from knitlab.figures.report.figures import Key, figure_key
from knitlab.figures.report.introduction import EXPLAINED, TopicSummary, cube_name
from knitlab.figures.report.table import Page, Section

STYLE = """
body { font: 15px/1.4 sans-serif; margin: 2em auto; max-width: 90em; padding: 0 1em; }
p, ul { max-width: 60em; } table { border-collapse: collapse; } img { max-width: 100%; }
td, th { padding: .3em .6em; text-align: left; vertical-align: top; border-bottom: 1px solid #ccc; }
.margin { font-weight: bold; white-space: nowrap; } .holds .margin { color: #00664b; }
.near-miss .margin { color: #8a6100; } .fails .margin { color: #a63603; }
"""


def one_file(page: Page, figures: Mapping[Key, Path]) -> str:
    """Write the page, with every figure embedded.

    Args:
        page: its content.
        figures: PNG file of each figure.
    """
    anchors = {key: f"figure-{number}" for number, key in enumerate(figures, start=1)}
    body = [
        f"<h1>{_safe(page.title)}</h1><p>{_safe(page.summary)}</p>",
        f"<h2>What you may rely on, and what not</h2><p>{_safe(EXPLAINED)}</p>",
        *map(_topic, page.topics),
        *(_section(section, anchors) for section in page.sections),
        _options(page.options) if page.options else "",
        "<h2>Figures</h2>" if figures else "",
        *(_figure(key, anchors[key], path) for key, path in figures.items()),
    ]
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{_safe(page.title)}</title>'
        f"<style>{STYLE}</style>\n{chr(10).join(body)}\n</html>\n"
    )


def _safe(text: str) -> str:
    return html.escape(text)


def _topic(summary: TopicSummary) -> str:
    lines = [
        f"<li><b>{_safe(opening)}:</b> {_safe(claims)}</li>"
        for opening, claims in summary.sentences
    ]
    return f"<h3>{_safe(summary.topic.capitalize())}</h3><ul>{''.join(lines)}</ul>"


def _section(section: Section, anchors: Mapping[Key, str]) -> str:
    head = "".join(f"<th>{_safe(name)}</th>" for name in section.columns.values())
    lines = []
    for row, judgement in zip(section.rows, section.claims, strict=True):
        cells = {name: _safe(row[name]) for name in section.columns}
        anchor = anchors.get(figure_key(judgement))
        cells["figure"] = f'<a href="#{anchor}">{cells["figure"]}</a>' if anchor else ""
        shown = "".join(f'<td class="{name}">{cell}</td>' for name, cell in cells.items())
        lines.append(f"<tr>{shown}</tr>")
    grade = section.grade.value.replace(" ", "-")
    return (
        f'<h2>{_safe(section.heading)}</h2><table class="{grade}"><tr>{head}</tr>\n'
        f"{chr(10).join(lines)}\n</table>"
    )


def _options(options: Mapping[str, str]) -> str:
    lines = "".join(f"<li>{letter}: {_safe(text)}</li>" for text, letter in options.items())
    return f"<h2>Model options</h2><ul>{lines}</ul>"


def _figure(key: Key, anchor: str, path: Path) -> str:
    kind, cubes = key
    caption = _safe(f"{kind}: {', '.join(map(cube_name, cubes))}")
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    return (
        f'<figure id="{anchor}"><figcaption>{caption}</figcaption>'
        f'<img alt="{caption}" src="data:image/png;base64,{data}"></figure>'
    )
