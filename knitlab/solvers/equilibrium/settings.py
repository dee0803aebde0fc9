"""Settings of the search for equilibria."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import NonNegativeFloat, PositiveFloat, PositiveInt

from knitlab.model.checked import Checked
from knitlab.model.settings import Fraction, Unit

if TYPE_CHECKING:
    from knitlab.solvers.combination import Combination

Start = Literal["dynamics", "flat", "periodic"]


@dataclass(frozen=True)
class Solver(Checked):
    """Settings of the search for equilibria.

    Attributes:
        tolerance: largest residual force on any free unknown [N].
        max_iterations: largest number of steps of a search.
        step_limit: longest change of the vector between two neighbouring nodes in a step, as a
            fraction of the shorter side of a grid cell; keeps hinges from passing ±π.
        smallest_shift: smallest shift, which also regularises the modes that cost no energy
            [N/mm].
        start: how a clamped sample relaxes: ``dynamics``, the whole flat sheet by damped dynamics,
            then to equilibrium; ``flat``, the whole flat sheet by minimisation; ``periodic``, from
            a tiling of relaxed periodic fabric. Periodic fabric always starts flat, and so does a
            sample with contact in place of ``dynamics``.
        ramp_steps: number of equal steps in which relaxation raises the rest fold angles.
        soft_wall: fraction of the wall stiffness at which relaxation begins, raised tenfold from
            stage to stage; 1 for hard walls from the start.
        waypoint_force: residual force accepted between these steps, as a fraction of the largest
            force of a fold, k_t × fold angle / cell.
        path_step: step of applied strain from one equilibrium to the next; up to four times as long
            where few iterations suffice.
        smallest_step: fraction of a strain step down to which it is halved if the search fails or
            the fabric leaves its branch.
        branch_limit: difference between the change of energy in a strain step and the work done in
            it, as a fraction of that work, or of the work done in ``path_step`` if that is less,
            above which the fabric has left its branch.
        drag: c ε̇, damping of a node times the rate of the applied strain [N/mm]; with 0 the test is
            quasi-static and every state an equilibrium.
    """

    tolerance: Annotated[PositiveFloat, Unit("N")] = 1e-8
    max_iterations: PositiveInt = 4000
    step_limit: Fraction = 0.3
    smallest_shift: Annotated[PositiveFloat, Unit("N/mm")] = 1e-9
    start: Start = "dynamics"
    ramp_steps: PositiveInt = 1
    soft_wall: Fraction = 1e-3
    waypoint_force: Fraction = 1e-3
    path_step: Fraction = 0.01
    smallest_step: Fraction = 1 / 8
    branch_limit: PositiveFloat = 0.05
    drag: Annotated[NonNegativeFloat, Unit("N/mm")] = 0.0


def drag_conflicts(combination: "Combination") -> Iterator[str]:
    """What drag between equilibria cannot be combined with."""
    if combination.method == "dynamics" or not combination.solver.drag:
        return
    if "periodic" in combination.boundaries:
        yield (
            "needs a sample between clamps, because periodic fabric has no fixed point; take"
            " boundary = clamped, or drag = 0"
        )
    if combination.sensitivities:
        yield "has no sensitivities; leave them out, or take drag = 0"
