"""Cross-talk: what each of several sensors reads while only one part of the fabric is pulled.

Two lines of nodes, at the sides of the part, are pulled apart, as by clamps that hold it there; all
other nodes follow. The response is that of the relaxed equilibrium to small forces.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np
import xarray as xr
from jaxtyping import Float

from knitlab.model.electrodes import Capacitor, Strip
from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape
from knitlab.sensors.electrode_set import ElectrodeSet
from knitlab.sensors.readings import Others, capacitance_matrices, readings
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.adjoint import LinearResponse
from knitlab.solvers.loads.loading import all_free

STEP = 1e-3  # mean strain of the part that is pulled


def cross_talk(
    case: Case,
    relaxed: Configuration,
    electrodes: ElectrodeSet,
    sensors: Sequence[tuple[int, int]],
    capacitor: Capacitor,
    axis: int,
    others: Others,
    polarised: float = 0.0,
) -> xr.Dataset:
    """The cross-talk of sensors that are pulled along an axis one by one; or NoDerivative."""
    shape = electrodes.shape
    free = all_free(shape)
    start = np.asarray(relaxed.flattened())
    parts = [sensor_part(electrodes, pair) for pair in sensors]
    ends = [[_line(shape, axis, part, end) for end in (0, 1)] for part in parts]
    forces = np.array([high - low for low, high in ends])
    moves = LinearResponse(shape, free).at(case.assemble()[1], start, case.contact).to(forces)
    # Of lines that are pulled apart, the force on nodes is also the measure of the elongation.
    strains = (moves @ forces.T) / (forces @ start)
    moves /= np.diag(strains)[:, None]
    signs = [start, *(start + sign * STEP * move for move in moves for sign in (1, -1))]
    states = Configuration.stacked([Configuration.of(each, shape) for each in signs])
    matrices = capacitance_matrices(electrodes, states, capacitor, polarised)
    found = readings(matrices, sensors, others)
    slopes = np.log(found[1::2] / found[2::2]).T / (2 * STEP)
    coupling = np.eye(len(sensors))
    for i, j in product(range(len(sensors)), repeat=2):
        if i != j:
            pairs = [(a, b) for a in sensors[i] for b in sensors[j] if a != b]
            largest = max(-float(matrices[0, a, b]) for a, b in pairs)
            coupling[i, j] = largest / found[0, i]
    relative = slopes / np.diag(slopes)[:, None], (strains / np.diag(strains)[:, None]).T
    variables = {
        "gauge_factor": (slopes, "change of ln C by the strain of the pulled part"),
        "cross_talk": (relative[0], "reading over that of its own strain"),
        "strain": (relative[1], "strain over that of the pulled part"),
        "coupling": (coupling, "largest capacitance between sensors over the reading"),
    }
    return xr.Dataset(
        {"reading": ("sensor", found[0], {"units": "pF", "long_name": "reading"})}
        | {
            name: (("sensor", "pulled"), values, {"units": "1", "long_name": meaning})
            for name, (values, meaning) in variables.items()
        }
    )


def sensor_part(electrodes: ElectrodeSet, pair: tuple[int, int]) -> Strip:
    """The part of the fabric that a sensor covers: where its electrodes cross, or both of them."""
    groups = [electrodes.groups[number] for number in pair]
    strips = [strip for group in groups for strip in group]
    if electrodes.overlapping(*pair):
        shared = (one.shared(other) for one, other in product(*groups))
        strips = [strip for strip in shared if strip is not None and strip.area > 0]
    left, bottom = (min(strip.extents[axis][0] for strip in strips) for axis in (0, 1))
    right, top = (max(strip.extents[axis][1] for strip in strips) for axis in (0, 1))
    lines = np.floor(left), np.ceil(right), np.floor(bottom), np.ceil(top)
    return Strip(*map(float, lines))


def _line(shape: MeshShape, axis: int, part: Strip, end: int) -> Float[np.ndarray, " unknown"]:
    """Weights of the unknowns in the mean position along an axis of a line of nodes."""
    weights = np.zeros(shape.unknowns)
    cells = (shape.cells_x, shape.cells_y) if shape.periodic else (np.inf, np.inf)
    across = np.arange(part.extents[1 - axis][0], part.extents[1 - axis][1] + 1)
    if shape.periodic:
        across = np.unique(across % cells[1 - axis])
    turns, line = divmod(part.extents[axis][end], cells[axis])
    row, column = (across, line) if axis == 0 else (line, across)
    node = (np.asarray(row) * shape.nodes_x + column).astype(int)
    weights[3 * node + axis] = 1 / len(across)
    if shape.periodic:
        weights[3 * shape.nodes + axis] = turns
    return weights
