"""Loads in workflows: their cases, what they measure, and what is refused."""

import numpy as np
import pytest

import knitlab as kl
from knitlab.runs.plan import make_plan
from knitlab.solvers.loads.biaxial import Biaxial
from knitlab.solvers.loads.warp import Warp
from knitlab.solvers.loads.weft import Weft

PERIODIC = ("n_stripe=4", "n_subunit=16", "robustness=0")


def test_lists_of_loads_are_dimensions():
    plan = make_plan("periodic", (*PERIODIC, "load=warp,weft,biaxial", "load_ratio=1"))
    loads = {case.design["load"]: case.load for case in plan.cases.values()}
    assert loads == {"warp": Warp(), "weft": Weft(), "biaxial": Biaxial(ratio=1.0)}
    angles = make_plan("periodic", (*PERIODIC, "load=off_axis", "load_angle=0,45"))
    assert [case.load.angle for case in angles.cases.values()] == [0, 45]
    assert angles.dims[-1] == "load_angle"


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
@pytest.mark.parametrize("boundary", ["periodic", "clamped"])
def test_both_biaxial_loads_lead_to_the_same_strains(boundary):
    def strained(load, largest, ratio):
        design = kl.Design(4, 8, boundary=boundary, unit_cells=(2, 1))
        protocol = kl.Protocol(strain_max=largest, strain_step=largest, load=load, load_ratio=ratio)
        return kl.simulate(design, protocol=protocol).isel(applied_strain=-1)

    warp, weft = strained("biaxial", 0.01, 2.0), strained("biaxial_weft", 0.02, 0.5)
    for name in ("mean_strain_xx", "mean_strain_yy", "energy_fold"):
        np.testing.assert_allclose(weft[name], warp[name], rtol=1e-5, atol=1e-8)
    for side in ("reaction_force", "force_per_width"):
        one, other = side, f"{side}_across"
        np.testing.assert_allclose(weft[one], warp[other], rtol=1e-5)
        np.testing.assert_allclose(weft[other], warp[one], rtol=1e-5)
    assert float(weft["force_ratio"] * warp["force_ratio"]) == pytest.approx(1, rel=1e-5)


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
