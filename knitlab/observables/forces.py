"""Reaction forces of a test, and of the pure stripe that it may be."""

from typing import TYPE_CHECKING, Any

import numpy as np

from knitlab.observables.observable import Group, curve, observable

if TYPE_CHECKING:
    from jaxtyping import Float

    from knitlab.observables.finished_test import FinishedTest

PULLED_ACROSS = Group("biaxial", "Biaxial loads", lambda case: case.load.pulls_across)
UNLOADED = Group("unloaded", "Unloading", lambda case: case.unloading)
PURE_STRIPES = Group("stripe", "Pure stripes", lambda case: case.pure)


@observable(
    reaction_force=curve(
        "reaction force",
        "N",
        description=(
            "over the whole side of the sample or periodic cell that is pulled; along the pull if "
            "the load is biaxial"
        ),
    )
)
def reaction_force(test: "FinishedTest") -> "Float[np.ndarray, ' reached']":
    """The reaction force at every strain."""
    return np.array([test.reaction_force(state) for state in test.reached])


@observable(
    PULLED_ACROSS,
    reaction_force_across=curve(
        "reaction force across the pull",
        "N",
        description="over the whole side of the sample or periodic cell; along the weft if load = "
        "biaxial, along the warp if load = biaxial_weft",
    ),
)
def reaction_force_across(test: "FinishedTest") -> "Float[np.ndarray, ' reached']":
    """The force across the pull, of a load that strains the fabric there too."""
    loading = test.test.loading
    assert loading is not None
    across = 1 - loading.load.axis
    return np.array([loading.force_along(across, state.gradient) for state in test.reached])


@observable(
    UNLOADED,
    reaction_force_unloading=curve(
        "reaction force during unloading",
        "N",
        description="from the last strain back, along the pull if the load is biaxial",
    ),
)
def unloading(test: "FinishedTest") -> dict[str, Any]:
    """The force on the way back from the last strain, if that was reached."""
    if not test.complete:
        return {}
    back = np.full(len(test.reached), np.nan)
    unloaded = [test.reaction_force(state) for state in test.test.unloaded]
    top = test.reaction_force(test.test.held or test.reached[-1])
    back[len(back) - 1 - len(unloaded) :] = [*unloaded[::-1], top]
    return {"reaction_force_unloading": back}


@observable(
    PURE_STRIPES,
    row_force=curve(
        "force for one row of the sheet", "N", description="a row is one grid cell wide"
    ),
)
def row_force(test: "FinishedTest") -> "Float[np.ndarray, ' reached']":
    """The reaction force over the number of rows."""
    return reaction_force(test) / test.case.mesh_shape.cells_x


@observable(
    PURE_STRIPES,
    unrelaxed=True,
    zigzag_force=curve(
        "force of the two-dimensional zigzag", "N", description="at its energy minimum"
    ),
    zigzag_residual=curve("largest residual force on a free node of the zigzag", "N"),
    zigzag_iterations=curve("minimiser steps of the zigzag"),
)
def zigzag(test: "FinishedTest") -> dict[str, Any]:
    """The tension of the two-dimensional zigzag at the same strains (paper, Sec. "2D model")."""
    from knitlab.model.zigzag import zigzag as zigzag_of
    from knitlab.solvers.zigzag_tension import pull_chain

    case = test.case
    chain = pull_chain(zigzag_of(case.weft, case.options), case.periods, case.applied_strain)
    return {
        "zigzag_force": [state.force if state.converged else np.nan for state in chain],
        "zigzag_residual": [state.residual for state in chain],
        "zigzag_iterations": [float(state.iterations) for state in chain],
    }
