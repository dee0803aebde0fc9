"""Plating: which stitches an electrode takes, and the face of the fabric that it lies on."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import binary_dilation

from knitlab.fabric.electrode_layout import BadLayout, ElectrodeLayout, ridge_lines
from knitlab.io.errors import BadInput, Fault, fault
from knitlab.knitting.chart import Face
from knitlab.simulation.case import Case

FRONT: Face = "front"
BACK: Face = "back"

StitchLines = tuple[Float[np.ndarray, " line_y"], Float[np.ndarray, " line_x"]]
"""Courses below every grid line along y, and wales to the left of every grid line along x."""


def plated_stitches(case: Case, lines: StitchLines) -> Int[np.ndarray, "course wale"]:
    """Numbers of the electrodes that stitches are plated for, 0 where they are not.

    Edges of electrodes are rounded to whole stitches; one narrower than a stitch takes one. On
    periodic fabric, one that crosses the seam goes on at the other edge.

    Args:
        case: the case; one without electrodes has no plated stitch.
        lines: where its grid lines lie, in stitches.

    Raises:
        BadInput: if the electrodes do not fit the fabric, or touch once they are whole stitches.
    """
    size = tuple(round(float(line[-1])) for line in lines)
    plated = np.zeros(size, int)
    if case.capacitor is None:
        return plated
    try:
        electrodes = case.electrodes
    except BadLayout as error:
        raise BadInput(Fault("layout", problem) for problem in error.problems) from error
    for number, strips in enumerate(electrodes.strips, start=1):
        for strip in strips:
            across, along = strip.extents
            rows, columns = (
                _whole(extent, line) for extent, line in zip((along, across), lines, strict=True)
            )
            plated[np.ix_(rows % size[0], columns % size[1])] = number
    touching = binary_dilation(plated == 1, np.ones((3, 3))) & (plated == 2)
    if touching.any():
        course, wale = np.argwhere(touching)[0].tolist()
        raise fault(
            "layout",
            f"electrodes A and B touch at course {course + 1}, wale {wale + 1}, as whole stitches;"
            " take a smaller width, or ridges farther apart",
        )
    return plated


def plated_faces(case: Case, face: Face | None) -> tuple[Face, Face]:
    """The faces of the fabric that the conductors of electrodes A and B lie on.

    Args:
        case: the case.
        face: the face of both, if it is chosen.
    """
    layout = ElectrodeLayout() if case.capacitor is None else case.capacitor.layout
    if face is not None:
        return face, face
    if layout.face != "both":
        return layout.face, layout.face
    if layout.mask:
        return FRONT, BACK
    lines = ridge_lines(layout, case.sample, case.options)
    mountains = ridge_lines(replace(layout, face=FRONT), case.sample, case.options)
    one, other = (FRONT if lines[number - 1] in mountains else BACK for number in layout.ridges)
    return one, other


def _whole(
    extent: tuple[float, float], line: Float[np.ndarray, " line"]
) -> Int[np.ndarray, " stitch"]:
    """Stitches between two places of the grid, which may lie beyond its edges."""
    cells, stitches = len(line) - 1, line[-1]
    first, last = (
        place // cells * stitches + np.interp(place % cells, np.arange(cells + 1), line)
        for place in extent
    )
    low, high = int(np.floor(first + 0.5)), int(np.floor(last + 0.5))
    return np.arange(low, max(high, low + 1))
