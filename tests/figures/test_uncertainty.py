"""The map of uncertainty: what its cells say, and that a changed material is drawn again."""

import pytest

import knitlab as kl
from knitlab.figures.drawing import draw, draw_figure
from knitlab.io.shipped import shipped
from tests.refusals import refused

ROOT = shipped("workflows").parent
CUBE = ROOT / "results" / "reference" / "acrylic"
ACRYLIC = ROOT / "docs" / "examples" / "swatches" / "acrylic.toml"


@pytest.mark.parametrize("strain", [None, 0.12])
def test_a_cell_has_the_value_its_deviation_and_the_number_to_measure_better(strain):
    cube = kl.open_cube(CUBE)
    known = kl.uncertainty(cube, material=ACRYLIC).sel(n_stripe=4, n_subunit=16)
    name, selections = "poisson_ratio_min", {}
    options = {"material": str(ACRYLIC)}
    if strain is not None:
        name, selections = "reaction_force", {"applied_strain": strain}
        options["of"] = name
        known = known.sel(selections)
    texts = [
        text.get_text() for text in draw("uncertainty", [cube], selections, options).axes[0].texts
    ]
    written = texts[texts.index("(4, 16)") + 1]
    value, deviation = (
        float(part.replace("−", "-")) for part in written.splitlines()[0].split(" ± ")
    )
    assert value == pytest.approx(known[name].item(), rel=0.01)
    assert deviation == pytest.approx(known[f"{name}_halfwidth"].item(), rel=0.05)
    knit, quantity = known[f"{name}_leading"].item().split("_", 1)
    symbol = {"theta_0": r"\theta_0"}.get(quantity, quantity)
    assert written.splitlines()[1].startswith(f"{knit} ${symbol}$")
    explained = known[f"{name}_explained"].max().item()
    assert written.endswith(f" {explained:.0%}")


def test_a_map_of_uncertainty_needs_a_material_and_is_drawn_again_for_another(tmp_path):
    with refused("material"):
        draw("uncertainty", [kl.open_cube(CUBE)])
    file, output = tmp_path / "a.toml", tmp_path / "a.svg"
    file.write_text(ACRYLIC.read_text())
    options = {"material": str(file)}
    drawn = draw_figure("uncertainty", [CUBE], output, {}, options).read_bytes()
    assert draw_figure("uncertainty", [CUBE], output, {}, options).read_bytes() == drawn
    material = kl.Material.read(file)
    row = material.covariances[("garter", 8)]["k_s"]
    assert material.covariances[("rib", 4)]["k_s"]["k_s"] == pytest.approx(0.0025064, rel=1e-4)
    file.write_text(file.read_text().replace(f"k_s = {row['k_s']}", f"k_s = {3 * row['k_s']}"))
    assert draw_figure("uncertainty", [CUBE], output, {}, options).read_bytes() != drawn
