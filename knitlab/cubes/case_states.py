"""The states of a case that have a shape, and datasets of what is computed from these."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from knitlab.cubes.case_file import length_unit, network_configurations
from knitlab.cubes.chosen_case import has_shape
from knitlab.cubes.selection import chosen_indices
from knitlab.io.progress import each
from knitlab.model.fabric import Configuration
from knitlab.observables.schema import STRAIN
from knitlab.solvers.plate_condensation import PlateStatus


@dataclass(frozen=True)
class StoredState:
    """A state of a case: ``ok`` with its shape, else why it cannot be analysed."""

    index: int  # of its applied strain
    status: PlateStatus  # ok, not_converged or plies_touch
    shape: Configuration | None  # in mm of the network


def stored_states(
    case_file: xr.Dataset, selections: Mapping[str, Any], default: Sequence[int] | None = None
) -> Iterator[StoredState]:
    """The states of a case at selected strains, or at ``default`` ones, by default at all."""
    every = range(case_file.sizes[STRAIN])
    chosen = chosen_indices({STRAIN: case_file[STRAIN].values}, selections)
    reached = has_shape(case_file)
    for index in each(chosen.get(STRAIN, every if default is None else default), "state"):
        # Contact that pushes layers apart has a stiffness, which is not modelled.
        if "energy_contact" in case_file and case_file["energy_contact"].values[index] > 0:
            yield StoredState(index, PlateStatus.plies_touch, None)
        elif not reached[index]:
            yield StoredState(index, PlateStatus.not_converged, None)
        else:
            shape = network_configurations(case_file.isel({STRAIN: [index]}))[0]
            yield StoredState(index, PlateStatus.ok, shape)


Described = tuple[tuple[str, ...], str, str]
"""Dimensions of a variable beside those of states, its unit and its meaning."""


def dataset_of_states(
    case_file: xr.Dataset,
    indices: Sequence[int],
    variables: Mapping[str, Described],
    values: Mapping[str, Any],
    coords: Mapping[str, Any],
) -> xr.Dataset:
    """Values along some strains of a case, described by a table of variables."""
    strains = case_file[STRAIN].variable[list(indices)]
    attributes = {"length_unit": length_unit(case_file)}
    found = xr.Dataset(coords={STRAIN: strains, **coords}, attrs=attributes)
    for name, (dims, unit, meaning) in variables.items():
        about = {"units": unit, "long_name": meaning}
        found[name] = (STRAIN, *dims), np.asarray(values[name]), about
    return found
