"""Quantities in a description: a number or a column, with its unit."""

from collections.abc import Callable
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from knitlab.io.table_file import factor_of
from knitlab.io.toml import StrictModel

REMEDIES = {
    "mm": "of length, such as mm",
    "s": "of time, such as s",
    "Hz": "of frequency, such as Hz",
    "N": "of force, such as N",
    "pF": "of capacitance, such as pF",
}
"""Units that knitlab uses, and for each the units that may be given instead."""


class _WithUnit(StrictModel):
    """Base of everything with a unit."""

    unit: str = Field(min_length=1)


class MeasuredQuantity(_WithUnit):
    """A number and its unit."""

    value: float


class Column(_WithUnit):
    """A column of a table by its header, and its unit."""

    column: str = Field(min_length=1)


class PlainColumn(StrictModel):
    """A column of a table that needs no unit."""

    column: str = Field(min_length=1)


def conversion(unit: str, target: str) -> float:
    """Factor that converts numbers in a unit to one of :data:`REMEDIES`.

    Raises:
        ValueError: if the unit has another dimension.
    """
    factor, faults = factor_of("", unit, target, REMEDIES[target])
    if faults:
        raise ValueError(faults[0].problem)
    return factor


def _positive(target: str) -> Callable[[MeasuredQuantity], MeasuredQuantity]:
    def checked(quantity: MeasuredQuantity) -> MeasuredQuantity:
        conversion(quantity.unit, target)
        if not quantity.value > 0:
            raise ValueError(f"is {quantity.value:g}; give one above 0")
        return quantity

    return checked


def _in(target: str) -> Callable[[Any], Any]:
    def checked(stated: Any) -> Any:
        conversion(stated.unit, target)
        return stated

    return checked


Length = Annotated[MeasuredQuantity, AfterValidator(_positive("mm"))]
Frequency = Annotated[MeasuredQuantity, AfterValidator(_positive("Hz"))]
Time = Annotated[MeasuredQuantity, AfterValidator(_in("s"))]
TimeColumn = Annotated[Column, AfterValidator(_in("s"))]
LengthColumn = Annotated[Column, AfterValidator(_in("mm"))]
ForceColumn = Annotated[Column, AfterValidator(_in("N"))]
CapacitanceColumn = Annotated[Column, AfterValidator(_in("pF"))]


def number(quantity: MeasuredQuantity, target: str) -> float:
    """A quantity as a number in one of the units of :data:`REMEDIES`."""
    return quantity.value * conversion(quantity.unit, target)
