"""Faults of the emulated bench: a timeline and commands, put into rig, board, wires and host.

All times are monotonic nanoseconds and arguments, as is what waits for the host.
"""

import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count
from typing import Any

from motord.config.faults import Fault
from motord.emulate.bench import EmulatedBench
from motord.emulate.devices import NEVER_NS
from motord.emulate.disturbance import Disturbance
from motord.rig import faults as rig_faults

FaultSink = Callable[[int, dict[str, Any]], None]
"""Takes the time (monotonic ns) and the account of a fault that begins."""


@dataclass
class Injector:
    """Plays faults into a bench and its wires; `begun` counts them.

    `stall` lets the process sleep (s); `restart_board` makes the board's link start anew.
    """

    bench: EmulatedBench
    can: Disturbance
    bridge: Disturbance
    fault_sink: FaultSink
    stall: Callable[[float], None]
    restart_board: Callable[[], None]
    begun: int = 0
    _edges: list[tuple[int, int, bool, Fault]] = field(default_factory=list)
    _number: Iterator[int] = field(default_factory=count)
    _active: list[Fault] = field(default_factory=list)

    def add(self, fault: Fault, start_ns: int) -> None:
        """Let a fault begin its `at_s` after `start_ns`. Raises ValueError if it cannot be."""
        fault.check_place("emulate")
        begin_ns = start_ns + round(fault.at_s * 1e9)
        heapq.heappush(self._edges, (begin_ns, next(self._number), True, fault))

    @property
    def next_ns(self) -> int:
        """When something begins or ends, or a frame that is late is due."""
        edge_ns = self._edges[0][0] if self._edges else NEVER_NS
        return min(edge_ns, self.can.next_ns, self.bridge.next_ns)

    def play(self, now_ns: int) -> None:
        """Put in force what has begun by `now_ns`, and end what is over."""
        changed = False
        while self._edges and self._edges[0][0] <= now_ns:
            _, _, begins, fault = heapq.heappop(self._edges)
            changed = True
            if begins:
                self._begin(fault, now_ns)
            else:
                self._active.remove(fault)
                if fault.kind == "bridge_reboot":
                    self.restart_board()
        if changed:
            self._put()

    def _begin(self, fault: Fault, now_ns: int) -> None:
        self.begun += 1
        self.bench.board.faults_begun = self.begun
        self.fault_sink(now_ns, {"fault": self.begun, **fault.log_entry()})
        self._active.append(fault)
        end_ns = now_ns + round(fault.duration_s * 1e9)
        heapq.heappush(self._edges, (end_ns, next(self._number), False, fault))
        if fault.kind == "host_stall":
            self.stall(fault.duration_s)
        elif fault.kind == "bridge_clock":
            self.bench.board.jump(round((fault.jump_s or 0.0) * 1e9))
        elif fault.kind == "bridge_reboot":
            self.bench.board.restart(now_ns)

    def _put(self) -> None:
        """Make rig, brake and wires what the faults that are active want."""
        rig_faults.clear(self.bench.rig_input)
        self.bench.brake.silent = False
        self.can.clear()
        self.bridge.clear()
        for fault in self._active:
            rig_faults.put(self.bench.rig_input, fault)
            if fault.kind == "brake_silent":
                self.bench.brake.silent = True
            wire, _, what = fault.kind.partition("_")
            if wire in ("can", "bridge"):
                _disturb(self.can if wire == "can" else self.bridge, what, fault)


def _disturb(wire: Disturbance, what: str, fault: Fault) -> None:
    fraction = fault.fraction or 0.0
    if what in ("drop", "corrupt", "duplicate"):
        setattr(wire, what, max(getattr(wire, what), fraction))
    elif what == "late":
        wire.delay_ns = max(wire.delay_ns, round((fault.delay_s or 0.0) * 1e9))
    elif what in ("bus_off", "reboot"):
        wire.off = True
    wire.active = True
