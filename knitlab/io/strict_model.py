"""The base of every file's schema."""

from pydantic import BaseModel, ConfigDict


class StrictModel(BaseModel):
    """Base of every file's schema: no unknown keys, no infinities, no silent conversions."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)
