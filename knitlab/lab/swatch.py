"""Simulation of a calibrated swatch: how far the network is from the records of the fit."""

import warnings
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from knitlab.lab.calibration import Calibration
from knitlab.model.computing import computing
from knitlab.model.settings import ModelOptions, Sheet
from knitlab.model.stripe import Stripe
from knitlab.runs.parameters import defaults
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.method import Equilibrium
from knitlab.solvers.loads import WARP
from knitlab.solvers.loads.load import Load
from knitlab.solvers.loads.weft import Weft

Direction = Literal["across", "along"]
Points = Float[np.ndarray, " point"]

FAR = 0.05  # largest difference over the largest force, above which there is a warning
STATES = 12  # strains of a simulated swatch, at most
# Ridges lie along x: a swatch is pulled across them along the warp.
LOADS: dict[Direction, Load] = {"across": WARP, "along": Weft()}
ENDLESS = ModelOptions(cell_size="relaxed", boundary="periodic", fold_phase="stripe_centre")
OUT_OF_REACH = 100.0  # distance of the walls, in periods: a testing machine has none


@dataclass(frozen=True)
class Swatch:
    """A record, and the simulated force at some of its strains [N/mm], or on one row [N]."""

    direction: Direction
    strain: Points
    force: Points  # measured
    simulated: Points  # NaN where the simulation did not converge

    @property
    def error(self) -> float:
        """Largest difference over the largest measured force, NaN if a state did not converge."""
        return float(np.max(np.abs(self.simulated - self.force)) / np.max(np.abs(self.force)))

    @property
    def apart(self) -> float:
        """Deprecated: :attr:`error`."""
        warnings.warn("Swatch.apart is now Swatch.error", DeprecationWarning, stacklevel=2)
        return self.error

    @property
    def report(self) -> str:
        """How far the simulation is from the record, as a line of text."""
        error = f"at most {self.error:.1%} of the largest force from its record"
        if np.isnan(self.error):
            error = "not every state converged"
        strains = f"at {len(self.strain)} strains"
        return f"swatch   simulated {self.direction} the ridges {strains}: {error}"

    @property
    def warning(self) -> str:
        """What to do if the simulation is far from the record; empty if it is not."""
        if not self.error > FAR:
            return ""
        where = self.strain[np.argmax(np.abs(self.simulated - self.force))]
        return (
            f"{self.direction} the ridges the simulated swatch is {self.error:.0%} of the largest"
            f" force from its record, at a strain of {where:.2g}; compare the curves in the figure,"
            " and try another law, or records of a smaller strain"
        )


@computing()
def simulated_swatches(calibration: Calibration) -> list[Swatch]:
    """Simulate the swatches of a calibration: across the ridges, and along them if measured.

    The network of an endless pure sheet is relaxed and pulled to some strains of each record.

    Args:
        calibration: the fit, as :func:`knitlab.calibrate` returns it.

    Returns:
        A swatch for each direction, with its ``strain`` [1], the measured ``force`` and the
        ``simulated`` one, in the unit of the records; ``error`` is their largest difference over
        the largest force.

    Example:
        >>> record = kl.read_tension_record("docs/examples/swatches/records/rib.csv", width=95.5)
        >>> fitted = kl.calibrate(record.strain, record.force, period=10, per_width=True)
        >>> [swatch] = kl.simulated_swatches(fitted)
        >>> bool(swatch.error < 0.01)
        True
    """
    stripe = calibration.stripe("rib", 1, "relaxed")
    records: list[tuple[Direction, Points, Points]] = [
        ("across", calibration.strain, calibration.force)
    ]
    if calibration.along is not None:
        records.append(("along", calibration.along.strain, calibration.along.force))
    swatches = []
    for direction, strain, force in records:
        order = np.argsort(strain)
        order = order[strain[order] > 0]
        some = order[np.unique(np.linspace(0, len(order) - 1, STATES).round().astype(int))]
        simulated = _forces(stripe, strain[some], direction)
        if calibration.per_width:
            cell = calibration.flat_cell
            width = cell if direction == "across" else cell * stripe.contraction
            simulated = simulated / width
        swatches.append(Swatch(direction, strain[some], force[some], simulated))
    return swatches


def _forces(stripe: Stripe, strain: Points, direction: Direction) -> Points:
    known = defaults()
    case = Case(
        design={"n_stripe": stripe.n},
        weft=stripe,
        warp=stripe,
        sheet=Sheet(z_max=OUT_OF_REACH * stripe.period, k_wall=known.sheet.k_wall),
        options=ENDLESS,
        pattern=("G",),
        periods=1,
        unit_cells=(1, 1),
        applied_strain=(0.0, *strain.tolist()),
        method="equilibrium",
        solver=known.solver,
        load=LOADS[direction],
    )
    (test,) = Equilibrium().stretch([case], lambda *_: None)
    forces = np.full(len(case.applied_strain), np.nan)
    if test.loading is not None:
        for number, state in enumerate(test.states):
            if state.converged:
                forces[number] = test.loading.reaction_force(state.gradient)
    shape = case.mesh_shape
    return forces[1:] / (shape.cells_x if direction == "across" else shape.cells_y)
