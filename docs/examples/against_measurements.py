"""Poisson's ratio of acrylic swatches, measured beside computed.

python docs/examples/against_measurements.py results/swatches_across results/swatches_along

prints the tables of docs/explanation/against_measurements.md; ``-o FILE`` also draws the figure.
The folders are those of ``knitlab run swatches_across`` and ``knitlab run swatches_along``.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

SWATCHES = Path(__file__).parent / "swatches"
FORCE_STRAINS = (0.05, 0.1, 0.2, 0.3, 0.5)
NAMES = ("rib_across", "garter_across", "garter_along", "rib_along")
SAMPLES = {"10mm": "period 10 mm", "5mm": "period 5 mm", "long": "long sample"}
"""Simulated samples of a swatch, by the end of their pattern's name."""


def width_at_mid_height(positions: np.ndarray) -> np.ndarray:
    """Distance of the left and the right edge at mid-height, seen from above [mm].

    Args:
        positions: of the nodes, with axes (..., node_y, node_x, component) [mm].
    """
    rows = positions.shape[-3]
    # With an even number of rows mid-height lies between two of them.
    middle = positions[..., [(rows - 1) // 2, rows // 2], :, :2].mean(axis=-3)
    return np.linalg.norm(middle[..., -1, :] - middle[..., 0, :], axis=-1)


def clamp_distance(positions: np.ndarray) -> np.ndarray:
    """Distance of the clamps, the first and the last row of nodes, along y [mm].

    Args:
        positions: as for :func:`width_at_mid_height`.
    """
    heights = positions[..., 1].mean(axis=-1)
    return heights[..., -1] - heights[..., 0]


def poisson_ratio(positions: np.ndarray) -> np.ndarray:
    """Minus the strain of the width at mid-height over the strain between the clamps [1].

    Args:
        positions: with axes (state, node_y, node_x, component), the relaxed state first [mm].

    Returns:
        The ratio at every state after the first.
    """
    width, height = width_at_mid_height(positions), clamp_distance(positions)
    return -(width[1:] / width[0] - 1) / (height[1:] / height[0] - 1)


def read_cases(folders: Sequence[Path]) -> dict[str, xr.Dataset]:
    """The case of each pattern, from the files that the cubes of some results folders name."""
    cases = {}
    for folder in folders:
        with xr.open_dataset(folder / "cube.nc", engine="netcdf4") as cube:
            for pattern, name in zip(cube.pattern.values, cube.case_id.values.ravel(), strict=True):
                with xr.open_dataset(folder / "cases" / f"{name}.nc", engine="netcdf4") as case:
                    cases[str(pattern)] = case.load()
    return cases


def positions_of(case: xr.Dataset) -> np.ndarray:
    """Positions of a case, with axes (applied_strain, node_y, node_x, component) [mm]."""
    return case.position.transpose("applied_strain", "node_y", "node_x", "component").values


def computed(cases: Mapping[str, xr.Dataset], swatch: str, sample: str) -> pd.Series | None:
    """Poisson's ratio of a sample by applied strain; None if there is no such sample."""
    case = cases.get(f"{swatch}_{sample}")
    if case is None:
        return None
    return pd.Series(poisson_ratio(positions_of(case)), case.applied_strain.values[1:].round(6))


def measured(swatch: str) -> pd.DataFrame:
    """Mean and standard deviation of the measured Poisson's ratio, by strain."""
    return _of_swatch("poisson_ratio.csv", swatch).set_index("strain [1]")


def size_of(swatch: str) -> pd.Series:
    """The measured sizes of a swatch [mm], and its force at a strain of 0.5 [N]."""
    return _of_swatch("sizes.csv", swatch).iloc[0]


def _of_swatch(file: str, swatch: str) -> pd.DataFrame:
    table = pd.read_csv(SWATCHES / file, comment="#")
    knit, direction = swatch.split("_")
    return table.loc[(table.swatch == knit) & (table.pulled == f"{direction} ridges")]


def signed(number: float, digits: int) -> str:
    """A number with its sign, a minus in print."""
    return f"{number:+.{digits}f}".replace("-", "−")


def ratio_table(
    cases: Mapping[str, xr.Dataset], swatches: Sequence[str], samples: Sequence[str]
) -> list[str]:
    """Poisson's ratios of some swatches, measured beside computed, as a table in Markdown.

    Args:
        cases: the simulated samples, by pattern.
        swatches: the swatches, for which groups of columns stand side by side.
        samples: the samples of each, keys of :data:`SAMPLES`.
    """
    heads = ["strain"]
    columns: dict[float, list[str]] = {}
    for swatch in swatches:
        name = swatch.replace("_", " ")
        heads += [f"{name}: measured", *(SAMPLES[sample] for sample in samples)]
        found = [computed(cases, swatch, sample) for sample in samples]
        for label, row in measured(swatch).iterrows():
            strain = float(str(label))
            own = signed(row["poisson_ratio [1]"], 2)
            own += f" ± {row['standard_deviation [1]']:.2f}"
            cells = [own, *(signed(its[strain], 3) for its in found if its is not None)]
            columns.setdefault(strain, []).extend(cells)
    filled = [
        [f"{strain:.2f}", *cells, *[""] * (len(heads) - 1 - len(cells))]
        for strain, cells in columns.items()
    ]
    return ["| " + " | ".join(line) + " |" for line in (heads, ["---"] * len(heads), *filled)]


def tables(cases: Mapping[str, xr.Dataset]) -> list[list[str]]:
    """The tables of the page, each as its lines."""
    return [
        ratio_table(cases, ("rib_across", "garter_across"), ("10mm", "5mm")),
        ratio_table(cases, ("garter_along", "rib_along"), tuple(SAMPLES)),
        force_table(cases),
    ]


def force_table(cases: Mapping[str, xr.Dataset]) -> list[str]:
    """Forces on whole swatches, measured beside computed, in Markdown.

    A computed force is that over the width of the sample, times the width of the swatch between its
    pins, for which the stripes were calibrated.
    """
    heads = ["swatch, pulled", "width over clamp distance: measured", "simulated"]
    heads += [f"force [N] at {strain:.0%}: measured, computed" for strain in FORCE_STRAINS]
    lines = [heads, ["---"] * len(heads)]
    for swatch in NAMES:
        case = cases[f"{swatch}_10mm"]
        positions, size = positions_of(case)[0], size_of(swatch)
        width = size["pin_width [mm]"]
        aspect = width / size["clamp_distance [mm]"]
        own = width_at_mid_height(positions) / clamp_distance(positions)
        over_width = case.reaction_force / width_at_mid_height(positions)
        force = width * over_width.sel(applied_strain=[*FORCE_STRAINS], method="nearest").values
        pairs = zip(measured_force(swatch), force, strict=True)
        cells = [f"{mean:.2f} ± {spread:.2f}, {found:.2f}" for (mean, spread), found in pairs]
        lines.append([swatch.replace("_", " "), f"{aspect:.2f}", f"{own:.2f}", *cells])
    return ["| " + " | ".join(line) + " |" for line in lines]


def measured_force(swatch: str) -> list[tuple[float, float]]:
    """Mean and standard deviation over the repeats of a record, at :data:`FORCE_STRAINS` [N]."""
    record = pd.read_csv(
        SWATCHES / "records" / f"{swatch.removesuffix('_across')}.csv", comment="#"
    )
    curves = []
    for _, repeat in record.groupby("repeat [1]"):
        ordered = repeat.sort_values("axial strain [1]")
        curves.append(np.interp(FORCE_STRAINS, ordered["axial strain [1]"], ordered["force [N]"]))
    return list(zip(np.mean(curves, axis=0), np.std(curves, axis=0, ddof=1), strict=True))


def figure_of(cases: Mapping[str, xr.Dataset]) -> Figure:
    """Measured ratios with their standard deviation beside computed ones, a panel a swatch."""
    figure = Figure(figsize=(7.2, 5.2), layout="constrained")
    panels = figure.subplots(2, 2, sharey=True)
    for axes, swatch in zip(panels.flat, NAMES, strict=True):
        own = measured(swatch)
        axes.axhline(0, color="0.8", lw=0.8)
        axes.errorbar(
            own.index,
            own["poisson_ratio [1]"],
            own["standard_deviation [1]"],
            fmt="o",
            color="black",
            ms=4,
            lw=1,
            capsize=2,
            label="measured, ± standard deviation",
        )
        styles = ("-", "C0", "s"), ("--", "C1", "^"), (":", "C2", "d")
        for (sample, label), (line, colour, marker) in zip(SAMPLES.items(), styles, strict=True):
            found = computed(cases, swatch, sample)
            if found is not None:
                found = found[found.index <= own.index.max()]
                style = {"ls": line, "color": colour, "marker": marker, "ms": 3, "lw": 1.2}
                axes.plot(found, label=f"computed, {label}", **style)
        axes.set_title(swatch.replace("_", ", ") + " ridges", fontsize=10)
        axes.set_xlim(0)
        axes.set_xlabel("strain between the clamps [1]")
    for axes in panels[:, 0]:
        axes.set_ylabel("Poisson's ratio [1]")
    handles, labels = panels[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return figure


def main() -> None:
    """Print the tables of the page; draw its figure if a file is given."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, nargs="+")
    parser.add_argument("-o", "--output", type=Path)
    asked = parser.parse_args()
    cases = read_cases(asked.results)
    print("\n\n".join("\n".join(lines) for lines in tables(cases)))
    if asked.output is not None:
        figure_of(cases).savefig(asked.output, dpi=160)


if __name__ == "__main__":
    main()
