"""What this machine offers, and whether it computes right: a report to paste."""

import os
import platform
import shutil
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from packaging.requirements import Requirement

from knitlab.io import job_limits
from knitlab.io.atomic_write import can_write_into
from knitlab.io.provenance import MODEL, git_commit
from knitlab.io.shipped import PACKAGE

OPTIONAL = ("design", "knitting")  # extras that users install
VARIABLES = ("CUDA_", "HDF5_", "JAX_", "MKL_", "OMP_", "OPENBLAS_", "PJRT_", "SLURM_CPUS", "XLA_")
"""Beginnings of the names of environment variables that change how simulations run."""
WORKFLOW, DESIGN = "preview", ("n_stripe=4", "n_subunit=16", "strain_max=0.06")
KEPT = {
    "poisson_ratio": np.array([-0.24045752467097978, -0.327085660473918]),
    "reaction_force": np.array([0.4908221496168516, 0.6575205907205512]),
}
"""ν and force [N] of this design at 3 and 6 % in ``results/reference/preview/cube.nc``."""
TOLERANCE = 1e-3  # largest relative difference; other processors have differed by 2e-4


@dataclass(frozen=True)
class Finding:
    """One line of the report."""

    name: str
    text: str
    problem: str = ""  # and its remedy


def doctor(
    *,
    results: str | Path = "results",
    simulate: bool = True,
    report: Callable[[str], None] = print,
) -> bool:
    """Report versions, devices, limits and folders, and simulate one design with a known result.

    Args:
        results: folder that is tried for results.
        simulate: whether to simulate, in a process of its own; it takes some 20 s.
        report: called with each line of the report.

    Returns:
        Whether nothing is wrong.

    Example:
        >>> kl.doctor(simulate=False)  # doctest: +SKIP
        knitlab     0.1.0, model 1, commit 44e5e7c3
        …
        True
    """
    problems = 0
    for finding in _findings(Path(results), simulate):
        report(_wrapped(f"{finding.name:11} {finding.text}"))
        if finding.problem:
            report(_wrapped(f"{'':11} PROBLEM: {finding.problem}"))
            problems += 1
    report(f"problems    {problems or 'none'}")
    return not problems


def _wrapped(text: str) -> str:
    indent = " " * 12
    return textwrap.fill(text, 100, subsequent_indent=indent, break_on_hyphens=False)


def _findings(results: Path, simulate: bool) -> Iterator[Finding]:
    yield Finding("knitlab", f"{version('knitlab')}, {MODEL}, commit {git_commit()}, in {PACKAGE}")
    yield Finding("Python", f"{platform.python_version()} on {platform.platform()}")
    yield from _libraries()
    yield _limits()
    yield _jax()
    yield _folder(results)
    yield _compiled_programs()
    names = [name for name in sorted(os.environ) if name.startswith(VARIABLES)]
    variables = " ".join(f"{name}={os.environ[name]}" for name in names)
    yield Finding("variables", variables or "none that change a simulation")
    if simulate:
        yield _simulation()


def _libraries() -> Iterator[Finding]:
    """Installed versions of what knitlab requires, and of what its extras do."""
    for extra in ("", *OPTIONAL):
        found, wrong = [], []
        for requirement in map(Requirement, requires("knitlab") or ()):
            marker = requirement.marker
            is_optional = marker is not None and "extra" in str(marker)
            if is_optional != bool(extra) or (marker and not marker.evaluate({"extra": extra})):
                continue
            try:
                installed = version(requirement.name)
            except PackageNotFoundError:
                installed = "missing"
            found.append(f"{requirement.name} {installed}")
            if installed == "missing" or not requirement.specifier.contains(installed, True):
                wrong.append(f"{requirement.name} {requirement.specifier}")
        command = " ".join(f'"{each}"' for each in wrong)
        hint = f"python -m pip install {command}" if wrong else ""
        if extra:
            is_missing = f"; for what is missing: {hint}" if wrong else ""
            yield Finding(f"[{extra}]", (", ".join(found) or "nothing here") + is_missing)
        else:
            yield Finding("libraries", ", ".join(found), hint and f"out of bounds: {hint}")


def _limits() -> Finding:
    import psutil

    ours, all_of_it = job_limits.memory(), psutil.virtual_memory()
    return Finding(
        "this job",
        f"{job_limits.processors()} of {os.cpu_count()} processors,"
        f" {ours / 1e9:.1f} of {all_of_it.total / 1e9:.1f} GB of memory,"
        f" {all_of_it.available / 1e9:.1f} GB free",
    )


def _jax() -> Finding:
    try:
        import jax

        from knitlab.model.computing import computing

        own = jax.config.read("jax_enable_x64")
        with computing():
            devices = ", ".join(map(str, jax.devices()))
            precision = jax.numpy.zeros(()).dtype
    except Exception as error:  # whatever JAX raises, the report goes on
        return Finding("JAX", "cannot be used", f"{error}")
    text = f"{devices}; knitlab computes in {precision}, outside it JAX's x64 is {own}"
    wrong = "" if precision == "float64" else "not in double precision; install JAX again"
    return Finding("JAX", text, wrong)


def _folder(folder: Path) -> Finding:
    existing = next(each for each in (folder.resolve(), *folder.resolve().parents) if each.exists())
    if not (existing.is_dir() and os.access(existing, os.W_OK)):
        return Finding("results", f"{folder.resolve()}", "cannot be written; choose another folder")
    free = shutil.disk_usage(existing).free / 1e9
    return Finding("results", f"{folder.resolve()} can be written, {free:.1f} GB free")


def _compiled_programs() -> Finding:
    from platformdirs import user_cache_path

    own = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    folder = Path(own) if own else user_cache_path("knitlab")
    kept = "" if can_write_into(folder) else ", cannot be written: every run compiles again"
    return Finding("compiled", f"{folder}{kept}")


def _simulation() -> Finding:
    """One design of the preview, in a worker: a crash of a library ends only that process."""
    try:
        from knitlab.runs.plan import make_plan
        from knitlab.runs.run import run_plan
        from knitlab.runs.run_options import RunOptions

        plan = make_plan(WORKFLOW, DESIGN)
        (case,) = plan.cases.values()
        with TemporaryDirectory() as folder:
            run = run_plan(plan, Path(folder), RunOptions(workers=1))
    except Exception as error:  # whatever is wrong with a library, the report goes on
        return Finding("simulation", "ended with an error", f"{type(error).__name__}: {error}")
    text = f"{case.label} of {WORKFLOW}"
    if run.failures:
        return Finding("simulation", text, run.failures[0]["reason"])
    pulled = run.cube.squeeze().isel(applied_strain=slice(1, None))
    errors = [np.abs(pulled[name].values / kept - 1).max() for name, kept in KEPT.items()]
    text += ": ν differs by {:.0e}, force by {:.0e} of the kept results".format(*errors)
    if max(errors) < TOLERANCE:
        return Finding("simulation", text)
    hint = "JAX computes wrong here; install another version of it, and report this"
    return Finding("simulation", text, hint)
