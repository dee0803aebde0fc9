"""Tables are read as they were written: by any program, separator, decimal mark and encoding."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from knitlab.io.errors import InputError
from knitlab.io.table_file import column_numbers, name_and_unit, read_table
from knitlab.io.text_file import read_text

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
    return {name_and_unit(header)[0] for header in headers} >= {"Time", "Extension"} or set(
        headers
    ) >= {"a", "b"}


def read(tmp_path, content, encoding="utf-8"):
    path = tmp_path / "table.csv"
    path.write_bytes(content.encode(encoding))
    (headers, rows, *_), _ = read_table(path, "write rows of numbers", fits)
    return headers, np.array([column_numbers(path, "x", rows[each])[0] for each in rows]).T


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
    _, mistakes = column_numbers(path, "a", rows[0])
    assert "point 2 is 'x'" in str(mistakes[0])


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
    assert column_numbers(path, "Load", rows[1])[0].tolist() == [1.5, 2.5, 3.25]


@given(text=st.text(st.characters(codec="cp1252", exclude_categories=["C"]), min_size=4))
def test_text_is_decoded_in_every_encoding_with_a_mark(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("text") / "text.txt"
    for encoding in ("utf-8-sig", "utf-16", "utf-32"):
        path.write_bytes(text.encode(encoding))
        assert read_text(Path(path)) == text.replace("\u00a0", " ")
