"""A file that ends with its checksum is known as it was written, whatever its size."""

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.io.checksum import LENGTH, PART, append_checksum, has_checksum

SIZES = st.sampled_from([1, LENGTH, PART - 1, PART, PART + 1, 2 * PART + 7])


@given(SIZES, st.floats(0, 1, exclude_max=True), st.integers(0, 7))
def test_a_changed_bit_is_noticed(tmp_path_factory, size, where, bit):
    path = tmp_path_factory.mktemp("checked") / "file"
    path.write_bytes(os.urandom(size))
    assert not has_checksum(path)
    append_checksum(path)
    assert has_checksum(path)
    content = bytearray(path.read_bytes())
    content[int(where * size)] ^= 1 << bit
    path.write_bytes(content)
    with pytest.raises(ValueError, match="contents"):
        has_checksum(path)


def test_an_empty_file_has_no_checksum(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"")
    assert not has_checksum(path)
