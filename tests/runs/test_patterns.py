"""Named patterns: contents of a file, the resulting designs, and refused patterns."""

import warnings

import matplotlib.image
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import knitlab as kl
from knitlab.io.errors import InputError
from knitlab.runs.plan import make_plan
from knitlab.solvers.case import case_of
from tests.refusals import refused

DESIGN = ("n_stripe=4", "n_subunit=16", "boundary=periodic")


def case(*overrides):
    (found,) = make_plan("periodic", (*DESIGN, *overrides)).cases.values()
    return found


def own(tmp_path, text, *overrides):
    """The case of a pattern ``own`` of a file."""
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    return case(f"pattern_files={path}", "pattern=own", *overrides)


def said_of(tmp_path, text):
    with pytest.raises(InputError) as caught:
        own(tmp_path, text)
    return str(caught.value)


def test_the_checkerboard_by_name_is_the_default_design():
    assert case("pattern=checkerboard").case_id == case().case_id


def test_several_patterns_are_a_dimension_of_the_cube():
    plan = make_plan("periodic", (*DESIGN, "pattern=checkerboard,basket,miura"))
    assert plan.dims == ("n_stripe", "n_subunit", "pattern")
    names = [each.design["pattern"] for each in plan.cases.values()]
    assert names == ["checkerboard", "basket", "miura"]
    assert len(set(plan.cases)) == 3


@pytest.mark.parametrize("name", ["checkerboard", "basket", "ribbed_bands", "framed", "miura"])
def test_a_case_of_every_named_pattern_is_read_back_from_its_record(name):
    original = case(f"pattern={name}")
    assert case_of(original.record) == original
    np.testing.assert_array_equal(case_of(original.record).sample.knit, original.sample.knit)


def test_graded_samples_have_cells_and_stripes_of_their_own():
    plan = make_plan("graded")
    rows, stripes = plan.cases.values()
    assert rows.cell_grid.count == (6, 4)
    assert np.diff(rows.cell_grid.rows).tolist() == [16, 16, 24, 32, 40, 48]
    assert stripes.cell_grid.count == (4, 6)
    assert [stripe.n for stripe in stripes.grading.weft] == [2, 4, 6, 8]
    # The stitches of neighbours match: every column has whole wales, every row whole courses.
    for graded in (rows, stripes):
        courses, wales = graded.stitches_per_cell
        assert courses.sum() == graded.stitches.courses
        assert wales.sum() == graded.stitches.wales
    assert (rows.stitches.courses, rows.stitches.wales) == (704, 192)
    assert (stripes.stitches.courses, stripes.stitches.wales) == (384, 288)


def test_sizes_in_stitches_and_in_periods_are_one_pattern(tmp_path):
    stitches = own(
        tmp_path, '[own]\nrows = ["GR"]\ncolumn_stitches = [8, 24]\nrow_courses = [32]\n'
    )
    periods = own(tmp_path, '[own]\nrows = ["GR"]\ncolumn_periods = [1, 3]\nrow_periods = [2]\n')
    assert stitches.case_id == periods.case_id


def test_a_patch_with_an_odd_number_of_stripes_is_refused_with_its_place(tmp_path):
    text = said_of(tmp_path, '[own]\nrows = ["GR", "RG"]\ncolumn_stitches = [16, 20]\n')
    assert "pattern=own (n_stripe 4, n_subunit 16): column 2: 20 stitches are 5 stripes" in text
    assert "take 16 or 24" in text
    text = said_of(tmp_path, '[own]\nrows = ["GR", "RG"]\nrow_courses = [24, 32]\n')
    assert "row, from the top, 1: 24 courses are 3 stripes of n_stripe 4" in text
    assert "take 16 or 32" in text


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('rows = ["GR", "R"]', ["rectangle"]),
        ('rows = ["GX"]', ["row 1", "column 2", "'X'"]),
        ('rows = ["GR"]\ncolumn_periods = [1]', ["1 values", "2 columns"]),
        ('rows = ["GR"]\ncolumn_n_stripe = [4, 5]', ["column 2", "rib stripe of 5"]),
        ('rows = ["GR"]\nrow_n_stripe = [3]', ["n_stripe 3"]),
        ('rows = ["GR"]\ncell = [1, 3]', ["cell = [1, 3]", "1 by 2 patches"]),
        ("row_periods = [1]", ["rows, map and image"]),
        ('rows = ["GR"]\nmap = "a.txt"', ["rows and map"]),
        ('rows = ["GR"]\ncolours = {red = "R"}', ["image", "colours"]),
        ('rows = ["GR"]\nrow_periods = [1]\nrow_courses = [16]', ["row_courses", "row_periods"]),
        ('rows = ["PP"]\nfolds = [{along = "wale", at = 9, theta_0 = 1.0}]', ["fold 1", "at = 9"]),
        ('map = "missing.txt"', ["missing.txt"]),
        ('rows = ["GR"]\n[GR]\nrows = ["GR"]', ["'GR'", "row of patches"]),
    ],
)
def test_patterns_that_cannot_be_knitted_are_refused_with_their_place(tmp_path, text, named):
    said = said_of(tmp_path, f"[own]\n{text}\n")
    assert all(part in said for part in named), said


@given(st.lists(st.text("RGP", min_size=3, max_size=3), min_size=1, max_size=4))
def test_text_and_image_give_the_same_pattern(tmp_path_factory, rows):
    folder = tmp_path_factory.mktemp("map")
    (folder / "map.txt").write_text("\n".join(rows).lower() + "\n\n", encoding="utf-8")
    colours = {"#ff0000": "R", "#0000ff": "G", "#ffffff": "P"}
    levels = {"R": (1.0, 0, 0), "G": (0, 0, 1.0), "P": (1.0, 1.0, 1.0)}
    pixels = np.array([[levels[letter] for letter in row] for row in rows])
    matplotlib.image.imsave(folder / "map.png", pixels)
    text = kl.Pattern(map="map.txt").patches(folder)
    image = kl.Pattern(image="map.png", colours=colours).patches(folder)
    assert text == image == tuple(rows)


@pytest.mark.parametrize(
    ("mode", "pixel", "named"),
    [
        *((mode, (255, 255, 255, 0), "transparent") for mode in ("RGBA", "LA", "P")),
        ("RGBA", (0, 255, 0, 255), "#00ff00"),
    ],
)
def test_pixels_without_a_letter_are_refused_by_their_position(tmp_path, mode, pixel, named):
    pixels = np.full((3, 2, 4), 255, np.uint8)
    pixels[2, 1] = pixel
    drawn = Image.fromarray(pixels)
    (drawn if mode == "RGBA" else drawn.convert(mode)).save(tmp_path / "map.png")
    pattern = kl.Pattern(image="map.png", colours={"white": "R"})
    with refused(f"pixel 2 of line 3 is {named}", "it has #ffffff"):
        pattern.patches(tmp_path)


def test_a_changed_map_changes_the_plan(tmp_path):
    (tmp_path / "map.txt").write_text("GR\nRG\n", encoding="utf-8")
    before = own(tmp_path, '[own]\nmap = "map.txt"\n')
    (tmp_path / "map.txt").write_text("GR\nGR\n", encoding="utf-8")
    assert own(tmp_path, '[own]\nmap = "map.txt"\n').case_id != before.case_id
    plan = make_plan("periodic", (*DESIGN, f"pattern_files={tmp_path / 'own.toml'}", "pattern=own"))
    assert str(tmp_path / "map.txt") in plan.inputs


def test_plain_knit_is_a_setting_and_enters_only_patterns_that_have_it():
    assert case().plain is None
    framed = case("pattern=framed", "plain_stretch_weft=2.0")
    assert framed.plain.plain_stretch_weft == 2.0


def test_needles_take_as_many_repeats_as_fit():
    (sample,) = make_plan("paper", ("n_stripe=4", "n_subunit=16", "pattern=basket")).cases.values()
    assert sample.unit_cells == (10, 5)
    assert sample.stitches.wales == 320


@pytest.mark.slow
def test_a_pattern_is_simulated_from_python():
    pattern = kl.Pattern(rows=("RP", "PG"), column_periods=(2, 1), row_periods=(1, 2))
    design = kl.Design(n_stripe=4, n_subunit=16, boundary="periodic", pattern=pattern)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        test = kl.simulate(design, [0, 0.03])
    assert test.sizes["node_y"] == test.sizes["node_x"] == 12
    assert np.isfinite(test["poisson_ratio"][1])
    assert np.isfinite(test["rib_width_centre"])
    with pytest.raises(InputError, match="rows"):
        kl.Pattern()


@pytest.mark.parametrize("number", [100_000, 1_000_001])
def test_a_long_map_that_is_none_has_a_short_message(tmp_path, number):
    (tmp_path / "map.txt").write_text("." * number, encoding="utf-8")
    for pattern in ({"rows": ("." * number,)}, {"rows": (".",) * number}, {"map": "map.txt"}):
        with pytest.raises(InputError) as caught:
            kl.Pattern(**pattern).patches(tmp_path)
        named = "'.'" if number < 1_000_000 else "1,000,001 patches"
        assert named in str(caught.value)
        assert len(str(caught.value)) < 5000
