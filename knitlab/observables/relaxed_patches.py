"""Boundaries and widths of the patches of the relaxed fabric (paper, Sec. "Relaxation")."""

from typing import TYPE_CHECKING, Any

from knitlab.observables.observable import Group, boundary, number, observable

if TYPE_CHECKING:
    from knitlab.observables.finished_test import FinishedTest
    from knitlab.observables.wavelength import Direction

PATCHES = Group(
    "patches",
    "Shape of the relaxed fabric",
    lambda case: not case.pure and case.spans is None,
)
TRACED = "between unit cells, nearest the middle of the relaxed fabric"
WAVE = f"{TRACED}; missing where it crosses a single unit cell"
ACROSS = "across its folds, relaxed, in the unit cell nearest the middle"


def boundary_in(test: "FinishedTest", direction: "Direction") -> dict[str, Any]:
    """The boundary along one direction, and its wavelength and amplitude."""
    from knitlab.observables.wavelength import boundary_wave

    case = test.case
    wave = boundary_wave(case.mesh_shape, case.cell_grid, test.relaxed, direction)
    if wave is None:
        return {}
    return {
        f"wavelength_{direction}": wave.wavelength,
        f"wave_amplitude_{direction}": wave.amplitude,
        f"boundary_{direction}": wave.across,
        f"boundary_length_{direction}": wave.along[-1],
    }


@observable(
    PATCHES,
    wavelength_x=number("wavelength of the boundary along the weft", "mm", description=WAVE),
    wave_amplitude_x=number("amplitude of the boundary along the weft", "mm", description=WAVE),
    boundary_x=boundary("offset of the boundary along the weft", "mm", description=TRACED),
    boundary_length_x=number("length of the boundary along the weft", "mm", description=TRACED),
)
def boundary_x(test: "FinishedTest") -> dict[str, Any]:
    """The boundary along the weft."""
    return boundary_in(test, "x")


@observable(
    PATCHES,
    wavelength_y=number("wavelength of the boundary along the warp", "mm", description=WAVE),
    wave_amplitude_y=number("amplitude of the boundary along the warp", "mm", description=WAVE),
    boundary_y=boundary("offset of the boundary along the warp", "mm", description=TRACED),
    boundary_length_y=number("length of the boundary along the warp", "mm", description=TRACED),
)
def boundary_y(test: "FinishedTest") -> dict[str, Any]:
    """The boundary along the warp."""
    return boundary_in(test, "y")


@observable(
    PATCHES,
    rib_width_centre=number("width of a rib patch at its centre", "mm", description=ACROSS),
    rib_width_edge=number("width of a rib patch at its edges", "mm", description=ACROSS),
    garter_height_centre=number("height of a garter patch at its centre", "mm", description=ACROSS),
    garter_height_edge=number("height of a garter patch at its edges", "mm", description=ACROSS),
)
def widths(test: "FinishedTest") -> dict[str, Any]:
    """Widths of patches across their folds."""
    from knitlab.observables.folds import widths_across_folds

    case, names = test.case, {"rib": "rib_width", "garter": "garter_height"}
    found = widths_across_folds(case.mesh_shape, case.sample, case.cell_grid, test.relaxed)
    values = {}
    for knit, (centre, edge) in found.items():
        values[f"{names[knit]}_centre"] = centre
        values[f"{names[knit]}_edge"] = edge
    return values
