"""Results that follow from mesh shapes are kept apart for small and for large shapes."""

from knitlab.fabric.network import LARGE_KEPT, SMALL_KEPT, MeshShape, cached_by_shape

LARGE = MeshShape(100, 100, periodic=False)


def counted():
    """A cached function, and the shapes that it was computed for."""
    computed = []

    @cached_by_shape
    def nodes(shape, factor=1):
        computed.append((shape, factor))
        return factor * shape.nodes

    return nodes, computed


def test_many_small_shapes_do_not_evict_the_sample_that_they_are_parts_of():
    nodes, computed = counted()
    nodes(LARGE)
    for cells in range(2, SMALL_KEPT):
        nodes(MeshShape(cells, 3, periodic=False))
    before = len(computed)
    assert nodes(LARGE) == 101 * 101
    assert nodes(MeshShape(2, 3, periodic=False)) == 12
    assert len(computed) == before


def test_few_large_shapes_are_kept():
    nodes, computed = counted()
    shapes = [MeshShape(100 + more, 100, periodic=False) for more in range(LARGE_KEPT + 1)]
    for shape in shapes:
        nodes(shape)
    nodes(shapes[-1])
    assert len(computed) == len(shapes)
    nodes(shapes[0])
    assert len(computed) == len(shapes) + 1


def test_other_arguments_count_too():
    nodes, computed = counted()
    assert (nodes(LARGE, 2), nodes(LARGE, factor=3), nodes(LARGE, 2)) == (20402, 30603, 20402)
    assert len(computed) == 2
