"""The search space: designs, and the numbers of stripes and gauge that vary within bounds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.io.errors import fault
from knitlab.measure.knit_size import Gauge
from knitlab.measure.sensitivity import STRIPE_PARAMETERS
from knitlab.model.stripe import Stripe
from knitlab.optimisation.request import CHOICES, PARAMETERS, DesignRequest
from knitlab.simulation.case import Case
from knitlab.study.plan import Plan, make_plan

ROUND_OFF = 1e-9
AT_BOUND = 1e-3
"""Part of the way between bounds within which a value counts as on one."""
DesignLabels = tuple[int | str, ...]
"""n_stripe, n_subunit and, where it varies, the name of the pattern."""
Place = Float[np.ndarray, " variable"]
"""Values of the variables as parts of the way, in logarithms, between their bounds [1]."""


@dataclass(frozen=True)
class SearchSpace:
    """What a search may change.

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
        """Values of the variables at a place, in their units."""
        logarithms = self.lower + np.clip(place, 0, 1) * (self.upper - self.lower)
        return dict(zip(self.names, np.exp(logarithms).tolist(), strict=True))

    def place_of(self, values: Mapping[str, float]) -> Place:
        """The place of values, or the nearest within the bounds; the inverse of :meth:`values`."""
        logarithms = np.log([values[name] for name in self.names])
        return np.clip((logarithms - self.lower) / (self.upper - self.lower), 0, 1)

    def bounds_at(self, place: Place, downhill: Place) -> list[str]:
        """Bounds that hold a place back.

        Args:
            place: the place.
            downhill: direction in which the distance falls; where it is 0, a bound that is
                reached counts.
        """
        held = []
        for name, at, pull, low, high in zip(
            self.names, place, downhill, np.exp(self.lower), np.exp(self.upper), strict=True
        ):
            if at < AT_BOUND and pull <= 0:
                held.append(f"{name} >= {low:.4g}")
            if at > 1 - AT_BOUND and pull >= 0:
                held.append(f"{name} <= {high:.4g}")
        return held

    def plan(self, design: DesignLabels, values: Mapping[str, float]) -> Plan:
        """The plan of one case: a design with values of the variables.

        Raises:
            BadInput: if a value is out of range, as a rest angle that reaches π.
        """
        return make_plan(self.workflow, {**self.settings, **values, **self.labels(design)})

    def labels(self, design: DesignLabels) -> dict[str, int | str]:
        """The labels of a design, by dimension."""
        return dict(zip(self.dims, design, strict=True))

    def case(self, design: DesignLabels, place: Place) -> tuple[Case, Gauge]:
        """The case at a place, and the gauge of its sizes in cloth."""
        plan = self.plan(design, self.values(place))
        (case,) = plan.cases.values()
        return case, plan.gauge

    def start(self, design: DesignLabels) -> Place:
        """The place of the tables' values, or the nearest within the bounds."""
        plan = self.plan(design, {})
        (case,) = plan.cases.values()
        stripes = {"weft": case.weft, "warp": case.warp}
        known = {
            name: 1.0 if name.endswith("_factor") else _number(name, stripes, plan.gauge)
            for name in self.names
        }
        return self.place_of(known)

    def acts_on(self) -> Float[np.ndarray, "parameter variable"]:
        """How the logarithm of each parameter of stripes and gauge follows each place."""
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

    The test goes as far as the targets reach, where the request does not say.

    Raises:
        BadInput: if it holds no possible design, no value within its bounds can be simulated, or
            the test ends before a target's window.
    """
    settings = {**request.settings, "robustness": 0}
    labels = {name: list(values) for name, values in request.choices.items()}
    if "strain_step" in settings:
        # The workflow's last strain need be no multiple of it.
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
    """The last strain of the test, as far as the targets need it."""
    windows = [its.window for its in (*request.targets, *request.subject_to) if its.window]
    needed = max((window.stop for window in windows), default=0.0)
    if len(plan.applied_strain) < 2:
        raise fault("strain_max = 0", "leaves nothing to pull; raise it, or leave it out")
    last, step = plan.applied_strain[-1], plan.applied_strain[1]
    if "strain_max" not in request.settings:
        steps = max(1, int(np.ceil(needed / step - ROUND_OFF)))
        return {"strain_max": round(steps * step, 12)}
    if needed > last + ROUND_OFF:
        problem = f"ends before the strain {needed:g} of a target; raise it, or leave it out"
        raise fault(f"settings.strain_max = {last:g}", problem)
    return {}
