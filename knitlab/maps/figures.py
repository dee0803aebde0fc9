"""Every figure by name, drawn from a cube and written whole."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from knitlab.maps.auxetic import auxetic_map
from knitlab.maps.cube import open_cube
from knitlab.maps.curves import tension_curves
from knitlab.maps.selection import selected
from knitlab.maps.shape import relaxed_shape
from knitlab.maps.style import print_style
from knitlab.sweep.case_file import case_path, read_case
from knitlab.sweep.faults import BadInput, Fault, fault
from knitlab.sweep.files import written_whole
from knitlab.sweep.registry import DESIGN_DIMS

CUBE_FIGURES: dict[str, Callable[[xr.Dataset], Figure]] = {
    "auxetic": auxetic_map,
    "curves": tension_curves,
}
CASE_FIGURES: dict[str, Callable[[xr.Dataset], Figure]] = {"shape": relaxed_shape}
SUFFIXES = (".pdf", ".svg", ".png")


def draw_figure(kind: str, cube_path: Path, output: Path, selections: Sequence[str] = ()) -> Path:
    """Draw one figure into a file.

    Args:
        kind: a name of :data:`CUBE_FIGURES`, or of :data:`CASE_FIGURES` for the most
            auxetic design of the selection that has a case file beside the cube.
        cube_path: a cube, or the results folder that holds one.
        output: the file; its suffix sets the format.
        selections: texts ``NAME=VALUE`` that slice the cube first.

    Returns:
        The file.

    Raises:
        BadInput: if the cube, a selection or the suffix is at fault.
    """
    if output.suffix.lower() not in SUFFIXES:
        raise fault(f"-o {output}", f"has no suffix of {', '.join(SUFFIXES)}; give one")
    with print_style():
        _save(_drawn(kind, cube_path, selections), output)
    return output


def draw_figures(kinds: Iterable[str], folder: Path) -> tuple[list[Path], list[Fault]]:
    """Draw a workflow's figures into its results folder, each for print and for the screen.

    Returns:
        The files, and why a figure could not be drawn of these results.
    """
    saved: list[Path] = []
    faults: list[Fault] = []
    for kind in kinds:
        outputs = [folder / "figures" / f"{kind}{suffix}" for suffix in (".pdf", ".png")]
        try:
            with print_style():
                figure = _drawn(kind, folder)
                for output in outputs:
                    _save(figure, output)
        except BadInput as error:
            faults += [Fault(f"figure {kind}", entry.problem) for entry in error.faults]
        else:
            saved += outputs
    return saved, faults


def _drawn(kind: str, cube_path: Path, selections: Sequence[str] = ()) -> Figure:
    if kind != "curves":
        faults = [
            Fault(f"--select {text}", f"says nothing to {kind}; select of {', '.join(DESIGN_DIMS)}")
            for text in selections
            if text.partition("=")[0].strip() not in DESIGN_DIMS
        ]
        if faults:
            raise BadInput(faults)
    cube = selected(open_cube(cube_path), selections)
    if kind in CUBE_FIGURES:
        return CUBE_FIGURES[kind](cube)
    folder = cube_path if cube_path.is_dir() else cube_path.parent
    return CASE_FIGURES[kind](_most_auxetic_case(cube, folder))


def _save(figure: Figure, output: Path) -> None:
    FigureCanvasAgg(figure)
    with written_whole(output) as temporary:
        figure.savefig(temporary)


def _most_auxetic_case(cube: xr.Dataset, folder: Path) -> xr.Dataset:
    designs = cube[["case_id", "poisson_ratio_min"]].stack(design=DESIGN_DIMS)
    for case_id in designs.sortby("poisson_ratio_min")["case_id"].values:
        if case_path(folder, case_id).is_file():
            case = read_case(folder, case_id)
            if "position" in case:
                return case
    raise fault(str(folder / "cases"), "holds no relaxed shape of these designs")
