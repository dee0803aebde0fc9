"""Charts of all kinds of files give the same stitches; what is none is refused with its place."""

import numpy as np
import pytest
from PIL import Image

import knitlab as kl
from knitlab.export.knitting.chart_files import read_stitches
from tests.refusals import refused

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
        ("a.txt", "kkpp\nkxpp", ["line 2", "stitch 2", "'x'", "k K . 1"]),
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


def test_a_transparent_image_is_refused(tmp_path):
    path = tmp_path / "chart.png"
    Image.fromarray(np.zeros((4, 4, 4), "u1")).save(path)
    with refused("chart.png", "transparent", "opaque"):
        kl.read_chart(path)


def test_an_image_of_many_colours_is_refused(tmp_path):
    path = tmp_path / "chart.png"
    SAMPLE.save(path)
    with refused("chart.png", "two colours"):
        kl.read_chart(path)
