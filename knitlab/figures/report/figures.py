"""The figures that show claims, each drawn once for its cubes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from knitlab.figures.drawing import draw_figure
from knitlab.figures.report.introduction import cube_name
from knitlab.io.errors import BadInput, Fault
from knitlab.validation.judgement import Judgement
from knitlab.validation.margin import Verdict

Key = tuple[str | None, tuple[Path, ...]]


def figure_key(judgement: Judgement) -> Key:
    """The kind of figure and the cubes, which identify the figure of a claim."""
    return judgement.claim.statement.figure, judgement.cubes


def draw_claims(
    judgements: Sequence[Judgement], folder: Path, selections: Mapping[str, Any]
) -> tuple[dict[Key, Path], list[Fault]]:
    """Draw the figures of all claims that were measured.

    Args:
        judgements: the claims and their verdicts.
        folder: folder for the figures.
        selections: values of the coordinates that the cubes were sliced by.

    Returns:
        The files, and why some figures could not be drawn.
    """
    files: dict[Key, Path] = {}
    faults: list[Fault] = []
    refused: set[Key] = set()
    for judgement in judgements:
        kind, key = judgement.claim.statement.figure, figure_key(judgement)
        if (
            not kind
            or judgement.finding.verdict is Verdict.not_measured
            or key in files.keys() | refused
        ):
            continue
        label = cube_name(judgement.cubes[0]).replace("/", "-")
        name = f"{label}-{kind}.png" if len(judgement.cubes) == 1 else f"{kind}.png"
        try:
            files[key] = draw_figure(kind, judgement.cubes, folder / name, selections)
        except BadInput as error:
            refused.add(key)
            faults += [Fault(f"figure {kind}", entry.problem) for entry in error.faults]
    return files, faults
