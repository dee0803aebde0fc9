"""Drawing figures by name."""

from collections.abc import Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.cubes import cube_file
from knitlab.cubes.case_file import case_path, in_cloth, read_case
from knitlab.cubes.chosen_case import has_shape
from knitlab.cubes.cube_file import base_dims, is_measured, swept_dims, with_derived
from knitlab.cubes.selection import (
    as_given,
    choices,
    refuse_others,
    selectable,
    selected,
    selections_along,
)
from knitlab.cubes.trust import with_doubts
from knitlab.figures import figure_files, kinds
from knitlab.figures.kinds import FigureKind
from knitlab.figures.style import print_style
from knitlab.io.errors import InputError, Mistake, invalid, unknown
from knitlab.io.provenance import file_digest
from knitlab.observables.schema import VARIABLES
from knitlab.runs.figure_names import COMPARING, check_figure_suffix

FIGURES: dict[str, FigureKind] = {}
for _module in iter_modules(kinds.__path__):
    FIGURES |= import_module(f"{kinds.__name__}.{_module.name}").FIGURES
FIGURES = dict(sorted(FIGURES.items()))
NO_CASE_FILES = "shapes are in case files, not in the cube: run the designs into this folder"


def draw_figure(
    kind: str,
    cube_paths: Sequence[Path],
    output: Path,
    selections: Mapping[str, Any] = {},
    options: Mapping[str, str] = {},
) -> Path:
    """Draw a figure of cubes, or of their results folders, unless the file holds it already.

    InputError if a cube, a selection, an option or the suffix is at fault.
    """
    if kind not in FIGURES:
        raise invalid("kind", unknown(kind, FIGURES, "figure"))
    check_figure_suffix(output)
    cubes = [cube_file.open_cube(path) for path in cube_paths]
    digests = [file_digest(cube_file.cube_path(path)) for path in cube_paths]
    fingerprint = figure_files.fingerprint_of_figure(kind, digests, selections, options)
    figure_files.draw_into(partial(draw, kind, cubes, selections, options), output, fingerprint)
    return output


def draw_figures(names: Sequence[str], folder: Path) -> tuple[list[Path], list[Mistake]]:
    """Draw a workflow's figures into its results folder, unless they are up to date.

    Returned are the files, and why some could not be drawn. CannotWrite if one cannot be written.
    """
    files, cube = list[Path](), cube_file.open_cube(folder)
    requested, mistakes = figure_files.requested_figures(names, cube, folder)
    for figure in requested:
        with figure_files.reporting(figure.output.stem, mistakes):
            drawn = partial(draw, figure.kind, [cube], figure.selections)
            figure_files.draw_into(drawn, figure.output, figure.fingerprint)
            files.append(figure.output)
    return files, mistakes


@print_style()
def draw(
    name: str,
    cubes: Sequence[xr.Dataset],
    selections: Mapping[str, Any] = {},
    options: Mapping[str, str] = {},
) -> Figure:
    """Draw one figure from cubes or single cases in memory; otherwise as :func:`draw_figure`.

    Node positions are those of a case, or of case files beside the file that a cube was read from.
    """
    kind = FIGURES[name]
    cubes = [with_doubts(with_derived(cube)) for cube in cubes]
    if not cubes:
        raise invalid(name, "shows a cube; give one")
    if len(cubes) > 1 and not kind.several:
        raise invalid(name, f"shows one cube, not {len(cubes)}; give one")
    if others := [option for option in options if option not in kind.options]:
        able = ", ".join(other for other, each in FIGURES.items() if each.options)
        message = f"is not an option of {name}, only of {able}; leave it out"
        raise InputError([Mistake(option, message) for option in others])
    if all(cube_file.is_case(cube) for cube in cubes):
        if kind.needs is not None:
            known = kind.coordinates
            hint = f"select along {', '.join(known)}" if known else "select nothing"
            message = f"is not a coordinate along which {name} can be sliced; {hint}"
            refuse_others(selections, known, message)
            return _draw_cases(kind, [in_cloth(case, case) for case in cubes], selections)
        cubes = [cube_file.as_cube(case) for case in cubes]
    _check_cubes(name, kind, cubes)
    dims = {dim: None for cube in cubes for dim in cube_file.design_dims(cube)}
    known = (*dims, *kind.coordinates)
    message = f"is not a coordinate of {name}; select along {', '.join(known)}"
    refuse_others(selections, known, message)
    folder = Path(cubes[0].encoding.get("source", "")).parent
    cubes = [selected(cube, selections_along(selections, selectable(cube))) for cube in cubes]
    slices = dict[str, None]()
    if name not in COMPARING:
        for cube in cubes:
            if several := [dim for dim in swept_dims(cube) if cube.sizes[dim] > 1]:
                message = f"shows one value of each swept setting; select {choices(cube, several)}"
                raise invalid(name, message)
            values = (f"{dim} = {cube[dim].item()}" for dim in swept_dims(cube))
            slices[", ".join(values)] = None
        cubes = [cube.isel(dict.fromkeys(swept_dims(cube), 0), drop=True) for cube in cubes]
    if kind.needs is not None:
        cases = _cases(kind, cubes[0], folder)
        figure = _draw_cases(kind, cases, selections_along(selections, kind.coordinates))
    else:
        figure = kind.draw(cubes if kind.several else cubes[0], **options)
    if shown := ", ".join(filter(None, slices)):
        title = figure.get_suptitle()
        figure.suptitle(f"{title}\n{shown}" if title else shown, fontsize="small")
    return figure


def _check_cubes(name: str, kind: FigureKind, cubes: Sequence[xr.Dataset]) -> None:
    """Check that a kind can show the dimensions of cubes, and those that were measured."""
    for cube in cubes:
        able = [each for each, kind in FIGURES.items() if kind.dims in (None, base_dims(cube))]
        if name not in able:
            message = "does not show designs along the dimensions of this cube"
            raise invalid(name, f"{message}; draw {', '.join(able)}")
    measured = [cube for cube in cubes if is_measured(cube)]
    if measured and kind.several is None:
        able = [other for other, each in FIGURES.items() if each.several]
        message = f"needs a simulation, and {cube_file.source_of(measured[0])} was measured"
        raise invalid(name, f"{message}; draw {', '.join(able)}")
    if kind.several == "experiments" and len(cubes) - len(measured) > 1:
        raise invalid(name, "shows one simulation, and experiments beside it; give one simulation")


def _draw_cases(
    kind: FigureKind, cases: Sequence[xr.Dataset], selections: Mapping[str, Any]
) -> Figure:
    """Draw the selected strains of cases, of which their files must hold the shapes."""
    sliced = [selected(case, selections) for case in cases]
    for case, shown in zip(cases, sliced, strict=True):
        kept = case["applied_strain"].values[has_shape(case)]
        if selections and not np.isin(shown["applied_strain"].values, kept).all():
            known = ", ".join(f"{strain:g}" for strain in kept)
            message = f"has no shape, which this case file keeps at {known}; choose one of these"
            raise invalid(f"selections {', '.join(as_given(selections))}", message)
    return kind.draw(sliced if kind.designs else sliced[0])


def _cases(kind: FigureKind, cube: xr.Dataset, folder: Path) -> list[xr.Dataset]:
    """The case files that a figure shows: of its designs, or of the most auxetic design."""
    dims = base_dims(cube)
    designs = cube[["case_id", "poisson_ratio_min"]].stack(design=dims)
    designs = designs.isel(design=designs["case_id"].values != "")
    is_stored = [case_path(folder, each).is_file() for each in designs["case_id"].values]
    stored = designs.isel(design=np.flatnonzero(is_stored))
    case_ids = dict(zip(stored["design"].values, stored["case_id"].values, strict=True))

    def case_of(design: tuple[Any, ...]) -> xr.Dataset:
        only = cube.sel(dict(zip(dims, design, strict=True)))
        return in_cloth(read_case(folder, case_ids[design]), only)

    if kind.designs:
        shown = [design for design in kind.designs if design in case_ids]
        shown = shown or [*case_ids][: len(kind.designs)]
        if not shown:
            raise invalid(str(folder / "cases"), f"holds none of these designs; {NO_CASE_FILES}")
        return [case_of(design) for design in shown]
    needs = VARIABLES[str(kind.needs)]
    for design in stored.sortby("poisson_ratio_min")["design"].values:
        if kind.needs in (case := case_of(design)):
            return [case]
    if not designs.sizes["design"]:
        raise invalid("selections", "no design of this selection is planned; choose others")
    how = "run them with method=dynamics" if needs.of == "dynamics" else NO_CASE_FILES
    raise invalid(str(folder / "cases"), f"holds no {needs.long_name} of these designs; {how}")
