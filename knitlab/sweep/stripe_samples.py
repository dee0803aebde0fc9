"""Samples of uncertain stripes, as the paired settings of a workflow."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag
from scipy.stats import norm, qmc

from knitlab.fabric.stripe import GARTER_STITCHES_PER_RIB_STITCH, Knit
from knitlab.io.errors import fault
from knitlab.io.toml import read_toml, write_toml
from knitlab.sweep.material import SCALED, Material, with_material_file
from knitlab.sweep.parameters import defaults
from knitlab.sweep.stripe_covariance import covariance_of
from knitlab.sweep.workflow import SETTINGS
from knitlab.sweep.workflow_file import workflow_file
from knitlab.sweep.workflow_text import PAIRED, read_workflow


def latin_hypercube(count: int, numbers: int, seed: int) -> Float[np.ndarray, "sample number"]:
    """Independent normal numbers, each of which has one in every of ``count`` equal quantiles."""
    return norm.ppf(qmc.LatinHypercube(numbers, rng=seed).random(count))


def saltelli(count: int, numbers: int, seed: int) -> Float[np.ndarray, "sample number"]:
    """Independent normal numbers: A, B, and A with each column of B, ``count`` rows each."""
    both = norm.ppf(qmc.Sobol(2 * numbers, rng=seed).random(count))
    a, b = both[:, :numbers], both[:, numbers:]
    exchanged = [np.where(np.arange(numbers) == column, b, a) for column in range(numbers)]
    return np.concatenate([a, b, *exchanged])


def sampled_numbers(
    material: Material, n_stripe: int, count: int, seed: int, sobol: bool
) -> dict[str, list[float]]:
    """Samples of the stripe numbers of designs with this ``n_stripe``, by setting."""
    knits: tuple[tuple[Knit, int], ...]
    knits = ("rib", n_stripe), ("garter", GARTER_STITCHES_PER_RIB_STITCH * n_stripe)
    names, middles, matrices = list[str](), list[float](), []
    for knit, n in knits:
        stripe, own, matrix = covariance_of(material, knit, n)
        names += [f"{knit}_{name}" for name in own]
        middles += [getattr(stripe, name) for name in own]
        matrices.append(matrix)
    covariance = block_diag(*matrices)
    if sobol:
        root = np.diag(np.sqrt(np.diag(covariance)))
        deviates = saltelli(count, len(names), seed)
    else:
        variances, directions = np.linalg.eigh(covariance)
        root = directions * np.sqrt(np.maximum(variances, 0))
        deviates = latin_hypercube(count, len(names), seed)
    changes = deviates @ root.T
    return {
        name: (middle + change if name.endswith("theta_0") else middle * np.exp(change)).tolist()
        for name, middle, change in zip(names, middles, changes.T, strict=True)
    }


def write_samples(
    material: Path, output: Path, n_stripe: int, count: int, workflow: str, seed: int, sobol: bool
) -> int:
    """Write a workflow that samples a material; returns the number of samples."""
    if count < 2 or (sobol and count & (count - 1)):
        needed = "a power of 2, for Sobol indices" if sobol else "at least 2"
        raise fault(f"samples {count}", f"is not {needed}; give {needed}")
    base = workflow_file(workflow)
    table: dict[str, Any] = read_toml(base)
    numbers = sampled_numbers(Material.read(material), n_stripe, count, seed, sobol)
    if "design" not in table:
        raise fault(workflow, "has no designs, but pure stripes; name one with [design]")
    # Lengths of the workflow are those of the paper's yarn.
    text = read_workflow(base, {"material": str(material)})
    _, scaled = with_material_file(material, defaults(), text)
    for name in SCALED:
        section = SETTINGS[name].section
        if name in table.get(section, {}):
            table[section][name] = [*scaled.axes.get(name, ())] or scaled.table[section][name]
    table["design"]["n_stripe"] = [n_stripe]
    if files := table["design"].get("pattern_files"):
        table["design"]["pattern_files"] = [str((base.parent / file).resolve()) for file in files]
    table.setdefault("model", {})["material"] = str(material.resolve())
    # Siblings would add their own changes of the same numbers.
    table.setdefault("protocol", {})["robustness"] = 0
    table |= {
        "title": f"Samples of {material.name}: {table.get('title', base.stem)}",
        "figures": [],
    }
    table[PAIRED] = numbers
    write_toml(output, table)
    return len(next(iter(numbers.values())))
