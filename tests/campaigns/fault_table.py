"""What each fault must lead to: the table from which the tests and docs/faults.md come.

A cell gives for a state of `fault_bench.STATES` the first cause and the time within which it must
be found; in OFF, where nothing is latched, the cause that then stands against enabling; in TRIPPED
the cause that joins the first. Without a cause the fault must not trip.
"""

from dataclasses import dataclass
from typing import Any

from motord.config.faults import Fault
from motord.schema import Trip
from tests.campaigns.fault_bench import STATES

RUNNING = ("torque", "ramping")
ENABLED = ("idle", *RUNNING)


@dataclass(frozen=True)
class Cell:
    """What is expected in one state."""

    cause: Trip | None
    within_ms: float


@dataclass(frozen=True)
class Row:
    """A fault with what it must lead to; `without` says where else it shows if it does not trip."""

    fault: Fault
    cells: dict[str, Cell]
    without: str = ""
    in_virtual_time: bool = True

    @property
    def name(self) -> str:
        """The fault with its parameters."""
        parameters = ", ".join(f"{key} {value}" for key, value in self.fault.parameters().items())
        return f"{self.fault.kind} {self.fault.duration_s:g} s" + (
            f" ({parameters})" if parameters else ""
        )


NONE = Cell(None, 0.0)


def _row(
    kind: str,
    cause: Trip | None,
    within_ms: float,
    states: tuple[str, ...] = STATES,
    without: str = "",
    others: dict[str, tuple[Trip, float]] | None = None,
    **parameters: Any,
) -> Row:
    cells = dict.fromkeys(STATES, NONE)
    cells |= {state: Cell(cause, within_ms) for state in states if cause is not None}
    cells |= {state: Cell(*expected) for state, expected in (others or {}).items()}
    return Row(Fault.model_validate({"kind": kind, **parameters}), cells, without)


_STANDS = "nothing: without current it reads as it should"
_STALE_MS, _SLOW_MS = 22.0, 25.0
_ENCODER_STALE = dict.fromkeys(("OFF", "READY", "TRIPPED"), (Trip.ENCODER_STALE, _STALE_MS))
_OVER_TORQUE = dict.fromkeys(("OFF", "READY", "TRIPPED"), (Trip.OVER_TORQUE, 1200.0))

TABLE = (
    _row("inverter_fault", Trip.INVERTER_FAULT, 5),
    _row("inverter_off", Trip.INVERTER_FAULT, 5, ENABLED, "nothing: it is off already"),
    _row("current_stuck", Trip.CURRENT_IMPLAUSIBLE, 200, RUNNING, _STANDS),
    _row("current_noise", Trip.OVER_CURRENT, 100),
    _row("current_noise", Trip.CURRENT_IMPLAUSIBLE, 400, (), "the sensed current", noise_A=2.0),
    _row("current_runaway", Trip.INVERTER_FAULT, 5, ENABLED, "nothing: no voltage is applied"),
    _row("phase_open", Trip.CURRENT_IMPLAUSIBLE, 250, RUNNING, _STANDS),
    _row("encoder_bit", Trip.ENCODER_IMPLAUSIBLE, 5),
    _row(
        "encoder_bit", Trip.ENCODER_IMPLAUSIBLE, 200, RUNNING,
        "nothing: the rotor stands within the track's period", bit=5, level=1,
    ),
    _row(
        "encoder_frozen", Trip.TORQUE_IMPLAUSIBLE, 300, RUNNING, "nothing: the rotor stands still"
    ),
    _row("encoder_skew", Trip.ENCODER_IMPLAUSIBLE, 5, others={
        "ramping": (Trip.ENCODER_IMPLAUSIBLE, 200)
    }),
    _row("index_slip", Trip.ENCODER_IMPLAUSIBLE, 5),
    _row("torque_drift", Trip.TORQUE_IMPLAUSIBLE, 500, ENABLED, others=_OVER_TORQUE),
    _row("torque_saturated", Trip.OVER_TORQUE, 8),
    _row("inverter_hot", Trip.TEMPERATURE, _SLOW_MS),
    _row("brake_hot", Trip.BRAKE_TEMPERATURE, _SLOW_MS),
    _row("bus_voltage", Trip.BUS_VOLTAGE, _SLOW_MS),
    _row("brake_silent", None, 0, (), "the supervisor: brake `stale`, torque to zero"),
    _row("host_stall", None, 0, (), "`missed` and the flags LATE and AFTER_GAP", for_s=0.005),
    _row("host_stall", None, 0, (), "`missed` and the flags LATE and AFTER_GAP", for_s=0.04),
    _row("host_stall", Trip.LOOP_OVERRUN, 101, for_s=0.1),
    _row("can_drop", Trip.INVERTER_STALE, _STALE_MS),
    _row("can_drop", Trip.LINK_ERRORS, 500, fraction=0.3, for_s=0.6),
    _row("can_drop", None, 0, (), "`link_errors`", fraction=0.05, for_s=0.3),
    _row("can_corrupt", Trip.INVERTER_STALE, _STALE_MS),
    _row("can_duplicate", Trip.LINK_ERRORS, 60),
    _row("can_late", Trip.INVERTER_STALE, _STALE_MS),
    _row("can_late", None, 0, (), "`i_age_ns`", delay_s=0.003),
    _row("can_bus_off", Trip.BUS_OFF, 1),
    _row("bridge_drop", Trip.ENCODER_STALE, _STALE_MS),
    _row("bridge_drop", None, 0, (), "`link_errors`", fraction=0.05, for_s=0.3),
    _row("bridge_corrupt", Trip.ENCODER_STALE, _STALE_MS),
    _row("bridge_duplicate", Trip.LINK_ERRORS, 60),
    _row("bridge_late", Trip.ENCODER_STALE, _STALE_MS),
    _row("bridge_late", None, 0, (), "`sample_age_ns`", delay_s=0.003),
    _row("bridge_reboot", Trip.INVERTER_FAULT, 5, ENABLED, others=_ENCODER_STALE),
    _row("supervisor_silent", Trip.SUPERVISOR_STALE, 252, others={
        "torque": (Trip.SUPERVISOR_STALE, 570), "ramping": (Trip.SUPERVISOR_STALE, 570)
    }),
)  # fmt: skip
"""Every fault of a virtual bench with its default parameters, and some with others."""
