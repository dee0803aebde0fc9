"""Refusals of invalid input: the thing, its value and the remedy are named, in whatever words."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from knitlab.io.errors import InputError


@contextmanager
def refused(*words: str, error: type[Exception] = InputError) -> Iterator[None]:
    """The block raises an error whose message contains all words."""
    with pytest.raises(error) as caught:
        yield
    missing = [word for word in words if word not in str(caught.value)]
    assert not missing, f"{missing} not in: {caught.value}"
