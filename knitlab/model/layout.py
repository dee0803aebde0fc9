"""The layout of a fabric: where it has which spring, hinge and fold, without their numbers."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from knitlab.model.fabric import Fabric, Sheet, StripePair, cell_length
from knitlab.model.fold_lines import (
    fold_stiffness_factors,
    inside_runs,
    patch_senses,
    ridge_of,
)
from knitlab.model.network import Network, mesh_shape, network
from knitlab.model.options import ModelOptions
from knitlab.model.pattern import CELLS_PER_PERIOD, PatchGrid
from knitlab.model.plain import PlainKnit
from knitlab.model.spring_law import SpringLaw, spring_law
from knitlab.model.stripe import Stripe

Sides = Int[np.ndarray, "hinge 2"]


@dataclass(frozen=True, eq=False)
class FabricLayout:
    """How a patterned fabric takes its numbers from its stripes: all of it but the numbers.

    Attributes:
        net: the network of its mesh shape.
        sheet: the walls.
        options: the choices that the paper leaves open.
        row_stripe: number of the garter stripe of each row of grid cells.
        column_stripe: number of the rib stripe of each column of grid cells.
        plain: the numbers of plain knit; None if the fabric has none.
        plain_cells: which grid cells are of plain knit.
        spring_kind: of every spring, 0 along the weft, 1 along the warp, 2 a diagonal.
        spring_cells: the two grid cells (y, x) that every spring borders on, the same one twice
            for a diagonal and at an edge.
        hinge_kind: of every hinge, 0 if it turns about an edge along y, else 1.
        hinge_cells: the grid cells (y, x) before and after every hinge's edge.
        fold_part: of every hinge, the part of a fold that it takes: > 0 in a mountain, < 0 in a
            valley, 0 where it rests flat.
        single_fold: of every hinge, the fold angle at rest of the single fold that it lies on,
            NaN where it lies on none [rad].
        stiffness_factor: of every hinge, on its k_t.
        hinged: of every hinge, whether the model options put one there.
    """

    net: Network
    sheet: Sheet
    options: ModelOptions
    row_stripe: Int[np.ndarray, " grid_y"]
    column_stripe: Int[np.ndarray, " grid_x"]
    plain: PlainKnit | None
    plain_cells: Bool[np.ndarray, "grid_y grid_x"]
    spring_kind: Int[np.ndarray, " spring"]
    spring_cells: Int[np.ndarray, "spring 2 2"]
    hinge_kind: Int[np.ndarray, " hinge"]
    hinge_cells: Int[np.ndarray, "hinge 2 2"]
    fold_part: Float[np.ndarray, " hinge"]
    single_fold: Float[np.ndarray, " hinge"]
    stiffness_factor: Float[np.ndarray, " hinge"]
    hinged: Bool[np.ndarray, " hinge"]

    @property
    def fold_sense(self) -> Float[np.ndarray, " hinge"]:
        """Of every hinge, > 0 in a mountain, < 0 in a valley, 0 where it rests flat."""
        return np.where(np.isnan(self.single_fold), self.fold_part, np.sign(self.single_fold))

    def fabric(self, stripes: StripePair) -> Fabric:
        """The fabric of its stripes; pure JAX, so that derivatives pass through it.

        There is none by k_s where two springs have the same: diagonals take the smaller, and the
        spring law of its stripe.

        Args:
            stripes: of rib by the number of the column's stripe, of garter by that of the row's;
                plain numbers if there is one of each.
        """
        weft, warp = (_by_number(side, "k_s") for side in (stripes.weft, stripes.warp))
        width = cell_length(stripes.weft, self.options).reshape(-1)[self.column_stripe]
        height = cell_length(stripes.warp, self.options).reshape(-1)[self.row_stripe]
        cells = len(height), len(width)
        k_s = [
            jnp.broadcast_to(weft[self.column_stripe], cells),
            jnp.broadcast_to(warp[self.row_stripe][:, None], cells),
        ]
        k_t = [
            jnp.broadcast_to(_by_number(stripes.weft, "k_t")[self.column_stripe], cells),
            jnp.broadcast_to(_by_number(stripes.warp, "k_t")[self.row_stripe][:, None], cells),
        ]
        if self.options.hinge_stiffness == "per_length":
            # The paper's edges, which are as long as a cell of its grid.
            paper_cells = self.options.cells_per_period // CELLS_PER_PERIOD
            k_t = [k_t[0] * height[:, None] * paper_cells, k_t[1] * width * paper_cells]
        if self.plain is not None:
            shape = height[:, None] / width
            k_s = [
                jnp.where(self.plain_cells, self.plain.plain_stretch_weft * shape, k_s[0]),
                jnp.where(self.plain_cells, self.plain.plain_stretch_warp / shape, k_s[1]),
            ]
            k_t = [
                jnp.where(self.plain_cells, self.plain.plain_bend_weft * shape, k_t[0]),
                jnp.where(self.plain_cells, self.plain.plain_bend_warp / shape, k_t[1]),
            ]
        rows, columns = self.spring_cells[:, 0, 0], self.spring_cells[:, 0, 1]
        return Fabric(
            rest_length=jnp.select(
                [self.spring_kind == 0, self.spring_kind == 1],
                [width[columns], height[rows]],
                jnp.hypot(width[columns], height[rows]),
            ),
            stretch_stiffness=self._spring_stiffness(k_s),
            rest_fold=self._rest_fold(stripes),
            fold_stiffness=self._hinge_stiffness(k_t),
            z_max=jnp.asarray(self.sheet.z_max, float),
            k_wall=jnp.asarray(self._k_wall, float),
            cell_x=width,
            cell_y=height,
            fold_angle=self.options.fold_angle,
            spring_law=self._spring_law(stripes, k_s),
        )

    @property
    def _k_wall(self) -> float:
        """Stiffness of the wall at a node, which stands for a part of the paper's cell."""
        return self.sheet.k_wall * (CELLS_PER_PERIOD / self.options.cells_per_period) ** 2

    def _spring_stiffness(self, k_s: list[Array]) -> Float[Array, " spring"]:
        """A spring on the border of two cells takes the mean of theirs."""
        one, other = self.spring_cells[:, 0].T, self.spring_cells[:, 1].T
        along = [(of[tuple(one)] + of[tuple(other)]) / 2 for of in k_s]
        return jnp.select(
            [self.spring_kind == 0, self.spring_kind == 1], along, jnp.minimum(*along)
        )

    def _spring_law(self, stripes: StripePair, k_s: list[Array]) -> SpringLaw:
        """The law of every spring: that of its stripe, linear within plain knit."""
        (weft, weft_curves), (warp, warp_curves) = stripes.weft.laws, stripes.warp.laws
        laws = spring_law([*weft, *warp, None], [*weft_curves, *warp_curves, None])
        (row, column), (other_row, other_column) = self.spring_cells.transpose(1, 2, 0)
        rib, garter = self.column_stripe[column], len(weft) + self.row_stripe[row]
        softer = jnp.where(k_s[0][row, column] <= k_s[1][row, column], rib, garter)
        number = jnp.select([self.spring_kind == 0, self.spring_kind == 1], [rib, garter], softer)
        plain = self.plain_cells[row, column] & self.plain_cells[other_row, other_column]
        return laws.of(jnp.where(plain, len(weft) + len(warp), number))

    def _hinge_stiffness(self, k_t: list[Array]) -> Float[Array, " hinge"]:
        """A hinge between two cells is half of one's and half of the other's in series."""
        before, after = self.hinge_cells[:, 0].T, self.hinge_cells[:, 1].T
        pairs = [(of[tuple(before)], of[tuple(after)]) for of in k_t]
        across = self.hinge_kind == 0
        one = jnp.where(across, pairs[0][0], pairs[1][0])
        other = jnp.where(across, pairs[0][1], pairs[1][1])
        stiffness = jnp.where(self._alike, other, 2 * one * other / (one + other))
        return jnp.where(self.hinged, self.stiffness_factor * stiffness, 0.0)

    @property
    def _alike(self) -> Bool[np.ndarray, " hinge"]:
        """Whether the cells on both sides of a hinge take the same numbers."""
        (y, x), (up, right) = self.hinge_cells[:, 0].T, self.hinge_cells[:, 1].T
        stripe = np.where(
            self.hinge_kind == 0,
            self.column_stripe[x] == self.column_stripe[right],
            self.row_stripe[y] == self.row_stripe[up],
        )
        return stripe & (self.plain_cells[y, x] == self.plain_cells[up, right])

    def _rest_fold(self, stripes: StripePair) -> Float[Array, " hinge"]:
        ridge = ridge_of(self.options)
        before, after = self.hinge_cells[:, 0], self.hinge_cells[:, 1]
        turns = [
            ridge.turn(_by_number(stripes.weft, "theta_0")),
            ridge.turn(_by_number(stripes.warp, "theta_0")),
        ]
        numbers = [
            (self.column_stripe[before[:, 1]], self.column_stripe[after[:, 1]]),
            (self.row_stripe[before[:, 0]], self.row_stripe[after[:, 0]]),
        ]
        turn = [(of[one] + of[other]) / 2 for of, (one, other) in zip(turns, numbers, strict=True)]
        fold = self.fold_part * jnp.where(self.hinge_kind == 0, turn[0], turn[1])
        return jnp.where(np.isnan(self.single_fold), fold, np.nan_to_num(self.single_fold))


def _by_number(stripe: object, name: str) -> Float[Array, " stripe"]:
    """A number of one or of several stripes, along one axis."""
    return jnp.reshape(getattr(stripe, name), -1)


def fabric_layout(
    pattern: PatchGrid, sheet: Sheet, options: ModelOptions, plain: PlainKnit | None = None
) -> FabricLayout:
    """Where a patterned fabric has which spring, hinge and fold (paper, Sec. "3D model").

    Springs and hinges take their values by direction: those across the wales (springs along x,
    hinges about edges along y) from the rib stripe of their column, those across the courses from
    the garter stripe of their row, diagonals the smaller k_s. In plain knit they take its own.
    Folds lie where :func:`~knitlab.model.fold_lines.fold_senses` puts them, the first of a rib
    patch a mountain, of a garter patch as the option ``garter_start`` has it, and where the pattern
    has single folds. Hinges that join unlike patches, or turn against their patch's folds, rest
    flat and exist only by the option ``hinges = "all"``, within plain knit always.

    Args:
        pattern: the patches.
        sheet: the walls.
        options: the choices that the paper leaves open.
        plain: numbers of plain knit, which a pattern that has plain patches needs.

    Raises:
        BadPattern: if a single fold lies outside the pattern or between grid lines.
        ValueError: if the pattern has plain knit and no numbers of it are given, or another grid
            than the options.
    """
    shape = mesh_shape(pattern, options.boundary)
    net = network(shape)
    if pattern.cells_per_period != options.cells_per_period:
        counts = f"{pattern.cells_per_period} and {options.cells_per_period}"
        raise ValueError(f"pattern and options have {counts} cells a period; give both the same")
    plain_cells = pattern.cells_of("plain")
    if plain is None and plain_cells.any():
        raise ValueError("the pattern has plain patches (P); give the numbers of plain knit")
    after = net.hinge_cells
    before = (after - np.where(net.wale[:, None], [0, 1], [1, 0])) % pattern.grid
    at = tuple(after.T)
    rib_senses, garter_senses = patch_senses(pattern, options)
    rib_factors, garter_factors = fold_stiffness_factors(pattern, options)
    single = _single_folds(pattern, net, options.boundary == "periodic")
    factor = np.where(net.wale, rib_factors[at], garter_factors[at])
    paper_cells = options.cells_per_period // CELLS_PER_PERIOD
    hinged = np.ones(len(net.wale), dtype=bool)
    if options.hinges == "fold_lines":
        in_rib = inside_runs(pattern.cells_of("rib"), shape.periodic)
        in_garter = inside_runs(pattern.cells_of("garter").T, shape.periodic).T
        in_plain = plain_cells[tuple(before.T)] & plain_cells[at]
        hinged = np.where(net.wale, in_rib[at], in_garter[at]) | in_plain | ~np.isnan(single)
    return FabricLayout(
        net=net,
        sheet=sheet,
        options=options,
        row_stripe=pattern.row_stripe[pattern.patch_of_row],
        column_stripe=pattern.column_stripe[pattern.patch_of_column],
        plain=plain,
        plain_cells=plain_cells,
        spring_kind=np.select([net.weft, net.warp], [0, 1], 2),
        spring_cells=_spring_cells(net),
        hinge_kind=np.where(net.wale, 0, 1),
        hinge_cells=np.stack([before, after], axis=1),
        fold_part=np.where(net.wale, rib_senses[at], garter_senses[at]),
        single_fold=single,
        # A single fold is one hinge on any grid, with an edge shorter than the paper's.
        stiffness_factor=np.where(np.isnan(single), factor, 1 / paper_cells),
        hinged=hinged,
    )


def assemble_fabric(
    pattern: PatchGrid,
    weft: Stripe,
    warp: Stripe,
    sheet: Sheet,
    options: ModelOptions,
    plain: PlainKnit | None = None,
) -> tuple[Network, Fabric]:
    """Network and numbers of a patterned fabric of one pair of stripes.

    Args:
        pattern: the patches.
        weft: the rib stripe; for a pure stripe fabric, that stripe.
        warp: the garter stripe; for a pure stripe fabric, that stripe.
        sheet: the walls.
        options: the choices that the paper leaves open.
        plain: numbers of plain knit, if the pattern has any.
    """
    layout = fabric_layout(pattern, sheet, options, plain)
    return layout.net, layout.fabric(StripePair.of(weft, warp))


def _spring_cells(net: Network) -> Int[np.ndarray, "spring 2 2"]:
    """The two grid cells (y, x) that every spring borders on."""
    shape = net.shape
    # The node of a spring that lies lowest and leftmost names the cell above and right of it.
    first, second = (
        np.stack(np.divmod(nodes, shape.nodes_x), axis=-1)
        + net.springs.images[:, end, ::-1] * [shape.cells_y, shape.cells_x]
        for end, nodes in enumerate(net.springs.nodes.T)
    )
    after = np.minimum(first, second)
    before = after - np.select([net.weft[:, None], net.warp[:, None]], [[1, 0], [0, 1]], [0, 0])
    cells = np.stack([before, after], axis=1)
    size = np.array([shape.cells_y, shape.cells_x])
    if shape.periodic:
        return cells % size
    # At an edge there is a cell on one side alone.
    return np.clip(cells, 0, size - 1)


def _single_folds(pattern: PatchGrid, net: Network, periodic: bool) -> Float[np.ndarray, " hinge"]:
    rest = np.full(len(net.wale), np.nan)
    (row, column), (rows, columns) = net.hinge_cells.T, pattern.grid
    for fold in pattern.grid_folds():
        across, along, count = (
            (column, row, columns) if fold.along == "wale" else (row, column, rows)
        )
        line = fold.line % count if periodic else fold.line
        wale = net.wale if fold.along == "wale" else ~net.wale
        on = wale & (across == line) & (fold.start <= along) & (along < fold.end)
        rest[on] = fold.rest_fold
    return rest
