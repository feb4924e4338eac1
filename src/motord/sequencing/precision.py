"""How well a plan knows by now what it is to find out: what it may end early by."""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Precision:
    """Halves of the 95 % intervals that the captures so far give, by quantity with its unit.

    captures: how many operating points it is of; half_widths: such as {"beta_A": 0.03}, a quantity
    that these cannot give yet being left out; obstacle: why the plan must not end early by it (a
    model that does not fit), "" if it may; remark: what else the captures show, as text.
    """

    captures: int
    half_widths: Mapping[str, float] = field(default_factory=dict)
    obstacle: str = ""
    remark: str = ""

    def reaches(self, targets: Mapping[str, float]) -> bool:
        """Return whether every target is reached; False without targets."""
        return (
            bool(targets)
            and not self.obstacle
            and all(self.half_widths.get(name, float("inf")) <= targets[name] for name in targets)
        )

    def in_words(self, targets: Mapping[str, float]) -> str:
        """Return what is reached next to what is wanted, as "beta_A 0.03 of 0.02"."""
        known = ((name, self.half_widths.get(name)) for name in targets)
        parts = [
            f"{name} {'?' if half is None else format(half, '.2g')} of {targets[name]:g}"
            for name, half in known
        ]
        return ", ".join([*parts, *([self.obstacle] if self.obstacle else [])])
