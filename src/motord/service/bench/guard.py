"""Fault containment: the parts of the supervisor's step that may fail while the bench goes on.

Each has a row here and is stepped inside `Guard.part`. A fault of the environment (OSError, no
memory) is reported, and the part is tried again with the next step. An error in the program stops
the bench as well. The bench itself, from the tick ring to the set-point mailbox, is not among the
parts: an error there ends the daemon, with the current taken away.
"""

from types import TracebackType

from motord.schema import Request
from motord.service.bench.bench import Bench

REPORT_NS = 10_000_000_000
"""Time between two events about the same part."""

PARTS = {
    "loop link": "the loop is not followed",
    "processes": "children that end are not started again",
    "requests": "requests are not carried out",
    "estimator": "how precise a plan is by now is not followed",
    "channels": "no channel is read: one with a trip limit trips after timeout_s",
    "tracker": "the calibration in force is not tracked",
    "queue": "the queue of plans does not go on",
    "answers": "requests wait for their answer",
    "gateway": "what the gateway reports is not passed on",
    "recording": "recorder and recording are not followed",
    "publisher": "clients see no news",
    "service manager": "its watchdog is not fed",
}
"""By part, the consequence while it fails."""


class Guard:
    """Contains the errors of a part. `faults`: present faults, by part.

    An error in the program requests a stop every time, so that nothing is powered while it lasts,
    and is a `Bench.fault_stop` at most every `REPORT_NS`.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._reported_ns: dict[str, int] = {}
        self.faults: dict[str, str] = {}

    def part(self, name: str, now_ns: int) -> "_Part":
        """Do the step of a part (a key of PARTS) in a block; an error in it ends there."""
        return _Part(self, name, now_ns)

    def note(self, name: str, now_ns: int, error: Exception) -> None:
        """Note a fault of a part; an error in the program stops the bench."""
        if isinstance(error, OSError | MemoryError):
            message = f"{name}: {str(error) or type(error).__name__}; {PARTS[name]}"
            self.faults[name] = message
            if self._due(name, now_ns):
                self._bench.events.emit("fault", message, part=name)
            return
        self.faults[name] = f"{name}: {type(error).__name__}: {error}; {PARTS[name]}"
        self._bench.setpoint.request(Request.STOP)
        if self._due(name, now_ns):
            self._bench.fault_stop(f"in the supervisor's part {name!r}", error)

    def _due(self, name: str, now_ns: int) -> bool:
        reported_ns = self._reported_ns.get(name)
        if reported_ns is not None and now_ns - reported_ns < REPORT_NS:
            return False
        self._reported_ns[name] = now_ns
        return True


class _Part:
    """The block of a part: a class, as twelve are entered in each step and a generator is slow."""

    __slots__ = ("_guard", "_name", "_now_ns")

    def __init__(self, guard: Guard, name: str, now_ns: int) -> None:
        self._guard, self._name, self._now_ns = guard, name, now_ns

    def __enter__(self) -> None:
        pass

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        error: BaseException | None,
        _trace: TracebackType | None,
    ) -> bool:
        if error is None:
            self._guard.faults.pop(self._name, None)
        elif isinstance(error, Exception):
            self._guard.note(self._name, self._now_ns, error)
            return True
        return False
