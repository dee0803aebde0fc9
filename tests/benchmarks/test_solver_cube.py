from dataclasses import asdict, replace

import numpy as np
import pytest

from benchmarks.solver.cube import (
    NOT_MEASURED,
    NOT_REACHED,
    REACHED,
    cube_of,
    machine,
    read_cube,
    report,
    write_cube,
)
from benchmarks.solver.figures import FIGURES, draw_all
from benchmarks.solver.measurement import Measurement
from benchmarks.solver.methods import RESIDUAL_LEVELS
from benchmarks.solver.plan import GROUPS, Budget, best_setting, planned

NODES = {"1x1": 289, "3x2": 1617, "5x3": 3969}
SLOPE = {"knitlab": 1.2, "dynamics": 2.0}
DAY = "2026-01-01T00:00:00+00:00"
MACHINE = {"cpu_model": "Abacus 1", "blas_kernels": "beads"}


def made_up_records():
    """Times that are powers of the size; the dynamics do not finish the largest sample."""
    records = []
    for solver, slope in SLOPE.items():
        for size, nodes in NODES.items():
            for task in ("relaxation", "tension"):
                for repeat in range(3):
                    seconds = 1e-3 * nodes**slope * (1 + 0.1 * (repeat - 1))
                    reached = (solver, size) != ("dynamics", "5x3")
                    measurement = Measurement(task, solver, size=size, repeat=repeat)
                    # As the residual falls, each level takes as long as the one before.
                    times = np.linspace(0, seconds, len(RESIDUAL_LEVELS) + 1)[1:].tolist()
                    cost = {
                        "nodes": nodes,
                        "reached": reached,
                        "residual": 1e-7 if reached else 1e-3,
                        "date": DAY,
                        "git_commit": "0",
                        **MACHINE,
                        "first_times": times if reached else times[:9] + [None] * len(times[9:]),
                    }
                    records.append(asdict(measurement) | cost)
                    records[-1]["seconds" if reached else "given_up_after"] = seconds
    iteration = {"nodes": 289, "reached": True, "date": DAY, "git_commit": "0"} | MACHINE
    for solver, factorise in (("nested_dissection", 2.0), ("pardiso", 1.0)):
        records.append(
            asdict(Measurement("iteration", solver))
            | iteration
            | {"seconds": factorise + 1.0, "factorise_seconds": factorise}
        )
    trial = {
        "reached": True,
        "seconds": 1.0,
        "evaluations": 9,
        "date": DAY,
        "git_commit": "0",
    } | MACHINE
    return [*records, asdict(Measurement("tuning", "fire", setting=0.02)) | trial]


@pytest.fixture(scope="module")
def cube():
    return cube_of(made_up_records()).assign_attrs(machine())


def test_every_variable_has_units_and_a_long_name(cube):
    for name, variable in cube.data_vars.items():
        assert variable.attrs["long_name"], name
        assert "units" in variable.attrs or "flag_meanings" in variable.attrs, name
    for name in cube.coords:
        assert cube[name].attrs["long_name"], name


def test_attributes_state_the_machine(cube):
    assert cube.attrs["cpu_model"]
    assert cube.attrs["cpu_cores"] >= 1
    assert cube.attrs["memory_bytes"] > 0
    assert "numpy=" in cube.attrs["library_versions"]


def test_median_spread_slope_and_ratio_follow_from_the_repeats(cube):
    of = cube.sel(
        task="tension", boundary="clamped", n_stripe=4, n_subunit=16, workers=1, size="3x2"
    )
    knitlab_record = of.sel(solver="knitlab")
    expected = 1e-3 * NODES["3x2"] ** SLOPE["knitlab"]
    assert float(knitlab_record["seconds_median"]) == pytest.approx(expected)
    assert float(knitlab_record["seconds_least"]) == pytest.approx(0.9 * expected)
    assert float(knitlab_record["seconds_most"]) == pytest.approx(1.1 * expected)
    for solver, slope in SLOPE.items():
        assert float(of.sel(solver=solver)["slope"]) == pytest.approx(slope)
    ratio = NODES["3x2"] ** (SLOPE["dynamics"] - SLOPE["knitlab"])
    assert float(of.sel(solver="dynamics")["times_slower"]) == pytest.approx(ratio)


def test_times_of_two_machines_are_not_compared():
    records = made_up_records()
    for record in records:
        if record["solver"] == "dynamics" and record["size"] == "1x1":
            record["cpu_model"] = "Abacus 2"
    cube = cube_of(records)
    assert cube["measured_on"].attrs["flag_meanings"] == "none Abacus_1_beads Abacus_2_beads"
    of = cube.sel(
        task="tension",
        boundary="clamped",
        n_stripe=4,
        n_subunit=16,
        workers=1,
        solver="dynamics",
    )
    assert np.isnan(of["times_slower"].sel(size="1x1"))
    assert of["times_slower"].sel(size="3x2") > 1
    machines = of["measured_on"].isel(repeat=0)
    assert int(machines.sel(size="1x1")) == 1
    assert int(machines.sel(size="3x2")) == 0


def test_an_iteration_is_compared_with_the_fastest_factorisation_alone(cube):
    ratio = cube["iteration_over_factorisation"].sel(
        task="iteration", boundary="clamped", n_stripe=4, n_subunit=16, workers=1, size="1x1"
    )
    assert float(ratio.sel(solver="nested_dissection")) == pytest.approx(3.0)


def test_what_was_not_reached_has_no_time(cube):
    of = cube.sel(task="tension", boundary="clamped", n_stripe=4, n_subunit=16, workers=1)
    given_up = of.sel(solver="dynamics", size="5x3")
    assert (given_up["status"] == NOT_REACHED).all()
    assert given_up["seconds"].isnull().all()
    assert (given_up["residual"] == 1e-3).all()
    at_least = 1.1 * NODES["5x3"] ** (SLOPE["dynamics"] - SLOPE["knitlab"])
    assert float(given_up["times_slower_at_least"]) == pytest.approx(at_least)
    assert given_up["times_slower"].isnull()
    assert (of["status"].sel(solver="knitlab") == REACHED).all()
    assert (of["status"].sel(solver="pardiso") == NOT_MEASURED).all()
    assert "not reached" in report(cube)


def test_of_two_records_with_different_settings_the_later_is_used():
    early = asdict(Measurement("relaxation", "fire", setting=0.1))
    early |= {
        "seconds": 1.0,
        "nodes": 1,
        "reached": True,
        "date": "2026-01-01",
        "git_commit": "0",
    } | MACHINE
    late = early | {"setting": 0.2, "seconds": 2.0, "date": "2026-01-02"}
    cube = cube_of([late, early])
    assert cube["seconds"].item() == 2.0
    assert cube["setting"].item() == 0.2


def test_a_cube_can_hold_only_sweeps():
    measurement = Measurement("sweep", "knitlab", size="paper", workers=2)
    cost = {
        "reached": True,
        "seconds": 180.0,
        "designs": 20,
        "date": DAY,
        "git_commit": "0",
    } | MACHINE
    cube = cube_of([asdict(measurement) | cost])
    assert cube["seconds_median"].squeeze().item() == 180.0


@pytest.mark.slow
def test_figures_are_drawn_from_the_file_of_the_cube_alone(cube, tmp_path):
    write_cube(cube, tmp_path / "solvers.nc")
    read = read_cube(tmp_path / "solvers.nc")
    drawn = list(draw_all(read, tmp_path / "figures"))
    expected = {f"{name}{suffix}" for name in FIGURES for suffix in (".pdf", ".png")}
    assert {path.name for path in drawn} == expected
    assert all(path.stat().st_size for path in drawn)


def test_figures_name_the_methods_that_failed(cube):
    for draw in FIGURES.values():
        figure = draw(cube)
        (axes,) = figure.axes
        (legend,) = figure.legends or [axes.get_legend()]
        assert "[" in axes.get_xlabel()
        assert "[" in axes.get_ylabel()
        labels = [text.get_text() for text in legend.get_texts()]
        assert [label for label in labels if "given up" in label]
        assert all(("given up" in label) == ("dynamics" in label) for label in labels)


def test_where_nothing_was_reached_no_times_are_drawn():
    (record,) = (
        record
        for record in made_up_records()
        if record["solver"] == "dynamics"
        and (record["task"], record["size"], record["repeat"]) == ("tension", "5x3", 0)
    )
    assert FIGURES["time_against_size"](cube_of([record])) is None


def test_what_a_sweep_does_on_two_threads_is_drawn(cube):
    swept = [
        asdict(Measurement("tension", "knitlab_as_swept", size=size, workers=2))
        | {"seconds": 1e-4 * nodes, "nodes": nodes, "reached": True, "date": DAY}
        | {"git_commit": "0", **MACHINE}
        for size, nodes in NODES.items()
    ]
    figure = FIGURES["time_against_size"](cube_of([*made_up_records(), *swept]))
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "knitlab, from periodic fabric, 2 threads, $s$ = 1.00" in labels


def test_a_record_is_kept_unless_it_was_stopped_too_early(tmp_path):
    measurement = Measurement("relaxation", "fire", time_limit=10.0)
    assert measurement.record(tmp_path) is None
    measurement.write(tmp_path, {"reached": False})
    assert measurement.record(tmp_path)
    assert replace(measurement, time_limit=20.0).record(tmp_path) is None
    measurement.write(tmp_path, {"reached": True})
    assert replace(measurement, time_limit=20.0).record(tmp_path)


def test_the_setting_that_took_the_fewest_evaluations_is_taken(tmp_path):
    asked = Measurement("relaxation", "fire")
    assert best_setting(asked, tmp_path) is None
    for setting, evaluations, reached in ((0.01, 300, True), (0.02, 200, True), (0.03, 100, False)):
        trial = Measurement("tuning", "fire", setting=setting)
        trial.write(tmp_path, {"reached": reached, "evaluations": evaluations, "seconds": 1.0})
    assert best_setting(asked, tmp_path) == 0.02


def test_a_slow_measurement_is_not_repeated(tmp_path):
    budget = Budget(repeats=2, time_limit=100.0, once_above=10.0)
    names = []
    for measurement in planned(["scaling"], budget, tmp_path):
        names.append(measurement.name)
        long = measurement.size == "22x11"
        measurement.write(tmp_path, {"reached": True, "seconds": 50.0 if long else 1.0})
    count = len(list(GROUPS["scaling"]()))
    assert len(names) == len(set(names)) == 2 * count - 2
