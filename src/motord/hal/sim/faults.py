"""Faults of the simulated bench in the loop: a timeline from the first read on."""

import time
from collections.abc import Callable

import numpy as np

from motord.config.faults import Fault, Timeline
from motord.rig import faults as rig_faults
from motord.schema import FAULT_COUNT_MODULUS, FAULT_COUNT_SHIFT

NEVER_NS = 1 << 62


class SimFaults:
    """Puts faults into a RIG_INPUT; `due_ns` is when something begins or ends next.

    `status_bits` go into bridge_status: the number of faults begun. A host stall sleeps.
    """

    def __init__(
        self, timeline: Timeline, rig_input: np.ndarray, sleep: Callable[[float], None] = time.sleep
    ) -> None:
        """Raises ConfigError for faults that a bench simulated in the loop cannot have."""
        timeline.check_place("sim", "[bench] faults: ")
        self.due_ns = 0 if timeline.fault else NEVER_NS
        self.status_bits = 0
        self._input = rig_input
        self._sleep = sleep
        self._timeline = timeline
        self._edges: list[tuple[int, bool, Fault]] = []
        self._active: list[Fault] = []
        self._begun = 0

    def play(self, now_ns: int) -> None:
        """Put in force what has begun by `now_ns`, end what is over; the first call starts."""
        if self.due_ns == 0:
            self._start(now_ns)
        while self._edges and self._edges[0][0] <= now_ns:
            _, begins, fault = self._edges.pop(0)
            if not begins:
                self._active.remove(fault)
                continue
            self._begun += 1
            self.status_bits = self._begun % FAULT_COUNT_MODULUS << FAULT_COUNT_SHIFT
            self._active.append(fault)
            if fault.kind == "host_stall":
                self._sleep(fault.duration_s)
        rig_faults.clear(self._input)
        for fault in self._active:
            rig_faults.put(self._input, fault)
        self.due_ns = self._edges[0][0] if self._edges else NEVER_NS

    def _start(self, now_ns: int) -> None:
        for fault in self._timeline.fault:
            self._edges.append((now_ns + round(fault.at_s * 1e9), True, fault))
            self._edges.append((now_ns + round(fault.end_s * 1e9), False, fault))
        self._edges.sort(key=lambda edge: (edge[0], not edge[1]))
