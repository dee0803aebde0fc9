"""Caches of what follows from a mesh shape: for many small shapes, and for few large ones.

What follows from a small shape is small, and a sample has subdomains of many shapes; what follows
from a large one may take a gigabyte. In one cache for all, subdomains would evict the sample that
they belong to, or samples that are no longer needed would fill the memory.
"""

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Concatenate, ParamSpec, Protocol, TypeVar

LARGE = 2048
"""Number of nodes above which a mesh shape is large; no subdomain is."""
LARGE_KEPT, SMALL_KEPT = 2, 32
"""Results that are kept. A large sample needs two: of its relaxation and of its tensile test."""


class HasNodes(Protocol):
    """A mesh shape."""

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        ...


Shape = TypeVar("Shape", bound=HasNodes)
Others = ParamSpec("Others")
Result = TypeVar("Result")


def cached_by_shape(
    function: Callable[Concatenate[Shape, Others], Result],
) -> Callable[Concatenate[Shape, Others], Result]:
    """Decorator that keeps the most recent results, apart for small and for large shapes.

    Args:
        function: a function of a mesh shape and of other hashable arguments.
    """
    large: Callable[..., Result] = lru_cache(LARGE_KEPT)(function)
    small: Callable[..., Result] = lru_cache(SMALL_KEPT)(function)

    @wraps(function)
    def cached(shape: Shape, *args: Others.args, **kwargs: Others.kwargs) -> Result:
        return (large if shape.nodes > LARGE else small)(shape, *args, **kwargs)

    return cached
