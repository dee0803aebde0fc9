"""Drawing figures by name."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.cube.case_file import case_path, read_case
from knitlab.cube.cube_file import (
    as_cube,
    base_dims,
    design_dims,
    is_case,
    is_measured,
    open_cube,
    source_of,
    swept_dims,
)
from knitlab.cube.schema import DESIGN_DIMS, VARIABLES
from knitlab.cube.selection import as_given, choices, refuse_others, selected, selections_along
from knitlab.figures.drawn import (
    MOST_SLICES,
    fingerprint_of_figure,
    is_drawn,
    requested_figures,
)
from knitlab.figures.figure_kind import Drawing, FigureKind
from knitlab.figures.saving import save
from knitlab.figures.style import print_style
from knitlab.io.errors import BadInput, Fault, fault, unknown
from knitlab.sweep.figure_names import COMPARING, FIGURE_NAMES, suffixes

FIGURES: dict[str, FigureKind] = {
    name: import_module(f"knitlab.figures.kinds.{name}").FIGURE for name in FIGURE_NAMES
}
NO_CASE_FILES = "shapes are in case files, not in the cube: run the designs into this folder"


def draw_figure(
    kind: str,
    cube_paths: Sequence[Path],
    output: Path,
    selections: Mapping[str, Any] = {},
    options: Mapping[str, str] | None = None,
) -> Path:
    """Draw one figure into a file.

    Args:
        kind: a name of :data:`FIGURES`; one that shows a single case shows the most auxetic
            design of the selection that has its case file beside the cube.
        cube_paths: a cube, or the results folder that holds one; several for a kind that takes
            several.
        output: the file; its suffix sets the format.
        selections: values by coordinate that slice the cube first.
        options: what a kind with options shows, such as ``{"of": "reaction_force"}``.

    Returns:
        The file.

    Raises:
        BadInput: if the cube, a selection or the suffix is at fault.
    """
    if kind not in FIGURES:
        raise fault("kind", unknown(kind, FIGURES, "figure"))
    if output.suffix.lower() not in suffixes(kind):
        known = ", ".join(suffixes(kind))
        raise fault(f"output {output}", f"{kind} has no format of this suffix; give one of {known}")
    _check_count(kind, len(cube_paths))
    _check_options(kind, options or {})
    cubes = [open_cube(path) for path in cube_paths]
    fingerprint = fingerprint_of_figure(kind, cube_paths, selections, options)
    if not is_drawn(output, fingerprint):
        with print_style():
            save(_drawn(kind, cube_paths, cubes, selections, options), output, fingerprint)
    return output


def draw_figures(kinds: Iterable[str], folder: Path) -> tuple[list[Path], list[Fault]]:
    """Draw a workflow's figures into its results folder, each for print and for the screen.

    A cube with dimensions of swept settings gives a figure for each of their values. Figures that
    are up to date are kept.

    Returns:
        The files, and why some figures could not be drawn.
    """
    saved: list[Path] = []
    faults: list[Fault] = []
    cube = open_cube(folder)
    requested = requested_figures(kinds, cube, folder)
    slices = {
        tuple(figure.selections.items()) for figure in requested if figure.kind not in COMPARING
    }
    if len(slices) > MOST_SLICES:
        problem = f"{len(slices)} slices are too many to draw in a run; draw one by knitlab map"
        faults.append(Fault("figures", problem))
        requested = [figure for figure in requested if figure.kind in COMPARING]
    for figure in requested:
        fingerprint = fingerprint_of_figure(figure.kind, [folder], figure.selections)
        missing = [output for output in figure.outputs if not is_drawn(output, fingerprint)]
        try:
            if missing:
                with print_style():
                    drawing = _drawn(figure.kind, [folder], [cube], figure.selections)
                    for output in missing:
                        save(drawing, output, fingerprint)
                        if isinstance(drawing, Figure):
                            # The other formats take the layout of the first.
                            drawing.set_layout_engine("none")
        except BadInput as error:
            stem = figure.outputs[0].stem
            faults += [Fault(f"figure {stem}", entry.problem) for entry in error.faults]
        else:
            saved += figure.outputs
    return saved, faults


def draw(
    kind: str,
    cubes: Sequence[xr.Dataset],
    selections: Mapping[str, Any] = {},
    options: Mapping[str, str] | None = None,
) -> Drawing:
    """Draw one figure from cubes in memory.

    Args:
        kind: a name of :data:`FIGURES`.
        cubes: cubes or single cases. A figure that needs node positions takes them from a case,
            or from the case files beside the file that the cube was opened from.
        selections: values by coordinate that slice the cubes first.
        options: what a kind with options shows, such as ``{"of": "reaction_force"}``.

    Returns:
        The figure, or an animation if the kind is a film.

    Raises:
        BadInput: if a cube or a selection is at fault.
    """
    _check_count(kind, len(cubes))
    _check_options(kind, options or {})
    with print_style():
        if all(is_case(cube) for cube in cubes):
            return _drawn_of_cases(kind, cubes, selections, options)
        paths = [
            Path(cube.encoding.get("source", f"cube {number}"))
            for number, cube in enumerate(cubes, start=1)
        ]
        return _drawn(kind, paths, cubes, selections, options)


def _check_count(kind: str, cubes: int) -> None:
    """Check the number of cubes.

    Raises:
        BadInput: if there is none, or more than one for a kind that takes one.
    """
    if not cubes:
        raise fault(kind, "shows a cube; give one")
    if cubes > 1 and not FIGURES[kind].several:
        raise fault(kind, f"shows one cube, not {cubes}; give one")


def _check_options(kind: str, options: Mapping[str, str]) -> None:
    """Check the names of options.

    Raises:
        BadInput: for an option that a kind does not have.
    """
    able = ", ".join(name for name, each in FIGURES.items() if each.options)
    faults = [
        Fault(option, f"is not an option of {kind}, only of {able}; leave it out")
        for option in options
        if option not in FIGURES[kind].options
    ]
    if faults:
        raise BadInput(faults)


def _drawn_of_cases(
    name: str,
    cases: Sequence[xr.Dataset],
    selections: Mapping[str, Any],
    options: Mapping[str, str] | None,
) -> Drawing:
    kind = FIGURES[name]
    if kind.needs is None:
        paths = [Path(case.attrs["title"]) for case in cases]
        return _drawn(name, paths, [as_cube(case) for case in cases], selections, options)
    known = kind.coordinates
    remedy = f"select along {', '.join(known)}" if known else "select nothing of a single case"
    problem = f"is not a coordinate along which {name} can be sliced; {remedy}"
    refuse_others(selections, known, problem)
    sliced = [_sliced_case(case, selections) for case in cases]
    return kind.draw(sliced if kind.designs else sliced[0])


def _sliced_case(case: xr.Dataset, selections: Mapping[str, Any]) -> xr.Dataset:
    """The selected strains of a case.

    Raises:
        BadInput: if the file of the case does not hold the shape at one of them.
    """
    sliced = selected(case, selections)
    if selections and "position" in case:
        strains = case["applied_strain"].values
        kept = np.isfinite(case["position"].values).all(axis=(1, 2, 3))
        if not np.isin(sliced["applied_strain"].values, strains[kept]).all():
            known = ", ".join(f"{strain:g}" for strain in strains[kept])
            raise fault(
                f"selections {', '.join(as_given(selections))}",
                f"has no shape, which this case file keeps at {known}; choose one of these",
            )
    return sliced


def _drawn(
    name: str,
    cube_paths: Sequence[Path],
    cubes: Sequence[xr.Dataset],
    selections: Mapping[str, Any],
    options: Mapping[str, str] | None = None,
) -> Drawing:
    kind = FIGURES[name]
    for cube in cubes:
        if kind.dims not in (None, base_dims(cube)):
            able = [name for name, kind in FIGURES.items() if kind.dims in (None, base_dims(cube))]
            raise fault(
                name,
                f"does not show designs along the dimensions of this cube; draw {', '.join(able)}",
            )
    _check_sources(name, kind, cubes)
    dims = {dim: None for cube in cubes for dim in design_dims(cube)}
    known = (*dims, *kind.coordinates)
    problem = f"is not a coordinate of {name}; select along {', '.join(known)}"
    refuse_others(selections, known, problem)
    cubes = [selected(cube, selections_along(selections, cube.coords)) for cube in cubes]
    if name in COMPARING:
        if kind.several:
            return kind.draw(list(zip(cube_paths, cubes, strict=True)))
        return kind.draw(cubes[0], **(options or {}))
    sliced = [_one_slice(name, cube) for cube in cubes]
    (cube, _), folder = sliced[0], _folder(cube_paths[0])
    slice_shown = ", ".join(dict.fromkeys(shown for _, shown in sliced if shown))
    if kind.several:
        drawing = kind.draw([cube for cube, _ in sliced], **(options or {}))
    elif kind.needs is None:
        drawing = kind.draw(cube)
    else:
        along = selections_along(selections, kind.coordinates)
        cases = (
            _cases(name, cube, folder)
            if kind.designs
            else [_most_auxetic_case(cube, folder, kind.needs)]
        )
        shown = [_sliced_case(case, along) for case in cases]
        drawing = kind.draw(shown if kind.designs else shown[0])
    if slice_shown and isinstance(drawing, Figure):
        title = drawing.get_suptitle()
        drawing.suptitle(f"{title}\n{slice_shown}" if title else slice_shown, fontsize="small")
    return drawing


def _check_sources(name: str, kind: FigureKind, cubes: Sequence[xr.Dataset]) -> None:
    """Check which cubes are simulated and which are measured.

    Raises:
        BadInput: for experiments that a kind cannot show, or cubes that it could not tell apart.
    """
    measured = [source_of(cube) for cube in cubes if is_measured(cube)]
    if measured and kind.several is None:
        able = ", ".join(other for other, kind in FIGURES.items() if kind.several)
        raise fault(
            name,
            f"needs a simulation, and {measured[0]} was measured; draw {able}",
        )
    if kind.several in ("experiments", "designs") and len(cubes) - len(measured) > 1:
        raise fault(name, "shows one simulation, and experiments beside it; give one simulation")
    apart = kind.several != "designs"
    shown = [
        (source_of(cube) if apart else "", *design)
        for cube in cubes
        if is_measured(cube)
        for design in itertools.product(*(cube[dim].values.tolist() for dim in DESIGN_DIMS))
    ]
    if len(set(shown)) < len(shown):
        remedy = "give each another source" if apart else "show one of them"
        raise fault(name, f"has several experiments on one design; {remedy}")


def _one_slice(name: str, cube: xr.Dataset) -> tuple[xr.Dataset, str]:
    """A cube without the dimensions of swept settings, and the value of each as text."""
    swept = swept_dims(cube)
    if several := [dim for dim in swept if cube.sizes[dim] > 1]:
        raise fault(name, f"shows one value of each swept setting; select {choices(cube, several)}")
    shown = ", ".join(f"{dim} = {cube[dim].item()}" for dim in swept)
    return cube.isel(dict.fromkeys(swept, 0), drop=True), shown


def _folder(cube_path: Path) -> Path:
    return cube_path if cube_path.is_dir() else cube_path.parent


def _cases(name: str, cube: xr.Dataset, folder: Path) -> list[xr.Dataset]:
    """Cases of the designs that a figure shows and that have a case file."""
    designs = cube["case_id"].stack(design=DESIGN_DIMS)
    stored = {
        design: case_id
        for design, case_id in zip(designs["design"].values, designs.values, strict=True)
        if case_id and case_path(folder, case_id).is_file()
    }
    preferred = FIGURES[name].designs
    found = [stored[design] for design in preferred if design in stored]
    if found := found or [*stored.values()][: len(preferred)]:
        return [read_case(folder, case_id) for case_id in found]
    raise fault(str(folder / "cases"), f"holds none of these designs; {NO_CASE_FILES}")


def _most_auxetic_case(cube: xr.Dataset, folder: Path, needs: str) -> xr.Dataset:
    designs = cube[["case_id", "poisson_ratio_min"]].stack(design=base_dims(cube))
    for case_id in designs.sortby("poisson_ratio_min")["case_id"].values:
        if case_path(folder, case_id).is_file():
            case = read_case(folder, case_id)
            if needs in case:
                return case
    if not any(designs["case_id"].values):
        raise fault("selections", "no design of this selection is planned; choose others")
    what = VARIABLES[needs].long_name
    how = "run them with method=dynamics" if VARIABLES[needs].of == "dynamics" else NO_CASE_FILES
    raise fault(str(folder / "cases"), f"holds no {what} of these designs; {how}")
