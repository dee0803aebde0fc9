import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from knitlab.model.fold_lines import fold_senses
from tests.fabrics import checkerboard, patch_map

LINES = hnp.arrays(bool, st.tuples(st.integers(1, 3), st.integers(1, 6))).map(
    lambda patches: np.repeat(patches, 4, axis=1)
)
PHASES = st.sampled_from(["stripe_border", "stripe_centre"])


@pytest.mark.parametrize(("phase", "folds"), [("stripe_border", 2 * 3 - 1), ("stripe_centre", 6)])
def test_the_number_of_folds_of_a_single_patch_follows_from_fold_phase(phase, folds):
    senses = fold_senses(checkerboard(3).knit_cells("rib"), phase, periodic=True)
    assert (np.count_nonzero(senses, axis=1) == folds).all()


@given(LINES, PHASES, st.booleans())
def test_mountains_and_valleys_alternate_and_lie_inside_their_knit(like, phase, periodic):
    senses = fold_senses(like, phase, periodic)
    inside = like & np.roll(like, 1, axis=1)
    assert not senses[~inside].any()
    if not periodic:
        assert not senses[:, 0].any()
    for line, own in zip(senses, like, strict=True):
        runs = np.split(line, np.flatnonzero(~own)) if not periodic else []
        for run in runs:
            folds = run[run != 0]
            assert (folds[:1] == 1).all()
            assert (folds[1:] == -folds[:-1]).all()


@given(LINES, PHASES, st.integers(0, 5))
def test_periodic_folds_shift_with_their_pattern(like, phase, patches):
    # Runs that fill the line have no start, so their first fold is a convention.
    like = like[~like.all(axis=1)]
    shifted = fold_senses(np.roll(like, 4 * patches, axis=1), phase, periodic=True)
    assert (shifted == np.roll(fold_senses(like, phase, True), 4 * patches, axis=1)).all()


def test_neighbouring_patches_of_one_knit_fold_as_one_patch():
    one = fold_senses(patch_map(["RR"], 1).knit_cells("rib"), "stripe_border", periodic=False)
    other = fold_senses(patch_map(["R"], 2).knit_cells("rib"), "stripe_border", periodic=False)
    assert (one[0] == other[0]).all()


def test_text_reads_from_the_top_course_down():
    assert patch_map(["GR", "RG"], 2).knit.tolist() == [["R", "G"], ["G", "R"]]


@pytest.mark.parametrize("rows", [[], ["RG", "R"], ["RX"], [""]])
def test_a_patch_map_must_be_a_rectangle_of_known_letters(rows):
    with pytest.raises(ValueError, match="patch map"):
        patch_map(rows, 1)
