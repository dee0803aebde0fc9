"""Transverse strain of the cube of ``knitlab run springs``, by how soon springs stiffen.

python docs/examples/spring_laws.py results/springs/cube.nc -o spring_laws.png
"""

import argparse
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

DESIGNS = (4, 16), (4, 32), (8, 48)
AFTER = 0.09
"""Applied strain over which the fall is taken."""

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("cube", type=Path)
parser.add_argument("-o", "--output", type=Path, default=Path("spring_laws.png"))
asked = parser.parse_args()

cube = xr.open_dataset(asked.cube, engine="netcdf4")
strain = cube.applied_strain.values
steps = round(AFTER / (strain[1] - strain[0]))
figure = Figure(figsize=(7.0, 2.4), layout="constrained")
print("design    e_s   peak   at    in the next 0.09   slope at 0.54")
for axes, (n_stripe, n_subunit) in zip(figure.subplots(1, 3), DESIGNS, strict=True):
    for colour, stiffening in enumerate(cube.stiffening_strain.values[::-1]):
        case = cube.sel(
            n_stripe=n_stripe, n_subunit=n_subunit, stiffening_strain=stiffening
        ).mean_strain_xx.values
        name = "linear" if stiffening > 10 else f"$e_s$ = {stiffening:g}"
        axes.plot(strain, case, ".-", color=f"C{colour}", lw=1, ms=3, label=name)
        top = int(np.argmax(case))
        later = top + steps
        fall = f"{case[later] - case[top]:+.4f}" if later < len(case) else "not reached"
        end = int(np.searchsorted(strain, 0.54 - 1e-9))
        slope = (case[end] - case[end - 1]) / (strain[end] - strain[end - 1])
        law = "linear" if stiffening > 10 else f"{stiffening:g}"
        print(
            f"({n_stripe}, {n_subunit})  {law:6s} {case[top]:.4f} {strain[top]:.2f}"
            f"  {fall:12s} {slope:+.3f}"
        )
    axes.set(title=f"({n_stripe}, {n_subunit})", xlabel="applied strain")
    axes.title.set_fontsize(8)
    axes.axvline(0.54, color="0.8", lw=0.6)
figure.axes[0].set_ylabel("transverse strain")
figure.axes[0].legend(frameon=False, fontsize=6)
figure.savefig(asked.output, dpi=200)
