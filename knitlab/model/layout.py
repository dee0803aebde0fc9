"""The layout of a fabric: position and kind of every spring, hinge and fold, without parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from knitlab.model.array_library import array_library
from knitlab.model.fabric import Fabric
from knitlab.model.fold_lines import fold_stiffness_factors, inside_runs, model_ridge, patch_senses
from knitlab.model.network import Network, Spans, mesh_shape, network
from knitlab.model.pattern import CELLS_PER_PERIOD, PatchGrid
from knitlab.model.settings import ModelOptions, PlainKnit, Sheet
from knitlab.model.spring_law import SpringLaw, spring_law
from knitlab.model.stripe import cell_length
from knitlab.model.stripe_numbers import StripeNumbers, StripePair


@dataclass(frozen=True, eq=False)
class FabricLayout:
    """How the parameters of a patterned fabric follow from those of its stripes."""

    net: Network
    sheet: Sheet
    options: ModelOptions
    row_stripe: Int[np.ndarray, " grid_y"]  # number of the garter stripe
    column_stripe: Int[np.ndarray, " grid_x"]  # number of the rib stripe
    plain: PlainKnit | None
    plain_cells: Bool[np.ndarray, "grid_y grid_x"]  # which are of plain knit
    rib_cells: Bool[np.ndarray, "grid_y grid_x"]  # which are of rib
    garter_cells: Bool[np.ndarray, "grid_y grid_x"]  # which are of garter
    patch_fold: Float[np.ndarray, " hinge"]  # > 0 in a mountain, < 0 in a valley, 0 if flat at rest
    single_fold: Float[np.ndarray, " hinge"]  # rest angle of its single fold, or NaN [rad]
    stiffness_factor: Float[np.ndarray, " hinge"]  # on k_t, 0 if the model options omit the hinge

    @property
    def fold_sense(self) -> Float[np.ndarray, " hinge"]:
        """Sense of every hinge: > 0 in a mountain, < 0 in a valley, 0 if it is flat at rest."""
        return np.where(np.isnan(self.single_fold), self.patch_fold, np.sign(self.single_fold))

    def fabric(self, stripes: StripePair) -> Fabric:
        """The fabric of given stripes; differentiable, except by k_s where both are equal."""
        xp = array_library(stripes)
        net = self.net
        options = self.options
        sides = stripes.weft, stripes.warp

        in_cells = self._in_cells
        width, height = self._on_grid(*(cell_length(side, options) for side in sides))
        k_s = in_cells(*(side.k_s for side in sides))
        k_t = in_cells(*(side.k_t for side in sides))
        rest_fold = in_cells(*(model_ridge(options).rest_fold(side.theta_0) for side in sides))
        # Grid cells along a cell of the paper's grid.
        refinement = options.cells_per_period // CELLS_PER_PERIOD
        if options.hinge_stiffness == "per_length":
            # The length of an edge is that on the paper's grid.
            k_t = [k_t[0] * height[:, None] * refinement, k_t[1] * width * refinement]
        k_s, k_t = self._scaled_to_rows(stripes, (width, height), k_s, k_t)
        k_s = self._with_along(stripes, height[:, None] / width, k_s)
        if self.plain is not None:
            plain = self.plain
            shape = height[:, None] / width
            k_s[0] = xp.where(self.plain_cells, plain.plain_stretch_weft * shape, k_s[0])
            k_s[1] = xp.where(self.plain_cells, plain.plain_stretch_warp / shape, k_s[1])
            k_t[0] = xp.where(self.plain_cells, plain.plain_bend_weft * shape, k_t[0])
            k_t[1] = xp.where(self.plain_cells, plain.plain_bend_warp / shape, k_t[1])

        one, other = (tuple(cells.T) for cells in net.spring_cells.transpose(1, 0, 2))
        # A spring on the border of two cells has the mean of their stiffness.
        along = [(stiffness[one] + stiffness[other]) / 2 for stiffness in k_s]
        lengths = width[one[1]], height[one[0]]

        before, after = net.beside_hinges
        folds, (k_before, k_after) = (
            [xp.where(net.wale, values[0][cells], values[1][cells]) for cells in (before, after)]
            for values in (rest_fold, k_t)
        )
        fold = self.patch_fold * ((folds[0] + folds[1]) / 2)
        # A hinge between two cells is half a hinge of each cell in series.
        in_series = k_before * (2 * k_after / (k_before + k_after))
        return Fabric(
            rest_length=xp.select([net.weft, net.warp], lengths, xp.hypot(*lengths)),
            stretch_stiffness=xp.select([net.weft, net.warp], along, xp.minimum(*along)),
            rest_fold=xp.where(np.isnan(self.single_fold), fold, np.nan_to_num(self.single_fold)),
            fold_stiffness=self.stiffness_factor * in_series,
            z_max=np.asarray(self.sheet.z_max, float),
            # In proportion to the area of a node's cell.
            k_wall=np.asarray(self.sheet.k_wall / refinement**2, float),
            cell_x=width,
            cell_y=height,
            fold_angle=options.fold_angle,
            spring_law=self._spring_law(stripes, k_s, xp),
        )

    def _on_grid(self, weft: Any, warp: Any) -> tuple[Any, Any]:
        xp = array_library(weft, warp)
        columns = xp.reshape(xp.asarray(weft), -1)[self.column_stripe]
        return columns, xp.reshape(xp.asarray(warp), -1)[self.row_stripe]

    def _in_cells(self, weft: Any, warp: Any) -> list[Any]:
        columns, rows = self._on_grid(weft, warp)
        xp = array_library(columns, rows)
        cells = (len(rows), len(columns))
        return [xp.broadcast_to(columns, cells), xp.broadcast_to(rows[:, None], cells)]

    def _scaled_to_rows(
        self, stripes: StripePair, sides: tuple[Any, Any], k_s: list[Any], k_t: list[Any]
    ) -> tuple[list[Any], list[Any]]:
        """Stiffnesses across the ridges in the rows of the grid, scaled from given row widths."""
        both = (stripes.weft, stripes.warp)
        xp = array_library(stripes)
        (width, height) = sides
        if not any(given for each in both for given in each.row_widths):
            return k_s, k_t
        refinement = self.options.cells_per_period // CELLS_PER_PERIOD
        given = self._in_cells(*(_or_nan(each.row_widths) for each in both))
        for axis, row in enumerate((height[:, None], width)):
            known = ~np.isnan(given[axis])
            # Safe to differentiate where no width is given.
            own = np.where(known, given[axis], 1.0)
            factor = xp.where(known, row * refinement / own, 1.0)
            k_s[axis] = k_s[axis] * factor
            k_t[axis] = k_t[axis] * factor
        return k_s, k_t

    def _with_along(self, stripes: StripePair, shape: Any, k_s: list[Any]) -> list[Any]:
        """Stiffnesses with given ones along the ridges; ``shape`` is cell height over width."""
        both = (stripes.weft, stripes.warp)
        xp = array_library(stripes)
        if not any(stretch for each in both for stretch in each.stretches_along):
            return k_s
        of_rib, of_garter = self._in_cells(*(_or_nan(each.stretches_along) for each in both))
        weft = xp.where(self.garter_cells & ~np.isnan(of_garter), of_garter * shape, k_s[0])
        warp = xp.where(self.rib_cells & ~np.isnan(of_rib), of_rib / shape, k_s[1])
        return [weft, warp]

    def _spring_law(self, stripes: StripePair, k_s: list[Any], xp: Any) -> SpringLaw:
        """The law of every spring: that of its stripe, linear within plain knit."""
        net = self.net
        sides = (stripes.weft, stripes.warp)
        strains = [strain for side in sides for strain in _stiffening_strains(side)]
        curves = [curve for side in sides for curve in side.spring_curves]
        of_weft = len(stripes.weft.spring_curves)
        count = len(strains)
        # Laws across the ridges, then along them, then linear.
        strains += [None] * (count + 1)
        laws = spring_law(
            strains, [*curves, *(c for side in sides for c in side.curves_along), None]
        )
        own_rib, own_garter = (~np.isnan(_or_nan(side.stretches_along)) for side in sides)
        cells = net.spring_cells.transpose(1, 2, 0)
        plain = np.all([self.plain_cells[row, column] for row, column in cells], axis=0)

        def law_numbers(row: np.ndarray, column: np.ndarray) -> Any:
            rib = self.column_stripe[column]
            garter = of_weft + self.row_stripe[row]
            along_rib = self.rib_cells[row, column] & own_rib[rib]
            along_garter = self.garter_cells[row, column] & own_garter[garter - of_weft]
            weft = np.where(along_garter, count + garter, rib)
            warp = np.where(along_rib, count + rib, garter)
            softer = xp.where((k_s[0] <= k_s[1])[row, column], weft, warp)
            number = xp.select([net.weft, net.warp], [weft, warp], softer)
            return xp.where(plain, len(strains) - 1, number)

        one, other = (tuple(cell) for cell in cells)
        law = laws.of(law_numbers(*one))
        if law.rate is None or not (own_rib.any() or own_garter.any()):
            return law
        # A spring on the border of two knits is half a spring of each.
        halves = [xp.where(net.weft, k_s[0][cell], k_s[1][cell]) for cell in (one, other)]
        return law.mixed_with(laws.of(law_numbers(*other)), halves[1] / (halves[0] + halves[1]))


def _stiffening_strains(stripes: StripeNumbers) -> list[Float[Array | np.ndarray, ""] | None]:
    if stripes.stiffening_strain is None:
        return [None] * len(stripes.spring_curves)
    return list(stripes.stiffening_strain.reshape(-1))


def _or_nan(numbers: Sequence[float | None]) -> Float[np.ndarray, " stripe"]:
    return np.array([np.nan if number is None else number for number in numbers])


def fabric_layout(
    pattern: PatchGrid,
    sheet: Sheet,
    options: ModelOptions,
    plain: PlainKnit | None = None,
    spans: Spans | None = None,
) -> FabricLayout:
    """The springs, hinges and folds of a patterned fabric (paper, Sec. "3D model").

    Springs and hinges across the wales have the values of the rib stripe of their column, those
    across the courses of the garter stripe of their row, diagonals the smaller k_s; within plain
    knit all have its values. Hinges that join different knits, or that are across the folds of
    their patch, are flat at rest, and exist only with ``hinges = "all"`` or within plain knit.
    A shaped piece is the part of the fabric within its ``spans``. BadPattern is raised if a single
    fold lies outside the pattern or between grid lines.
    """
    if pattern.cells_per_period != options.cells_per_period:
        counts = f"{pattern.cells_per_period} and {options.cells_per_period}"
        raise ValueError(f"pattern and options have {counts} cells per period; make them equal")
    plain_cells = pattern.knit_cells("plain")
    if plain is None and plain_cells.any():
        raise ValueError("the pattern has plain patches (P); give the stiffness of plain knit")
    net = network(mesh_shape(pattern, options.boundary, spans))
    before, after = net.beside_hinges
    single = _single_folds(pattern, net)

    def knit_values(rib: np.ndarray, garter: np.ndarray) -> np.ndarray:
        return np.where(net.wale, rib[after], garter[after])

    factor = knit_values(*fold_stiffness_factors(pattern, options))
    # A single fold is one hinge on any grid; on a finer grid its edges are shorter.
    factor = np.where(np.isnan(single), factor, CELLS_PER_PERIOD / options.cells_per_period)
    if options.hinges == "fold_lines":
        in_rib = inside_runs(pattern.knit_cells("rib"), net.shape.periodic)
        in_garter = inside_runs(pattern.knit_cells("garter").T, net.shape.periodic).T
        in_plain = plain_cells[before] & plain_cells[after]
        factor = np.where(
            knit_values(in_rib, in_garter) | in_plain | ~np.isnan(single), factor, 0.0
        )
    return FabricLayout(
        net=net,
        sheet=sheet,
        options=options,
        row_stripe=pattern.row_stripe[pattern.patch_of_row],
        column_stripe=pattern.column_stripe[pattern.patch_of_column],
        plain=plain,
        plain_cells=plain_cells,
        rib_cells=pattern.knit_cells("rib"),
        garter_cells=pattern.knit_cells("garter"),
        patch_fold=knit_values(*patch_senses(pattern, options)),
        single_fold=single,
        stiffness_factor=factor,
    )


def _single_folds(pattern: PatchGrid, net: Network) -> Float[np.ndarray, " hinge"]:
    rest = np.full(len(net.wale), np.nan)
    (row, column) = net.hinge_cells.T
    (rows, columns) = pattern.grid
    for fold, line, start, end in pattern.grid_folds():
        wale = fold.along == "wale"
        across, along, count = (column, row, columns) if wale else (row, column, rows)
        on_line = across == (line % count if net.shape.periodic else line)
        rest[(net.wale == wale) & on_line & (start <= along) & (along < end)] = fold.rest_fold
    return rest
