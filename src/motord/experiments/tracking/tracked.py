"""What tracking knows of the calibration in force."""

from pydantic import BaseModel


class TrackedQuantity(BaseModel, frozen=True):
    """A parameter as ordinary operation shows it, against the calibration in force."""

    name: str
    """As `alpha-a`, `beta-common`, `cogging-48-phase`."""
    meaning: str
    """What it is."""
    unit: str
    """Of all figures; `1` for a ratio."""
    value: float
    """As ordinary operation shows it."""
    half_width: float
    """Half of its 95 % interval."""
    in_force: float
    """As the calibration in force has it."""
    in_force_half_width: float
    """Half of the 95 % interval of that."""
    departed: bool
    """They differ by more than both uncertainties explain."""
    adoptable: bool = True
    """Whether `calibration/adopt` can put the value in force; else another calibration has to."""


class TrackedCalibration(BaseModel, frozen=True):
    """The quantities that ordinary operation shows, as of `t_ns`."""

    calibration: str
    """Id of the one in force."""
    t_ns: int = 0
    """Unix time of the newest tick that is in it; 0 before the first."""
    turns: int = 0
    """Whole turns since tracking began: with the installation, the daemon, or its own restart."""
    memory_s: float = 0.0
    """`[tracking] memory_s`."""
    quantities: tuple[TrackedQuantity, ...] = ()
    """What is known by now."""
    unseen: tuple[str, ...] = ()
    """What operation has not shown."""
    obstacle: str = ""
    """Why nothing, or not all, is tracked; "" without."""
