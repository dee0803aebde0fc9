"""Charts of all kinds of files give the same stitches; what is none is refused with its place."""

import numpy as np
import pytest
from PIL import Image

import knitlab as kl
from knitlab.export.knitting.chart_files import read_stitches
from knitlab.export.knitting.symbols import BETWEEN, Key
from knitlab.io.limits import MAX_SIDE
from tests.refusals import refused

RIB = np.tile([True] * 4 + [False] * 4, (32, 4))
GARTER = np.tile([[True]] * 8 + [[False]] * 8, (4, 32))
SAMPLE = kl.knit("sensor", n_stripe=2, n_subunit=16)
FRONT = SAMPLE.chart.front
TWO_COURSES = "".join(
    f"knit {sign} f{number} 3\n"
    for sign, order in (("-", (3, 2, 1)), ("+", (1, 2, 3)))
    for number in order
)


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("symbols", ["kp", "KP", "10", ".-"])
def test_rows_of_symbols_are_read_the_last_first_by_default(tmp_path, symbols):
    rows = ["# from the front", *(" ".join(symbols[not knit] for knit in row) for row in FRONT)]
    path = written(tmp_path / "chart.txt", "\n".join(rows))
    assert (read_stitches(path, "top")[0] == FRONT).all()
    assert (read_stitches(path)[0] == FRONT[::-1]).all()


def drawn(path, front, knit, purl, separator=""):
    """A text with a symbol for each stitch, the top first."""
    rows = (separator.join(knit if each else purl for each in row) for row in front)
    return written(path, "\n".join(rows))


KEYS = [
    " .",
    "|-",
    " -",
    ". ",
    "x.",
    ".x",
    "k ",
    "□■",
    "■□",
    "V-",
    "12",
    "ox",
    "#.",
    ".#",
    "p-",
    "kx",
]


@pytest.mark.parametrize("separator", ["", ",", ";", "\t", " "], ids=repr)
@pytest.mark.parametrize("front", [RIB, GARTER], ids=["rib", "garter"])
@pytest.mark.parametrize("symbols", KEYS)
def test_a_chart_of_any_two_symbols_is_refused_until_they_are_named(
    tmp_path, symbols, front, separator
):
    knit, purl = symbols
    separator = "" if separator in symbols else separator
    path = drawn(tmp_path / "chart.txt", front, knit, purl, separator)
    with refused("chart.txt"):
        read_stitches(path)
    given = Key(knit, purl)
    assert (read_stitches(path, "top", given=given)[0] == front).all()
    if not set(BETWEEN) & {purl, separator}:
        assert (read_stitches(path, "top", given=Key(knit))[0] == front).all()


@pytest.mark.parametrize(
    ("symbols", "readings"),
    [
        (" .", ["knit = ' ' and purl = '.'", "knit = '.' and purl = ' '", "remove ' '"]),
        ("|-", ["knit = '|' and purl = '-'", "remove '|'"]),
        ("x.", ["knit = 'x' and purl = '.'", "knit = '.' and purl = 'x'"]),
        ("..", ["knit = '.'", "purl = '.'"]),
    ],
)
def test_all_readings_of_a_chart_are_named(tmp_path, symbols, readings):
    with refused("chart.txt", *readings):
        read_stitches(drawn(tmp_path / "chart.txt", RIB, *symbols))


@pytest.mark.parametrize(("symbols", "knit"), [("k.", "k"), (".-", "."), (".p", "."), ("1-", "1")])
@pytest.mark.parametrize("separator", ["", " ", "|", ", "])
def test_beside_another_symbol_a_dot_has_one_meaning_and_blanks_separate(
    tmp_path, symbols, knit, separator
):
    stitches, remark = read_stitches(drawn(tmp_path / "a.txt", RIB, *symbols, separator), "top")
    assert (stitches == RIB).all()
    assert f"knit = {knit!r}" in remark


def test_empty_cells_and_lines_are_blanks(tmp_path):
    table = drawn(tmp_path / "chart.csv", RIB, "", ".", ",")
    with refused("' '"):
        read_stitches(table)
    assert (read_stitches(table, "top", given=Key(" "))[0] == RIB).all()
    rows = ("".join(" " if each else "p" for each in row).rstrip() for row in GARTER)
    stripped = written(tmp_path / "stripped.txt", "\n".join(rows))
    with refused("' '"):
        read_stitches(stripped)
    with refused("line 9", "32 stitches", "blanks"):
        read_stitches(stripped, given=Key(" "))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (Key("x"), ["'x'", "'k', 'p'"]),
        (Key("k", "k"), ["'k'", "two"]),
        (Key("knit"), ["one character", "'knit'"]),
        (Key("k", "x"), ["line 1", "stitch 5", "'p'", "'k' and 'x'"]),
    ],
)
def test_symbols_that_a_chart_does_not_have_are_refused(tmp_path, given, words):
    with refused(*words):
        read_stitches(drawn(tmp_path / "chart.txt", RIB, "k", "p"), given=given)
    with refused("sample.k", "symbols"):
        read_stitches(SAMPLE.save(tmp_path / "sample.k"), given=Key("k"))


def test_comments_are_no_stitches(tmp_path):
    rows = ["# 32 courses", *("".join("kp"[not each] for each in row) for row in RIB), "", "#"]
    assert (read_stitches(written(tmp_path / "a.txt", "\n".join(rows)), "top")[0] == RIB).all()


@pytest.mark.parametrize("rows", [MAX_SIDE + 1, 200_000])
def test_a_large_chart_is_refused_before_it_is_read(tmp_path, rows):
    with refused("a.txt", f"{rows:,}", f"{MAX_SIDE:,}"):
        read_stitches(written(tmp_path / "a.txt", "kkpp\n" * rows))
    path = tmp_path / "a.png"
    Image.new("1", (4, rows)).save(path)
    with refused("a.png", f"{rows:,}", f"{MAX_SIDE:,}"):
        read_stitches(path)


def test_an_image_has_its_first_course_at_the_bottom_and_purls_darker(tmp_path):
    path = tmp_path / "chart.png"
    Image.fromarray(np.where(FRONT[::-1, :, None], (250, 240, 0), (9, 9, 90)).astype("u1")).save(
        path
    )
    assert (read_stitches(path)[0] == FRONT).all()


@pytest.mark.parametrize("end", ["bind_off", "drop"])
@pytest.mark.parametrize("model", ["SWG061N2", "Kniterate"])
@pytest.mark.parametrize("marked", [True, False], ids=["own", "without comments"])
def test_programs_are_read_with_their_comments_or_without(tmp_path, end, model, marked):
    sample = kl.knit("periodic", n_stripe=2, n_subunit=8, machine={"end": end, "model": model})
    lines = sample.program.split("\n")
    if not marked:
        lines = [line for line in lines if not line.startswith(";") or line[1] in ";!"]
    stitches, _ = read_stitches(written(tmp_path / "sample.k", "\n".join(lines)), carrier=3)
    before = 0 if marked else sample.machine.setup_courses
    assert (stitches[before:] == sample.chart.front).all()
    assert stitches[:before].all()


def test_tables_and_programs_of_a_plated_sample_are_read(tmp_path):
    for name in ("chart.csv", "sample.k"):
        assert (read_stitches(SAMPLE.save(tmp_path / name))[0] == FRONT).all()


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.txt", "kkpp\nkkp", ["line 2", "3 stitches", "4"]),
        ("a.txt", "kkpp\nkxpp", ["line 2", "stitch 2", "'x'", "'k' and 'p'"]),
        ("a.txt", "# nothing\n", ["a.txt", "no stitches", "k and p"]),
        ("a.png", "no image", ["a.png", "image"]),
        ("a.k", "inhook 3\ntuck - f1 3\n", ["a.k", "no stitch"]),
        ("a.k", "inhook 3\ntuck - f" + "1" * 5000 + " 3\n", ["a.k", "no stitch"]),
        (
            "a.k",
            "tuck - f1 3\ntuck - b1 3\nknit + f1 3\nknit + b1 3\n" * 2,
            ["both beds", "line 8", "single cloth"],
        ),
        (
            "a.k",
            "tuck - f3 3\ntuck - f2 3\ntuck - f1 3\n" + TWO_COURSES + "knit - f3 3\n",
            ["3 stitches", "carrier 3", "needle 3", "rectangle"],
        ),
    ],
)
def test_what_is_no_chart_is_refused(tmp_path, name, text, words):
    with refused(*words):
        read_stitches(written(tmp_path / name, text))


def test_a_carrier_that_knits_nothing_is_refused(tmp_path):
    path = SAMPLE.save(tmp_path / "sample.k")
    with refused("carrier 9", "3, 4, 5"):
        kl.read_chart(path, carrier=9)


@pytest.mark.parametrize(
    ("pixels", "words"),
    [
        (np.zeros((4, 4, 4)), ["transparent", "opaque"]),
        ([[[0, 0, 0], [9, 9, 9], [255, 255, 255]]], ["3 colours", "two colours"]),
    ],
)
def test_an_image_that_is_transparent_or_of_many_colours_is_refused(tmp_path, pixels, words):
    Image.fromarray(np.array(pixels, "u1")).save(tmp_path / "chart.png")
    with refused("chart.png", *words):
        kl.read_chart(tmp_path / "chart.png")


@pytest.mark.parametrize("other", [(0, 0, 255), (255, 0, 0), (255, 200, 0), (0, 200, 0)])
def test_of_colours_without_a_darker_one_the_knit_is_asked_for(tmp_path, other):
    colours = ["#ff0000" if other[2] else "#0000ff", "#{:02x}{:02x}{:02x}".format(*other)]
    path = tmp_path / "chart.png"
    one = (255, 0, 0) if other[2] else (0, 0, 255)
    Image.fromarray(np.where(FRONT[..., None], one, other).astype("u1")).save(path)
    if other == (255, 200, 0):  # is lighter in every respect
        assert (read_stitches(path, "top")[0] != FRONT).all()
    else:
        with refused(*colours):
            read_stitches(path)
    for given in (Key(colours[0]), Key(purl=colours[1]), Key(*colours)):
        assert (read_stitches(path, "top", given=given)[0] == FRONT).all()
    with refused("'#123456'", *colours):
        read_stitches(path, given=Key("#123456"))


LEFTWARDS = range(32, 0, -1)
EVEN, ODD, ALL = LEFTWARDS[::2], LEFTWARDS[1::2][::-1], LEFTWARDS
CAST_ONS = {
    "there and back": [("tuck -", "f", EVEN), ("tuck +", "f", ODD)],
    "knitted there and back": [("knit -", "f", EVEN), ("knit +", "f", ODD)],
    "every second needle alone": [("tuck -", "f", EVEN)],
    "every second needle knitted": [("knit -", "f", EVEN)],
    "of both beds": [("tuck -", "f", EVEN), ("tuck -", "b", ODD)],
    "closed": [
        ("knit -", "f", EVEN),
        ("knit +", "b", ODD),
        ("knit -", "f", ODD),
        ("knit +", "b", EVEN),
    ],
}


@pytest.mark.parametrize("step", [1, 2])
@pytest.mark.parametrize("cast_on", CAST_ONS)
def test_courses_are_counted_from_any_cast_on(tmp_path, cast_on, step):
    """Also of a program that uses every second needle of the machine."""
    lines, front = [";!knitout-2", "inhook 3"], RIB[:6]
    for word, bed, needles in CAST_ONS[cast_on]:
        lines += [f"{word} {bed}{step * number} 3" for number in needles]
        last = word
    if any(bed == "b" for _, bed, _ in CAST_ONS[cast_on]):
        lines += [f"xfer b{step * number} f{step * number}" for number in ALL]
    beds = dict.fromkeys(ALL, "f")
    sign = "+" if last.endswith("-") else "-"
    for course in front:
        for number in ALL:
            bed = "f" if course[number - 1] else "b"
            if bed != beds[number]:
                lines.append(f"xfer {beds[number]}{step * number} {bed}{step * number}")
            beds[number] = bed
        order = ALL if sign == "-" else ALL[::-1]
        lines += [f"knit {sign} {beds[number]}{step * number} 3" for number in order]
        sign = "+" if sign == "-" else "-"
    stitches, remark = read_stitches(written(tmp_path / "a.k", "\n".join(lines)))
    assert (stitches == front).all()
    assert ("2 needles" in remark) == (step == 2)
