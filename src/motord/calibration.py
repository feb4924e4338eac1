"""The calibration file: gains and offsets of a motor's currents, and its cogging torque.

JSON, versioned, written at once or not at all. `id` is a digest of everything that is applied; a
file whose content does not fit its id is refused, and so is one of another motor.
"""

import hashlib
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from motord.atomic_write import write_whole
from motord.config import Finite, MotorConfig, NonNegative, Positive
from motord.config.base import what_is_wrong
from motord.findings import Finding
from motord.learned import LearnedTorque

SCHEMA: Literal["motord.calibration/1"] = "motord.calibration/1"

LEARNED_SHARE = 0.25
"""Part of rated torque that a learned correction may reach."""

Triple = tuple[Finite, Finite, Finite]
StandardErrors = tuple[NonNegative, NonNegative, NonNegative]


class CalibrationError(Exception):
    """A calibration that cannot be used; the message says which file, what and what to do."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class CalibratedMotor(_Part):
    """The motor that was calibrated: what has to agree with the bench's `[motor]`.

    encoder_direction: the cogging torque is by count. Files do not name it where it is 1.
    """

    name: str
    serial: str = ""
    slots: Annotated[int, Field(ge=1)]
    pole_pairs: Annotated[int, Field(ge=1)]
    counts: Annotated[int, Field(ge=1)]
    rated_torque_Nm: Positive
    connection: Literal["star", "independent"]
    encoder_direction: Literal[1, -1] = 1

    @classmethod
    def of(cls, motor: MotorConfig) -> "CalibratedMotor":
        """Return the identity of a bench's motor."""
        return cls(**{name: getattr(motor, name) for name in cls.model_fields})


class Harmonic(_Part):
    """One order of the cogging torque: amplitude_Nm sin(order theta + phase_rad).

    stderr_Nm: of the amplitude; phase_stderr_rad: of the phase, None in files that do not tell.
    """

    order: Annotated[int, Field(ge=1)]
    amplitude_Nm: Finite
    phase_rad: Finite
    stderr_Nm: NonNegative
    phase_stderr_rad: NonNegative | None = None


class AddedOrder(_Part):
    """A cogging order that slots and poles do not allow, and the data show.

    p_value: probability of so much by chance; bic: by how much the Bayesian information criterion
    falls, with the number of turns.
    """

    order: Annotated[int, Field(ge=1)]
    p_value: NonNegative
    bic: Finite


class RmsSummary(_Part):
    """RMS error over the operating points, percent of rated torque."""

    mean: NonNegative
    max: NonNegative


class RmsPoint(_Part):
    """RMS error of one operating point, Poels 2008, eq. (4.16); None where not measured."""

    torque_Nm: Finite
    speed_Hz: Finite
    before: NonNegative | None = None
    after: NonNegative | None = None


class RmsErrors(_Part):
    """RMS errors without (`before`) and with (`after`) compensation, percent of rated torque."""

    before: RmsSummary | None = None
    after: RmsSummary | None = None
    points: tuple[RmsPoint, ...] = ()

    @classmethod
    def of(cls, points: tuple[RmsPoint, ...]) -> "RmsErrors":
        """Return the points with their summaries."""
        before = [p.before for p in points if p.before is not None]
        after = [p.after for p in points if p.after is not None]
        return cls(before=_summary(before), after=_summary(after), points=points)


def _summary(values: list[float]) -> RmsSummary | None:
    return RmsSummary(mean=sum(values) / len(values), max=max(values)) if values else None


class Calibration(_Part):
    """A calibration, Poels 2008, eq. (4.1): what flows is alpha epsilon i* + beta_A in each phase.

    alpha has product 1 and beta_A sums to 0 where the data cannot tell otherwise (`observable`
    says so in words). tau_cog_Nm[n] is the cogging torque at angle 2 pi n / counts; added_orders:
    those of its orders that slots and poles do not allow. findings: where the data depart from the
    model; None in files of before they were looked for.
    """

    schema_: Literal["motord.calibration/1"] = Field(SCHEMA, alias="schema")
    id: str = ""
    created: datetime
    motor: CalibratedMotor
    method: Literal["joint", "residual"]
    runs: tuple[str, ...] = ()
    alpha: tuple[Positive, Positive, Positive]
    alpha_stderr: StandardErrors
    beta_A: Triple
    beta_stderr_A: StandardErrors
    delta_epsilon: Positive = 1.0
    delta_epsilon_source: str = "assumed"
    tau_cog_Nm: tuple[Finite, ...]
    tau_cog_harmonics: tuple[Harmonic, ...] = ()
    added_orders: tuple[AddedOrder, ...] = ()
    observable: tuple[str, ...] = ()
    condition_number: Annotated[float, Field(ge=1)]
    rms_error_percent: RmsErrors = RmsErrors()
    findings: tuple[Finding, ...] | None = None

    learned: LearnedTorque | None = None

    @model_validator(mode="after")
    def _consistent(self) -> "Calibration":
        self._check_learned()
        if len(self.tau_cog_Nm) != self.motor.counts:
            has, counts = len(self.tau_cog_Nm), self.motor.counts
            raise ValueError(f"tau_cog_Nm has {has} values, the motor {counts} counts")
        digest = self._digest()
        if not self.id:
            object.__setattr__(self, "id", digest)
        elif self.id != digest:
            raise ValueError(f"content does not fit its id {self.id}: the file was changed")
        return self

    def _check_learned(self) -> None:
        """Refuse corrections so large that they cannot be what a calibration left."""
        points = self.learned.points if self.learned else ()
        largest_Nm = max((point.amplitude_Nm for point in points), default=0.0)
        allowed_Nm = LEARNED_SHARE * self.motor.rated_torque_Nm
        if largest_Nm > allowed_Nm:
            raise ValueError(f"learned torque of {largest_Nm:.3g} Nm, at most {allowed_Nm:.3g} Nm")

    def _digest(self) -> str:
        """Digest of all but the verification, which is added after the calibration is applied."""
        content = self.to_json()
        del content["id"], content["rms_error_percent"]
        text = json.dumps(content, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def with_rms_error(self, rms: RmsErrors) -> "Calibration":
        """Return the same calibration (same id) with these RMS errors."""
        return self.model_copy(update={"rms_error_percent": rms})

    def with_learned(self, learned: LearnedTorque, created: datetime) -> "Calibration":
        """Return a calibration of its own id with this learned torque, else the same.

        Raises pydantic.ValidationError where that is larger than LEARNED_SHARE of rated torque.
        """
        content = {**dict(self), "id": "", "created": created, "learned": learned}
        return Calibration(**content)

    def check_motor(self, motor: MotorConfig) -> None:
        """Raise CalibrationError naming all that differs if this was made for another motor."""
        here = CalibratedMotor.of(motor)
        differing = [
            f"{name} is {getattr(self.motor, name)!r} there and {getattr(here, name)!r} here"
            for name in CalibratedMotor.model_fields
            if getattr(self.motor, name) != getattr(here, name)
        ]
        if differing:
            raise CalibrationError(
                f"calibration {self.id} was made for another motor: {'; '.join(differing)}; "
                "calibrate this motor or correct [motor] in the bench file"
            )

    def age_s(self, now: datetime) -> float:
        """Return how long ago it was made (s)."""
        return (now - self.created).total_seconds()

    def age(self, now: datetime | None = None) -> str:
        """Return how long ago it was made, in words, such as "3 days"."""
        return in_words(self.age_s(now or datetime.now(UTC)))

    def to_json(self) -> dict[str, Any]:
        """Return the content of the file; without `learned`, `findings`, `added_orders` if none.

        Nor is there an error of a phase where none is known, or an encoder's direction of 1: files
        from before have no such keys.
        """
        nothing = {name for name in ("learned", "findings") if getattr(self, name) is None}
        nothing |= set() if self.added_orders else {"added_orders"}
        content = self.model_dump(mode="json", by_alias=True, exclude=nothing)
        for harmonic in content["tau_cog_harmonics"]:
            if harmonic["phase_stderr_rad"] is None:
                del harmonic["phase_stderr_rad"]
        if content["motor"]["encoder_direction"] == 1:
            del content["motor"]["encoder_direction"]
        return content

    def save(self, path: Path) -> None:
        """Write the file in one step. Raises CalibrationError.

        Whatever interrupts it, `path` holds either the old or the new calibration, whole.
        """
        try:
            write_whole(path, json.dumps(self.to_json(), indent=1) + "\n")
        except OSError as error:
            raise CalibrationError(f"{path}: cannot write it: {error.strerror}") from error


def from_json(content: object, where: str) -> Calibration:
    """Check the content of a calibration file. Raises CalibrationError that begins with `where`."""
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != SCHEMA:
        found = f"its schema is {schema!r}" if schema else "it names no schema"
        raise CalibrationError(f"{where}: not a calibration file: {found}, expected {SCHEMA!r}")
    try:
        return Calibration.model_validate_json(json.dumps(content))
    except ValidationError as error:
        raise CalibrationError(f"{where}: {next(what_is_wrong(error))}") from None


def load(path: Path) -> Calibration:
    """Read and check a calibration file. Raises CalibrationError."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise CalibrationError(f"{path}: cannot read it: {error.strerror}") from error
    except ValueError as error:
        raise CalibrationError(f"{path}: not a calibration file: no valid JSON: {error}") from error
    return from_json(content, str(path))


def in_words(seconds: float) -> str:
    """Return a duration in words: "40 seconds", "3 hours", "12 days"."""
    if seconds < 0:
        return "less than nothing (made in the future: is the clock right?)"
    for unit, length_s in (("day", 86_400), ("hour", 3_600), ("minute", 60)):
        if seconds >= 2 * length_s:
            return f"{int(seconds // length_s)} {unit}s"
    return f"{int(seconds)} second{'' if int(seconds) == 1 else 's'}"
