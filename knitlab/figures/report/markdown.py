"""The page of claims in Markdown, with figures as files beside it."""

from collections.abc import Mapping

from knitlab.figures.report.figures import Key, figure_key
from knitlab.figures.report.introduction import EXPLAINED
from knitlab.figures.report.table import Page, Section


def markdown(page: Page, links: Mapping[Key, str]) -> str:
    """Write the page.

    Args:
        page: its content.
        links: path of each figure, relative to the folder of the page.
    """
    lines = [f"# {page.title}", "", page.summary, ""]
    lines += ["## What you may rely on, and what not", "", EXPLAINED, ""]
    for topic in page.topics:
        lines += [f"### {topic.topic.capitalize()}", ""]
        lines += [f"- **{opening}:** {claims}" for opening, claims in topic.sentences]
        lines.append("")
    for section in page.sections:
        lines += [f"## {section.heading}", "", *_table(section, links), ""]
    if page.options:
        lines += ["## Model options", ""]
        lines += [f"- {letter}: {text}" for text, letter in page.options.items()]
        lines.append("")
    return "\n".join(lines)


def _table(section: Section, links: Mapping[Key, str]) -> list[str]:
    lines = [f"| {' | '.join(section.columns.values())} |", f"|{'---|' * len(section.columns)}"]
    for row, judgement in zip(section.rows, section.claims, strict=True):
        link = links.get(figure_key(judgement))
        shown = row | {"figure": f"[{row['figure']}]({link})" if link else ""}
        cells = [shown[name].replace("|", "\\|") for name in section.columns]
        lines.append(f"| {' | '.join(cells)} |")
    return lines
