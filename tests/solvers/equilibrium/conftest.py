"""A sample in small subdomains, for the tests of domain decomposition and second processes."""

import pytest

from knitlab.solvers.loads.loading import loading_of
from tests.fabrics import CLAMPED, checkered, relaxed


@pytest.fixture(scope="package")
def sample():
    """A relaxed sample of 2 × 2 unit cells, and its test."""
    net, fabric = checkered(4, 1, CLAMPED, unit_cells=(2, 2))
    return net, fabric, loading_of(net.shape, relaxed(net, fabric).configuration)
