"""Sheets: in perspective, shaded by their slope, and in plan, each face in its colour."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LightSource, to_rgba_array
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.proj3d import proj_transform

from knitlab.export.meshes.surface import grid_surface
from knitlab.figures.style import Look

FABRIC = "0.85"  # colour of a sheet
LIGHT = np.array([-0.5, 0.5, 0.7])  # direction of the light on a sheet in plan
DARKEST = 0.45  # brightness of a face that the light grazes
TONES = 8  # steps of brightness: few keep the files of large samples small


def design_text(case: xr.Dataset) -> str:
    """The design of a case as text."""
    return f"n_stripe = {int(case['n_stripe'])}, n_subunit = {int(case['n_subunit'])}"


def state_text(strain: float) -> str:
    """An applied strain as the state of a sheet."""
    return f"pulled {strain:.0%}" if strain else "relaxed"


def draw_sheet(axes: Axes3D, nodes: np.ndarray, colours: Sequence[str] = (FABRIC,)) -> None:
    """Draw nodes (y, x, component) in perspective, in one colour or one for every face."""
    rows, columns, _ = nodes.shape
    faces = np.broadcast_to(to_rgba_array(list(colours)), ((rows - 1) * (columns - 1), 4))
    look: Look = {"facecolors": faces.reshape(rows - 1, columns - 1, 4), "rasterized": True}
    look |= {"shade": True, "lightsource": LightSource(azdeg=225, altdeg=45)}
    # Edges in the colour of their face cover the gaps between faces.
    look |= {"linewidth": 0.3, "antialiased": False}
    axes.plot_surface(*np.moveaxis(nodes, -1, 0), rcount=rows, ccount=columns, **look)


def frame_sheet(axes: Axes3D, around: np.ndarray) -> None:
    """Frame positions (…, component), with equal scales of x, y and z, so that none is cut off."""
    points = around.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2 * (1 + 0.02)
    half = np.maximum(half, 0.05 * half.max())
    limits = zip("xyz", middle - half, middle + half, strict=True)
    axes.set(**{f"{name}lim": (low, high) for name, low, high in limits})
    axes.set_proj_type("ortho")
    axes.view_init(**{"elev": 38.0, "azim": -58.0})
    axes.set_axis_off()
    # In this projection the picture grows as the zoom does.
    axes.set_box_aspect(half)
    across, along, _ = proj_transform(*points.T, axes.get_proj())
    reach = max(np.abs(across).max(), np.abs(along).max())
    axes.set_box_aspect(half, zoom=0.97 * axes.viewLim.x1 / reach)


def draw_scale(axes: Axes3D, around: np.ndarray, unit: str = "mm") -> None:
    """Draw a bar of a round length next to positions (…, component), along x."""
    points = around.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    length = max(MaxNLocator(4).tick_values(0, high[0] - low[0])[1], 1e-9)
    look: Look = {"zs": low[2], "color": "black"}
    ends = (low[0] + high[0]) / 2 + np.array([-0.5, 0.5]) * length
    below, text = low[1] - np.array([0.06, 0.14]) * (high[1] - low[1])
    axes.plot(ends, [below, below], lw=1.2, **look)
    axes.text(ends.mean(), text, low[2], f"{length:g} {unit}", fontsize=7, ha="center", va="top")


def grid_faces(nodes: Float[np.ndarray, "y x 3"]) -> Float[np.ndarray, "face 4 3"]:
    """Corners of the grid cells of a sheet of nodes."""
    surface = grid_surface(nodes)
    return surface.nodes[surface.faces]


def shaded(
    faces: Float[np.ndarray, "face 4 3"], colours: Float[np.ndarray, "face 4"]
) -> Float[np.ndarray, "face 4"]:
    """RGBA colours of faces, darkened by their slope."""
    normals = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    light = np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
    light = np.round(light * TONES) / TONES
    darkened = colours.copy()
    darkened[:, :3] *= (DARKEST + (1 - DARKEST) * light)[:, None]
    return darkened


def draw_faces(
    axes: Axes,
    faces: Float[np.ndarray, "face 4 3"],
    colours: Float[np.ndarray, "face 4"],
    unit: str = "mm",
) -> None:
    """Draw faces in their RGBA colours from above, without seams between them."""
    # A fold hides what lies under it.
    from_below = np.argsort(faces[:, :, 2].mean(axis=1))
    look: Look = {"facecolors": colours[from_below], "rasterized": True}
    # Smoothed edges let the background through between two faces.
    look |= {"edgecolors": "face", "lw": 0.2, "antialiaseds": False}
    axes.add_collection(PolyCollection(list(faces[from_below, :, :2]), **look))
    axes.set(xlabel=f"x, weft [{unit}]", ylabel=f"y, warp [{unit}]", aspect="equal")
    axes.autoscale_view()
