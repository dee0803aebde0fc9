"""The pieces of the guide, from another start and on a finer grid."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import knitlab as kl
from knitlab.api.single_design import single_design
from knitlab.export.pieces.piece import Fabric
from knitlab.model.computing import computing
from knitlab.solvers.methods import METHODS

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
DESIGN = {"n_stripe": 8, "n_subunit": 32}
MAX_OF_START = 0.15  # of a unit cell; 0.02 to 0.09 were found
MAX_OF_GRID = 0.2  # of a unit cell; 0.09 to 0.14 were found


def refined(case):
    """A piece with twice as many grid cells along each axis."""
    spans = tuple((2 * left, 2 * right) for left, right in case.spans for _ in range(2))
    return replace(case, options=replace(case.options, cells_per_period=8), spans=spans)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    ("target", "border"), [("rectangle.csv", "cut"), ("sleeve.svg", "whole"), ("bulge.csv", "cut")]
)
def test_a_piece_keeps_its_outline_from_another_start_and_on_a_finer_grid(target, border, tmp_path):
    """From a sheet shaken at random, solved a hundred times more exactly; and on half the grid."""
    best = kl.shape(EXAMPLES / target, border=border, results=tmp_path, **DESIGN).fit.best
    single = single_design("periodic", [f"{name}={n}" for name, n in DESIGN.items()], {})
    fabric = Fabric(single.case, single.gauge, single.plain, border)
    exact = replace(best.case, solver=replace(best.case.solver, tolerance=1e-10))
    for case, seed, most in (
        (exact, 7, MAX_OF_START),
        (refined(best.case), None, MAX_OF_GRID),
    ):
        with computing():
            test = METHODS["equilibrium"].stretch([case], lambda *_: None, imperfection=seed)[0]
        assert test.states[0].converged
        positions = np.asarray(test.states[0].configuration.positions)
        outline = fabric.view(case, positions).outline
        assert outline.centred_on(best.outline).distance(best.outline) < most * min(best.cell)
