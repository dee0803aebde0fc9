"""Uncertainty: what that of calibrated stripes makes of the results of designs."""

from pathlib import Path

import xarray as xr

from knitlab.api.cubes import Cube, as_cube
from knitlab.cubes.normalised import naming_missing
from knitlab.cubes.sampled import sampled_uncertainty
from knitlab.cubes.uncertainty import first_order
from knitlab.io.errors import invalid, shortened
from knitlab.io.names import check_suffix
from knitlab.io.toml import TOML
from knitlab.observables.schema import SAMPLE
from knitlab.runs.cube import joined_cubes
from knitlab.runs.material import Material
from knitlab.runs.stripe_covariance import uncertain_stripes
from knitlab.runs.stripe_samples import write_samples


def uncertainty(
    *cubes: Cube, material: str | Path | Material | None = None, uncertainty_of: str | None = None
) -> xr.Dataset:
    """Standard deviations of Poisson's ratio and force, and the stripe numbers they are due to.

    They are those of first order, J Σ Jᵀ, by the sensitivities J of the cubes and the covariance Σ
    of the stripes: of new swatches, or of the mean of all. Their 95 % intervals are those of
    Student's t, as scatter is known from a few repeats. Nothing is simulated. They are too small or
    too large where a quantity is not linear within the uncertainty, as near a snap. Those of
    samples (:func:`sample_stripes`) are the statistics of these.

    Args:
        cubes: cubes of designs along the same dimensions, run with ``sensitivities = true`` and
            the same material; or of samples.
        material: material file, as ``knitlab calibrate`` writes it, or a material with covariances;
            none for samples.
        uncertainty_of: ``"swatch"``, of fabric that is knitted anew, or ``"mean"``, of the mean
            stripe. By default a new swatch, if repeats are known of all stripes of the material.

    Returns:
        For each design ``poisson_ratio_sd`` [1] and ``reaction_force_sd`` [N] along
        ``applied_strain``, and ``poisson_ratio_min_sd``; ``…_halfwidth``, half the 95 % interval,
        and the ``…_degrees_of_freedom`` of its Student's t. The attribute ``uncertainty_of`` says
        what is uncertain, and ``comment`` how it is known. For each quantity, along
        ``stripe_parameter``, ``…_share`` in the variance (all sum to 1; with correlated numbers,
        some may be negative) and ``…_explained``, the part of the variance that would vanish if
        this number were known exactly; and ``…_leading``, the number that explains most, which
        is the one to measure better. Of samples, ``…_mean`` and ``…_sd`` of every variable,
        from 40 samples on ``…_halfwidth`` by their quantiles, the number of ``samples`` that
        are ok, and of those for Sobol indices ``…_first_order`` and ``…_total``.

    Raises:
        InputError: if a cube has no sensitivities or other stripes, or a covariance is missing, is
            not positive semidefinite, or has no repeats and a new swatch is asked for.

    Example:
        >>> acrylic = "docs/examples/swatches/acrylic.toml"
        >>> spread = kl.uncertainty("results/reference/acrylic", material=acrylic)
        >>> spread["poisson_ratio_min_leading"].sel(n_stripe=4, n_subunit=16).item()
        'garter_theta_0'
    """
    if not cubes:
        raise invalid("cubes", "none is given; name a cube or its results folder")
    read = [as_cube(cube) for cube in cubes]
    with naming_missing("uncertainties", read):
        cube = joined_cubes(read) if len(read) > 1 else read[0]
        if SAMPLE in cube.dims:
            if uncertainty_of is not None:
                message = "is that of the samples, as they were drawn; leave it out"
                raise invalid(f"uncertainty_of {shortened(uncertainty_of)}", message)
            return sampled_uncertainty(cube)
        if material is None:
            message = "is not given; give the file with the covariances of its stripes"
            raise invalid("material", message)
        return first_order(cube, uncertain_stripes(material, uncertainty_of))


def sample_stripes(
    material: str | Path,
    output: str | Path,
    *,
    n_stripe: int,
    samples: int = 32,
    sobol: bool = False,
    workflow: str | Path = "periodic",
    seed: int = 0,
    uncertainty_of: str | None = None,
) -> Path:
    """Write a workflow that simulates designs with samples of the stripe numbers of a material.

    The samples are a Latin hypercube along the dimension ``sample`` of the cube, of normal
    deviates or, where the covariance has degrees of freedom, of the multivariate t. Run as any
    workflow, they are kept and continued.

    Args:
        material: material file with covariances, as ``knitlab calibrate`` writes it.
        output: workflow to write, ``.toml``.
        n_stripe: stitches across a rib stripe of the designs.
        samples: number of samples; for Sobol indices a power of 2, of which each of the d uncertain
            numbers takes one more set, and two: (d + 2) times as many are simulated.
        sobol: whether to sample for Sobol indices, by Saltelli's design. These are defined for
            independent numbers of finite variance: correlations of the fit are left out, and
            deviates are normal.
        workflow: name or path of the workflow that all else is taken from.
        seed: of the random numbers.
        uncertainty_of: ``"swatch"`` or ``"mean"``, as of :func:`knitlab.uncertainty`.

    Returns:
        The path of the workflow, for :func:`knitlab.run` and then :func:`knitlab.uncertainty`.

    Raises:
        InputError: if the material lacks a covariance, or has one of two repeats, whose deviates
            are too large to be simulated; or if a number is invalid.

    Example:
        >>> acrylic = "docs/examples/swatches/acrylic.toml"
        >>> path = kl.sample_stripes(acrylic, folder / "samples.toml", n_stripe=4, samples=8)
        >>> len(kl.plan(path, n_subunit=16).cases)
        8
    """
    material = Path(material)
    output = Path(output)
    check_suffix(output, TOML, "a workflow")
    write_samples(material, output, n_stripe, samples, str(workflow), seed, sobol, uncertainty_of)
    return output
