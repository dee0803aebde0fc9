"""Derivatives of equilibria, against finite differences of recomputed equilibria."""

from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from knitlab.model.contact_layers import contact_layers
from knitlab.model.energy import Energy, Evaluation, Point
from knitlab.model.fabric import Configuration, Fabric, flat_sheet
from knitlab.model.layout import FabricLayout, fabric_layout
from knitlab.model.network import MeshShape
from knitlab.model.pattern import Grading, SingleFold, graded_pattern
from knitlab.model.settings import ModelOptions, PlainKnit, Sheet
from knitlab.model.stripe_numbers import StripePair
from knitlab.observables.case_variables import STRIPE_PARAMETERS
from knitlab.observables.sensitivity import logarithmic, measured_by
from knitlab.solvers.equilibrium.adjoint import Adjoint, NoDerivative, rigid_motions
from knitlab.solvers.equilibrium.alignment import aligning_rotation, rigidly_aligned
from knitlab.solvers.equilibrium.contact_barrier import Barrier
from knitlab.solvers.equilibrium.equilibrium import find_equilibrium
from knitlab.solvers.equilibrium.search import SearchRules
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.system import System
from knitlab.solvers.equilibrium.tensile_test import stretch
from knitlab.solvers.loads.loading import all_free, loading_of
from tests.fabrics import CLAMPED, FINE, PERIODIC, checkerboard, equations, even_cells, stripe

NAMES = (
    "poisson_ratio",
    "mean_strain_xx",
    "mean_strain_yy",
    "reaction_force",
    "relaxed_cell_x",
    "relaxed_cell_y",
)
ALIGNING = jax.jit(aligning_rotation)
SLOPE = jax.jit(
    lambda target, points, toward: jax.jvp(
        lambda moved: aligning_rotation(target, moved), (points,), (toward,)
    )[1]
)
WALLS_FAR, WALLS_NEAR = Sheet(6.0, 100.0), Sheet(1.5, 100.0)


@dataclass(frozen=True)
class Pulled:
    """A small design, relaxed and at one strain."""

    layout: FabricLayout
    unit_cells: tuple[int, int]
    stripes: StripePair
    strain: float
    relaxed: Configuration
    strained: Configuration
    thickness: float | None = None  # with contact

    @property
    def cells(self):
        return even_cells(self.layout.net.shape, self.unit_cells)

    @property
    def measure(self):
        return measured_by(self.layout.net.shape, self.cells, NAMES)

    def under(self, stripes: StripePair) -> tuple[Configuration, Configuration, Fabric]:
        """Its states with slightly different stripes, each started from the original state."""
        net, fabric = self.layout.net, self.layout.fabric(stripes)

        contact = self.contact(fabric)

        def found(start: np.ndarray, free: np.ndarray) -> Configuration:
            stiffness = free_stiffness(net.shape, free)
            rules = SearchRules(stiffness, FINE, convexified=False)
            system = System(net.shape, fabric, contact=contact)
            state = find_equilibrium(system, Point(start), rules)
            assert state.converged
            return state.configuration

        relaxed = found(self.relaxed.flattened(), all_free(net.shape))
        aligned = rigidly_aligned(net.shape, flat_sheet(net, fabric), relaxed)
        relaxed = found(np.asarray(aligned.flattened()), all_free(net.shape))
        loading = loading_of(net.shape, relaxed)
        start = loading.holding(self.strained.flattened(), self.strain)
        return relaxed, found(start, loading.free), fabric

    def measured_here(self) -> np.ndarray:
        return self._measured(self.relaxed, self.strained, self.layout.fabric(self.stripes))

    def measured(self, stripes: StripePair) -> np.ndarray:
        return self._measured(*self.under(stripes))

    def _measured(
        self, relaxed: Configuration, strained: Configuration, fabric: Fabric
    ) -> np.ndarray:
        unknowns = np.asarray(strained.flattened())
        pushed, contact = np.zeros_like(unknowns), self.contact(fabric)
        if contact is not None:
            bare = Evaluation(Energy(*jnp.zeros(3)), pushed)
            pushed = contact.added(bare, unknowns).gradient
        return np.asarray(jax.jit(self.measure)(relaxed, strained, fabric, pushed))

    def contact(self, fabric: Fabric) -> Barrier | None:
        return barrier_of(fabric, self.layout.net.shape, self.thickness)

    def adjoint(self) -> Adjoint:
        contact = self.contact(self.layout.fabric(self.stripes))
        return Adjoint(self.layout, self.stripes, self.relaxed, contact)

    def sensitivities(self) -> np.ndarray:
        found = self.adjoint().strained_derivatives(self.strain, self.strained, self.measure)
        return logarithmic(found, self.stripes)


def barrier_of(fabric: Fabric, shape: MeshShape, thickness: float | None) -> Barrier | None:
    if thickness is None:
        return None
    cell = float(np.mean(fabric.cell_x)), float(np.mean(fabric.cell_y))
    return Barrier(shape, contact_layers(thickness, 1.0, cell))


def pulled(
    n_stripe: int,
    options: ModelOptions,
    unit_cells: tuple[int, int] = (1, 1),
    sheet: Sheet = WALLS_FAR,
) -> Pulled:
    layout = fabric_layout(checkerboard(1, unit_cells), sheet, options)
    stripes = StripePair.of([stripe("rib", n_stripe)], [stripe("garter", 2 * n_stripe)])
    return pulled_fabric(layout, stripes, unit_cells, sheet)


def pulled_fabric(
    layout: FabricLayout,
    stripes: StripePair,
    unit_cells: tuple[int, int],
    sheet: Sheet,
    strain: float = 0.05,
    thickness: float | None = None,
) -> Pulled:
    fabric = layout.fabric(stripes)
    contact = barrier_of(fabric, layout.net.shape, thickness)
    test = stretch(equations(layout.net, fabric, contact), [0, strain], FINE)
    relaxed, strained = test.states
    assert strained.converged
    assert not strained.snapped
    # Finite differences are invalid if a node begins or ends to touch a wall.
    for state in test.states:
        heights = np.abs(state.configuration.positions[..., 2])
        assert np.abs(heights - sheet.z_max).min() > 1e-6
    shapes = relaxed.configuration, strained.configuration
    return Pulled(layout, unit_cells, stripes, strain, *shapes, thickness)


@pytest.fixture(scope="module")
def periodic() -> Pulled:
    return pulled(4, PERIODIC)


@pytest.fixture(scope="module")
def clamped() -> Pulled:
    return pulled(2, CLAMPED, (2, 1))


def by_differences(of: Pulled) -> np.ndarray:
    """Logarithmic derivatives by central differences of two steps, extrapolated."""
    columns = []
    for side, name in STRIPE_PARAMETERS.values():

        def at(factor, side=side, name=name):
            def where(pair):
                return getattr(getattr(pair, side), name)

            return of.measured(eqx.tree_at(where, of.stripes, factor * where(of.stripes)))

        short, long = ((at(1 + h) - at(1 - h)) / (2 * h) for h in (2e-4, 4e-4))
        columns.append((4 * short - long) / 3)
    return np.stack(columns, axis=-1)


def assert_agree(found: np.ndarray, expected: np.ndarray) -> None:
    """Within 1e-5 of the largest derivative of each quantity."""
    scale = np.abs(expected).max(axis=1, keepdims=True)
    assert (np.abs(found - expected) <= 1e-5 * scale + 1e-9).all()


@pytest.mark.slow
@pytest.mark.nightly
def test_derivatives_of_periodic_fabric_agree_with_finite_differences(periodic):
    found, expected = periodic.sensitivities(), by_differences(periodic)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-9)


@pytest.mark.slow
def test_derivatives_of_a_clamped_sample_are_those_of_differences(clamped):
    assert_agree(clamped.sensitivities(), by_differences(clamped))


@pytest.mark.slow
def test_derivatives_of_a_sample_pressed_by_walls_are_those_of_differences():
    pressed = pulled(4, CLAMPED, (2, 1), WALLS_NEAR)
    assert (np.abs(pressed.strained.positions[..., 2]) > WALLS_NEAR.z_max).any()
    assert_agree(pressed.sensitivities(), by_differences(pressed))


@pytest.mark.slow
@pytest.mark.nightly
def test_derivatives_of_graded_fabric_are_those_of_differences():
    """Two ribs and two garters, plain knit beside them, and a single fold, all with ridges."""
    cells_per_period = 8
    ribs, garters = [stripe("rib", n) for n in (4, 6)], [stripe("garter", n) for n in (8, 12)]
    grading = Grading((1, 1), (1, 1, 1), (garters[1], garters[0]), (*ribs, ribs[0]))
    fold = SingleFold(along="wale", at=2.5, theta_0=2.2, end=1)
    rows = ("GRP", "RGP")
    pattern = graded_pattern(rows, 1, (1, 1), grading, (fold,), cells_per_period)
    options = ModelOptions(boundary="periodic", cells_per_period=cells_per_period)
    plain = PlainKnit(
        plain_stretch_weft=0.9, plain_stretch_warp=2.5, plain_bend_weft=0.02, plain_bend_warp=0.05
    )
    layout = fabric_layout(pattern, WALLS_FAR, options, plain)
    stripes = StripePair.of(grading.weft, grading.warp)
    graded = pulled_fabric(layout, stripes, (1, 1), WALLS_FAR)
    assert_agree(graded.sensitivities(), by_differences(graded))


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize(("strain", "pressed"), [(0.02, True), (0.1, False)])
def test_derivatives_with_contact_are_those_of_differences(strain, pressed):
    """Plies touch in the relaxed shape. The barrier's scale depends on the periods and θ0."""
    layout = fabric_layout(checkerboard(2), WALLS_FAR, PERIODIC)
    stripes = StripePair.of([stripe("rib", 4)], [stripe("garter", 8)])
    touching = pulled_fabric(layout, stripes, (1, 1), WALLS_FAR, strain, thickness=0.25)
    contact = touching.contact(layout.fabric(stripes))
    for shape, within_reach in ((touching.relaxed, True), (touching.strained, pressed)):
        unknowns = np.asarray(shape.flattened())
        assert (contact.hessian(unknowns, np.arange(len(unknowns))) is not None) == within_reach
    assert_agree(touching.sensitivities(), by_differences(touching))


@pytest.mark.slow
def test_the_relaxed_shape_alone_has_the_same_derivatives(periodic):
    alone = logarithmic(periodic.adjoint().relaxed_derivatives(periodic.measure), periodic.stripes)
    np.testing.assert_allclose(alone[4:], periodic.sensitivities()[4:], rtol=1e-9)


@pytest.mark.slow
def test_any_scalar_of_the_states_has_a_gradient(periodic):
    """The chain rule holds for a loss made of several quantities."""

    strains = measured_by(periodic.layout.net.shape, periodic.cells, NAMES[1:3])

    def loss(*of):
        return jnp.sum(strains(*of) ** 2)

    gradient = periodic.adjoint().strained_derivatives(periodic.strain, periodic.strained, loss)
    expected = 2 * periodic.measured_here()[1:3] @ periodic.sensitivities()[1:3]
    np.testing.assert_allclose(logarithmic(gradient, periodic.stripes)[0], expected, rtol=1e-9)


@pytest.mark.slow
def test_results_do_not_depend_on_the_pose_before_the_rigid_alignment(clamped):
    """Derivatives do not depend on a rigid motion of the relaxed shape."""
    adjoint = clamped.adjoint()
    shape = clamped.layout.net.shape
    flat = flat_sheet(clamped.layout.net, clamped.layout.fabric(clamped.stripes))
    motions = rigid_motions(clamped.relaxed)

    def aligned(q):
        return rigidly_aligned(shape, flat, Configuration.of(q, shape)).flattened()

    left = np.asarray(jax.jacfwd(aligned)(jnp.asarray(clamped.relaxed.flattened()))) @ motions
    height = np.tile([0, 0, 1.0], shape.nodes)
    assert np.abs(np.delete(left, 2, axis=1)).max() < 1e-9
    np.testing.assert_allclose(left[:-2, 2], height, atol=1e-9)

    turn = Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix()
    weights = jnp.asarray(np.random.default_rng(0).normal(size=(shape.nodes, shape.nodes)))

    def distances(q):
        nodes = q.positions.reshape(-1, 3)
        return jnp.sum(weights * ((nodes[:, None] - nodes[None]) ** 2).sum(-1))

    def turned(q):
        return Configuration(q.positions @ turn.T, q.lengths)

    one = adjoint.relaxed_derivatives(lambda q0, *of: distances(q0))
    other = adjoint.relaxed_derivatives(lambda q0, *of: distances(turned(q0)))
    np.testing.assert_allclose(
        logarithmic(one, clamped.stripes), logarithmic(other, clamped.stripes), rtol=1e-8
    )


@pytest.mark.slow
def test_derivatives_are_missing_without_a_stable_equilibrium(periodic):
    flat = flat_sheet(periodic.layout.net, periodic.layout.fabric(periodic.stripes))
    squeezed = Configuration(
        flat.positions * np.array([1, 0.5, 1]), flat.lengths * np.array([1, 0.5])
    )
    with pytest.raises(NoDerivative):
        replace(periodic, relaxed=squeezed).adjoint()


@given(seed=st.integers(0, 1000), flat=st.booleans(), mirrored=st.booleans())
def test_the_aligning_rotation_and_its_derivative_are_scipys(seed, flat, mirrored):
    random = np.random.default_rng(seed)
    target = random.normal(size=(20, 3)) * [3, 2, 0 if flat else 1]
    points = Rotation.random(random_state=seed).apply(target)
    points = points * [1, 1, -1 if mirrored else 1] + 0.1 * random.normal(size=points.shape)

    def scipys(x):
        return Rotation.align_vectors(target, x)[0].as_matrix()

    found = ALIGNING(target, points)
    np.testing.assert_allclose(found, scipys(points), atol=1e-10)
    toward, h = random.normal(size=points.shape), 1e-6
    slope = SLOPE(target, points, toward)
    differences = (scipys(points + h * toward) - scipys(points - h * toward)) / (2 * h)
    np.testing.assert_allclose(slope, differences, atol=1e-6)
