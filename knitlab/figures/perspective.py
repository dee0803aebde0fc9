"""A sheet in perspective, coloured by height, and the snapshots of a relaxation."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from mpl_toolkits.mplot3d import Axes3D

from knitlab.figures.style import SEQUENCE_COLOURS

VIEW = {"elev": 38.0, "azim": -58.0}
MARGIN = 0.02
FLAT_SHEET_FITS, FOLDED_SHEET_FITS = 1.0, 1.1
"""Zooms at which a sheet fills its frame."""


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


def by_height(nodes: np.ndarray) -> mpl.colors.Normalize:
    """Norm of the colours of sheets, by height."""
    return mpl.colors.Normalize(nodes[..., 2].min(), nodes[..., 2].max())


def draw_sheet(axes: Axes3D, nodes: np.ndarray, norm: mpl.colors.Normalize) -> None:
    """Draw one sheet, coloured by height.

    Args:
        axes: three-dimensional axes.
        nodes: positions (y, x, component).
        norm: norm of the heights.
    """
    faces = (nodes[:-1, :-1, 2] + nodes[1:, :-1, 2] + nodes[:-1, 1:, 2] + nodes[1:, 1:, 2]) / 4
    axes.plot_surface(
        *np.moveaxis(nodes, -1, 0),
        rcount=nodes.shape[0],
        ccount=nodes.shape[1],
        facecolors=mpl.colormaps[SEQUENCE_COLOURS](norm(faces)),
        linewidth=0,
        antialiased=False,
        shade=True,
    )


def frame_sheet(axes: Axes3D, around: np.ndarray, zoom: float = FLAT_SHEET_FITS) -> None:
    """Set the limits of axes around positions (…, component), with equal scales of x, y and z."""
    low, high = around.reshape(-1, 3).min(axis=0), around.reshape(-1, 3).max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2 * (1 + MARGIN)
    half = np.maximum(half, 0.05 * half.max())
    axes.set(
        xlim=(middle[0] - half[0], middle[0] + half[0]),
        ylim=(middle[1] - half[1], middle[1] + half[1]),
        zlim=(middle[2] - half[2], middle[2] + half[2]),
    )
    axes.set_proj_type("ortho")
    axes.set_box_aspect(half, zoom=zoom)
    axes.view_init(**VIEW)
    axes.set_axis_off()


def time_text(time: float) -> str:
    """A time [ms] as a label."""
    return f"{time:.2g} ms"


def design_text(case: xr.Dataset) -> str:
    """The design of a case as a label."""
    return f"n_stripe = {int(case['n_stripe'])}, n_subunit = {int(case['n_subunit'])}"
