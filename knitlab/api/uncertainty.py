"""Uncertainty: what that of calibrated stripes makes of the results of designs."""

from pathlib import Path

import xarray as xr

from knitlab.api.cubes import Cube, opened
from knitlab.cube.cube_file import joined_cubes
from knitlab.cube.uncertainty import uncertainty_of
from knitlab.io.errors import fault
from knitlab.sweep.material import Material
from knitlab.sweep.stripe_covariance import uncertain_stripes


def uncertainty(*cubes: Cube, material: str | Path | Material) -> xr.Dataset:
    """Standard deviations of Poisson's ratio and force, and the stripe numbers they are due to.

    They are those of first order, J Σ Jᵀ, by the sensitivities J of the cubes and the covariance Σ
    of the stripes; nothing is simulated. They are too small or too large where a quantity is not
    linear within the uncertainty, as near a snap: :func:`knitlab.sample_stripes` samples it.

    Args:
        cubes: cubes of designs along the same dimensions, run with ``sensitivities = true`` and
            the same material.
        material: material file, as ``knitlab calibrate`` writes it, or a material with covariances.

    Returns:
        For each design ``poisson_ratio_sd`` [1] and ``reaction_force_sd`` [N] along
        ``applied_strain``, and ``poisson_ratio_min_sd``. For each of these, along
        ``stripe_parameter``, ``…_share`` in the variance (all sum to 1; with correlated numbers,
        some may be negative) and ``…_explained``, the part of the variance that would vanish if
        this number were known exactly; and ``…_leading``, the number that explains most, which
        is the one to measure better.

    Raises:
        BadInput: if a cube has no sensitivities or other stripes, or a covariance is missing, or
            is not positive semidefinite.

    Example:
        >>> spread = kl.uncertainty("results/reference/acrylic", material="docs/examples/swatches/acrylic.toml")
        >>> round(spread["poisson_ratio_min_sd"].sel(n_stripe=4, n_subunit=16).item(), 3)
        0.0
    """
    if not cubes:
        raise fault("cubes", "none is given; name a cube or its results folder")
    read = [opened(cube) for cube in cubes]
    cube = joined_cubes(read) if len(read) > 1 else read[0]
    return uncertainty_of(cube, uncertain_stripes(material))
