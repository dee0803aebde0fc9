"""Settings: name, type, default and unit of each, for workflows and sweeps.

A setting is declared once, as a field of a table such as
:class:`~knitlab.equilibrium.settings.Solver` or of a section of
:mod:`knitlab.sweep.workflow`; ``--set``, sweeps, coordinates and the reference follow.
"""

from dataclasses import dataclass
from typing import Any, get_origin

from knitlab.sweep.declared_fields import FactorOn, parts, unit_of
from knitlab.sweep.patterns import is_pattern_name
from knitlab.sweep.workflow import SECTIONS

SWEPT_SECTIONS = ("model", "solver", "dynamics", "electrodes")
"""Sections of which any single setting may be a list, and is then a dimension of the cube."""
SAMPLE_SIZE = "unit_cells"
"""The setting of ``[design]`` that may be a list too, of pairs."""
PATTERN = "pattern"
"""The setting of ``[design]`` that may be a list of names."""
OF_ALL_CASES = ("material", "interpolate_stripes")
"""Settings of a swept section that may not be a list."""


@dataclass(frozen=True)
class Setting:
    """One setting of a section of a workflow: its declared type, with range and unit, and default.

    The default is None if it is that of the parameter files, or if it has no effect.
    """

    section: str
    name: str
    kind: Any
    default: Any

    @property
    def unit(self) -> str:
        """Its unit [UDUNITS]."""
        return unit_of(self.kind)

    @property
    def factor_on(self) -> str | None:
        """The quantity that it multiplies, if it is a factor."""
        marks = (its.quantity for its in parts(self.kind) if isinstance(its, FactorOn))
        return next(marks, None)

    @property
    def takes_list(self) -> bool:
        """Whether its value is a list."""
        return any(get_origin(part) is tuple for part in parts(self.kind))

    def is_swept_by(self, value: Any) -> bool:
        """Whether a value of a workflow file is a list of several values."""
        if not isinstance(value, list) or not value:
            return False
        if self.name == SAMPLE_SIZE:
            return all(isinstance(one, list) for one in value)
        if self.name == PATTERN:
            names = [isinstance(one, str) and is_pattern_name(one) for one in value]
            return len(value) > 1 and all(names)
        swept = self.section in SWEPT_SECTIONS and self.name not in OF_ALL_CASES
        return swept and not self.takes_list


SETTINGS = {
    name: Setting(section, name, field.rebuild_annotation(), field.default)
    for section, schema in SECTIONS.items()
    for name, field in schema.model_fields.items()
}
"""Every setting, by name."""
