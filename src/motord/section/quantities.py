"""Quantities of a bench file, bounded by what no bench reaches: a slip of unit or exponent shows.

What leaves an interlock its time has narrower bounds (`motord.config.timing`). `FromZero` takes 0,
`Signed` either sign, others are above 0.
"""

from typing import Annotated

from pydantic import AfterValidator, Field

from motord.section import not_too_small

_INVERTIBLE = AfterValidator(not_too_small)

Torque = Annotated[float, Field(gt=0, le=1_000_000), _INVERTIBLE]
TorqueFromZero = Annotated[float, Field(ge=0, le=1_000_000)]
TorqueSigned = Annotated[float, Field(ge=-1_000_000, le=1_000_000)]
"""Nm; the largest generators of wind turbines reach a few times that, and no bench."""
Current = Annotated[float, Field(gt=0, le=100_000), _INVERTIBLE]
CurrentFromZero = Annotated[float, Field(ge=0, le=100_000)]
CurrentSigned = Annotated[float, Field(ge=-100_000, le=100_000)]
"""A."""
Voltage = Annotated[float, Field(gt=0, le=100_000), _INVERTIBLE]
VoltageFromZero = Annotated[float, Field(ge=0, le=100_000)]
"""V."""
Power = Annotated[float, Field(gt=0, le=1_000_000_000), _INVERTIBLE]
PowerFromZero = Annotated[float, Field(ge=0, le=1_000_000_000)]
"""W."""
AngularSpeed = Annotated[float, Field(gt=0, le=100_000), _INVERTIBLE]
"""rad/s, about a million turns a minute."""
TurnsPerSecond = Annotated[float, Field(gt=0, le=20_000), _INVERTIBLE]
TurnsPerSecondFromZero = Annotated[float, Field(ge=0, le=20_000)]
TurnsPerSecondSigned = Annotated[float, Field(ge=-20_000, le=20_000)]
"""Hz of a rotor, the same."""
AngleSigned = Annotated[float, Field(ge=-100, le=100)]
"""rad, also of many turns: an angle in degrees is hardly ever less."""
Inertia = Annotated[float, Field(gt=0, le=1_000_000), _INVERTIBLE]
InertiaFromZero = Annotated[float, Field(ge=0, le=1_000_000)]
"""kg m^2."""
ResistanceFromZero = Annotated[float, Field(ge=0, le=1_000_000)]
"""Ohm."""
BackEmfConstant = Annotated[float, Field(ge=-1_000_000, le=1_000_000)]
"""V s/rad."""
Temperature = Annotated[float, Field(ge=-273, le=1000)]
"""degC."""
TemperatureChange = Annotated[float, Field(gt=0, le=1000), _INVERTIBLE]
"""K."""
Wait = Annotated[float, Field(gt=0, le=86_400), _INVERTIBLE]
WaitFromZero = Annotated[float, Field(ge=0, le=86_400)]
"""s of a plan, up to a day."""
Scale = Annotated[float, Field(gt=0, le=1_000_000), _INVERTIBLE]
"""Unit for each count, or for each unit of another."""
Factor = Annotated[float, Field(gt=0, le=100), _INVERTIBLE]
FactorFromZero = Annotated[float, Field(ge=0, le=100)]
"""Multiple of a value; 1 leaves it as it is."""
