"""Tables are read as they were written: by any program, separator, decimal mark and encoding."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from knitlab.io.errors import InputError
from knitlab.io.table_file import column_numbers, name_and_unit, read_columns, read_table
from knitlab.io.table_readings import Choice
from knitlab.io.text_file import read_text
from knitlab.io.toml import read_toml
from tests.refusals import refused

NAMES = "Time", "Extension", "Load", "Extra"
UNITS = "s", "mm", "N", "1"
BLOCKS = {
    "none": [],
    "properties": ["Operator;Ann", "Specimen width;16.7;mm", "", "Test 1"],
    "results": ["Results Table 1", ";Maximum Load;Label", ";(N);", "1;0.66;A", ""],
    "comments": ["# made by a tester", "# Time,Extension", ""],
    "stated": ["sep=;"],
}
ENCODINGS = "utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32", "cp1252"

tables = st.integers(2, 4).flatmap(
    lambda width: st.lists(
        st.lists(
            st.floats(-1e9, 1e9, allow_subnormal=False).map(lambda value: float(f"{value:.6g}")),
            min_size=width,
            max_size=width,
        ),
        min_size=6,
        max_size=30,
    )
)


def fits(headers):
    names = {name_and_unit(header)[0] for header in headers}
    return names >= {"Time"} or names >= {"a", "b"}


def read(tmp_path, content, encoding="utf-8"):
    path = tmp_path / "table.csv"
    path.write_bytes(content.encode(encoding))
    (headers, rows, *_), _ = read_table(path, "write rows of numbers", fits)
    return headers, np.array([column_numbers(path, "x", rows[each]) for each in rows]).T


def written(values, separator, mark, header, block):
    names = NAMES[: len(values[0])]
    units = UNITS[: len(values[0])]
    lines = [line.replace(";", separator) if line != "sep=;" else line for line in BLOCKS[block]]
    if header == "units below":
        lines += [separator.join(names), separator.join(f"({unit})" for unit in units)]
    elif header == "bare units below":
        lines += [separator.join(names), separator.join(unit.replace("1", "") for unit in units)]
    else:
        row = separator.join(f"{name} [{unit}]" for name, unit in zip(names, units, strict=True))
        lines.append(row if header == "plain" else f"# {row}")
    lines += [separator.join(repr(value).replace(".", mark) for value in row) for row in values]
    return "\n".join(lines) + "\n"


@given(
    values=tables,
    separator=st.sampled_from(",;\t|"),
    mark=st.sampled_from(".,"),
    header=st.sampled_from(["plain", "units below", "bare units below", "behind #"]),
    block=st.sampled_from(sorted(BLOCKS)),
    encoding=st.sampled_from(ENCODINGS),
    line_end=st.sampled_from(["\n", "\r\n"]),
)
def test_numbers_are_read_as_they_were_written(
    tmp_path_factory, values, separator, mark, header, block, encoding, line_end
):
    if separator == ",":
        mark = "."
    assume((header, block) != ("behind #", "results"))
    if block == "stated":
        separator = ";"
    text = written(values, separator, mark, header, block).replace("\n", line_end)
    headers, numbers = read(tmp_path_factory.mktemp("table"), text, encoding)
    assert [each.split()[0] for each in headers] == list(NAMES[: len(values[0])])
    np.testing.assert_array_equal(numbers, values)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("a,b\n1,2\n3,4\n5,6\n", [[1, 2], [3, 4], [5, 6]]),
        ("a b\n1   2\n3\t4\n5  6\n", [[1, 2], [3, 4], [5, 6]]),
        ("a;b\n1.234,5;2\n3;4,25\n,5;6\n", [[1234.5, 2], [3, 4.25], [0.5, 6]]),
        ('a,b\n"1,234.5",2\n3,4.25\n.5,6\n', [[1234.5, 2], [3, 4.25], [0.5, 6]]),
        ('a,b\n"0,5","2"\n"3","4,25"\n"1","6"\n', [[0.5, 2], [3, 4.25], [1, 6]]),
        ("a,b\n1,2\n3,4\n5,6\nend of test\n", [[1, 2], [3, 4], [5, 6]]),
        ("a,b,\n1,\u22122,\n3,4,\n5,6,\n", [[1, -2], [3, 4], [5, 6]]),
        ("a\u00a0;b\n1;\u00a02\n3;4\n5;6\n", [[1, 2], [3, 4], [5, 6]]),
    ],
)
def test_marks_of_thousands_quotes_spaces_and_ends_of_lines(tmp_path, content, expected):
    headers, numbers = read(tmp_path, content)
    assert headers == ["a", "b"]
    np.testing.assert_array_equal(numbers, expected)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ("a,b\n1,2\n3\n5,6\n7,8\n9,10\n", "line 3"),
        ("1,2\n3,4\n5,6\n", "header above line 1"),
        ("no numbers here\n", "numbers"),
        ("", "numbers"),
    ],
)
def test_what_is_no_table_is_named_with_its_line(tmp_path, content, named):
    with pytest.raises(InputError, match=named):
        read(tmp_path, content)


def test_a_row_without_a_number_is_reported_as_a_point(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a,b\n1,2\nx,y\n5,6\n")
    (_, rows, *_), _ = read_table(path, "", fits)
    with refused("point 2 is 'x'"):
        column_numbers(path, "a", rows[0])


@pytest.mark.parametrize(
    ("begin", "named"),
    [
        (b"PK\x03\x04 not really", "Excel workbook"),
        (b"\xd0\xcf\x11\xe0", "old Excel workbook"),
        (b"\x89HDF\r\n", "HDF5"),
        (b"CDF\x01", "netCDF"),
        (b"a,b\n1,\x00\x00\x00\n", "zero bytes"),
    ],
)
def test_what_is_no_text_is_named(tmp_path, begin, named):
    path = tmp_path / "table.csv"
    path.write_bytes(begin)
    with pytest.raises(InputError, match=named):
        read_table(path, "", fits)


def test_a_workbook_is_read(tmp_path):
    pytest.importorskip("openpyxl")
    path = tmp_path / "table.xlsx"
    sheet = pd.DataFrame([["Time", "Load"], ["s", "N"], [0, 1.5], [1, 2.5], [2, 3.25]])
    sheet.to_excel(path, header=False, index=False)
    (headers, rows, *_), _ = read_table(path, "", fits)
    assert headers == ["Time [s]", "Load [N]"]
    assert column_numbers(path, "Load", rows[1]).tolist() == [1.5, 2.5, 3.25]


def with_three_decimals(values, separator, mark, thousands):
    """A table with commas in its header and in a remark above it."""
    exchanged = str.maketrans({",": thousands, ".": mark})
    quote = '"{}"' if separator in (mark, thousands) else "{}"
    fields = [[quote.format(f"{each:,.3f}".translate(exchanged)) for each in row] for row in values]
    names = [f'"{name}"' if separator == "," else name for name in ("Time, s", "Load, N")]
    rows = [separator.join(row) for row in (names, *fields)]
    return "\n".join(["Specimen: rib, 4 x 4; load cell 1,5 kN", *rows, ""])


@given(
    values=st.lists(
        st.tuples(*[st.integers(0, 5_000_000).map(lambda thousandths: thousandths / 1000)] * 2),
        min_size=4,
        max_size=20,
    ),
    separator=st.sampled_from(",;\t|"),
    mark=st.sampled_from(".,"),
    marked=st.booleans(),
)
def test_only_numbers_decide_on_the_decimal_mark(tmp_path_factory, values, separator, mark, marked):
    thousands = {".": ",", ",": "."}[mark] if marked else ""
    path = tmp_path_factory.mktemp("table") / "table.csv"
    path.write_text(with_three_decimals(values, separator, mark, thousands))
    names = {"Time, s": None, "Load, N": None}
    quoted_or_none = separator != "," or mark == "," or marked
    if quoted_or_none and all(1 <= each < 1000 for row in values for each in row):
        with refused("decimal points", "decimal commas", "decimal = "):
            read_columns(path, names, "", choice=Choice())
        read = read_columns(path, names, "", choice=Choice(mark)).numbers
    else:
        read = read_columns(path, names, "").numbers
    np.testing.assert_allclose(np.transpose([*read.values()]), values)


def test_of_two_readings_both_are_shown_and_the_stated_mark_decides(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a;b\n1;12,500\n2;13,000\n3;13,500\n")
    with refused("line 2", "12500 with decimal points", "12.500 with decimal commas", "decimal ="):
        read_table(path, "", fits, Choice())
    with refused("decimal points", "without marks"):  # where no option is offered
        read_table(path, "", fits)
    for mark, factor in ((",", 1), (".", 1000)):
        read = read_columns(path, {"a": None, "b": None}, "", choice=Choice(mark)).numbers
        np.testing.assert_allclose(read["b"], factor * np.array([12.5, 13.0, 13.5]))


@pytest.mark.parametrize(
    ("rows", "name", "expected"),
    [
        # Who marks thousands marks them all; and no zero is before such a mark.
        ("1000;12,500\n2000;13,500\n3000;15,500\n", "b", [12.5, 13.5, 15.5]),
        ("1;0.400\n2;1.500\n3;12.500\n", "b", [0.4, 1.5, 12.5]),
    ],
)
def test_numbers_that_agree_with_each_other_decide(tmp_path, rows, name, expected):
    path = tmp_path / "table.csv"
    path.write_text("a;b\n" + rows)
    np.testing.assert_allclose(
        read_columns(path, {"a": None, "b": None}, "").numbers[name], expected
    )


def stacked(rows, title, repeated, blank):
    """Three tables below each other."""
    lines = []
    for number in (1, 2, 3):
        lines += [""] * blank + [f"Specimen {number}"] * title + ["a,b"] * (repeated or number == 1)
        lines += [f"{a},{number * b}" for a, b in rows]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("title", [True, False])
@pytest.mark.parametrize("repeated", [True, False])
@pytest.mark.parametrize("blank", [True, False])
def test_of_tables_below_each_other_the_stated_one_is_read(tmp_path, title, repeated, blank):
    path = tmp_path / "table.csv"
    text = stacked([(0, 0), (1, 2), (2, 5), (3, 9)], title, repeated, blank)
    path.write_text(text)
    if not (title or repeated or blank):
        assert len(read_columns(path, {"a": None}, "").numbers["a"]) == 12
        return
    with refused("table 1", "table 3", "rows from 0, 0", "table = "):
        read_columns(path, {"a": None}, "", choice=Choice())
    with refused("table 1", "leave one"):  # where no option is offered
        read_columns(path, {"a": None}, "")
    columns, unread = read_columns(path, {"b": None}, "", choice=Choice(table=2))
    assert columns["b"].tolist() == [0, 4, 10, 18]
    begun = [
        number for number, line in enumerate(text.split("\n"), 1) if line in ("a,b", "Specimen 3")
    ]
    assert any(f"line {number}" in unread[0] for number in (begun[-1], begun[-1] - 1))
    with refused("table 4", "3 tables"):
        read_columns(path, {"b": None}, "", choice=Choice(table=4))


def test_rows_with_a_label_below_a_table_are_named_as_not_read(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a;b\n0;1,5\n1;2,5\n2;3,5\n\nMaximum;4,000\nMean;2,5\n")
    columns, unread = read_columns(path, {"b": None}, "")
    assert columns["b"].tolist() == [1.5, 2.5, 3.5]
    assert "not read: line 6, line 7" in unread[0]


def test_a_number_with_the_other_decimal_mark_is_none(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a;b\n0;1.500\n1;1500.5\n2;2.500\n")
    with refused("column b", "point 2", "1500.5 with a decimal point"):
        read_columns(path, {"b": None}, "", choice=Choice(","))


@pytest.mark.parametrize("between", ["", "paused", "a,b", "a,b\n(s),(N)"])
def test_a_table_that_goes_on_below_a_remark_is_one(tmp_path, between):
    path = tmp_path / "table.csv"
    path.write_text(f"a,b\n(s),(N)\n0,1\n1,2\n2,3\n{between}\n3,4\n4,5\n")
    assert read_columns(path, {"b": None}, "").numbers["b"].tolist() == [1, 2, 3, 4, 5]


def test_of_sheets_the_one_that_fits_is_read_and_of_several_the_stated_one(tmp_path):
    pytest.importorskip("openpyxl")
    path = tmp_path / "book.xlsx"
    sheets = {
        "Results": [["Label", "maximum"], ["A", 0.66]],
        "First": [["a", "b"], [0, 1.5], [1, 2.5]],
        "Second": [["a", "b"], [0, 3.5], [1, 4.5]],
    }

    def write(*names):
        with pd.ExcelWriter(path) as book:
            for name in names:
                sheet = pd.DataFrame(sheets[name])
                sheet.to_excel(book, sheet_name=name, header=False, index=False)

    write("Results", "First")
    columns, unread = read_columns(path, {"b": None}, "")
    assert columns["b"].tolist() == [1.5, 2.5]
    assert "First" in unread[0]
    write("Results", "First", "Second")
    with refused("First", "Second", "table = "):
        read_columns(path, {"b": None}, "", choice=Choice())
    columns, unread = read_columns(path, {"b": None}, "", choice=Choice(table=2))
    assert columns["b"].tolist() == [3.5, 4.5]
    assert "First" in unread[0]


@pytest.mark.parametrize("written", ['"data\\tensile.csv"', '"C:\\Users\\tensile.csv"'])
def test_a_backslash_in_toml_is_named(tmp_path, written):
    path = tmp_path / "sheet.toml"
    path.write_text(f"file = {written}\n")
    with refused("backslash", "'…'", "/"):
        read_text(tmp_path / read_toml(path)["file"])


@given(text=st.text(st.characters(codec="cp1252", exclude_categories=["C"]), min_size=4))
def test_text_is_decoded_in_every_encoding_with_a_mark(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("text") / "text.txt"
    for encoding in ("utf-8-sig", "utf-16", "utf-32"):
        path.write_bytes(text.encode(encoding))
        assert read_text(Path(path)) == text.replace("\u00a0", " ")
