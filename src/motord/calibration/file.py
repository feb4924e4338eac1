"""The calibration file: gains and offsets of a motor's currents, and its cogging torque.

JSON, versioned, written at once or not at all. `id` is a digest of everything that is applied; a
file whose content does not fit its id is refused, and so is one of another motor.
"""

import hashlib
import json
from datetime import UTC, datetime
from pathlib import Path
from shlex import quote
from typing import Annotated, Any, Literal

from pydantic import AwareDatetime, Field, ValidationError, model_validator

from motord.atomic_write import write_whole
from motord.calibration.parts import (
    AddedOrder,
    CalibratedMotor,
    CramerRao,
    DegreesOfFreedom,
    Harmonic,
    Part,
    RmsErrors,
    StandardErrors,
    Triple,
    half_widths,
)
from motord.config import Finite, MotorConfig, Positive
from motord.findings import Finding
from motord.learned import LearnedTorque
from motord.section.complaints import wrong_things
from motord.uncertainty_budget import Contribution
from motord.untrusted import parse_json, read_text

SCHEMA: Literal["motord.calibration/1"] = "motord.calibration/1"

LEARNED_SHARE = 0.25
"""Part of rated torque that a learned correction may reach."""


class CalibrationError(Exception):
    """A calibration that cannot be used; the message says which file, what and what to do."""


class Calibration(Part):
    """A calibration, Poels 2008, eq. (4.1): what flows is alpha epsilon i* + beta_A in each phase.

    alpha has product 1 and beta_A sums to 0 where the data cannot determine otherwise (`observable`
    says so in words). tau_cog_Nm[n] is the cogging torque at angle 2 pi n / counts; added_orders:
    those of its orders that slots and poles do not allow. findings: where the data depart from the
    model; None in files of before they were looked for. degrees_of_freedom of the standard errors;
    None for many, as files from before had it. budget: what each source contributes to the
    uncertainty; standard errors are its Type A. cramer_rao: how near to the bound of the sensor's
    noise it is; None in files of before it was looked for, and of the residual estimator.
    """

    schema_: Literal["motord.calibration/1"] = Field(SCHEMA, alias="schema")
    id: str = ""
    created: AwareDatetime
    motor: CalibratedMotor
    method: Literal["joint", "residual"]
    runs: tuple[str, ...] = ()
    alpha: tuple[Positive, Positive, Positive]
    alpha_stderr: StandardErrors
    beta_A: Triple
    beta_stderr_A: StandardErrors
    degrees_of_freedom: DegreesOfFreedom | None = None
    delta_epsilon: Positive = 1.0
    delta_epsilon_source: str = "assumed"
    tau_cog_Nm: tuple[Finite, ...]
    tau_cog_harmonics: tuple[Harmonic, ...] = ()
    added_orders: tuple[AddedOrder, ...] = ()
    observable: tuple[str, ...] = ()
    condition_number: Annotated[float, Field(ge=1)]
    rms_error_percent: RmsErrors = RmsErrors()
    findings: tuple[Finding, ...] | None = None
    budget: tuple[Contribution, ...] = ()
    cramer_rao: CramerRao | None = None

    learned: LearnedTorque | None = None

    @property
    def alpha_half_width(self) -> tuple[float, ...]:
        """Halves of alpha's 95 % intervals (3,)."""
        freedom = self.degrees_of_freedom
        return half_widths(self.alpha_stderr, freedom.alpha if freedom else None)

    @property
    def beta_half_width_A(self) -> tuple[float, ...]:
        """Halves of beta's 95 % intervals (3,)."""
        freedom = self.degrees_of_freedom
        return half_widths(self.beta_stderr_A, freedom.beta_A if freedom else None)

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

    def check_motor(self, motor: MotorConfig, *, recorded: bool = False) -> None:
        """Raise CalibrationError naming all that differs if this was made for another motor.

        recorded: `motor` is what recordings say, which may know a serial number where the bench
        file has none: then one that is empty fits any.
        """
        here = CalibratedMotor.of(motor)
        names = list(CalibratedMotor.model_fields)
        if recorded and "" in (here.serial, self.motor.serial):
            names.remove("serial")
        differing = [
            f"{name} is {getattr(self.motor, name)!r} there and {getattr(here, name)!r} here"
            for name in names
            if getattr(self.motor, name) != getattr(here, name)
        ]
        if differing:
            raise CalibrationError(
                f"calibration {self.id} was made for another motor: {'; '.join(differing)}; "
                "calibrate this motor or correct [motor] in the bench file"
            )

    @property
    def serious_findings(self) -> tuple[Finding, ...]:
        """Those that have to be accepted by name before it is applied."""
        return tuple(one for one in self.findings or () if one.severity == "serious")

    @property
    def serious_names(self) -> list[str]:
        """Names of its serious findings, each once."""
        return list(dict.fromkeys(one.name for one in self.serious_findings))

    @property
    def accept_options(self) -> str:
        """Options of `motord calibration install` with which it is applied."""
        return " ".join(f"--accept {quote(name)}" for name in self.serious_names)

    def age_s(self, now: datetime) -> float:
        """Return how long ago it was made (s)."""
        return (now - self.created).total_seconds()

    def age(self, now: datetime | None = None) -> str:
        """Return how long ago it was made, in words, such as "3 days"."""
        return format_duration(self.age_s(now or datetime.now(UTC)))

    def to_json(self) -> dict[str, Any]:
        """Return the content of the file.

        Without what files from before had no keys for, where there is none of it: what was learned,
        findings, degrees of freedom, added orders, a budget, a Cramer-Rao bound, the error of a
        phase, or an encoder's direction other than 1.
        """
        names = ("learned", "findings", "degrees_of_freedom", "cramer_rao")
        nothing = {name for name in names if getattr(self, name) is None}
        nothing |= {name for name in ("added_orders", "budget") if not getattr(self, name)}
        content = self.model_dump(mode="json", by_alias=True, exclude=nothing)
        for harmonic in content["tau_cog_harmonics"]:
            for name in ("phase_stderr_rad", "degrees_of_freedom"):
                if harmonic[name] is None:
                    del harmonic[name]
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
        raise CalibrationError(f"{where}: {next(wrong_things(error))}") from None


def load(path: Path) -> Calibration:
    """Read and check a calibration file. Raises CalibrationError."""
    try:
        content = parse_json(read_text(path))
    except OSError as error:
        raise CalibrationError(f"{path}: cannot read it: {error.strerror}") from error
    except ValueError as error:
        raise CalibrationError(f"{path}: not a calibration file: no valid JSON: {error}") from error
    return from_json(content, str(path))


def format_duration(seconds: float) -> str:
    """Return a duration in words: "40 seconds", "3 hours", "12 days"."""
    if seconds < 0:
        return "less than nothing (made in the future: is the clock right?)"
    for unit, length_s in (("day", 86_400), ("hour", 3_600), ("minute", 60)):
        if seconds >= 2 * length_s:
            return f"{int(seconds // length_s)} {unit}s"
    return f"{int(seconds)} second{'' if int(seconds) == 1 else 's'}"
