"""The figure of a swept setting, on artificial cubes."""

import numpy as np
import pytest
import xarray as xr

from knitlab.figures.kinds.swept import swept
from knitlab.io.errors import InputError
from knitlab.observables.status import Status
from tests.cubes.artificial_cubes import synthetic_cube

LAYOUTS = ["checkerboard", "checkerboard_courses"]


def two_layouts() -> xr.Dataset:
    one, other = synthetic_cube(), synthetic_cube()
    other["poisson_ratio_min"] = one["poisson_ratio_min"] - 1
    other["status"][1, 0] = Status.not_converged
    return xr.concat([one, other], xr.IndexVariable("layout", LAYOUTS)).transpose(
        "n_stripe", "n_subunit", "layout", ...
    )


def marks(figure):
    return [np.asarray(line.get_xdata()) for line in figure.axes[0].get_lines()]


def test_marks_are_the_values_of_the_designs_that_are_ok():
    figure = swept(two_layouts())
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    # All but the three designs that are excluded.
    assert names == ["(2, 16)", "(2, 32)", "(2, 64)", "(4, 16)", "(4, 32)", "(8, 32)"]
    one, other = marks(figure)
    np.testing.assert_allclose(one, [0.05, np.nan, np.nan, -0.8, -0.4, np.nan])
    np.testing.assert_allclose(other, [-0.95, np.nan, np.nan, np.nan, -1.4, np.nan])


def test_designs_without_value_are_counted():
    assert [text.get_text() for text in swept(two_layouts()).legends[0].get_texts()] == [
        "checkerboard (3 without value)",
        "checkerboard_courses (4 without value)",
    ]


def test_curves_are_reduced():
    one, _ = marks(swept(two_layouts(), of="mean(poisson_ratio, 0.1:0.2)"))
    np.testing.assert_allclose(one[[0, 3, 4]], 0.75 * np.array([0.05, -0.8, -0.4]))


@pytest.mark.parametrize(
    ("cube", "of", "message"),
    [
        (synthetic_cube, "periods", "several values"),
        (lambda: two_layouts().expand_dims(width=[1, 2], axis=2), "periods", "width"),
        (two_layouts, "poisson_ratio", "poisson_ratio"),
        (two_layouts, "status", "status"),
        (two_layouts, "poisson", "poisson"),
    ],
)
def test_what_it_cannot_show_is_refused(cube, of, message):
    with pytest.raises(InputError, match=message):
        swept(cube(), of)
