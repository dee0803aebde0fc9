"""Designs from targets to a workflow: hidden fabrics, unreachable targets, kills, budgets."""

import importlib
import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import psutil
import pytest
import xarray as xr
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from knitlab.design.objective import Objective
from knitlab.design.search import run_searches
from knitlab.model.stripe import changed_stripe
from knitlab.solvers.equilibrium.adjoint import NoDerivative
from tests.file_events import kill_command
from tests.refusals import refused

PREVIEW = Path(__file__).parents[2] / "results" / "reference" / "periodic"
SMALL = {"n_stripe": [4], "n_subunit": [8]}
FLAT = {
    "model": kl.Model(cell_size="flat", contact="none"),
    "sheet": kl.Sheet(z_max=1.9, k_wall=100.0),
}
"""A fabric without contact, whose tests take a second."""
SETTINGS = {"cell_size": "flat", "contact": "none", "z_max": 1.9}
SETTINGS |= {"cloth_stitch_width": 0, "cloth_stitch_height": 0}
IN_A_FILE = "".join(f"{name} = {value!r}\n" for name, value in SETTINGS.items())
STRAINS = np.array([0.0, 0.05, 0.1, 0.15])
STEPS = {"strain_step": 0.05, "strain_max": 0.15, **SETTINGS}
FACTORS = {
    f"{knit}_{name}_factor": [0.7, 1.3] for knit in ("rib", "garter") for name in ("k_t", "theta_0")
}


def varied(n_stripe, n_subunit, factors, **options):
    """Periodic fabric whose stripes are those of the tables times factors."""
    stripes = kl.defaults().stripes
    return kl.Design(
        n_stripe,
        n_subunit,
        boundary="periodic",
        rib=changed_stripe(stripes.stripe("rib", n_stripe), factors),
        garter=changed_stripe(stripes.stripe("garter", 2 * n_stripe), factors),
        **options,
    )


def wanted(design):
    """Poisson's ratio of a design, as a target."""
    return {
        "name": "poisson_ratio",
        "applied_strain": STRAINS[1:].tolist(),
        "value": kl.simulate(design, STRAINS, **FLAT)["poisson_ratio"].values[1:].tolist(),
        "tolerance": 0.01,
    }


def designed(tmp_path, **changes):
    options = {"vary": SMALL | FACTORS, "robustness": 0, "results": tmp_path, **STEPS}
    return kl.design(**options | changes)


@pytest.mark.slow
@pytest.mark.nightly
def test_the_pattern_that_was_hidden_is_chosen_and_its_workflow_gives_its_numbers(tmp_path):
    target = wanted(varied(4, 8, {"k_t_factor": 1.2}, pattern="ribbed_bands"))
    vary = SMALL | {"pattern": ["checkerboard", "ribbed_bands", "basket"], "k_t_factor": [0.7, 1.4]}
    result = designed(tmp_path / "design", targets=target, vary=vary, starts=1)
    assert result.met
    assert result.table.iloc[0]["pattern"] == "ribbed_bands"
    cube = kl.run(str(result.workflows[0]), results=tmp_path / "again", workers=0)
    np.testing.assert_allclose(cube["poisson_ratio"].values.ravel()[1:], target["value"], atol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("design", [(4, 8), (6, 24)])
def test_a_hidden_fabric_is_met_and_undetermined_parameters_are_reported(tmp_path, design):
    factors = dict(zip(FACTORS, (1.2, 0.9, 0.8, 1.1), strict=True))
    n_stripe, n_subunit = design
    vary = {"n_stripe": [n_stripe], "n_subunit": [n_subunit], **FACTORS}
    result = designed(tmp_path, targets=wanted(varied(*design, factors)), vary=vary)
    assert result.met
    assert result.simulations <= 60
    assert result.table["off_by_1"].item() <= 0.01
    (search,) = result.searches
    values = search.trials[search.best].values
    back = [name for name in FACTORS if abs(np.log(values[name] / factors[name])) < 0.05]
    assert set(back) | set(search.undetermined) == set(FACTORS)


@pytest.mark.slow
@pytest.mark.nightly
def test_the_workflow_of_a_candidate_gives_its_numbers_and_the_cube_can_be_queried(tmp_path):
    result = designed(tmp_path, targets="poisson_ratio = -0.1 ± 0.02 @ 0.05:0.15", robustness=1)
    again = kl.run(result.workflows[0], results=tmp_path / "again")
    for name in ("poisson_ratio", "reaction_force", "poisson_ratio_low", "poisson_ratio_high"):
        np.testing.assert_allclose(
            result.cube[name].values.ravel(), again[name].values.ravel(), rtol=1e-9
        )
    assert kl.query(result.folder, where="distance_worst >= distance")["candidate"].tolist() == [1]
    assert (result.table["distance_worst"] >= result.table["distance"]).all()
    files = kl.find(result.folder, targets="poisson_ratio = -0.1 ± 0.02 @ 0.05:0.15").table
    assert files["off_by_1"].item() == pytest.approx(result.table["off_by_1"].item())


@pytest.mark.slow
def test_a_target_that_cannot_be_met_is_reported_with_the_limiting_bound(tmp_path):
    path = tmp_path / "sleeve.toml"
    path.write_text(
        'targets = ["poisson_ratio = -0.9 ± 0.02 @ 0.1"]\nrobustness = 0\n'
        "[vary]\nn_stripe = [4]\nn_subunit = [8]\nrib_theta_0_factor = [0.95, 1.05]\n"
        f"[settings]\nstrain_step = 0.05\n{IN_A_FILE}"
    )
    ran = CliRunner().invoke(main, ["design", str(path), "--results", str(tmp_path)])
    assert ran.exit_code == 1, ran.output
    assert "not met: poisson_ratio = -0.9" in ran.output
    assert "held back by rib_theta_0_factor" in ran.output
    assert (tmp_path / "sleeve" / "figures" / "wanted.png").is_file()


@pytest.mark.slow
@pytest.mark.nightly
def test_conflicting_targets_give_a_pareto_front(tmp_path):
    targets = ["reaction_force = 0.1 ± 0.01 @ 0.1", "reaction_force = 2 ± 0.01 @ 0.15"]
    result = designed(tmp_path, targets=targets, figures=True)
    assert not result.met
    assert (result.folder / "figures" / "pareto.png").is_file()


@pytest.mark.slow
@pytest.mark.nightly
def test_constraints_are_kept(tmp_path):
    targets = "reaction_force = 0.5 ± 0.01 @ 0.1"
    free = designed(tmp_path, targets=targets, name="free")
    constraint = "poisson_ratio > -0.05 @ 0.1"
    held = designed(tmp_path, targets=targets, subject_to=constraint, name="held")
    for result, broken in ((free, True), (held, False)):
        ratio = result.cube["poisson_ratio"].sel(applied_strain=0.1).item()
        assert (ratio < -0.05) == broken, ratio


@pytest.mark.slow
def test_a_search_that_starts_on_a_bound_leaves_it(tmp_path):
    vary = SMALL | {"k_t_factor": [1.0, 2.0]}
    result = designed(tmp_path, targets="poisson_ratio = -0.3 ± 0.03 @ 0.05:0.1", vary=vary)
    (search,) = result.searches
    assert search.held_by == ["k_t_factor <= 2"]
    assert search.trials[search.best].distance < 0.6 * search.trials[0].distance


@pytest.mark.slow
@pytest.mark.nightly
def test_candidates_that_keep_the_constraints_come_first_and_a_smaller_budget_leaves_fewer(
    tmp_path,
):
    asked = {
        "targets": "poisson_ratio = -0.4 ± 0.03 @ 0.05",
        "subject_to": "knit_cell_x < 22",
        "vary": {"n_stripe": [4], "n_subunit": [8, 16], "k_t_factor": [0.9, 1.1]},
    }
    result = designed(tmp_path, **asked, budget=6)
    assert result.table["n_subunit"].tolist() == [8, 16]
    assert result.table["violation"].iloc[0] == 0 < result.table["violation"].iloc[1]
    assert result.table["distance"].iloc[0] > result.table["distance"].iloc[1]
    fewer = designed(tmp_path, **asked, budget=1)
    assert len(fewer.table) == len(fewer.workflows) == 1
    assert len(list(fewer.folder.glob("candidate_*.toml"))) == 1


@pytest.mark.slow
def test_a_budget_of_one_is_one_simulation(tmp_path):
    result = designed(tmp_path, targets="poisson_ratio = -0.2 @ 0.1", budget=1)
    assert result.simulations == len(result.trials) == 1
    assert result.searches[0].ended == "the budget is spent"
    with refused("budget 5", "10 designs"):
        designed(tmp_path, targets="poisson_ratio = -0.2 @ 0.1", vary={}, budget=5, name="more")
    for budget in ("soon", "9" * 4000, "1e400min", "nanmin"):
        with refused(f"budget {budget[:500]}"):
            designed(tmp_path, targets="poisson_ratio = -0.2 @ 0.1", budget=budget)


@pytest.mark.slow
@pytest.mark.nightly
def test_a_target_without_derivatives_is_searched_without_gradients(tmp_path):
    (search,) = designed(tmp_path, targets="wavelength_x = 2.42 ± 0.01", budget=25).searches
    assert search.methods == ["CMA-ES"]
    assert search.trials[search.best].distance < 0.5 * search.trials[0].distance


@pytest.mark.slow
@pytest.mark.nightly
def test_the_search_continues_without_gradients_after_a_missing_derivative(tmp_path, monkeypatch):
    def snapping(self, trial):
        raise NoDerivative("a branch ends here")

    monkeypatch.setattr(Objective, "slopes", snapping)
    result = designed(tmp_path, targets="poisson_ratio = -0.15 ± 0.01 @ 0.05:0.15", budget=25)
    (search,) = result.searches
    assert search.methods == ["least squares", "CMA-ES"]
    assert search.trials[search.best].distance < search.trials[0].distance


@pytest.mark.slow
def test_functions_of_the_shape_can_be_targets(tmp_path):
    def thickness(shape):
        return jnp.ptp(shape.positions[..., 2])

    asked = {"targets": "thickness = 0.72 ± 0.01 @ 0.1", "measures": {"thickness": thickness}}
    result = designed(tmp_path, **asked)
    assert result.searches[0].methods == ["least squares"]
    again = designed(tmp_path, **asked)
    assert again.trials.equals(result.trials)
    assert result.cube["thickness"].sel(applied_strain=0.1).item() == pytest.approx(0.72, abs=0.01)
    with refused("workers"):
        designed(tmp_path, **asked, workers=1, name="spawned")


REQUEST = """
targets = ["poisson_ratio = -0.2 ± 0.01 @ 0.05:0.15"]
robustness = 0
[vary]
n_stripe = [4]
n_subunit = [8]
rib_k_t_factor = [0.5, 2.0]
garter_theta_0_factor = [0.8, 1.25]
[settings]
strain_step = 0.05
"""
REQUEST += IN_A_FILE


@pytest.mark.slow
@pytest.mark.nightly
def test_a_search_whose_worker_dies_is_begun_again_and_repeats_nothing(tmp_path, monkeypatch):
    killed = []

    def run_and_kill_once(jobs, folder, workers, progress):
        def reported(design, distance):
            if not killed:
                workers_here = [
                    child
                    for child in psutil.Process().children(recursive=True)
                    if any("spawn_main" in word for word in child.cmdline())
                ]
                killed.extend(child.pid for child in workers_here)
                for child in workers_here:
                    child.kill()
            progress(design, distance)

        return run_searches(jobs, folder, workers, reported)

    asked = {"targets": "poisson_ratio = -0.2 ± 0.01 @ 0.05:0.15", "budget": 6}
    alone = designed(tmp_path / "alone", **asked)
    module = importlib.import_module("knitlab.design.design")
    monkeypatch.setattr(module, "run_searches", run_and_kill_once)
    result = designed(tmp_path / "killed", **asked, workers=1)
    assert killed
    assert result.trials.equals(alone.trials)


@pytest.mark.slow
def test_allowed_designs_that_no_cube_has_are_reported(tmp_path):
    (tmp_path / "sleeve.toml").write_text(
        'targets = ["poisson_ratio = -0.1 ± 0.02 @ 0.05:0.15"]\nrobustness = 0\n'
        f'cubes = ["{PREVIEW}"]\n[vary]\nn_stripe = [4]\nn_subunit = [16, 40]\n'
        f"[settings]\nstrain_step = 0.05\nstrain_max = 0.15\n{IN_A_FILE}"
    )
    words = ["design", str(tmp_path / "sleeve.toml"), "--budget", "1", "--results", str(tmp_path)]
    ran = CliRunner().invoke(main, words)
    reported = "not considered, as no cube has results of them: n_stripe 4  n_subunit 40"
    assert reported in ran.output, ran.output


@pytest.mark.slow
@pytest.mark.nightly
def test_a_killed_design_resumes_to_the_same_result(tmp_path):
    (tmp_path / "sleeve.toml").write_text(REQUEST)
    kill_command(tmp_path, ["design", "sleeve.toml", "--results", str(tmp_path / "results")], 3)
    trials = tmp_path / "results" / "sleeve" / "trials" / "cases"
    before = {path.name: path.stat().st_mtime_ns for path in trials.glob("*.nc")}
    assert before
    went_on = kl.design(tmp_path / "sleeve.toml", results=tmp_path / "results")
    unbroken = kl.design(tmp_path / "sleeve.toml", results=tmp_path / "whole")
    assert all((trials / name).stat().st_mtime_ns == each for name, each in before.items())
    assert went_on.trials.equals(unbroken.trials)
    assert len(before) < len(unbroken.trials)
    xr.testing.assert_allclose(
        went_on.cube[["poisson_ratio", "distance"]], unbroken.cube[["poisson_ratio", "distance"]]
    )
    kept = json.loads((tmp_path / "whole" / "sleeve" / "request.json").read_text())
    assert kept["choices"]["n_stripe"] == [4]
    (tmp_path / "sleeve.toml").write_text(REQUEST.replace("-0.2", "-0.1"))
    request = tmp_path / "results" / "sleeve" / "request.json"
    for contents in (request.read_bytes(), b"\xff"):
        request.write_bytes(contents)
        with refused("sleeve", "another request"):
            kl.design(tmp_path / "sleeve.toml", results=tmp_path / "results")
