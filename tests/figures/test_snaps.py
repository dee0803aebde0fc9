"""Curves break where the fabric snaps, and nowhere else."""

import itertools

import numpy as np
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from knitlab.figures.curves import broken
from knitlab.figures.kinds.curves import curves
from tests.cubes.artificial_cubes import synthetic_cube


@given(st.lists(st.booleans(), min_size=1, max_size=30))
def test_a_curve_breaks_before_every_snap_and_loses_no_point(snaps):
    snapped = np.array(snaps)
    strain = np.arange(len(snaps), dtype=float)
    broken_strain, values = broken(snapped, strain, 10 * strain)
    kept = np.isfinite(broken_strain)
    np.testing.assert_array_equal(broken_strain[kept], strain)
    np.testing.assert_array_equal(values[kept], 10 * strain)
    joined = {
        int(after)
        for before, after in itertools.pairwise(broken_strain)
        if np.isfinite([before, after]).all()
    }
    assert joined == {k for k in range(1, len(snaps)) if not snapped[k]}


def test_the_curve_of_a_design_that_snaps_has_a_gap_and_a_legend():
    cube = synthetic_cube()
    assert not any("snaps" in note for note in notes(curves([cube])))
    cube["snapped"] = xr.zeros_like(cube["mean_strain_xx"])
    cube["snapped"].loc[{"n_stripe": 4, "n_subunit": 16, "applied_strain": 0.2}] = 1
    figure = curves([cube])
    lines = {line.get_label(): line for line in np.array(figure.axes).reshape(3, 3)[0, 1].lines}
    snapping, other = lines["16 (P = 2)"].get_xdata(), lines["32 (P = 4)"].get_xdata()
    np.testing.assert_array_equal(snapping, [0, 0.1, np.nan, 0.2])
    np.testing.assert_array_equal(other, [0, 0.1, 0.2])
    assert "break: the fabric snaps there" in notes(figure)


def notes(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]
