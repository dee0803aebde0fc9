"""The cube: all records along labelled dimensions, with what the figures and the report need."""

import json
import os
import platform
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from threadpoolctl import ThreadpoolController

from benchmarks.solver.methods import RESIDUAL_LEVELS
from knitlab.io.atomic_write import atomic_write

DIMS = {
    "task": "what was done: relaxation from the flat sheet, that and 15 load steps (tension),"
    " relaxation as a sweep does it, one iteration, a sweep over all the paper's designs, or"
    " tension of a batch of fabrics of one mesh shape",
    "solver": "method, or factorisation of one iteration",
    "boundary": "of the sample",
    "n_stripe": "stitches across a rib stripe",
    "n_subunit": "stitches along a garter stripe",
    "size": "unit cells of the sample along y x along x; of a sweep, its set of designs",
    "workers": "worker processes of a sweep, threads of anything else",
    "repeat": "which of the repeats",
}
TRIAL_DIMS = ("solver", "size", "setting")
COST = {
    "seconds": (
        "s",
        "processor time of a search on one thread, compilation apart; wall time of one on two"
        " threads, of a sweep, of a batch and of one iteration; missing where the tolerance was"
        " not reached",
    ),
    "compile_seconds": ("s", "time to compile, before the watch started"),
    "residual": ("N", "largest force left on a free unknown; of one iteration, of its solution"),
    "time_limit": ("s", "processor time after which a search is given up"),
    "given_up_after": ("s", "processor time after which it was, which is no time to the tolerance"),
    "states": ("1", "states reached, of the 16 of a tension test"),
    "evaluations": ("1", "evaluations of energy and gradient"),
    "factorisations": ("1", "factorisations of the stiffness"),
    "energy": ("N mm", "elastic energy of the last state"),
    "peak_memory": ("B", "largest resident memory of the process, of a sweep of its largest"),
    "setting": ("1", "the method's number that tuning chose"),
    "symbolic_seconds": ("s", "plan of the factorisation, made once for a sparsity"),
    "hessian_seconds": ("s", "element Hessians and their assembly"),
    "factorise_seconds": ("s", "numeric factorisation; SuperLU's with its symbolic one"),
    "solve_seconds": ("s", "one solution with the factors"),
    "evaluation_seconds": ("s", "one evaluation of energy and gradient"),
    "evaluating_seconds": ("s", "wall time of all evaluations of a search"),
    "assembling_seconds": ("s", "wall time of all its assemblies, element Hessians included"),
    "factorising_seconds": ("s", "wall time of all its factorisations"),
    "solving_seconds": ("s", "wall time of all its solutions"),
    "subdomains_seconds": ("s", "wall time of its subdomains"),
}
SAMPLE_DIMS = ("boundary", "n_stripe", "n_subunit", "size")
COMPARED_TO = "knitlab"
NOT_MEASURED, REACHED, NOT_REACHED = -1, 0, 1
LIBRARIES = [
    "jax",
    "jaxlib",
    "diffrax",
    "equinox",
    "numpy",
    "scipy",
    "xarray",
    "netCDF4",
    "cvxopt",
    "numba",
    "warp-lang",
    "mkl",
    "pypardiso",
]


def gathered(results: Path) -> xr.Dataset:
    """The cube of all records in a results folder.

    Raises:
        FileNotFoundError: if there is none.
    """
    records = [json.loads(path.read_text()) for path in sorted(results.glob("records/*.json"))]
    if not records:
        raise FileNotFoundError(f"no records in {results}; run the benchmark first")
    return cube_of(records).assign_attrs(
        machine()
        | {
            "git_commit": " ".join(sorted({record["git_commit"] for record in records})),
            "date": max(record["date"] for record in records),
            "cpu_model": _listed(record["cpu_model"] for record in records),
            "blas_kernels": _listed(record["blas_kernels"] for record in records),
            "devices_of_batches": _listed(
                record["device"] for record in records if "device" in record
            ),
        }
    )


def _listed(values: Iterable[str]) -> str:
    return "; ".join(sorted(set(values)))


def cube_of(records: list[dict[str, Any]]) -> xr.Dataset:
    """A cube of records. Where two differ in the setting alone, the later one counts."""
    frame = pd.DataFrame(records).sort_values("date")
    trials = frame[frame["task"] == "tuning"].drop_duplicates([*TRIAL_DIMS], keep="last")
    frame = frame[frame["task"] != "tuning"].drop_duplicates([*DIMS], keep="last")
    parts = []
    if len(frame):
        parts.append(_costs(frame))
    if len(trials):
        parts.append(_trials(trials))
    cube = xr.merge(parts, join="outer", combine_attrs="override", compat="no_conflicts")
    if "status" in cube:
        cube["status"] = cube["status"].fillna(NOT_MEASURED).astype(np.int8)
    for name, words in DIMS.items():
        if name in cube.coords:
            cube[name].attrs |= {"long_name": words}
    return cube.assign_attrs(
        Conventions="CF-1.11", title="Benchmark of knitlab's solvers against others"
    )


def _trials(trials: pd.DataFrame) -> xr.Dataset:
    """What every setting cost on a small sample; missing where it did not reach the tolerance."""
    costs = trials.set_index([*TRIAL_DIMS]).sort_index()[["evaluations", "seconds"]].astype(float)
    costs = costs.where(costs["seconds"].notna())
    of = costs.to_xarray().rename(
        setting="trial_setting",
        size="trial_size",
        evaluations="trial_evaluations",
        seconds="trial_seconds",
    )
    of["trial_evaluations"].attrs = {
        "units": "1",
        "long_name": "evaluations of energy and gradient to relax, by the setting that is tried",
    }
    of["trial_seconds"].attrs = {
        "units": "s",
        "long_name": "processor time to relax, by the setting that is tried",
    }
    of["trial_setting"].attrs = {
        "long_name": "damping ratio of the dynamics [1], initial time step of FIRE [sqrt(g mm/N)],"
        " steps that L-BFGS remembers",
    }
    of["trial_size"].attrs = {"long_name": "unit cells of the small sample along y x along x"}
    return of


def _costs(frame: pd.DataFrame) -> xr.Dataset:
    """What every measurement cost, its median, spread and ratios."""
    for name in (*COST, "nodes"):
        if name not in frame:
            frame[name] = np.nan
    indexed = frame.set_index([*DIMS])
    cube = indexed[list(COST)].astype(float).to_xarray()
    for name, (units, words) in COST.items():
        cube[name].attrs = {"units": units, "long_name": words}
    reached = indexed["reached"].map({True: REACHED, False: NOT_REACHED}).astype(float)
    cube["status"] = reached.to_xarray().fillna(NOT_MEASURED).astype(np.int8)
    cube["status"].attrs = {
        "long_name": "whether the tolerance was reached",
        "flag_values": np.array([NOT_MEASURED, REACHED, NOT_REACHED], np.int8),
        "flag_meanings": "not_measured reached not_reached",
    }
    samples = frame[frame["task"] != "sweep"].drop_duplicates([*SAMPLE_DIMS])
    nodes = samples.set_index([*SAMPLE_DIMS])["nodes"].astype(float).to_xarray()
    cube["nodes"] = nodes.assign_attrs(units="1", long_name="nodes of the sample")

    of_record = indexed["cpu_model"] + " " + indexed["blas_kernels"]
    models = sorted(set(of_record))
    measured_on = of_record.map({model: code for code, model in enumerate(models)})
    cube["measured_on"] = measured_on.to_xarray().fillna(NOT_MEASURED).astype(np.int8)
    cube["measured_on"].attrs = {
        "long_name": "processor that it was measured on, and kernels of its BLAS",
        "flag_values": np.arange(NOT_MEASURED, len(models), dtype=np.int8),
        "flag_meanings": " ".join(["none", *(model.replace(" ", "_") for model in models)]),
    }

    seconds = cube["seconds"]
    for name, value, words in (
        ("seconds_median", seconds.median("repeat"), "median time over repeats"),
        ("seconds_least", seconds.min("repeat"), "shortest time of the repeats"),
        ("seconds_most", seconds.max("repeat"), "longest time of the repeats"),
    ):
        cube[name] = value.assign_attrs(units="s", long_name=words)
    middle = cube["seconds_median"]
    if COMPARED_TO in middle["solver"]:
        machine_of = cube["measured_on"].max("repeat")
        same_machine = machine_of == machine_of.sel(solver=COMPARED_TO, drop=True)
        own = middle.sel(solver=COMPARED_TO, drop=True).where(same_machine)
        ratio = middle / own
        words = f"median time over that of {COMPARED_TO} for the same on the same machine"
        cube["times_slower"] = ratio.assign_attrs(units="1", long_name=words)
        least = cube["given_up_after"].max("repeat") / own
        words = f"time after which it was given up over the median time of {COMPARED_TO} there"
        cube["times_slower_at_least"] = least.assign_attrs(units="1", long_name=words)
    best = cube["factorise_seconds"].median("repeat").min("solver")
    words = "one iteration over the fastest numeric factorisation alone of the same matrix"
    cube["iteration_over_factorisation"] = (middle / best).assign_attrs(units="1", long_name=words)
    cube["slope"] = _slopes(cube)
    return _with_first_times(cube, frame)


def _slopes(cube: xr.Dataset) -> xr.DataArray:
    """The s of time ~ nodes^s, by least squares in logarithms over samples of one design."""

    def slope(seconds: np.ndarray, nodes: np.ndarray) -> float:
        stored = np.isfinite(seconds) & np.isfinite(nodes)
        if stored.sum() < 2:
            return np.nan
        return float(np.polyfit(np.log(nodes[stored]), np.log(seconds[stored]), 1)[0])

    return xr.apply_ufunc(
        slope,
        cube["seconds_median"],
        cube["nodes"],
        input_core_dims=[["size"], ["size"]],
        vectorize=True,
    ).assign_attrs(units="1", long_name="s of the fit: time ~ nodes^s")


def _with_first_times(cube: xr.Dataset, frame: pd.DataFrame) -> xr.Dataset:
    """When every residual was first reached in relaxation by one thread."""
    traced = frame[frame["task"] == "relaxation"]
    if "first_times" not in traced or not len(traced):
        return cube
    dims = ["solver", *SAMPLE_DIMS[1:], "repeat"]
    indexed = traced.set_index(dims)["first_times"]
    long = pd.DataFrame(
        indexed.tolist(), index=indexed.index, columns=pd.Index(RESIDUAL_LEVELS, name="level")
    )
    times = xr.DataArray.from_series(pd.Series(long.stack()).astype(float))
    cube["time_to_residual"] = times.assign_attrs(
        units="s",
        long_name="processor time until the residual first fell to a level, relaxing",
    )
    cube["level"].attrs = {"units": "N", "long_name": "largest force on a free unknown"}
    return cube


def cpu_model() -> str:
    """Name of this machine's processor."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor()


def blas_kernels() -> str:
    """Which kernels the OpenBLAS of this process runs.

    It chooses them for its processor as it is loaded, unless ``OPENBLAS_CORETYPE`` does.
    """
    loaded = ThreadpoolController().select(internal_api="openblas").info()
    return " ".join(sorted({library["architecture"] for library in loaded}))


def machine() -> dict[str, str | int]:
    """The machine and the libraries, as attributes."""
    return {
        "cpu_model": cpu_model(),
        "cpu_cores": os.cpu_count() or 0,
        "memory_bytes": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"),
        "operating_system": platform.platform(),
        "python_version": platform.python_version(),
        "library_versions": " ".join(f"{name}={_version(name)}" for name in LIBRARIES),
        "gathered": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"


def write_cube(cube: xr.Dataset, path: Path) -> None:
    """Replace the cube's file whole."""
    with atomic_write(path) as temporary:
        packed = {name: {"zlib": True} for name in cube.data_vars if cube[name].dtype.kind in "fi"}
        cube.to_netcdf(temporary, encoding=packed)


def read_cube(path: Path) -> xr.Dataset:
    """Read a cube into memory."""
    with xr.open_dataset(path, engine="netcdf4") as cube:
        return cube.load()


def report(cube: xr.Dataset) -> str:
    """Medians with their spread, ratios and what was not reached, as a table."""
    if "status" not in cube:
        return ""
    whole = cube[[name for name in _REPORTED if name in cube]]
    over_repeats = {name: cube[name].median("repeat") for name in _MEDIANS}
    over_repeats["status"] = cube["status"].max("repeat")
    table = whole.assign(over_repeats).to_dataframe().reset_index()
    table = table[table["status"] != NOT_MEASURED].dropna(axis="columns", how="all")
    table["status"] = table["status"].map({REACHED: "reached", NOT_REACHED: "not reached"})
    return table.to_string(index=False, na_rep="", float_format="{:.3g}".format)


_REPORTED = (
    "seconds_median",
    "seconds_least",
    "seconds_most",
    "times_slower",
    "times_slower_at_least",
    "iteration_over_factorisation",
    "slope",
)
_MEDIANS = (
    "residual",
    "evaluations",
    "factorisations",
    "symbolic_seconds",
    "factorise_seconds",
    "subdomains_seconds",
    "factorising_seconds",
    "solving_seconds",
    "evaluating_seconds",
    "assembling_seconds",
    "peak_memory",
)
