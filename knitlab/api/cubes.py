"""Cubes: their designs in tables, compared with targets, experiments and claims, and exported."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr

from knitlab.cubes.case_file import length_unit
from knitlab.cubes.chosen_case import reached_strains, selected_case
from knitlab.cubes.comparison import compared
from knitlab.cubes.cube_file import is_case, open_cube
from knitlab.cubes.find import Found, find_designs
from knitlab.cubes.query import query_cubes
from knitlab.cubes.selection import refuse_others, selected, selections_along
from knitlab.cubes.target import Target, read_target
from knitlab.export.meshes import formats
from knitlab.export.meshes.fabric import fabric_meshes
from knitlab.export.meshes.surface import SurfaceMesh, solid_of
from knitlab.io.errors import ErrorCollector, invalid, raise_if_any, shortened
from knitlab.io.names import check_suffix
from knitlab.observables.schema import STRAIN

if TYPE_CHECKING:
    from knitlab.runs.material import Material

Cube = str | Path | xr.Dataset  # a cube, its file, or the results folder that holds it
Wanted = str | Mapping[str, Any] | Target  # as text, as the table of a curve, or as an object


def opened(cube: Cube, *, lazily: bool = False) -> xr.Dataset:
    """A cube, opened as by :func:`knitlab.open_cube` unless it is."""
    return open_cube(cube, lazily=lazily) if isinstance(cube, str | Path) else cube


def opened_with_shapes(shapes: Cube) -> xr.Dataset:
    """A cube that was read from a file, beside which its case files lie, or a test with shapes."""
    cube = opened(shapes)
    if "status" not in cube:
        raise invalid("shapes", "is not a cube or a test; give one of knitlab.run or simulate")
    if is_case(cube) and "position" not in cube:
        raise invalid("shapes", "has no node positions; give a dataset of knitlab.simulate")
    if not is_case(cube) and "source" not in cube.encoding:
        message = "is a cube that was not opened from a file, beside which shapes lie"
        raise invalid("shapes", f"{message}; give its path")
    return cube


def query(
    *cubes: Cube,
    where: str | None = None,
    sort: str | Sequence[str] | None = None,
    columns: Sequence[str] | None = None,
    **selections: Any,
) -> pd.DataFrame:
    """The designs of several cubes along the same dimensions, simulated and measured, in one table.

    The other arguments are those of ``cube.knitlab.query``.

    Raises:
        InputError: with everything that is wrong in these arguments.

    Example:
        >>> table = kl.query("results/reference/periodic", sort="poisson_ratio_min")
        >>> table[["n_stripe", "n_subunit"]].iloc[0].tolist()
        [8, 64]
    """
    read = [opened(cube, lazily=True) for cube in cubes]
    return query_cubes(read, selections, where, sort, columns)


def find(
    *cubes: Cube,
    targets: Wanted | Sequence[Wanted],
    subject_to: Wanted | Sequence[Wanted] = (),
    most: int | None = None,
    material: "str | Path | Material | None" = None,
    uncertainty_of: str | None = None,
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

    Returns:
        The designs, the nearest first, or with a material the most probable. For target 1
        ``table`` has ``value_1``, ``off_by_1`` in the unit of the variable, and ``in_spread_1``:
        whether the spread over a design's siblings covers it.

    Raises:
        InputError: with every target that cannot be read or is not of a variable of the cubes.

    Example:
        >>> wanted = ["poisson_ratio = -0.7 @ 0.05:0.25", "reaction_force < 2 @ 0.2"]
        >>> cube = "results/reference/periodic"
        >>> nearest = kl.find(cube, targets=wanted, subject_to="knit_cell_x < 50")
        >>> nearest.table[["n_stripe", "n_subunit"]].iloc[0].tolist()
        [4, 16]
    """
    wanted, required = _targets(targets, "target"), _targets(subject_to, "subject_to")
    stripes = None
    if uncertainty_of is not None and material is None:
        message = "is that of a material, but none is given; give the file with its covariances"
        raise invalid(f"uncertainty_of {shortened(uncertainty_of)}", message)
    if material is not None:
        from knitlab.runs.stripe_covariance import uncertain_stripes  # which imports JAX

        stripes = uncertain_stripes(material, uncertainty_of)
    read = [opened(cube, lazily=True) for cube in cubes]
    return find_designs(read, wanted, required, most, stripes)


def _targets(given: Wanted | Sequence[Wanted], source: str) -> list[Target]:
    mistakes, targets = ErrorCollector(), list[Target]()
    for one in [given] if isinstance(given, str | Mapping | Target) else given:
        with mistakes:
            targets.append(read_target(one, source))
    raise_if_any(mistakes.all)
    return targets


def compare(simulation: Cube, /, *experiments: Cube, **selections: Any) -> pd.DataFrame:
    """How far a simulation is from experiments, curve by curve.

    Args:
        simulation: a simulated cube.
        experiments: measured cubes, see :func:`knitlab.import_records`.
        selections: a value or a list of values for each coordinate.

    Returns:
        For each design, experiment and curve the RMS difference and its uncertainty, by the
        scatter of the records, in the unit of the curve.

    Raises:
        InputError: if the cubes have no design in common, or a selection is at fault.
    """
    cubes = [opened(cube) for cube in (simulation, *experiments)]
    known = {str(name) for cube in cubes for name in cube.dims if name in cube.coords}
    hint = f"select along {', '.join(sorted(known))}"
    refuse_others(selections, known, f"is not a coordinate of these cubes; {hint}")
    chosen = [selected(cube, selections_along(selections, cube.dims)) for cube in cubes]
    return compared(chosen[0], chosen[1:])


def claims(*cubes: str | Path, output: str | Path | None = None, **selections: Any) -> pd.DataFrame:
    """Judge the paper's claims by cubes: each holds, nearly holds, fails, or is not measured.

    Args:
        cubes: cubes or results folders; if several measure a claim, the one with the paper's
            samples decides it.
        output: report to write, ``.md``, with its figures in a folder beside it.
        selections: a value for each swept setting.

    Returns:
        One row for each claim, with its verdict, margin, and the cube that decided it.

    Raises:
        InputError: if a cube, a selection or the suffix of the page is at fault.

    Example:
        >>> len(kl.claims("results/reference/paper"))
        39
    """
    from knitlab.claims.claims import read_claims
    from knitlab.claims.judgement import judged, record

    judgements = judged(read_claims(), [Path(cube) for cube in cubes], selections)
    if output is not None:
        from knitlab.figures.claims_page import write_page

        write_page(judgements, Path(output), selections)
    return pd.DataFrame(map(record, judgements))


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

    return write_explorer([opened(cube) for cube in cubes], Path(output))


@dataclass(frozen=True, eq=False)
class Exported:
    """What was exported.

    Attributes:
        files: the files, the one that was asked for first.
        applied_strain: the strains of the meshes [1].
        meshes: at each, the mesh: ``nodes``, ``faces``, ``node_fields``, ``face_fields``.
        self_intersections: at each, pairs of grid cells of a sample, or of one repeat, that pass
            through each other [1].
        unit: of the nodes: mm of cloth, or ``mm of network`` where the gauge says nothing.
    """

    files: tuple[Path, ...]
    applied_strain: tuple[float, ...]
    meshes: tuple[SurfaceMesh, ...]
    self_intersections: tuple[int, ...]
    unit: str = "mm"

    def __repr__(self) -> str:
        nodes = sum(len(mesh.nodes) for mesh in self.meshes)
        return f"<Exported {self.files[0]}: {len(self.meshes)} meshes, {nodes} nodes>"


def export(
    shapes: Cube,
    output: str | Path,
    selections: Mapping[str, Any] = {},
    *,
    repeats: tuple[int, int] = (1, 1),
    triangles: bool = False,
    thickness: float | None = None,
    **named: Any,
) -> Exported:
    """Write the shape of one design as a mesh that other programs read.

    The mesh is the sheet of grid cells in mm, x along the courses and y along the wales, with the
    technical face up. Faces that meet share their nodes, over the seams of repeats too.

    Args:
        shapes: dataset of :func:`knitlab.simulate`, or a cube with its case files beside it.
        output: file to write: ``.vtu``, ``.ply``, ``.obj``, ``.stl`` or ``.glb``; a series
            over the applied strain is ``.pvd``, with a ``.vtu`` for each in a folder beside it, or
            ``.fold``, with a frame for each and its fold angles.
        selections: a value for each coordinate, until one design is left. ``applied_strain`` is 0
            if it is left out, of a series every strain that was reached.
        repeats: how often periodic fabric is repeated along the warp (y) and the weft (x).
        triangles: whether to divide grid cells into triangles where the format has quads too.
        thickness: of a closed solid with the sheet in its middle [mm]; by default an open sheet.
        named: further selections, as keywords: ``n_stripe=4``.

    Returns:
        The files and their meshes.

    Raises:
        InputError: if the suffix is unknown, not exactly one design is left, it has no shape at a
            strain, or repeats or thickness do not fit it.

    Example:
        >>> one = {"n_stripe": 4, "n_subunit": 16, "applied_strain": 0.15}
        >>> exported = kl.export("results/reference/periodic", folder / "shape.vtu", one)
        >>> len(exported.meshes[0].faces)
        256
    """
    output, selections = Path(output), {**selections, **named}
    check_suffix(output, formats.FORMATS, "a mesh")
    chosen = formats.FORMATS[output.suffix.lower()]
    case_file = selected_case(opened_with_shapes(shapes), selections)
    rows = reached_strains(case_file, selections, several=chosen.is_series)
    meshes = fabric_meshes(case_file, rows, repeats)
    if thickness is not None:
        meshes = [solid_of(mesh, thickness) for mesh in meshes]
    if triangles or not chosen.has_quads:
        meshes = [mesh.triangulated() for mesh in meshes]
    strains, unit = tuple(case_file[STRAIN].values[rows].tolist()), length_unit(case_file)
    files = formats.write_meshes(formats.Shapes(meshes, strains, unit), output)
    crossing = case_file["self_intersections"].values[rows].astype(int).tolist()
    return Exported(tuple(files), strains, tuple(meshes), tuple(crossing), unit)
