"""The page of claims: reliable claims, near misses, and figures."""

import re

import pytest
from click.testing import CliRunner

from knitlab.claims.claims import TOPICS, read_claims
from knitlab.claims.judgement import judged
from knitlab.cli import main
from knitlab.cubes.cube_file import write_cube
from knitlab.figures.claims_page import _blocks, introduction, reliance, write_page
from knitlab.io.errors import InputError
from tests.claims.test_claims import good_checkerboards, good_stripes


@pytest.fixture(scope="module")
def cubes(tmp_path_factory):
    """Checkerboards that fail one claim, and stripes that miss one narrowly and fail another."""
    folder = tmp_path_factory.mktemp("cubes")
    boards, stripes = good_checkerboards(), good_stripes()
    boards["poisson_ratio_min"].loc[{"n_stripe": 4, "n_subunit": 48}] = -0.1
    stripes["zigzag_force"] *= 2
    stripes["row_force"].loc[{"knit": "rib", "n": 8, "applied_strain": slice(0.04, 0.06)}] *= 5
    write_cube(boards, folder / "boards.nc")
    write_cube(stripes, folder / "stripes.nc")
    return [folder / "boards.nc", folder / "stripes.nc"]


@pytest.fixture(scope="module")
def judgements(cubes):
    return judged(read_claims(), cubes)


def test_a_page_of_another_format_is_refused(tmp_path):
    with pytest.raises(InputError, match="is not a page of Markdown; give it the suffix"):
        write_page([], tmp_path / "page.html")


def test_model_options_are_shown_as_they_are(tmp_path):
    boards = good_checkerboards().assign_attrs(model_boundary="<b>", model_cell_size="<i>")
    write_cube(boards, tmp_path / "cube.nc")
    text = "".join(_blocks(judged(read_claims(), [tmp_path / "cube.nc"]), {}))
    assert r"\<b\>" in text
    assert r"cell_size \<i\>" in text
    assert "<b>" not in text


@pytest.mark.slow
def test_a_markdown_page_has_its_figures_in_a_folder(cubes, tmp_path):
    page = tmp_path / "page.md"
    ran = CliRunner().invoke(main, ["claims", str(cubes[1]), "-o", str(page)])
    assert ran.exit_code == 0
    assert "4 hold, 1 near miss, 1 fail, 33 not measured" in ran.output
    figures = list((tmp_path / "page").glob("*.png"))
    assert figures
    assert all(f"page/{path.name}" in page.read_text() for path in figures)


@pytest.mark.slow
def test_the_page_begins_with_reliable_claims_and_separates_near_misses(cubes, tmp_path):
    page = tmp_path / "page.md"
    write_page(judged(read_claims(), cubes[1:]), page)
    text = page.read_text()
    heads = re.findall("^## (.*)$", text, re.MULTILINE)
    assert heads == [
        "What you may rely on, and what not",
        "What holds",
        "Near misses: they fail by at most 0.25",
        "What fails by more than 0.25",
        "What was not measured",
    ]
    parts = dict(zip(heads, re.split("^## .*$", text, flags=re.MULTILINE)[1:], strict=True))
    assert "lower n is stiffer at first" in parts["Near misses: they fail by at most 0.25"]
    failed = parts["What fails by more than 0.25"]
    assert "for pure rib and garter the 3D model gives the same curves" in failed
    assert "one more row of springs than of hinges" in failed
    assert "one more row of springs than of hinges" not in parts["What holds"]


@pytest.mark.slow
def test_every_claim_is_reported_once_under_its_topic(judgements):
    topics = introduction(judgements)
    assert list(topics) == list(TOPICS)
    said = {topic: " ".join(claims for _, claims in topics[topic]) for topic in topics}
    for each in judgements:
        claim = each.claim
        assert said[claim.topic].count(f"“{claim.quoted}”") == 1
    assert sum(text.count("“") for text in said.values()) == len(judgements)


def test_reliable_claims_hold_by_a_large_margin(judgements):
    for each in judgements:
        margin, group = each.result.margin, reliance(each)
        assert (group == "not measured") == (margin is None)
        if margin is not None:
            assert (group in ("good", "reserved")) == (margin >= 0.25)
            assert (group == "narrow") == (0 <= margin < 0.25)
            assert (group == "near") == (-0.25 <= margin < 0)
            assert (group == "gross") == (margin < -0.25)


def test_claims_that_another_cube_contradicts_are_not_reliable(cubes, tmp_path):
    boards = good_checkerboards().assign_attrs(model_boundary="periodic")
    boards["rib_width_centre"] += 10
    write_cube(boards, tmp_path / "other.nc")
    claims = [claim for claim in read_claims() if claim.name == "rib_centre_contracts_more"]
    (alone,) = judged(claims, cubes)
    (each,) = judged(claims, [*cubes, tmp_path / "other.nc"])
    assert reliance(alone) == reliance(each) == "narrow"
    assert each.contrary
    assert "but it fails at -1.80 on 20 of 20 designs of" in str(introduction([each]))


def test_rows_along_weft_and_warp_are_labelled(judgements):
    twins = [each.claim for each in judgements if "_along_w" in each.claim.name]
    assert len(twins) == 8
    for claim in twins:
        along = claim.measured_along
        assert f"_along_{along}" in claim.name
        assert claim.quoted == f"{claim.text} (here along the {along})"
