"""The run-time checker of the data types and shapes of arrays, which mypy cannot check.

Whether an array is a JAX or a NumPy array is checked by mypy, like every other type.
"""

import functools
import operator
import types
from collections.abc import Callable
from typing import Any, TypeVar, Union, get_args, get_origin

import jax
import numpy as np
from beartype import BeartypeConf, beartype
from jaxtyping import AbstractArray

F = TypeVar("F", bound=Callable[..., Any])
CHECKER = beartype(conf=BeartypeConf(is_pep484_tower=True))  # an int is a float
ANY_LIBRARY = jax.Array | np.ndarray | np.generic


def checked(function: F) -> F:
    """Make every call compare its arrays with their annotations."""
    hints = getattr(function, "__annotations__", {})
    arrays = {name: _of_any_library(hint) for name, hint in hints.items() if _has_arrays(hint)}
    if not arrays:
        return function
    if "return" in arrays:
        # jaxtyping checks the arguments by a separate function, which stores their shapes.
        arrays = {"return": arrays["return"]}
    function.__annotations__ = arrays
    return CHECKER(function)


def _is_array(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, AbstractArray)


def _has_arrays(hint: Any) -> bool:
    return _is_array(hint) or any(map(_has_arrays, get_args(hint)))


def _of_any_library(hint: Any) -> Any:
    if _is_array(hint):
        return hint.dtype[ANY_LIBRARY, hint.dim_str]
    origin = get_origin(hint)
    if not _has_arrays(hint) or origin is Callable:
        return hint
    parts = tuple(map(_of_any_library, get_args(hint)))
    if origin in (Union, types.UnionType):
        return functools.reduce(operator.or_, parts)
    return origin[parts]
