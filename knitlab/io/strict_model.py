"""Base class of the schema of every input file."""

from pydantic import BaseModel, ConfigDict


class StrictModel(BaseModel):
    """Base of the schema of every input file: no unknown keys, infinities or type conversions."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)
