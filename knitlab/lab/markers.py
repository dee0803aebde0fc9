"""Strains and Poisson's ratio from tracked markers, evaluated as in simulations."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from knitlab.io.errors import invalid
from knitlab.io.table_file import read_columns
from knitlab.lab.description import Description, MarkersTable, SampleTable
from knitlab.lab.machine import Imports, Values, read_pulls
from knitlab.lab.records import Record, resampled
from knitlab.lab.tracks.checks import without_implausible
from knitlab.lab.tracks.grid import MarkerGrid, NoGrid, find_grid, placed_grid
from knitlab.lab.tracks.reading import read_tracks
from knitlab.lab.tracks.track_file import Trajectories, whole_numbers
from knitlab.observables.poisson_ratio import lowest_poisson_ratio, poisson_ratio_of_test
from knitlab.observables.unit_cells import (
    central_mean,
    lattice_vectors,
    local_strain,
    mean_cell_size,
)

Vector = Float[np.ndarray, "2"]
Strains = Float[np.ndarray, " frame"]  # applied, of every frame
POSITIONS_EXAMPLE = "write it as in 'marker,row,column'"
MAX_AT_REST = 0.25  # strain of the reference shape over the first applied strain
MAX_AT_START = 0.02  # and if the first frames show no marker
MIN_FOLLOWED = 0.02  # axial over applied strain, below which a sample counts as unloaded
PULLED_MARGIN = 0.1  # frames within this fraction of the largest strain count as fully pulled
AGREEING = np.radians(6)  # of drift and separation, up to which the drift is along the pull
MIN_DRIFT = 0.1  # of the middle, over the separation of the end rows, by which one clamp moves
MAX_MISALIGNMENT = 35.0  # of the fabric from its stated direction [°]
MAX_SIZE_RATIO = 1.6  # of measured to stated size, or its inverse
IN_PICTURE = {"right": (1, 0), "left": (-1, 0), "up": (0, -1), "down": (0, 1)}  # y points down


@dataclass(frozen=True)
class MarkedSample:
    """The corners of a sample's unit cells, in the fabric's axes; NaN if a marker is lost [mm]."""

    relaxed: Float[np.ndarray, "corner_y corner_x 2"]  # mean of the relaxed frames
    corners: Float[np.ndarray, "frame corner_y corner_x 2"]
    grid: MarkerGrid
    relaxed_frames: int
    unit_cells: tuple[int, int]  # of the sample along (y, x)
    frames: Float[np.ndarray, " frame"]  # their numbers, 0 that of the first of the video
    remarks: Sequence[str] = ()  # on how the tracks were read, and on what was dropped
    turn: float = 0.0  # of the fabric in the picture from the description, anticlockwise [rad]

    @property
    def summary(self) -> str:
        """Summary in one sentence."""
        rows, columns = (count - 1 for count in self.relaxed.shape[:2])
        summary = "{} × {} unit cells of {} × {}".format(rows, columns, *self.unit_cells)
        summary += f"; turned by {round(np.degrees(self.turn), 1) + 0.0:.1f}°"
        if missing := int((self.grid.marker < 0).sum()):
            summary += f"; {missing} position{'s' * (missing > 1)} of the grid without a marker"
        if self.grid.strays:
            strays = ", ".join(map(str, self.grid.strays))
            summary += f"; markers {strays} are not on the grid and are ignored"
        return summary

    def motion(self, strain: Strains) -> tuple[Vector, Vector, Vector]:
        """Where the pull is largest: motion of the middle, last row from first, and last column."""
        pulled = np.flatnonzero(strain >= (1 - PULLED_MARGIN) * np.nanmax(strain))
        moved = self.corners[pulled] - self.relaxed
        drift = _median((moved + moved[:, ::-1, ::-1]) / 2)
        return drift, _separation(moved), _separation(moved.swapaxes(1, 2))


def read_markers(folder: Path, description: Description) -> Imports:
    """Strains and Poisson's ratio in every cycle."""
    table, requested = description.markers, description.protocol.applied_strain
    assert table is not None  # as read_description checks
    path = folder / table.file
    marked = read_marked(folder, table, description.sample)
    frames, summary = marked.frames, list[str]()
    if table.strain_per_frame is not None:
        strain, spans = frames * table.strain_per_frame, [np.arange(len(frames))]
        if strain[-1] < requested[-1] * (1 - 1e-9):
            message = f"ends at an applied strain of {strain[-1]:.3g}, but strain_max is"
            raise invalid(str(path), f"{message} {requested[-1]:g}; reduce strain_max")
    else:
        assert table.frame_rate is not None  # as without strain_per_frame it has both
        assert table.starts is not None
        pulls = read_pulls(folder, description)
        time = table.starts.to("s") + frames / table.frame_rate.to("Hz")
        strain = pulls.strain(time)
        seen = np.isfinite(strain)
        spans = [np.flatnonzero(cycle.loaded(time) & seen) for cycle in pulls.cycles]
        if not len(spans[0]):
            pull = f"the first pull, from {pulls.cycles[0].start:g} s to {pulls.cycles[0].turn:g} s"
            message = f"runs from {time[0]:g} s to {time[-1]:g} s by the machine's clock, and does"
            raise invalid(str(path), f"{message} not cover {pull}; correct starts or frame_rate")
        summary += pulls.remarks
    pulled = np.nanmax(np.abs(strain[: table.relaxed_frames]), initial=0.0)
    if frames[0] > 0 and pulled > MAX_AT_START * requested[1]:
        message = f"shows its first markers in frame {frames[0]:g}, at a strain of {pulled:.3g}"
        hint = "track a frame before the pull, or correct starts or first_frame"
        raise invalid(str(path), f"{message}, so that their relaxed places are unknown; {hint}")
    if pulled > MAX_AT_REST * requested[1]:
        message = f"already reach a strain of {pulled:.3g}"
        hint = "give fewer, or correct starts or strain_per_frame"
        raise invalid(f"{path}: relaxed_frames {table.relaxed_frames}", f"{message}; {hint}")
    if table.align == "pull":
        marked = along_pull(path, marked, strain)
    # As with coordinates in the order (row, column).
    drift, separation, across = marked.motion(strain)
    size = np.linalg.norm(separation)
    drifts_across = np.linalg.norm(drift) > MIN_DRIFT * size and abs(drift[0]) > abs(drift[1])
    if drifts_across and abs(across[0]) > size:
        message = "shows a sample that is pulled along its weft; correct weft and warp, or the"
        raise invalid(str(path), f"{message} order of the coordinates, which is x, y")
    strains = np.array(requested)
    values = [marker_values(marked, strains, strain[span], span) for span in spans]
    mean, error = values[0]["mean_strain_yy"], values[0]["mean_strain_yy_error"]
    if abs(mean[0]) > max(requested[1] / 2, 5 * np.nan_to_num(error[0])):
        message = f"shows an axial strain of {mean[0]:.3g} where the applied strain is 0"
        raise invalid(str(path), f"{message}; correct starts or relaxed_frames")
    if np.isfinite(mean).any() and np.nanmax(np.abs(mean)) < MIN_FOLLOWED * requested[-1]:
        message = "shows markers that do not move while the sample is pulled; correct starts"
        raise invalid(str(path), message)
    if not np.isfinite(mean).any():
        summary.append("no central unit cell keeps its markers, so there are no mean strains")
    return values, [marked.summary, *marked.remarks, *summary]


def read_marked(folder: Path, table: MarkersTable, sample: SampleTable) -> MarkedSample:
    """The markers of a description that lies in a folder."""
    path = folder / table.file
    pixel = table.pixel.to("mm")
    rate = table.frame_rate.to("Hz") if table.frame_rate else None
    confidence, first_frame = table.least_confidence, table.first_frame
    read = read_tracks(path, table.y_axis, confidence, pixel, first_frame, rate, table.choice)
    tracks = in_fabric_axes(read.positions, table)
    if table.relaxed_frames > len(tracks):
        message = f"exceeds the number of frames, {len(tracks)}; give fewer"
        raise invalid(f"{path}: relaxed_frames {table.relaxed_frames}", message)
    before = tracks[: table.relaxed_frames]
    seen = np.isfinite(before).sum(axis=0)
    first = np.where(seen > 0, np.nansum(before, axis=0) / seen.clip(1), np.nan)
    grid = _marker_grid(path, first, folder / table.places if table.places else None)
    every_y, every_x = table.markers_per_cell
    relaxed = grid.corners(first[None])[0, ::every_y, ::every_x]
    corners = grid.corners(tracks)[:, ::every_y, ::every_x]
    cells = sample.unit_cells
    marked = MarkedSample(relaxed, corners, grid, table.relaxed_frames, cells, read.frames)
    _check_fits(path, marked, sample)
    corners, dropped = without_implausible(relaxed, corners)
    markers = grid.marker[::every_y, ::every_x]
    lines = (
        f"marker {markers[row, column]} {reason}: it is left out from frame"
        f" {read.frames[frame]:g} on"
        for row, column, frame, reason in dropped
    )
    return replace(marked, corners=corners, remarks=[*read.summary, *lines])


def _check_fits(path: Path, marked: MarkedSample, sample: SampleTable) -> None:
    marked_rows, marked_columns = (count - 1 for count in marked.relaxed.shape[:2])
    rows, columns = sample.unit_cells
    if not (1 <= marked_rows <= rows and 1 <= marked_columns <= columns):
        shown = f"{marked_rows} × {marked_columns} unit cells of a sample of {rows} × {columns}"
        raise invalid(str(path), f"shows {shown}; give markers_per_cell, or a table of places")
    cells = lattice_vectors(marked.relaxed).reshape(-1, 2, 2)
    edges = cells[np.isfinite(cells).all(axis=(1, 2))]
    if not len(edges):
        raise invalid(str(path), "shows no unit cell with all of its corners; mark more of them")
    mean = edges.mean(axis=0)
    sizes = np.linalg.norm(mean, axis=0)
    (xx, xy), (yx, yy) = mean / sizes
    misaligned = np.degrees(np.arctan2(yx - xy, xx + yy))
    if abs(misaligned) > MAX_MISALIGNMENT:
        message = f"are {misaligned:.0f}° from the rows and columns of markers"
        raise invalid(f"{path}: weft and warp", f"{message}; correct them, or give turned")
    for size, count, side in zip(sizes, (columns, rows), ("width", "length"), strict=True):
        stated = getattr(sample, side).to("mm")
        if not 1 / MAX_SIZE_RATIO < size * count / stated < MAX_SIZE_RATIO:
            message = f"is {stated:.4g} mm for {count} unit cells, but the markers give"
            hint = "correct it, unit_cells, pixel or markers_per_cell"
            raise invalid(f"{path}: sample.{side}", f"{message} {size:.4g} mm each; {hint}")


def along_pull(path: Path, marked: MarkedSample, strain: Strains) -> MarkedSample:
    """The same markers, rotated so that the pull is along y.

    The mean displacement of a marker and its opposite is along the pull if one clamp moves. Rows of
    markers always separate along the pull, but less exactly; so the drift is used where both agree.
    """
    drift, separation, _ = marked.motion(strain)
    if not separation.any():
        return marked
    drift_turn, turn = (
        float(np.arctan(-x / y)) if y else np.pi / 2 for x, y in (drift, separation)
    )
    difference = (drift_turn - turn + np.pi / 2) % np.pi - np.pi / 2
    drifting = np.linalg.norm(drift) > MIN_DRIFT * np.linalg.norm(separation)
    if drifting and abs(difference) > np.radians(MAX_MISALIGNMENT):
        message = f"shows a sample that moves {abs(np.degrees(difference)):.0f}° off the separation"
        message += " of its rows; correct weft and warp, or if the camera moved give"
        raise invalid(str(path), f"{message} align = picture")
    if drifting and abs(difference) <= AGREEING:
        turn = drift_turn
    if abs(turn) > np.radians(MAX_MISALIGNMENT):
        message = f"shows a pull that is {np.degrees(turn):.0f}° from the warp; correct weft, warp"
        raise invalid(str(path), f"{message} or turned, or give align = picture")
    back = _clockwise(turn).T
    return replace(marked, relaxed=marked.relaxed @ back, corners=marked.corners @ back, turn=turn)


def _median(vectors: Float[np.ndarray, "*any 2"]) -> Vector:
    known = vectors[np.isfinite(vectors).all(axis=-1)]
    return np.median(known, axis=0) if len(known) else np.zeros(2)


def _separation(moved: Float[np.ndarray, "frame line marker 2"]) -> Vector:
    one, other = np.triu_indices(moved.shape[1], 1)
    separation = (moved[:, other] - moved[:, one]) / (other - one)[:, None, None]
    return _median(separation) * (moved.shape[1] - 1)


def marker_values(
    marked: MarkedSample, strains: Record, strain: Strains, frames: Int[np.ndarray, " frame"]
) -> Values:
    """Strains and Poisson's ratio at the requested strains, from some frames at given strains."""
    corners = marked.corners[frames]
    values: Values = {}
    for name, field in zip(("xx", "yy"), local_strain(marked.relaxed, corners), strict=True):
        mean = resampled(strains, strain, np.asarray(central_mean(field)))
        # The relaxed shape is a mean of a few frames, each with the same noise.
        noise = mean.noise[np.isfinite(mean.noise)]
        relaxed_noise = np.median(noise) / np.sqrt(marked.relaxed_frames) if len(noise) else 0.0
        values |= {
            f"strain_{name}": resampled(strains, strain, np.asarray(field)).values,
            f"mean_strain_{name}": mean.values,
            f"mean_strain_{name}_error": np.hypot(mean.errors, relaxed_noise),
        }
    across, along = values["mean_strain_xx"], values["mean_strain_yy"]
    ratio = poisson_ratio_of_test(across, along)
    error = np.hypot(values["mean_strain_xx_error"], ratio * values["mean_strain_yy_error"])
    cell_x, cell_y = mean_cell_size(marked.relaxed)
    lost = np.isnan(corners).any(axis=-1).sum(axis=(1, 2)).astype(float)
    mean_lost = resampled(strains, strain, lost).values
    # Where frames are too far apart to resample across, no marker is seen.
    unseen = np.isnan(mean_lost) & (strains > strain.min()) & (strains < strain.max())
    values |= {
        "poisson_ratio": ratio,
        "poisson_ratio_error": np.where(np.isnan(ratio), np.nan, error / np.abs(along)),
        "relaxed_cell_x": float(cell_x),
        "relaxed_cell_y": float(cell_y),
        "markers_lost": np.where(unseen, marked.relaxed[..., 0].size, np.round(mean_lost)),
        "cells_lost": np.isnan(values["strain_xx"]).sum(axis=(1, 2)).astype(float),
    }
    return values | lowest_poisson_ratio(strains, ratio)


def in_fabric_axes(tracks: Trajectories, table: MarkersTable) -> Trajectories:
    """Trajectories in pixels along the x and y of the fabric, by the description [mm]."""
    axes = np.array([IN_PICTURE[table.weft], IN_PICTURE[table.warp]])
    # In pixels y points down, so that an anticlockwise rotation has the opposite sense.
    return table.pixel.to("mm") * tracks @ (axes @ _clockwise(np.radians(table.turned)).T).T


def _clockwise(angle: float) -> Float[np.ndarray, "2 2"]:
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def _marker_grid(
    path: Path, first: Float[np.ndarray, "marker 2"], places: Path | None
) -> MarkerGrid:
    try:
        if places is None:
            return find_grid(first)
        names = ("marker", "row", "column")
        table = read_columns(places, dict.fromkeys(names), POSITIONS_EXAMPLE).numbers
        marker, row, column = (whole_numbers(places, name, table[name]) for name in names)
        if marker.max() >= len(first):
            message = f"names marker {marker.max()}, but there are {len(first)}, counted from 0"
            raise invalid(f"{places}: column marker", message)
        rows, columns = np.full((2, len(first)), -1)
        rows[marker], columns[marker] = row, column
        return placed_grid(rows, columns)
    except NoGrid as error:
        raise invalid(str(places or path), str(error)) from error
