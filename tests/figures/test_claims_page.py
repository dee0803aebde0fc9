"""The page of claims: reliable claims, near misses, and figures."""

import pytest
from click.testing import CliRunner

from knitlab.claims.claims import TOPICS, read_claims
from knitlab.claims.judgement import judged
from knitlab.cli import main
from knitlab.cubes.cube_file import write_cube
from knitlab.figures.claims_page import _blocks, introduction, reliance
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
