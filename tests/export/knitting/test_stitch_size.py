"""The size of a stitch against the needles of a machine."""

import pytest

from knitlab.export.knitting.machine import read_machine
from knitlab.export.knitting.specification import implausible_size
from knitlab.model.stitches import Gauge
from knitlab.runs.parameters import defaults

PAPER, KNITERATE = read_machine(), read_machine({"model": "Kniterate"})


def test_the_papers_gauge_is_that_of_its_machine_and_no_other():
    gauge = defaults().gauge
    assert implausible_size(gauge, PAPER) is None
    problem = implausible_size(gauge, KNITERATE)
    assert problem is not None
    # The thing, its value, the pitch of 25.4 / 7 mm and the remedies.
    for word in ("stitch_width", "1.35 mm", "Kniterate", "3.63 mm", "swatch", "needles_per_inch"):
        assert word in problem
    assert (
        implausible_size(gauge, read_machine({"model": "Kniterate", "needles_per_inch": 15}))
        is None
    )


@pytest.mark.parametrize("machine", [PAPER, KNITERATE])
@pytest.mark.parametrize(("factor", "found"), [(0.49, True), (0.51, False), (1.51, True)])
def test_a_stitch_is_half_to_one_and_a_half_needles_wide(machine, factor, found):
    width = factor * 25.4 / machine.needles_per_inch
    assert (implausible_size(Gauge(width, 0.6 * width), machine) is not None) == found
    wide = 0.8 * 25.4 / machine.needles_per_inch
    assert "stitch_height" in (implausible_size(Gauge(wide, 6 * wide), machine) or "")
