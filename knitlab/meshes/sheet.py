"""The sheet of a case: its nodes on a grid, repeated and closed where the fabric is periodic."""

import numpy as np
import xarray as xr
from jaxtyping import Float


def is_periodic(case_file: xr.Dataset) -> bool:
    """Whether the fabric of a case has no edges."""
    return "length_x" in case_file


def closed_nodes(
    case_file: xr.Dataset, repeats: tuple[int, int] = (1, 1)
) -> Float[np.ndarray, "strain node_y node_x 3"]:
    """Nodes of a sheet at every strain; periodic fabric is repeated, and closed by images [mm].

    Neighbouring repeats share their nodes, so that there is no seam.

    Args:
        case_file: contents of a case file, with node positions.
        repeats: how often periodic fabric is repeated along (y, x); a sample has 1 of each.
    """
    # What knows the nodes of a fabric imports JAX.
    from knitlab.cube.case_file import configurations
    from knitlab.fabric.network import MeshShape
    from knitlab.measure.unit_cells import nodes_at

    periodic = is_periodic(case_file)
    cells_y, cells_x = (case_file.sizes[dim] - (not periodic) for dim in ("node_y", "node_x"))
    rows, columns = (
        np.arange(times * cells + 1)
        for times, cells in zip(repeats, (cells_y, cells_x), strict=True)
    )
    shape = MeshShape(cells_y, cells_x, periodic)
    return np.asarray(nodes_at(shape, configurations(case_file), rows, columns))
