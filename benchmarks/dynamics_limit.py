"""How near the dynamics is to what the machine can do: ``python -m benchmarks.dynamics_limit``.

Steps of the leapfrog of a clamped sample are timed of knitlab, of a plain loop over the same grid
that Numba compiles, and of kernels of NVIDIA Warp if it is installed, all on one thread and in
turn. Before that, their forces and motions are compared. The memory's bandwidth is measured between
them (a sum of two arrays much larger than all caches). Times are of the processor, because of what
else may run, with wall times beside them.
"""

import os
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import click
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from benchmarks.clamped_grid import LEAST_BYTES, grid_of, rows_of
from benchmarks.command_line import results_in
from benchmarks.dynamics import STEP, cases
from benchmarks.solver.cube import machine, write_cube
from knitlab.io.provenance import provenance
from knitlab.model.fabric import flat_sheet
from knitlab.model.threads import ONE_THREAD
from knitlab.runs.simulate import moving_fabrics
from knitlab.solvers.dynamics.damped_test import on_grid
from knitlab.solvers.dynamics.motion import Body, Motion, leapfrog

KNITLAB, LOOP, WARP = "knitlab", "Numba loop", "Warp kernels"
OTHERS = {LOOP: ("numba", "benchmarks.compiled_loop"), WARP: ("warp", "benchmarks.warp_kernels")}
"""The package that each needs, and the module with its ``leapfrog``."""
SIZES = {"22,11": 200, "3,2": 4000}
"""Unit cells along y and x of the samples, and steps that are timed."""
COMPARED = 20  # steps that all do before, and agree
DISPLACED, HALF_GAP = 0.2, 0.1
"""Largest displacement of nodes from the flat sheet, at random, and of walls, so that they act
[mm]."""
LARGEST_DIFFERENCE = 1e-10
WORDS = 2**24
"""Numbers in each of the three arrays by which the bandwidth is measured."""

Moved = tuple[np.ndarray, np.ndarray]
"""Velocities, and the works dissipated and supplied."""
Move = Callable[[int], Moved]
"""A motion by a number of steps, from the same beginning."""
DIMS = "size", "program", "repeat"


@click.command()
@click.option("--repeats", default=7, show_default=True, help="Repeats of every measurement.")
@results_in("dynamics_benchmark")
def main(repeats: int, results: Path) -> None:
    """Time a step by every method and print medians, ratios and the fraction of the bandwidth."""
    if find_spec("numba") is None:
        raise click.UsageError("Numba is not installed; run pip install 'knitlab[benchmarks]'")
    os.environ.update(ONE_THREAD)
    cube = measured(repeats)
    write_cube(cube, results / "limit.nc")
    click.echo(report(cube))


def measured(repeats: int) -> xr.Dataset:
    """The cube of all times, after forces and motions were found to agree."""
    methods = [KNITLAB, *(name for name, (package, _) in OTHERS.items() if find_spec(package))]
    nodes, differences, moves = zip(*(prepared(size, methods) for size in SIZES), strict=True)
    seconds = np.full((2, len(SIZES), len(methods), repeats), np.nan)
    bandwidth = np.full(repeats, np.nan)
    load = os.getloadavg()[0]
    for repeat in range(repeats):
        bandwidth[repeat] = triad_bandwidth()
        for at, (of_size, steps) in enumerate(zip(moves, SIZES.values(), strict=True)):
            for method, move in enumerate(of_size):
                began = time.process_time(), time.perf_counter()
                move(steps)
                ended = time.process_time(), time.perf_counter()
                seconds[:, at, method, repeat] = np.subtract(ended, began) / steps
    cube = xr.Dataset(
        {
            "processor_seconds": (DIMS, seconds[0], _attributes("s", "processor time of a step")),
            "wall_seconds": (DIMS, seconds[1], _attributes("s", "wall time of a step")),
            "bandwidth": ("repeat", bandwidth, _attributes("B/s", "memory bandwidth of a triad")),
            "difference": (
                (*DIMS[:2], "of"),
                np.array(differences),
                _attributes("1", "largest difference from knitlab, over its largest value"),
            ),
        },
        {
            "size": list(SIZES),
            "program": methods,
            "repeat": range(repeats),
            "of": ["force", "velocity", "work"],
            "nodes": ("size", list(nodes)),
        },
        {**provenance(), **machine(), "least_bytes": LEAST_BYTES, "load_average": load},
    )
    per_node = cube["processor_seconds"].median("repeat") / cube["nodes"]
    cube["times_slower"] = (per_node / per_node.sel(program=LOOP)).assign_attrs(
        _attributes("1", "median processor time over that of the Numba loop")
    )
    fraction = LEAST_BYTES / per_node / cube["bandwidth"].median()
    cube["bandwidth_fraction"] = fraction.assign_attrs(
        _attributes("1", "bandwidth by which a step moves the least bytes, over that measured")
    )
    return cube


def prepared(size: str, methods: list[str]) -> tuple[int, list[list[float]], list[Move]]:
    """Number of nodes, differences of every method, and the methods, compiled, for a sample.

    Raises:
        click.ClickException: if forces or motions differ by more than round-off.
    """
    place = "n_stripe=4", "n_subunit=16", "boundary=clamped", f"unit_cells={size}"
    (case,) = cases("preview", *place)
    (body,) = moving_fabrics([case]).bodies(clamped=True)
    body = eqx.tree_at(lambda own: own.fabric.z_max, body, jnp.asarray(HALF_GAP))
    flat, random = on_grid(flat_sheet(*case.assemble())), np.random.default_rng(0)
    x, y, z = (
        component + random.uniform(-DISPLACED, DISPLACED, component.shape)
        for component in flat.positions
    )
    still = Motion.at_rest(flat._replace(positions=(x, y, z)))
    pulled = jnp.zeros_like(y).at[-1].set(case.motion.strain_rate * flat.lengths[1])
    motion = eqx.tree_at(lambda own: own.velocity.positions[1], still, pulled)
    force = rows_of(body.fabric.gradient(still.shape, walls=False))
    # Of mass 1 without drag and walls, the first kick of a step of 2 ms is the force.
    lone = jax.tree.map(jnp.ones_like, body.inverse), jnp.zeros(()), jnp.zeros(())
    free = eqx.tree_at(lambda own: (own.inverse, own.damping, own.fabric.k_wall), body, lone)
    expected = _by_knitlab(body, motion, COMPARED)
    differences, moves = [], list[Move]()
    for method in methods:
        by = _by_knitlab
        if method != KNITLAB:
            by = partial(_by_loop, import_module(OTHERS[method][1]).leapfrog)
        moves.append(partial(by, body, motion))
        kicked, found = by(free, still, 0, 2.0)[0], moves[-1](COMPARED)
        differences.append(
            [_difference(-kicked, force)]
            + [_difference(*pair) for pair in zip(found, expected, strict=True)]
        )
        if max(differences[-1]) > LARGEST_DIFFERENCE:
            raise click.ClickException(f"{method} moves otherwise than knitlab: {differences[-1]}")
    return x.size, differences, moves


def _by_knitlab(body: Body, motion: Motion, count: int, step: float = STEP) -> Moved:
    """As :mod:`knitlab.solvers.dynamics.motion` moves a batch, of one."""
    batch = jax.tree.map(lambda leaf: leaf[None], (body, motion))
    numbers = jnp.asarray([step]), jnp.asarray([count]), jnp.asarray(count)
    moved = jax.tree.map(lambda leaf: leaf[0], _LEAP(*batch, *numbers))
    return rows_of(moved.velocity), np.array([moved.dissipated, moved.supplied])


_LEAP = jax.jit(jax.vmap(leapfrog, in_axes=(0, 0, 0, 0, None)))


def _by_loop(
    loop: Callable[..., tuple[float, float]],
    body: Body,
    motion: Motion,
    count: int,
    step: float = STEP,
) -> Moved:
    places, velocities = rows_of(motion.shape), rows_of(motion.velocity)
    return velocities, np.array(loop(grid_of(body), places, velocities, step, count))


def _difference(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def triad_bandwidth() -> float:
    """Bytes read and written in a second of processor time by a sum of two large arrays [B/s]."""
    triad = import_module("benchmarks.compiled_loop").triad
    one, other, total = np.ones(WORDS), np.ones(WORDS), np.ones(WORDS)
    triad(one[:1], other[:1], total[:1])
    began = time.process_time()
    triad(one, other, total)
    return 3 * one.nbytes / (time.process_time() - began)


def report(cube: xr.Dataset) -> str:
    """Medians and ranges as a table."""
    lines = [
        f"memory bandwidth {float(cube['bandwidth'].median()) / 1e9:.1f} GB/s,"
        f" of {float(cube['bandwidth'].min()) / 1e9:.1f} to"
        f" {float(cube['bandwidth'].max()) / 1e9:.1f}; least bytes of a node and step"
        f" {cube.attrs['least_bytes']}; load average {cube.attrs['load_average']:.1f}",
        f"{'nodes':>7} {'method':12} {'ns per node and step':>20} {'range':>14} {'wall':>7}"
        f" {'/ loop':>7} {'of bandwidth':>12}  difference of force, velocity, work",
    ]
    per_node = 1e9 * cube[["processor_seconds", "wall_seconds"]] / cube["nodes"]
    for size in cube["size"].values:
        for method in cube["program"].values:
            place = {"size": size, "program": method}
            own, times = cube.sel(place), per_node.sel(place)
            spent = times["processor_seconds"]
            lines.append(
                f"{int(own['nodes']):7,} {method:12} {float(spent.median()):20.1f}"
                f" {float(spent.min()):6.1f}–{float(spent.max()):<7.1f}"
                f" {float(times['wall_seconds'].median()):7.1f} {float(own['times_slower']):7.2f}"
                f" {float(own['bandwidth_fraction']):12.0%} "
                + "".join(f" {difference:.0e}" for difference in own["difference"].values)
            )
    lines += [f"{name} is not installed" for name in OTHERS if name not in cube["program"].values]
    return "\n".join(lines)


def _attributes(units: str, long_name: str) -> dict[str, str]:
    return {"units": units, "long_name": long_name}


if __name__ == "__main__":
    main()
