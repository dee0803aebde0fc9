"""Strains and Poisson's ratio from tracked markers, evaluated as in simulations.

Trajectories in pixels are read, brought to the axes of the fabric and assigned to the corners of
unit cells; the strains of these are resampled at the applied strains.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy.lib.format import MAGIC_PREFIX

from knitlab.io.errors import fault
from knitlab.io.table_file import read_columns
from knitlab.laboratory.description import Description, MarkersTable, SampleTable
from knitlab.laboratory.machine import Imports, Values, read_pulls
from knitlab.measure.marker_grid import MarkerGrid, NoGrid, find_grid, grid_of_positions
from knitlab.measure.records import resampled
from knitlab.measure.unit_cells import (
    central_mean,
    lattice_vectors,
    local_strain,
    lowest_poisson_ratio,
    mean_cell_size,
    poisson_ratio_of_test,
)

LARGEST_AT_REST = 0.25  # strain of the reference shape over the first applied strain
LEAST_FOLLOWED = 0.02  # axial over applied strain, below which a sample counts as unloaded
PULLED_MARGIN = 0.1  # frames within this fraction of the largest strain count as fully pulled
AGREEING = np.radians(6)  # of drift and separation, up to which the drift is along the pull
LEAST_DRIFT = 0.1  # of the middle, over the separation of the end rows, by which one clamp moves
LARGEST_MISALIGNMENT = 35.0  # of the fabric from its stated direction [°]
LARGEST_SIZE_RATIO = 1.6  # of measured to stated size, or its inverse
MOST_MISSING_LISTED = 5  # frames without a marker
IN_PICTURE = {"right": (1, 0), "left": (-1, 0), "up": (0, -1), "down": (0, 1)}  # y points down

Trajectories = Float[np.ndarray, "frame marker 2"]


@dataclass(frozen=True)
class MarkedSample:
    """The corners of a sample's unit cells, in the fabric's axes; NaN if a marker is lost [mm]."""

    relaxed: Float[np.ndarray, "corner_y corner_x 2"]  # mean of the relaxed frames
    corners: Float[np.ndarray, "frame corner_y corner_x 2"]
    grid: MarkerGrid
    relaxed_frames: int
    unit_cells: tuple[int, int]  # of the sample along (y, x)
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


def read_markers(folder: Path, description: Description) -> Imports:
    """Strains and Poisson's ratio in every cycle."""
    table, requested = description.markers, description.protocol.applied_strain
    assert table is not None  # as read_description checks
    path = folder / table.file
    marked = read_marked(folder, table, description.sample)
    frames, summary = np.arange(len(marked.corners)), []
    if table.strain_per_frame is not None:
        strain, spans = frames * table.strain_per_frame, [frames]
        if strain[-1] < requested[-1] * (1 - 1e-9):
            problem = f"ends at an applied strain of {strain[-1]:.3g}, but strain_max is"
            raise fault(str(path), f"{problem} {requested[-1]:g}; reduce strain_max")
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
            problem = f"runs from {time[0]:g} s to {time[-1]:g} s by the machine's clock, and does"
            raise fault(str(path), f"{problem} not cover {pull}; correct starts or frame_rate")
        summary.append(pulls.summary)
    pulled = np.nanmax(np.abs(strain[: table.relaxed_frames]), initial=0.0)
    if pulled > LARGEST_AT_REST * requested[1]:
        problem = f"already reach a strain of {pulled:.3g}"
        remedy = "give fewer, or correct starts or strain_per_frame"
        raise fault(f"{path}: relaxed_frames {table.relaxed_frames}", f"{problem}; {remedy}")
    if table.align == "pull":
        marked = along_pull(path, marked, strain)
    values = [marker_values(marked, requested, strain[span], span) for span in spans]
    mean, error = values[0]["mean_strain_yy"], values[0]["mean_strain_yy_error"]
    if abs(mean[0]) > max(requested[1] / 2, 5 * np.nan_to_num(error[0])):
        problem = f"shows an axial strain of {mean[0]:.3g} where the applied strain is 0"
        raise fault(str(path), f"{problem}; correct starts or relaxed_frames")
    if np.isfinite(mean).any() and np.nanmax(np.abs(mean)) < LEAST_FOLLOWED * requested[-1]:
        problem = "shows markers that do not move while the sample is pulled; correct starts"
        raise fault(str(path), problem)
    if not np.isfinite(mean).any():
        summary.append("no central unit cell keeps its markers, so there are no mean strains")
    return values, [marked.summary, *summary]


def read_marked(folder: Path, table: MarkersTable, sample: SampleTable) -> MarkedSample:
    """The markers of a description that lies in a folder."""
    path = folder / table.file
    tracks = in_fabric_axes(read_trajectories(path), table)
    if table.relaxed_frames > len(tracks):
        problem = f"exceeds the number of frames, {len(tracks)}; give fewer"
        raise fault(f"{path}: relaxed_frames {table.relaxed_frames}", problem)
    before = tracks[: table.relaxed_frames]
    seen = np.isfinite(before).sum(axis=0)
    first = np.where(seen > 0, np.nansum(before, axis=0) / seen.clip(1), np.nan)
    grid = _grid_of(path, first, folder / table.places if table.places else None)
    every_y, every_x = table.markers_per_cell
    relaxed = grid.corners(first[None])[0, ::every_y, ::every_x]
    corners = grid.corners(tracks)[:, ::every_y, ::every_x]
    marked = MarkedSample(relaxed, corners, grid, table.relaxed_frames, sample.unit_cells)
    _check_fits(path, marked, sample)
    return marked


def _check_fits(path: Path, marked: MarkedSample, sample: SampleTable) -> None:
    marked_rows, marked_columns = (count - 1 for count in marked.relaxed.shape[:2])
    rows, columns = sample.unit_cells
    if not (1 <= marked_rows <= rows and 1 <= marked_columns <= columns):
        shown = f"{marked_rows} × {marked_columns} unit cells of a sample of {rows} × {columns}"
        remedy = "give markers_per_cell, or a table of places"
        raise fault(str(path), f"shows {shown}; {remedy}")
    cells = lattice_vectors(marked.relaxed).reshape(-1, 2, 2)
    edges = cells[np.isfinite(cells).all(axis=(1, 2))]
    if not len(edges):
        raise fault(str(path), "shows no unit cell with all of its corners; mark more of them")
    mean = edges.mean(axis=0)
    sizes = np.linalg.norm(mean, axis=0)
    (xx, xy), (yx, yy) = mean / sizes
    misaligned = np.degrees(np.arctan2(yx - xy, xx + yy))
    if abs(misaligned) > LARGEST_MISALIGNMENT:
        problem = f"are {misaligned:.0f}° from the rows and columns of markers"
        raise fault(f"{path}: weft and warp", f"{problem}; correct them, or give turned")
    for size, stated, count, side in (
        (sizes[0], sample.width.to("mm"), columns, "width"),
        (sizes[1], sample.length.to("mm"), rows, "length"),
    ):
        if not 1 / LARGEST_SIZE_RATIO < size * count / stated < LARGEST_SIZE_RATIO:
            problem = f"is {stated:.4g} mm for {count} unit cells, but the markers give"
            remedy = "correct it, unit_cells, pixel or markers_per_cell"
            raise fault(f"{path}: sample.{side}", f"{problem} {size:.4g} mm each; {remedy}")


def along_pull(
    path: Path, marked: MarkedSample, strain: Float[np.ndarray, " frame"]
) -> MarkedSample:
    """The same markers, rotated so that the pull is along y.

    If one clamp moves, the middle of the sample drifts along the pull: the sample is symmetric
    under rotation by 180°, so that the mean displacement of a marker and its opposite is along the
    pull for any unit cell. But the camera may move, or both clamps. Rows of markers always separate
    along the pull, but less exactly. So the drift is used where it agrees with the separation.
    """
    pulled = np.flatnonzero(strain >= (1 - PULLED_MARGIN) * np.nanmax(strain))
    moved = marked.corners[pulled] - marked.relaxed
    drifts = (moved + moved[:, ::-1, ::-1]) / 2
    one, other = np.triu_indices(moved.shape[1], 1)
    separations = (moved[:, other] - moved[:, one]) / (other - one)[:, None, None]
    if not np.nan_to_num(separations).any():
        return marked
    drift, separation = (
        np.nanmedian(each.reshape(-1, 2), axis=0) for each in (drifts, separations)
    )
    by_drift, turn = _direction(drift), _direction(separation)
    difference = (by_drift - turn + np.pi / 2) % np.pi - np.pi / 2
    apart = np.linalg.norm(separation) * (moved.shape[1] - 1)
    drifting = np.linalg.norm(drift) > LEAST_DRIFT * apart
    if drifting and abs(difference) > np.radians(LARGEST_MISALIGNMENT):
        moves = f"moves {abs(np.degrees(difference)):.0f}° off the separation of its rows"
        remedy = "correct weft and warp, or if the camera moved give align = picture"
        raise fault(str(path), f"shows a sample that {moves}; {remedy}")
    if drifting and abs(difference) <= AGREEING:
        turn = by_drift
    if abs(turn) > np.radians(LARGEST_MISALIGNMENT):
        problem = f"shows a pull that is {np.degrees(turn):.0f}° from the warp"
        remedy = "correct weft, warp or turned, or give align = picture"
        raise fault(str(path), f"{problem}; {remedy}")
    back = _clockwise(turn).T
    relaxed, corners = marked.relaxed @ back, marked.corners @ back
    return replace(marked, relaxed=relaxed, corners=corners, turn=turn)


def _direction(moved: Float[np.ndarray, "2"]) -> float:
    """Angle of an undirected line from y, anticlockwise [rad]."""
    across, along = moved
    return float(np.arctan(-across / along)) if along else np.pi / 2


def marker_values(
    marked: MarkedSample,
    requested: Sequence[float],
    strain: Float[np.ndarray, " frame"],
    frames: np.ndarray,
) -> Values:
    """Strains and Poisson's ratio at the requested strains, from some frames at given strains."""
    strains, corners = np.asarray(requested), marked.corners[frames]
    values: Values = {}
    for name, field in zip(("xx", "yy"), local_strain(marked.relaxed, corners), strict=True):
        mean = resampled(strains, strain, np.asarray(central_mean(field)))
        # The relaxed shape is a mean of a few frames, each with the same noise.
        noise = mean.noise[np.isfinite(mean.noise)]
        of_relaxed = np.median(noise) / np.sqrt(marked.relaxed_frames) if len(noise) else 0.0
        values |= {
            f"strain_{name}": resampled(strains, strain, np.asarray(field)).values,
            f"mean_strain_{name}": mean.values,
            f"mean_strain_{name}_error": np.hypot(mean.errors, of_relaxed),
        }
    across, along = values["mean_strain_xx"], values["mean_strain_yy"]
    ratio = poisson_ratio_of_test(across, along)
    error = np.hypot(values["mean_strain_xx_error"], ratio * values["mean_strain_yy_error"])
    cell_x, cell_y = mean_cell_size(marked.relaxed)
    lost = np.isnan(corners).any(axis=-1).sum(axis=(1, 2)).astype(float)
    values |= {
        "poisson_ratio": ratio,
        "poisson_ratio_error": np.where(np.isnan(ratio), np.nan, error / np.abs(along)),
        "relaxed_cell_x": float(cell_x),
        "relaxed_cell_y": float(cell_y),
        "markers_lost": np.round(resampled(strains, strain, lost).values),
        "cells_lost": np.isnan(values["strain_xx"]).sum(axis=(1, 2)).astype(float),
    }
    return values | lowest_poisson_ratio(strains, ratio)


def read_trajectories(path: Path) -> Trajectories:
    """Trajectories in pixels, of an ``.npy`` array or a CSV table; NaN where a marker is lost."""
    if path.suffix not in READERS:
        raise fault(str(path), "has no suffix .npy or .csv; give one of these")
    tracks = READERS[path.suffix](path)
    lost = np.isnan(tracks)
    empty = np.flatnonzero(lost.all(axis=(1, 2)))
    if np.isinf(tracks).any():
        frame, marker, _ = np.argwhere(np.isinf(tracks))[0]
        problem = f"is infinite for marker {marker} in frame {frame}; write NaN where it is lost"
    elif (half_known := lost[..., 0] != lost[..., 1]).any():
        frame, marker = np.argwhere(half_known)[0]
        problem = f"has only one coordinate of marker {marker} in frame {frame}; correct it"
    elif len(empty):
        listed = ", ".join(map(str, empty[:MOST_MISSING_LISTED]))
        more = ", …" if len(empty) > MOST_MISSING_LISTED else ""
        problem = f"shows no marker in {len(empty)} frames ({listed}{more})"
        problem += "; track them again, or cut them off"
    else:
        return tracks
    raise fault(str(path), problem)


def _read_array(path: Path) -> Trajectories:
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC_PREFIX)) != MAGIC_PREFIX:
                raise fault(str(path), "is not an .npy array; save it with numpy.save")
        tracks = np.load(path, allow_pickle=False)
    except OSError as error:
        raise fault(str(path), f"cannot be read ({error.strerror}); check the path") from error
    except (ValueError, EOFError) as error:
        problem = f"is not a complete .npy array ({error}); save it with numpy.save"
        if "allow_pickle" in str(error):
            problem = "holds pickled objects, which may execute code; save a plain array of floats"
        raise fault(str(path), problem) from error
    if tracks.dtype.kind not in "fiu":
        raise fault(str(path), "holds no array of numbers; save one with numpy.save")
    if tracks.ndim != 3 or tracks.shape[2] != 2:
        problem = f"has the shape {tracks.shape}; give (frames, markers, 2), x and y in pixels"
        raise fault(str(path), problem)
    if not tracks.size:
        raise fault(str(path), f"is empty, of shape {tracks.shape}; track some markers")
    return tracks.astype(float)


def _read_rows(path: Path) -> Trajectories:
    """Rows may be in any order; a marker without a row in a frame is lost there."""
    table = _columns(path, ("frame", "marker", "x", "y"))
    frames, frame = np.unique(_integers(path, "frame", table), return_inverse=True)
    markers, marker = np.unique(_integers(path, "marker", table), return_inverse=True)
    if frames[0] > 1:
        problem = f"begins with frame {frames[0]}; number the frames from 0 or 1, the first in time"
        raise fault(f"{path}: column frame", problem)
    if len(gap := np.setdiff1d(np.arange(frames[0], frames[-1] + 1), frames)):
        raise fault(f"{path}: column frame", f"skips {gap[0]}; number the frames consecutively")
    if len(np.unique(np.stack([frame, marker], axis=1), axis=0)) < len(frame):
        raise fault(str(path), "has a marker twice in one frame; keep one row")
    tracks = np.full((len(frames), len(markers), 2), np.nan)
    tracks[frame, marker] = np.stack([table["x"], table["y"]], axis=1)
    return tracks


READERS = {".npy": _read_array, ".csv": _read_rows}


def _columns(path: Path, names: tuple[str, ...]) -> dict[str, Float[np.ndarray, " row"]]:
    example = f"write it as in '{','.join(names)}'"
    return read_columns(path, names, example, lambda header: header.strip().lower(), ("x", "y"))


def _integers(path: Path, name: str, table: dict[str, Float[np.ndarray, " row"]]) -> np.ndarray:
    values = table[name]
    bad = np.flatnonzero((values % 1 != 0) | (values < 0))
    if len(bad):
        problem = f"has {values[bad[0]]:g} at point {bad[0] + 1}; count from 0 up"
        raise fault(f"{path}: column {name}", problem)
    return values.astype(int)


def in_fabric_axes(tracks: Trajectories, table: MarkersTable) -> Trajectories:
    """Trajectories in pixels along the x and y of the fabric, by the description [mm]."""
    axes = np.array([IN_PICTURE[table.weft], IN_PICTURE[table.warp]])
    # In pixels y points down, so that an anticlockwise rotation has the opposite sense.
    rotation = _clockwise(np.radians(table.turned))
    return table.pixel.to("mm") * tracks @ (axes @ rotation.T).T


def _clockwise(angle: float) -> Float[np.ndarray, "2 2"]:
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def _grid_of(path: Path, first: Float[np.ndarray, "marker 2"], places: Path | None) -> MarkerGrid:
    """The grid of markers, found in the first frame of ``path`` or read from a table of places."""
    try:
        if places is None:
            return find_grid(first)
        table = _columns(places, ("marker", "row", "column"))
        marker, row, column = (_integers(places, name, table) for name in table)
        if marker.max() >= len(first):
            problem = f"names marker {marker.max()}, but there are {len(first)}, counted from 0"
            raise fault(f"{places}: column marker", problem)
        rows, columns = np.full((2, len(first)), -1)
        rows[marker], columns[marker] = row, column
        return grid_of_positions(rows, columns)
    except NoGrid as error:
        raise fault(str(places or path), str(error)) from error
