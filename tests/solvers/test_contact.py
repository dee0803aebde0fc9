"""Contact in simulations: nothing passes through itself, balance, limits, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

import knitlab as kl
from knitlab.model.cell_grid import nodes_at
from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape
from knitlab.model.surfaces import self_intersections

PERIODIC = kl.Design(n_stripe=4, n_subunit=16, boundary="periodic")
RATIO = 0.3467  # of lengths of the network to those of the cloth, for n_stripe 4
THICKNESS = kl.defaults().sheet.thickness * RATIO


def only(**settings):
    (case,) = kl.plan("periodic", n_stripe=4, n_subunit=16, **settings).cases.values()
    return case


def distances(nodes):
    """Shortest distance of two nodes more than two cells apart on the grid, by brute force."""
    rows, columns = nodes.shape[:2]
    place = np.indices((rows, columns)).reshape(2, -1).T
    points = nodes.reshape(-1, 3)
    apart = np.linalg.norm(points[:, None] - points, axis=-1)
    return apart[np.abs(place[:, None] - place).max(axis=-1) > 2].min()


@pytest.mark.slow
def test_a_fabric_that_would_pass_through_itself_keeps_its_distance():
    strains = [0.0, 0.03, 0.06]
    free = kl.simulate(PERIODIC, strains, model=kl.Model(contact="none"))
    held = kl.simulate(PERIODIC, strains)
    assert free["self_intersections"][0] > 0
    assert not held["self_intersections"].any()
    assert (held["residual_force"] < 1e-8).all()
    assert held["energy_contact"][0] > 0
    shape = MeshShape(16, 16, periodic=True)
    sides = np.stack([held["length_x"], held["length_y"]], axis=-1)
    shapes = Configuration(held["position"].values, sides)
    assert not any(self_intersections(shape, shapes))
    around = nodes_at(shape, shapes, np.arange(32), np.arange(32))
    assert all(distances(np.asarray(state)) > THICKNESS for state in around)


@pytest.mark.slow
def test_clamped_samples_with_contact_balance_and_keep_from_passing_through_themselves():
    design = kl.Design(n_stripe=4, n_subunit=16, boundary="clamped", unit_cells=(1, 1))
    held = kl.simulate(design, [0.0, 0.05, 0.1])
    assert not held["self_intersections"].any()
    parts = ("stretch", "fold", "wall", "contact")
    energy = sum(held[f"energy_{part}"].values for part in parts)
    work = np.trapezoid(held["reaction_force"], held["applied_strain"]) * np.ptp(
        held["position"].values[0, :, :, 1].mean(axis=1)
    )
    assert energy[-1] - energy[0] == pytest.approx(work, rel=0.05)


@pytest.mark.slow
def test_thin_fabric_that_touches_nothing_is_that_without_contact():
    design = kl.Design(n_stripe=4, n_subunit=24, boundary="periodic")
    strains = [0.0, 0.1]
    model = kl.Model(cell_size="flat", contact="none")
    sheet = kl.Sheet(z_max=1.9, k_wall=100.0)
    free = kl.simulate(design, strains, model=model, sheet=sheet)
    assert not free["self_intersections"].any()
    differences = []
    for thickness in (0.02, 0.002):
        touching = replace(model, contact="barrier")
        thin = replace(sheet, thickness=thickness)
        held = kl.simulate(design, strains, model=touching, sheet=thin)
        differences.append(abs(held["poisson_ratio"][1].item() - free["poisson_ratio"][1].item()))
    assert differences[1] < 1e-3
    assert differences[1] <= differences[0]


@pytest.mark.slow
@pytest.mark.nightly
def test_sensitivities_with_contact_predict_a_test_of_changed_stripes():
    """By the change of the reaction force with k_t; a pull of plies that press on each other."""
    strains, sheet = [0.0, 0.02], kl.Sheet(z_max=6.0, k_wall=100.0, thickness=0.25)
    rib = kl.defaults().stripes.stripe("rib", 4)

    def pulled(factor):
        design = replace(PERIODIC, rib=replace(rib, k_t=factor * rib.k_t))
        protocol = kl.Protocol(sensitivities=True)
        return kl.simulate(design, strains, protocol=protocol, sheet=sheet)

    low, middle, high = (pulled(factor) for factor in (0.998, 1.0, 1.002))
    assert (middle["energy_contact"] > 0).all()
    found = middle["reaction_force_sensitivity"].sel(stripe_parameter="rib_k_t")[1].item()
    change = (high["reaction_force"] - low["reaction_force"])[1].item()
    assert found == pytest.approx(change / 0.004, rel=1e-3)


@pytest.mark.slow
def test_contact_is_a_dimension_of_a_cube_and_its_energy_is_missing_without(tmp_path):
    cube = kl.run(
        "periodic",
        n_stripe=4,
        n_subunit=8,
        strain_max=0.03,
        robustness=0,
        contact=["none", "barrier"],
        results=tmp_path,
    )
    energy = cube["energy_contact"].squeeze()
    assert np.isnan(energy.sel(contact="none")).all()
    assert np.isfinite(energy.sel(contact="barrier")).all()


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        ({"method": "dynamics", "integrator": "tsit5"}, "leapfrog"),
        ({"thickness": 4.0}, "4 mm.*1.36 mm"),
        ({"thickness": -1}, "thickness"),
    ],
)
def test_what_contact_is_not_combined_with_is_refused(settings, problem):
    with pytest.raises(kl.InputError, match=problem):
        only(**settings)


def test_only_with_contact_are_cases_told_apart_by_their_thickness():
    without = {only(contact="none", thickness=each).case_id for each in (0.2, 0.4)}
    touching = {only(thickness=each).case_id for each in (0.2, 0.4)}
    assert without == {only(contact="none").case_id}
    assert len(touching | without) == 3


def test_walls_leave_half_a_thickness_to_the_middle_surface():
    gaps = [float(only(contact=contact).assemble()[1].z_max) for contact in ("none", "barrier")]
    assert gaps[0] - gaps[1] == pytest.approx(THICKNESS / 2, rel=1e-3)
    assert gaps[0] == pytest.approx(6.0 * RATIO, rel=1e-3)
