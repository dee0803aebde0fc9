"""Patterns from a file to a cube: every valid pattern relaxes and is read back."""

import numpy as np
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import knitlab as kl
from knitlab.cubes.case_file import read_case
from knitlab.runs.plan import make_plan
from knitlab.runs.run import run_plan
from knitlab.runs.run_options import RunOptions
from knitlab.solvers.case import case_of

SLOW_TO_COMPILE = settings(
    derandomize=True,
    deadline=None,
    max_examples=10,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@st.composite
def patterns(draw):
    """Any pattern of up to 2 × 3 patches."""
    height, width = draw(st.integers(1, 2)), draw(st.integers(1, 3))
    # A garter stripe many times as wide as the ribs below it crushes a narrow periodic cell.
    alike = draw(st.sampled_from([(2, 4), (4, 6), (6, 8)]))
    counts = [st.sampled_from([1, 2]), st.sampled_from(alike)]

    def along(count, of):
        return [draw(of) for _ in range(count)]

    pattern = {
        "rows": [draw(st.text("RGP", min_size=width, max_size=width)) for _ in range(height)]
    }
    if draw(st.booleans()):
        pattern |= {
            "column_periods": along(width, counts[0]),
            "row_periods": along(height, counts[0]),
            "column_n_stripe": along(width, counts[1]),
            "row_n_stripe": along(height, counts[1]),
        }
    if draw(st.booleans()):
        fold = {"along": draw(st.sampled_from(["wale", "course"])), "at": 0.5, "theta_0": 2.0}
        pattern["folds"] = [fold | {"sense": draw(st.sampled_from(["mountain", "valley"]))}]
    return pattern


def _is_frustrated(rows):
    """Whether a column of garter only, which shortens, is beside one of other knits, which do not.

    Periodic fabric then folds over itself in every row; in some fabrics cells are crushed.
    """
    columns = ["".join(column) for column in zip(*rows, strict=True)]
    return len({set(column) == {"G"} for column in columns}) == 2


@pytest.mark.slow
@pytest.mark.nightly
@SLOW_TO_COMPILE
@given(patterns())
def test_any_valid_pattern_relaxes_or_reports_why_and_is_read_back(tmp_path_factory, pattern):
    folder = tmp_path_factory.mktemp("pattern")
    (folder / "own.toml").write_text(tomli_w.dumps({"own": pattern}), encoding="utf-8")
    chosen = {
        "n_stripe": 4,
        "n_subunit": 8,
        "pattern": "own",
        "pattern_files": [str(folder / "own.toml")],
        "strain_max": 0.01,
        "strain_step": 0.01,
        "robustness": 0,
    }
    plan = make_plan("periodic", chosen)
    (case,) = plan.cases.values()
    ran = run_plan(plan, folder, RunOptions(workers=0))
    (row,) = kl.query(ran.cube).to_dict("records")
    stored = read_case(folder, case.case_id)
    if _is_frustrated(pattern["rows"]):
        assert row["status"] == "ok" or "no equilibrium" in ran.failures[0]["reason"]
    else:
        assert row["status"] == "ok", (pattern, ran.failures)
        assert stored["residual_force"].max() <= 1e-8
    found = case_of(case.record).sample
    np.testing.assert_array_equal(found.knit, [list(row) for row in pattern["rows"][::-1]])
    if row["status"] == "ok":
        assert stored.sizes["node_y"], stored.sizes["node_x"] == found.grid


@pytest.mark.slow
def test_patterns_of_one_shape_are_one_batch_and_one_cube(tmp_path):
    names = "checkerboard,ribbed_bands"
    plan = make_plan(
        "periodic",
        ("n_stripe=4", "n_subunit=8", f"pattern={names}", "strain_max=0.06", "robustness=0"),
    )
    assert len(plan.batches) == 1
    cube = run_plan(plan, tmp_path, RunOptions(workers=0)).cube
    assert cube["status"].dims == ("n_stripe", "n_subunit", "pattern")
    assert cube["pattern"].values.tolist() == names.split(",")
    ratios = cube["poisson_ratio"].sel(applied_strain=0.06).values.ravel()
    assert np.isfinite(ratios).all()
    assert ratios[0] != ratios[1]
    rows = cube.knitlab.query("poisson_ratio < 0", applied_strain=0.06, pattern="checkerboard")
    assert len(rows) == 1


@pytest.mark.slow
@pytest.mark.nightly
def test_every_drawing_of_a_case_shows_a_graded_pattern(tmp_path):
    pattern = {
        "rows": ["GRP", "RGP"],
        "column_periods": [1, 2, 1],
        "column_n_stripe": [4, 6, 4],
        "row_periods": [1, 1],
    }
    (tmp_path / "own.toml").write_text(tomli_w.dumps({"own": pattern}), encoding="utf-8")
    plan = make_plan(
        "sensor",
        {
            "n_stripe": [4],
            "n_subunit": [8],
            "pattern": "own",
            "pattern_files": [str(tmp_path / "own.toml")],
            "strain_max": 0.02,
            "unloading": False,
            "within": "fabric",
        },
    )
    run_plan(plan, tmp_path, RunOptions(workers=0))
    for figure in ("shape", "electrodes"):
        drawn = getattr(kl.plot, figure)(tmp_path)
        assert drawn.axes
