import numpy as np
import pytest

from knitlab.model.cell_grid import nodes_at
from knitlab.model.fabric import Configuration, flat_sheet
from knitlab.model.network import MeshShape
from knitlab.observables.folds import widths_across_folds
from knitlab.observables.wavelength import boundary_line, boundary_wave
from tests.fabrics import CLAMPED, PERIODIC, checkerboard, checkered, even_cells, relaxed


def waved(net, fabric, cells, amplitude=0.4):
    """A flat sheet whose courses are waves along x, one per unit cell; and the cell's width."""
    flat = flat_sheet(net, fabric)
    nodes = np.array(flat.positions)
    width = float(np.diff(nodes[0, :2, 0])[0]) * net.shape.cells_x / cells
    nodes[..., 1] += amplitude * np.sin(2 * np.pi * nodes[..., 0] / width)
    return Configuration(nodes, flat.lengths), width


@pytest.mark.slow
@pytest.mark.parametrize(("options", "cells"), [(CLAMPED, (3, 5)), (PERIODIC, (1, 1))])
def test_boundary_of_a_waved_sheet_has_its_wavelength_and_amplitude(options, cells):
    net, fabric = checkered(4, 2, options, cells)
    configuration, width = waved(net, fabric, cells[1])
    wave = boundary_wave(net.shape, even_cells(net.shape, cells), configuration, "x")
    assert wave.wavelength == pytest.approx(width, rel=0.01)
    assert wave.amplitude == pytest.approx(0.4, rel=0.05)


def test_boundary_lies_between_unit_cells_next_to_the_middle():
    net, fabric = checkered(4, 2, CLAMPED, (4, 3))
    flat = flat_sheet(net, fabric)
    across_x = boundary_line(net.shape, even_cells(net.shape, (4, 3)), flat, "x")[:, 1]
    nodes = flat.positions
    assert np.allclose(across_x, np.ptp(nodes[..., 1]) / 2 + nodes[..., 1].min())
    across_y = boundary_line(net.shape, even_cells(net.shape, (4, 3)), flat, "y")[:, 1]
    assert np.allclose(across_y, np.ptp(nodes[..., 0]) / 3 + nodes[..., 0].min())


def test_boundary_across_a_single_unit_cell_has_no_wave():
    net, fabric = checkered(4, 2, CLAMPED, (1, 1))
    flat = flat_sheet(net, fabric)
    assert boundary_wave(net.shape, even_cells(net.shape, (1, 1)), flat, "x") is None


@pytest.mark.slow
def test_wavelength_of_relaxed_periodic_fabric_is_its_unit_cell():
    net, fabric = checkered(4, 2, PERIODIC)
    state = relaxed(net, fabric)
    for direction, length in zip("xy", state.configuration.lengths, strict=True):
        cells = even_cells(net.shape, (1, 1))
        wave = boundary_wave(net.shape, cells, state.configuration, direction)
        assert wave.wavelength == pytest.approx(length, rel=2e-3)
        assert wave.amplitude > 0.5


@pytest.mark.slow
@pytest.mark.parametrize(("options", "cells"), [(CLAMPED, (3, 4)), (PERIODIC, (1, 1))])
def test_central_cell_is_a_whole_unit_cell(options, cells):
    net, fabric = checkered(4, 2, options, cells)
    flat = flat_sheet(net, fabric)
    middle = even_cells(net.shape, cells).middle
    lines = (np.arange(each.start, each.stop) for each in middle)
    cell = np.asarray(nodes_at(net.shape, flat, *lines))
    assert cell.shape == (17, 17, 3)
    steps = np.diff(cell[..., :2], axis=0)[..., 1], np.diff(cell[..., :2], axis=1)[..., 0]
    for step in steps:
        assert np.allclose(step, step[0, 0])


def test_widths_across_folds_differ_between_centre_and_edges_of_a_patch():
    y, x = np.mgrid[:17, :17].astype(float)
    # Every patch is 8 wide, and 6 at mid-height, where its right border is shifted by 2.
    bulge = 1 - (np.mod(y, 8) / 4 - 1) ** 2
    x = x - 2 * bulge * np.mod(x, 8) / 8 - 2 * bulge * (x // 8)
    cell = np.stack([x, y, 0 * x], axis=-1)
    cell[:, 16, 0] = cell[:, 8, 0] + (8 - 2 * bulge[:, 0])
    shape = MeshShape(16, 16, periodic=False)
    sheet = Configuration(cell, np.zeros(2))
    widths = widths_across_folds(shape, checkerboard(2), even_cells(shape, (1, 1)), sheet)
    assert widths["rib"] == pytest.approx((6, 8))
    assert widths["garter"] == pytest.approx((8, 8))
