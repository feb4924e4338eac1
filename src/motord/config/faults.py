"""Faults to inject into a simulated or emulated bench: one strict model, kinds in one table.

A timeline is a TOML file of `[[fault]]` tables: `kind`, `at_s` after the start, `for_s` (the
kind's own duration if left out), and the parameters of the kind.
"""

from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from motord.config.base import ConfigError, Finite, NonNegative, Section
from motord.config.reading import read_toml, validate
from motord.config.timing import LATE_MAX_S

EVERYWHERE = frozenset({"virtual", "sim", "emulate"})
WIRES = frozenset({"virtual", "emulate"})


@dataclass(frozen=True)
class FaultKind:
    """A kind of fault: what it does, how long it lasts by default, its parameters' defaults.

    `places`: which benches can have it: in virtual time, simulated in the loop, emulated.
    """

    meaning: str
    for_s: float
    parameters: dict[str, Any] = field(default_factory=dict)
    places: frozenset[str] = EVERYWHERE


def _wire_kinds(wire: str, device: str) -> dict[str, FaultKind]:
    """Return what can happen to the frames of a wire."""
    both, back = f"frames to and from the {device}", f"frames from the {device}"
    return {
        f"{wire}_drop": FaultKind(f"{both} are lost", 0.3, {"fraction": 1.0}, WIRES),
        f"{wire}_corrupt": FaultKind(f"{both} arrive changed", 0.3, {"fraction": 1.0}, WIRES),
        f"{wire}_duplicate": FaultKind(f"{back} come twice", 0.3, {"fraction": 1.0}, WIRES),
        f"{wire}_late": FaultKind(f"{back} come late", 0.3, {"delay_s": 0.04}, WIRES),
    }


KINDS: dict[str, FaultKind] = {
    "inverter_fault": FaultKind("the drive reports a fault and switches off", 0.2),
    "inverter_off": FaultKind("the power stage goes off and reports no fault", 0.2),
    "current_stuck": FaultKind("the reading of a current sensor sticks", 0.5, {"phase": "a"}),
    "current_noise": FaultKind(
        "the reading of a current sensor is noisy", 0.5, {"phase": "a", "noise_A": 25.0}
    ),
    "current_runaway": FaultKind(
        "the current loop of a phase loses its sensor: the current runs away to the drive's own "
        "limit, which switches it off",
        0.2,
        {"phase": "a"},
    ),
    "phase_open": FaultKind("no current can flow in a phase", 0.5, {"phase": "a"}),
    "encoder_bit": FaultKind("a Gray track is stuck", 2.0, {"bit": 9, "level": 1}),
    "encoder_frozen": FaultKind("the encoder says the same for ever", 1.0),
    "encoder_skew": FaultKind("every other Gray track is displaced", 2.0, {"counts": 120}),
    "index_slip": FaultKind("the code disc slips on the shaft", 1.0, {"counts": 300}),
    "torque_drift": FaultKind("the torque signal drifts", 2.0, {"drift_Nm_per_s": 10.0}),
    "torque_saturated": FaultKind("the torque converter is at its end", 0.2),
    "inverter_hot": FaultKind("the inverter is this hot", 0.2, {"temperature_C": 120.0}),
    "brake_hot": FaultKind("the brake's disc is this hot", 1.0, {"temperature_C": 200.0}),
    "bus_voltage": FaultKind("the DC bus has this voltage", 0.2, {"bus_V": 12.0}),
    "brake_silent": FaultKind("the brake does not answer; its excitation stays", 1.5),
    "host_stall": FaultKind("whoever runs the bench gets no processor", 0.05),
    **_wire_kinds("can", "inverter"),
    "can_bus_off": FaultKind("the CAN controller goes off the bus", 0.3, {}, WIRES),
    **_wire_kinds("bridge", "bridge"),
    "bridge_reboot": FaultKind("the board starts anew, silent for that long", 0.3, {}, WIRES),
    "bridge_clock": FaultKind(
        "the board's clock jumps; back, its samples are old ones",
        0.0,
        {"jump_s": 0.3},
        frozenset({"emulate"}),
    ),
    "supervisor_silent": FaultKind(
        "the supervisor gives no sign of life", 0.6, {}, frozenset({"virtual"})
    ),
}
"""Every kind of fault."""

PARAMETERS = tuple(dict.fromkeys(name for kind in KINDS.values() for name in kind.parameters))


class Fault(Section):
    """One fault: its kind, when it begins and how long it lasts; a kind's parameters have defaults.

    for_s left out is the kind's own duration.
    """

    kind: Annotated[str, Field(json_schema_extra={"enum": list(KINDS)})]
    at_s: NonNegative = 0.0
    for_s: NonNegative | None = None
    phase: Literal["a", "b", "c"] | None = None
    bit: Annotated[int, Field(ge=0, le=31)] | None = None
    level: Literal[0, 1] | None = None
    counts: Annotated[int, Field(ge=-(2**20), le=2**20)] | None = None
    noise_A: NonNegative | None = None
    drift_Nm_per_s: Finite | None = None
    temperature_C: Finite | None = None
    bus_V: NonNegative | None = None
    fraction: Annotated[float, Field(gt=0, le=1)] | None = None
    delay_s: Annotated[float, Field(gt=0, le=LATE_MAX_S)] | None = None
    jump_s: Finite | None = None

    @model_validator(mode="before")
    @classmethod
    def _fill_in(cls, data: Any) -> Any:
        kind = KINDS.get(str(data.get("kind"))) if isinstance(data, dict) else None
        if kind is None:
            return data
        given = {key: value for key, value in data.items() if value is not None}
        return {"for_s": kind.for_s, **kind.parameters, **given}

    @model_validator(mode="after")
    def _is_known(self) -> "Fault":
        if self.kind not in KINDS:
            raise ValueError(f'"{self.kind}" is no kind of fault; known: {", ".join(KINDS)}')
        wanted = KINDS[self.kind].parameters
        for name in PARAMETERS:
            if getattr(self, name) is not None and name not in wanted:
                known = ", ".join(wanted) or "none"
                raise ValueError(f"{self.kind} has no parameter {name}; it has: {known}")
        return self

    def check_place(self, place: str) -> None:
        """Raise ValueError if a bench of this kind cannot have it."""
        places = KINDS[self.kind].places
        if place not in places:
            possible = ", ".join(sorted(places))
            raise ValueError(f"fault {self.kind} is not possible here, only in: {possible}")

    @property
    def duration_s(self) -> float:
        """How long it lasts."""
        return KINDS[self.kind].for_s if self.for_s is None else self.for_s

    @property
    def end_s(self) -> float:
        """When it ends."""
        return self.at_s + self.duration_s

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of its kind."""
        return {name: getattr(self, name) for name in KINDS[self.kind].parameters}

    def summary(self) -> str:
        """Return the fault in one line."""
        parameters = "".join(f", {name} {value}" for name, value in self.parameters().items())
        return f"{self.kind} for {self.duration_s:g} s{parameters}: {KINDS[self.kind].meaning}"

    def log_entry(self) -> dict[str, Any]:
        """Return the fault as it goes into a log."""
        return {"kind": self.kind, "at_s": self.at_s, "for_s": self.duration_s, **self.parameters()}


class Timeline(Section):
    """Faults in the order of their beginnings."""

    fault: Annotated[
        tuple[Fault, ...],
        AfterValidator(lambda faults: tuple(sorted(faults, key=attrgetter("at_s")))),
    ] = ()

    def check_place(self, place: str, where: str = "") -> None:
        """Raise ConfigError for a fault that a bench of this kind cannot have, after `where`."""
        try:
            for fault in self.fault:
                fault.check_place(place)
        except ValueError as error:
            raise ConfigError(f"{where}{error}") from None


def load_timeline(path: Path | None) -> Timeline:
    """Read and check a timeline; None is one without faults. Raises ConfigError."""
    if path is None:
        return Timeline()
    text, data = read_toml(path)
    return validate(Timeline, path, text, data)
