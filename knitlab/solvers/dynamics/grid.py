"""The fabric as a structured grid: its energy and forces by shifted arrays, without index lists.

The network of :mod:`knitlab.model.network` is regular: differences between nodes are those of two
slices, and a force is gathered from slices too. Equilibria use the same energy element by element
(:mod:`knitlab.solvers.element_chunks`), with one program for all mesh shapes; a motion has
thousands of steps of one shape, so that a program for each pays off.

Periodic fabric is extended by the image of its first row and column of nodes, so that both kinds of
fabric have one more line of nodes than of cells. What lies on the images counts once.
"""

from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.model.energy import Energy
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape
from knitlab.model.settings import FoldAngle
from knitlab.model.spring_law import SpringLaw
from knitlab.solvers.dynamics.vectors import (
    Component,
    Vector,
    add,
    arctan2,
    cross,
    dot,
    materialised,
    norm,
    scale,
    subtract,
)

ALL = slice(None)
INNER = slice(1, -1)
BEFORE = slice(None, -1)
AFTER = slice(1, None)

Lines = Float[Array, "_ _"]  # on some lines of the grid, whose number differs
OnLines = tuple[Lines, Lines, Lines]


class Shape(NamedTuple):
    """Configuration of a fabric on the grid, its velocity, or a gradient with respect to it."""

    positions: Vector  # components of the position of every node [mm]
    lengths: Float[Array, "2"]  # L_x and L_y of periodic fabric; without effect on a sample [mm]


class Surroundings(NamedTuple):
    """What forces depend on, also on lines around the fabric."""

    edges: tuple[OnLines, ...]  # along the weft, along the warp, and along both diagonals [mm]
    lengths: tuple[Lines, ...]  # of the edges [mm]
    normals: OnLines  # of the cells, cross products of their diagonals [mm²]


class Springs(eqx.Module):
    """Springs of one direction; those beyond an edge or on an image of a line have no stiffness."""

    stiffness: Float[Array, "row column"]
    rest_length: Float[Array, "row column"]
    law: SpringLaw

    def energy(self, along: Vector) -> Float[Array, ""]:
        """Energy of all springs, given the vectors along them [N mm]."""
        return jnp.sum(self.stiffness * self.law.stored(norm(along), self.rest_length))

    def gradient(self, along: Vector, length: Component) -> Vector:
        """Derivative of the energy with respect to the vectors along them [N]."""
        pull_over_length = self.law.pull_over_length(length, self.rest_length)
        return scale(self.stiffness * pull_over_length, along)


class Hinges(eqx.Module):
    """Hinges about the edges of one direction, on every line of the grid across it."""

    stiffness: Float[Array, "row column"]  # k_t, 0 at an open edge and beyond it [N mm]
    rest: Float[Array, "row column"]  # signed fold angle at rest [rad]
    of: FoldAngle = eqx.field(static=True)  # definition of the fold angle, a model option

    def energy(self, edge: Vector, before: Vector, after: Vector) -> Component:
        """Energy of every hinge [N mm], from edges [mm] and normals of cells [mm²]."""
        angle = self._from_rest(*self._sine_and_cosine(edge, norm(edge), before, after))
        return 0.5 * self.stiffness * angle**2

    def turned(
        self, edge: Vector, length: Component, before: Vector, after: Vector
    ) -> tuple[Component, ...]:
        """Numbers of every hinge that the derivatives of its energy share.

        With whole normals: the derivatives by sine and by cosine, and the sine, the first and the
        last over the length of the edge. Across the edge: the moment over the square of each
        normal, and the component of each along the edge, all over the length of the edge.
        """
        sine, cosine = self._sine_and_cosine(edge, length, before, after)
        moment = self.stiffness * self._from_rest(sine, cosine)
        if self.of == "across_edge":
            one, other = (dot(normal, edge) / length**2 for normal in (before, after))
            before = subtract(before, scale(one, edge))
            after = subtract(after, scale(other, edge))
            moment = moment / length
            return moment / dot(before, before), moment / dot(after, after), one, other
        turn = moment / (sine**2 + cosine**2)
        per_length = 1 / length
        return turn * cosine * per_length, -turn * sine, sine * per_length

    def by_normals(
        self, turned: tuple[Component, ...], edge: Vector, before: Vector, after: Vector
    ) -> tuple[Vector, Vector]:
        """Derivatives of the energy by normals, see :mod:`knitlab.model.fold_angle`."""
        one, other, *_ = turned
        if self.of == "across_edge":
            return scale(one, cross(before, edge)), scale(other, cross(edge, after))
        return (
            add(scale(one, cross(after, edge)), scale(other, after)),
            add(scale(one, cross(edge, before)), scale(other, before)),
        )

    def by_edge(
        self, turned: tuple[Component, ...], edge: Vector, before: Vector, after: Vector
    ) -> Vector:
        """Derivative of the energy by edges."""
        if self.of == "across_edge":
            by_before, by_after = self.by_normals(turned, edge, before, after)
            _, _, one, other = turned
            return subtract(scale(-one, by_before), scale(other, by_after))
        by_sine, _, sine = turned
        return scale(by_sine, subtract(cross(before, after), scale(sine, edge)))

    def _from_rest(self, sine: Component, cosine: Component) -> Component:
        angle = arctan2(sine, cosine) - self.rest
        return angle - 2 * np.pi * jnp.round(angle / (2 * np.pi))

    def _sine_and_cosine(
        self, edge: Vector, length: Component, before: Vector, after: Vector
    ) -> tuple[Component, Component]:
        """Sine and cosine of the fold angles, times the same positive number."""
        sine = dot(cross(before, after), edge) / length
        cosine = dot(before, after)
        if self.of == "across_edge":
            cosine = cosine - dot(before, edge) * dot(after, edge) / length**2
        return sine, cosine


class GridFabric(eqx.Module):
    """A fabric on the structured grid, whose elements are numbered as in the network."""

    springs: tuple[Springs, ...]  # along x, along y, and along both diagonals
    hinges: tuple[Hinges, ...]  # about edges along y, and along x
    z_max: Float[Array, ""]  # half the gap between the walls [mm]
    k_wall: Float[Array, ""]  # penalty stiffness of the walls [N/mm]
    periodic: bool = eqx.field(static=True)

    @classmethod
    def of(cls, shape: MeshShape, fabric: Fabric) -> "GridFabric":
        """A fabric of a mesh shape."""
        rows = shape.cells_y
        columns = shape.cells_x
        image = int(shape.periodic)
        # Lines of nodes are as they are, or with their image; cells get one more on every side.
        lines = (0, image)
        cells = (1, 1)
        springs = []
        first = 0
        for size, around in (
            ((shape.nodes_y, columns), (lines, cells)),
            ((rows, shape.nodes_x), (cells, lines)),
            *[((rows, columns), (cells, cells))] * 2,
        ):
            numbers = np.arange(first, first := first + size[0] * size[1]).reshape(size)
            places = np.pad(numbers, around, "edge")
            exists = np.pad(np.ones(size), around)
            springs.append(
                Springs(
                    jnp.asarray(np.asarray(fabric.stretch_stiffness)[places] * exists),
                    jnp.asarray(np.asarray(fabric.rest_length)[places]),
                    fabric.spring_law.of(places),
                )
            )
        # The hinge on the image of the first line is that line's; open edges have none.
        beyond = (0, 1) if shape.periodic else (1, 1)
        mode: Literal["wrap", "constant"] = "wrap" if shape.periodic else "constant"
        wales = rows * (columns if shape.periodic else columns - 1)
        hinges = []
        for own, size, axes in (
            (slice(None, wales), (rows, -1), 1),
            (slice(wales, None), (-1, columns), -1),
        ):
            across = ((0, 0), beyond)[::axes]
            beside = (cells, (0, 0))[::axes]
            stiffness, rest = (
                np.pad(np.pad(np.asarray(values)[own].reshape(size), across, mode), beside)
                for values in (fabric.fold_stiffness, fabric.rest_fold)
            )
            hinges.append(Hinges(jnp.asarray(stiffness), jnp.asarray(rest), fabric.fold_angle))
        walls = jnp.asarray(fabric.z_max), jnp.asarray(fabric.k_wall)
        return cls(tuple(springs), tuple(hinges), *walls, shape.periodic)

    def energy(self, shape: Shape) -> Energy:
        """Elastic energy in its parts [N mm]."""
        around = _surroundings(self._surrounded(shape))
        (of_wale, of_course) = self.hinges
        (wale, course) = _hinged(around)
        counted = BEFORE if self.periodic else ALL  # lines that are not images
        stretch = [own.energy(along) for own, along in zip(self.springs, around.edges, strict=True)]
        return Energy(
            stretch=sum(stretch[1:], stretch[0]),
            fold=of_wale.energy(*wale)[:, counted].sum() + of_course.energy(*course)[counted].sum(),
            wall=0.5 * self.k_wall * jnp.sum(self._beyond(shape.positions[2]) ** 2),
        )

    def gradient(self, shape: Shape, walls: bool = True) -> Shape:
        """Derivative of the elastic energy, minus the force, with or without the walls [N]."""
        around = _surroundings(self._surrounded(shape))
        turned = self._turned(around)
        # Padded apart, since a loop that also pads is twice as slow.
        by_normal = jax.tree.map(lambda each: jnp.pad(each, 1), self._by_normal(around, turned))
        x, y, z = map(_gathered, *self._by_edges(around, turned, by_normal))
        lengths = jnp.zeros(2)
        if self.periodic:
            lengths = jnp.stack([x[:, -1].sum(), y[-1].sum()])
            # At the nodes of periodic fabric, that of their images is added.
            x, y, z = (each[:-1].at[0].add(each[-1]) for each in (x, y, z))
            x, y, z = (each[:, :-1].at[:, 0].add(each[:, -1]) for each in (x, y, z))
        if walls:
            z = z + self.k_wall * self._beyond(shape.positions[2])
        return Shape((x, y, z), lengths)

    @materialised
    def _turned(self, around: Surroundings) -> list[tuple[Component, ...]]:
        lengths = around.lengths[1], around.lengths[0]
        return [
            own.turned(edge, length, *normals)
            for own, length, (edge, *normals) in zip(
                self.hinges, lengths, _hinged(around), strict=True
            )
        ]

    @materialised
    def _by_normal(self, around: Surroundings, turned: list[tuple[Component, ...]]) -> OnLines:
        (wale_before, wale_after), (course_before, course_after) = (
            own.by_normals(numbers, *vectors)
            for own, numbers, vectors in zip(self.hinges, turned, _hinged(around), strict=True)
        )
        # A cell is before the hinges on its far lines, and after those on its near lines.
        return add(
            _at(wale_before, INNER, AFTER),
            _at(wale_after, INNER, BEFORE),
            _at(course_before, AFTER, INNER),
            _at(course_after, BEFORE, INNER),
        )

    @materialised
    def _by_edges(
        self, around: Surroundings, turned: list[tuple[Component, ...]], by_normal: OnLines
    ) -> tuple[OnLines, OnLines, OnLines, OnLines]:
        by_warp, by_weft = (
            own.by_edge(numbers, *vectors)
            for own, numbers, vectors in zip(self.hinges, turned, _hinged(around), strict=True)
        )
        if self.periodic:
            by_warp = jax.tree.map(lambda component: component.at[:, -1].set(0.0), by_warp)
            by_weft = jax.tree.map(lambda component: component.at[-1].set(0.0), by_weft)
        weft, warp, up, down = (
            own.gradient(along, length)
            for own, along, length in zip(self.springs, around.edges, around.lengths, strict=True)
        )
        _, _, rising, falling = around.edges
        return (
            subtract(weft, by_weft),  # the edge of a course hinge points to −x
            add(warp, by_warp),
            add(up, cross(falling, by_normal)),
            add(down, cross(by_normal, rising)),
        )

    def _beyond(self, heights: Component) -> Component:
        """How far nodes are beyond the walls, with the sign of their height [mm]."""
        return heights - jnp.clip(heights, -self.z_max, self.z_max)

    def _surrounded(self, shape: Shape) -> Vector:
        """Positions, also of straight lines beyond open edges, so that normals exist [mm]."""
        (x, y, z) = shape.positions
        (length_x, length_y) = shape.lengths
        return (
            _extended(x, self.periodic, length_x, 0.0),
            _extended(y, self.periodic, 0.0, length_y),
            _extended(z, self.periodic, 0.0, 0.0),
        )


@materialised
def _surroundings(around: OnLines) -> Surroundings:
    """Edges, their lengths and normals, from positions with those beyond open edges."""
    weft = subtract(_at(around, INNER, AFTER), _at(around, INNER, BEFORE))
    warp = subtract(_at(around, AFTER, INNER), _at(around, BEFORE, INNER))
    rising = subtract(_at(around, AFTER, AFTER), _at(around, BEFORE, BEFORE))
    falling = subtract(_at(around, AFTER, BEFORE), _at(around, BEFORE, AFTER))
    edges = weft, warp, rising, falling
    return Surroundings(edges, tuple(map(norm, edges)), cross(rising, falling))


def _hinged(
    around: Surroundings,
) -> tuple[tuple[OnLines, OnLines, OnLines], tuple[OnLines, OnLines, OnLines]]:
    """Edge, normal before and normal after, of the wale hinges and of the course hinges."""
    ((x, y, z), warp, _, _) = around.edges
    normals = around.normals
    return (
        (warp, _at(normals, ALL, BEFORE), _at(normals, ALL, AFTER)),
        ((-x, -y, -z), _at(normals, BEFORE, ALL), _at(normals, AFTER, ALL)),
    )


def _at(vector: OnLines, rows: slice, columns: slice) -> OnLines:
    return jax.tree.map(lambda component: component[rows, columns], vector)


def _extended(
    grid: Lines, periodic: bool, offset_x: Array | float, offset_y: Array | float
) -> Lines:
    """A component with a line before the first and one after the last, or two if periodic."""
    if periodic:
        grid = jnp.concatenate([grid[-1:] - offset_y, grid, grid[:2] + offset_y], axis=0)
        return jnp.concatenate([grid[:, -1:] - offset_x, grid, grid[:, :2] + offset_x], axis=1)
    grid = jnp.concatenate([2 * grid[:1] - grid[1:2], grid, 2 * grid[-1:] - grid[-2:-1]], axis=0)
    return jnp.concatenate(
        [2 * grid[:, :1] - grid[:, 1:2], grid, 2 * grid[:, -1:] - grid[:, -2:-1]], axis=1
    )


def _gathered(weft: Lines, warp: Lines, rising: Lines, falling: Lines) -> Lines:
    """One component of the gradient at every node, from those with respect to the vectors."""
    return (
        weft[:, BEFORE]
        - weft[:, AFTER]
        + warp[BEFORE]
        - warp[AFTER]
        + rising[BEFORE, BEFORE]
        - rising[AFTER, AFTER]
        + falling[BEFORE, AFTER]
        - falling[AFTER, BEFORE]
    )
