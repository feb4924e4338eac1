"""What the screen shows, at one moment."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from rich.text import Text

from motord.api.messages import BenchState, Event

STALE_S = 0.5
"""A state that is older than this is shown as such: five are published meanwhile."""

Columns = Callable[[int, int], tuple[np.ndarray, np.ndarray]]
"""`MinMaxHistory.columns`."""


@dataclass(frozen=True)
class Snapshot:
    """The newest of everything; `age_s` is the age of `state`, as it arrived here.

    `scales` are the limits of the signals, 0 where they are not known. `pending` is a command that
    the daemon has not confirmed.
    """

    bench: str
    state: BenchState | None
    age_s: float
    events: Sequence[Event]
    columns: Columns
    scales: tuple[float, ...] = (0.0,) * 5
    viewer: str = ""  # name of an identity that may only watch
    lease_here: bool = False
    pending: str = ""
    message: str = ""
    alarming: bool = False  # the message
    events_back: int = 0
    dialog: Sequence[Text] = ()

    @property
    def stale(self) -> bool:
        """True if the daemon is silent, or was never received."""
        return is_stale(self.state, self.age_s)


def is_stale(state: BenchState | None, age_s: float) -> bool:
    """Return whether a state that came `age_s` ago may not be the present one."""
    return state is None or age_s > STALE_S
