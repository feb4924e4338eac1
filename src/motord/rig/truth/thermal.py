"""`[thermal]` of a rig file: heat capacities of the motor's parts, and what lies between them."""

from typing import Annotated

from pydantic import Field

from motord.config import NonNegative, Positive, Section


class ThermalTruth(Section):
    """Winding, magnets and housing, each of one temperature; copper loss heats the winding.

    The copper's resistance is that of `[motor]` at the temperature of the room, and rises by
    resistance_per_K of it; so does the back-EMF by back_emf_per_K with the magnets' temperature.
    """

    winding_J_per_K: Positive = 150.0
    magnet_J_per_K: Positive = 400.0
    housing_J_per_K: Positive = 1500.0
    winding_housing_K_per_W: Positive = 0.25
    winding_magnet_K_per_W: Positive = 3.0
    magnet_housing_K_per_W: Positive = 1.5
    housing_ambient_K_per_W: Positive = 0.4
    resistance_per_K: NonNegative = 0.00393
    back_emf_per_K: Annotated[float, Field(ge=-0.01, le=0.01)] = 0.0
