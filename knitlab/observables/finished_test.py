"""A finished test of a case: what observables are computed from."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from knitlab.io.progress import part
from knitlab.model.electrodes import Electrodes
from knitlab.model.fabric import Configuration, Fabric
from knitlab.model.network import Network
from knitlab.observables.unit_cells import (
    CellField,
    CellTensor,
    CornerGrid,
    ReferenceGrid,
    central_mean,
    deformation_gradient,
    lattice_vectors,
    local_strain,
    strains_in_direction,
    unit_cell_corners,
)
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.state import State, TensileTest
from knitlab.solvers.loads import WARP
from knitlab.solvers.loads.load import X
from knitlab.solvers.perturbed_copies import PerturbedTest

if TYPE_CHECKING:
    from knitlab.observables.capacitance.capacitor import Capacitances

Curve = Float[np.ndarray, " reached"]


@dataclass(frozen=True, eq=False)
class FinishedTest:
    """A case, its test, and the tests of its perturbed copies; what follows is computed once."""

    case: Case
    test: TensileTest
    copies: Sequence[PerturbedTest] = ()
    computed: dict[Callable[..., Any], Any] = field(default_factory=dict)  # by observable

    @property
    def relaxed_at_all(self) -> bool:
        """Whether the fabric relaxed, so that it has strains and shapes."""
        return self.test.loading is not None

    @cached_property
    def reached(self) -> list[State]:
        """The states that converged, one for each strain from 0 on."""
        return [state for state in self.test.states if state.converged]

    @property
    def complete(self) -> bool:
        """Whether every strain was reached."""
        return len(self.reached) == len(self.case.applied_strain)

    @property
    def applied_strain(self) -> Curve:
        """The applied strains that were reached [1]."""
        return np.array(self.case.applied_strain)[: len(self.reached)]

    @cached_property
    def configurations(self) -> Configuration:
        """The states that were reached, along a leading axis [mm]."""
        return Configuration.stacked([self._of_fabric(state) for state in self.reached])

    @cached_property
    def relaxed(self) -> Configuration:
        """The relaxed shape, before the first cycle [mm]."""
        return self._of_fabric(self.test.relaxed or self.reached[0])

    def _of_fabric(self, state: State) -> Configuration:
        """The configuration of a state, without positions of nodes without fabric [mm]."""
        configuration, shape = state.configuration, self.case.mesh_shape
        if shape.spans is None:
            return configuration
        there = shape.nodes_of_fabric[..., None]
        return replace(configuration, positions=np.where(there, configuration.positions, np.nan))

    @cached_property
    def corners(self) -> tuple[ReferenceGrid, CornerGrid]:
        """Corners of the unit cells, relaxed and in the states that were reached [mm]."""
        states = [self.relaxed, *map(self._of_fabric, self.reached)]
        stacked = Configuration.stacked(states)
        corners = unit_cell_corners(self.case.mesh_shape, self.case.cell_grid, stacked)
        return corners[0], corners[1:]

    @cached_property
    def gradient(self) -> CellTensor:
        """Deformation gradient of every unit cell, from its relaxed shape [1]."""
        at_rest, corners = self.corners
        return deformation_gradient(lattice_vectors(at_rest), lattice_vectors(corners))

    @cached_property
    def strains(self) -> tuple[CellField, CellField]:
        """Local strains along weft and warp [1].

        That across the pull is missing if every corner of a unit cell is held: it is round-off.
        """
        strain_xx, strain_yy = local_strain(*self.corners)
        if self.case.all_corners_held:
            if self.case.load.axis == X:
                strain_yy = strain_yy * np.nan
            else:
                strain_xx = strain_xx * np.nan
        return strain_xx, strain_yy

    @cached_property
    def mean_strains(self) -> tuple[Curve, Curve]:
        """Mean strains along weft and warp over the central unit cells [1]."""
        strain_xx, strain_yy = self.strains
        return np.asarray(central_mean(strain_xx)), np.asarray(central_mean(strain_yy))

    @cached_property
    def strains_of_pull(self) -> tuple[Curve, Curve]:
        """Mean strains across and along the pulled direction [1]."""
        if self.case.load.kind == WARP.kind:
            return self.mean_strains
        across, along = strains_in_direction(self.gradient, self.case.load.angle_of_pull)
        return np.asarray(across), np.asarray(along)

    def reaction_force(self, state: State) -> float:
        """The force that the load of the test reports [N]."""
        assert self.test.loading is not None
        return self.case.load.reaction_force(self.test.loading, state.gradient)

    @cached_property
    def assembled(self) -> tuple[Network, Fabric]:
        """The network of the case, and its fabric."""
        return self.case.assemble()

    @cached_property
    def capacitances(self) -> "Capacitances":
        """The capacitor in every state, without leads, of the modelled length."""
        from knitlab.observables.capacitors import capacitances

        with part(0.0, 0.5 if self.case.unloading else 1.0):
            return capacitances(self, self.configurations)

    @cached_property
    def electrodes(self) -> Electrodes:
        """What is plated on the fabric."""
        return self.case.electrodes
