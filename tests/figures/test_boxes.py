"""Every figure of every kind of cube can be read, by the boxes of what is drawn."""

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.figure import Figure
from PIL import Image

import knitlab as kl
from knitlab.figures.drawing import draw
from knitlab.figures.figure_files import draw_into, requested_figures
from knitlab.figures.fits import fit_figure
from knitlab.figures.nearest_designs import nearest_figure, pareto_figure
from knitlab.figures.registry import figure_kind
from knitlab.figures.stability import branches_figure, shapes_figure
from knitlab.figures.style import print_style, shades, subplots
from knitlab.io.errors import InputError
from knitlab.observables.status import Status
from knitlab.runs.figure_names import FIGURE_NAMES
from tests.figures.boxes import faults
from tests.figures.test_contact import side_by_side
from tests.figures.test_drawing import synthetic_case, values_written
from tests.figures.test_uncertainty import ACRYLIC, ROOT

REFERENCE = ROOT / "results" / "reference"
ONE = {"n_stripe": [4], "n_subunit": [16]}


def kept(name: str) -> xr.Dataset:
    return kl.open_cube(REFERENCE / name)


def one(name: str) -> xr.Dataset:
    return kept(name).sel(ONE)


def missing(cube: xr.Dataset) -> xr.Dataset:
    """A cube whose tests have all failed."""
    cube = cube.load().copy(deep=True)
    for variable in cube.data_vars.values():
        if variable.dtype.kind == "f":
            variable.values[:] = np.nan
    planned = cube["status"] != Status.excluded
    return cube.assign(status=cube["status"].where(~planned, Status.failed).astype(np.int8))


def sheared(cube: xr.Dataset) -> xr.Dataset:
    """A cube of tests without Poisson's ratio, as those under shear and biaxial loads."""
    ratios = [name for name in cube.data_vars if str(name).startswith("poisson_ratio")]
    found = cube.load().copy(deep=True)
    for name in [*ratios, "applied_strain_at_min"]:
        found[name][:] = np.nan
    return found


def case(folder: str, number: int = 0) -> xr.Dataset:
    return xr.open_dataset(sorted(Path(REFERENCE, folder, "cases").iterdir())[number])


def patterned(periodic: bool) -> xr.Dataset:
    return synthetic_case(periodic, pattern="framed")


def plates(_: xr.Dataset) -> xr.Dataset:
    """Stiffnesses of an auxetic fabric at five strains."""
    strain = [0.0, 0.1, 0.2, 0.3, 0.4]
    one = np.array([[0.1, -0.08, 0], [-0.08, 0.3, 0], [0, 0, 0.05]])
    stiffness = (("applied_strain", "row", "column"), [(1 + each) * one for each in strain])
    found = {"membrane_stiffness": stiffness}
    found |= dict.fromkeys(("modulus_x", "modulus_y"), ("applied_strain", strain))
    return xr.Dataset(found, {"applied_strain": strain}, {"length_unit": "mm"})


def many_contacts() -> xr.Dataset:
    """Both kinds of contact of twenty designs."""
    cube = kept("sensor_contact")
    rows = [
        cube.isel(n_subunit=[k % 2]).assign_coords(n_stripe=[n], n_subunit=[8 * n * k])
        for n in (2, 4, 6, 8)
        for k in range(1, 6)
    ]
    joined = xr.concat([row.stack(design=("n_stripe", "n_subunit")) for row in rows], "design")
    fill = {"status": Status.excluded, "case_id": "", "code": ""}
    whole = {str(name): fill.get(str(name), np.nan) for name in cube.data_vars}
    return joined.unstack("design", fill_value=whole)


@dataclass(frozen=True)
class Drawn:
    """A figure, the cubes that it shows, and what it is given besides."""

    name: str
    of: str
    cubes: Callable[[], list[xr.Dataset]]
    options: dict[str, Any] = field(default_factory=dict)
    selections: dict[str, Any] = field(default_factory=dict)
    fast: bool = False

    def figure(self) -> Figure:
        return draw(self.name, self.cubes(), self.selections, self.options)


def of_designs(name: str) -> list[Drawn]:
    return [
        Drawn(name, "large", lambda: [kept("paper")]),
        Drawn(name, "small", lambda: [kept("preview")]),
        Drawn(name, "one design", lambda: [one("periodic")]),
        Drawn(name, "own yarn", lambda: [kept("acrylic")]),
        Drawn(name, "own pattern", lambda: [kept("graded").isel(pattern=[0])]),
        Drawn(name, "missing", lambda: [missing(kept("preview"))]),
    ]


MATERIAL = {"material": ACRYLIC}
ALL = [
    *(each for name in ("auxetic", "curves", "grid") for each in of_designs(name)),
    *(each for each in of_designs("force") if each.of in ("large", "own yarn", "missing")),
    *(each for each in of_designs("tension") if each.of in ("large", "missing")),
    *(each for each in of_designs("wavelength") if each.of in ("large", "small", "missing")),
    Drawn("auxetic", "sheared", lambda: [sheared(kept("preview"))]),
    Drawn("curves", "sheared", lambda: [sheared(one("preview"))]),
    Drawn("grid", "strains", lambda: [one("paper").squeeze()], {"of": "poisson_ratio"}),
    Drawn("sensitivity", "own yarn", lambda: [kept("acrylic")], fast=True),
    Drawn("sensitivity", "missing", lambda: [missing(kept("acrylic"))]),
    Drawn("uncertainty", "own yarn", lambda: [kept("acrylic")], MATERIAL),
    Drawn("uncertainty", "missing", lambda: [missing(kept("acrylic"))], MATERIAL),
    Drawn("sensor", "large", lambda: [kept("sensor")]),
    Drawn("sensor", "window", lambda: [kept("sensor").sel(n_stripe=[6])], {"window": "0.1:0.3"}),
    Drawn("sensor", "one design", lambda: [one("sensor")]),
    Drawn("sensor", "missing", lambda: [missing(kept("sensor"))]),
    Drawn("capacitors", "large", lambda: [kept("sensor"), kept("sensor_stripes")]),
    Drawn("capacitors", "one design", lambda: [one("sensor")]),
    Drawn("capacitors", "missing", lambda: [missing(kept("sensor"))]),
    Drawn("contact", "large", lambda: [many_contacts()]),
    Drawn("contact", "small", lambda: [kept("sensor_contact")]),
    Drawn("contact", "one design", lambda: [one("sensor_contact")]),
    Drawn("contact", "several n_stripe", lambda: [side_by_side()]),
    Drawn("contact", "missing", lambda: [missing(kept("sensor_contact"))]),
    Drawn("cycles", "one design", lambda: [kept("cycles")], fast=True),
    Drawn("cycles", "missing", lambda: [missing(kept("cycles"))]),
    Drawn("directions", "one design", lambda: [kept("directions")]),
    Drawn("directions", "missing", lambda: [missing(kept("directions"))]),
    Drawn(
        "options",
        "large",
        lambda: [kept("options").isel(hinges=[0])],
    ),
    Drawn("stripes", "large", lambda: [kept("stripes")]),
    Drawn("stripes", "small", lambda: [kept("sensor_stripes")]),
    Drawn("stripes", "missing", lambda: [missing(kept("stripes"))]),
    Drawn("swept", "small", lambda: [kept("sensor_layouts")], fast=True),
    Drawn("swept", "missing", lambda: [missing(kept("sensor_layouts"))]),
    Drawn("electrodes", "one design", lambda: [case("sensor")]),
    Drawn("polar", "one design", lambda: [case("periodic")]),
    Drawn("relaxation", "one design", lambda: [case("folding")]),
    Drawn("shape", "large", lambda: [case("periodic", 1)]),
    Drawn("shape", "one design", lambda: [case("preview")], fast=True),
    Drawn("shape", "own pattern", lambda: [patterned(periodic=True)]),
    Drawn("samples", "one design", lambda: [case("preview")]),
    Drawn("samples", "own pattern", lambda: [patterned(periodic=False)]),
]


@pytest.mark.parametrize(
    "drawn",
    [
        pytest.param(
            each, id=f"{each.name}, {each.of}", marks=() if each.fast else pytest.mark.slow
        )
        for each in ALL
    ],
)
def test_a_figure_can_be_read_or_is_refused(drawn, monkeypatch):
    if drawn.name == "polar":  # whose plates take a minute to compile
        module = import_module("knitlab.export.plates.plate_stiffness")
        monkeypatch.setattr(module, "case_plates", plates)
    try:
        figure = drawn.figure()
    except InputError:
        assert drawn.of == "missing", "a cube with results has a figure"
        return
    assert faults(figure) == []


def test_every_figure_is_looked_at():
    assert {each.name for each in ALL} == set(FIGURE_NAMES)


def test_tests_without_poissons_ratio_show_their_force():
    cube = sheared(one("preview"))
    (written,) = values_written(draw("auxetic", [cube]).axes[0])
    last = cube["force_per_width"].isel(applied_strain=-1).item()
    assert float(written) == pytest.approx(10 * last, rel=0.01)
    panels = draw("curves", [cube]).axes
    assert any("force" in axes.get_ylabel() for axes in panels)
    assert not any("Poisson" in axes.get_ylabel() for axes in panels)


@pytest.mark.parametrize(("count", "files"), [(3, 9), (7, 1)])
def test_a_run_over_many_values_draws_one_figure_that_compares_them(tmp_path, count, files):
    cube = one("directions").isel(load_angle=slice(count))
    cube.to_netcdf(tmp_path / "cube.nc")
    requested, mistakes = requested_figures(["curves", "auxetic", "shape"], cube, tmp_path)
    assert len(requested) == files
    assert len(mistakes) == (count == 7)
    for mistake in mistakes:
        assert [each.name for each in requested] == ["directions"]
        assert all(part in str(mistake) for part in ("figures", "7", "directions", "map"))


def test_a_figure_of_python_has_the_resolution_of_the_command_line(tmp_path):
    drawn = kl.plot.grid(kept("preview"))
    drawn.savefig(tmp_path / "python.png")
    draw_into(lambda: draw("grid", [kept("preview")]), tmp_path / "command.png")
    python, command = (Image.open(tmp_path / f"{name}.png") for name in ("python", "command"))
    assert python.size == command.size


def branches() -> xr.Dataset:
    """Three branches of equilibria that part where the first buckles."""
    strain = np.linspace(0, 0.3, 30)
    each = [
        {
            "applied_strain": strain,
            "reaction_force": strain * (1 + 3 * number * np.clip(strain - 0.15, 0, None)),
            "lowest_eigenvalue": 0.1 - strain * (number + 1),
            "unstable": (strain > 0.2).astype(int),
            "branch": np.full(30, number + 1),
            "kind": np.where(np.arange(30) == 15, "branch", ""),
        }
        for number in range(3)
    ]
    points = {name: ("point", np.concatenate([one[name] for one in each])) for name in each[0]}
    return xr.Dataset(points, attrs={"design": "(4, 16)"})


def shapes(count: int) -> xr.Dataset:
    """Waves of as many kinds, with the energies between them."""
    y, x = np.mgrid[:24, :24] * 2 * np.pi / 24
    number = np.arange(count)
    found = {
        "height": (("shape", "y", "x"), [np.sin(x + k) * np.cos(y * (1 + k % 2)) for k in number]),
        "energy": ("shape", 1 + 1e-3 * number),
        "starts": ("shape", 1 + number),
        "barrier": (("shape", "to"), 1e-3 * (number[:, None] + 2.0 * number)),
    }
    return xr.Dataset(found, {"shape": 1 + number, "to": 1 + number}, {"design": "(4, 16)"})


def found() -> Figure:
    targets = ["poisson_ratio = -0.7 ± 0.03 @ 0.05:0.25", "reaction_force < 2 @ 0.2"]
    return nearest_figure(kl.find(REFERENCE / "periodic", targets=targets))


def pareto() -> Figure:
    trials = np.abs(np.random.default_rng(0).normal(0, 2, (60, 2)))
    searches = pd.Series(np.arange(60) % 3)
    return pareto_figure(trials, ("poisson_ratio = -0.6 ± 0.02", "knit_cell_x <= 40"), searches)


def fitted() -> Figure:
    strain = np.linspace(0.01, 0.36, 19)
    curves = np.array([strain * (1 - strain), strain, 10 * strain**2])
    target = SimpleNamespace(applied_strain=strain, values=curves, errors=0.01 * (curves + 0.1))
    names = [
        f"{knit}_{number}" for knit in ("rib", "garter") for number in ("k_s", "k_t", "theta_0")
    ]
    fit = SimpleNamespace(
        target=target,
        curves=(1.2 * curves, 1.005 * curves),
        factors=dict(zip(names, np.linspace(0.8, 1.2, 6), strict=True)),
        standard_errors=dict.fromkeys(names, 0.05),
    )
    return fit_figure(fit, "n_stripe 4, n_subunit 16, fitted to synthetic_4_16")


@pytest.mark.parametrize(
    "figure",
    [
        lambda: branches_figure(branches()),
        lambda: shapes_figure(shapes(4)),
        lambda: shapes_figure(shapes(1)),
        found,
        pareto,
        fitted,
    ],
    ids=["branches", "shapes", "shape", "found", "pareto", "fitted"],
)
@pytest.mark.slow
def test_figures_of_searches_can_be_read(figure):
    with print_style():
        assert faults(figure()) == []


@pytest.mark.slow
def test_samples_of_three_designs_can_be_read():
    assert faults(figure_kind("samples").draw([case("preview").load()] * 3)) == []


def test_eight_colours_in_an_order_differ():
    figure, axes = subplots(2)
    for number, colour in enumerate(shades(8)):
        axes.plot([0, 1], [number, number], color=colour, label=f"{number}")
    figure.legend(loc="outside right center")
    assert faults(figure) == []


def test_faults_are_found():
    figure, (left, right) = subplots(2, 1, 2)
    left.plot([0, 1], [0, 1], color="#440154", label="one")
    left.plot([0, 1], [1, 0], color="#450457", label="other")
    left.text(0.5, 0.5, "crossed")
    left.text(0.5, 0.52, "over it", rotation=45)
    left.set_title("far to the left", x=-1)
    right.axhline(0)
    figure.legend(loc="outside lower center")
    found = " ".join(faults(figure))
    for kind in ("slanted", "overlap", "outside", "crosses", "empty panel", "look the same"):
        assert kind in found
