"""The shipped parameters: the paper's tables and designs."""

from knitlab.runs.parameters import defaults


def test_the_tables_are_those_of_the_paper():
    stripes = defaults().stripes
    assert sorted(map(int, stripes.rib.n)) == [2, 4, 6, 8]
    assert sorted(map(int, stripes.garter.n)) == [4, 6, 8, 12, 16]
    assert stripes.rib.n["6"].model_dump(exclude_none=True) == {
        "period": 1.93,
        "k_s": 0.562,
        "theta_0": 0.754,
        "k_t": 0.0072,
    }
    assert stripes.garter.n["12"].k_t == 0.025


def test_the_paper_has_twenty_designs():
    pairs = defaults().designs.root["paper"].pairs
    assert len(pairs) == len(set(pairs)) == 20
    assert {m // (2 * n) for n, m in pairs if n == 2} == {4, 5, 6, 7, 8}
    assert {m // (2 * n) for n, m in pairs if n > 2} == {2, 3, 4, 5, 6}


def test_every_design_of_a_set_is_possible():
    known = defaults()
    for members in known.designs.root.values():
        assert not [pair for pair in members.pairs if known.stripes.impossible(*pair)]
