"""Marks on what not to rely on: states and designs, each with its sign and the reason.

Tables and figures show the marks of :func:`marks_of`. The rules and what they were measured on are
in ``docs/explanation/trust.md``.
"""

import re
from collections.abc import Iterable
from functools import cache, reduce
from operator import or_
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from knitlab.cubes.cube_file import is_measured, parameters_of
from knitlab.cubes.force_control import FORCES
from knitlab.cubes.strain_window import reduced_columns, reduced_windows
from knitlab.io.shipped import shipped
from knitlab.io.toml import read_toml
from knitlab.observables.capacitors import CAPACITORS, CAPACITORS_UNLOADING
from knitlab.observables.schema import STRAIN, VARIABLES


class Mark(NamedTuple):
    """A sign, and the reason not to rely on what has it."""

    sign: str
    reason: str

    def __str__(self) -> str:
        return f"{self.sign} {self.reason}"


MARKS = {
    "intersecting": Mark("†", "the fabric passes through itself here; real fabric cannot"),
    "snapped": Mark("§", "the fabric has snapped before this strain"),
    "moving": Mark(
        "¶", "not settled yet: it would change if it relaxed longer or was pulled more slowly"
    ),
    "contrary": Mark("*", "auxetic here, and not in the paper: do not rely on this design"),
}
COLUMN = "marks"  # of a table
PREFIX = "doubt_"  # of the variables that hold the marks until a cube is sliced
STILL_RELEASED = 100.0  # elastic energy that relaxing still releases, over the kinetic energy left
SMALL_RELEASE = 0.05  # part of the elastic energy of the pull that does not change a state
ARRIVED = 0.5  # part of the applied strain in the central cells once the pull has reached them
AT_MINIMUM = {"poisson_ratio_min", "applied_strain_at_min", "intersections_at_min"}
SENSING = ("applied_strain_opened", "sensing_end")
ROUND_OFF = 1e-9  # of an applied strain


def with_doubts(cube: xr.Dataset) -> xr.Dataset:
    """The cube with a variable for each of :data:`MARKS`: 1 where its states or designs have it."""
    if is_measured(cube) or any(f"{PREFIX}{name}" in cube for name in MARKS):
        return cube
    found: dict[str, xr.DataArray] = {}
    if "self_intersections" in cube:
        found["intersecting"] = cube["self_intersections"] > 0
    if "snapped" in cube and STRAIN in cube["snapped"].dims:
        found["snapped"] = (cube["snapped"] == 1).cumsum(STRAIN) > 0
    if (moving := _moving(cube)) is not None:
        found["moving"] = moving
    if "poisson_ratio_min" in cube and {"n_stripe", "n_subunit"} <= set(cube.coords):
        lowest = cube["poisson_ratio_min"]
        if "poisson_ratio" in cube and STRAIN in cube["poisson_ratio"].dims:
            # That of a test which did not converge at all strains is missing.
            lowest = lowest.fillna(cube["poisson_ratio"].min(STRAIN))
        found["contrary"] = _not_auxetic_in_the_paper(cube) & (lowest < 0)
    return cube.assign({f"{PREFIX}{name}": each.astype(float) for name, each in found.items()})


def marked(
    cube: xr.Dataset, names: Iterable[str], each_strain: bool = False
) -> dict[str, xr.DataArray]:
    """For each of :data:`MARKS`, the designs that have it at the states that some columns show.

    Of a window its strains count, of the lowest Poisson's ratio its strain, of a capacitor the
    range of sensing. If the strain is selected, or with ``each_strain``, that state counts.
    """
    cube = with_doubts(cube)
    doubts = {name: cube[f"{PREFIX}{name}"] > 0 for name in MARKS if f"{PREFIX}{name}" in cube}
    if each_strain or STRAIN not in cube.dims:
        return doubts
    used = _states(cube, list(names))
    return {
        name: (each & used).any(STRAIN) if STRAIN in each.dims else each
        for name, each in doubts.items()
    }


def marks_of(cube: xr.Dataset, names: Iterable[str], each_strain: bool = False) -> xr.DataArray:
    """The signs of the marks of designs as texts; the arguments are those of :func:`marked`."""
    signs: xr.DataArray = xr.full_like(cube["status"], "", object).drop_attrs()
    for name, where in marked(cube, names, each_strain).items():
        signs = signs + xr.where(where, MARKS[name].sign, "").astype(object)
    return signs.rename(COLUMN)


def marks_of_rows(cube: xr.Dataset, table: pd.DataFrame) -> list[str]:
    """The marks of the states in a table, whose rows name them by the dimensions of the cube."""
    signs = marks_of(cube, (), each_strain=True)
    rows = pd.MultiIndex.from_frame(table[list(signs.dims)])
    return [str(sign) for sign in signs.to_series().reindex(rows, fill_value="")]


def with_marks_only(cube: xr.Dataset) -> xr.Dataset:
    """The variables of a cube that its marks need, and those by which it is selected."""
    names = [f"{PREFIX}{name}" for name in MARKS]
    names += ["status", "applied_strain_at_min", *SENSING, *FORCES, STRAIN]
    cube = with_doubts(cube)
    return cube.drop_vars([name for name in cube.data_vars if name not in names])


def legend(marks: Iterable[str]) -> list[str]:
    """The lines that explain the signs of some marks."""
    shown = set("".join(marks))
    return [str(mark) for mark in MARKS.values() if mark.sign in shown]


def pulled_without_pause(cube: xr.Dataset) -> xr.DataArray:
    """Whether tests are motions that were stopped after some steps or a time, not at rest."""
    dynamics = parameters_of(cube).get("dynamics") or {}
    settings = {"method": cube.attrs.get("method", ""), "ending": dynamics.get("ending", "")}
    method, ending = (
        cube[name] if name in cube.coords else xr.DataArray(value)
        for name, value in settings.items()
    )
    return (method == "dynamics") & (ending != "rest")


def _moving(cube: xr.Dataset) -> xr.DataArray | None:
    """Where a test that is pulled without pause has not settled; None if that is not known."""
    pulled = pulled_without_pause(cube)
    if STRAIN not in cube.dims or not pulled.any():
        return None
    strain = cube[STRAIN]
    causes = list[xr.DataArray]()
    needed = {"kinetic_energy_left", "kinetic_energy_peak", "energy_stretch", "energy_fold"}
    if needed <= set(cube) and strain[0] == 0:
        names = [name for name in ("energy_wall", "energy_contact") if name in cube]
        further = sum(cube[name].fillna(0) for name in names)
        elastic = cube["energy_stretch"] + cube["energy_fold"] + further
        gained = elastic - elastic.isel({STRAIN: 0}, drop=True)
        peak = cube["kinetic_energy_peak"].isel({STRAIN: 0}, drop=True)
        left = cube["kinetic_energy_left"] * peak
        # The relaxation had not ended when the pull began.
        causes.append(STILL_RELEASED * left > SMALL_RELEASE * gained)
    if "mean_strain_yy" in cube and "load_direction" not in cube:
        # The pull has not yet reached the central cells.
        causes.append(cube["mean_strain_yy"] < ARRIVED * strain)
    if not causes:
        return None
    return pulled & (strain > 0) & reduce(or_, causes)


def _not_auxetic_in_the_paper(cube: xr.Dataset) -> xr.DataArray:
    """Whether the paper states that a design is not auxetic."""
    n_stripe, n_subunit = cube["n_stripe"], cube["n_subunit"]
    found = xr.zeros_like(cube["status"], bool)
    for claim in _claims():
        ratio = claim.get("of") in ("poisson_ratio", "poisson_ratio_min")
        about = claim.get("about", {}) if ratio and claim.get("lowest") == 0 else {}
        for narrow in about.get("n_stripe", ()):
            found = found | (n_stripe == narrow)
        for first, second in about.get("designs", ()):
            found = found | ((n_stripe == first) & (n_subunit == second))
    return found


@cache
def _claims() -> list[dict[str, Any]]:
    return list(read_toml(shipped("params") / "claims.toml").values())


def _states(cube: xr.Dataset, names: Iterable[str]) -> xr.DataArray:
    """Whether columns show a state, along designs and strain; see :func:`marked`."""
    text = "; ".join(names)
    strain = cube[STRAIN]
    used = xr.zeros_like(cube["status"], bool) & (strain < 0)
    for window in reduced_windows(text):
        # Up to the strains between which the ends of the window are interpolated.
        first = strain.where(strain <= window.start + ROUND_OFF).max()
        last = strain.where(strain >= window.stop - ROUND_OFF).min().fillna(np.inf)
        used = used | ((strain >= first) & (strain <= last))
    for column in reduced_columns(text):
        text = text.replace(column, "")
    plain = set(re.findall(r"\w+", text))
    if plain & AT_MINIMUM and "applied_strain_at_min" in cube:
        used = used | (abs(strain - cube["applied_strain_at_min"]) < ROUND_OFF)
    known = [VARIABLES[name] for name in plain & VARIABLES.keys() if not VARIABLES[name].dims]
    sensing = any(each.group in (CAPACITORS, CAPACITORS_UNLOADING) for each in known)
    if sensing and set(SENSING) <= set(cube):
        start, end = (cube[name] for name in SENSING)
        used = used | ((strain > start - ROUND_OFF) & (strain < end + ROUND_OFF))
    return used
