"""Lists of the pairs of parts that may touch, in two stages: soon, and in the coming steps.

Whatever may come within reach in a while takes long to find, and is listed once for many steps. Few
of these pairs touch. Before some steps, those are chosen that may meet at the present velocities,
and only they act. If the motion then shows that others may have met, the steps are taken back, and
fewer are tried.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from knitlab.model.contact_layers import ContactLayers
from knitlab.solvers.dynamics.closest_points import Kind
from knitlab.solvers.dynamics.contact_cells import Place
from knitlab.solvers.dynamics.contact_pairs import Listed, PairFinder, Parts, approaches
from knitlab.solvers.dynamics.contact_potential import Contact, PairList, chunk_size
from knitlab.solvers.dynamics.grid import Shape

COVERED = 0.8  # part of its margins that a motion may use of a list, if it gains no speed
AWAKE = 0.05  # distance beyond that up to which pairs act, over a cell side
OLD = 0.1  # part used of a list that is worth a new one
STEPS = 60  # for which a list has margins at least
PLACES = 1  # of a list of pairs that act at least, for each node

OfCases = Float[np.ndarray, " case"]


@dataclass(frozen=True, eq=False)
class Watch:
    """Listed pairs that are looked at before and after some steps."""

    before: Place  # where the steps begin
    parts: dict[Kind, Parts]
    slack: dict[Kind, Float[np.ndarray, " pair"]]
    """By how much they may approach before they touch unseen [mm]; infinite for those that act."""

    def used(self, place: Place) -> float:
        """Largest part of their slack by which pairs may have approached on the way to a place."""
        nearer = approaches(self.parts, _motion(self.before, place))
        parts = (nearer[kind] / slack for kind, slack in self.slack.items())
        return max(float(np.max(part, initial=0.0)) for part in parts)


@dataclass(frozen=True, eq=False)
class ContactLists:
    """The lists of pairs that may touch in a batch of fabrics, one for each."""

    finders: Sequence[PairFinder]
    listed: Sequence[Listed]
    contact: Contact  # pairs that act in the coming steps
    now: OfCases  # part that each fabric has used of the margins of its list
    watches: Sequence[Watch]  # over each fabric in the coming steps

    @classmethod
    def at(cls, finders: Sequence[PairFinder], shape: Shape) -> "ContactLists":
        """List the pairs of all fabrics, of which those within reach act."""
        listed = [
            finder.listed(place) for finder, place in zip(finders, _places(shape), strict=True)
        ]
        touching = [
            {kind: parts.some(np.flatnonzero(parts.gap <= 0)) for kind, parts in each.parts.items()}
            for each in listed
        ]
        contact = batch_contact(finders, touching)
        return cls(finders, listed, contact, np.zeros(len(listed)), [])

    def missed(self, shape: Shape) -> tuple["ContactLists", Bool[np.ndarray, " case"]]:
        """The lists after some steps, and whether pairs that do not act may have touched."""
        places = _places(shape)
        now = self._used(places)
        unseen = [watch.used(place) > 1 for watch, place in zip(self.watches, places, strict=True)]
        return replace(self, now=now), (now > 1) | unseen

    def covering(
        self, shape: Shape, velocity: Shape, step: OfCases, count: Int[np.ndarray, " case"]
    ) -> tuple["ContactLists", Int[np.ndarray, " case"]]:
        """Lists for some coming steps [ms], and as many of these as they cover, at least one."""
        places, rates = _places(shape), _places(velocity)

        def ahead(steps: Int[np.ndarray, " case"]) -> list[Place]:
            return [
                Place(at.positions + time * rate.positions, at.lengths + time * rate.lengths)
                for at, rate, time in zip(places, rates, steps * step, strict=True)
            ]

        lists = self
        then = self._used(ahead(count))
        short = (then > COVERED) & (self.now > OLD)
        if short.any():
            fastest = np.array([np.abs(each.positions).max() for each in rates])
            lists = self._renewed(places, short, 2 * STEPS * step * fastest)
            then = lists._used(ahead(count))
        part = np.clip((COVERED - lists.now) / np.maximum(then - lists.now, 1e-300), 0.0, 1.0)
        covered = np.where(count > 0, np.maximum(part * count, 1), 0).astype(int)
        acting, watches = [], []
        for each in zip(lists.finders, lists.listed, places, ahead(covered), strict=True):
            act, watch = _chosen(*each)
            acting.append(act)
            watches.append(watch)
        contact = batch_contact(lists.finders, acting)
        return replace(lists, contact=contact, watches=watches), covered

    def _used(self, places: Sequence[Place]) -> OfCases:
        """Part of the margins of its list that each fabric uses; above 1 the list is incomplete."""
        fabrics = zip(self.finders, self.listed, places, strict=True)
        return np.array([finder.used(listed, place) for finder, listed, place in fabrics])

    def _renewed(
        self, places: Sequence[Place], which: Bool[np.ndarray, " case"], margins: OfCases
    ) -> "ContactLists":
        """The same with new lists of some fabrics, of at least these margins [mm]."""
        fabrics = zip(self.finders, self.listed, which, places, margins, strict=True)
        listed = [
            finder.listed(place, old, margin) if new else old
            for finder, old, new, place, margin in fabrics
        ]
        return replace(self, listed=listed, now=np.where(which, 0.0, self.now))


def _chosen(
    finder: PairFinder, listed: Listed, before: Place, ahead: Place
) -> tuple[dict[Kind, Parts], Watch]:
    """The pairs that may touch on the way from one place to another, and a watch over the rest."""
    gaps = finder.gaps(listed.parts, before)
    nearer = approaches(listed.parts, _motion(before, ahead))
    act = {}
    slack = {}
    for kind, gap in gaps.items():
        may_touch = gap <= nearer[kind] / COVERED + AWAKE * finder.layers.cell
        # The nearest first, so that those that touch are together in few chunks.
        nearest = np.argsort(np.where(may_touch, gap, np.inf))
        act[kind] = listed.parts[kind].some(nearest[: np.count_nonzero(may_touch)])
        slack[kind] = np.where(may_touch, np.inf, gap)
    return act, Watch(before, listed.parts, slack)


def _motion(before: Place, after: Place) -> Place:
    return Place(after.positions - before.positions, after.lengths - before.lengths)


def _places(shape: Shape) -> list[Place]:
    positions = np.stack([np.asarray(each) for each in shape.positions], axis=-1)
    flat = positions.reshape(len(positions), -1, 3)
    return [Place(*place) for place in zip(flat, np.asarray(shape.lengths), strict=True)]


def batch_contact(finders: Sequence[PairFinder], acting: Sequence[dict[Kind, Parts]]) -> Contact:
    """The contact of a batch of fabrics of one mesh shape, in lists of one length."""
    shape = finders[0].shape
    lists: dict[Kind, PairList] = {}
    counts: dict[Kind, Int[Array, ""]] = {}
    # Few lengths, so that few programs are compiled.
    places = 2 ** int(np.ceil(np.log2(max(PLACES * shape.nodes, chunk_size()))))
    while places < max(pairs.gap.size for each in acting for pairs in each.values()):
        places *= 4
    for kind in acting[0]:
        each = [
            _pair_list(finder.layers, pairs[kind], places)
            for finder, pairs in zip(finders, acting, strict=True)
        ]
        lists[kind] = jax.tree.map(lambda *leaves: jnp.stack(leaves), *each)
        longest = max(pairs[kind].gap.size for pairs in acting)
        counts[kind] = jnp.asarray(-(-longest // chunk_size()))
    return Contact(lists, counts, shape.periodic)


def _pair_list(layers: ContactLayers, parts: Parts, places: int) -> PairList:
    spare = places - parts.gap.size
    spare_corners = np.tile([[0], [1], [0], [1]], spare)  # an edge with itself, of some length

    def layer_values(name: str, spare_value: float = 0.0) -> Float[np.ndarray, " place"]:
        values = np.where(parts.near, getattr(layers.near, name), getattr(layers.far, name))
        return np.pad(values, (0, spare), constant_values=spare_value)

    columns = (
        np.concatenate([parts.nodes, spare_corners], axis=1).astype(np.int32),
        np.pad(parts.turns, ((0, 0), (0, 0), (0, spare))),
        layer_values("least") ** 2,
        layer_values("range_squared", -1.0),
        layer_values("strength"),
        np.pad(parts.parallel, (0, spare), constant_values=1.0),
    )
    return PairList(*map(jnp.asarray, columns))
