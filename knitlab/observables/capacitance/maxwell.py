"""Maxwell's capacitance matrix of electrodes that are divided into panels: charge i is Σ C_ij V_j.

Everything that computes a capacitance by boundary elements goes through here: what surrounds the
electrodes, batches of states, cloth that polarises, and the extrapolation from two panel sizes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from knitlab.io.progress import each
from knitlab.model.electrodes import Capacitor
from knitlab.model.fabric import Configuration
from knitlab.model.surfaces import gap_between
from knitlab.observables.capacitance import boundary_elements as bem

STATES_AT_ONCE = 4  # states that are computed together
ORDER = 2  # order of convergence of the capacitance with the size of graded panels
LEVELS = (1, 2)  # sizes of panels from which a value is extrapolated without an error estimate
Panels = Float[np.ndarray, "state panel 4 3"]
Matrices = Float[np.ndarray, "state electrode electrode"]


@dataclass(frozen=True)
class Surroundings:
    """What surrounds panels: their images along an axis, a grounded plane, an insulation."""

    axis: int | None = None
    period: Float[np.ndarray, " state"] | None = None  # [mm]
    ground: Float[np.ndarray, " state"] | None = None  # height of a grounded plane [mm]
    insulation: float = 0.0  # thickness of what insulates electrodes from each other [mm]
    polarised: float = 0.0  # (relative permittivity of the cloth - 1) times its thickness [mm]

    @property
    def periods(self) -> Float[np.ndarray, "3 state"] | Float[np.ndarray, "3 1"]:
        """Periods along x, y and z; 0 where nothing repeats [mm]."""
        if self.axis is None or self.period is None:
            return np.zeros((3, 1))
        return np.eye(3)[self.axis][:, None] * self.period


def surroundings(
    states: Configuration, axis: int | None, capacitor: Capacitor, polarised: float = 0.0
) -> Surroundings:
    """What surrounds the electrodes of a fabric in several states; ``axis`` None on a sample."""
    period = None if axis is None else np.asarray(states.lengths)[:, axis]
    ground = None
    if capacitor.ground == "plane":
        lowest = np.asarray(states.positions)[..., 2].min(axis=(1, 2))
        ground = lowest - capacitor.ground_distance
    return Surroundings(axis, period, ground, capacitor.dielectric_thickness, polarised)


def maxwell_matrices(
    panels: Panels,
    electrode: Int[np.ndarray, " panel"],
    count: int,
    around: Surroundings,
    batch_size: int | None = None,
) -> Matrices:
    """Maxwell's matrices in vacuum of ``count`` electrodes [pF], of one period if periodic.

    Panels whose ``electrode`` is ``count`` are cloth without an electrode: a field E along the
    cloth polarises it by ε0 ``polarised`` E over its width. Without a plane, potentials of periodic
    electrodes are relative to an arbitrary reference; see :func:`neutral`.
    """
    images = None
    if around.axis is not None and around.period is not None:
        images = bem.images_along(around.axis, panels, around.period, around.ground)
    near = bem.near_pairs(panels, images, around.period)
    member = np.eye(count + 1)[electrode][:, :count]
    unknown = np.eye(len(electrode)) if around.polarised else member
    size = batch_size or math.ceil(len(panels) / math.ceil(len(panels) / STATES_AT_ONCE))
    batches = []
    for first in each(range(0, len(panels), size), "states"):
        # The last batch is padded, as a smaller one would be compiled separately.
        batch = np.minimum(np.arange(first, first + size), len(panels) - 1)
        given = (None if one is None else one[batch] for one in (around.period, around.ground))
        period, ground = (None if one is None else jnp.asarray(one) for one in given)
        matrices = bem.maxwell_matrices(
            *map(jnp.asarray, (panels[batch], unknown, near)),
            images,
            period,
            around.insulation,
            ground,
        )
        batches.append(np.asarray(matrices))
    whole = np.concatenate(batches)[: len(panels)]
    if around.polarised:
        periods = np.broadcast_to(around.periods.T, (len(panels), 3))
        states = zip(whole, panels, periods, strict=True)
        whole = np.array([_with_cloth(*state, member, around.polarised) for state in states])
    return whole


def neutral(matrices: Matrices) -> Matrices:
    """Matrices of charges that sum to zero: those of periodic electrodes without a plane."""
    charges = matrices.sum(axis=2)
    total = charges.sum(axis=1)[:, None, None]
    return matrices - charges[:, :, None] * charges[:, None, :] / total


def _with_cloth(
    inverse: Float[np.ndarray, "panel panel"],
    panels: Float[np.ndarray, "panel 4 3"],
    period: Float[np.ndarray, "3"],
    member: Float[np.ndarray, "panel electrode"],
    polarised: float,
) -> Float[np.ndarray, "electrode electrode"]:
    """The matrix on polarised cloth, from the inverse of the potentials of all panels in air."""
    following = np.roll(panels, -1, axis=1)
    middles = (panels + following) / 2
    lengths = np.linalg.norm(following - panels, axis=-1)
    reach = np.linalg.norm(middles - panels.mean(axis=1)[:, None], axis=-1)
    points = middles.reshape(-1, 3)
    count = middles.size // 3
    images = [points, points + period] if period.any() else [points]
    # Panels are neighbours where the middles of two sides are one point.
    pairs = cKDTree(np.concatenate(images)).query_pairs(1e-6 * lengths.max(), output_type="ndarray")
    one, other = (pairs[(pairs < count).any(axis=1)] % count).T
    bare = member.sum(axis=1) == 0
    # Up to the edge an electrode has one potential.
    distance = (reach * bare[:, None]).ravel()
    distance = distance[one] + distance[other]
    between = distance > 0
    flow = lengths.ravel()[one][between] / distance[between]
    one = one[between] // 4
    other = other[between] // 4
    sheet = np.zeros_like(inverse)
    for rows, columns in ((one, other), (other, one)):
        np.add.at(sheet, (rows, columns), -flow)
        np.add.at(sheet, (rows, rows), flow)
    stiff = inverse + bem.VACUUM_PERMITTIVITY * polarised * sheet
    fixed = stiff @ member
    free = np.linalg.solve(stiff[np.ix_(bare, bare)], fixed[bare])
    return np.asarray(member.T @ fixed - fixed[bare].T @ free)


def limit(
    coarse: np.ndarray, fine: np.ndarray, coarse_level: int = LEVELS[0], level: int = LEVELS[1]
) -> np.ndarray:
    """The limit of ever finer panels, from values at two levels (Richardson extrapolation)."""
    gain = 1 / ((level / coarse_level) ** ORDER - 1)
    return fine + gain * (fine - coarse)


def extrapolated(solve: Callable[[int], np.ndarray]) -> np.ndarray:
    """The :func:`limit` of what ``solve`` computes at a level."""
    coarse, fine = map(solve, LEVELS)
    return limit(coarse, fine)


def gaps(
    panels: Panels,
    electrode: Int[np.ndarray, " panel"],
    pair: tuple[int, int],
    reach: float,
    around: Surroundings,
) -> Float[np.ndarray, " state"]:
    """Distance of two electrodes in every state, 0 if they cross and at most ``reach`` [mm]."""
    periods = np.broadcast_to(around.periods[:2].T, (len(panels), 2))
    one, other = (panels[:, electrode == number] for number in pair)
    states = zip(one, other, periods, strict=True)
    return np.array([gap_between(a, b, reach, (x, y)) for a, b, (x, y) in states])


def touching(distance: Float[np.ndarray, " state"], capacitor: Capacitor) -> np.ndarray:
    """Whether electrodes at a distance are in contact: bare ones within the clearance."""
    if capacitor.dielectric_thickness:
        return distance == 0
    return distance < capacitor.clearance
