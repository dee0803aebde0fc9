"""Energies of the states of a test."""

from typing import TYPE_CHECKING, Any

from knitlab.observables.observable import Group, curve, observable

if TYPE_CHECKING:
    from knitlab.observables.finished_test import FinishedTest

CONTACT = Group("contact", "Contact", lambda case: case.options.contact != "none")


@observable(
    energy_stretch=curve("energy of the extensional springs", "N mm"),
    energy_fold=curve("energy of the torsional springs", "N mm"),
    energy_wall=curve("energy of the wall penalty", "N mm"),
)
def elastic_energies(test: "FinishedTest") -> dict[str, Any]:
    """Energies of springs, folds and walls."""
    return {
        f"energy_{name}": [float(getattr(state.energy, name)) for state in test.reached]
        for name in ("stretch", "fold", "wall")
    }


@observable(
    CONTACT,
    energy_contact=curve(
        "energy of the contact", "N mm", description="of the barrier between layers of cloth"
    ),
)
def contact_energy(test: "FinishedTest") -> list[float]:
    """Energy of the contact of the fabric with itself."""
    return [float(state.energy.contact) for state in test.reached]
