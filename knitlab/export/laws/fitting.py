"""Fitting a law to tests: weights of ridges by least squares that are not negative.

The ridges are laid out evenly over directions and offsets; the best weights are unique in what they
predict, most of them are 0, and there is nothing to tune.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls, root

from knitlab.export.laws.ridge_law import RidgeLaw, Ridges
from knitlab.export.laws.strain_tests import StrainTest, axes_at, strain_of

DIRECTIONS, RINGS = 36, 4  # in the plane of the normal strains; from there to the shear
OFFSETS = 31  # from minus the largest strain of all tests to it, closer near 0
SHARPNESS = 100.0  # the largest strain over the width of a ramp
FLOOR = 0.05  # of the largest stress or energy of a test, below which errors count as absolute


def ridges_over(largest: float) -> Ridges:
    """Ridges in all directions, up to a largest strain."""
    directions = list[tuple[float, float, float]]()
    for height in np.linspace(0, math.pi / 2, RINGS + 1):
        radius = math.cos(height)
        count = max(round(DIRECTIONS * radius), 1)
        for around in 2 * math.pi * np.arange(count) / count:
            place = radius * math.cos(around), radius * math.sin(around), math.sin(height)
            directions.append(place)
    every = np.array(directions)
    even = np.linspace(-1, 1, OFFSETS)
    offsets = np.tile(largest * np.sign(even) * even**2, len(every))
    return Ridges(np.repeat(every, OFFSETS, axis=0), offsets, largest / SHARPNESS)


def fitted(
    tests: Sequence[StrainTest],
    mirrored: bool = True,
    stiffness: Float[np.ndarray, "3 3"] | None = None,
) -> RidgeLaw:
    """The law that comes closest to stresses and energies of tests, and to a stiffness at rest."""
    largest = max(float(np.abs(test.strain).max()) for test in tests)
    ridges = ridges_over(largest)
    twins = ridges.mirrored()

    def both(part: Callable[[Ridges], np.ndarray]) -> np.ndarray:
        """What each ridge of weight 1 gives, with its twin."""
        return part(ridges) + part(twins) if mirrored else part(ridges)

    rows, wanted = list[np.ndarray](), list[np.ndarray]()
    for test in tests:
        strain, stress, energy = test.strain[1:], test.stress[1:], test.energy[1:]
        strength = np.linalg.norm(stress, axis=-1)
        scale = 1 / np.maximum(strength, FLOOR * strength.max())
        rows.append(both(partial(Ridges.stresses, strain=strain)) * scale[:, None, None])
        wanted.append(stress * scale[:, None])
        scale = 1 / np.maximum(energy, FLOOR * energy.max())
        rows.append(both(partial(Ridges.energies, strain=strain)) * scale[:, None])
        wanted.append(energy * scale)
    if stiffness is not None:
        scale = len(tests) / np.linalg.norm(stiffness)
        rows.append(scale * both(partial(Ridges.tangents, strain=np.zeros(3))))
        wanted.append(scale * stiffness)
    matrix = np.concatenate([each.reshape(-1, len(ridges.offsets)) for each in rows])
    norms = np.linalg.norm(matrix, axis=0)
    vector = np.concatenate([each.ravel() for each in wanted])
    weights = nnls(matrix / norms, vector, maxiter=100 * len(norms))[0] / norms
    used = weights > 0
    chosen = Ridges(ridges.directions[used], ridges.offsets[used], ridges.width)
    if not mirrored:
        return RidgeLaw(chosen, weights[used])
    pair = chosen, chosen.mirrored()
    directions = np.concatenate([each.directions for each in pair])
    offsets = np.concatenate([each.offsets for each in pair])
    return RidgeLaw(Ridges(directions, offsets, ridges.width), np.tile(weights[used], 2))


def predicted(law: RidgeLaw, test: StrainTest) -> tuple[np.ndarray, np.ndarray]:
    """The stretches and forces of a test by a law, in the axes of the test."""
    free = [part for part in range(3) if part not in test.prescribed]
    now, stretches, forces = np.array([1.0, 1.0, 0.0]), [], []
    for reached in test.stretch:
        now = now.copy()
        now[[*test.prescribed]] = reached[[*test.prescribed]]
        if free:
            now[free] = root(_free_forces, now[free], (law, test.angle, now, free), tol=1e-12).x
        stretches.append(now)
        forces.append(_forces(law, now, test.angle))
    return np.array(stretches), np.array(forces)


def _free_forces(
    values: np.ndarray, law: RidgeLaw, angle: float, stretch: np.ndarray, free: list[int]
) -> np.ndarray:
    tried = stretch.copy()
    tried[free] = values
    return _forces(law, tried, angle)[free]


def _forces(law: RidgeLaw, stretch: np.ndarray, angle: float) -> np.ndarray:
    """Derivative of the energy by a, b and c."""
    xx, yy, xy = law.stress(strain_of(stretch, angle))
    axes = axes_at(angle)
    (s_11, s_12), (_, s_22) = axes.T @ np.array([[xx, xy], [xy, yy]]) @ axes
    a, b, c = stretch
    return np.array([s_11 * a + s_12 * c, s_22 * b, s_12 * a + s_22 * c])
