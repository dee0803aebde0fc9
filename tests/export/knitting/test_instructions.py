"""The words of hand knitting, knitted by a reader of their own, make the chart again."""

import re

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from knitlab.export.knitting.instructions import instructions
from knitlab.export.knitting.stitch_chart import stitch_chart
from knitlab.io.errors import InputError
from tests.export.knitting.charts import case_of
from tests.export.knitting.test_round_trip import charts
from tests.export.knitting.test_shaping import PIECES, pieces, shaped
from tests.refusals import refused

TERM = re.compile(r"([kp])(\d+)(?: with ([AB]))?")


def stitches_of_words(words, count):
    """The letters of a row, such as k, p or kA, in the order in which they are worked."""
    if words in ("knit", "purl"):
        return [words[0]] * count
    if starred := re.fullmatch(r"\*(.*); rep from \* to end", words):
        unit = stitches_of_words(starred[1], count)
        assert count % len(unit) == 0
        return unit * (count // len(unit))
    flat = re.sub(r"\[(.*?)\] (\d+) times", lambda m: ", ".join([m[1]] * int(m[2])), words)
    row = []
    for term in flat.split(", "):
        letter, number, electrode = TERM.fullmatch(term).groups()
        row += [letter + (electrode or "")] * int(number)
    return row


def words_of_rows(text):
    """What is worked in every row, by its number."""
    rows = {}
    for line in text.splitlines():
        if again := re.fullmatch(r"Rep (?:row|round)s 1 to (\d+) (once|\d+ times) more\.", line):
            length, times = int(again[1]), again[2].split()[0]
            assert sorted(rows) == list(range(1, length + 1))
            for turn in range(1, 1 + (1 if times == "once" else int(times))):
                rows |= {number + turn * length: rows[number] for number in range(1, length + 1)}
        head, _, words = line.partition(": ")
        named = re.fullmatch(
            r"(?:Odd |Even )?(?:[Rr]ow|[Rr]ound)s? ([\d, and to]+)( \(..\))?", head
        )
        if not named:
            continue
        numbers = list(map(int, re.findall(r"\d+", named[1])))
        if " to " in named[1]:
            numbers = range(numbers[0], numbers[1] + 1, 2 if head[0] in "OE" else 1)
        for number in numbers:
            assert named[2] in (None, (" (WS)", " (RS)")[number % 2])
            rows[number] = words.removesuffix(".")
    assert text.endswith("Bind off.\n")
    return [rows[number] for number in range(1, len(rows) + 1)]


def as_front_shows(worked, number, in_the_round=False):
    """Letters from left to right; what is knitted on the wrong side shows as a purl."""
    if in_the_round or number % 2:
        return worked[::-1]
    return [{"k": "p", "p": "k"}[each[0]] + each[1:] if each else each for each in worked]


def knitted(text):
    """Letters of a fabric as its front shows them, by course and wale, from the words."""
    in_the_round = "join in the round" in text
    count = int(re.search(r"Cast on (\d+) sts", text)[1])
    rows = [stitches_of_words(words, count) for words in words_of_rows(text)]
    return np.array([as_front_shows(row, n, in_the_round) for n, row in enumerate(rows, 1)])


def map_letters(chart):
    electrodes = np.array(["", "A", "B"], object)[chart.plated]
    return np.where(chart.front, "k", "p").astype(object) + electrodes


@given(charts(), st.booleans())
def test_any_chart_is_knitted_from_its_words(chart, in_the_round):
    assert (knitted(instructions(chart, in_the_round)) == map_letters(chart)).all()


@pytest.mark.parametrize("in_the_round", [False, True])
@pytest.mark.parametrize(
    "settings",
    [
        {"n_stripe": 4, "n_subunit": 16},
        {"n_stripe": 8, "n_subunit": 96},
        {"n_stripe": 4, "n_subunit": 16, "pattern": "framed"},
        {"workflow": "graded", "pattern": "graded_stripes"},
        {"workflow": "sensor", "n_stripe": 2, "n_subunit": 16},
        {"workflow": "paper", "n_stripe": 6, "n_subunit": 72},
    ],
    ids=str,
)
def test_designs_are_knitted_from_their_words(settings, in_the_round):
    chart = stitch_chart(case_of(**settings))
    assert (knitted(instructions(chart, in_the_round)) == map_letters(chart)).all()


SHAPING = {"ssk": "k", "k2tog": "k", "ssp": "p", "p2tog": "p", "m1": "k", "m1p": "p"}


def worked_row(words, loops):
    """Letters of a row worked through a number of loops, and how many it binds off.

    Stitches that are cast on at its end have no letter.
    """
    total = re.search(r" \((\d+) sts?\)$", words)
    if not total:
        row = stitches_of_words(words, loops)
        assert len(row) == loops
        return row, 0
    flat = re.sub(r"\[(.*?)\] (\d+) times", lambda m: ", ".join([m[1]] * int(m[2])), words)
    row = []
    bound_off = 0
    for term in flat[: flat.index(" (")].split(", "):
        if term in SHAPING:
            # A strand is between two stitches.
            assert "m1" not in term or (row and loops)
            row.append(SHAPING[term])
            loops -= 0 if "m1" in term else 2
        elif many := re.fullmatch(r"(cast on|bind off) (\d+) sts?", term):
            assert not row or (many[1], loops) == ("cast on", 0)
            row += [""] * int(many[2]) if row else []
            loops += 0 if row else int(many[2]) * (1 if many[1] == "cast on" else -1)
            bound_off += int(many[2]) * (many[1] == "bind off")
        else:
            row += stitches_of_words(term, None)
            loops -= len(stitches_of_words(term, None))
    assert (loops, len(row)) == (0, int(total[1]))
    return row, bound_off


def assert_knits_piece(chart):
    """Every row works all loops of the row before, and makes the stitches of its course."""
    text = instructions(chart)
    loops = int(re.search(r"Cast on (\d+) st", text)[1])
    rows = words_of_rows(text)
    assert len(rows) == chart.courses
    letters = map_letters(chart)
    for number, (words, present) in enumerate(zip(rows, chart.present, strict=True), 1):
        row, bound_off = worked_row(words, loops)
        loops = len(row)
        missing = present.sum() - loops  # at the edge where the row begins: bound off
        assert 0 <= missing <= bound_off
        expected = letters[number - 1, present]
        expected = expected[:loops] if number % 2 else expected[missing:]
        shown = as_front_shows(row, number)
        assert all(each in ("", letter) for each, letter in zip(shown, expected, strict=True))


@given(pieces())
def test_any_piece_is_knitted_from_its_words(chart):
    try:
        instructions(chart)
    except InputError:
        assume(False)  # it casts stitches on that it binds off at once
    assert_knits_piece(chart)


@pytest.mark.parametrize("name", [name for name in PIECES if name != "zigzag"])
def test_pieces_are_knitted_from_their_words(name):
    assert_knits_piece(shaped(PIECES[name]))


def test_increases_and_decreases_have_standard_terms():
    spans = [[2, 20], [1, 20], [2, 19], [2, 19], [2, 10], [2, 10]]
    words = "\n".join(words_of_rows(instructions(shaped(spans, np.ones((6, 20))))))
    assert re.search("p1, m1p, p17", words)
    assert re.search(r"ssk, k15, k2tog \(17 sts\)", words)
    assert re.search("bind off 9 sts", words)


def test_no_piece_is_knitted_in_the_round():
    with refused("in_the_round", "shaped", "leave it out"):
        instructions(shaped(PIECES["trapezoid"]), in_the_round=True)
