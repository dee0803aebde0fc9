"""The settings that all cases of a workflow share, and checks of what they combine."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar

from knitlab.io.errors import invalid, unknown
from knitlab.io.toml import StrictModel
from knitlab.model.electrodes import Capacitor
from knitlab.model.pattern import CELLS_PER_PERIOD
from knitlab.model.settings import ModelOptions, Sheet, largest_thickness
from knitlab.model.stripe import (
    Knit,
    Stripe,
    cell_length,
    changed_stripe,
    changed_table,
    lengths_ratio,
)
from knitlab.runs.parameters import Parameters
from knitlab.runs.recorded_plan import Labels
from knitlab.runs.workflow import CHANGES, PLAIN_NUMBERS, Workflow
from knitlab.solvers.case import Case, Label
from knitlab.solvers.combination import RULES, Combination
from knitlab.solvers.methods import METHODS

Table = TypeVar("Table")
Designs = dict[Labels, str | None]
"""Designs by their labels along the dimensions, with the reason why one is impossible."""
Source = Callable[[str], str]
"""Names where a ``section.key`` comes from, for a message."""


def overridden(table: Table, section: StrictModel) -> Table:
    """A table of settings with what a workflow's section gives in place of them."""
    # mypy knows no bound for "any dataclass".
    names = {field.name for field in fields(table)}  # type: ignore[arg-type]
    given = section.model_dump(include=names, exclude_none=True)
    return replace(table, **given)  # type: ignore[type-var]


@dataclass(frozen=True)
class CaseSettings:
    """One combination of a workflow's settings."""

    workflow: Workflow  # with one value for each setting
    labels: dict[str, Label]  # of the combination along the dimensions of swept settings
    parameters: Parameters  # of ``params/`` or of a material
    source: Source

    @cached_property
    def changes(self) -> dict[str, Any]:
        """Numbers of stripes, sheet and plain knit that the workflow changes."""
        numbers = {*CHANGES, *PLAIN_NUMBERS}
        return self.workflow.model.model_dump(include=numbers, exclude_none=True)

    @cached_property
    def options(self) -> ModelOptions:
        """The model options."""
        return overridden(self.parameters.model, self.workflow.model)

    @cached_property
    def sheet(self) -> Sheet:
        """The walls and the thickness."""
        return changed_table(self.parameters.sheet, self.changes)

    def stripe(self, knit: Knit, stitches: int) -> Stripe:
        """A stripe of the tables, with the workflow's changes."""
        return changed_stripe(self.parameters.stripes.stripe(knit, stitches), self.changes)

    def lengths_ratio(self, knit: Knit, stitches: int) -> float:
        """Lengths of the network over those of the cloth, by a stripe of the tables.

        A changed stripe is of the same cloth: its walls and thickness stay what they are, as they
        do in derivatives by stripe parameters.
        """
        table = self.parameters.stripes.stripe(knit, stitches)
        return lengths_ratio(table, self.sheet, self.options)

    @cached_property
    def combination(self) -> Combination:
        """What the tests combine."""
        workflow, protocol = self.workflow, self.workflow.protocol
        stripes = workflow.stripes
        return Combination(
            boundaries=stripes.boundaries if stripes else (self.options.boundary,),
            method=protocol.method,
            options=self.options,
            solver=overridden(self.parameters.solver, workflow.solver),
            dynamics=overridden(self.parameters.dynamics, workflow.dynamics),
            friction=overridden(self.parameters.friction, workflow.friction),
            load=protocol.as_load,
            strain_max=protocol.strain_max,
            cycle=protocol.cycle,
            robustness=protocol.robustness,
            sensitivities=protocol.sensitivities,
            electrodes=workflow.electrodes is not None,
        )

    @cached_property
    def common(self) -> dict[str, Any]:
        """Fields of a case that do not depend on its design."""
        protocol, combination = self.workflow.protocol, self.combination
        by_equilibria = METHODS[protocol.method].uses_solver
        return {
            "sheet": self.sheet,
            "applied_strain": protocol.applied_strain,
            "method": protocol.method,
            "solver": combination.solver if by_equilibria else None,
            "dynamics": combination.dynamics,
            "sensitivities": protocol.sensitivities,
            "unloading": protocol.unloading,
            "load": combination.load,
            "friction": combination.friction,
            "cycle": protocol.cycle,
            "robustness": protocol.robustness if by_equilibria else 0,
            "capacitor": self._capacitor(),
        }

    def _capacitor(self) -> Capacitor | None:
        section, parameters = self.workflow.electrodes, self.parameters
        if section is None:
            return None
        layout = parameters.capacitor.layout
        if section.layout is not None:
            if section.layout not in parameters.layouts:
                message = unknown(section.layout, parameters.layouts, "layout")
                raise invalid(self.source("electrodes.layout"), f"{message}, or give a mask")
            layout = parameters.layouts[section.layout]
        # The section's ``layout`` is a name.
        numbers = overridden(parameters.capacitor, section.model_copy(update={"layout": None}))
        return replace(numbers, layout=overridden(layout, section))

    def check(self) -> None:
        """Refuse features where they have no meaning; InputError names the first."""
        load = self.combination.load
        for setting in load.settings:
            if getattr(self.workflow.protocol, setting.name) is None:
                message = f"needs {setting.name} ({setting.meaning}); give it"
                raise invalid(self.source("protocol.load"), message)
        for rule in RULES:
            if rule.is_used(self.combination):
                for message in rule.conflicts(self.combination):
                    raise invalid(self.source(rule.setting), message)


def check_thickness(case: Case, source: Source) -> None:
    """Refuse a fabric so thick that contact would press open its folds at rest."""
    if case.options.contact == "none":
        return
    refinement = case.options.cells_per_period // CELLS_PER_PERIOD
    cell = refinement * min(float(cell_length(each, case.options)) for each in case.stripes)
    sharpest = min(each.theta_0 for each in case.stripes)
    largest = largest_thickness(cell, sharpest) / case.lengths_ratio
    if case.sheet.thickness >= largest:
        message = f"is too thick for the folds of {case.label}; give less than {largest:.3g} mm"
        raise invalid(source("model.thickness"), f"{case.sheet.thickness:g} mm {message}")
