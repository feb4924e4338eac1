"""The parts of the supervisor's step that may fail while the bench goes on.

The bench itself, from the tick ring to the set-point mailbox, is not among them: an error there
ends the daemon with the current taken away. Every other part has a row here, and is stepped inside
`Guard.part`. What the world does to it (an OSError, no memory) is a fault that is told, and it is
tried again with the next step. An error in the program puts its result in doubt, so the bench is
stopped as well.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from motord.service.host.events import EventLog

TELL_NS = 10_000_000_000
"""Time between two events about the same part."""

PARTS = {
    "loop link": "the loop is not followed",
    "processes": "children that end are not started again",
    "requests": "requests are not carried out",
    "answers": "requests wait for their answer",
    "gateway": "what the gateway reports is not told",
    "recording": "recorder and recording are not followed",
    "publisher": "clients see no news",
    "service manager": "its watchdog is not fed",
}
"""What it means while a part fails."""


class Guard:
    """Keeps errors of a part from the rest. `faults`: what is wrong now, by part.

    An error of the program calls `stop` every time, so that nothing is powered while it lasts, and
    `on_bug`, with where it was and the error, as often as it is told.
    """

    def __init__(
        self,
        events: EventLog,
        on_bug: Callable[[str, Exception], object],
        stop: Callable[[], None],
    ) -> None:
        self._events = events
        self._on_bug = on_bug
        self._stop = stop
        self._told_ns: dict[str, int] = {}
        self.faults: dict[str, str] = {}

    @contextmanager
    def part(self, name: str, now_ns: int) -> Iterator[None]:
        """Do the step of a part (a key of PARTS); an error in it ends here."""
        try:
            yield
        except (OSError, MemoryError) as error:
            said = f"{name}: {str(error) or type(error).__name__}; {PARTS[name]}"
            self.faults[name] = said
            if self._due(name, now_ns):
                self._events.emit("fault", said, part=name)
        except Exception as error:
            self.faults[name] = f"{name}: {type(error).__name__}: {error}; {PARTS[name]}"
            self._stop()
            if self._due(name, now_ns):
                self._on_bug(f"in the supervisor's part {name!r}", error)
        else:
            self.faults.pop(name, None)

    def _due(self, name: str, now_ns: int) -> bool:
        told_ns = self._told_ns.get(name)
        if told_ns is not None and now_ns - told_ns < TELL_NS:
            return False
        self._told_ns[name] = now_ns
        return True
