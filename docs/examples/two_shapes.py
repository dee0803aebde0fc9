"""Relaxed shapes of one fabric, their energies, and what lies between them.

python docs/examples/two_shapes.py  (some minutes) prints the energies of samples that relax
in three ways and the height of the pass between two shapes, and draws two_shapes.png beside it.
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

import knitlab as kl
from knitlab.model.computing import computing
from knitlab.model.fabric import Configuration
from knitlab.model.surfaces import self_intersections
from knitlab.solvers.case import Case
from knitlab.solvers.dynamics.grid import GridFabric, Shape
from knitlab.solvers.equilibrium.method import Equilibrium
from knitlab.solvers.equilibrium.state import State

DESIGNS = (8, 32), (6, 24)
STARTS = "dynamics", "flat", "periodic"
IMAGES = 21
"""Shapes along a path, the two relaxed ones included."""
ITERATIONS = 12_000
STEP, FRICTION = 0.005, 0.98
"""Step of a path over the force divided by the stiffest k_s, and what it keeps of the last step."""


@computing()
def relaxed(design: tuple[int, int], start: str) -> tuple[Case, State]:
    """A small sample of a design, relaxed from a start."""
    planned = kl.plan(
        "preview",
        n_stripe=design[0],
        n_subunit=design[1],
        unit_cells=[4, 3],
        method="equilibrium",
        ending="rest",
        start=start,
        strain_max=0.0,
    )
    (case,) = planned.cases.values()
    (test,) = Equilibrium().stretch([case], lambda name, states: None)
    return case, test.states[0]


@computing()
def lowest_path(
    case: Case, one: Configuration, other: Configuration
) -> Float[np.ndarray, " image"]:
    """Energies along a path of low energy between two shapes, by a nudged elastic band [N mm].

    Every shape moves by the forces across the path; the distances along it are kept even.
    """
    net, fabric = case.assemble()
    grid = GridFabric.of(net.shape, fabric)
    part = np.linspace(0, 1, IMAGES)[:, None, None, None]
    path = jnp.asarray((1 - part) * np.asarray(one.positions) + part * np.asarray(other.positions))
    lengths = jnp.asarray(one.lengths)

    def shape(nodes: Float[Array, "y x 3"]) -> Shape:
        return Shape((nodes[..., 0], nodes[..., 1], nodes[..., 2]), lengths)

    def gradient(nodes: Float[Array, "y x 3"]) -> Float[Array, "y x 3"]:
        return jnp.stack(grid.gradient(shape(nodes)).positions, axis=-1)

    def norm(vectors: Float[Array, "image y x 3"]) -> Float[Array, "image 1 1 1"]:
        return jnp.sqrt(jnp.sum(vectors**2, axis=(1, 2, 3), keepdims=True))

    stiffest = float(np.max(fabric.stretch_stiffness))

    @jax.jit
    def relaxed_path(path: Float[Array, "image y x 3"]) -> Float[Array, "image y x 3"]:
        def once(_: int, moving: tuple[Array, Array]) -> tuple[Array, Array]:
            path, last = moving
            ahead, behind = path[2:] - path[1:-1], path[1:-1] - path[:-2]
            tangent = (ahead + behind) / norm(ahead + behind)
            force = -jax.vmap(gradient)(path[1:-1])
            along = jnp.sum(force * tangent, axis=(1, 2, 3), keepdims=True)
            even = (norm(ahead) - norm(behind)) * tangent
            step = FRICTION * last + STEP * ((force - along * tangent) / stiffest + even)
            return path.at[1:-1].add(step), step

        return jax.lax.fori_loop(0, ITERATIONS, once, (path, jnp.zeros_like(path[1:-1])))[0]

    energies = jax.jit(jax.vmap(lambda nodes: grid.energy(shape(nodes)).total))
    return np.asarray(energies(relaxed_path(path)))


SAME = 1e-6
"""Energies that differ less are of one shape [N mm]."""

figure = Figure(figsize=(4.5, 2.8), layout="constrained")
axes = figure.subplots()
print("design    start     energy [N mm]  cells intersecting  width [mm]")
for design in DESIGNS:
    found = {start: relaxed(design, start) for start in STARTS}
    for start, (case, state) in found.items():
        shapes = Configuration.stacked([state.configuration])
        crossing = int(self_intersections(case.mesh_shape, shapes)[0])
        width = np.ptp(state.configuration.positions[..., 0].mean(axis=0))
        energy = float(state.energy.total)
        print(f"{design!s:9s} {start:9s} {energy:12.4f} {crossing:14d} {width:16.2f}")
    (case, one), (_, other) = found["dynamics"], found["periodic"]
    if abs(one.energy.total - other.energy.total) < SAME:
        continue
    energies = lowest_path(case, one.configuration, other.configuration)
    highest, lowest = energies.max(), energies.min()
    print(
        f"{design!s:9s} from dynamics to periodic: at most {highest - energies[0]:.4f} above the"
        f" one and {highest - energies[-1]:.4f} above the other, down to {lowest:.4f}"
    )
    axes.plot(np.linspace(0, 1, IMAGES), energies, ".-", label=str(design))
axes.set(xlabel="way from the shape of 'dynamics' to that of 'periodic'", ylabel="energy [N mm]")
axes.legend(frameon=False)
figure.savefig(Path(__file__).with_suffix(".png"), dpi=150)
