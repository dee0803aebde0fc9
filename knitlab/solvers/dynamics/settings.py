"""Settings of the dynamics, in a module that does not import JAX."""

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from knitlab.model.checked import Checked
from knitlab.model.settings import Fraction, Position, Unit

if TYPE_CHECKING:
    from knitlab.solvers.combination import Combination

Integrator = Literal["leapfrog", "tsit5"]
Ending = Literal["rest", "time", "steps"]


@dataclass(frozen=True)
class Dynamics(Checked):
    """Settings of damped motion in time (paper, Secs. "3D model" and "Relaxation of a pattern").

    Attributes:
        integrator: ``"leapfrog"``, explicit with a step from the highest frequency, or
            ``"tsit5"``, the paper's Runge–Kutta method with an adaptive step.
        ending: ``"rest"`` relaxes until the fabric is at rest and, in a test by dynamics, lets it
            come to rest at every strain; ``"time"`` relaxes for ``relax_time`` and pulls without a
            pause at ``strain_rate``; ``"steps"`` does so for ``relax_steps`` and at ``step_strain``
            a step, the largest stable one of the flat sheet. Every design then has a time of its
            own, as with the paper's fixed number of steps.
        damping_ratio: viscous damping of a node, c, over √(k_s m) with the smaller k_s of the two
            stripes and the mass m of a node [1].
        surface_density: mass of the fabric per area, ρ_s [g/mm²].
        release: part of the relaxation over which the folds develop: their rest angles grow
            evenly from flat. With 0 they are there from the beginning. With ``"rest"`` it counts
            in ``relax_time``.
        relax_time: duration of the relaxation with ``"time"`` [ms].
        strain_rate: rate of the applied strain in a test by dynamics, but with ``"steps"`` [1/ms].
        relax_steps: duration of the relaxation with ``"steps"``.
        step_strain: applied strain of a step with ``"steps"`` [1].
        rest_force: largest elastic force and drag on a free node at rest [N].
        longest_time: longest motion towards rest [ms].
        step_safety: time step of the leapfrog over that of its stability limit.
        relative_tolerance, absolute_tolerance: error tolerances of a step of ``"tsit5"``, for
            positions [mm], velocities [mm/ms] and work [N mm], with the same numbers.
        snapshots: number of configurations recorded of a relaxation.
    """

    integrator: Integrator = "leapfrog"
    ending: Ending = "rest"
    damping_ratio: NonNegativeFloat = 0.035
    surface_density: Annotated[PositiveFloat, Unit("g/mm^2")] = 1.1e-4
    release: Position = 0.5
    relax_time: Annotated[PositiveFloat, Unit("ms")] = 40.0
    strain_rate: Annotated[PositiveFloat, Unit("1/ms")] = 0.012
    relax_steps: PositiveInt = 4000
    step_strain: PositiveFloat = 1.5e-4
    rest_force: Annotated[PositiveFloat, Unit("N")] = 1e-6
    longest_time: Annotated[PositiveFloat, Unit("ms")] = 400.0
    step_safety: Fraction = 0.8
    relative_tolerance: Fraction = 1e-6
    absolute_tolerance: PositiveFloat = 1e-10
    snapshots: Annotated[int, Field(ge=0, le=1000)] = 0


def contact_conflicts(combination: "Combination") -> Iterator[str]:
    """What cannot follow contact: an integrator, and equilibria without the library for it."""
    if combination.options.contact == "none":
        return
    if combination.method == "dynamics":
        if combination.dynamics.integrator == "tsit5":
            yield "needs the leapfrog; take integrator = leapfrog, or contact = none"
    elif find_spec("ipctk") is None:  # it has no wheel for Linux on ARM
        yield "needs ipctk; pip install ipctk, or take method = dynamics or contact = none"
