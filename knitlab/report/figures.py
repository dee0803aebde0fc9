"""The figures that show claims, each drawn once for the cubes that it is of."""

from collections.abc import Sequence
from pathlib import Path

from knitlab.figures.drawing import draw_figure
from knitlab.io.errors import BadInput, Fault
from knitlab.paper.judgement import Judgement
from knitlab.paper.margin import Verdict
from knitlab.report.introduction import cube_name

Key = tuple[str | None, tuple[Path, ...]]


def figure_key(its: Judgement) -> Key:
    """What tells the figure of a claim from others: its kind, and the cubes."""
    return its.claim.statement.figure, its.cubes


def draw_claims(
    judgements: Sequence[Judgement], folder: Path, selections: Sequence[str]
) -> tuple[dict[Key, Path], list[Fault]]:
    """Draw the figures of all claims that were measured.

    Args:
        judgements: the claims and what was found.
        folder: where to draw them.
        selections: texts ``NAME=VALUE`` that the cubes were sliced by.

    Returns:
        The files, and why a figure could not be drawn.
    """
    files: dict[Key, Path] = {}
    faults: list[Fault] = []
    refused: set[Key] = set()
    for its in judgements:
        kind, key = its.claim.statement.figure, figure_key(its)
        if not kind or its.finding.verdict is Verdict.not_measured or key in files.keys() | refused:
            continue
        label = cube_name(its.cubes[0]).replace("/", "-")
        name = f"{label}-{kind}.png" if len(its.cubes) == 1 else f"{kind}.png"
        try:
            files[key] = draw_figure(kind, its.cubes, folder / name, selections)
        except BadInput as error:
            refused.add(key)
            faults += [Fault(f"figure {kind}", entry.problem) for entry in error.faults]
    return files, faults
