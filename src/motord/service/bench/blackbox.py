"""Black boxes: at a trip the recorder is asked to write the ticks around it, recorded or not.

A request is kept until the recorder reports it as written: a recorder that was started again is
asked again, and the ring still has the ticks.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from motord.api.messages import Event
from motord.config import Config
from motord.recorder.launch import RecorderLink
from motord.recorder.protocol import AFTER_S, BEFORE_S, BlackBoxRequest, RecorderReport, path_of
from motord.schema import State
from motord.service.bench.tick_monitor import TickMonitor
from motord.service.host.events import EventLog

OPEN_NS = round((AFTER_S + 1.0) * 1e9)
"""Events of this time after a trip go into its box."""
ASKED_MAX = 4


@dataclass
class BlackBoxTrigger:
    """Requests black boxes and reports on them. `about` returns a recording's metadata."""

    config: Config
    events: EventLog
    about: Callable[[], dict[str, Any]]
    unix_ns: Callable[[], int]
    _link: RecorderLink | None = None
    _asked: dict[str, BlackBoxRequest] = field(default_factory=dict)

    def trip(self, t_ns: int, tick: int, report: Mapping[str, Any]) -> str:
        """Ask for the box of a trip in `tick` at `t_ns` (Unix ns); return the name of its file."""
        cause = ", ".join(report["first"] or report["causes"])
        return self._ask(t_ns, tick, AFTER_S, {"cause": cause, **report})

    def loop_died(self, why: str, monitor: TickMonitor) -> None:
        """Ask for the box of a loop that has ended, unless it was tripped or never ran."""
        if monitor.last is None or monitor.state is State.TRIPPED:
            return
        account = {
            "cause": "loop died",
            "reason": why,
            "state": monitor.state.name,
            "action": "the reason says what ended the loop process, if not see the system's log; "
            "`motord reset` starts it again, OFF",
        }
        t_ns = self.unix_ns()
        path = self._ask(t_ns, None, 0.0, account)
        self.events.emit("blackbox", f"asked for a black box: {why}", t_ns, path=path)

    def event(self, event: Event) -> None:
        """Add an event to the boxes that are open."""
        boxes = [
            wanted
            for wanted in self._asked.values()
            if 0 <= event.t_ns - int(wanted.account["t_ns"]) <= OPEN_NS
        ]
        if not boxes:
            return
        content = event.model_dump(mode="json")
        for wanted in boxes:
            wanted.events.append(content)
        if self._link is not None:
            self._link.record("blackbox_event", event.t_ns, content)

    def recorder(self, link: RecorderLink | None) -> None:
        """Ask a new recorder for the boxes that the one before has not written."""
        self._link = link
        if link is not None:
            for wanted in self._asked.values():
                link.blackbox(wanted)

    def report(self, report: RecorderReport) -> None:
        """Take in the outcome of the boxes."""
        for path, outcome in report.blackboxes.items():
            wanted = self._asked.pop(path, None)
            if wanted is None:
                continue
            message = f"no black box of the trip: {outcome}" if outcome else f"black box: {path}"
            self.events.emit("blackbox", message, path=path, cause=wanted.account["cause"])

    def _ask(self, t_ns: int, tick: int | None, after_s: float, account: dict[str, Any]) -> str:
        rate_Hz = self.config.loop.rate_Hz
        earlier: list[Mapping[str, Any]] = [
            event.model_dump(mode="json")
            for event in self.events.recent()
            if t_ns - round(BEFORE_S * 1e9) <= event.t_ns <= t_ns
        ]
        wanted = BlackBoxRequest(
            path=path_of(self.config, t_ns),
            tick=tick,
            ticks_before=round(BEFORE_S * rate_Hz),
            ticks_after=round(after_s * rate_Hz),
            metadata=self.about(),
            account={**account, "t_ns": t_ns, "tick": tick},
            events=earlier,
        )
        while len(self._asked) >= ASKED_MAX:
            del self._asked[next(iter(self._asked))]
        self._asked[str(wanted.path)] = wanted
        if self._link is not None:
            self._link.blackbox(wanted)
        return str(wanted.path)
