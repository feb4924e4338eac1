"""A stop, from the key until the daemon's state shows it."""

import time

UNANSWERED_S = 2.0
"""A stop that the daemon has not confirmed after this time is said to be unanswered."""


class PendingStop:
    """Under way from `ask` until `confirm` sees, after the answer, that the bench has stopped."""

    def __init__(self) -> None:
        self._asked_s: float | None = None
        self._answered = False

    @property
    def under_way(self) -> bool:
        """True while it is asked for and not confirmed."""
        return self._asked_s is not None

    @property
    def late(self) -> bool:
        """True if it should be confirmed by now."""
        return self._asked_s is not None and time.monotonic() - self._asked_s > UNANSWERED_S

    def ask(self) -> None:
        """It is asked for, perhaps once more."""
        self._asked_s, self._answered = time.monotonic(), False

    def answered(self) -> None:
        """The daemon has answered it."""
        self._answered = True

    def confirm(self, state: str) -> bool:
        """Return whether the `state` that the daemon publishes now ends it."""
        confirmed = self.under_way and self._answered and state in ("OFF", "TRIPPED")
        if confirmed:
            self._asked_s = None
        return confirmed
