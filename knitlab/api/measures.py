"""Own functions of the shape of a fabric, along a test, with their derivatives."""

import json

import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from knitlab.cube.case_file import configurations
from knitlab.equilibrium.linear_response import NoDerivative
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.fabric import Fabric
from knitlab.inverse.quantities import Measure
from knitlab.io.errors import BadInput, Fault, fault
from knitlab.simulation.case import Case, case_of
from knitlab.simulation.sensitivity import STRIPE_PARAMETERS, adjoint_of, logarithmic


def evaluate(test: xr.Dataset, *, sensitivities: bool = True, **measures: Measure) -> xr.Dataset:
    """Evaluate own functions of the shape at every strain of a test.

    Derivatives are exact, by one adjoint solve for each state: the change of the value as the
    fabric follows a change of its stripe parameters at fixed applied strain.

    Args:
        test: dataset of :func:`knitlab.simulate`, or of a case file.
        sensitivities: whether to compute derivatives.
        measures: functions of a configuration, with ``positions`` (node_y, node_x, 3) and
            ``lengths`` (2) in mm, that return one number and are written in JAX.

    Returns:
        For each function a variable with its name, along ``applied_strain``, and its logarithmic
        derivatives p ∂f/∂p as ``NAME_sensitivity`` (applied_strain, stripe_parameter). Values
        are NaN where the test did not converge; derivatives are also NaN at snaps.

    Raises:
        BadInput: if the dataset has no shapes, or a function does not return one number.

    Example:
        >>> import jax.numpy as jnp
        >>> import knitlab as kl
        >>> design = kl.Design(n_stripe=4, n_subunit=8, boundary="periodic")
        >>> test = kl.simulate(design, [0, 0.03])
        >>> def thickness(shape):
        ...     return jnp.ptp(shape.positions[..., 2])
        >>> found = kl.evaluate(test, thickness=thickness)
        >>> found["thickness_sensitivity"].dims
        ('applied_strain', 'stripe_parameter')
    """
    if "position" not in test or "parameters" not in test.attrs:
        raise fault("test", "has no node positions; give a dataset of knitlab.simulate")
    shapes = configurations(test)
    reached = np.asarray(np.isfinite(shapes.positions).all(axis=(1, 2, 3)))
    _check(shapes[0], measures)
    strains = test["applied_strain"]
    found = xr.Dataset(coords={"applied_strain": strains})
    for name, measure in measures.items():
        values = [float(measure(shapes[k])) if reached[k] else np.nan for k in range(len(reached))]
        found[name] = ("applied_strain", values)
    if sensitivities and reached.any():
        found = found.assign_coords(stripe_parameter=list(STRIPE_PARAMETERS))
        case = case_of(json.loads(test.attrs["parameters"]))
        slopes = _slopes(case, strains.values, shapes, reached, measures)
        for place, name in enumerate(measures):
            dims = ("applied_strain", "stripe_parameter")
            found[f"{name}_sensitivity"] = (dims, slopes[:, place])
    return found


def _check(shape: Configuration, measures: dict[str, Measure]) -> None:
    faults = []
    for name, measure in measures.items():
        given = jnp.shape(measure(shape))
        if given:
            faults.append(Fault(name, f"returns an array of shape {given}; return one number"))
    if faults:
        raise BadInput(faults)


def _slopes(
    case: Case,
    strains: Float[np.ndarray, " strain"],
    shapes: Configuration,
    reached: np.ndarray,
    measures: dict[str, Measure],
) -> Float[np.ndarray, "strain measure parameter"]:
    stripes = case.stripe_pair

    def stacked(relaxed: Configuration, strained: Configuration, fabric: Fabric) -> Array:
        return jnp.stack([measure(strained) for measure in measures.values()])

    slopes = np.full((len(strains), len(measures), len(STRIPE_PARAMETERS)), np.nan)
    try:
        adjoint = adjoint_of(case, shapes[0])
    except NoDerivative:
        return slopes
    for place in np.flatnonzero(reached):
        try:
            derivatives = (
                adjoint.of_strained(float(strains[place]), shapes[place], stacked)
                if place
                else adjoint.of_relaxed(stacked)
            )
        except NoDerivative:
            continue
        slopes[place] = logarithmic(derivatives, stripes)
    return slopes
