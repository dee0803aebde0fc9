"""The figure of what contact changes, on artificial cubes."""

import numpy as np
import pytest
import xarray as xr

from knitlab.figures.kinds.contact import contact
from knitlab.io.errors import InputError
from knitlab.observables.status import Status
from tests.cubes.artificial_cubes import STRAINS, synthetic_cube


def side_by_side() -> xr.Dataset:
    """Contact adds 0.2 to Poisson's ratio, 10 % to the force and 5 % to the width."""
    without = synthetic_cube()
    designs, states = without["status"].dims, without["poisson_ratio"].dims
    size = np.ones(without["status"].shape)
    without["reaction_force"] = states, size[..., None] * np.array(STRAINS)
    through = np.zeros(without["poisson_ratio"].shape)
    through[0, 0, 0] = 3
    without["self_intersections"] = states, through
    for name in ("relaxed_cell_x", "relaxed_cell_y"):
        without[name] = designs, 10 * size
    touching = without.copy(deep=True)
    touching["poisson_ratio"] = without["poisson_ratio"] + 0.2
    touching["reaction_force"] = 1.1 * without["reaction_force"]
    touching["relaxed_cell_x"] = 1.05 * without["relaxed_cell_x"]
    return xr.concat([without, touching], xr.IndexVariable("contact", ["none", "barrier"]))


def test_changes_are_those_between_the_two():
    ratio, size, force = contact(side_by_side()).axes
    curves = [line for line in ratio.get_lines() if len(line.get_xdata()) == 2][:3]
    for line in curves:
        assert line.get_ydata() == pytest.approx([0.2, 0.2])
    for line in force.get_lines()[:3]:
        assert line.get_ydata() == pytest.approx([0.1, 0.1])
    widths = [line for line in size.get_lines() if line.get_marker() == "o"]
    lengths = [line for line in size.get_lines() if line.get_marker() == "^"]
    assert [float(line.get_xdata()[0]) for line in widths] == pytest.approx([0.05] * 3)
    assert [float(line.get_xdata()[0]) for line in lengths] == pytest.approx([0.0] * 3)
    names = [label.get_text() for label in size.get_yticklabels()]
    assert names == ["(2, 16)", "(4, 16)", "(4, 32)"]


def test_only_designs_that_pass_through_themselves_are_shaded():
    (_, size, _) = contact(side_by_side()).axes
    (shaded,) = size.patches
    assert shaded.get_y() == pytest.approx(-0.5)


def test_designs_that_fail_in_one_of_both_are_named():
    cube = side_by_side()
    cube["status"][1, 0, 0] = Status.failed
    figure = contact(cube)
    names = [label.get_text() for label in figure.axes[1].get_yticklabels()]
    assert names == ["(4, 16)", "(4, 32)"]
    assert any("(2, 16)" in text.get_text() for text in figure.legends[0].get_texts())


@pytest.mark.parametrize(
    ("cube", "message"),
    [
        (lambda: synthetic_cube(), "contact = none,barrier"),
        (lambda: side_by_side().isel(contact=[0]), "contact = none,barrier"),
        (lambda: side_by_side().isel(n_stripe=[2]), "contact: "),
    ],
)
def test_a_cube_without_both_is_refused(cube, message):
    with pytest.raises(InputError, match=message):
        contact(cube())
