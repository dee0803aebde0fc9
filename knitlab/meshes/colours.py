"""Colours of a mesh, by knit and electrode, for formats that have no fields of faces."""

import numpy as np
from jaxtyping import Float, UInt8

from knitlab.meshes.fields import ELECTRODE, KNIT
from knitlab.meshes.surface import SurfaceMesh

KNIT_COLOURS = ((166, 206, 227), (240, 228, 66), (221, 221, 221))
"""Colours of rib, garter and plain knit, told apart without colour vision [sRGB]."""
ELECTRODE_COLOURS = ((213, 94, 0), (0, 114, 178))
"""Colours of electrodes A and B, likewise [sRGB]."""


def node_colours(mesh: SurfaceMesh) -> UInt8[np.ndarray, "node 3"]:
    """Colour of every node in sRGB: the mean over the faces around it.

    A face has the colour of its electrode or, where there is none, of its knit.
    """
    colours = np.array(KNIT_COLOURS, float)[mesh.face_fields[KNIT]]
    if ELECTRODE in mesh.face_fields:
        electrode = mesh.face_fields[ELECTRODE]
        colours[electrode > 0] = np.array(ELECTRODE_COLOURS, float)[electrode[electrode > 0] - 1]
    nodes = mesh.faces.ravel()
    around = np.repeat(colours, mesh.faces.shape[1], axis=0)
    total = np.stack([np.bincount(nodes, part, len(mesh.nodes)) for part in around.T], axis=1)
    return np.rint(total / np.bincount(nodes)[:, None]).astype(np.uint8)


def linear(colours: UInt8[np.ndarray, "node 3"]) -> Float[np.ndarray, "node 3"]:
    """The same colours as light, from 0 to 1, in place of sRGB (IEC 61966-2-1)."""
    shade = colours / 255
    return np.where(shade <= 0.04045, shade / 12.92, ((shade + 0.055) / 1.055) ** 2.4)
