"""Times of the dynamics: ``python -m pytest benchmarks/bench_dynamics.py``.

Set ``OMP_NUM_THREADS`` and ``PJRT_NPROC`` to the number of threads. A first call compiles and is
not counted; a test at the paper's size has none, as compiling is a small part of it.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import pytest

from knitlab.model.fabric import flat_sheet
from knitlab.runs.plan import make_plan
from knitlab.solvers.case import Case
from knitlab.solvers.dynamics.damped_test import on_grid
from knitlab.solvers.dynamics.method import moving_fabrics
from knitlab.solvers.dynamics.motion import Motion, leapfrog
from knitlab.solvers.methods import METHODS

STEPS, STEP = 50, 1e-4  # number and size [ms] of the time steps that are timed together
SETTINGS = (
    *("method=dynamics", "contact=none", "ending=time"),
    *("relax_time=40", "strain_rate=0.012", "strain_max=0.48"),
)
"""40 ms of relaxation, then 48 % in 40 ms."""
EIGHT = (
    *("n_stripe=4", "n_subunit=16", "boundary=periodic", "unit_cells=1,1"),
    "k_t_factor=0.7,0.8,0.9,1,1.1,1.2,1.3,1.4",
)


def cases(workflow: str, *settings: str) -> list[Case]:
    """Cases of a workflow by dynamics that end after a time."""
    return list(make_plan(workflow, (*SETTINGS, *settings)).cases.values())


@pytest.mark.parametrize("unit_cells", ["3,2", "22,11"])
def test_steps(benchmark: Any, unit_cells: str) -> None:
    """Fifty time steps of a sample of (4, 16)."""
    settings = ("n_stripe=4", "n_subunit=16", "boundary=clamped", f"unit_cells={unit_cells}")
    (case,) = cases("preview", *settings)
    (body,) = moving_fabrics([case]).bodies(clamped=False)
    motion = Motion.at_rest(on_grid(flat_sheet(*case.assemble())))
    leap, count = eqx.filter_jit(leapfrog), jnp.asarray(STEPS)

    def steps() -> None:
        leap(body, motion, jnp.asarray(STEP), count, count).dissipated.block_until_ready()

    benchmark.pedantic(steps, rounds=7, warmup_rounds=1)
    benchmark.extra_info["nodes"] = case.mesh_shape.nodes


@pytest.mark.parametrize(
    ("workflow", "design"), [("preview", (4, 16)), ("paper", (8, 32)), ("paper", (4, 16))]
)
def test_whole_test(benchmark: Any, workflow: str, design: tuple[int, int]) -> None:
    """Relaxation and tensile test: of a small sample, and at the paper's size."""
    of_design = cases(workflow, f"n_stripe={design[0]}", f"n_subunit={design[1]}")
    warmup = int(workflow == "preview")
    benchmark.pedantic(
        METHODS["dynamics"].stretch,
        args=(of_design, lambda *_: None),
        rounds=1,
        warmup_rounds=warmup,
    )


@pytest.mark.parametrize("together", [True, False], ids=["together", "in turn"])
def test_eight_fabrics(benchmark: Any, together: bool) -> None:
    """Tests of eight periodic fabrics, as a batch or one after another."""
    fabrics = cases("preview", *EIGHT)
    batches = [fabrics] if together else [[case] for case in fabrics]

    def tests() -> None:
        for batch in batches:
            METHODS[batch[0].method].stretch(batch, lambda *_: None)

    benchmark.pedantic(tests, rounds=1, warmup_rounds=1)
