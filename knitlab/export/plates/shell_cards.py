"""Plates for other programs: a table, JSON, and an Abaqus card of a general shell section.

Columns are A11, A12, A16 … D66 as in books on laminates, with 1 along x, 2 along y, 6 the shear.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from knitlab.export.plates.plate_stiffness import STATUS, VARIABLES, known_states, stiffness_matrix
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import invalid
from knitlab.solvers.plate_condensation import PlateStatus

LETTERS = "ABD"
NUMBERED = "126"
MAIN_COLUMNS = ("A11", "A12", "A22", "A66", "D11", "D22", "D66", "modulus_y", "poisson_ratio_y")
"""Numbers that the command line shows."""
PER_LINE = 8  # entries on a line of a card of Abaqus


def plates_table(plates: xr.Dataset) -> pd.DataFrame:
    """One row for each state that has a shape; the attribute ``units`` has those of the columns."""
    rows = []
    units = dict[str, str]()
    for state in known_states(plates):
        row = _labels(state) | {"status": PlateStatus(int(state[STATUS])).name}
        for name, (dims, unit, _) in VARIABLES.items():
            values = _columns(name, len(dims), state[name].values)
            units |= dict.fromkeys(values, unit)
            row |= values
        rows.append(row)
    table = pd.DataFrame(rows)
    table.attrs["units"] = units
    return table


def _columns(name: str, dims: int, values: np.ndarray) -> dict[str, float]:
    if dims == 0:
        return {name: float(values)}
    letter = LETTERS[list(VARIABLES).index(name)] if dims == 2 else {"moment": "M"}.get(name, "N")
    if dims == 1:
        return {f"{letter}{one}": float(values[i]) for i, one in enumerate(NUMBERED)}
    return {
        f"{letter}{one}{other}": float(values[i, j])
        for i, one in enumerate(NUMBERED)
        for j, other in enumerate(NUMBERED)
        if j >= i or letter == "B"
    }


def _labels(state: xr.Dataset) -> dict[str, Any]:
    inner = ("row", "column")
    return {str(name): each.item() for name, each in state.coords.items() if name not in inner}


def write_table(plates: xr.Dataset, output: Path) -> None:
    """Write the table as CSV, with units in the header."""
    table = plates_table(plates)
    units = table.attrs["units"]
    named = table.rename(columns={name: f"{name} [{unit}]" for name, unit in units.items()})
    with atomic_write(output) as temporary:
        named.to_csv(temporary, index=False)


def write_json(plates: xr.Dataset, output: Path) -> None:
    """Write the usable states as JSON, each with its 6 × 6 matrix."""
    states = [
        _labels(state)
        | {
            "ABD": _without_noise(stiffness_matrix(state)).tolist(),
            "membrane_force": _without_noise(state["membrane_force"].values).tolist(),
            "moment": _without_noise(state["moment"].values).tolist(),
            "reference_height": float(state["reference_height"]),
        }
        for state in _usable(plates)
    ]
    card = {
        "axes": "1 = x along the courses (weft), 2 = y along the wales (warp), z to the face",
        "order": ["e11", "e22", "gamma12", "k11", "k22", "k12"],
        "law": "(N11, N22, N12, M11, M22, M12) = membrane_force and moment + ABD × order",
        "curvature": "positive where the side at +z gets longer; k12 is twice the twist",
        "strain": "Green-Lagrange strain and curvature from this state, per width of this state",
        "length_unit": plates.attrs["length_unit"],
        "units": {"A": "N/mm", "B": "N", "D": "N mm"}
        | {"membrane_force": "N/mm", "moment": "N", "reference_height": "mm"},
        "states": states,
    }
    with atomic_write(output) as temporary:
        temporary.write_text(json.dumps(card, indent=1, ensure_ascii=False) + "\n", "utf-8")


def write_abaqus(plates: xr.Dataset, output: Path) -> None:
    """Write the one state that is left as ``*SHELL GENERAL SECTION``, in N and mm."""
    states = _usable(plates)
    if len(states) != 1:
        message = f"holds one state, but {len(states)} are selected"
        raise invalid(f"output {output}", f"{message}; select one design and one applied strain")
    (state,) = states
    stiffness = stiffness_matrix(state)
    unit = plates.attrs["length_unit"]
    labels = ", ".join(f"{name} = {value}" for name, value in _labels(state).items())

    def listed(name: str) -> str:
        return ", ".join(f"{value:.4g}" for value in _without_noise(state[name].values))

    # The upper triangle, column by column.
    stiffness = _without_noise(stiffness)
    entries = [f"{stiffness[i, j]:.9g}" for j in range(6) for i in range(j + 1)]
    lines = [
        f"** knitlab: plate of periodic knit, {labels}",
        f"** In N and {unit}; forces and moments are over the width of this state.",
        "** Local 1 = x along the courses (weft), 2 = y along the wales (warp), 3 to the face:",
        "** give the elements this orientation by *ORIENTATION and the parameter ORIENTATION.",
        f"** The state carries N = {listed('membrane_force')} N/mm and M = {listed('moment')} N,",
        "** which this card leaves out; strains and curvatures count from this state.",
        f"** The reference plane is {float(state['reference_height']):.4g} mm above the middle of"
        " the walls, at the mean height of the fabric.",
        "*SHELL GENERAL SECTION, ELSET=KNIT",
        *(", ".join(entries[k : k + PER_LINE]) for k in range(0, len(entries), PER_LINE)),
    ]
    with atomic_write(output) as temporary:
        temporary.write_text("\n".join(lines) + "\n", "ascii")


def _without_noise(values: np.ndarray) -> np.ndarray:
    """Values with 0 in place of what is far below the others, or below the forces of a solver."""
    return np.where(np.abs(values) > max(1e-9 * np.abs(values).max(), 1e-8), values, 0.0)


def _usable(plates: xr.Dataset) -> list[xr.Dataset]:
    """The states of a card; InputError if one is no positive definite plate."""
    states = list(known_states(plates))
    for state in states:
        status = PlateStatus(int(state[STATUS]))
        if status is not PlateStatus.ok:
            name = ", ".join(f"{label} = {value}" for label, value in _labels(state).items())
            message = f"is {status.name.replace('_', ' ')}, which a shell element cannot represent"
            raise invalid(name, f"{message}; select other states, or write a .csv")
    return states


CARDS: dict[str, Callable[[xr.Dataset, Path], None]] = {
    ".csv": write_table,
    ".json": write_json,
    ".inp": write_abaqus,
}
"""What writes a file, by its suffix."""
