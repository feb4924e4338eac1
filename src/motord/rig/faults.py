"""Faults of the simulated rig, compiled: what RIG_INPUT asks for, put into currents and sensors.

All fields are zero without faults; `active` is then zero too, and nothing else is looked at.
"""

import math

import numpy as np

from motord.config.faults import Fault
from motord.jit import jit
from motord.rig.noise import gaussian
from motord.schema import record_dtype

INJECTED = record_dtype(
    [
        ("active", "u4"),  # not 0: some of the following are in force
        ("inverter_off", "u4"),  # the power stage is off
        ("phase_open", "u4"),  # bit of each phase in which nothing can flow
        ("current_stuck", "u4"),  # bit of each phase whose reading sticks
        ("current_runaway", "u4"),  # bit of each phase whose loop has no reading
        ("encoder_high", "u4"),  # Gray tracks that are stuck at 1
        ("encoder_low", "u4"),  # Gray tracks that are stuck at 0
        ("encoder_frozen", "u4"),
        ("encoder_skew", "i4"),  # counts by which every other Gray track is displaced
        ("index_slip", "i4"),  # counts by which the disc has slipped
        ("torque_saturated", "u4"),
        ("brake_silent", "u4"),  # the excitation asked for is not followed
        ("current_noise_A", "f8", (3,)),
        ("torque_drift_Nm_per_s", "f8"),
        ("inverter_hot_C", "f8"),  # reading of the temperature; 0 is the true one
        ("brake_hot_C", "f8"),  # reading of the disc's temperature; 0 is the true one
        ("bus_fault_V", "f8"),  # reading of the bus voltage; see bus_fault
        ("bus_fault", "u4"),
    ]
)
"""Faults as RIG_INPUT asks for them, and as RIG_STATE keeps what was last asked for."""

FAULT_STATE = [
    ("stuck", "u4"),  # readings that are held
    ("stuck_A", "f8", (3,)),
    ("frozen", "u4"),
    ("frozen_gray", "u4"),
    ("torque_drift_Nm", "f8"),
    ("tripped", "u4"),  # the drive's own limit has switched it off
    ("fault_peak_A", "f8"),  # largest current of any phase while a fault was in force
]
"""Fields of RIG_STATE in which faults remember."""


@jit
def take_faults(s: np.record, i: np.record) -> None:
    """Take over what `i`, a RIG_INPUT record, asks for; forget what is over."""
    if i.injected.active == 0 and s.injected.active == 0:
        return
    s.injected = i.injected
    s.stuck &= i.injected.current_stuck
    s.frozen = s.frozen if i.injected.encoder_frozen else 0
    if i.injected.torque_drift_Nm_per_s == 0.0:
        s.torque_drift_Nm = 0.0
    if i.injected.current_runaway == 0:
        s.tripped = 0


@jit
def is_off(s: np.record) -> bool:
    """Return whether a fault keeps the power stage off."""
    return bool(s.injected.inverter_off) or bool(s.tripped)


@jit
def disturbed_currents(
    p: np.record, s: np.record, i_a: float, i_b: float, i_c: float
) -> tuple[float, float, float]:
    """Return what flows (A) with an open phase or one that runs away, as the drive limits it."""
    rise_A = p.bus_V / p.inductance_H * p.substep_s
    if s.injected.current_runaway & 1:
        i_a = _run_away(p, s, s.i_A[0], rise_A)
    if s.injected.current_runaway & 2:
        i_b = _run_away(p, s, s.i_A[1], rise_A)
    if s.injected.current_runaway & 4:
        i_c = _run_away(p, s, s.i_A[2], rise_A)
    is_open = s.injected.phase_open
    i_a = 0.0 if is_open & 1 else i_a
    i_b = 0.0 if is_open & 2 else i_b
    i_c = 0.0 if is_open & 4 else i_c
    if p.star:
        i_a, i_b, i_c = _sum_to_zero(int(is_open | s.injected.current_runaway), i_a, i_b, i_c)
    return i_a, i_b, i_c


@jit
def _run_away(p: np.record, s: np.record, i_A: float, rise_A: float) -> float:
    """Return the current after a substep of full voltage; at the drive's limit it trips."""
    i_A += rise_A if i_A >= 0.0 else -rise_A
    if abs(i_A) >= p.current_max_A:
        s.tripped = 1
        return math.copysign(p.current_max_A, i_A)
    return i_A


@jit
def _sum_to_zero(fixed: int, i_a: float, i_b: float, i_c: float) -> tuple[float, float, float]:
    """Return the currents of a star some of whose phases are fixed: the others make up for them.

    An open phase counts as fixed at zero here; one that runs away at what it has.
    """
    free = 3 - (fixed & 1) - (fixed >> 1 & 1) - (fixed >> 2 & 1)
    if free == 0:
        return 0.0, 0.0, 0.0
    excess = (i_a + i_b + i_c) / free
    return (
        i_a if fixed & 1 else i_a - excess,
        i_b if fixed & 2 else i_b - excess,
        i_c if fixed & 4 else i_c - excess,
    )


@jit
def step_faults(p: np.record, s: np.record) -> None:
    """Let the torque signal drift over a substep; keep the largest current."""
    largest_A = max(abs(s.i_A[0]), abs(s.i_A[1]), abs(s.i_A[2]))
    s.fault_peak_A = max(s.fault_peak_A, largest_A)
    s.torque_drift_Nm += s.injected.torque_drift_Nm_per_s * p.substep_s


@jit
def disturbed_gray(p: np.record, s: np.record, count: int) -> int:
    """Return the Gray code of an encoder that slips, is skewed, stuck or frozen."""
    counts = int(p.counts)
    count = (count + int(s.injected.index_slip)) % counts
    gray = count ^ (count >> 1)
    if s.injected.encoder_skew:
        displaced = (count + int(s.injected.encoder_skew)) % counts
        gray = (gray & 0x55555555) | ((displaced ^ (displaced >> 1)) & 0xAAAAAAAA)
    gray = (gray | int(s.injected.encoder_high)) & ~int(s.injected.encoder_low)
    if s.injected.encoder_frozen:
        if not s.frozen:
            s.frozen = 1
            s.frozen_gray = gray
        gray = int(s.frozen_gray)
    return gray


@jit
def disturb_readings(p: np.record, s: np.record, o: np.record) -> None:
    """Change what the sensors of `o`, a filled RIG_OUTPUT record, say."""
    o.encoder_gray = disturbed_gray(p, s, int(o.encoder_count))
    for phase in range(3):
        if s.injected.current_noise_A[phase] > 0.0:
            o.i_sensed_A[phase] += s.injected.current_noise_A[phase] * gaussian(s)
        if s.injected.current_stuck >> phase & 1:
            if not s.stuck >> phase & 1:
                s.stuck |= 1 << phase
                s.stuck_A[phase] = o.i_sensed_A[phase]
            o.i_sensed_A[phase] = s.stuck_A[phase]
    limit = int(p.torque_count_max)
    counts = int(o.torque_counts)
    if s.torque_drift_Nm != 0.0:
        drifted = counts + s.torque_drift_Nm / p.torque_Nm_per_count
        counts = int(min(max(drifted, -limit - 1.0), float(limit)))
    if s.injected.torque_saturated:
        counts = limit
    o.torque_counts = counts
    o.torque_clipped = 1 if counts >= limit or counts <= -limit - 1 else 0
    o.torque_Nm = counts * p.torque_Nm_per_count
    if s.injected.inverter_hot_C != 0.0:
        o.temperature_C = s.injected.inverter_hot_C
    if s.injected.brake_hot_C != 0.0:
        o.brake_temperature_C = s.injected.brake_hot_C
    if s.injected.bus_fault:
        o.u_bus_V = s.injected.bus_fault_V
    o.fault |= s.tripped


def clear(rig_input: np.ndarray) -> None:
    """Take all faults out of a RIG_INPUT, shape (1,)."""
    rig_input["injected"] = 0
    rig_input["fault"] = 0


def put(rig_input: np.ndarray, fault: Fault) -> None:
    """Put a fault into a RIG_INPUT, shape (1,); those of wires and hosts are not the rig's."""
    i = rig_input["injected"][0]
    phase = "abc".index(fault.phase) if fault.phase else 0
    masks = ("current_stuck", "current_runaway", "phase_open")
    flags = ("inverter_off", "encoder_frozen", "torque_saturated", "brake_silent")
    if fault.kind in masks:
        i[fault.kind] |= 1 << phase
    elif fault.kind in flags:
        i[fault.kind] = 1
    elif fault.kind == "inverter_fault":
        rig_input["fault"] = 1
    elif fault.kind == "current_noise":
        i.current_noise_A[phase] = fault.noise_A or 0.0
    elif fault.kind == "encoder_bit":
        i["encoder_high" if fault.level else "encoder_low"] |= 1 << (fault.bit or 0)
    elif fault.kind in ("encoder_skew", "index_slip"):
        i[fault.kind] += fault.counts or 0
    elif fault.kind == "torque_drift":
        i.torque_drift_Nm_per_s += fault.drift_Nm_per_s or 0.0
    elif fault.kind in ("inverter_hot", "brake_hot"):
        i[f"{fault.kind}_C"] = fault.temperature_C or 0.0
    elif fault.kind == "bus_voltage":
        i.bus_fault, i.bus_fault_V = 1, fault.bus_V or 0.0
    else:
        return
    i.active = 1
