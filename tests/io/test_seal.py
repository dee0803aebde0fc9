"""A sealed file is known as it was written, whatever its size, and any other is not."""

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.io import seal

SIZES = st.sampled_from(
    [1, seal.LENGTH, seal.PART - 1, seal.PART, seal.PART + 1, 2 * seal.PART + 7]
)


@given(SIZES, st.floats(0, 1, exclude_max=True), st.integers(0, 7))
def test_a_changed_bit_breaks_a_seal(tmp_path_factory, size, where, bit):
    path = tmp_path_factory.mktemp("sealed") / "file"
    path.write_bytes(os.urandom(size))
    assert not seal.has_seal(path)
    seal.seal(path)
    assert seal.has_seal(path)
    content = bytearray(path.read_bytes())
    content[int(where * size)] ^= 1 << bit
    path.write_bytes(content)
    with pytest.raises(ValueError, match="other contents"):
        seal.has_seal(path)


def test_an_empty_file_has_no_seal(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"")
    assert not seal.has_seal(path)
