"""Markers read as simulations are: local strains, their central means, Poisson's ratio."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.laboratory.description import MarkersTable, SampleTable
from knitlab.laboratory.trajectories import grid_of, in_fabric_axes, read_trajectories
from knitlab.measure.marker_grid import MarkerGrid
from knitlab.measure.resampling import resampled
from knitlab.measure.strain import central_mean, lattice_vectors, local_strain, poisson_ratio
from knitlab.sweep.faults import fault

MOST_PULLED = 0.1
"""Part of the largest strain within which a frame shows the whole pull."""
LEAST_DRIFT = 0.25
"""Mean displacement, over that of the last row from the first, that tells of one moving clamp."""


@dataclass(frozen=True)
class Marked:
    """The corners of a sample's unit cells in every frame, along the fabric's axes.

    Attributes:
        relaxed: before the test [mm].
        corners: in every frame; NaN where the marker is lost [mm].
        grid: which marker is which corner, or between two of them.
        relaxed_frames: that the relaxed shape is the mean of.
        turn: by how much the fabric was turned in the picture, anticlockwise, beside what the
            description says [rad].
    """

    relaxed: Float[np.ndarray, "cell_y+1 cell_x+1 2"]
    corners: Float[np.ndarray, "frame cell_y+1 cell_x+1 2"]
    grid: MarkerGrid
    relaxed_frames: int
    turn: float = 0.0

    @property
    def summary(self) -> str:
        """What was found, in a sentence."""
        rows, columns = (count - 1 for count in self.relaxed.shape[:2])
        missing = int((self.grid.marker < 0).sum())
        parts = [f"{rows} × {columns} unit cells", f"turned by {np.degrees(self.turn):.1f}°"]
        if missing:
            parts.append(f"{missing} markers missing from the grid")
        if self.grid.strays:
            named = ", ".join(map(str, self.grid.strays))
            parts.append(f"markers {named} stand on no grid and are left out")
        return "; ".join(parts)


def read_marked(folder: Path, table: MarkersTable, sample: SampleTable) -> Marked:
    """Read the markers of a description.

    Args:
        folder: of the description.
        table: its markers.
        sample: its sample.

    Raises:
        BadInput: if the files are at fault, or do not fit the sample.
    """
    path = folder / table.file
    tracks = in_fabric_axes(read_trajectories(path), table)
    if table.relaxed_frames > len(tracks):
        raise fault(
            f"{path}: relaxed_frames {table.relaxed_frames}",
            f"is more than the {len(tracks)} frames there are; give fewer",
        )
    before = tracks[: table.relaxed_frames]
    there = np.isfinite(before).all(axis=2)
    known = np.where(there[..., None], before, 0.0).sum(axis=0)
    first = np.where(there.any(axis=0)[:, None], known / there.sum(axis=0).clip(1)[:, None], np.nan)
    grid = grid_of(path, first, folder / table.places if table.places else None)
    every_y, every_x = table.markers_per_cell
    places = slice(None, None, every_y), slice(None, None, every_x)
    relaxed = grid.corners(first[None])[(0, *places)]
    corners = grid.corners(tracks)[(slice(None), *places)]
    found = tuple(count - 1 for count in relaxed.shape[:2])
    if min(found) < 1 or any(
        many > most for many, most in zip(found, sample.unit_cells, strict=True)
    ):
        rows, columns = sample.unit_cells
        raise fault(
            str(path),
            f"shows {found[0]} × {found[1]} unit cells of a sample of {rows} × {columns};"
            " give markers_per_cell, or a table of places",
        )
    return Marked(relaxed, corners, grid, table.relaxed_frames)


def along_pull(marked: Marked, strain: Float[np.ndarray, " frame"]) -> Marked:
    """The same markers, turned so that the pull is along y.

    Where one clamp moves, so does the middle of the sample, and along the pull: what a sample does
    is the same when it is turned by half a turn, so that its mean displacement is, whatever its
    unit cells are like. Markers whose partner across the middle is missing are left out of it.
    Where both clamps move apart, it is along the pull that rows of markers part.

    Args:
        marked: the markers.
        strain: applied strain in every frame; NaN where it is not known.
    """
    pulled = np.flatnonzero(strain >= (1 - MOST_PULLED) * np.nanmax(strain))
    moved = marked.corners[pulled] - marked.relaxed
    paired = np.isfinite(moved + moved[:, ::-1, ::-1]).all(axis=-1)
    if not paired.any():
        return marked
    rows, columns = (
        np.broadcast_to(each, paired.shape)[paired] for each in np.indices(paired.shape[1:])
    )
    affine = np.stack([np.ones(len(rows)), rows - rows.mean(), columns - columns.mean()], axis=1)
    mean, parting, _ = np.linalg.lstsq(affine, moved[paired])[0]
    spread = np.linalg.norm(parting) * np.ptp(rows)
    across, along = mean if np.linalg.norm(mean) > LEAST_DRIFT * spread else parting
    turn = float(np.arctan2(-across, along))
    back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    relaxed, corners = marked.relaxed @ back.T, marked.corners @ back.T
    return replace(marked, relaxed=relaxed, corners=corners, turn=turn)


def marker_values(
    marked: Marked, at: Sequence[float], strain: Float[np.ndarray, " frame"], frames: np.ndarray
) -> dict[str, Any]:
    """What markers say of a pull, under the registry's names.

    Args:
        marked: the markers.
        at: applied strains that are asked for.
        strain: applied strain of the frames of this pull.
        frames: which frames these are.

    Raises:
        BadInput: if every unit cell lost a marker.
    """
    strains = np.asarray(at)
    values: dict[str, Any] = {}
    errors = {}
    for name, field in zip(
        ("xx", "yy"), local_strain(marked.relaxed, marked.corners[frames]), strict=True
    ):
        mean = resampled(strains, strain, np.asarray(central_mean(field)))
        # The relaxed shape is a mean of a few frames, as noisy as any.
        of_relaxed = np.nanmedian(mean.noise) / np.sqrt(marked.relaxed_frames)
        errors[name] = np.hypot(mean.errors, of_relaxed)
        values |= {
            f"strain_{name}": resampled(strains, strain, np.asarray(field)).values,
            f"mean_strain_{name}": mean.values,
            f"mean_strain_{name}_error": errors[name],
        }
    across, along = values["mean_strain_xx"], values["mean_strain_yy"]
    ratio = poisson_ratio(across, along)
    ratio[0] = np.nan  # 0/0, whatever noise makes of it
    edges = np.linalg.norm(lattice_vectors(marked.relaxed), axis=-2)
    lost = np.isnan(marked.corners[frames]).any(axis=-1).sum(axis=(1, 2)).astype(float)
    values |= {
        "poisson_ratio": ratio,
        "poisson_ratio_error": np.where(
            np.isnan(ratio), np.nan, np.hypot(errors["xx"], ratio * errors["yy"]) / np.abs(along)
        ),
        "relaxed_cell_x": float(central_mean(edges[..., 0])),
        "relaxed_cell_y": float(central_mean(edges[..., 1])),
        "markers_lost": np.round(resampled(strains, strain, lost).values),
        "cells_lost": np.isnan(values["strain_xx"]).sum(axis=(1, 2)).astype(float),
    }
    if np.isfinite(ratio).any():
        lowest = int(np.nanargmin(ratio))
        values["poisson_ratio_min"] = ratio[lowest]
        values["applied_strain_at_min"] = strains[lowest]
    return values
