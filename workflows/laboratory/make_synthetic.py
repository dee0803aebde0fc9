"""Make the synthetic experiment of the tutorial from a simulated case.

``python workflows/laboratory/make_synthetic.py RESULTS/laboratory``: the results of the workflow
``laboratory``, run with the stripes of :data:`STRIPES`. They are not those of the tables, so that
there is something to fit.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from scipy.interpolate import PchipInterpolator

from knitlab.cubes.case_file import configurations, read_case
from knitlab.cubes.cube_file import open_cube
from knitlab.model.cell_grid import CellGrid
from knitlab.model.network import MeshShape
from knitlab.observables.unit_cells import unit_cell_corners

Corners = Float[np.ndarray, "state row column 2"]


@dataclass(frozen=True)
class Camera:
    """A camera above a sample, with the noise of its tracking.

    Attributes:
        pixel: size of a pixel on the fabric [mm].
        turn: rotation of the fabric in the picture, anticlockwise [rad].
        centre: pixel at the middle of the relaxed fabric, x to the right and y up, as
            tracking-markers counts it.
        noise: standard deviation of a tracked coordinate [pixel].
    """

    pixel: float
    turn: float
    centre: tuple[float, float]
    noise: float

    def sees(
        self, points: Float[np.ndarray, "*any 2"], random: np.random.Generator
    ) -> Float[np.ndarray, "*any 2"]:
        """Points along weft and warp, relative to the middle [mm], as tracked in pixels."""
        cosine, sine = np.cos(self.turn), np.sin(self.turn)
        turned = points @ np.array([[cosine, sine], [-sine, cosine]])
        return turned / self.pixel + self.centre + random.normal(0, self.noise, points.shape)


@dataclass(frozen=True)
class Protocol:
    """Cycles of loading and unloading at one speed.

    Attributes:
        strain_rate: strain rate of the machine [1/s].
        cycles: number of cycles.
        rest: time before the first pull [s].
    """

    strain_rate: float
    cycles: int
    rest: float

    def duration(self, strain_max: float) -> float:
        """Duration of the whole test [s]."""
        return self.rest + 2 * self.cycles * strain_max / self.strain_rate

    def strain(
        self, time: Float[np.ndarray, " record"], strain_max: float
    ) -> Float[np.ndarray, " record"]:
        """Applied strain at times [1]."""
        pull = strain_max / self.strain_rate
        within = np.mod(np.clip(time - self.rest, 0, None), 2 * pull)
        within = np.where(time >= self.duration(strain_max), 0.0, within)
        return self.strain_rate * np.minimum(within, 2 * pull - within)


def along_test(
    strain: Float[np.ndarray, " record"],
    strains: Float[np.ndarray, " state"],
    states: Float[np.ndarray, "state *any"],
) -> Float[np.ndarray, "record *any"]:
    """States at ascending strains, at the strains of a record, by monotone cubic interpolation."""
    return np.asarray(PchipInterpolator(strains, states)(strain))


def tracked(
    corners: Corners,
    camera: Camera,
    order: Int[np.ndarray, " marker"],
    random: np.random.Generator,
) -> Float[np.ndarray, "frame marker 2"]:
    """Corners of unit cells [mm] as tracked in the pictures of a camera, in pixels.

    ``order`` is the corner of every marker, counted row by row; other corners have no marker.
    """
    points = corners.reshape(len(corners), -1, 2)
    return camera.sees(points - points[0].mean(axis=0), random)[:, order]


def with_losses(
    tracks: Float[np.ndarray, "frame marker 2"],
    losses: float,
    longest: int,
    random: np.random.Generator,
) -> Float[np.ndarray, "frame marker 2"]:
    """Tracks of which some are lost for up to ``longest`` frames, never in the first frame.

    There are ``losses`` per marker on average.
    """
    seen = tracks.copy()
    frames, markers, _ = tracks.shape
    for _ in range(random.poisson(losses * markers)):
        marker, start = random.integers(markers), random.integers(1, frames)
        seen[start : start + random.integers(1, longest + 1), marker] = np.nan
    return seen


STRIPES = {
    "rib_k_s_factor": 0.85,
    "rib_k_t_factor": 1.2,
    "rib_theta_0_factor": 1.1,
    "garter_k_s_factor": 1.15,
    "garter_k_t_factor": 0.85,
    "garter_theta_0_factor": 0.92,
}
SEED = 20261122
UNIT_CELLS = (5, 3)
CAMERA = Camera(pixel=0.05, turn=np.radians(6.0), centre=(700.0, 900.0), noise=0.25)
TEST = Protocol(strain_rate=0.004, cycles=2, rest=5.0)
FRAME_RATE = 2.0
MACHINE_RATE = 4.0
METER_RATE = 5.0
METER_STARTS = -2.3
"""The machine's time at which the meter's clock was 0 [s]."""
FORCE_NOISE = 0.004
CAPACITANCE_NOISE = 0.002
STRAY = 0.35
"""Capacitance of the leads [pF]."""
NO_MARKER = (3, 17)
"""Corners, row after row, that bear no marker."""
NAME = "synthetic_4_16"
HEADING = "# Synthetic: made by workflows/laboratory/make_synthetic.py, not measured.\n"


def main(results: Path, folder: Path) -> None:
    """Write markers and both logs into a folder."""
    random = np.random.default_rng(SEED)
    cube = open_cube(results).sel(n_stripe=4, n_subunit=16)
    case = read_case(results, str(cube["case_id"].item()))
    shape = MeshShape(case.sizes["node_y"] - 1, case.sizes["node_x"] - 1, periodic=False)
    rows, columns = (
        tuple(range(0, cells + 1, cells // count))
        for cells, count in zip((shape.cells_y, shape.cells_x), UNIT_CELLS, strict=True)
    )
    corners = unit_cell_corners(shape, CellGrid(rows, columns), configurations(case))
    strains = case["applied_strain"].values
    end, length = strains[-1], float(np.ptp(corners[0, [0, -1], :, 1].mean(axis=1)))
    width = float(np.ptp(corners[0, :, [0, -1], 0].mean(axis=1)))
    duration = TEST.duration(end)

    strain = TEST.strain(np.arange(0, duration, 1 / FRAME_RATE), end)
    order = random.permutation(np.setdiff1d(np.arange(corners[0, ..., 0].size), NO_MARKER))
    tracks = tracked(along_test(strain, strains, np.asarray(corners)), CAMERA, order, random)
    tracks = with_losses(tracks, losses=1.0, longest=12, random=random)
    np.save(folder / f"{NAME}_markers.npy", tracks.astype(np.float32))

    time = np.arange(0, duration, 1 / MACHINE_RATE)
    strain = TEST.strain(time, end)
    force = along_test(strain, strains, case["reaction_force"].values)
    machine = {
        "Time (s)": time.round(3),
        "Extension (mm)": (strain * length).round(4),
        "Load (N)": (force + random.normal(0, FORCE_NOISE, len(time))).round(5),
        "Trigger (V)": np.where(time < TEST.rest, 0, 5),
    }
    _write(folder / f"{NAME}_tensile.csv", machine)

    time = np.arange(0, duration, 1 / METER_RATE)
    strain = TEST.strain(time + METER_STARTS, end)
    between = along_test(strain, strains, case["capacitance_wedge"].values)
    meter = {
        "t (s)": time.round(3),
        "Cp (pF)": (between + STRAY + random.normal(0, CAPACITANCE_NOISE, len(time))).round(5),
        "TRIG": np.where(time + METER_STARTS < TEST.rest, 0, 1),
    }
    _write(folder / f"{NAME}_capacitance.csv", meter)
    print(f"relaxed length {length:.2f} mm, width {width:.2f} mm")


def _write(path: Path, columns: dict[str, np.ndarray]) -> None:
    table = pd.DataFrame(columns).to_csv(index=False, lineterminator="\n")
    path.write_text(HEADING + table, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(__file__).parent)
