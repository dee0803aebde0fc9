"""Control by force: against closed forms, and fabric under a dead load."""

import jax
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

import knitlab as kl
from knitlab.cubes.derived import with_derived
from knitlab.cubes.force_control import under_force
from knitlab.cubes.selection import select
from knitlab.io.errors import InputError
from knitlab.model.energy import energy
from knitlab.model.fabric import Configuration
from knitlab.model.network import network
from knitlab.solvers.equilibrium.tensile_test import stretch
from tests.fabrics import FINE, PERIODIC, checkered, equations

STRAINS = np.array([0.0, 0.1, 0.2, 0.3, 0.4])


def cube_of(force, **curves):
    """A synthetic cube of two designs, the second of which is twice as stiff."""
    force = np.array(force, float)
    variables = {"reaction_force": (("n_stripe", "applied_strain"), np.stack([force, 2 * force]))}
    variables |= {name: ("applied_strain", np.array(curve)) for name, curve in curves.items()}
    return xr.Dataset(variables, {"n_stripe": [2, 4], "applied_strain": STRAINS})


def test_a_linear_force_is_read_at_its_strain():
    """With F = 10 ε and 20 ε, whatever is linear in ε is linear in F."""
    cube = cube_of(10 * STRAINS, poisson_ratio=[np.nan, -0.5, -0.4, -0.3, -0.2])
    read = under_force(cube, "reaction_force", [0.0, 0.5, 3.3, 4.0, 7.0, 9.0])
    assert read["applied_strain"].dims == ("n_stripe", "reaction_force")
    strains = np.array([[0, 0.05, 0.33, 0.4, np.nan, np.nan], [0, 0.025, 0.165, 0.2, 0.35, np.nan]])
    np.testing.assert_allclose(read["applied_strain"], strains, atol=1e-12)
    # The ratio is undefined at zero strain, and so unknown below the next.
    ratio = np.where(strains < 0.1, np.nan, strains - 0.6)
    np.testing.assert_allclose(read["poisson_ratio"], ratio, atol=1e-12)
    assert not read["jumped"].any()


def test_a_test_that_controls_the_force_jumps_past_its_maximum():
    cube = cube_of([0, 2, 1, 3, 5], snapped=[0, 0, 1, 1, 1])
    read = under_force(cube, "reaction_force", [1.5, 2.0, 2.5]).sel(n_stripe=2)
    np.testing.assert_allclose(read["applied_strain"], [0.075, 0.1, 0.275])
    np.testing.assert_array_equal(read["jumped"], [0, 0, 1])
    # A flag that differs at both ends is that of neither.
    np.testing.assert_array_equal(read["snapped"], [0, 0, 1])


def test_a_state_that_is_missing_is_not_bridged():
    read = under_force(cube_of([0, 2, np.nan, 6, 8]), "reaction_force", [1, 2, 4, 7])
    found = read["applied_strain"].sel(n_stripe=2)
    np.testing.assert_allclose(found, [0.05, 0.1, np.nan, 0.35])


@given(st.lists(st.floats(0.01, 5), min_size=4, max_size=4), st.floats(0, 1))
def test_the_force_at_the_strain_that_is_read_is_the_one_selected(steps, fraction):
    force = np.concatenate([[0], np.cumsum(steps)])
    wanted = fraction * force[-1]
    read = select(cube_of(force), {"reaction_force": wanted}).sel(n_stripe=2)
    np.testing.assert_allclose(np.interp(read["applied_strain"], STRAINS, force), wanted, atol=1e-9)


@pytest.mark.parametrize(
    "selections",
    [
        {"reaction_force": -1},
        {"reaction_force": "much"},
        {"reaction_force": []},
        {"reaction_force": np.nan},
        {"reaction_force": 1, "applied_strain": 0.1},
        {"force_per_width": 1},
    ],
)
def test_forces_that_cannot_be_selected_are_refused(selections):
    with pytest.raises(InputError, match="force"):
        select(cube_of(STRAINS), selections)


def stiff_sheet(ratios):
    """A cube of biaxial tests of a linear elastic sheet, 20 mm wide and 10 mm long."""
    tension_y = (C12 * ratios + C22)[:, None] * STRAINS
    tension_x = (C11 * ratios + C12)[:, None] * STRAINS
    along, each = ("load_ratio", "applied_strain"), ("load_ratio",)
    sizes = {"knit_cell_x": 20.0, "knit_cell_y": 10.0, "unit_cells_x": 1, "unit_cells_y": 1}
    variables = {name: (each, np.full(len(ratios), size)) for name, size in sizes.items()} | {
        "status": (each, np.full(len(ratios), 1)),
        "case_id": (each, [f"test {ratio}" for ratio in ratios]),
        "load_direction": (each, np.full(len(ratios), 90.0)),
        "reaction_force": (along, 20 * tension_y),
        "reaction_force_across": (along, 10 * tension_x),
        "mean_strain_xx": (along, ratios[:, None] * STRAINS),
    }
    return with_derived(xr.Dataset(variables, {"load_ratio": ratios, "applied_strain": STRAINS}))


C11, C12, C22 = 3.0, 1.0, 2.0  # membrane stiffnesses [N/mm]
RATIOS = [0.8, 0.85, 0.9]  # around that of a plain pull of (4, 16)


def test_biaxial_tests_hold_those_at_a_ratio_of_forces():
    """N_x = k N_y gives ε_x / ε_y in closed form; without force across it is a plain pull."""
    cube, wanted = stiff_sheet(np.linspace(-0.5, 1, 61)), np.array([0.0, 0.5, 1.2])
    read = select(cube, {"force_ratio": [*wanted, 9.0]})
    ratio = np.append((wanted * C22 - C12) / (C11 - wanted * C12), np.nan)
    np.testing.assert_allclose(read["load_ratio"][1:], [ratio] * 4, atol=1e-4)
    np.testing.assert_allclose(
        read["mean_strain_xx"], STRAINS[:, None] * np.where(STRAINS[:, None], ratio, 0), atol=1e-4
    )
    stiffness = C22 + C12 * ratio
    np.testing.assert_allclose(read["tangent_stiffness"][1:-1], [stiffness] * 3, rtol=1e-4)
    assert not read["reaction_force"][0].any(), "what rests is at rest under every ratio"
    assert "case_id" not in read, "no test is at this ratio"
    both = select(cube, {"force_ratio": 0.5, "force_per_width": 0.3})
    np.testing.assert_allclose(both["applied_strain"], 0.3 / stiffness[1], rtol=1e-4)


@pytest.mark.parametrize(
    "selections", [{"force_ratio": 1, "load_ratio": 0.5}, {"force_ratio": np.inf}]
)
def test_ratios_that_cannot_be_selected_are_refused(selections):
    with pytest.raises(InputError, match="force_ratio"):
        select(stiff_sheet(np.array([0.0, 1.0])), selections)


@pytest.mark.slow
def test_without_force_across_a_biaxial_test_is_a_pull_along_the_warp():
    def strained(**load):
        design = kl.Design(4, 16, boundary="periodic")
        model, sheet = kl.Model(contact="none"), kl.Sheet(z_max=6.0, k_wall=100.0)
        protocol = kl.Protocol(strain_max=0.06, **load)
        return kl.simulate(design, protocol=protocol, model=model, sheet=sheet)

    tests = [strained(load="biaxial", load_ratio=ratio) for ratio in RATIOS]
    cube = with_derived(xr.concat(tests, xr.Variable("load_ratio", RATIOS)))
    read, pull = select(cube, {"force_ratio": 0.0}), strained()
    for name in ("mean_strain_xx", "reaction_force"):
        np.testing.assert_allclose(read[name].squeeze()[1:], pull[name].squeeze()[1:], rtol=1e-3)


@pytest.mark.slow
def test_the_strain_under_a_force_is_that_of_fabric_under_a_dead_load():
    """A second method: V - F L_y is minimised with all unknowns free."""
    net, fabric = checkered(2, 1, PERIODIC)
    strains = np.linspace(0, 0.1, 21)
    test = stretch(equations(net, fabric), list(strains), FINE)
    forces = [test.loading.reaction_force(state.gradient) for state in test.states]
    cube = xr.Dataset(
        {"reaction_force": ("applied_strain", np.array(forces))}, {"applied_strain": strains}
    )
    wanted = 0.6 * forces[-1]
    read = float(under_force(cube, "reaction_force", [wanted])["applied_strain"].item())

    @jax.jit
    @jax.value_and_grad
    def loaded(unknowns):
        at = Configuration.of(unknowns, net.shape)
        return energy(network(net.shape), fabric, at).total - wanted * at.lengths[1]

    relaxed = test.states[0].configuration
    found = minimize(
        lambda q: [np.asarray(each, float) for each in loaded(q)],
        np.asarray(relaxed.flattened()),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": 20000, "maxfun": 40000, "ftol": 1e-16, "gtol": 1e-8},
    )
    length = Configuration.of(found.x, net.shape).lengths[1]
    assert 0.03 < read < 0.1
    assert length / relaxed.lengths[1] - 1 == pytest.approx(read, abs=2e-4)
