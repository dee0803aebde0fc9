"""One design, simulated in this process."""

import warnings
from collections.abc import Sequence

import numpy as np
import xarray as xr
from jaxtyping import Float
from pydantic import ValidationError
from tqdm.auto import tqdm

from knitlab.api.design import Design
from knitlab.api.single_design import of_design
from knitlab.cube.schema import Status, described
from knitlab.dynamics.settings import DynamicsSettings
from knitlab.equilibrium.settings import SolverSettings
from knitlab.fabric.settings import ModelOptions, PlainKnit, Sheet
from knitlab.io.errors import BadInput, faults_of
from knitlab.measure.capacitance.capacitor import Capacitor
from knitlab.measure.knit_size import Gauge
from knitlab.simulation.case import Method
from knitlab.simulation.simulate import simulated
from knitlab.sweep.cube import known_in_advance, sizes_of, stated_gauge
from knitlab.sweep.parameters import defaults
from knitlab.sweep.workflow import ProtocolSection

DEFAULT_STRAINS = tuple(round(0.03 * step, 2) for step in range(16))
"""Strains of the preview: 0 to 45 % in steps of 3 %."""


class NotConverged(UserWarning):
    """A test that did not reach its last strain: missing results are NaN, see ``status``."""


def simulate(
    design: Design,
    applied_strain: Sequence[float] | Float[np.ndarray, " strain"] = DEFAULT_STRAINS,
    *,
    model: ModelOptions | None = None,
    sheet: Sheet | None = None,
    plain: PlainKnit | None = None,
    solver: SolverSettings | None = None,
    dynamics: DynamicsSettings | None = None,
    capacitor: Capacitor | None = None,
    gauge: Gauge | None = None,
    method: Method = "equilibrium",
    sensitivities: bool = False,
    unloading: bool = False,
    robustness: int = 0,
    progress: bool = False,
) -> xr.Dataset:
    """Relax a fabric and pull it along the warp, in this process.

    The test is that of the paper, Sec. "Kinematics under tension".

    Args:
        design: the knit and its sample.
        applied_strain: strains of the test along the warp, ascending from 0 [1].
        model: model options, such as ``knitlab.Model(cell_size="flat")``; by default this and the
            other tables of settings are those of :func:`knitlab.defaults`.
        sheet: the walls, and the thickness of the fabric.
        plain: stiffness of plain knit.
        solver: settings of the search for equilibria.
        dynamics: settings of motion in time.
        capacitor: electrodes and their layout; by default the fabric has none.
        gauge: size of a stitch in cloth.
        method: how the states of the test are reached, ``"equilibrium"`` or ``"dynamics"``.
        sensitivities: whether to add derivatives with respect to the stripe parameters.
        unloading: whether to add the states of unloading at the same strains.
        robustness: number of slightly perturbed copies over which results are spread.
        progress: whether to draw a progress bar.

    Returns:
        A dataset of this design: every variable of a cube along ``applied_strain``, and
        ``position`` (applied_strain, node_y, node_x, component) in mm. Each has its unit in
        ``attrs["units"]``. ``status``, ``residual_force`` and ``iterations`` describe the
        convergence.

    Raises:
        BadInput: if the design, the strains or a setting is at fault, or if settings contradict.

    Warns:
        NotConverged: if a strain was not reached; results from there on are NaN.

    Example:
        >>> import knitlab as kl
        >>> design = kl.Design(4, 8, boundary="periodic")
        >>> test = kl.simulate(design, [0, 0.03, 0.06])
        >>> bool(test["poisson_ratio"].sel(applied_strain=0.06) < 0)
        True
    """
    strains = np.asarray(applied_strain, dtype=float).tolist()
    parameters = defaults().with_tables(
        model=model,
        sheet=sheet,
        plain=plain,
        solver=solver,
        dynamics=dynamics,
        capacitor=capacitor,
        gauge=gauge,
    )
    try:
        protocol = ProtocolSection(
            method=method, sensitivities=sensitivities, unloading=unloading, robustness=robustness
        )
    except ValidationError as error:
        raise BadInput(faults_of(error, "simulate")) from error
    resolved = of_design(design, strains, parameters, protocol, electrodes=capacitor is not None)
    case = resolved.case
    with tqdm(total=case.states, unit="state", disable=not progress) as bar:

        def report(_: str, states: float) -> None:
            bar.update(int(states) - bar.n)

        results = simulated(case, report)
    values = {str(name): array.values for name, array in results.data_vars.items()}
    sizes = sizes_of(case, values, resolved.gauge)
    results = results.assign(known_in_advance(case) | sizes)
    results.attrs |= stated_gauge(resolved.gauge)
    if results["status"] != Status.ok:
        warnings.warn(f"{case.label}: {results.attrs['reason']}", NotConverged, stacklevel=2)
    return described(results)
