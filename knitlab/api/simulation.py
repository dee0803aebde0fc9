"""One design, simulated in this process."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float
from tqdm.auto import tqdm

from knitlab.api.design import Design, resolve
from knitlab.execution.cube import known_in_advance
from knitlab.io.design_status import Status
from knitlab.io.schema import described
from knitlab.simulation.simulate import simulated
from knitlab.study.gauge import sizes_of, stated

DEFAULT_STRAINS = tuple(round(0.03 * step, 2) for step in range(16))
"""Strains of the preview: 0 to 45 % in steps of 3 %."""


class NotConverged(UserWarning):
    """A test that did not reach its last strain: missing results are NaN, see ``status``."""


def simulate(
    design: Design,
    applied_strain: Sequence[float] | Float[np.ndarray, " strain"] = DEFAULT_STRAINS,
    *,
    progress: bool = False,
    **settings: Any,
) -> xr.Dataset:
    """Relax a fabric and pull it along the warp, in this process.

    The test is that of the paper, Sec. "Kinematics under tension".

    Args:
        design: the knit and its sample.
        applied_strain: strains of the test along the warp, ascending from 0 [1].
        progress: whether to draw a progress bar.
        settings: settings that override those of ``params/*.toml``, like ``--set``:
            ``k_t_factor=1.2``, ``cell_size="relaxed"``, ``robustness=2``, ``layout="ridges"``.

    Returns:
        A dataset of this design: every variable of a cube along ``applied_strain``, and
        ``position`` (applied_strain, node_y, node_x, component) in mm. Each has its unit in
        ``attrs["units"]``. ``status``, ``residual_force`` and ``iterations`` describe the
        convergence.

    Raises:
        BadInput: with every fault of the design, the strains and the settings.

    Warns:
        NotConverged: if a strain was not reached; results from there on are NaN.

    Example:
        >>> import knitlab as kl
        >>> design = kl.Design(n_stripe=4, n_subunit=8, boundary="periodic")
        >>> test = kl.simulate(design, [0, 0.03, 0.06])
        >>> bool(test["poisson_ratio"].sel(applied_strain=0.06) < 0)
        True
    """
    strains = np.asarray(applied_strain, dtype=float).tolist()
    resolved = resolve(design, strains, settings)
    case = resolved.case
    with tqdm(total=case.states, unit="state", disable=not progress) as bar:

        def report(_: str, states: float) -> None:
            bar.update(int(states) - bar.n)

        results = simulated(case, report)
    values = {str(name): array.values for name, array in results.data_vars.items()}
    sizes = sizes_of(case, values, resolved.gauge)
    results = results.assign(known_in_advance(case) | sizes)
    results.attrs |= stated(resolved.gauge)
    if results["status"] != Status.ok:
        warnings.warn(f"{case.label}: {results.attrs['reason']}", NotConverged, stacklevel=2)
    return described(results)
