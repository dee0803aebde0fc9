"""Files of a law: functions that need no knitlab, and stress over strains."""

from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

if TYPE_CHECKING:
    from knitlab.export.laws.law import Law

POINTS = (21, 21, 11)  # of a table, along E_xx, E_yy and 2 E_xy
FUNCTIONS = '''

def energy(strain, curvature=None, xp=np):
    """Energy over the relaxed area [N/mm], for strains (..., 3) and curvatures (..., 3) [1/mm]."""
    along = strain @ xp.asarray(DIRECTIONS).T
    offsets = xp.asarray(OFFSETS)
    density = (_ramp(along - offsets, xp) - _ramp(-offsets, xp)) @ xp.asarray(WEIGHTS)
    density = density - (along * _slope(-offsets, xp)) @ xp.asarray(WEIGHTS)
    if curvature is None:
        return density
    return density + ((curvature @ xp.asarray(BENDING)) * curvature).sum(-1) / 2


def stress(strain, xp=np):
    """Second Piola-Kirchhoff stress (S_xx, S_yy, S_xy) [N/mm], the first derivative of energy."""
    along = strain @ xp.asarray(DIRECTIONS).T
    offsets = xp.asarray(OFFSETS)
    slopes = _slope(along - offsets, xp) - _slope(-offsets, xp)
    return (slopes * xp.asarray(WEIGHTS)) @ xp.asarray(DIRECTIONS)


def tangent(strain, xp=np):
    """Stiffness (..., 3, 3) [N/mm], the second derivative of energy; never negative."""
    directions = xp.asarray(DIRECTIONS)
    x = strain @ directions.T - xp.asarray(OFFSETS)
    stiffness = xp.asarray(WEIGHTS) * (1 + x / xp.sqrt(x**2 + WIDTH**2)) / 2
    return xp.einsum("...j,ja,jb->...ab", stiffness, directions, directions)


def _ramp(x, xp):
    root = xp.sqrt(x**2 + WIDTH**2)
    return (x**2 + x * root + WIDTH**2 * xp.arcsinh(x / WIDTH)) / 4


def _slope(x, xp):
    return (x + xp.sqrt(x**2 + WIDTH**2)) / 2
'''


def _write_functions(law: "Law", path: Path) -> None:
    ridges = law.ridges.ridges
    arrays = {
        "DIRECTIONS": ridges.directions,
        "OFFSETS": ridges.offsets,
        "WEIGHTS": law.ridges.weights,
        "BENDING": np.zeros((3, 3)) if law.plate is None else law.plate.bending,
    }
    ranges = ", ".join(f"{low:.3g} to {high:.3g}" for low, high in zip(*law.range, strict=True))
    lines = [
        f'"""Membrane of a knit: {law.model}.',
        "",
        f"Written by knitlab {version('knitlab')} from {len(law.tests)} tests of periodic fabric.",
        "Strains are Green's (E_xx, E_yy, 2 E_xy) of the relaxed fabric, x along the courses and y",
        f"along the wales. The tests have {ranges}; beyond them",
        "the law is a guess. With JAX, give xp=jax.numpy.",
        '"""',
        "",
        "import numpy as np",
        "",
        *(f"{name} = np.array({values.tolist()!r})" for name, values in arrays.items()),
        f"WIDTH = {ridges.width!r}",
    ]
    path.write_text("\n".join(lines) + FUNCTIONS, encoding="utf-8")


def _write_table(law: "Law", path: Path) -> None:
    lowest, highest = law.range
    axes = [np.linspace(*ends) for ends in zip(lowest, highest, POINTS, strict=True)]
    strain = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    table = pd.DataFrame(strain, columns=["E_xx [1]", "E_yy [1]", "2 E_xy [1]"])
    table[["S_xx [N/mm]", "S_yy [N/mm]", "S_xy [N/mm]"]] = law.stress(strain)
    table["energy [N/mm]"] = law.energy(strain)
    table["between tests"] = law.covers(strain).astype(int)
    table.to_csv(path, index=False, float_format="%.9g", lineterminator="\n")


FORMATS: dict[str, Callable[["Law", Path], None]] = {
    ".py": _write_functions,
    ".csv": _write_table,
}
"""Every format by its suffix."""
