"""Plates: the stiffness of periodic fabric as a shell, and cards for other programs."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from knitlab.api.cubes import Cube, opened_with_shapes
from knitlab.export.plates.plate_stiffness import plates_of
from knitlab.export.plates.shell_cards import CARDS
from knitlab.io.names import check_suffix


def plate_stiffness(
    shapes: Cube,
    output: str | Path | None = None,
    selections: Mapping[str, Any] = {},
    *,
    where: str | None = None,
    **named: Any,
) -> xr.Dataset:
    """The stiffness of periodic fabric as a plate, at every state: membrane, coupling, bending.

    To first order from a state, forces over width are N = N0 + A e + B κ and moments
    M = M0 + Bᵀ e + D κ, with strain and curvature in the order xx, yy, 2 xy. x is along the courses
    (weft), y along the wales (warp), which tests pull by default, and z to the technical face.
    Curvature is positive where the side at +z gets longer. The nodes of one unit cell are condensed
    out; ``docs/explanation/plate.md`` says what the forces in a state add. Lengths are in mm of
    cloth where the gauge says how long that is.

    Args:
        shapes: a cube with its case files beside it, or a test of :func:`knitlab.simulate`.
        output: file to write: ``.csv`` a table, ``.json`` all states, ``.inp`` one state as
            ``*SHELL GENERAL SECTION`` of Abaqus.
        selections: a value or a list of values for each coordinate.
        where: condition on the designs, as of :func:`knitlab.query`.
        named: further selections, as keywords: ``n_stripe=4``.

    Returns:
        ``membrane_stiffness`` A, ``coupling_stiffness`` B and ``bending_stiffness`` D along ``row``
        and ``column``, ``membrane_force`` N0 and ``moment`` M0 along ``row``; ``modulus_x``,
        ``poisson_ratio_y`` and others that follow from A; and ``plate_status`` of every state: ok,
        singular, negative (of these numbers are known), unstable, not_converged or no_shape.

    Raises:
        InputError: if no design that is left has a periodic shape, a design is a clamped sample, a
            selection or the suffix is at fault, or a card asks for a state that is not ok.

    Example:
        >>> one = {"n_stripe": 4, "n_subunit": 16, "applied_strain": [0.06, 0.15]}
        >>> plates = kl.plate_stiffness("results/reference/periodic", selections=one)
        >>> plates["poisson_ratio_y"].values.round(2).ravel().tolist()
        [-0.8, -0.71]
    """
    selections = {**selections, **named}
    if output is not None:
        check_suffix(output := Path(output), CARDS, "a card or table")
    plates = plates_of(opened_with_shapes(shapes), selections, where)
    if output is not None:
        CARDS[output.suffix.lower()](plates, output)
    return plates
