"""Loads in workflows: their cases, what they measure, and what is refused."""

import numpy as np
import pytest

import knitlab as kl
from knitlab.io.errors import InputError
from knitlab.runs.plan import make_plan
from knitlab.solvers.loads.biaxial import Biaxial
from knitlab.solvers.loads.warp import Warp
from knitlab.solvers.loads.weft import Weft

PERIODIC = ("n_stripe=4", "n_subunit=16", "robustness=0")


def test_lists_of_loads_are_dimensions():
    plan = make_plan("periodic", (*PERIODIC, "load=warp,weft,biaxial", "load_ratio=1"))
    loads = {case.design["load"]: case.load for case in plan.cases.values()}
    assert loads == {
        "warp": Warp(),
        "weft": Weft(),
        "biaxial": Biaxial(ratio=1.0),
    }
    angles = make_plan("periodic", (*PERIODIC, "load=off_axis", "load_angle=0,45"))
    assert [case.load.angle for case in angles.cases.values()] == [0, 45]
    assert angles.dims[-1] == "load_angle"


def test_a_pull_along_the_warp_keeps_its_identifier():
    (one,) = make_plan("periodic", PERIODIC).cases
    (other,) = make_plan("periodic", (*PERIODIC, "load=warp", "load_angle=30")).cases
    assert one == other


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (["load=of_axis"], "'warp', 'weft', 'biaxial', 'shear' or 'off_axis'"),
        (["load=biaxial"], "needs load_ratio"),
        (["load=biaxial", "load_ratio=nan"], "finite"),
        (["load=biaxial", "load_ratio=1,1e9"], r"× load_ratio = 4.5e\+08 is the strain"),
        (["load=warp,biaxial", "load_ratio=-0.9", "strain_max=1.2"], r"× load_ratio = -1\.08 is"),
        (["method=dynamics", "fold_drift=0.1"], "fold_drift=0.1: is found by equilibria"),
        (["load=off_axis"], "needs load_angle"),
        (["load=off_axis", "load_angle=270"], "less than 180"),
        (["load=off_axis", "load_angle=30", "boundary=clamped"], "clamps cannot pull"),
        (["load=weft", "sensitivities=true"], "has no sensitivities"),
        (["load=shear", "method=dynamics"], "take method = equilibrium"),
        (["load=shear", "layout=checkerboard"], "no electrodes"),
    ],
)
def test_loads_that_a_boundary_cannot_carry_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        make_plan("periodic", (*PERIODIC, *settings))


def test_a_drag_of_equilibria_is_said_to_be_ignored_by_dynamics():
    settings = ("n_stripe=4", "n_subunit=16", "strain_max=0.03", "drag=1")
    plan = make_plan("preview", settings)
    assert any("drag = 1 is ignored by dynamics" in sentence for sentence in plan.warnings)


def test_stripes_are_pulled_across_their_ridges():
    with pytest.raises(InputError, match="across their ridges"):
        make_plan("stripes", ("load=weft",))


def test_a_ratio_without_a_biaxial_load_is_said_to_be_ignored():
    (sentence,) = make_plan("periodic", (*PERIODIC, "load_ratio=2")).warnings
    assert sentence == "load_ratio is ignored by load = warp; take load = biaxial"


@pytest.mark.slow
def test_measures_follow_the_direction_of_the_load():
    """A pull along the weft is one at 0°; the ratio of ν to stiffness is that along the warp."""

    def pulled(load, **more):
        protocol = kl.Protocol(strain_max=0.002, strain_step=0.001, load=load, **more)
        design = kl.Design(4, 16, boundary="periodic")
        return kl.simulate(design, protocol=protocol, model=kl.Model(cell_size="flat"))

    warp, weft, at_0 = pulled("warp"), pulled("weft"), pulled("off_axis", load_angle=0.0)
    names = ("poisson_ratio", "force_per_width", "mean_strain_xx", "mean_strain_yy")
    for name in names:
        np.testing.assert_allclose(at_0[name], weft[name], rtol=1e-6, atol=1e-9)
    # Maxwell–Betti: ν along the warp over the stiffness there is that along the weft.
    in_cloth = warp["knit_cell_x"] / warp["relaxed_cell_x"]
    over = in_cloth / (warp["knit_cell_y"] / warp["relaxed_cell_y"])
    one, other = (
        float(test["poisson_ratio"][1] / test["force_per_width"][1]) for test in (warp, weft)
    )
    assert one == pytest.approx(other * float(over), rel=0.01)


@pytest.mark.slow
def test_what_clamps_hold_is_missing_along_the_axis_that_they_hold():
    def strains(load, unit_cells, **more):
        design = kl.Design(4, 8, unit_cells=unit_cells)
        protocol = kl.Protocol(strain_max=0.02, strain_step=0.02, load=load, **more)
        solver = kl.Solver(start="flat")
        test = kl.simulate(design, protocol=protocol, solver=solver)
        return test["mean_strain_xx"].values[-1], test["mean_strain_yy"].values[-1]

    along, across = strains("weft", (2, 1))
    assert along == pytest.approx(0.02, abs=1e-3)
    assert np.isnan(across)
    along, across = strains("biaxial", (1, 2), load_ratio=0.5)
    assert np.isfinite([along, across]).all()
