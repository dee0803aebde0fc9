"""The search space: designs, and parameters of stripes and gauge that vary within bounds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.fabric.stripe import Stripe
from knitlab.inverse.request import CHOICES, PARAMETERS, DesignRequest
from knitlab.io.errors import fault
from knitlab.measure.knit_size import Gauge
from knitlab.simulation.case import Case
from knitlab.simulation.sensitivity import STRIPE_PARAMETERS
from knitlab.sweep.plan import Plan, make_plan

ROUND_OFF = 1e-9
AT_BOUND = 1e-3
"""Part of the way between bounds within which a value counts as on one."""
DesignLabels = tuple[int | str, ...]
"""n_stripe, n_subunit and, where it varies, the name of the pattern."""
Place = Float[np.ndarray, " variable"]
"""A point: logarithms of the variables, scaled by their bounds to [0, 1]."""


@dataclass(frozen=True)
class SearchSpace:
    """The variables of a search and their bounds.

    Attributes:
        workflow: name or path of the workflow.
        settings: that replace the workflow's, the strains of the test included.
        dims: what the labels of designs are: n_stripe, n_subunit and, if it varies, pattern.
        designs: the labels of the possible designs.
        names: of the variables.
        lower, upper: logarithms of their bounds.
    """

    workflow: str
    settings: Mapping[str, Any]
    dims: tuple[str, ...]
    designs: tuple[DesignLabels, ...]
    names: tuple[str, ...]
    lower: Place
    upper: Place

    def values(self, place: Place) -> dict[str, float]:
        """Values of the variables at a point, in their units."""
        logarithms = self.lower + np.clip(place, 0, 1) * (self.upper - self.lower)
        return dict(zip(self.names, np.exp(logarithms).tolist(), strict=True))

    def place_of(self, values: Mapping[str, float]) -> Place:
        """The point of values, or the nearest within the bounds; the inverse of :meth:`values`."""
        logarithms = np.log([values[name] for name in self.names])
        return np.clip((logarithms - self.lower) / (self.upper - self.lower), 0, 1)

    def bounds_at(self, place: Place, downhill: Place) -> list[str]:
        """The active bounds at a point.

        Args:
            place: the point.
            downhill: direction in which the distance decreases; a bound that is reached counts as
                active if this is 0.
        """
        held = []
        for name, fraction, slope, low, high in zip(
            self.names, place, downhill, np.exp(self.lower), np.exp(self.upper), strict=True
        ):
            if fraction < AT_BOUND and slope <= 0:
                held.append(f"{name} >= {low:.4g}")
            if fraction > 1 - AT_BOUND and slope >= 0:
                held.append(f"{name} <= {high:.4g}")
        return held

    def plan(self, design: DesignLabels, values: Mapping[str, float]) -> Plan:
        """The plan of one case: a design with values of the variables.

        Raises:
            BadInput: if a value is out of range, such as a rest angle that reaches π.
        """
        return make_plan(self.workflow, {**self.settings, **values, **self.labels(design)})

    def labels(self, design: DesignLabels) -> dict[str, int | str]:
        """The labels of a design, by dimension."""
        return dict(zip(self.dims, design, strict=True))

    def case(self, design: DesignLabels, place: Place) -> tuple[Case, Gauge]:
        """The case at a point, and the gauge of its sizes in cloth."""
        plan = self.plan(design, self.values(place))
        (case,) = plan.cases.values()
        return case, plan.gauge

    def start(self, design: DesignLabels) -> Place:
        """The point of the tabulated values, or the nearest one within the bounds."""
        plan = self.plan(design, {})
        (case,) = plan.cases.values()
        stripes = {"weft": case.weft, "warp": case.warp}
        known = {
            name: 1.0 if name.endswith("_factor") else _number(name, stripes, plan.gauge)
            for name in self.names
        }
        return self.place_of(known)

    def acts_on(self) -> Float[np.ndarray, "parameter variable"]:
        """Derivatives of the logarithm of each parameter by each coordinate of a point."""
        spans = list(zip(self.names, self.upper - self.lower, strict=True))
        return np.array(
            [
                [span * _multiplies(name, parameter) for name, span in spans]
                for parameter in PARAMETERS
            ]
        ).reshape(len(PARAMETERS), len(self.names))


def _labels(design: Sequence[Any]) -> DesignLabels:
    return tuple(label if isinstance(label, str) else int(label) for label in design)


def _number(name: str, stripes: Mapping[str, Stripe], gauge: Gauge) -> float:
    if name not in STRIPE_PARAMETERS:
        return float(getattr(gauge, name))
    side, quantity = STRIPE_PARAMETERS[name]
    return float(getattr(stripes[side], quantity))


def _multiplies(variable: str, parameter: str) -> bool:
    quantity = variable.removesuffix("_factor")
    return parameter == quantity or parameter in (f"rib_{quantity}", f"garter_{quantity}")


def search_space(request: DesignRequest) -> SearchSpace:
    """The space that a request allows.

    Unless the request gives it, the last strain of the test follows from the targets.

    Raises:
        BadInput: if it has no possible design, if a bound cannot be simulated, or if the test ends
            before the window of a target.
    """
    settings = {**request.settings, "robustness": 0}
    labels = {name: list(values) for name, values in request.choices.items()}
    if "strain_step" in settings:
        # The workflow's last strain may not be a multiple of it.
        settings.setdefault("strain_max", settings["strain_step"])
    whole = make_plan(request.workflow, {**settings, **labels})
    if any(name not in CHOICES for name in whole.dims):
        raise fault(request.workflow, f"has dimensions {whole.dims}; a search takes one setting")
    settings |= _test_of(request, whole)
    settings |= {name: only[0] for name, only in labels.items() if name not in whole.dims}
    designs = tuple(_labels(design) for design in whole.designs.values())
    bounds = np.array(list(request.bounds.values())).reshape(-1, 2)
    space = SearchSpace(
        request.workflow,
        settings,
        whole.dims,
        designs,
        tuple(request.bounds),
        np.log(bounds[:, 0]),
        np.log(bounds[:, 1]),
    )
    for design in designs:
        for corner in (np.zeros(len(bounds)), np.ones(len(bounds))):
            space.case(design, corner)
    return space


def _test_of(request: DesignRequest, plan: Plan) -> dict[str, float]:
    """The last strain of the test that the targets need."""
    windows = [each.window for each in (*request.targets, *request.subject_to) if each.window]
    needed = max((window.stop for window in windows), default=0.0)
    if len(plan.applied_strain) < 2:
        raise fault("strain_max = 0", "leaves no strain to apply; raise it, or leave it out")
    last, step = plan.applied_strain[-1], plan.applied_strain[1]
    if "strain_max" not in request.settings:
        steps = max(1, int(np.ceil(needed / step - ROUND_OFF)))
        return {"strain_max": round(steps * step, 12)}
    if needed > last + ROUND_OFF:
        problem = f"ends before the strain {needed:g} of a target; raise it, or leave it out"
        raise fault(f"settings.strain_max = {last:g}", problem)
    return {}
