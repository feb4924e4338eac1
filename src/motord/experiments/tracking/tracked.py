"""What tracking knows of the calibration in force, as it is published in the state, too."""

from pydantic import BaseModel

from motord.intervals import plus_minus

TRACKING_OFF = (
    "tracking is off: set enabled = true in [tracking] of the bench file and start the daemon again"
)
NOT_IN_FORCE = "no calibration is in force, so none is tracked"


class TrackedQuantity(BaseModel, frozen=True):
    """A quantity of the calibration in force, as it is tracked."""

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

    def figures(self) -> str:
        """Return both values with their 95 % intervals, as text."""
        now = plus_minus(self.value, self.half_width)
        before = plus_minus(self.in_force, self.in_force_half_width)
        return f"{now}, in force {before}" + ("" if self.unit in ("", "1") else f" {self.unit}")


class TrackedCalibration(BaseModel, frozen=True):
    """The calibration in force as ordinary operation shows it; it changes nothing by itself."""

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

    @property
    def departed(self) -> list[TrackedQuantity]:
        """The quantities whose value in force has left its interval."""
        return [one for one in self.quantities if one.departed]
