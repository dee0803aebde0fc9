"""A knitted capacitor: its electrodes, and what is around them."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from knitlab.model.electrodes import ElectrodeLayout
from knitlab.model.settings import Fraction, Unit


@dataclass(frozen=True)
class Capacitor:
    """Parameters of electrodes on a fabric.

    Attributes:
        layout: layout of the electrodes.
        electrode_length: relaxed length of the electrodes on periodic fabric [mm].
        permittivity: relative permittivity of the surroundings [1].
        clearance: distance below which electrodes count as touching [mm].
        accuracy: largest estimated relative error of a capacitance [1].
        linearity: R² that the working range must have [1].
        unfolded: fold angle over the relaxed one at which unfolding is complete [1].
        dielectric_thickness: of what insulates the electrodes from each other: a distance r between
            them counts as √(r² + dielectric_thickness²) [mm]. Insulated electrodes may touch.
        lead_capacitance: of the leads to the meter, parallel to the fabric [pF].
        ground: what lies below the fabric: nothing, or a grounded plane such as skin.
        ground_distance: distance of that plane from the lowest point of the fabric [mm].
    """

    layout: ElectrodeLayout
    electrode_length: Annotated[PositiveFloat, Unit("mm")]
    permittivity: Annotated[float, Field(ge=1)]
    clearance: Annotated[PositiveFloat, Unit("mm")]
    accuracy: Fraction
    linearity: Fraction
    unfolded: Fraction
    dielectric_thickness: Annotated[NonNegativeFloat, Unit("mm")] = 0.0
    lead_capacitance: Annotated[NonNegativeFloat, Unit("pF")] = 0.0
    ground: Literal["none", "plane"] = "none"
    ground_distance: Annotated[PositiveFloat, Unit("mm")] = 2.0
