"""What tracking knows of the calibration in force."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TrackedQuantity:
    """A parameter as ordinary operation shows it, against the calibration in force.

    value, in_force: both in `unit`, with halves of their 95 % intervals; departed: whether they
    differ by more than both uncertainties explain; adoptable: whether a calibration can be made
    with the value as it is tracked.
    """

    name: str
    meaning: str
    unit: str
    value: float
    half_width: float
    in_force: float
    in_force_half_width: float
    departed: bool
    adoptable: bool = True


@dataclass(frozen=True)
class TrackedCalibration:
    """The quantities that ordinary operation shows, as of `t_ns`.

    calibration: id of the one in force; turns: whole ones that were taken so far; memory_s: time
    after which a turn counts 1/e. unseen: meanings of the quantities that operation does not show;
    obstacle: why nothing, or not all, is tracked; empty without.
    """

    calibration: str
    t_ns: int
    turns: int
    memory_s: float
    quantities: tuple[TrackedQuantity, ...]
    unseen: tuple[str, ...] = ()
    obstacle: str = ""
