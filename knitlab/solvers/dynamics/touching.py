"""What may touch in a batch of fabrics, listed again when a motion may have used up its margins."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from knitlab.solvers.dynamics.contact import Contact
from knitlab.solvers.dynamics.contact_pairs import (
    Listed,
    PairFinder,
    Place,
    chunks_of,
    contact_of_batch,
)
from knitlab.solvers.dynamics.grid import Shape

COVERED = 0.8  # part of its margins that a motion may use of a list, if it gains no speed
SPARE = 0.05  # part of margins up to which pairs are evaluated beyond what a motion may use
OLD = 0.1  # part used of a list that is worth a new one
STEPS = 20  # for which a list has margins at least

OfCases = Float[np.ndarray, " case"]


@dataclass(frozen=True, eq=False)
class Touching:
    """The lists of pairs that may touch in a batch of fabrics, one for each."""

    finders: Sequence[PairFinder]
    listed: Sequence[Listed]
    contact: Contact
    now: OfCases  # part that each fabric has used of the margins of its list
    most: OfCases  # part up to which pairs are evaluated that come within reach

    @classmethod
    def at(cls, finders: Sequence[PairFinder], shape: Shape) -> "Touching":
        """List the pairs of all fabrics."""
        places = zip(finders, _places(shape), strict=True)
        listed = [finder.listed(place) for finder, place in places]
        none = np.zeros(len(listed))
        return cls(finders, listed, contact_of_batch(finders, listed), none, none + 1.0)

    def used(self, shape: Shape) -> OfCases:
        """Part of the margins of its list that each fabric uses; above 1 the list is incomplete."""
        fabrics = zip(self.finders, self.listed, _places(shape), strict=True)
        return np.array([finder.used(listed, place) for finder, listed, place in fabrics])

    def covering(
        self, shape: Shape, velocity: Shape, step: OfCases, count: Int[np.ndarray, " case"]
    ) -> tuple["Touching", Int[np.ndarray, " case"]]:
        """Lists for some coming steps [ms], and as many of these as they cover, at least one."""
        duration = step * count

        def moved(at: jax.Array, rate: jax.Array) -> jax.Array:
            return at + duration.reshape(-1, *[1] * (at.ndim - 1)) * rate

        ahead: Shape = jax.tree.map(moved, shape, velocity)
        lists, then = self, self.used(ahead)
        short = (then > COVERED) & (self.now > OLD)
        if short.any():
            fastest = np.max([np.abs(each).max(axis=(1, 2)) for each in velocity.positions], axis=0)
            lists = self._renewed(shape, short, 2 * STEPS * step * fastest)
            then = lists.used(ahead)
        part = np.clip((COVERED - lists.now) / np.maximum(then - lists.now, 1e-300), 0.0, 1.0)
        covered = np.where(count > 0, np.maximum(part * count, 1), 0).astype(int)
        expected = lists.now + np.maximum(then - lists.now, 0.0) * covered / np.maximum(count, 1)
        return lists._up_to(np.minimum(expected / COVERED + SPARE, 1.0)), covered

    def _up_to(self, most: OfCases) -> "Touching":
        """The same, with as many pairs as can be within reach up to a used part of margins."""
        first = [each.within(part) for each, part in zip(self.listed, most, strict=True)]
        contact = replace(self.contact, chunks=chunks_of(first))
        return replace(self, contact=contact, most=most)

    def _renewed(
        self, shape: Shape, which: Bool[np.ndarray, " case"], margins: OfCases
    ) -> "Touching":
        """The same with new lists of some fabrics, which have at least these margins [mm]."""
        fabrics = zip(self.finders, self.listed, which, _places(shape), margins, strict=True)
        listed = [
            finder.listed(place, old, margin) if new else old
            for finder, old, new, place, margin in fabrics
        ]
        contact = contact_of_batch(self.finders, listed)
        now = np.where(which, 0.0, self.now)
        return replace(self, listed=listed, contact=contact, now=now)


def _places(shape: Shape) -> list[Place]:
    """Where the nodes of every fabric of a batch are."""
    positions = np.stack([np.asarray(each) for each in shape.positions], axis=-1)
    flat = positions.reshape(len(positions), -1, 3)
    return [Place(*place) for place in zip(flat, np.asarray(shape.lengths), strict=True)]
