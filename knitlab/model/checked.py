"""Settings that check their values when they are made."""

import dataclasses
from functools import cache
from typing import Any, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, create_model

from knitlab.io.errors import naming


class Checked:
    """Base of dataclasses of settings: a value outside its annotated range is an InputError.

    Numbers of NumPy become those of Python, whole numbers floats where these are declared.
    """

    def __post_init__(self) -> None:
        kind: Any = type(self)
        schema, values = _schema(kind), dict[str, Any]()
        for name in schema.model_fields:
            value = getattr(self, name)
            values[name] = value.item() if isinstance(value, np.generic) else value
        with naming(kind.__name__):
            read = schema.model_validate(values)
        for name in values:
            object.__setattr__(self, name, getattr(read, name))  # it is frozen


@cache
def _schema(table: Any) -> type[BaseModel]:
    """The fields of a dataclass, without type conversions or infinities."""
    hints = get_type_hints(table, include_extras=True)
    names = [field.name for field in dataclasses.fields(table)]
    types: dict[str, Any] = {name: (hints[name], ...) for name in names}
    strict = ConfigDict(strict=True, allow_inf_nan=False, arbitrary_types_allowed=True)
    schema: type[BaseModel] = create_model(table.__name__, __config__=strict, **types)
    return schema
