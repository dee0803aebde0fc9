"""Poisson's ratio of a test (paper, Sec. "Kinematics under tension")."""

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from knitlab.observables.observable import curve, number, observable

if TYPE_CHECKING:
    from knitlab.observables.finished_test import FinishedTest

MIN_FOLLOWED = 0.2
"""Axial strain of the central cells over the applied strain below which they have no Poisson's
ratio: a sample that is pulled before it is at rest still contracts, and both strains are near 0."""


def poisson_ratio_of_test(
    mean_strain_xx: Float[np.ndarray, " strain"], mean_strain_yy: Float[np.ndarray, " strain"]
) -> Float[np.ndarray, " strain"]:
    """ν at every strain of a test; missing at the first, relaxed state, where it is 0/0 [1]."""
    ratio = np.full(len(mean_strain_yy), np.nan)
    np.divide(-mean_strain_xx, mean_strain_yy, out=ratio, where=mean_strain_yy != 0)
    # Round-off and noise would give an arbitrary value.
    ratio[0] = np.nan
    return ratio


def lowest_poisson_ratio(
    applied_strain: Float[np.ndarray, " strain"], ratio: Float[np.ndarray, " strain"]
) -> dict[str, float]:
    """The lowest Poisson's ratio of a test and its strain, by their names in a cube, if any [1]."""
    if not np.isfinite(ratio).any():
        return {}
    lowest = int(np.nanargmin(ratio))
    return {
        "poisson_ratio_min": float(ratio[lowest]),
        "applied_strain_at_min": float(applied_strain[lowest]),
    }


@observable(
    poisson_ratio=curve(
        "Poisson's ratio",
        description=(
            "-mean_strain_xx / mean_strain_yy, or the contraction across another pulled "
            "direction over the strain along it; undefined at zero strain, under shear and "
            "biaxial loads, and where the central cells have taken less than a fifth of the"
            " applied strain"
        ),
    )
)
def poisson_ratio(test: "FinishedTest") -> Float[np.ndarray, " reached"]:
    """ν at every strain."""
    across, along = test.strains_of_pull
    ratio = poisson_ratio_of_test(across, along)
    ratio[along < MIN_FOLLOWED * test.applied_strain] = np.nan
    if test.case.all_corners_held or not test.case.load.has_poisson_ratio:
        ratio[:] = np.nan
    return ratio


@observable(
    poisson_ratio_min=number(
        "lowest Poisson's ratio",
        description=(
            "at the recorded strains, without interpolation between them; missing unless "
            "all of them converged"
        ),
    ),
    applied_strain_at_min=number(
        "applied strain at the lowest Poisson's ratio", description="one of the recorded strains"
    ),
)
def lowest(test: "FinishedTest") -> dict[str, Any]:
    """The lowest ν of a complete test, and its strain."""
    if not test.complete:
        return {}
    return lowest_poisson_ratio(test.applied_strain, poisson_ratio(test))
