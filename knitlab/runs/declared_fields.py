"""Schemas of parameter files and workflows, derived from dataclasses that declare settings."""

import dataclasses
from collections.abc import Callable, Collection
from functools import partial
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from pydantic import AfterValidator, Field, PositiveFloat, create_model

from knitlab.io.toml import StrictModel
from knitlab.model.settings import Unit

Types = dict[str, Any]  # declared types of settings, with range and unit, by name
Fields = dict[str, tuple[Any, Any]]  # types and defaults of a schema, by name; ... where required
FACTOR = "_factor"  # suffix of a setting that multiplies another quantity
Count = Annotated[int, Field(gt=0, le=1_000_000)]  # of stitches, needles, periods, unit cells
CHANGES = "would change Poisson's ratio by more than 0.001"
LARGEST = {
    "tolerance": (1e-6, " N", CHANGES),
    "rest_force": (1e-5, " N", CHANGES),
    "relative_tolerance": (1e-4, "", "is too coarse for a motion to come to rest"),
    "absolute_tolerance": (1e-6, "", "is too coarse for a motion to come to rest"),
}
"""Largest errors that a setting may allow, with their units, and what larger ones do.

Of ``tolerance``: ν of nine periodic designs, from 1 % strain on, changes by 2e-4 at most against
1e-8 N; at 1e-5 N two designs change by 2e-3, at 1e-4 N one by 0.2. Of ``rest_force``: ν of four, in
a test by dynamics, changes by 3e-4 at most against 1e-6 N; at 3e-5 N one changes by 2e-3, at 0.05 N
one by 0.2. Of the other two: ν of one changes by 1e-5 at most against 1e-6 and 1e-10; with a
relative tolerance of 0.01 its motion did not end within three minutes, of 20 s otherwise.
"""
Model = TypeVar("Model", bound=type[StrictModel])


def check_bound(name: str, error: float) -> float:
    """An error that a setting of LARGEST allows; ValueError if it is too large."""
    largest, unit, message = LARGEST[name]
    if error > largest:
        raise ValueError(f"{error:g}{unit} {message}; give at most {largest:g}{unit}")
    return error


class ParameterValue(StrictModel):
    """A value with its unit and source."""

    value: Any
    unit: str
    source: str = Field(min_length=1)


def declared(table: type, without: Collection[str] = ()) -> Types:
    """The settings that a dataclass declares, but for some of its fields."""
    hints, fields = get_type_hints(table, include_extras=True), dataclasses.fields(table)
    types = {field.name: hints[field.name] for field in fields if field.name not in without}
    for name in types.keys() & LARGEST:
        types[name] = Annotated[types[name], AfterValidator(partial(check_bound, name))]
    return types


def factors(quantities: Collection[str]) -> Types:
    """A factor on each quantity."""
    return {f"{name}{FACTOR}": PositiveFloat for name in quantities}


def with_inner(kind: Any) -> tuple[Any, ...]:
    """A declared type and all types and markers within it, such as its unit."""
    return kind, *(inner for argument in get_args(kind) for inner in with_inner(argument))


def unit_of(kind: Any) -> str:
    """Unit of a declared type [UDUNITS]."""
    return next((mark.symbol for mark in with_inner(kind) if isinstance(mark, Unit)), "1")


def required(types: Types) -> Fields:
    """Required fields."""
    return {name: (_of_toml(kind), ...) for name, kind in types.items()}


def optional(types: Types) -> Fields:
    """Optional fields with the default None."""
    return {name: (_of_toml(kind) | None, None) for name, kind in types.items()}


def with_defaults(table: type) -> Fields:
    """Fields with the defaults of a dataclass."""
    defaults = {field.name: field.default for field in dataclasses.fields(table)}
    return {
        name: (kind, missing if defaults[name] is dataclasses.MISSING else defaults[name])
        for name, (kind, missing) in required(declared(table)).items()
    }


def entries(types: Types) -> Fields:
    """Tables ``{value, unit, source}`` of a parameter file."""
    return {
        name: (with_fields(required({"value": kind}) | units({"unit": kind}))(ParameterValue), ...)
        for name, kind in types.items()
    }


def units(types: Types) -> Fields:
    """The unit of each quantity."""
    form: Any = Literal
    return {name: (form[unit_of(kind)], ...) for name, kind in types.items()}


def with_fields(fields: Fields) -> Callable[[Model], Model]:
    """Add fields to the schema that is declared below."""

    def added(model: Model) -> Model:
        derived: Any = create_model(
            model.__name__,
            __base__=model,
            __module__=model.__module__,
            __doc__=model.__doc__,
            **dict[str, Any](fields),
        )
        return derived

    return added


def _of_toml(kind: Any) -> Any:
    """A declared type, with lists for its tuples: TOML has no tuples, and schemas are strict."""
    base, *markers = get_args(kind) if get_origin(kind) is Annotated else (kind,)
    if get_origin(base) is not tuple:
        return kind
    return Annotated[(base, Field(strict=False), *markers)]
