"""Searches of several fabrics of one mesh shape, at the same time where that is faster."""

from collections.abc import Callable, Sequence
from threading import Event
from typing import TypeVar

from knitlab.equilibrium.divided_system import system_of
from knitlab.equilibrium.factorisation import one_thread_of_blas
from knitlab.equilibrium.system import System
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape
from knitlab.fabric.threads import ALONE, Threads, allowed_threads

LARGEST_CONCURRENT = 4096
"""Number of nodes up to which fabrics run concurrently."""

Result = TypeVar("Result")


def run_each(
    shape: MeshShape, fabrics: Sequence[Fabric], searches: Sequence[Callable[[System], Result]]
) -> list[Result]:
    """Call one function for each fabric, with the equations of the fabric.

    Small fabrics run one to a thread; large ones one after another, as their elements and fronts
    keep all threads busy. Results do not depend on the number of threads.

    Args:
        shape: mesh shape of all fabrics.
        fabrics: the fabrics.
        searches: a function for each.

    Returns:
        What the functions return, in order.
    """
    threads, stopped = Threads(allowed_threads()), Event()
    pairs = list(zip(fabrics, searches, strict=True))

    def concurrently(pair: tuple[Fabric, Callable[[System], Result]]) -> Result:
        fabric, search = pair
        return search(system_of(shape, fabric, ALONE, stopped))

    with one_thread_of_blas():
        if len(pairs) == 1 or shape.nodes > LARGEST_CONCURRENT:
            return [search(system_of(shape, fabric, threads)) for fabric, search in pairs]
        try:
            return threads.each(concurrently, pairs)
        except BaseException:
            # Python would wait for the other threads before it exits.
            stopped.set()
            raise
