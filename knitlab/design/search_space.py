"""The search space: designs, and parameters of stripes and gauge that vary within bounds."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.design.request import CHOICES, PARAMETERS, DesignRequest, Variable
from knitlab.io.errors import invalid
from knitlab.model.stitches import Gauge
from knitlab.observables.case_variables import STRIPE_PARAMETERS
from knitlab.runs.plan import make_plan
from knitlab.solvers.case import Case

ROUND_OFF = 1e-9
AT_BOUND = 1e-3  # fraction of the distance between bounds within which a value counts as on one
DesignLabels = tuple[int | str, ...]  # n_stripe, n_subunit and, where it varies, pattern
Point = Float[np.ndarray, " variable"]  # logarithms, scaled by their bounds to [0, 1]


@dataclass(frozen=True)
class SearchSpace:
    """The variables of a search and their bounds."""

    workflow: str
    settings: Mapping[str, Any]  # replace those of the workflow, the last strain included
    dims: tuple[str, ...]  # n_stripe, n_subunit and, where it varies, pattern
    designs: tuple[DesignLabels, ...]
    variables: tuple[Variable, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the variables."""
        return tuple(variable.name for variable in self.variables)

    @cached_property
    def lower(self) -> Point:
        """Logarithms of the lower bounds."""
        return np.log([variable.low for variable in self.variables])

    @cached_property
    def width(self) -> Point:
        """Logarithms of the upper over the lower bounds."""
        return np.log([variable.high for variable in self.variables]) - self.lower

    def values(self, point: Point) -> dict[str, float]:
        """Values of the variables at a point, in their units."""
        logarithms = self.lower + np.clip(point, 0, 1) * self.width
        return dict(zip(self.names, np.exp(logarithms).tolist(), strict=True))

    def point(self, values: Mapping[str, float]) -> Point:
        """The point of values, or the nearest within the bounds; the inverse of :meth:`values`."""
        logarithms = np.log([values[name] for name in self.names])
        return np.clip((logarithms - self.lower) / self.width, 0, 1)

    def bounds_at(self, point: Point, downhill: Point) -> list[str]:
        """The bounds reached, such as ``rib_k_t <= 0.1``, unless downhill leads away from them."""
        active = []
        for variable, fraction, slope in zip(self.variables, point, downhill, strict=True):
            if fraction < AT_BOUND and slope <= 0:
                active.append(f"{variable.name} >= {variable.low:.4g}")
            if fraction > 1 - AT_BOUND and slope >= 0:
                active.append(f"{variable.name} <= {variable.high:.4g}")
        return active

    def labels(self, design: DesignLabels) -> dict[str, int | str]:
        """The labels of a design, by dimension."""
        return dict(zip(self.dims, design, strict=True))

    def case(self, design: DesignLabels, point: Point | None = None) -> tuple[Case, Gauge]:
        """The case at a point, or by the tabulated values, and the gauge of its sizes in cloth."""
        values = {} if point is None else self.values(point)
        plan = make_plan(self.workflow, {**self.settings, **values, **self.labels(design)})
        (case,) = plan.cases.values()
        return case, plan.gauge

    def start(self, design: DesignLabels) -> Point:
        """The point of the tabulated values, or the nearest one within the bounds."""
        case, gauge = self.case(design)
        tabulated = dict.fromkeys(self.names, 1.0) | vars(gauge)
        for name, (side, quantity) in STRIPE_PARAMETERS.items():
            tabulated[name] = float(getattr(getattr(case, side), quantity))
        return self.point(tabulated)

    def parameter_slopes(self) -> Float[np.ndarray, "parameter variable"]:
        """Derivatives of the logarithm of each parameter by each coordinate of a point."""
        changed = [[each.changes(parameter) for each in self.variables] for parameter in PARAMETERS]
        return np.reshape(changed, (len(PARAMETERS), len(self.variables))) * self.width


def search_space(request: DesignRequest) -> SearchSpace:
    """The space that a request allows; InputError if a bound or a target cannot be simulated."""
    settings = {**request.settings, "robustness": 0}
    labels = {name: list(values) for name, values in request.choices.items()}
    if "strain_step" in settings:
        # The workflow's last strain may not be a multiple of it.
        settings.setdefault("strain_max", settings["strain_step"])
    allowed = make_plan(request.workflow, {**settings, **labels})
    if any(name not in CHOICES for name in allowed.dims):
        raise invalid(request.workflow, f"has dimensions {allowed.dims}; give single settings")
    needed = max((target.window.stop for target in request.wanted if target.window), default=0.0)
    if len(allowed.applied_strain) < 2:
        raise invalid("strain_max = 0", "leaves no strain to apply; raise it, or leave it out")
    last = allowed.applied_strain[-1]
    step = allowed.applied_strain[1]
    if "strain_max" not in request.settings:
        # By default the last strain that a target needs.
        settings["strain_max"] = round(max(1, int(np.ceil(needed / step - ROUND_OFF))) * step, 12)
    elif needed > last + ROUND_OFF:
        message = f"ends before the strain {needed:g} of a target; raise it, or leave it out"
        raise invalid(f"settings.strain_max = {last:g}", message)
    settings |= {name: only[0] for name, only in labels.items() if name not in allowed.dims}
    designs = tuple(
        tuple(label if isinstance(label, str) else int(label) for label in design)
        for design in allowed.designs.values()
    )
    space = SearchSpace(request.workflow, settings, allowed.dims, designs, request.variables)
    for design, fraction in product(designs, (0.0, 1.0)):
        space.case(design, np.full(len(request.variables), fraction))
    return space
