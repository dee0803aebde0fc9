"""A sheet in perspective, shaded by its slope, and the snapshots of a relaxation."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.colors import LightSource, to_rgba_array
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.proj3d import proj_transform

VIEW = {"elev": 38.0, "azim": -58.0}
MARGIN = 0.02
FILLED = 0.97
"""Part of its frame that a sheet fills."""
LIGHT = LightSource(azdeg=225, altdeg=45)
FABRIC = "0.85"
"""Colour of a sheet."""


def snapshot_nodes(case: xr.Dataset) -> np.ndarray:
    """Node positions (snapshot, y, x, component) of a relaxation, periodic fabric closed [mm]."""
    nodes = case["snapshot_position"].values
    if "snapshot_length_x" not in case:
        return nodes
    across, along = (np.zeros((len(nodes), 1, 1, 3)) for _ in range(2))
    across[..., 0] = case["snapshot_length_x"].values[:, None, None]
    along[..., 1] = case["snapshot_length_y"].values[:, None, None]
    nodes = np.concatenate([nodes, nodes[:, :, :1] + across], axis=2)
    return np.concatenate([nodes, nodes[:, :1] + along], axis=1)


def draw_sheet(axes: Axes3D, nodes: np.ndarray, colours: Sequence[str] | None = None) -> None:
    """Draw one sheet, shaded by its slope, without seams between its faces.

    Args:
        axes: three-dimensional axes.
        nodes: positions (y, x, component).
        colours: a colour for every face, row after row; grey by default.
    """
    rows, columns = nodes.shape[0] - 1, nodes.shape[1] - 1
    faces = to_rgba_array([FABRIC] if colours is None else list(colours))
    axes.plot_surface(
        *np.moveaxis(nodes, -1, 0),
        rcount=nodes.shape[0],
        ccount=nodes.shape[1],
        facecolors=np.broadcast_to(faces, (rows * columns, 4)).reshape(rows, columns, 4),
        # Edges in the colour of their face cover the gaps between faces.
        linewidth=0.3,
        antialiased=False,
        shade=True,
        lightsource=LIGHT,
        rasterized=True,
    )


def frame_sheet(axes: Axes3D, around: np.ndarray) -> None:
    """Frame positions (…, component), with equal scales of x, y and z, so that none is cut off."""
    points = around.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2 * (1 + MARGIN)
    half = np.maximum(half, 0.05 * half.max())
    axes.set(
        xlim=(middle[0] - half[0], middle[0] + half[0]),
        ylim=(middle[1] - half[1], middle[1] + half[1]),
        zlim=(middle[2] - half[2], middle[2] + half[2]),
    )
    axes.set_proj_type("ortho")
    axes.view_init(**VIEW)
    axes.set_axis_off()
    # In this projection the picture grows as the zoom does.
    axes.set_box_aspect(half)
    across, along, _ = proj_transform(*points.T, axes.get_proj())
    reach = max(np.abs(across).max(), np.abs(along).max())
    axes.set_box_aspect(half, zoom=FILLED * axes.viewLim.x1 / reach)


def time_text(time: float) -> str:
    """A time [ms] as a label."""
    return f"{time:.2g} ms"


def design_text(case: xr.Dataset) -> str:
    """The design of a case as a label."""
    return f"n_stripe = {int(case['n_stripe'])}, n_subunit = {int(case['n_subunit'])}"
