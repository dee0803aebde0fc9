"""Block-tridiagonal Cholesky factorisation in JAX, for a batch of fabrics of one mesh shape.

Two neighbouring lines of the grid form a block. Nodes couple no further, so that the matrix is
block-tridiagonal. The lengths of periodic fabric, which couple to all nodes, form a border that is
eliminated last; so do two lines of periodic fabric, which cut it open. All blocks have the same
size, so that a factorisation is one scan of dense steps, each for the whole batch.
"""

from dataclasses import dataclass
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax.linalg import triangular_solve
from jax.scipy.linalg import cho_solve, solve_triangular
from jaxtyping import Array, Bool, Float, Int

import knitlab.model  # noqa: F401  (float64)

Arrays = tuple[Array, ...]
Pair = tuple[Array, Array]

REACH = 2
"""Number of lines over which nodes couple, and so of lines in a block."""


@dataclass(frozen=True, eq=False)
class BlockLayout:
    """Where the unknowns lie in blocks padded to one size, the border after the last.

    Attributes:
        unknowns: unknown at every place; where there is none, their number.
        places: place of every unknown.
        blocks, width, border: number of blocks, size of each, and size of the border.
    """

    unknowns: Int[np.ndarray, " place"]
    places: Int[np.ndarray, " unknown"]
    blocks: int
    width: int
    border: int


class BlockFactors(eqx.Module):
    """Cholesky factor L of one matrix, or of a batch of them from a vmapped ``factorise``.

    Attributes:
        pivots: lower-triangular diagonal blocks of L.
        panels: what lies below each: the rows of the next block, then those of the border.
        corner: lower-triangular diagonal block of the border.
        positive: whether the matrix is positive definite; the factors are of no use otherwise.
        layout: of the unknowns in the blocks.
    """

    pivots: Float[Array, "*batch block width width"]
    panels: Float[Array, "*batch block row width"]
    corner: Float[Array, "*batch border border"]
    positive: Bool[Array, "*batch"]
    layout: BlockLayout = eqx.field(static=True)

    def solve(self, right: Float[Array, " unknown"]) -> Float[Array, " unknown"]:
        """Solution x of K x = right, for one matrix; of no use unless ``positive``.

        For a batch: ``jax.vmap(Factors.solve)(factors, rights)``.
        """
        layout, width = self.layout, self.layout.width
        padded = jnp.append(right, 0.0)[layout.unknowns]
        rights, border = jnp.split(padded, [layout.blocks * width])

        def forward(taken: Pair, block: Arrays) -> tuple[Pair, Array]:
            (own, shared), (pivot, panel, right) = taken, block
            part = solve_triangular(pivot, right - own, lower=True)
            below = panel @ part
            return (below[:width], shared + below[width:]), part

        nothing = jnp.zeros_like(rights, shape=width)
        (_, shared), parts = jax.lax.scan(
            forward,
            (nothing, jnp.zeros_like(border)),
            (self.pivots, self.panels, rights.reshape(layout.blocks, width)),
        )
        border = cho_solve((self.corner, True), border - shared)

        def backward(following: Array, block: Arrays) -> Pair:
            pivot, panel, part = block
            part = part - jnp.concatenate([following, border]) @ panel
            solution = solve_triangular(pivot, part, lower=True, trans="T")
            return solution, solution

        _, solutions = jax.lax.scan(
            backward, nothing, (self.pivots, self.panels, parts), reverse=True
        )
        return jnp.append(solutions, border)[layout.places]


@partial(
    jax.tree_util.register_dataclass, data_fields=["columns", "corner"], meta_fields=["layout"]
)
@dataclass(frozen=True, eq=False)
class BlockTridiagonal:
    """Where the non-zeros of a sparsity go in the blocks of :class:`BlockFactors`.

    Non-zeros are numbered as they are stored; after the last, one number stands for 0 and the
    next for 1. ``jax.jit(plan.factorise)`` compiles these maps in; for a large mesh they can be
    an argument instead, ``jax.jit(BlockTridiagonal.factorise)(plan, entries)``.

    Attributes:
        columns: non-zero at every place of a block's own rows (lower triangle), of the next
            block's and of the border's.
        corner: the same within the border.
        layout: of the unknowns in the blocks.
    """

    columns: Int[np.ndarray, "block row width"]
    corner: Int[np.ndarray, "border border"]
    layout: BlockLayout

    def factorise(self, entries: Float[Array, " nonzero"]) -> BlockFactors:
        """Factor the matrix with these entries in the lower triangle, column by column.

        For a batch: ``jax.vmap(plan.factorise)(entries)``; a matrix in it that is not positive
        definite leaves the others as they are.
        """
        width, border = self.layout.width, self.layout.border
        values = jnp.append(entries, jnp.array([0.0, 1.0]))

        def eliminate(taken: Arrays, sources: Array) -> tuple[Arrays, Pair]:
            update, shared, corner = taken
            # Gathered here and not beforehand, so that the blocks are never all held twice.
            pivot, following, border = jnp.split(values[sources], [width, 2 * width])
            pivot = _cholesky(pivot - update)
            panel = triangular_solve(
                pivot,
                jnp.concatenate([following, border - shared]),
                lower=True,
                transpose_a=True,
            )
            product = panel @ panel.T
            passed = product[:width, :width], product[width:, :width]
            return (*passed, corner + product[width:, width:]), (pivot, panel)

        sizes = (width, width), (border, width), (border, border)
        nothing = tuple(jnp.zeros_like(values, shape=size) for size in sizes)
        (_, _, taken), (pivots, panels) = jax.lax.scan(
            eliminate, nothing, jnp.asarray(self.columns)
        )
        corner = _cholesky(values[self.corner] - taken)
        # All pivots are tested, as a triangular solve may skip zeros and so lose NaNs.
        diagonals = jnp.append(jnp.diagonal(pivots, axis1=1, axis2=2), jnp.diagonal(corner))
        return BlockFactors(pivots, panels, corner, jnp.isfinite(diagonals).all(), self.layout)


def _cholesky(matrix: Float[Array, "row row"]) -> Float[Array, "row row"]:
    # Not symmetrised, as only the lower triangle is filled.
    return jnp.linalg.cholesky(matrix, symmetrize_input=False)


def narrower(
    rows: Int[np.ndarray, " unknown"], columns: Int[np.ndarray, " unknown"]
) -> Int[np.ndarray, " unknown"]:
    """Rows or columns, whichever form the smaller blocks.

    Args:
        rows: row of the node of every unknown; −1 for the lengths.
        columns: column of the node of every unknown, likewise.
    """
    return min(rows, columns, key=lambda lines: np.bincount(lines[lines >= 0]).max())


def block_tridiagonal(
    indptr: Int[np.ndarray, " column"],
    indices: Int[np.ndarray, " nonzero"],
    lines: Int[np.ndarray, " unknown"],
) -> BlockTridiagonal:
    """Lay out the blocks of a symmetric sparsity, once for a mesh shape.

    Args:
        indptr: where every column starts in ``indices``.
        indices: rows of the non-zeros of the lower triangle, column by column.
        lines: row (or column) of the node of each unknown; −1 for the lengths, which may couple to
            all unknowns.

    Raises:
        ValueError: if lines couple that are more than two apart, also across a periodic boundary.
    """
    size, nonzeros = len(lines), len(indices)
    ends = np.array([indices, np.repeat(np.arange(size), np.diff(indptr))])
    layout = _layout(ends, lines)
    width, inner = layout.width, layout.blocks * layout.width

    # Padding has 1 on the diagonal, so that it does not affect the factorisation.
    padding = np.flatnonzero(layout.unknowns == size)
    sources = np.append(np.arange(nonzeros), np.full(len(padding), nonzeros + 1))
    column, row = np.sort(np.append(layout.places[ends], [padding, padding], axis=1), axis=0)
    block, column_within = np.divmod(column, width)
    row_within = row - np.where(row < inner, block * width, inner - 2 * width)
    if (row_within >= 2 * width)[row < inner].any():
        raise ValueError(f"lines couple that are more than {REACH} apart")

    columns = np.full((layout.blocks, 2 * width + layout.border, width), nonzeros, dtype=np.int32)
    corner = np.full((layout.border, layout.border), nonzeros, dtype=np.int32)
    left, last = column < inner, column >= inner
    columns[block[left], row_within[left], column_within[left]] = sources[left]
    corner[row[last] - inner, column[last] - inner] = sources[last]
    return BlockTridiagonal(columns, corner, layout)


def _layout(ends: Int[np.ndarray, "2 nonzero"], lines: Int[np.ndarray, " unknown"]) -> BlockLayout:
    bordering = lines < 0
    line = np.searchsorted(np.unique(lines[~bordering]), lines)
    distance = abs(line[ends[0]] - line[ends[1]])[~bordering[ends].any(axis=0)]
    # Lines so far apart couple only across a periodic boundary, where the grid is cut open.
    if distance.max() > REACH:
        bordering |= line > line.max() - REACH
    blocks = int(line[~bordering].max()) // REACH + 1
    block = np.where(bordering, blocks, line // REACH)
    members = np.bincount(block, minlength=blocks + 1)
    # Never empty, as not every backend accepts an empty matrix.
    width, border = int(members[:-1].max()), max(1, int(members[-1]))

    order = np.argsort(block, kind="stable")
    places = np.empty_like(order)
    places[order] = np.arange(len(lines)) + (
        np.arange(blocks + 1) * width - np.cumsum(members) + members
    ).repeat(members)
    unknowns = np.full(blocks * width + border, len(lines))
    unknowns[places] = np.arange(len(lines))
    return BlockLayout(unknowns, places, blocks, width, border)
