"""Shapes and plates for other programs: meshes, and stiffness as a shell."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr

from knitlab.api.cubes import Cube, as_cube
from knitlab.api.renamed import renamed
from knitlab.cubes.case_file import length_unit
from knitlab.cubes.chosen_case import reached_strains, selected_case
from knitlab.export.meshes import formats
from knitlab.export.meshes.fabric import fabric_meshes
from knitlab.export.meshes.surface import SurfaceMesh, solid_of
from knitlab.io.errors import invalid
from knitlab.io.names import check_suffix
from knitlab.model.computing import computing
from knitlab.observables.schema import STRAIN
from knitlab.runs.figure_names import FIGURE_SUFFIXES

if TYPE_CHECKING:
    from knitlab.export.laws.law import Law


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


@computing()
@renamed(shapes="cube")
def export(
    cube: Cube,
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
        cube: dataset of :func:`knitlab.simulate`, or a cube with its case files beside it.
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
    output = Path(output)
    selections = {**selections, **named}
    check_suffix(output, formats.FORMATS, "a mesh")
    chosen = formats.FORMATS[output.suffix.lower()]
    case_file = selected_case(as_cube(cube), selections)
    rows = reached_strains(case_file, selections, several=chosen.is_series)
    meshes = fabric_meshes(case_file, rows, repeats)
    if thickness is not None:
        meshes = [solid_of(mesh, thickness) for mesh in meshes]
    if triangles or not chosen.has_quads:
        meshes = [mesh.triangulated() for mesh in meshes]
    strains = tuple(case_file[STRAIN].values[rows].tolist())
    unit = length_unit(case_file)
    files = chosen.write(formats.Shapes(meshes, strains, unit), output)
    crossing = case_file["self_intersections"].values[rows].astype(int).tolist()
    return Exported(tuple(files), strains, tuple(meshes), tuple(crossing), unit)


@computing()
@renamed(shapes="cube")
def plate_stiffness(
    cube: Cube,
    output: str | Path | None = None,
    selections: Mapping[str, Any] = {},
    *,
    where: str | None = None,
    **named: Any,
) -> xr.Dataset:
    """The stiffness of periodic fabric as a plate, at every state: membrane, coupling, bending.

    To first order from a state, forces over width are N = N0 + A e + B κ and moments
    M = M0 + Bᵀ e + D κ, with strain and curvature in the order xx, yy, 2 xy. x is along the courses
    (weft), y along the wales (warp), which tests pull by default, and z to the technical face.
    Curvature is positive where the side at +z gets longer. The nodes of one unit cell are condensed
    out; ``docs/explanation/plate.md`` says what the forces in a state add. Lengths are in mm of
    cloth where the gauge says how long that is.

    Args:
        cube: a cube with its case files beside it, or a test of :func:`knitlab.simulate`.
        output: file to write: ``.csv`` a table, ``.json`` all states, ``.inp`` one state as
            ``*SHELL GENERAL SECTION`` of Abaqus.
        selections: a value or a list of values for each coordinate.
        where: condition on the designs, as of :func:`knitlab.query`.
        named: further selections, as keywords: ``n_stripe=4``.

    Returns:
        ``membrane_stiffness`` A, ``coupling_stiffness`` B and ``bending_stiffness`` D along ``row``
        and ``column``, ``membrane_force`` N0 and ``moment`` M0 along ``row``; ``modulus_x``,
        ``poisson_ratio_y`` and others that follow from A; and ``plate_status`` of every state: ok,
        singular, negative (of these numbers are known), unstable, not_converged or no_shape.

    Raises:
        InputError: if no design that is left has a periodic shape, a design is a clamped sample, a
            selection or the suffix is invalid, or a card asks for a state that is not ok.

    Example:
        >>> one = {"n_stripe": 4, "n_subunit": 16, "applied_strain": [0.06, 0.15]}
        >>> plates = kl.plate_stiffness("results/reference/periodic", selections=one)
        >>> plates["poisson_ratio_y"].values.round(2).ravel().tolist()
        [-0.8, -0.71]
    """
    # They import JAX.
    from knitlab.export.plates.plate_stiffness import design_plates
    from knitlab.export.plates.shell_cards import CARDS

    selections = {**selections, **named}
    if output is not None:
        check_suffix(output := Path(output), CARDS, "a card or table")
    plates = design_plates(as_cube(cube), selections, where)
    if output is not None:
        CARDS[output.suffix.lower()](plates, output)
    return plates


@computing()
def law(
    cube: Cube,
    output: str | Path | None = None,
    selections: Mapping[str, Any] = {},
    **named: Any,
) -> "Law":
    """The law of a cloth: an energy density of a membrane, fitted to all tests of one fabric.

    The energy is a sum of convex functions of one combination of strains each, with weights by
    least squares that are not negative: it is stable at every strain. Forces are its exact
    derivatives. If the cube has its case files, the energy of curvature is that of the plate.

    Args:
        cube: tests of periodic fabric: pulled at several angles or both ways, sheared; the workflow
            ``law`` runs them.
        output: file to write: ``.py`` functions for NumPy and JAX without knitlab, ``.csv`` stress
            over strains, or a figure.
        selections: a value for each coordinate but those of loads, until one design is left.
        named: further selections, as keywords: ``n_stripe=4``.

    Returns:
        The law: its ``energy``, ``stress`` and ``tangent`` at any strains, which strains it
        ``covers``, and its ``errors`` at every test, also if this test is left out.

    Raises:
        InputError: if several designs are left, they are clamped samples, or tests are too few.

    Example:
        >>> law = kl.law("results/reference/law")
        >>> law.stress([0.0, 0.1, 0.0])[:2].round(4).tolist()
        [-0.0048, 0.0141]
        >>> bool(law.covers([0.05, 0.1, 0.0]))
        True
    """
    from knitlab.export.laws.law import law_of
    from knitlab.export.laws.law_files import FORMATS
    from knitlab.export.laws.strain_tests import rows_of_tests

    if output is not None:
        check_suffix(output := Path(output), (*FORMATS, *FIGURE_SUFFIXES), "a law or a figure")
    opened = as_cube(cube)
    fitted = law_of(opened, rows_of_tests(opened, {**selections, **named}))
    if output is None:
        return fitted
    if output.suffix.lower() in FORMATS:
        fitted.write(output)
    else:
        from knitlab.figures.figure_files import draw_into
        from knitlab.figures.law import law_figure

        draw_into(lambda: law_figure(fitted), output)
    return fitted


@computing()
def wear(
    cube: Cube,
    limb: str | Path,
    selections: Mapping[str, Any] = {},
    *,
    needles: int | None = None,
    pressure: float | None = None,
    compression_class: str | None = None,
    length_ratio: float | None = None,
    thickness: float | None = None,
    sensor: Cube | None = None,
    **named: Any,
) -> pd.DataFrame:
    """Stretch, tension and pressure of a sleeve on a limb, by the law of its fabric.

    The sleeve is knitted in the round, with courses around the limb. The middle of the folded cloth
    lies half its thickness above the skin. Pressure follows from the tension and the circumference
    (Laplace's law), each height on its own: the taper and the curvature along the limb, friction on
    the skin and the softness of the limb are left out.

    Args:
        cube: tests of periodic fabric, as of :func:`knitlab.law`.
        limb: a table of ``height [mm]`` and ``circumference [mm]``.
        selections: a value for each coordinate but those of loads, until one design is left.
        needles: needles around, or
        pressure: pressure at the narrowest place [mmHg], for which needles of whole unit cells are
            found, or
        compression_class: a class of ``params/compression.toml``, such as ``"ral-1"``, whose middle
            is that pressure.
        length_ratio: length along the limb over the relaxed one; by default no force acts there.
        thickness: of the folded cloth [mm], by default that of its relaxed shape.
        sensor: a test or cube of the same design with electrodes, pulled along the courses, with
            the wales held if ``length_ratio`` is given.
        named: further selections, as keywords: ``n_stripe=4``.

    Returns:
        At every height ``stretch`` around [1], ``length_ratio`` [1], ``tension`` [N/mm],
        ``pressure`` [kPa] and [mmHg] with its ``error``, and whether the strain lies ``between``
        those that were tested; with a class, whether the pressure is ``in_class``; with a sensor
        its ``capacitance``, the change of that from the relaxed sleeve, and its slope by the
        stretch [pF]. ``attrs["needles"]`` are those of the sleeve, and ``attrs["class"]`` says what
        of a class is reached.

    Raises:
        InputError: as of :func:`knitlab.law`; if the limb cannot be read, not exactly one of
            ``needles``, ``pressure`` and ``compression_class`` is given, the cube has no shape and
            ``thickness`` is not given, or the sensor is of another design.

    Example:
        >>> sleeve = kl.wear("results/reference/law", "docs/examples/arm.csv", pressure=2)
        >>> sleeve.attrs["needles"]
        224
    """
    from knitlab.export.laws.compression import compression_class as class_of
    from knitlab.export.laws.law import law_of
    from knitlab.export.laws.sleeve import knit_of, needles_for, read_limb, thickness_of, worn
    from knitlab.export.laws.strain_tests import rows_of_tests
    from knitlab.export.laws.worn_sensor import add_readings, sensor_of

    if [needles, pressure, compression_class].count(None) != 2:
        message = "need exactly one value between them; give one"
        raise invalid("needles, pressure, compression_class", message)
    if thickness is not None and not thickness >= 0:
        raise invalid("thickness", f"is {thickness:g} mm; give 0 or more")
    wanted = None if compression_class is None else class_of(compression_class)
    opened, shape = as_cube(cube), read_limb(Path(limb))
    selections = {**selections, **named}
    rows = rows_of_tests(opened, selections)
    design = rows.isel(test=0)
    test = None if sensor is None else sensor_of(as_cube(sensor), design, selections, length_ratio)
    if thickness is None:
        thickness = thickness_of(opened, design)
    knit = knit_of(law_of(opened, rows), design, thickness)
    if needles is None:
        aim = wanted.middle if wanted else float(pressure or 0)
        needles = needles_for(knit, shape, aim, length_ratio)
    table = worn(knit, shape, needles, length_ratio)
    table.attrs["needles"] = needles
    if wanted:
        table.attrs["class"] = wanted.judge(table)
    if test is not None:
        add_readings(table, test)
    return table


def plates_table(plates: xr.Dataset, *, main: bool = False) -> pd.DataFrame:
    """The states of :func:`plate_stiffness` that have a shape as rows; or ``main`` columns only."""
    from knitlab.export.plates import shell_cards

    table = shell_cards.plates_table(plates)
    if not main:
        return table
    labels = list(table.columns[: list(table.columns).index("status") + 1])
    return table[[*labels, *shell_cards.MAIN_COLUMNS]]
