"""Drawing figures by name, from cubes in memory and into files."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.cubes import cube_file
from knitlab.cubes.case_file import case_path, in_cloth, read_case
from knitlab.cubes.chosen_case import has_shape, shapes_folder
from knitlab.cubes.cube_file import base_dims, is_measured, swept_dims
from knitlab.cubes.derived import with_derived
from knitlab.cubes.normalised import as_cube_of_one, naming_missing, normalised
from knitlab.cubes.selection import (
    as_given,
    choices,
    refuse_others,
    select,
    selectable,
    selections_along,
)
from knitlab.cubes.trust import with_doubts
from knitlab.figures import figure_files
from knitlab.figures.registry import FigureKind, figure_kind, figure_kinds
from knitlab.figures.style import print_style
from knitlab.io.cube_path import cube_path
from knitlab.io.errors import Mistake, invalid
from knitlab.io.progress import each
from knitlab.io.provenance import file_digest
from knitlab.observables.motion_history import DYNAMICS
from knitlab.observables.schema import STRAIN, VARIABLES
from knitlab.runs.figure_names import check_figure_suffix

NO_CASE_FILES = "shapes are in case files, not in the cube: run the designs into this folder"


def draw_figure(
    name: str,
    cube_paths: Sequence[Path],
    output: Path,
    selections: Mapping[str, Any] = {},
    options: Mapping[str, str] = {},
) -> Path:
    """Draw a figure of cubes, or of their results folders, unless the file holds it already."""
    figure_kind(name)
    check_figure_suffix(output)
    cubes = [cube_file.open_cube(path) for path in cube_paths]
    digests = [file_digest(cube_path(path)) for path in cube_paths]
    fingerprint = figure_files.fingerprint_of_figure(name, digests, selections, options)
    figure_files.draw_into(partial(draw, name, cubes, selections, options), output, fingerprint)
    return output


def draw_figures(names: Sequence[str], folder: Path) -> tuple[list[Path], list[Mistake]]:
    """Draw a workflow's figures into its folder; the files, and why some could not be drawn."""
    files, cube = list[Path](), cube_file.open_cube(folder)
    requested, mistakes = figure_files.requested_figures(names, cube, folder)
    for figure in each(requested, "figure"):
        with figure_files.reporting(figure.output.stem, mistakes):
            drawn = partial(draw, figure.name, [cube], figure.selections)
            figure_files.draw_into(drawn, figure.output, figure.fingerprint)
            files.append(figure.output)
    return files, mistakes


@print_style()
def draw(
    name: str,
    cubes: Sequence[xr.Dataset],
    selections: Mapping[str, Any] = {},
    options: Mapping[str, Any] = {},
) -> Figure:
    """Draw one figure from cubes or cases in memory; a cube's case files are those beside it."""
    kind = figure_kind(name)
    if not cubes:
        raise invalid(name, "shows a cube; give one")
    if len(cubes) > 1 and not kind.several:
        raise invalid(name, f"shows one cube, not {len(cubes)}; give one")
    for option in options:
        if option not in kind.options:
            able = [other for other, it in figure_kinds().items() if option in it.options]
            only = f", only of {', '.join(able)}" if able else ""
            raise invalid(option, f"is not an option of {name}{only}; leave it out")
    cubes = [with_doubts(with_derived(normalised(cube))) for cube in cubes]
    if all(map(cube_file.is_case, cubes)):
        if kind.needs is not None:
            _refuse_others(selections, kind.coordinates, name)
            return _draw_cases(kind, [in_cloth(case, case) for case in cubes], selections)
        cubes = [as_cube_of_one(case) for case in cubes]
    _check_cubes(name, kind, cubes)
    dims = {dim: None for cube in cubes for dim in cube_file.design_dims(cube)}
    _refuse_others(selections, (*dims, *kind.coordinates), name)
    folder = Path() if kind.needs is None else shapes_folder(cubes[0])
    cubes = [select(cube, selections_along(selections, selectable(cube))) for cube in cubes]
    stated = dict[str, None]()
    if not kind.compares:
        for cube in cubes:
            if several := [dim for dim in swept_dims(cube) if cube.sizes[dim] > 1]:
                message = f"shows one value of each swept setting; select {choices(cube, several)}"
                raise invalid(name, message)
            stated[", ".join(f"{dim} = {cube[dim].item()}" for dim in swept_dims(cube))] = None
        cubes = [cube.isel(dict.fromkeys(swept_dims(cube), 0), drop=True) for cube in cubes]
    with naming_missing(f"figures like {name}", cubes):
        if kind.needs is not None:
            cases = _cases(kind, cubes[0], folder)
            figure = _draw_cases(kind, cases, selections_along(selections, kind.coordinates))
        else:
            figure = kind.draw(cubes if kind.several else cubes[0], **options)
    if shown := ", ".join(filter(None, stated)):
        title = figure.get_suptitle()
        figure.suptitle(f"{title}\n{shown}" if title else shown, fontsize="small")
    return figure


def _names(able: Any) -> str:
    return ", ".join(name for name, kind in figure_kinds().items() if able(kind))


def _refuse_others(selections: Mapping[str, Any], known: Sequence[str], name: str) -> None:
    hint = f"select along {', '.join(known)}" if known else "select nothing"
    refuse_others(selections, known, f"is not a coordinate of {name}; {hint}")


def _check_cubes(name: str, kind: FigureKind, cubes: Sequence[xr.Dataset]) -> None:
    for cube in cubes:
        if kind.dims not in (None, dims := base_dims(cube)):
            able = _names(lambda other: other.dims in (None, dims))
            message = "does not show designs along the dimensions of this cube"
            raise invalid(name, f"{message}; draw {able}")
    measured = [cube for cube in cubes if is_measured(cube)]
    if measured and kind.several is None:
        message = f"needs a simulation, and {cube_file.source_of(measured[0])} was measured"
        raise invalid(name, f"{message}; draw {_names(lambda other: other.several)}")
    if kind.several == "experiments" and len(cubes) - len(measured) > 1:
        raise invalid(name, "shows one simulation, and experiments beside it; give one simulation")


def _draw_cases(
    kind: FigureKind, cases: Sequence[xr.Dataset], selections: Mapping[str, Any]
) -> Figure:
    sliced = [select(case, selections) for case in cases]
    for case, shown in zip(cases, sliced, strict=True):
        kept = case[STRAIN].values[has_shape(case)]
        if selections and not np.isin(shown[STRAIN].values, kept).all():
            known = ", ".join(f"{strain:g}" for strain in kept)
            message = f"has no shape, which this case file keeps at {known}; choose one of these"
            raise invalid(f"selections {', '.join(as_given(selections))}", message)
    return kind.draw(sliced if kind.designs else sliced[0])


def _cases(kind: FigureKind, cube: xr.Dataset, folder: Path) -> list[xr.Dataset]:
    """The case files that a figure shows: of its designs, or of the most auxetic design."""
    dims = base_dims(cube)
    designs = cube[["case_id", "poisson_ratio_min"]].stack(design=dims)
    designs = designs.isel(design=designs["case_id"].values != "")
    if not designs.sizes["design"]:
        raise invalid("selections", "no design of this selection is planned; choose others")
    designs = designs.sortby("poisson_ratio_min") if not kind.designs else designs
    case_ids = {
        design: case_id
        for design, case_id in zip(designs["design"].values, designs["case_id"].values, strict=True)
        if case_path(folder, case_id).is_file()
    }

    def case_of(design: tuple[Any, ...]) -> xr.Dataset:
        only = cube.sel(dict(zip(dims, design, strict=True)))
        return in_cloth(read_case(folder, case_ids[design]), only)

    if kind.designs:
        shown = [design for design in kind.designs if design in case_ids]
        if case_ids:
            return [case_of(each) for each in shown or [*case_ids][: len(kind.designs)]]
        raise invalid(str(folder / "cases"), f"holds none of these designs; {NO_CASE_FILES}")
    for design in case_ids:
        if kind.needs in (case := case_of(design)):
            return [case]
    needs = VARIABLES[str(kind.needs)]
    how = "run them with method=dynamics" if needs.group is DYNAMICS else NO_CASE_FILES
    raise invalid(str(folder / "cases"), f"holds no {needs.long_name} of these designs; {how}")
