"""A sheet in plan: its faces seen from above, coloured, and shaded if colour is not to be read."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

LIGHT = np.array([-0.5, 0.5, 0.7])
DARKEST = 0.45
"""Brightness of a face that the light grazes."""


TONES = 8
"""Steps of brightness."""


def faces_of(nodes: Float[np.ndarray, "y x 3"]) -> Float[np.ndarray, "face 4 3"]:
    """Corners of the grid cells of a sheet of nodes."""
    corners = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2)
    return corners.reshape(-1, 4, 3)


def shaded(
    faces: Float[np.ndarray, "face 4 3"], colours: Float[np.ndarray, "face 4"]
) -> Float[np.ndarray, "face 4"]:
    """Colours of faces, darkened by their slope.

    Args:
        faces: corners of every face.
        colours: RGBA colour of every face.
    """
    normals = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    light = np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
    # Few tones keep the files of large samples small.
    light = np.round(light * TONES) / TONES
    darkened = colours.copy()
    darkened[:, :3] *= (DARKEST + (1 - DARKEST) * light)[:, None]
    return darkened


def draw_faces(
    axes: Axes, faces: Float[np.ndarray, "face 4 3"], colours: Float[np.ndarray, "face 4"]
) -> None:
    """Draw faces from above, without seams between them.

    They are drawn from the lowest to the highest, so that a fold hides what lies under it; vector
    files hold them as a picture.

    Args:
        axes: axes to draw on.
        faces: corners of every face [mm].
        colours: RGBA colour of every face.
    """
    from_below = np.argsort(faces[:, :, 2].mean(axis=1))
    axes.add_collection(
        PolyCollection(
            list(faces[from_below, :, :2]),
            facecolors=colours[from_below],
            edgecolors="face",
            lw=0.2,
            # Smoothed edges let the background through between two faces.
            antialiaseds=False,
            rasterized=True,
        )
    )
    axes.set(xlabel="x, weft [mm]", ylabel="y, warp [mm]", aspect="equal")
    axes.autoscale_view()
