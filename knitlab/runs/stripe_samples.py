"""Samples of uncertain stripes, as the paired settings of a workflow."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag
from scipy.stats import norm, qmc

from knitlab.cubes.probability import chi_scale
from knitlab.cubes.uncertainty import matrix_root
from knitlab.io.errors import invalid
from knitlab.io.toml import read_toml, write_toml
from knitlab.model.stripe import GARTER_STITCHES_PER_RIB_STITCH, Knit
from knitlab.model.stripe_covariance import Subject
from knitlab.runs.material import SCALED, Material, with_material_file
from knitlab.runs.parameters import defaults
from knitlab.runs.stripe_covariance import MEANING, stripe_covariance, uncertain_subject
from knitlab.runs.workflow import SETTINGS
from knitlab.runs.workflow_file import workflow_file
from knitlab.runs.workflow_text import PAIRED, read_workflow

MIN_FREEDOM = 2.0  # degrees of freedom below which samples are too far apart to be simulated


def student_hypercube(
    count: int, numbers: Sequence[int], freedoms: Sequence[float], seed: int
) -> Float[np.ndarray, "sample number"]:
    """A Latin hypercube of the numbers of stripes, each multivariate t with its freedom."""
    finite = [freedom for freedom in freedoms if math.isfinite(freedom)]
    uniform = qmc.LatinHypercube(sum(numbers) + len(finite), rng=seed).random(count)
    normal, of_scales = np.split(uniform, [sum(numbers)], axis=1)
    columns = iter(of_scales.T)
    scales = [
        chi_scale(next(columns), freedom) if math.isfinite(freedom) else np.ones(count)
        for freedom in freedoms
    ]
    return norm.ppf(normal) * np.repeat(scales, numbers, axis=0).T


def saltelli(count: int, numbers: int, seed: int) -> Float[np.ndarray, "sample number"]:
    """Independent normal numbers: A, B, and A with each column of B, ``count`` rows each."""
    both = norm.ppf(qmc.Sobol(2 * numbers, rng=seed).random(count))
    a, b = both[:, :numbers], both[:, numbers:]
    exchanged = [np.where(np.arange(numbers) == column, b, a) for column in range(numbers)]
    return np.concatenate([a, b, *exchanged])


def sampled_numbers(
    material: Material, n_stripe: int, count: int, seed: int, sobol: bool, subject: Subject
) -> dict[str, list[float]]:
    """Samples of the stripe numbers of designs with this ``n_stripe``, by setting."""
    knits: tuple[tuple[Knit, int], ...]
    knits = ("rib", n_stripe), ("garter", GARTER_STITCHES_PER_RIB_STITCH * n_stripe)
    names, middles, matrices, freedoms = list[str](), list[float](), [], []
    for knit, n in knits:
        stripe, own, matrix, freedom = stripe_covariance(material, knit, n, subject)
        if freedom < MIN_FREEDOM:
            message = f"has {freedom:g} degrees of freedom, whose samples have no bounds"
            hint = f"calibrate {math.ceil(MIN_FREEDOM) + 1} repeats or more"
            raise invalid(f"material {material.name}: {knit} {n}: covariance", f"{message}; {hint}")
        names += [f"{knit}_{name}" for name in own]
        middles += [getattr(stripe, name) for name in own]
        matrices.append(matrix)
        freedoms.append(freedom)
    if sobol:
        roots = [np.diag(np.sqrt(np.diag(matrix))) for matrix in matrices]
        deviates = saltelli(count, len(names), seed)
    else:
        roots = [matrix_root(matrix) for matrix in matrices]
        deviates = student_hypercube(count, [len(each) for each in matrices], freedoms, seed)
    changes = deviates @ block_diag(*roots).T
    return {
        name: (middle + change if name.endswith("theta_0") else middle * np.exp(change)).tolist()
        for name, middle, change in zip(names, middles, changes.T, strict=True)
    }


def write_samples(
    material: Path,
    output: Path,
    n_stripe: int,
    count: int,
    workflow: str,
    seed: int,
    sobol: bool,
    subject: str | None,
) -> None:
    """Write a workflow that samples a material."""
    if count < 2 or (sobol and count & (count - 1)):
        needed = "a power of 2, for Sobol indices" if sobol else "at least 2"
        raise invalid(f"samples {count}", f"is not {needed}; give {needed}")
    base = workflow_file(workflow)
    table: dict[str, Any] = read_toml(base)
    read = Material.read(material)
    chosen = uncertain_subject(read, subject)
    numbers = sampled_numbers(read, n_stripe, count, seed, sobol, chosen)
    if "design" not in table:
        raise invalid(workflow, "has no designs, but pure stripes; name one with [design]")
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
    # Perturbed copies would add their own changes of the same numbers.
    table.setdefault("protocol", {})["robustness"] = 0
    title = f"Samples of {MEANING[chosen]} of {material.name}: {table.get('title', base.stem)}"
    table |= {"title": title, "figures": []}
    table[PAIRED] = numbers
    write_toml(output, table)
