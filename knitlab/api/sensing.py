"""Sensors: the capacitances of several electrodes, cross-talk, and what moves a reading."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd
import xarray as xr

from knitlab.api.cubes import Cube, as_cube
from knitlab.api.renamed import renamed
from knitlab.cubes.case_file import network_configurations
from knitlab.cubes.chosen_case import for_each_design, reached_strains, selected_case
from knitlab.cubes.cube_file import is_case
from knitlab.cubes.query import with_marks
from knitlab.cubes.recorded_case import recorded_case
from knitlab.cubes.selection import selections_along
from knitlab.cubes.trust import marks_of_rows
from knitlab.figures.figure_files import maybe_draw
from knitlab.figures.sensing import cross_talk_figure, matrix_figure, selectivity_figure
from knitlab.io.errors import invalid
from knitlab.io.names import as_texts
from knitlab.io.progress import Progress
from knitlab.model.computing import computing
from knitlab.model.electrodes import Capacitor
from knitlab.model.fabric import Configuration
from knitlab.observables.schema import STRAIN, described
from knitlab.runs.figure_names import check_figure_suffix
from knitlab.sensors import selectivity as core
from knitlab.sensors.crosstalk import cross_talk as cross_talk_of
from knitlab.sensors.electrode_set import ElectrodeSet, electrode_set, sensor_case
from knitlab.sensors.readings import Others, capacitance_matrices
from knitlab.sensors.selectivity import DIRECTIONS, STATUS, case_selectivity
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.adjoint import NoDerivative


@computing()
@renamed(shapes="cube")
def capacitance_matrix(
    cube: Cube,
    electrodes: Sequence[str] = (),
    selections: Mapping[str, Any] = {},
    *,
    cloth_permittivity: float = 1.0,
    cloth_thickness: float = 0.5,
    output: str | Path | None = None,
    **named: Any,
) -> xr.Dataset:
    """Maxwell's capacitance matrix of several electrodes on the fabric of one design.

    The charge of electrode i is Σ C_ij V_j. Electrodes are ridges on the face of the layout,
    counted in the whole fabric: ``"w2"`` is the second along a wale, ``"c1"`` the first along a
    course, ``"w1+w3"`` two that are connected, ``"0:4/2:6"`` columns 0 to 4 and rows 2 to 6 of the
    grid. Those along wales cross those along courses on a sample only, with an insulation,
    ``dielectric_thickness``. Width, ground plane, insulation and permittivity are those of the
    capacitor that was simulated. Of periodic fabric, values are of electrodes of its
    ``electrode_length``; without a ground plane, charges sum to zero.

    The cloth may polarise along itself, as a thin sheet; between layers that face each other it
    counts as air. ``permittivity`` of the capacitor fills all space instead, an upper bound.

    Args:
        cube: a cube with its case files beside it, or a test of :func:`knitlab.simulate`.
        electrodes: their names; by default every ridge of the layout's direction and face.
        selections: a value for each coordinate of a cube, that leave one design; strains.
        cloth_permittivity: relative permittivity of the cloth over that of what surrounds it [1].
        cloth_thickness: of the sheet that has it [mm of the network].
        output: figure to write, of the first state.
        named: further selections, as keywords: ``n_stripe=4``.

    Returns:
        ``capacitance`` (applied_strain, electrode, to) [pF], without leads. It is missing where
        electrodes touch.

    Raises:
        InputError: if there is no single design with electrodes and a shape, or a name, a number or
            a selection is invalid.

    Example:
        >>> one = {"n_stripe": 4, "n_subunit": 16, "applied_strain": 0.1}
        >>> found = kl.capacitance_matrix("results/reference/sensor", ["w1", "w2"], one)
        >>> found["capacitance"].sel(electrode="w1", to="w2").values.round(3).tolist()
        [-2.018]
    """
    check_figure_suffix(output)
    case, capacitor, states, strains, relaxed = _states(cube, {**selections, **named})
    polarised = _polarised(cloth_permittivity, cloth_thickness, capacitor)
    used = electrode_set(case, capacitor, as_texts(electrodes))
    with Progress("capacitances"):
        matrices = capacitance_matrices(used, states, capacitor, polarised)
    names = list(used.names)
    scaled = matrices * _lengthened(used, relaxed, capacitor)
    coordinates = {STRAIN: strains, "electrode": names, "to": names}
    table = described(xr.Dataset(coords=coordinates, attrs={"design": case.label}))
    about = {"units": "pF", "long_name": "capacitance matrix"}
    table["capacitance"] = (STRAIN, "electrode", "to"), scaled, about
    return maybe_draw(matrix_figure, table, output)


@computing()
@renamed(shapes="cube")
def cross_talk(
    cube: Cube,
    sensors: Sequence[tuple[str, str]],
    selections: Mapping[str, Any] = {},
    *,
    pull: str = "weft",
    others: Others = "floating",
    cloth_permittivity: float = 1.0,
    cloth_thickness: float = 0.5,
    output: str | Path | None = None,
    **named: Any,
) -> xr.Dataset:
    """What each of several sensors reads while the cloth is pulled at one of them alone.

    A sensor is read between its two electrodes, named as in :func:`capacitance_matrix`. The part of
    the relaxed cloth that a sensor covers, or where its electrodes cross, is pulled by its two
    sides; the rest of the cloth is free and follows. Readings change by the shape as well as by
    charges on other electrodes.

    Args:
        cube: a cube with its case files beside it, or a test of :func:`knitlab.simulate`.
        sensors: pairs of electrodes.
        selections: a value for each coordinate of a cube, that leave one design.
        pull: direction of the pull, ``"weft"`` or ``"warp"``.
        others: whether electrodes that are not read float, without charge, or are ``"grounded"``,
            so that the meter shows the mutual capacitance of the two.
        cloth_permittivity: relative permittivity of the cloth over that of what surrounds it [1].
        cloth_thickness: of the sheet that has it [mm of the network].
        output: figure to write.
        named: further selections, as keywords: ``n_stripe=4``.

    Returns:
        Along ``sensor``: its ``reading`` [pF], and along ``pulled`` too: ``gauge_factor``, the
        change of the logarithm of the reading over the mean strain of the pulled part [1];
        ``cross_talk``, that over the gauge factor of the sensor when it is pulled itself [1];
        ``strain`` of the sensor over that of the pulled one [1]; ``coupling``, the largest
        capacitance between electrodes of the two over the reading [1].

    Raises:
        InputError: as :func:`capacitance_matrix`; or if the relaxed state is not a stable
            equilibrium.

    Example:
        >>> found = kl.cross_talk(
        ...     "results/reference/sensor", [("w1", "w2"), ("w3", "w4")], n_stripe=4, n_subunit=16
        ... )
        >>> bool(abs(found["cross_talk"][0, 1]) < 0.1)
        True
    """
    check_figure_suffix(output)
    if pull not in DIRECTIONS:
        raise invalid("pull", f"is {pull!r}; give {' or '.join(DIRECTIONS)}")
    if others not in get_args(Others):
        raise invalid("others", f"are {others!r}; give {' or '.join(get_args(Others))}")
    if not sensors or any(len(pair) != 2 for pair in sensors):
        raise invalid("sensors", f"are {list(sensors)}; give pairs of electrodes, as (w1, w2)")
    case, capacitor, states, strains, relaxed = _states(cube, {**selections, **named})
    if len(strains) > 1 or strains[0] != 0:
        raise invalid(STRAIN, "is always 0 here, as parts are pulled alone; select no strain")
    polarised = _polarised(cloth_permittivity, cloth_thickness, capacitor)
    names = list(dict.fromkeys(name for pair in sensors for name in pair))
    used = electrode_set(case, capacitor, names)
    pairs = [(names.index(one), names.index(other)) for one, other in sensors]
    axis = DIRECTIONS.index(pull)
    try:
        with Progress("capacitances"):
            table = cross_talk_of(case, states[0], used, pairs, capacitor, axis, others, polarised)
    except NoDerivative as message:
        hint = "take a design that relaxes to one shape"
        raise invalid(case.label, f"{message}; {hint}") from message
    labels = ["-".join(pair) for pair in sensors]
    table["reading"].values *= _lengthened(used, relaxed, capacitor)
    table = table.assign_coords(sensor=labels, pulled=labels)
    table.attrs |= {"design": case.label, "pull": pull, "others": others}
    return maybe_draw(cross_talk_figure, table, output)


@computing()
@renamed(shapes="cube")
def selectivity(
    cube: Cube,
    output: str | Path | None = None,
    selections: Mapping[str, Any] = {},
    *,
    along: str = "warp",
    where: str | None = None,
    **named: Any,
) -> xr.Dataset:
    """What a knitted capacitor reads of strain along and across it, and of bending.

    Gauge factors are derivatives of ln C by small strains and curvatures of the cloth, along the
    warp (y) and along the weft (x), at the relaxed state or at selected strains. A curvature is
    positive where the technical face gets longer; it refers to the mean plane of the cloth, which
    keeps its length. With the sides ``held``, cloth follows a skin: all other strains and
    curvatures are zero. With ``free`` sides it gets shorter across a pull as it likes, as in a
    tensile test.

    Args:
        cube: a cube with its case files beside it, or a test of :func:`knitlab.simulate`, of
            periodic fabric with electrodes.
        output: figure to write: maps over n_stripe and n_subunit, or bars of few designs.
        selections: a value or a list of values for each coordinate.
        along: the direction that the sensor is to read, ``"warp"`` or ``"weft"``.
        where: condition on the designs, as of :func:`knitlab.query`.
        named: further selections, as keywords: ``n_stripe=4``.

    Returns:
        Along the design, ``applied_strain`` and ``sides``: ``strain_gauge`` [1] and
        ``bending_gauge`` [mm], each along ``direction``; ``selectivity``, the magnitude of the
        strain gauge factor along the sensor over that across [1]; ``lever`` [mm], the strain along
        the sensor that reads like a curvature of 1/mm; and ``sensing_status``: ok, or why
        nothing is known: touching (its electrodes), plies_touch (by contact), folded_through,
        unresolved, unstable, not_converged.

    Raises:
        InputError: if no design that is left has a periodic shape with electrodes; of one with a
            ground plane or shear; if an argument is invalid.

    Example:
        >>> one = {"n_stripe": 4, "n_subunit": 16, "applied_strain": 0.1}
        >>> found = kl.selectivity("results/reference/sensor", **one)
        >>> found["strain_gauge"].sel(sides="held").values.round(2).ravel().tolist()
        [-1.7, 0.22]
    """
    selections = {**selections, **named}
    check_figure_suffix(output)
    if along not in DIRECTIONS:
        raise invalid("along", f"is {along!r}; give {' or '.join(DIRECTIONS)}")
    opened = as_cube(cube)
    compute = partial(case_selectivity, along=along)
    with Progress("sensing"):
        found = for_each_design(compute, opened, selections, where)
    found[STATUS] = found[STATUS].fillna("")
    if is_case(opened):
        found.attrs["design"] = recorded_case(opened).label
    return maybe_draw(selectivity_figure, found, output)


def selectivity_table(found: xr.Dataset, cube: Cube, *, free: bool, marks: bool) -> pd.DataFrame:
    """The states of :func:`selectivity` as rows, held or free, perhaps with their marks."""
    table = core.selectivity_table(found, "free" if free else "held")
    return with_marks(table, marks_of_rows(as_cube(cube, lazily=True), table)) if marks else table


def _polarised(permittivity: float, thickness: float, capacitor: Capacitor) -> float:
    """Polarisation of a sheet of cloth over ε0 [mm]; InputError if electrodes are insulated."""
    if not 1 <= permittivity < np.inf:
        raise invalid("cloth_permittivity", f"is {permittivity:g}; give a number from 1 on")
    if not 0 < thickness < np.inf:
        raise invalid("cloth_thickness", f"is {thickness:g}; give a positive number of mm")
    if permittivity != 1 and capacitor.dielectric_thickness:
        message = "needs bare electrodes; leave it out, or simulate with dielectric_thickness = 0"
        raise invalid("cloth_permittivity", message)
    return (permittivity - 1) * thickness


def _states(
    cube: Cube, selections: Mapping[str, Any]
) -> tuple[Case, Capacitor, Configuration, list[float], Configuration]:
    """One design with electrodes, its states and strains, and relaxed, in mm of the network."""
    case_file = selected_case(as_cube(cube), selections)
    along = selections_along(selections, [STRAIN])
    chosen = reached_strains(case_file, along, several=STRAIN in along)
    case, capacitor = sensor_case(case_file)
    every = network_configurations(case_file)
    strains = case_file[STRAIN].values[chosen].tolist()
    return case, capacitor, every[chosen], strains, every[0]


def _lengthened(used: ElectrodeSet, relaxed: Configuration, capacitor: Capacitor) -> float:
    """Stated length of electrodes over that of one period, 1 of a sample."""
    if used.axis is None:
        return 1.0
    return capacitor.electrode_length / float(relaxed.lengths[used.axis])
