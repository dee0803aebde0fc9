"""``knitlab knit``: files, exit codes and messages, and the same from Python."""

import re
from dataclasses import replace

import numpy as np
import pytest

import knitlab as kl
from knitlab.api import knitting
from knitlab.export.knitting.knitout import knitout
from tests.commands import knitlab
from tests.refusals import refused

PREVIEW = "results/reference/periodic"
DESIGN = ("--select", "n_stripe=4", "--select", "n_subunit=16")
SMALL = ("periodic", "--set", "n_stripe=2", "--set", "n_subunit=8")

CHART = "tests/export/knitting/checkerboard.txt"


def run(*words):
    return knitlab("knit", *words)


@pytest.mark.slow
def test_a_design_of_a_cube_gives_all_files(tmp_path):
    names = ("sample.k", "chart.csv", "chart.svg", "chart.png")
    outputs = [word for name in names for word in ("-o", tmp_path / name)]
    result = run(PREVIEW, *DESIGN, *outputs, "--sheet", tmp_path / "sheet.pdf")
    assert result.exit_code == 0, result.output
    sample = kl.open_cube(PREVIEW).sel(n_stripe=4, n_subunit=16)
    width, length = (f"{sample[name].item():.0f}" for name in ("knit_cell_x", "knit_cell_y"))
    assert f"size relaxed  {width} × {length} mm (width × length)" in result.output
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*names, "sheet.pdf"])
    assert (tmp_path / "sample.k").read_bytes().startswith(b";!knitout-2\n;;Machine: SWG061N2\n")
    assert (tmp_path / "sheet.pdf").read_bytes().count(b"/Count 1") == 1


def test_the_table_has_a_line_for_each_course_the_last_first(tmp_path):
    path = tmp_path / "chart.csv"
    assert run(*SMALL, "-o", path).exit_code == 0
    header, *lines = [line.split(",") for line in path.read_text().splitlines()]
    chart = kl.knit("periodic", n_stripe=2, n_subunit=8).chart
    assert header == ["course", *map(str, range(1, 17))]
    assert [int(line[0]) for line in lines] == [*range(32, 0, -1)]
    letters = np.array([line[1:] for line in lines[::-1]])
    assert ((letters == "k") == chart.front).all()


def test_plated_stitches_have_the_letter_of_their_electrode_in_the_table(tmp_path):
    sample = kl.knit("sensor", n_stripe=4, n_subunit=16)
    lowest = sample.save(tmp_path / "chart.csv").read_text().splitlines()[-1].split(",")
    # The yarn of each is brought in at the right end of its first course.
    rib = "kA kA kA kA:in p p p p kB kB kB kB:in p p p p"
    assert lowest[1:] == [*rib.split(), *["k"] * 16]


def test_a_design_takes_the_electrodes_of_an_object_and_no_keywords():
    known, design = kl.defaults(), kl.Design(4, 16, boundary="periodic")
    plated = replace(known.capacitor, layout=known.layouts["checkerboard"])
    sample = kl.knit(design, model=kl.Model(cell_size="flat"), capacitor=plated)
    assert sample.program == kl.knit("sensor", n_stripe=4, n_subunit=16).program
    with refused("layout", "Design"):
        kl.knit(design, layout="checkerboard")
    with refused("capacitor", "Design"):
        kl.knit("periodic", capacitor=plated)


@pytest.mark.parametrize("end", [pytest.param("bind_off", marks=pytest.mark.slow), "drop"])
def test_a_checked_program_has_exit_code_0(end):
    result = run(*SMALL, "--machine", f"end={end}", "--machine", "waste_courses=2", "--check")
    assert result.exit_code == 0, result.output
    assert "own checks:" in result.output
    assert "interpreter:" in result.output


def test_a_program_with_a_fault_has_exit_code_1(monkeypatch):
    def forgetful(*arguments):
        return knitout(*arguments).replace("outhook 3\n", "")

    monkeypatch.setattr(knitting, "knitout", forgetful)
    result = run(*SMALL, "--machine", "waste_courses=2", "--check")
    assert result.exit_code == 1
    assert "ends while carrier 3 is in action; add outhook 3" in result.stderr


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("periodic",), "--select"),
        ((PREVIEW, "--select", "n_stripe=4"), "3 designs"),
        ((PREVIEW, *DESIGN, "--set", "n_stripe=4"), "n_stripe"),
        ((*SMALL, "--repeats", "4"), "--repeats"),
        ((*SMALL, "--repeats", "1x1", "--needles", "90"), "needles"),
        ((*SMALL, "--needles", "9"), "16"),
        ((*SMALL, "--machine", "ends=drop"), "'ends'"),
        ((*SMALL, "--machine", "model=Stoll"), "SWG061N2"),
        ((*SMALL, "-o", "sample.dat"), "sample.dat"),
        (("nothing",), "'nothing'"),
    ],
)
def test_invalid_input_is_named_with_exit_code_2(words, named):
    result = run(*words)
    assert result.exit_code == 2, result.output
    assert named in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.slow
def test_a_design_a_test_and_a_cube_give_the_same_chart():
    design = kl.Design(n_stripe=2, n_subunit=8, boundary="periodic")
    test = kl.simulate(design, [0, 0.03])
    samples = [kl.knit(design), kl.knit(test), kl.knit("periodic", n_stripe=2, n_subunit=8)]
    assert len({sample.program for sample in samples}) == 1
    assert samples[0].relaxed_size is None
    assert samples[1].relaxed_size is not None


def test_a_cube_without_its_cases_is_planned_again(tmp_path):
    cube = kl.open_cube(PREVIEW)
    path = tmp_path / "cube.nc"
    cube.to_netcdf(path)
    sample = kl.knit(path, n_stripe=6, n_subunit=24)
    assert sample.chart.front.shape == (96, 48)
    cube.attrs["workflow"] = "own"
    cube.to_netcdf(tmp_path / "other.nc")
    with refused("plan"):
        kl.knit(tmp_path / "other.nc", n_stripe=6, n_subunit=24)


def test_the_relaxed_size_is_that_of_the_cube():
    cube = kl.open_cube(PREVIEW).sel(n_stripe=[4], n_subunit=[16])
    width, length = kl.knit(cube, repeats=(3, 2)).relaxed_size
    assert width == pytest.approx(2 * float(cube["knit_cell_x"].squeeze()))
    assert length == pytest.approx(3 * float(cube["knit_cell_y"].squeeze()))


def test_a_kept_cube_is_knitted_at_another_size_of_a_stitch(tmp_path):
    sizes = {}
    for width in ("0.5", "1.0"):
        done = run(PREVIEW, *DESIGN, "--set", f"stitch_width={width}", "-o", tmp_path / "sample.k")
        assert done.exit_code == 0, done.output
        (line,) = (line for line in done.output.splitlines() if line.startswith("size flat"))
        sizes[width] = [int(word) for word in line.split() if word.isdigit()]
    assert sizes["1.0"][0] == 2 * sizes["0.5"][0]
    assert sizes["1.0"][1] == sizes["0.5"][1]


def test_what_leaves_for_the_machine_says_which_yarn_it_needs(tmp_path):
    words = ("periodic", "--set", "n_stripe=4", "--set", "n_subunit=16", "-o", tmp_path / "a.k")
    needed = run(*words, "--set", "rib_k_t_factor=2").output
    assert "rib 4 needs k_t × 2.00 of the paper's yarn" in needed
    assert "garter 8 needs" not in needed
    usual = run(*words).output
    assert "needs" not in usual
    assert "yarn          that of the paper" in usual
    assert "case          4-16-" in usual


def test_a_chart_is_read_as_a_pattern_that_a_workflow_takes(tmp_path):
    output = tmp_path / "mine.toml"
    result = knitlab("read", CHART, "-o", output)
    assert result.exit_code == 0, result.output
    assert "patch         courses 1 to 16, wales 1 to 8: rib, stripes of 2 wales" in result.output
    words = result.output.split("knitlab run ")[1].split()
    path = tmp_path / "again.csv"
    assert run(*words, "-o", path).exit_code == 0
    assert (kl.read_chart(path).chart.front == kl.read_chart(CHART).chart.front).all()


def test_what_no_pattern_has_ends_with_exit_code_1(tmp_path):
    path = tmp_path / "chart.txt"
    path.write_text("kkpp\nkpkp\n", encoding="utf-8")
    result = knitlab("read", path)
    assert result.exit_code == 1
    assert "neither rib nor garter" in result.output


MERINO = """
name = "merino"
yarn = "merino 2/30, two ends"
stitch_size = 9
machine = "Kniterate"
stitch_width = { value = 3.2, unit = "mm", source = "swatch" }
stitch_height = { value = 1.9, unit = "mm", source = "swatch" }
thickness = { value = 1.2, unit = "mm", source = "swatch" }
z_max = { value = 40.0, unit = "mm", source = "swatch" }

[rib]
source = "swatch"
unit = { period = "mm", k_s = "N/mm", theta_0 = "rad", k_t = "N" }
n.4 = { period = 10.0, k_s = 2.6, theta_0 = 0.74, k_t = 0.93 }

[garter]
source = "swatch"
unit = { period = "mm", k_s = "N/mm", theta_0 = "rad", k_t = "N" }
n.8 = { period = 10.0, k_s = 8.0, theta_0 = 1.26, k_t = 1.6 }
"""


@pytest.fixture
def merino(tmp_path):
    path = tmp_path / "merino.toml"
    path.write_text(MERINO, encoding="utf-8")
    return path


def of_row(output, name):
    (line,) = (line for line in output.splitlines() if line.startswith(f"{name:13} "))
    return line[14:]


def test_a_material_brings_its_yarn_stitch_size_and_machine(merino, tmp_path):
    words = ("periodic", "--set", "n_stripe=4", "--set", "n_subunit=16", "--material", merino)
    result = run(*words, "-o", tmp_path / "sample.k")
    assert result.exit_code == 0, result.output
    assert of_row(result.output, "machine") == "Kniterate, 252 needles, 7 an inch"
    assert of_row(result.output, "material") == "merino"
    assert of_row(result.output, "yarn") == "merino 2/30, two ends"
    assert of_row(result.output, "carrier 3") == "body: merino 2/30, two ends"
    assert of_row(result.output, "stitch size") == "body 9 (machine units)"
    # 32 wales and 64 courses of its stitch.
    assert of_row(result.output, "size flat") == "102 × 122 mm (width × length)"
    assert "warning" not in result.stderr
    # The code of the case and the folder of the program may have any digits.
    said = re.sub(r"^(case|knitout) .*$", "", result.output, flags=re.MULTILINE)
    assert not any(word in said for word in ("nylon", "lycra", "34"))
    text = (tmp_path / "sample.k").read_text()
    assert ";;Yarn-3: merino-2/30,-two-ends white" in text
    assert ";;X-Stitch-Number-5: body 9\n" in text


def test_what_a_material_does_not_give_is_said_to_be_not_given(merino):
    lines = MERINO.splitlines(keepends=True)
    bare = [line for line in lines if not line.startswith(("yarn", "stitch_size", "machine"))]
    merino.write_text("".join(bare), encoding="utf-8")
    result = run("sensor", "--set", "n_stripe=4", "--set", "n_subunit=16", "--material", merino)
    assert result.exit_code == 0, result.output
    for name in ("yarn", "carrier 3", "carrier 4", "stitch size"):
        assert "not given" in of_row(result.output, name)
    assert "stitch_size" in result.stderr


def test_another_machine_or_gauge_than_the_material_is_warned_of(merino):
    words = ("periodic", "--set", "n_stripe=4", "--set", "n_subunit=16", "--material", merino)
    result = run(*words, "--machine", "model=SWG061N2")
    assert result.exit_code == 0, result.output
    assert "Kniterate" in result.stderr
    assert "not given" in of_row(result.output, "stitch size")
    for width, warned in (("19", True), ("1.9", False)):
        result = run(*SMALL, "--set", f"stitch_width={width}", "--set", "stitch_height=1")
        assert ("stitch_width" in result.stderr) == warned


def test_the_size_in_cloth_is_that_of_the_gauge_on_every_machine():
    models = ("SWG061N2", "SWG091N2", "Kniterate")
    sizes = {
        of_row(run(*SMALL, "--machine", f"model={model}").output, "size flat") for model in models
    }
    assert sizes == {f"{16 * 1.35:.0f} × {32 * 0.8:.0f} mm (width × length)"}


@pytest.mark.slow
def test_material_and_yarn_are_the_same_from_a_file_an_object_a_plan_and_a_test(merino, tmp_path):
    material, design = kl.Material.read(merino), kl.Design(4, 16, boundary="periodic")
    assert (material.yarn, material.stitch_size) == ("merino 2/30, two ends", 9)
    material.write(tmp_path / "again.toml")
    assert kl.Material.read(tmp_path / "again.toml").on_machine == material.on_machine
    test = kl.simulate(design, [0, 0.03], material=material)
    samples = [
        kl.knit(design, material=material),
        kl.knit(design, material=merino),
        kl.knit(test),
        kl.knit("periodic", n_stripe=4, n_subunit=16, material=str(merino)),
    ]
    assert {sample.program for sample in samples} == {samples[0].program}
    for sample in samples:
        rows = dict(sample.rows())
        assert (rows["material"], rows["yarn"]) == ("merino", "merino 2/30, two ends")
        assert rows["machine"].startswith("Kniterate")
    with refused("material", "Design"):
        kl.knit("periodic", n_stripe=4, n_subunit=16, material=material)
