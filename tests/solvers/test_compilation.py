"""A design of another mesh shape is solved by the programs that are compiled already."""

import jax
import pytest

from knitlab.runs.plan import make_plan
from knitlab.runs.simulate import simulated

SHORT = ("strain_max=0.03", "robustness=0")
LOWERED = "/jax/core/compile/jaxpr_to_mlir_module_duration"


def simulate(*settings):
    (case,) = make_plan("periodic", (*SHORT, *settings)).cases.values()
    return simulated(case, lambda case_id, states: None)


@pytest.fixture
def compiled():
    """Counts what JAX compiles, or loads as compiled before."""
    events = []

    def listen(event, duration, **details):
        if event == LOWERED:
            events.append(event)

    jax.monitoring.register_event_duration_secs_listener(listen)  # JAX 0.8 cannot take it back
    return events


@pytest.mark.parametrize(
    "boundary",
    ["periodic", pytest.param("clamped", marks=[pytest.mark.slow, pytest.mark.nightly])],
)
def test_a_design_of_another_size_needs_no_compilation(compiled, boundary):
    cells = 1 if boundary == "periodic" else 2
    # Dynamics are compiled for every mesh shape.
    options = f"boundary={boundary}", f"unit_cells={cells},{cells}", "start=flat"
    simulate("n_stripe=6", "n_subunit=24", *options)
    compiled.clear()
    other = simulate("n_stripe=4", "n_subunit=8", *options)
    assert other["poisson_ratio"][-1].notnull()
    assert not compiled
