"""The reference of figures, from the registry of what ``knitlab map`` can draw."""

from pathlib import Path

from markdown_text import first_paragraph

from knitlab.figures.registry import figure_kind
from knitlab.runs.figure_names import FIGURE_NAMES

ROOT = Path(__file__).parents[2]


def page() -> str:
    """Every kind of figure: what it shows, of what, and a kept example."""
    return "\n\n".join(part for name in FIGURE_NAMES for part in _section(name))


def _section(name: str) -> list[str]:
    kind = figure_kind(name)
    facts = [f"In Python: `knitlab.plot.{name}`; drawn by `{kind.draw.__module__}`."]
    if kind.dims:
        facts.append(f"Designs along {' and '.join(f'`{dim}`' for dim in kind.dims)}.")
    if kind.needs:
        facts.append(f"Needs `{kind.needs}`, which is in case files.")
    facts.append(f"Takes {kind.takes}.")
    parts = [f"## {name}", first_paragraph(kind.summary), " ".join(facts)]
    kept = sorted((ROOT / "results" / "reference").glob(f"*/figures/{name}.png"))
    if kept:
        example = kept[0].relative_to(ROOT)
        parts.append(f"Of the workflow `{example.parts[2]}`:")
        parts.append(f"![{name}](../../{example.as_posix()})")
    return parts
