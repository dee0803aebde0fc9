"""Cubes: their designs in tables, compared with targets, experiments and claims, and drawn."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pandas as pd
import xarray as xr

from knitlab.cubes.comparison import compared
from knitlab.cubes.cube_file import open_cube
from knitlab.cubes.derived import with_derived
from knitlab.cubes.find import Found, find_designs
from knitlab.cubes.model_line import model_lines
from knitlab.cubes.normalised import naming_missing, normalised
from knitlab.cubes.query import formatted as formatted
from knitlab.cubes.query import query_cubes, variables_table
from knitlab.cubes.selection import refuse_others, select, selections_along
from knitlab.cubes.target import Target, read_target
from knitlab.io.errors import ErrorCollector, Mistake, invalid, raise_if_any, shortened
from knitlab.io.names import check_suffix
from knitlab.runs.figure_names import check_figure_suffix

if TYPE_CHECKING:
    from knitlab.runs.material import Material

Cube = str | Path | xr.Dataset  # a cube, its file, or the results folder that holds it
Wanted = str | Mapping[str, Any] | Target  # as text, as the table of a curve, or as an object


def as_cube(cube: Cube, *, lazily: bool = False) -> xr.Dataset:
    """A cube, opened as by :func:`knitlab.open_cube`, or one in memory in the same form."""
    if isinstance(cube, str | Path):
        return open_cube(cube, lazily=lazily)
    return with_derived(normalised(cube))


def models(*cubes: Cube) -> list[str]:
    """The lines that state the models of cubes: one if they agree, else one for each cube."""
    return model_lines([as_cube(cube, lazily=True) for cube in cubes])


def query(
    *cubes: Cube,
    where: str | None = None,
    sort: str | Sequence[str] | None = None,
    columns: str | Sequence[str] | None = None,
    marks: bool = False,
    selections: Mapping[str, Any] = {},
    **named: Any,
) -> pd.DataFrame:
    """The designs of several cubes along the same dimensions, simulated and measured, in one table.

    Args:
        cubes: cubes, their files or results folders.
        where: expression over the columns that the rows must meet, as of ``cube.knitlab.query``.
        sort: column to sort by, or several; a leading minus sorts descending.
        columns: columns to keep, or expressions over them, as a list or separated by commas; or
            ``"main"`` for the at most eight that answer most questions.
        marks: whether a last column has the signs of what not to rely on, if there are any.
        selections: a value or a list of values for each coordinate.
        named: further selections, as keywords: ``n_stripe=4``.

    Raises:
        InputError: with everything that is wrong in these arguments.

    Example:
        >>> table = kl.query("results/reference/periodic", sort="poisson_ratio_min")
        >>> table[["n_stripe", "n_subunit"]].iloc[0].tolist()
        [8, 64]
    """
    read = [as_cube(cube, lazily=True) for cube in cubes]
    return query_cubes(read, {**selections, **named}, where, sort, columns, marks)


def variables(*cubes: Cube) -> pd.DataFrame:
    """The variables of cubes that can be asked for: name, dimensions, unit and meaning.

    Example:
        >>> table = kl.variables("results/reference/periodic").set_index("name")
        >>> table.loc["reaction_force", "unit"]
        'N'
    """
    return variables_table([as_cube(cube, lazily=True) for cube in cubes])


def find(
    *cubes: Cube,
    targets: Wanted | Sequence[Wanted],
    subject_to: Wanted | Sequence[Wanted] = (),
    most: int | None = None,
    material: "str | Path | Material | None" = None,
    uncertainty_of: str | None = None,
    output: str | Path | None = None,
) -> Found:
    """Find the designs that come closest to targets; nothing is simulated.

    A target is a variable, a relation and a number: ``"knit_cell_x < 20"``. A variable along the
    applied strain needs a strain or a window: ``"poisson_ratio = -0.7 @ 0.05:0.25"`` applies to
    every strain of the window, ``"mean(poisson_ratio) = -0.3 @ 0.05:0.25"`` to the mean over it;
    ``min``, ``max``, ``slope``, ``linearity`` and ``spread`` (largest minus smallest) likewise.
    ``± 0.02`` is the tolerance, the unit of distance; by default the scatter among the designs.

    Args:
        cubes: cubes of designs along the same dimensions.
        targets: targets. A curve is ``"poisson_ratio = wanted.csv"``, with the columns
            ``strain`` and ``poisson_ratio``, or a table with the keys ``name``,
            ``applied_strain``, ``value`` and ``tolerance``.
        subject_to: targets that must be met; designs that do not are left out.
        most: largest number of designs to return, all by default.
        material: material with the covariances of its stripes, to rank by the probability that a
            design meets all targets and ``subject_to``, of cubes with sensitivities. What has no
            sensitivities counts as exact; a single value needs a tolerance.
        uncertainty_of: whether this is the probability of a new ``"swatch"`` or of the ``"mean"``
            stripe, as of :func:`knitlab.uncertainty`; ``uncertainty`` of the result says it.
        output: figure to write, of the targets and the nearest designs, if there are any.

    Returns:
        The designs, the nearest first, or with a material the most probable. For target 1
        ``table`` has ``value_1``, ``off_by_1`` in the unit of the variable, and ``in_spread_1``:
        whether the spread over a design's perturbed copies covers it.

    Raises:
        InputError: with every target that cannot be read or names no variable of the cubes.

    Example:
        >>> wanted = ["poisson_ratio = -0.7 @ 0.05:0.25", "reaction_force < 2 @ 0.2"]
        >>> cube = "results/reference/periodic"
        >>> nearest = kl.find(cube, targets=wanted, subject_to="knit_cell_x < 50")
        >>> nearest.table[["n_stripe", "n_subunit"]].iloc[0].tolist()
        [4, 16]
    """
    check_figure_suffix(output)
    wanted = _targets(targets, "target")
    required = _targets(subject_to, "subject_to")
    stripes = None
    if uncertainty_of is not None and material is None:
        message = "needs a material; give the file with its covariances"
        raise invalid(f"uncertainty_of {shortened(uncertainty_of)}", message)
    if material is not None:
        from knitlab.runs.stripe_covariance import uncertain_stripes  # which imports JAX

        stripes = uncertain_stripes(material, uncertainty_of)
    read = [as_cube(cube, lazily=True) for cube in cubes]
    found = find_designs(read, wanted, required, most, stripes)
    if output is not None and len(found.table):
        from knitlab.figures.figure_files import draw_into
        from knitlab.figures.nearest_designs import nearest_figure

        draw_into(lambda: nearest_figure(found), Path(output))
    return found


def _targets(given: Wanted | Sequence[Wanted], source: str) -> list[Target]:
    mistakes = ErrorCollector()
    targets = list[Target]()
    for one in [given] if isinstance(given, str | Mapping | Target) else given:
        with mistakes:
            targets.append(read_target(one, source))
    raise_if_any(mistakes.all)
    return targets


def compare(
    cube: Cube, /, *experiments: Cube, selections: Mapping[str, Any] = {}, **named: Any
) -> pd.DataFrame:
    """How far a simulation is from experiments, curve by curve.

    Args:
        cube: a simulated cube.
        experiments: measured cubes, see :func:`knitlab.import_records`.
        selections: a value or a list of values for each coordinate.
        named: further selections, as keywords: ``n_stripe=4``.

    Returns:
        For each design, experiment and curve the RMS difference and its uncertainty, by the
        scatter of the records, in the unit of the curve.

    Raises:
        InputError: if the cubes have no design in common, or a selection is invalid.
    """
    selections = {**selections, **named}
    cubes = [as_cube(each) for each in (cube, *experiments)]
    known = {str(name) for each in cubes for name in each.dims if name in each.coords}
    hint = f"select along {', '.join(sorted(known))}"
    refuse_others(selections, known, f"is not a coordinate of these cubes; {hint}")
    chosen = [select(each, selections_along(selections, each.dims)) for each in cubes]
    with naming_missing("comparisons", cubes):
        return compared(chosen[0], chosen[1:])


def claims(
    *cubes: str | Path,
    output: str | Path | None = None,
    selections: Mapping[str, Any] = {},
    **named: Any,
) -> pd.DataFrame:
    """Judge the paper's claims by cubes: each holds, nearly holds, fails, or is not measured.

    Args:
        cubes: cubes or results folders; if several measure a claim, the one with the paper's
            samples decides it.
        output: report to write, ``.md``, with its figures in a folder beside it.
        selections: a value for each swept setting.
        named: further selections, as keywords.

    Returns:
        One row for each claim, with its verdict, margin, and the cube that decided it.

    Raises:
        InputError: if a cube, a selection or the suffix of the page is invalid.

    Example:
        >>> len(kl.claims("results/reference/paper"))
        39
    """
    return judge_claims(cubes, output, {**selections, **named}).table


class JudgedClaims(NamedTuple):
    """The claims as a table and as lines of text, the files written, and figures left out."""

    table: pd.DataFrame
    lines: str
    files: list[Path]
    mistakes: list[Mistake]


def judge_claims(
    cubes: Sequence[str | Path], output: str | Path | None, selections: Mapping[str, Any]
) -> JudgedClaims:
    """Judge the paper's claims by cubes, as :func:`claims`."""
    from knitlab.claims.claims import read_claims
    from knitlab.claims.judgement import judged, listed, record

    if output is not None:
        check_suffix(Path(output), (".md",), "a page of Markdown")
    judgements = judged(read_claims(), [Path(cube) for cube in cubes], selections)
    files = list[Path]()
    mistakes = list[Mistake]()
    if output is not None:
        from knitlab.figures.claims_page import write_page

        files, mistakes = write_page(judgements, Path(output), selections)
    return JudgedClaims(pd.DataFrame(map(record, judgements)), listed(judgements), files, mistakes)


def draw(
    kind: str,
    *cubes: str | Path,
    output: str | Path,
    selections: Mapping[str, Any] = {},
    **options: str | Path | None,
) -> Path:
    """Draw a figure of cubes into a file, unless it is up to date.

    The functions of :mod:`knitlab.plot` return figures instead.

    Args:
        kind: name of the figure, one of those of :mod:`knitlab.plot`.
        cubes: cubes or results folders; most kinds take one.
        output: the file: ``.pdf``, ``.svg`` or ``.png``.
        selections: a value or a list of values for each coordinate.
        options: options of the kind, such as ``x`` and ``y``, names of dimensions.

    Raises:
        InputError: if a cube does not hold what the figure shows, or an argument is invalid.

    Example:
        >>> kl.draw("auxetic", "results/reference/periodic", output=folder / "map.png").name
        'map.png'
    """
    from knitlab.figures.drawing import draw_figure

    given = {name: str(value) for name, value in options.items() if value is not None}
    paths = [Path(cube) for cube in cubes]
    return draw_figure(kind, paths, Path(output), selections, given)


def explore(*cubes: Cube, output: str | Path = "explorer.html") -> Path:
    """Write a page on which cubes can be explored in a browser, without a network.

    It shows a design map, the curves of a design with their bands, its shape, which turns and is
    pulled, and the report of the run. Shapes come from the case files beside the file of a cube,
    figures from its results folder. Positions are rounded to less than a thousandth of the extent
    of a shape, other numbers to 6 digits. Of samples with more than 4096 nodes the central unit
    cells are shown.

    Args:
        cubes: cubes, or the results folders that hold them.
        output: the page, with the suffix ``.html``.

    Raises:
        InputError: if there is no cube, one cannot be read, or the suffix is another one.
        CannotWrite: if the page cannot be written.

    Example:
        >>> kl.explore("results/reference/periodic", output=folder / "explorer.html").name
        'explorer.html'
    """
    from knitlab.figures.explorer.explorer import write_explorer

    return write_explorer([as_cube(cube) for cube in cubes], Path(output))
