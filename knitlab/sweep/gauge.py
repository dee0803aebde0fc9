"""The gauge of a cube: the knit sizes of its designs, and the attributes for its gauge."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

from knitlab.measure.knit_size import ALONG_X, ALONG_Y, Gauge, at_gauge, knit_sizes
from knitlab.simulation.case import Case

ATTRIBUTES = {field.name: f"gauge_{field.name}" for field in fields(Gauge)}
"""The cube's attributes that state its gauge [mm]."""


def sizes_of(case: Case, values: Mapping[str, Any], gauge: Gauge) -> dict[str, float]:
    """Knit sizes of a simulated case, by the names of the schema.

    Args:
        case: the case.
        values: variables of its file.
        gauge: the gauge of the cube.

    Returns:
        The sizes; empty for a pure stripe, whose stitches are not defined by patches [mm].
    """
    if case.pure:
        return {}
    names = (
        f"{kind}_{axis}" for kind in ("relaxed_cell", "flat_cell", "wavelength") for axis in "xy"
    )
    lengths = {name: float(values[name]) for name in names}
    return knit_sizes(lengths, case.stitches, case.options.boundary == "periodic", gauge)


def sizes_at(
    values: Mapping[str, Any], attributes: Mapping[str, Any], gauge: Gauge
) -> dict[str, float]:
    """Knit sizes of a design of an old cube, at the gauge of the new one.

    Args:
        values: values of the design in the old cube.
        attributes: attributes of the old cube.
        gauge: the gauge of the new cube.

    Returns:
        The sizes; empty if the old cube has no gauge, because it is of pure stripes or of an
        earlier version [mm].
    """
    if not set(ATTRIBUTES.values()) <= set(attributes):
        return {}
    before = Gauge(**{name: float(attributes[its]) for name, its in ATTRIBUTES.items()})
    sizes = {name: float(values[name]) for name in (*ALONG_X, *ALONG_Y)}
    return at_gauge(sizes, before, gauge)


def stated(gauge: Gauge) -> dict[str, float]:
    """The attributes of a cube that state its gauge [mm]."""
    return {ATTRIBUTES[name]: value for name, value in asdict(gauge).items()}
