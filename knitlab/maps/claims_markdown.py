"""The page of claims in Markdown; its figures are files beside it."""

from collections.abc import Mapping, Sequence

from knitlab.maps.claims_figures import Key, figure_key
from knitlab.maps.claims_introduction import EXPLAINED, Passage
from knitlab.maps.claims_table import Section


def markdown(
    title: str,
    said: str,
    passages: Sequence[Passage],
    sections: Sequence[Section],
    readings: Mapping[str, str],
    links: Mapping[Key, str],
) -> str:
    """Write the page.

    Args:
        title: its title.
        said: how many claims hold.
        passages: what a user may rely on, topic by topic.
        sections: the table, grade by grade.
        readings: the short name of every reading.
        links: where each figure lies, from the page's folder.
    """
    lines = [f"# {title}", "", said, "", "## What you may rely on, and what not", "", EXPLAINED, ""]
    for passage in passages:
        lines += [f"### {passage.topic.capitalize()}", ""]
        lines += [f"- **{opening}:** {claims}" for opening, claims in passage.sentences]
        lines.append("")
    for section in sections:
        lines += [f"## {section.heading}", "", *_table(section, links), ""]
    if readings:
        lines += ["## Readings of the model", ""]
        lines += [f"- {name}: {text}" for text, name in readings.items()]
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
