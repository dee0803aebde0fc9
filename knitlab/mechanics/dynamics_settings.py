"""Settings of the dynamics, apart from it because diffrax takes long to import."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, PositiveInt

from knitlab.model.setting_types import Fraction, Unit

Ending = Literal["steady", "fixed_steps"]


@dataclass(frozen=True)
class DynamicsSettings:
    """Settings of the integration in time.

    Attributes:
        ending: ``"steady"`` ends a motion at rest; ``"fixed_steps"`` ends it as the paper does,
            after a number of equal steps.
        steady_force: largest elastic force and drag on a free node at rest [N].
        fixed_steps_force: the same for ``"fixed_steps"`` [N].
        duration: longest motion towards one state, after the end of the drive [ms].
        max_steps: largest number of time steps of a motion.
        relative_tolerance, absolute_tolerance: error tolerances of a time step, for positions [mm],
            velocities [mm/ms] and work [N mm], with the same numbers.
        fixed_steps: number of steps for ``"fixed_steps"``.
        time_step: size of these steps [ms].
        ramp_rate: largest applied strain rate of a tensile test [1/ms].
        quasi_static_limit: kinetic energy plus work against the drag, over the work of a strain
            step, up to which the step is quasi-static.
        smallest_rate: smallest rate, as a fraction of ``ramp_rate``, at which a step that is not
            quasi-static is repeated.
        snapshots: number of configurations recorded of a relaxation.
    """

    ending: Ending = "steady"
    steady_force: Annotated[PositiveFloat, Unit("N")] = 1e-7
    fixed_steps_force: Annotated[PositiveFloat, Unit("N")] = 1e-3
    duration: Annotated[PositiveFloat, Unit("ms")] = 100.0
    max_steps: PositiveInt = 1_000_000
    relative_tolerance: Fraction = 1e-6
    absolute_tolerance: PositiveFloat = 1e-10
    fixed_steps: PositiveInt = 1600
    time_step: Annotated[PositiveFloat, Unit("ms")] = 1e-3
    ramp_rate: Annotated[PositiveFloat, Unit("1/ms")] = 0.02
    quasi_static_limit: PositiveFloat = 0.05
    smallest_rate: Fraction = 1 / 16
    snapshots: Annotated[int, Field(ge=2, le=1000)] = 60

    @property
    def force_left(self) -> float:
        """Largest force at the end of a motion [N]."""
        return self.steady_force if self.ending == "steady" else self.fixed_steps_force

    @property
    def settling_time(self) -> float:
        """Longest motion after the end of the drive [ms]."""
        steady = self.ending == "steady"
        return self.duration if steady else self.fixed_steps * self.time_step
