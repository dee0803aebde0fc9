"""A rectangle of membrane that obeys the law of a fabric, compared with a sample of its network."""

import numpy as np
import pytest

import knitlab as kl
from tests.export.laws.test_law import LAW

pytestmark = [pytest.mark.slow, pytest.mark.nightly]
skfem = pytest.importorskip("skfem", reason="scikit-fem is not installed; .ci/nightly installs it")
STRAINS = [0.0, 0.05, 0.1, 0.15]
UNIT_CELLS = (8, 4)  # along the pull and across
TOLERANCE = 1e-9


def test_a_clamped_membrane_pulls_and_widens_as_the_network_does():
    law = kl.law(LAW)
    protocol = kl.Protocol(strain_max=0.15, strain_step=0.05)
    sample = kl.simulate(kl.Design(4, 16, unit_cells=UNIT_CELLS), protocol=protocol)
    height = float(sample["knit_cell_y"]) * UNIT_CELLS[0]
    width = float(sample["knit_cell_x"]) * UNIT_CELLS[1]
    forces, widening = clamped(law, width, height)
    # The network has free edges, which are softer: half a unit cell of the four on each side.
    ratios = forces[1:] / sample["reaction_force"].values[1:]
    assert (ratios > 0.97).all(), ratios
    assert (ratios < 1.2).all(), ratios
    np.testing.assert_allclose(widening, sample["mean_strain_xx"], atol=0.012)


def clamped(law, width, height):
    """Force [N] and widening in the middle [1] of a rectangle between clamps at every strain."""
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, width, 7), np.linspace(0, height, 15))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=4)
    x, y = basis.doflocs
    is_y = basis.project(lambda place: np.stack([0 * place[0], 1 + 0 * place[0]])) > 0.5
    held = np.flatnonzero(np.isclose(y, 0) | np.isclose(y, height))
    top = np.flatnonzero(np.isclose(y, height) & is_y)
    sides = [
        np.flatnonzero(np.isclose(x, at) & np.isclose(y, height / 2) & ~is_y) for at in (0, width)
    ]

    def deformed(field):
        gradient = field.grad + np.eye(2)[..., None, None]
        metric = np.einsum("ki...,kj...->ij...", gradient, gradient)
        strain = [(metric[0, 0] - 1) / 2, (metric[1, 1] - 1) / 2, metric[0, 1]]
        return gradient, np.stack(strain, axis=-1)

    def tensor(stress):
        xx, yy, xy = np.moveaxis(stress, -1, 0)
        return np.array([[xx, xy], [xy, yy]])

    def strain_by(gradient, change):
        product = np.einsum("ki...,kj...->ij...", gradient, change)
        return np.stack([product[0, 0], product[1, 1], product[0, 1] + product[1, 0]], axis=-1)

    @skfem.LinearForm
    def residual(v, w):
        gradient, strain = deformed(w["u"])
        return np.einsum("...a,...a->...", strain_by(gradient, v.grad), law.stress(strain))

    @skfem.BilinearForm
    def stiffness(u, v, w):
        gradient, strain = deformed(w["u"])
        ours, theirs = strain_by(gradient, u.grad), strain_by(gradient, v.grad)
        material = np.einsum("...a,...ab,...b->...", ours, law.tangent(strain), theirs)
        stress = tensor(law.stress(strain))
        return material + np.einsum("ki...,ij...,kj...->...", u.grad, stress, v.grad)

    forces, widening, moved = [], [], np.zeros(basis.N)
    free = np.setdiff1d(np.arange(basis.N), held)
    for applied in STRAINS:
        moved[top] = applied * height
        for _ in range(40):
            out_of_balance = residual.assemble(basis, u=basis.interpolate(moved))
            if np.abs(out_of_balance[free]).max() < TOLERANCE:
                break
            matrix = stiffness.assemble(basis, u=basis.interpolate(moved))
            moved = moved + skfem.solve(*skfem.condense(matrix, -out_of_balance, D=held))
        else:
            pytest.fail(f"no equilibrium at {applied}")
        forces.append(out_of_balance[top].sum())
        widening.append((moved[sides[1]].mean() - moved[sides[0]].mean()) / width)
    return np.array(forces), np.array(widening)
