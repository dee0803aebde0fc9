"""The committed reference results: their figures and the page of claims can be reproduced."""

from pathlib import Path

import pytest

from knitlab.figures.drawing import draw_figure
from knitlab.figures.report.page import write_page
from knitlab.validation.claims import read_claims
from knitlab.validation.judgement import judged

REFERENCE = Path(__file__).parents[3] / "results" / "reference"
JUDGED = ("paper", "stripes", "relaxation", "sensor_stripes", "sensor")
DRAWN = {
    "paper": ("auxetic", "curves", "tension", "wavelength"),
    "lengths": ("readings",),
    "periodic": ("auxetic", "curves", "shape"),
    "preview": ("auxetic", "curves", "shape"),
    "readings": ("readings",),
    "readings_samples": ("readings",),
    "readings_stripes": ("readings",),
    "stripes": ("stripes", "departure"),
    "sensor": ("sensor", "capacitors", "electrodes"),
    "sensor_contact": ("contact",),
    "sensor_stripes": ("capacitors",),
}
SMALLEST = ("preview", "periodic", "sensor_stripes")


@pytest.mark.parametrize(
    "results",
    [
        pytest.param(results, marks=() if results in SMALLEST else pytest.mark.slow)
        for results in DRAWN
    ],
)
def test_figures_are_drawn_from_the_committed_cube_alone(results, tmp_path):
    for kind in DRAWN[results]:
        drawn = draw_figure(kind, [REFERENCE / results], tmp_path / f"{kind}.svg")
        assert b"</svg>" in drawn.read_bytes()[-20:]


@pytest.mark.slow
def test_the_committed_page_of_claims_is_that_of_the_committed_cubes(tmp_path):
    cubes = [REFERENCE / name for name in JUDGED]
    judgements = judged(read_claims(), cubes)
    write_page(judgements, tmp_path / "claims.md")
    committed = (REFERENCE / "claims.md").read_text(encoding="utf-8")
    assert (tmp_path / "claims.md").read_text(encoding="utf-8") == committed
