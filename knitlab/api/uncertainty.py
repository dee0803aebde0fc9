"""Uncertainty: what that of calibrated stripes makes of the results of designs."""

from pathlib import Path

import xarray as xr

from knitlab.api.cubes import Cube, opened
from knitlab.cube.sampled import sampled_uncertainty
from knitlab.cube.schema import SAMPLE
from knitlab.cube.uncertainty import uncertainty_of
from knitlab.io.errors import fault
from knitlab.io.names import check_suffix
from knitlab.io.toml import TOML
from knitlab.sweep.cube import joined_cubes
from knitlab.sweep.material import Material
from knitlab.sweep.stripe_covariance import uncertain_stripes
from knitlab.sweep.stripe_samples import write_samples


def uncertainty(*cubes: Cube, material: str | Path | Material | None = None) -> xr.Dataset:
    """Standard deviations of Poisson's ratio and force, and the stripe numbers they are due to.

    They are those of first order, J Σ Jᵀ, by the sensitivities J of the cubes and the covariance Σ
    of the stripes; nothing is simulated. They are too small or too large where a quantity is not
    linear within the uncertainty, as near a snap. Those of samples (:func:`sample_stripes`) are
    the statistics of these.

    Args:
        cubes: cubes of designs along the same dimensions, run with ``sensitivities = true`` and
            the same material; or of samples.
        material: material file, as ``knitlab calibrate`` writes it, or a material with covariances;
            none for samples.

    Returns:
        For each design ``poisson_ratio_sd`` [1] and ``reaction_force_sd`` [N] along
        ``applied_strain``, and ``poisson_ratio_min_sd``. For each of these, along
        ``stripe_parameter``, ``…_share`` in the variance (all sum to 1; with correlated numbers,
        some may be negative) and ``…_explained``, the part of the variance that would vanish if
        this number were known exactly; and ``…_leading``, the number that explains most, which
        is the one to measure better. Of samples, ``…_mean`` and ``…_sd`` of every variable, the
        number of ``samples`` that are ok, and of those for Sobol indices ``…_first_order`` and
        ``…_total``.

    Raises:
        BadInput: if a cube has no sensitivities or other stripes, or a covariance is missing, or
            is not positive semidefinite.

    Example:
        >>> acrylic = "docs/examples/swatches/acrylic.toml"
        >>> spread = kl.uncertainty("results/reference/acrylic", material=acrylic)
        >>> spread["poisson_ratio_min_leading"].sel(n_stripe=4, n_subunit=16).item()
        'garter_k_s'
    """
    if not cubes:
        raise fault("cubes", "none is given; name a cube or its results folder")
    read = [opened(cube) for cube in cubes]
    cube = joined_cubes(read) if len(read) > 1 else read[0]
    if SAMPLE in cube.dims:
        return sampled_uncertainty(cube)
    if material is None:
        raise fault("material", "is not given; give the file with the covariances of its stripes")
    return uncertainty_of(cube, uncertain_stripes(material))


def sample_stripes(
    material: str | Path,
    output: str | Path,
    *,
    n_stripe: int,
    samples: int = 32,
    sobol: bool = False,
    workflow: str | Path = "periodic",
    seed: int = 0,
) -> Path:
    """Write a workflow that simulates designs with samples of the stripe numbers of a material.

    The samples are a Latin hypercube of the normal distribution of the fit, along the dimension
    ``sample`` of the cube. Run as any workflow, they are kept and continued.

    Args:
        material: material file with covariances, as ``knitlab calibrate`` writes it.
        output: workflow to write, ``.toml``.
        n_stripe: stitches across a rib stripe of the designs.
        samples: number of samples; for Sobol indices a power of 2, of which each of the d uncertain
            numbers takes one more set, and two: (d + 2) times as many are simulated.
        sobol: whether to sample for Sobol indices, by Saltelli's design. These are defined for
            independent numbers: correlations of the fit are left out.
        workflow: name or path of the workflow that all else is taken from.
        seed: of the random numbers.

    Returns:
        The path of the workflow, for :func:`knitlab.run` and then :func:`knitlab.uncertainty`.

    Raises:
        BadInput: if the material lacks a covariance, or a number is at fault.

    Example:
        >>> acrylic = "docs/examples/swatches/acrylic.toml"
        >>> path = kl.sample_stripes(acrylic, folder / "samples.toml", n_stripe=4, samples=8)
        >>> len(kl.plan(path, n_subunit=16).cases)
        8
    """
    material, output = Path(material), Path(output)
    check_suffix(output, TOML, "a workflow")
    write_samples(material, output, n_stripe, samples, str(workflow), seed, sobol)
    return output
