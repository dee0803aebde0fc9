"""Single bad readings and saturation are left out of any record, and nothing else is."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab import read_tension_record
from knitlab.lab.machine import rounding_error
from knitlab.lab.readings import departing, saturated, without_bad_readings
from knitlab.lab.records import resampled
from tests.lab.recorded import capacitance, force

AT = np.linspace(0, 1, 11)
STRAIN = np.linspace(0, 1, 400)
CLEAN = {
    "line": 10 * STRAIN,
    "at rest first": np.clip(STRAIN - 0.2, 0, None),
    "J-shaped": 0.05 * STRAIN + 20 * np.exp(8 * (STRAIN - 1)),
    "falling": 1.6 - 0.5 * STRAIN + 0.3 * STRAIN**2,
    "snap down": np.where(STRAIN < 0.5, 5 * STRAIN, 5 * STRAIN - 1.2),
    "snap up": np.where(STRAIN < 0.37, 1.5, 2.1) + 0.3 * STRAIN,
    "there and back": 1 - np.abs(2 * STRAIN - 1),
    "hold": np.clip(STRAIN, None, 0.3) + np.clip(STRAIN - 0.6, 0, None),
}
records = st.sampled_from([*CLEAN])
noises = st.sampled_from(["none", "0.0001", "0.01", "rounded", "noisy and rounded"])
seeds = st.integers(0, 2**32 - 1)


def recorded(name, noise, random):
    """A record, and the scatter of its readings."""
    clean = CLEAN[name]
    if noise == "none":
        return clean, 1e-3 * np.ptp(clean)
    if noise == "rounded":
        return np.round(clean, 2), 0.01
    if noise == "noisy and rounded":
        return np.round(clean + random.normal(0, 0.007, len(clean)), 2), 0.01
    scatter = float(noise) * np.ptp(clean)
    return clean + random.normal(0, scatter, len(clean)), scatter


@given(records, noises, seeds)
def test_a_record_without_bad_readings_loses_none(name, noise, seed):
    values, _ = recorded(name, noise, np.random.default_rng(seed))
    kept, lines = without_bad_readings("force", values, STRAIN)
    np.testing.assert_array_equal(kept, values)
    assert not lines


@given(
    records,
    noises,
    seeds,
    st.sampled_from([5.0, 12.0, 100.0, 1e4, 1e6, 0.0]),
    st.integers(1, 4),
)
def test_single_bad_readings_change_a_curve_by_no_more_than_its_error(
    name, noise, seed, size, count
):
    """A size of 0 is that of a logger that wrote zeros."""
    random = np.random.default_rng(seed)
    values, scatter = recorded(name, noise, random)
    bad = random.choice(np.arange(5, len(values) - 5, 10), count, replace=False)
    wrong = values.copy()
    wrong[bad] = values[bad] + size * scatter * random.choice([-1, 1], count) if size else 0.0
    clean = resampled(AT, STRAIN, values)
    kept, _ = without_bad_readings("force", wrong, STRAIN)
    found = resampled(AT, STRAIN, kept)
    error = np.hypot(np.fmax(clean.errors, found.errors), rounding_error(values))
    changed = np.abs(found.values - clean.values)
    assert (changed <= 2.5 * error + 1e-9 * np.ptp(values)).all()
    if size >= 100 and noise != "none":
        assert np.isnan(kept[bad]).all()
        assert np.isnan(kept).sum() == count


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_few_bad_readings_in_a_row_are_left_out_and_a_step_is_kept(count):
    values = CLEAN["snap up"] + np.random.default_rng(0).normal(0, 0.002, 400)
    values[200 : 200 + count] += [1.0, -0.7, 0.4][:count]
    kept, lines = without_bad_readings("force", values, STRAIN)
    assert np.flatnonzero(np.isnan(kept)).tolist() == [*range(200, 200 + count)]
    assert f"{count} readings of force" in lines[0]


def test_zeros_of_a_logger_that_dropped_out_are_left_out_however_long():
    values = 1.0 + STRAIN + np.random.default_rng(0).normal(0, 0.002, 400)
    values[150:190] = 0.0
    np.testing.assert_array_equal(np.flatnonzero(departing(values, STRAIN)), np.arange(150, 190))
    # A machine that stands still may show one value, and the rest at the start is no drop-out.
    assert not departing(values, np.where((STRAIN > 0.3) & (STRAIN < 0.6), 0.3, STRAIN)).any()
    assert not departing(np.where(STRAIN < 0.2, 0.0, values)[:150], STRAIN[:150]).any()


def test_what_departs_everywhere_is_the_shape_of_a_record_and_is_reported():
    values = CLEAN["falling"] + np.random.default_rng(0).normal(0, 0.002, 400)
    values[::8] += 1.0
    kept, lines = without_bad_readings("force", values, STRAIN)
    np.testing.assert_array_equal(kept, values)
    assert "too many" in lines[0]


@given(records, st.sampled_from([0.0, 0.003]), seeds)
def test_a_flat_top_is_left_out(name, noise, seed):
    random = np.random.default_rng(seed)
    values = 5 * STRAIN + CLEAN[name] + noise * random.normal(size=400)
    limit = float(np.quantile(values, 0.8))
    kept, lines = without_bad_readings("force", np.minimum(values, limit), STRAIN)
    gone = np.isnan(kept)
    np.testing.assert_array_equal(gone, values >= limit)
    assert f"{gone.sum()} readings of force are saturated at {limit:.4g}" in lines[0]
    assert not saturated(values, STRAIN, bottom=True).any()


def test_equal_readings_of_a_rounded_record_or_of_a_hold_are_no_saturation():
    round_peak = np.round(1 - (2 * STRAIN - 1) ** 2, 2)
    held = np.minimum(STRAIN, 0.5)
    assert not saturated(round_peak, STRAIN).any()
    assert not saturated(held, held).any()


def test_glitches_of_all_columns_of_a_machine_change_nothing(laboratory):
    machine = laboratory.machine()
    machine["force"] += np.random.default_rng(0).normal(0, 0.05, len(machine))
    machine.to_csv(laboratory.folder / "tensile.csv", index=False)
    clean = laboratory.imported("tensile").cube.squeeze()
    for column, row, value in (
        ("time", 60, 0.001),
        ("extension", 140, 0.0),
        ("extension", 141, -40.0),
        ("force", 200, 0.0),
        ("force", 300, 9999.0),
    ):
        machine.loc[row, column] = value
    machine.to_csv(laboratory.folder / "tensile.csv", index=False)
    read = laboratory.imported("tensile")
    found = read.cube.squeeze()
    changed = np.abs(found.reaction_force - clean.reaction_force)
    assert (changed <= clean.reaction_force_error).all()
    counts = ("1 readings of time", "2 readings of extension", "2 readings of force")
    assert all(any(line.startswith(count) for line in read.summary) for count in counts)


def test_glitches_and_zeros_of_a_meter_change_nothing(laboratory):
    meter = laboratory.meter()
    noise = np.random.default_rng(0).normal(0, 2, len(meter))
    meter["C"] += noise
    meter.loc[[100, 180], "C"] = [1496.0, -3.0]
    meter.loc[[0, 1, 120, 150], "C"] = 0.0
    meter.to_csv(laboratory.folder / "meter.csv", index=False)
    read = laboratory.imported("capacitance")
    cube = read.cube.squeeze()
    astray = cube.capacitance / capacitance(cube.applied_strain) - 1
    assert (np.abs(astray) <= 3 * cube.capacitance_error).all()
    assert "4 readings of capacitance are 0: left out" in read.summary
    assert any(line.startswith("2 readings of capacitance depart") for line in read.summary)


def test_saturated_values_are_missing(laboratory):
    machine, meter = laboratory.machine(), laboratory.meter()
    machine["force"] = np.minimum(machine["force"], 100 * force(0.2))
    meter["C"] = np.clip(meter["C"], 1000 * capacitance(0.23), 1000 * capacitance(0.08))
    machine.to_csv(laboratory.folder / "tensile.csv", index=False)
    meter.to_csv(laboratory.folder / "meter.csv", index=False)
    read = laboratory.imported("tensile")
    gone = np.isnan(read.cube.reaction_force.squeeze())
    np.testing.assert_array_equal(gone, np.arange(7) * 0.05 > 0.21)
    assert any("force are saturated at 0.6" in line for line in read.summary)
    cube = laboratory.imported("capacitance").cube.squeeze()
    known = np.isfinite(cube.capacitance)
    np.testing.assert_array_equal(np.flatnonzero(known), [2, 3, 4])
    np.testing.assert_allclose(cube.capacitance[known], capacitance(np.array([0.1, 0.15, 0.2])))


def test_the_error_of_rounded_readings_is_at_least_that_of_rounding(laboratory):
    meter = laboratory.meter()
    meter["C"] = meter["C"].round(-2)
    meter.to_csv(laboratory.folder / "meter.csv", index=False)
    cube = laboratory.imported("capacitance").cube.squeeze()
    error = cube.capacitance_error * cube.capacitance
    assert (error >= 0.1 / np.sqrt(12) * 0.999).all()
    assert (np.abs(cube.capacitance - capacitance(cube.applied_strain)) <= 3 * error).all()


def test_readings_at_one_time_are_kept_and_counted(laboratory):
    machine = laboratory.machine()
    machine.loc[101, "time"] = machine.loc[100, "time"]
    machine.to_csv(laboratory.folder / "tensile.csv", index=False)
    assert any(
        "1 readings have the time" in line for line in laboratory.imported("tensile").summary
    )


def test_glitches_of_a_tension_record_do_not_change_its_curve(tmp_path):
    strain = np.linspace(0, 1, 200)
    noise = np.random.default_rng(0).normal(0, 0.003, 200)
    record = pd.DataFrame({"strain [1]": strain, "force [N]": 2 * strain**2 + strain + noise})
    record["force [N]"] -= record["force [N]"][0]
    path = tmp_path / "curve.csv"
    record.to_csv(path, index=False)
    clean = read_tension_record(path)
    record.loc[[50, 120], "force [N]"] = [40.0, 0.0]
    record.loc[150, "strain [1]"] = 0.0
    record.to_csv(path, index=False)
    found = read_tension_record(path)
    np.testing.assert_array_equal(found.strain, np.delete(clean.strain, [50, 120, 150]))
    np.testing.assert_array_equal(found.force[0], np.delete(clean.force[0], [50, 120, 150]))
    assert any(line.startswith("2 readings of force depart") for line in found.summary)
