"""Faults of wires, board, host and supervisor on a virtual bench; those of the rig are the rig's.

Python plays the timeline, between ticks; what a wire loses in a tick is compiled. Wires are
disturbed as records: a lost frame is a sample that does not arrive, a corrupt one as well.
"""

import numpy as np

from motord.config.faults import Fault, Timeline
from motord.jit import constants, jit
from motord.rig import faults as rig_faults
from motord.rig.noise import random_state, uniform
from motord.schema import (
    FAULT_COUNT_MODULUS,
    FAULT_COUNT_SHIFT,
    BridgeStatus,
    InverterStatus,
    record_dtype,
)

LINK = record_dtype(
    [
        ("random", "u8"),
        ("tick", "i8"),
        ("late_since", "i8"),  # tick at which frames became late
        ("can_late", "i8"),  # ticks
        ("bridge_late", "i8"),
        ("can_drop", "f8"),  # fractions
        ("can_duplicate", "f8"),
        ("bridge_drop", "f8"),
        ("bridge_duplicate", "f8"),
        ("command_timeout", "i8"),  # ticks
        ("beat_timeout", "i8"),
        ("command_age", "i8"),
        ("beat_age", "i8"),
        ("heartbeat_ns", "i8"),  # of the supervisor, the last
        ("active", "u4"),  # 0: wires are perfect, nothing else here is looked at
        ("bus_off", "u4"),
        ("board_down", "u4"),
        ("supervisor_silent", "u4"),
        ("timed_out", "u4"),  # the inverter, for want of commands
        ("beat_lost", "u4"),  # the board, for want of heartbeats
        ("held_open", "u4"),  # the enable line, since the board started, until asked to be open
        ("errors", "u4"),
        ("begun", "u4"),  # faults so far
    ]
)

_BRIDGE, _INVERTER = constants(BridgeStatus), constants(InverterStatus)
_NOT_BUS_OFF = 0xFFFFFFFF ^ _INVERTER.BUS_OFF


@jit
def _chance(lk: np.record, fraction: float) -> bool:
    """Return True with this probability."""
    return fraction > 0.0 and uniform(lk) < fraction


@jit
def deliver(link: np.ndarray, ring: np.ndarray, fresh: np.ndarray, feedback: np.ndarray) -> None:
    """Deliver what arrives of `fresh`, a FEEDBACK (1,): the rest of `feedback` stays as it was.

    ring: the newest samples, FEEDBACK (n,), more than the ticks by which any may be late.
    """
    lk, f, now = link[0], feedback[0], fresh[0]
    n = lk.tick
    ring[n % ring.size] = now
    lk.tick = n + 1
    f.now_ns = now.now_ns
    if _arrives(lk, n, lk.can_late, lk.can_drop, lk.can_duplicate) and not lk.bus_off:
        r = ring[(n - lk.can_late) % ring.size]
        for phase in range(3):
            f.i_A[phase] = r.i_A[phase]
            f.u_V[phase] = r.u_V[phase]
        f.u_bus_V, f.temperature_C = r.u_bus_V, r.temperature_C
        f.t_inverter_ns = r.t_inverter_ns
        f.inverter_status = r.inverter_status | (_INVERTER.COMMAND_TIMEOUT if lk.timed_out else 0)
    f.inverter_status = (f.inverter_status & _NOT_BUS_OFF) | (
        _INVERTER.BUS_OFF if lk.bus_off else 0
    )
    if _arrives(lk, n, lk.bridge_late, lk.bridge_drop, lk.bridge_duplicate) and not lk.board_down:
        r = ring[(n - lk.bridge_late) % ring.size]
        f.t_ns, f.encoder_gray, f.torque_Nm = r.t_ns, r.encoder_gray, r.torque_Nm
        status = r.bridge_status | (_BRIDGE.HEARTBEAT_LOST if lk.beat_lost else 0)
        f.bridge_status = status | lk.begun % FAULT_COUNT_MODULUS << FAULT_COUNT_SHIFT
    f.link_errors = lk.errors


@jit
def _arrives(lk: np.record, n: int, late: int, drop: float, duplicate: float) -> bool:
    """Return whether a sample arrives in tick `n`; count what the receiver sees of errors."""
    if _chance(lk, drop):
        lk.errors += 1
        return False
    if _chance(lk, duplicate):
        lk.errors += 1
    return n - lk.late_since >= late or late == 0


@jit
def deliver_command(link: np.ndarray, command: np.ndarray, rig_input: np.ndarray) -> None:
    """Put a COMMAND into a RIG_INPUT as far as it arrives, with the devices' own time limits."""
    lk, c, i = link[0], command[0], rig_input[0]
    if lk.bus_off or _chance(lk, lk.can_drop):
        lk.command_age += 1
    else:
        lk.command_age = 0
        lk.timed_out = 1 if lk.timed_out and c.enable else 0
        i.enable_command = c.enable
        for phase in range(3):
            i.i_command_A[phase] = c.i_A[phase]
    if lk.board_down:
        lk.beat_age, lk.beat_lost, lk.held_open = 0, 0, 1
    elif _chance(lk, lk.bridge_drop):
        lk.beat_age += 1
    else:
        lk.beat_age = 0
        if not c.enable:
            lk.beat_lost, lk.held_open = 0, 0
        i.enable_line = c.enable
    i.brake = c.brake
    i.drive_rad_s = c.drive_rad_s
    expire(link, rig_input)


@jit
def expire(link: np.ndarray, rig_input: np.ndarray) -> None:
    """Let inverter and board act on commands and heartbeats that are too old."""
    lk, i = link[0], rig_input[0]
    if lk.command_age > lk.command_timeout:
        lk.timed_out = 1
    if lk.beat_age > lk.beat_timeout and not lk.held_open:
        lk.beat_lost = 1
    if lk.timed_out:
        i.enable_command = 0
        for phase in range(3):
            i.i_command_A[phase] = 0.0
    if lk.beat_lost or lk.held_open:
        i.enable_line = 0


def new_link(
    seed: int, command_timeout_s: float, beat_timeout_s: float, rate_Hz: int
) -> np.ndarray:
    """Return a LINK, shape (1,), of perfect wires."""
    link = np.zeros(1, LINK)
    lk = link[0]
    lk.random = random_state(seed + 1)
    lk.command_timeout = round(command_timeout_s * rate_Hz)
    lk.beat_timeout = round(beat_timeout_s * rate_Hz)
    return link


class Player:
    """Plays a timeline into a rig and its wires; `events` states what was injected, and when."""

    def __init__(self, timeline: Timeline, rate_Hz: int, link: np.ndarray) -> None:
        self.events: list[dict[str, object]] = []
        self._rate_Hz = rate_Hz
        self._link = link
        self._link["active"] = 1
        self._edges: list[tuple[int, bool, Fault]] = []
        for fault in timeline.fault:
            self._add(fault, 0)
        self._active: list[Fault] = []

    def inject(self, fault: Fault, tick: int) -> None:
        """Add a fault whose `at_s` counts from `tick`."""
        fault.check_place("virtual")
        self._add(fault, tick)

    def _add(self, fault: Fault, tick: int) -> None:
        begin = tick + round(fault.at_s * self._rate_Hz)
        end = begin + max(round(fault.duration_s * self._rate_Hz), 1)
        self._edges += [(begin, True, fault), (end, False, fault)]
        self._edges.sort(key=lambda edge: edge[0])

    def next_edge(self, tick: int) -> int:
        """Return how many ticks may run from `tick` before something begins or ends."""
        return max(self._edges[0][0] - tick, 0) if self._edges else 1 << 62

    def play(self, tick: int, t_ns: int, rig_input: np.ndarray) -> int:
        """Put in force what has begun by `tick`; return how many ticks the host stalls now."""
        stalled = 0
        while self._edges and self._edges[0][0] <= tick:
            _, begins, fault = self._edges.pop(0)
            if begins:
                self._link["begun"] += 1
                self.events.append({"t_ns": t_ns, "tick": tick, **fault.log_entry()})
                self._active.append(fault)
                if fault.kind == "host_stall":
                    stalled = max(stalled, round(fault.duration_s * self._rate_Hz))
                if fault.kind in ("can_late", "bridge_late"):
                    self._link["late_since"] = self._link["tick"]
            else:
                self._active.remove(fault)
        self._put(rig_input)
        return stalled

    def _put(self, rig_input: np.ndarray) -> None:
        rig_faults.clear(rig_input)
        lk = self._link[0]
        for name in ("can_drop", "can_duplicate", "bridge_drop", "bridge_duplicate"):
            lk[name] = 0.0
        for name in ("can_late", "bridge_late", "bus_off", "board_down", "supervisor_silent"):
            lk[name] = 0
        for fault in self._active:
            rig_faults.put(rig_input, fault)
            self._put_link(lk, fault)

    def _put_link(self, lk: np.record, fault: Fault) -> None:
        wire, _, what = fault.kind.partition("_")
        if wire in ("can", "bridge") and fault.fraction is not None:
            field = f"{wire}_{'drop' if what == 'corrupt' else what}"
            lk[field] = max(float(lk[field]), fault.fraction)
        elif what == "late":
            lk[fault.kind] = max(round((fault.delay_s or 0.0) * self._rate_Hz), 1)
        elif fault.kind == "can_bus_off":
            lk["bus_off"] = 1
        elif fault.kind == "bridge_reboot":
            lk["board_down"] = 1
        elif fault.kind == "supervisor_silent":
            lk["supervisor_silent"] = 1
