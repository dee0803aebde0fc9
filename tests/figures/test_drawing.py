import json
import subprocess
import sys

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg

import knitlab as kl
from knitlab.figures.drawing import draw, draw_figure
from knitlab.figures.kinds.auxetic import auxetic
from knitlab.figures.kinds.curves import curves
from knitlab.figures.kinds.samples import samples
from knitlab.figures.kinds.sensitivity import sensitivity
from knitlab.figures.registry import figure_kind
from knitlab.figures.style import value_colours
from knitlab.io.errors import InputError
from knitlab.observables.status import Status
from knitlab.runs.figure_names import FIGURE_NAMES
from knitlab.runs.plan import make_plan
from tests.cubes.artificial_cubes import STATUS, synthetic_cube
from tests.refusals import refused


@pytest.fixture
def cube_file(tmp_path):
    synthetic_cube().to_netcdf(tmp_path / "cube.nc")
    return tmp_path / "cube.nc"


@pytest.mark.parametrize("name", FIGURE_NAMES)
def test_every_file_declares_the_figure_of_its_name(name):
    kind = figure_kind(name)
    assert kind.draw.__module__.endswith(f".{name}")
    assert kind.summary
    assert getattr(kl.plot, name).__doc__.startswith(kind.summary)


def test_settings_of_the_user_change_no_figure(cube_file, tmp_path):
    own = {
        "text.usetex": True,
        "font.size": 20,
        "axes.formatter.use_locale": True,
        "axes.grid": True,
    }
    with mpl.rc_context(own):
        draw_figure("auxetic", [cube_file], tmp_path / "theirs.png")
        assert mpl.rcParams["text.usetex"]
    draw_figure("auxetic", [cube_file], tmp_path / "ours.png")
    assert (tmp_path / "theirs.png").read_bytes() == (tmp_path / "ours.png").read_bytes()


def cell_pixels(figure, column, row):
    """Pixels of one place of the map, inside its border."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())[..., :3].astype(int)
    (left, low), (right, high) = figure.axes[0].transData.transform(
        [(column - 0.4, row - 0.4), (column + 0.4, row + 0.4)]
    )
    height = image.shape[0]
    return image[int(height - high) : int(height - low), int(left) : int(right)].reshape(-1, 3)


@pytest.mark.slow
def test_failed_and_missing_designs_are_not_drawn_as_values():
    figure = auxetic([synthetic_cube()])
    # P is 2, 4, 8 and 16 from the left: (8, 32), (2, 32), (2, 64), and (4, 64), which is excluded.
    without = ((0, 2), (2, 0), (3, 0), (2, 1))
    for column, row in without:
        pixels = cell_pixels(figure, column, row)
        assert np.ptp(pixels, axis=1).max() <= 2, "a cell without a value has a colour"
    for column, row in ((0, 1), (1, 1)):
        background = np.median(cell_pixels(figure, column, row), axis=0)
        assert np.ptp(background) > 20, "a value has no colour"
    looks = [cell_pixels(figure, *cell).mean() for cell in without]
    assert len({round(look) for look in looks}) == 4
    assert looks[-1] == 255, "an impossible cell is drawn"


def values_written(axes):
    """Texts of the cells of a map, without the names of the designs."""
    return [text.get_text() for text in axes.texts if not text.get_text().startswith("(")]


def test_the_map_writes_each_value_with_its_strain():
    axes = auxetic([synthetic_cube()]).axes[0]
    assert values_written(axes) == ["0.05\nat 10%", "−0.80\nat 10%", "−0.40\nat 10%"]


def test_the_map_has_a_cell_for_every_design_and_none_for_what_cannot_be():
    axes = auxetic([synthetic_cube()]).axes[0]
    named = [text.get_text() for text in axes.texts if text.get_text().startswith("(")]
    planned = [design for design, status in STATUS.items() if status is not Status.excluded]
    assert sorted(named) == sorted(map(str, planned))
    cells = {(patch.get_x() + 0.5, patch.get_y() + 0.5) for patch in axes.patches}
    periods, stripes = [m / (2 * n) for n, m in planned], [2, 4, 8]
    places = sorted(set(periods))
    assert [label.get_text() for label in axes.get_xticklabels()] == [f"{p:g}" for p in places]
    assert cells == {
        (places.index(p), stripes.index(n)) for (n, _), p in zip(planned, periods, strict=True)
    }


def test_the_colour_bar_spans_the_values_and_zero_is_white():
    assert auxetic([synthetic_cube()]).axes[1].get_ylim() == pytest.approx((-0.8, 0.05))
    colours = value_colours(np.array([-0.8, 0.05]))
    assert colours.to_rgba(0.0)[:3] == pytest.approx(colours.to_rgba(-0.0)[:3], abs=0.02)
    assert min(colours.to_rgba(0.0)[:3]) > 0.95


def test_the_map_shows_the_ratio_at_a_selected_strain():
    cube = synthetic_cube()
    axes = draw("auxetic", [cube], {"applied_strain": 0.2}).axes[0]
    at = cube["poisson_ratio"].sel(applied_strain=0.2)
    wanted = [
        f"{float(at.sel(n_stripe=n, n_subunit=m)):.2f}".replace("-", "−")
        for n, m in ((2, 16), (4, 16), (4, 32))
    ]
    assert values_written(axes) == wanted


def with_spread(half):
    """An artificial cube: copies of (4, 16) differ by a value at 10 % strain, others by 0.02."""
    cube = synthetic_cube()
    width = xr.full_like(cube["poisson_ratio"], 0.01)
    width.loc[{"n_stripe": 4, "n_subunit": 16, "applied_strain": 0.1}] = half
    for end, sign in (("low", -1), ("high", 1)):
        cube[f"poisson_ratio_{end}"] = cube["poisson_ratio"] + sign * width
    return cube


@pytest.mark.parametrize(("half", "mark"), [(0.024, ""), (0.03, "\nspread 0.06")])
def test_the_map_marks_designs_whose_copies_differ_by_more_than_a_twentieth(half, mark):
    figure = auxetic([with_spread(half)])
    written = values_written(figure.axes[0])
    assert written == ["0.05\nat 10%", f"−0.80\nat 10%{mark}", "−0.40\nat 10%"]
    notes = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert any("spread" in note for note in notes) == bool(mark)


def test_curves_have_a_band_from_the_lowest_to_the_highest_copy():
    axes = np.array(curves([with_spread(0.03)]).axes).reshape(3, 3)[2, 1]
    first = axes.collections[0].get_paths()[0].vertices
    for strain, low, high in ((0.1, -0.83, -0.77), (0.2, -0.41, -0.39)):
        edge = first[np.isclose(first[:, 0], strain), 1]
        assert np.allclose([edge.min(), edge.max()], [low, high])


def test_the_sensitivity_map_frames_the_largest_of_each_design():
    axes = sensitivity(synthetic_cube(sensitivities=True)).axes[0]
    designs = [label.get_text().split("  ")[0] for label in axes.get_yticklabels()]
    assert designs == ["(2, 16)", "(2, 32)", "(2, 64)", "(4, 16)", "(4, 32)", "(8, 32)"]
    bold = [text.get_text() for text in axes.texts if text.get_weight() == "bold"]
    assert bold == ["+0.10", "−1.60", "−0.80"]
    frames = [patch for patch in axes.patches if patch.get_facecolor()[3] == 0]
    places = [(round(of.get_x() + 0.5), of.get_y() + 0.5) for of in frames]
    assert places == [(1, 0), (1, 3), (1, 4)]
    hatched = [patch.get_y() + 0.5 for patch in axes.patches if patch.get_hatch()]
    assert sorted(set(hatched)) == [1, 2, 5], "a design without a value is not marked"


def test_curves_have_a_line_for_every_run_and_a_cross_where_one_ended():
    ratio = np.array(curves([synthetic_cube()]).axes).reshape(3, 3)[2]
    lines = [[line for line in axes.lines if "(P = " in line.get_label()] for axes in ratio]
    assert [len(column) for column in lines] == [1, 2, 1]
    assert lines[1][0].get_ydata().tolist() == [-0.8, -0.4]
    crosses = [line for axes in ratio for line in axes.lines if line.get_marker() == "x"]
    assert [line.get_xdata().tolist() for line in crosses] == [[0.1]]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".pdf", ".svg", ".png"])
def test_a_figure_is_written_in_the_format_of_its_suffix(cube_file, tmp_path, suffix):
    output = tmp_path / "figures" / f"map{suffix}"
    assert draw_figure("auxetic", [cube_file], output) == output
    assert [path.name for path in output.parent.iterdir()] == [output.name]
    start = output.read_bytes()[:300]
    assert {".pdf": b"%PDF", ".svg": b"<svg", ".png": b"\x89PNG"}[suffix] in start


@pytest.mark.parametrize(
    ("kind", "output", "selections", "named"),
    [
        ("auxetic", "map.jpeg2", {}, ["map.jpeg2", ".svg"]),
        ("auxetic", "map.pdf", {"n_stripe": 3}, ["n_stripe", "3", "choose from 2, 4, 8"]),
        ("shape", "shape.png", {}, ["cases", "node position"]),
        ("curves", "curves.png", {"n_stripe": 2, "n_subunit": 64}, ["designs", "run"]),
        ("auxetic", "map.pdf", {"cell_x": 1}, ["cell_x", "auxetic", "n_subunit"]),
        ("sensitivity", "map.pdf", {}, ["sensitivities = true"]),
        ("samples", "map.pdf", {}, ["cases", "case files"]),
    ],
)
def test_what_cannot_be_drawn_writes_nothing(cube_file, tmp_path, kind, output, selections, named):
    with refused(*named):
        draw_figure(kind, [cube_file], tmp_path / output, selections)
    assert list(tmp_path.iterdir()) == [cube_file]


def synthetic_case(periodic: bool, pattern: str = "checkerboard") -> xr.Dataset:
    """A flat case of 2 × 1 unit cells of (4, 16), stretched differently in its cells."""
    side = 32 if pattern == "framed" else 16
    rows, columns = (side, side) if periodic else (2 * side + 1, side + 1)
    y, x = np.mgrid[:rows, :columns]
    flat = np.stack([x, y, 0.1 * (x % 2)], axis=-1)
    cells = (1, 1) if periodic else (2, 1)
    lengths = {name: ("applied_strain", [16.0, 16.0]) for name in ("length_x", "length_y")}
    boundary = "periodic" if periodic else "clamped"
    design = ["n_stripe=4", "n_subunit=16", "cells_per_period=4", "robustness=0"]
    design += [f"boundary={boundary}", f"unit_cells={list(cells)}"]
    plan = make_plan("periodic", [*design, f"pattern={pattern}"])
    (planned,) = plan.cases.values()
    return xr.Dataset(
        {
            "position": (("applied_strain", "node_y", "node_x", "component"), [flat, 1.2 * flat]),
            "strain_xx": (
                ("applied_strain", "cell_y", "cell_x"),
                [np.zeros(cells), np.reshape([0.2, -0.1][: cells[0]], cells)],
            ),
            "status": ((), np.int8(Status.ok)),
            **(lengths if periodic else {}),
        },
        {"applied_strain": [0.0, 0.2], "n_stripe": 4, "n_subunit": 16},
        {"parameters": json.dumps(planned.record)},
    )


def test_stretched_samples_have_the_colour_of_each_unit_cell():
    relaxed, stretched, _ = samples([synthetic_case(periodic=False)]).axes
    assert relaxed.get_title().endswith("relaxed")
    assert stretched.get_title().endswith("pulled 20%")
    faces = stretched.collections[0]
    colours = faces.get_facecolors()
    redder = colours[:, 0] > colours[:, 2]
    middle = np.array([path.vertices[:4, 1].mean() for path in faces.get_paths()])
    assert redder[middle < 16 * 1.2].all()
    assert not redder[middle > 16 * 1.2].any()


def test_stretched_samples_are_between_clamps():
    with pytest.raises(InputError, match="periodic"):
        samples([synthetic_case(periodic=True)])


@pytest.mark.parametrize("strain", [0.0, 0.2])
def test_a_shape_has_the_colour_of_its_height_at_the_selected_strain(strain):
    case = synthetic_case(periodic=False)
    axes = draw("shape", [case], {"applied_strain": strain}).axes[0]
    faces = axes.collections[0]
    nodes = case["position"].sel(applied_strain=strain).values
    assert faces.get_datalim(axes.transData).x1 == pytest.approx(nodes[..., 0].max())
    # All faces of this sheet have one mean height, which no shading may tell apart.
    assert len(np.unique(faces.get_facecolors(), axis=0)) == 1
    assert "pulled 20%" in axes.get_title() if strain else "relaxed" in axes.get_title()


def test_a_strain_whose_shape_is_not_kept_is_refused():
    case = synthetic_case(periodic=False)
    case["position"][1] = np.nan
    with pytest.raises(InputError, match=r"applied_strain=0.2.* at 0"):
        draw("shape", [case], {"applied_strain": 0.2})


@pytest.mark.slow
def test_figures_and_queries_never_import_jax():
    program = """if True:
        import importlib, pkgutil, sys
        import knitlab.cli, knitlab.cubes.query, knitlab.figures
        for module in pkgutil.walk_packages(knitlab.figures.__path__, "knitlab.figures."):
            importlib.import_module(module.name)
        print("jax" in sys.modules)
    """
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "False"
