"""The page of claims in Markdown; its figures are files beside it."""

from collections.abc import Mapping

from knitlab.report.figures import Key, figure_key
from knitlab.report.introduction import EXPLAINED
from knitlab.report.table import Page, Section


def markdown(page: Page, links: Mapping[Key, str]) -> str:
    """Write the page.

    Args:
        page: what it says.
        links: where each figure lies, from the page's folder.
    """
    lines = [f"# {page.title}", "", page.said, ""]
    lines += ["## What you may rely on, and what not", "", EXPLAINED, ""]
    for passage in page.passages:
        lines += [f"### {passage.topic.capitalize()}", ""]
        lines += [f"- **{opening}:** {claims}" for opening, claims in passage.sentences]
        lines.append("")
    for section in page.sections:
        lines += [f"## {section.heading}", "", *_table(section, links), ""]
    if page.readings:
        lines += ["## Readings of the model", ""]
        lines += [f"- {name}: {text}" for text, name in page.readings.items()]
        lines.append("")
    return "\n".join(lines)


def _table(section: Section, links: Mapping[Key, str]) -> list[str]:
    lines = [f"| {' | '.join(section.columns.values())} |", f"|{'---|' * len(section.columns)}"]
    for row, its in zip(section.rows, section.claims, strict=True):
        link = links.get(figure_key(its))
        shown = row | {"figure": f"[{row['figure']}]({link})" if link else ""}
        cells = [shown[name].replace("|", "\\|") for name in section.columns]
        lines.append(f"| {' | '.join(cells)} |")
    return lines
