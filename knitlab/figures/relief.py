"""A sheet in plan, shaded as a relief."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

LIGHT = np.array([-0.5, 0.5, 0.7])
LIFT = 0.02
"""Height of lines above their faces, as a fraction of the height of the relief."""


def faces_of(nodes: np.ndarray) -> np.ndarray:
    """Corners (face, corner, component) of the grid cells of a sheet of nodes (y, x, component)."""
    corners = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2)
    return corners.reshape(-1, 4, 3)


def draw_relief(
    axes: Axes, faces: np.ndarray, colours: np.ndarray, lines: np.ndarray, rasterised: bool = False
) -> None:
    """Draw faces shaded by their slope, and white lines on them.

    They are drawn from the lowest to the highest, so that a fold hides what lies under it.

    Args:
        axes: axes to draw on.
        faces: corners (face, corner, component).
        colours: RGBA colour of every face.
        lines: segments (segment, end, component).
        rasterised: whether to rasterise them in vector files, which large samples need.
    """
    normals = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    light = np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
    shaded = colours.copy()
    shaded[:, :3] *= (0.45 + 0.55 * light)[:, None]

    heights = faces[:, :, 2].mean(axis=1)
    lifted = lines[:, :, 2].mean(axis=1) + LIFT * np.ptp(heights)
    from_below = np.argsort(np.concatenate([heights, lifted]))
    polygons = [*faces[:, :, :2], *lines[:, :, :2]]
    shades = np.concatenate([shaded, np.ones((len(lines), 4))])[from_below]
    widths = np.repeat([0.2, 1.2], [len(faces), len(lines)])[from_below]
    axes.add_collection(
        PolyCollection(
            [polygons[k] for k in from_below],
            facecolors=shades,
            edgecolors=shades,
            lw=widths,
            rasterized=rasterised,
        )
    )
    axes.set(xlabel="x, weft [mm]", ylabel="y, warp [mm]", aspect="equal")
    axes.autoscale_view()
