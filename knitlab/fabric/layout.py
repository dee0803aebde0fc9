"""The layout of a fabric: place and kind of every spring, hinge and fold, without parameters."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from knitlab.fabric.array_library import array_library
from knitlab.fabric.fabric import Fabric, Sheet, StripeNumbers, StripePair, cell_length
from knitlab.fabric.fold_lines import (
    fold_stiffness_factors,
    inside_runs,
    patch_senses,
    ridge_of,
)
from knitlab.fabric.network import Network, mesh_shape, network
from knitlab.fabric.options import ModelOptions
from knitlab.fabric.pattern import CELLS_PER_PERIOD, PatchGrid
from knitlab.fabric.plain import PlainKnit
from knitlab.fabric.spring_law import SpringLaw, spring_law
from knitlab.fabric.stripe import Stripe

Sides = Int[np.ndarray, "hinge 2"]


@dataclass(frozen=True, eq=False)
class FabricLayout:
    """How the parameters of a patterned fabric follow from those of its stripes.

    Attributes:
        net: the network of its mesh shape.
        sheet: the walls.
        options: model options.
        row_stripe: number of the garter stripe of each row of grid cells.
        column_stripe: number of the rib stripe of each column of grid cells.
        plain: the stiffness of plain knit; None if the fabric has none.
        plain_cells: which grid cells are of plain knit.
        spring_kind: of every spring, 0 along the weft, 1 along the warp, 2 for a diagonal.
        spring_cells: the two grid cells (y, x) beside every spring; twice the same cell for a
            diagonal and at an edge.
        hinge_kind: of every hinge, 0 if its edge is along y, else 1.
        hinge_cells: the grid cells (y, x) before and after every hinge's edge.
        fold_part: of every hinge, its part of a fold: > 0 in a mountain, < 0 in a valley, 0 if it
            is flat at rest.
        single_fold: of every hinge, the rest fold angle of the single fold on which it lies, NaN
            if it lies on none [rad].
        stiffness_factor: of every hinge, the factor on its k_t.
        hinged: of every hinge, whether it exists by the model options.
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
        """Of every hinge, > 0 in a mountain, < 0 in a valley, 0 if it is flat at rest."""
        return np.where(np.isnan(self.single_fold), self.fold_part, np.sign(self.single_fold))

    def fabric(self, stripes: StripePair) -> Fabric:
        """The fabric of given stripes; differentiable by JAX.

        Diagonals have the smaller of both k_s, and the spring law of that stripe. Where both k_s
        are equal, the fabric is not differentiable with respect to k_s.

        Args:
            stripes: rib stripes in the order of ``column_stripe``, garter stripes in the order of
                ``row_stripe``; without this axis if there is one of each.
        """
        xp = array_library(stripes)
        width, height = (
            xp.reshape(xp.asarray(cell_length(side, self.options)), -1)[number]
            for side, number in (
                (stripes.weft, self.column_stripe),
                (stripes.warp, self.row_stripe),
            )
        )
        cells = len(height), len(width)
        k_s, k_t = (
            [
                xp.broadcast_to(_by_number(stripes.weft, name)[self.column_stripe], cells),
                xp.broadcast_to(_by_number(stripes.warp, name)[self.row_stripe][:, None], cells),
            ]
            for name in ("k_s", "k_t")
        )
        if self.options.hinge_stiffness == "per_length":
            # The length of an edge is that on the paper's grid.
            paper_cells = self.options.cells_per_period // CELLS_PER_PERIOD
            k_t = [k_t[0] * height[:, None] * paper_cells, k_t[1] * width * paper_cells]
        if self.plain is not None:
            shape = height[:, None] / width
            k_s = [
                xp.where(self.plain_cells, self.plain.plain_stretch_weft * shape, k_s[0]),
                xp.where(self.plain_cells, self.plain.plain_stretch_warp / shape, k_s[1]),
            ]
            k_t = [
                xp.where(self.plain_cells, self.plain.plain_bend_weft * shape, k_t[0]),
                xp.where(self.plain_cells, self.plain.plain_bend_warp / shape, k_t[1]),
            ]
        rows, columns = self.spring_cells[:, 0, 0], self.spring_cells[:, 0, 1]
        return Fabric(
            rest_length=xp.select(
                [self.spring_kind == 0, self.spring_kind == 1],
                [width[columns], height[rows]],
                xp.hypot(width[columns], height[rows]),
            ),
            stretch_stiffness=self._spring_stiffness(k_s, xp),
            rest_fold=self._rest_fold(stripes, xp),
            fold_stiffness=self._hinge_stiffness(k_t, xp),
            z_max=np.asarray(self.sheet.z_max, float),
            k_wall=np.asarray(self._k_wall, float),
            cell_x=width,
            cell_y=height,
            fold_angle=self.options.fold_angle,
            spring_law=self._spring_law(stripes, k_s, xp),
        )

    @property
    def _k_wall(self) -> float:
        """Stiffness of the wall at a node, in proportion to the area of its cell."""
        return self.sheet.k_wall * (CELLS_PER_PERIOD / self.options.cells_per_period) ** 2

    def _spring_stiffness(self, k_s: list[Any], xp: Any) -> Float[Array | np.ndarray, " spring"]:
        """A spring on the border of two cells has the mean of their stiffness."""
        one, other = self.spring_cells[:, 0].T, self.spring_cells[:, 1].T
        along = [(stiffness[tuple(one)] + stiffness[tuple(other)]) / 2 for stiffness in k_s]
        return xp.select([self.spring_kind == 0, self.spring_kind == 1], along, xp.minimum(*along))

    def _spring_law(self, stripes: StripePair, k_s: list[Any], xp: Any) -> SpringLaw:
        """The law of every spring: that of its stripe, linear within plain knit."""
        (weft, weft_curves), (warp, warp_curves) = stripes.weft.laws, stripes.warp.laws
        laws = spring_law([*weft, *warp, None], [*weft_curves, *warp_curves, None])
        (row, column), (other_row, other_column) = self.spring_cells.transpose(1, 2, 0)
        rib, garter = self.column_stripe[column], len(weft) + self.row_stripe[row]
        softer = xp.where(k_s[0][row, column] <= k_s[1][row, column], rib, garter)
        number = xp.select([self.spring_kind == 0, self.spring_kind == 1], [rib, garter], softer)
        plain = self.plain_cells[row, column] & self.plain_cells[other_row, other_column]
        return laws.of(xp.where(plain, len(weft) + len(warp), number))

    def _hinge_stiffness(self, k_t: list[Any], xp: Any) -> Float[Array | np.ndarray, " hinge"]:
        """A hinge between two cells is half a hinge of each cell in series."""
        before, after = self.hinge_cells[:, 0].T, self.hinge_cells[:, 1].T
        pairs = [(stiffness[tuple(before)], stiffness[tuple(after)]) for stiffness in k_t]
        across = self.hinge_kind == 0
        one = xp.where(across, pairs[0][0], pairs[1][0])
        other = xp.where(across, pairs[0][1], pairs[1][1])
        stiffness = xp.where(self._alike, other, 2 * one * other / (one + other))
        return xp.where(self.hinged, self.stiffness_factor * stiffness, 0.0)

    @property
    def _alike(self) -> Bool[np.ndarray, " hinge"]:
        """Whether the cells on both sides of a hinge have the same parameters."""
        (y, x), (up, right) = self.hinge_cells[:, 0].T, self.hinge_cells[:, 1].T
        stripe = np.where(
            self.hinge_kind == 0,
            self.column_stripe[x] == self.column_stripe[right],
            self.row_stripe[y] == self.row_stripe[up],
        )
        return stripe & (self.plain_cells[y, x] == self.plain_cells[up, right])

    def _rest_fold(self, stripes: StripePair, xp: Any) -> Float[Array | np.ndarray, " hinge"]:
        ridge = ridge_of(self.options)
        before, after = self.hinge_cells[:, 0], self.hinge_cells[:, 1]
        folds = [
            ridge.rest_fold(_by_number(side, "theta_0")) for side in (stripes.weft, stripes.warp)
        ]
        numbers = [
            (self.column_stripe[before[:, 1]], self.column_stripe[after[:, 1]]),
            (self.row_stripe[before[:, 0]], self.row_stripe[after[:, 0]]),
        ]
        weft, warp = (
            (angle[one] + angle[other]) / 2
            for angle, (one, other) in zip(folds, numbers, strict=True)
        )
        fold = self.fold_part * xp.where(self.hinge_kind == 0, weft, warp)
        return xp.where(np.isnan(self.single_fold), fold, np.nan_to_num(self.single_fold))


def _by_number(stripe: StripeNumbers, name: str) -> Any:
    """A parameter of one or of several stripes, along one axis."""
    return getattr(stripe, name).reshape(-1)


def fabric_layout(
    pattern: PatchGrid, sheet: Sheet, options: ModelOptions, plain: PlainKnit | None = None
) -> FabricLayout:
    """The springs, hinges and folds of a patterned fabric (paper, Sec. "3D model").

    The parameters of springs and hinges depend on their direction: those across the wales (springs
    along x, hinges about edges along y) have the values of the rib stripe of their column, those
    across the courses the values of the garter stripe of their row, and diagonals the smaller k_s.
    Within plain knit they have the values of plain knit.

    Folds lie on the lines given by :func:`~knitlab.fabric.fold_lines.fold_senses`, and where the
    pattern has single folds. The first fold of a rib patch is a mountain; the sense of the first
    fold of a garter patch is the option ``garter_start``. Hinges that join different knits, or that
    are across the folds of their patch, are flat at rest. They exist only with the option
    ``hinges = "all"``; hinges within plain knit always exist.

    Args:
        pattern: the patches.
        sheet: the walls.
        options: model options.
        plain: stiffness of plain knit, required if the pattern has plain patches.

    Raises:
        BadPattern: if a single fold lies outside the pattern or between grid lines.
        ValueError: if the pattern has plain knit and ``plain`` is not given, or if its grid is not
            that of the options.
    """
    shape = mesh_shape(pattern, options.boundary)
    net = network(shape)
    if pattern.cells_per_period != options.cells_per_period:
        counts = f"{pattern.cells_per_period} and {options.cells_per_period}"
        raise ValueError(f"pattern and options have {counts} cells per period; make them equal")
    plain_cells = pattern.cells_of("plain")
    if plain is None and plain_cells.any():
        raise ValueError("the pattern has plain patches (P); give the stiffness of plain knit")
    after = net.hinge_cells
    before = (after - np.where(net.wale[:, None], [0, 1], [1, 0])) % pattern.grid
    cell_after = tuple(after.T)
    rib_senses, garter_senses = patch_senses(pattern, options)
    rib_factors, garter_factors = fold_stiffness_factors(pattern, options)
    single = _single_folds(pattern, net, options.boundary == "periodic")
    factor = np.where(net.wale, rib_factors[cell_after], garter_factors[cell_after])
    paper_cells = options.cells_per_period // CELLS_PER_PERIOD
    hinged = np.ones(len(net.wale), dtype=bool)
    if options.hinges == "fold_lines":
        in_rib = inside_runs(pattern.cells_of("rib"), shape.periodic)
        in_garter = inside_runs(pattern.cells_of("garter").T, shape.periodic).T
        in_plain = plain_cells[tuple(before.T)] & plain_cells[cell_after]
        in_patch = np.where(net.wale, in_rib[cell_after], in_garter[cell_after])
        hinged = in_patch | in_plain | ~np.isnan(single)
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
        fold_part=np.where(net.wale, rib_senses[cell_after], garter_senses[cell_after]),
        single_fold=single,
        # A single fold is one hinge on any grid; on a finer grid its edges are shorter.
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
    """Network and parameters of a patterned fabric of one pair of stripes.

    Args:
        pattern: the patches.
        weft: the rib stripe; for a pure stripe fabric, that stripe.
        warp: the garter stripe; for a pure stripe fabric, that stripe.
        sheet: the walls.
        options: model options.
        plain: stiffness of plain knit, if the pattern has any.
    """
    layout = fabric_layout(pattern, sheet, options, plain)
    return layout.net, layout.fabric(StripePair.of(weft, warp))


def _spring_cells(net: Network) -> Int[np.ndarray, "spring 2 2"]:
    """The two grid cells (y, x) beside every spring."""
    shape = net.shape
    # The lowest leftmost node of a spring has the indices of the cell above and right of it.
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
    # At an edge there is a cell only on one side.
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
        folded = wale & (across == line) & (fold.start <= along) & (along < fold.end)
        rest[folded] = fold.rest_fold
    return rest
