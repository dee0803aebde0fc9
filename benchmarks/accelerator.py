"""Simulations a second on JAX's device: ``python -m benchmarks.accelerator`` in the repository.

The batch is that of the paper's 20 designs as small samples, each with eight stiffnesses of its
folds: one vmapped program for each design. The same program then runs a variant of each design on
one core of the processor, in a process of its own. Programs are compiled before, which is not
counted. It prints simulations a second of both, and how far apart their forces are. Without an
accelerator, or with ``JAX_PLATFORMS=cpu``, the device is the processor.
"""

import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from typing import Any, NamedTuple

import click
import jax
import numpy as np
from jaxtyping import Float

from knitlab.model.threads import ONE_THREAD
from knitlab.runs.plan import make_plan
from knitlab.runs.simulate import tensile_tests
from knitlab.solvers.case import Case

SHORT = ("relax_steps=2", "step_strain=0.03", "strain_max=0.03")  # a test that only compiles


class Measured(NamedTuple):
    """Number of cases, their time [s], and the force of a variant of each design [N]."""

    cases: int
    seconds: float
    forces: list[float]


def groups(designs: int, variants: int, settings: tuple[str, ...]) -> list[list[Case]]:
    """The variants of each of the smallest designs."""
    factors = ",".join(f"{1 + k / 10:g}" for k in range(variants))
    made = make_plan("preview", ("set=paper", f"k_t_factor={factors}", *settings))
    of_design: dict[tuple[Any, ...], list[Case]] = defaultdict(list)
    for name, case in made.cases.items():
        of_design[made.designs[name][:2]].append(case)
    return sorted(of_design.values(), key=lambda cases: cases[0].mesh_shape.nodes)[:designs]


def forces(cases: list[Case]) -> Float[np.ndarray, " case"]:
    """Reaction force of every case at its last strain [N]."""
    last = []
    for test in tensile_tests(cases, lambda *_: None):
        if test.loading is None:
            raise RuntimeError("a fabric did not relax")
        last.append(test.loading.reaction_force(test.states[-1].gradient))
    return np.array(last)


def measured(designs: int, variants: int, settings: tuple[str, ...]) -> Measured:
    """Run the variants of designs, after their programs are compiled."""
    for cases in groups(designs, variants, SHORT):
        forces(cases)
    batch = groups(designs, variants, settings)
    began = time.perf_counter()
    found = [forces(cases) for cases in batch]
    seconds = time.perf_counter() - began
    return Measured(sum(map(len, batch)), seconds, [float(each[0]) for each in found])


@click.command()
@click.option("--designs", default=20, show_default=True, help="How many of the paper's designs.")
@click.option("--variants", default=8, show_default=True, help="Variants of each design.")
@click.option("--set", "settings", multiple=True, help="Further settings, as of knitlab run.")
@click.option("--one-core", is_flag=True, hidden=True)
def main(designs: int, variants: int, settings: tuple[str, ...], one_core: bool) -> None:
    """Time the batch on JAX's device, and one variant of each design on one core."""
    here = measured(designs, variants, settings)
    if one_core:
        click.echo(json.dumps(here))
        return
    done = subprocess.run(
        [
            *(sys.executable, "-m", "benchmarks.accelerator", "--one-core", "--variants=1"),
            *(f"--designs={designs}", *(f"--set={each}" for each in settings)),
        ],
        check=True,
        stdout=subprocess.PIPE,
        env=os.environ | dict.fromkeys(ONE_THREAD, "1") | {"JAX_PLATFORMS": "cpu"},
    )
    core = Measured(*json.loads(done.stdout))
    (device, *_) = jax.devices()
    named = {f"{device.platform} {device.device_kind}": here, "one core": core}
    for name, each in named.items():
        click.echo(f"{name}: {each.cases} cases, {each.cases / each.seconds:.3g} a second")
    ratio = here.cases / here.seconds * core.seconds / core.cases
    apart = np.abs(np.array(here.forces) / np.array(core.forces) - 1).max()
    click.echo(f"ratio {ratio:.3g}, forces apart by {apart:.1e} of themselves")


if __name__ == "__main__":
    main()
