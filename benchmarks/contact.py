"""What contact costs: ``python -m benchmarks.contact`` in the repository.

The paper's designs are relaxed and stretched as periodic fabric, without contact and with it, in
one process. It prints the processor time of each, compilation left out, which other programs on
the machine hardly change. Nothing of it is a test: figures depend on the machine.
"""

import time
from dataclasses import replace
from typing import Literal

import click
import numpy as np

import knitlab as kl

CONTACT: tuple[Literal["none", "barrier"], ...] = ("none", "barrier")


@click.command()
@click.option("--designs", default="paper", show_default=True, help="Set of params/designs.toml.")
@click.option("--strain-max", default=0.2, show_default=True, help="Last applied strain.")
@click.option("--steps", default=5, show_default=True, help="Strain steps.")
@click.option("--thickness", default=0.25, show_default=True, help="Distance of plies [mm].")
def main(designs: str, strain_max: float, steps: int, thickness: float) -> None:
    """Time every design without contact and with it."""
    sheet = replace(kl.defaults().sheet, thickness=thickness)
    strain = np.linspace(0.0, strain_max, steps + 1)
    click.echo("design    nodes     none  barrier  ratio  iterations  self-intersections")
    for n_stripe, n_subunit in kl.defaults().designs.root[designs].pairs:
        design = kl.Design(n_stripe=n_stripe, n_subunit=n_subunit, boundary="periodic")
        kl.simulate(design, strain[:2])  # compiles
        seconds, tests = [], []
        for contact in CONTACT:
            began = time.process_time()
            model = kl.Model(contact=contact)
            tests.append(kl.simulate(design, strain, model=model, sheet=sheet))
            seconds.append(time.process_time() - began)
        nodes = tests[0].sizes["node_y"] * tests[0].sizes["node_x"]
        counts = [
            "/".join(f"{int(test[name].sum())}" for test in tests)
            for name in ("iterations", "self_intersections")
        ]
        click.echo(
            f"{n_stripe},{n_subunit:<5} {nodes:7} {seconds[0]:7.1f}s {seconds[1]:7.1f}s"
            f" {seconds[1] / seconds[0]:6.1f}  {counts[0]:>10}  {counts[1]:>18}"
        )


if __name__ == "__main__":
    main()
