"""The words of hand knitting, knitted by a reader of their own, make the chart again."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.export.knitting.instructions import instructions
from knitlab.export.knitting.stitch_chart import stitch_chart
from tests.export.knitting.charts import case_of
from tests.export.knitting.test_round_trip import charts

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


def knitted(text):
    """Letters of a fabric as its front shows them, by course and wale, from the words."""
    in_the_round = "join in the round" in text
    count = int(re.search(r"Cast on (\d+) sts", text)[1])
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
            worked = stitches_of_words(words.removesuffix("."), count)
            if in_the_round or number % 2:
                assert in_the_round or named[2] == " (RS)"
                rows[number] = worked[::-1]
            else:
                assert named[2] == " (WS)"
                # What is knitted on the wrong side shows as a purl on the front.
                rows[number] = [{"k": "p", "p": "k"}[each[0]] + each[1:] for each in worked]
    assert text.endswith("Bind off.\n")
    return np.array([rows[number] for number in range(1, len(rows) + 1)])


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
