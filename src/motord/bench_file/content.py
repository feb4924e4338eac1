"""The answers put into an example's tables, and what follows from them."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from motord.bench_file.parsing import parse
from motord.bench_file.questions import BACK_EMF, QUESTIONS, Question, get, is_real
from motord.bench_file.templates import Tables, Template, inverter_tables
from motord.config import ConfigError, MotorConfig, TorqueSensorConfig, resolve
from motord.config.reading import check_table
from motord.config.rules.torque import dead_sensor_error_Nm, found_late_s
from motord.config.sections import LimitsConfig
from motord.config.text.descriptions import field_of

Answers = Mapping[str, str]
"""What was answered, as text, by key."""

Ask = Callable[[Question, str], str]
"""Asks one question, with a default; the answer is one that `parse` takes."""

SMALL = 1 / 3
"""Of the rated torque, to begin with."""

LEAST_ERROR = 0.2
"""Of the torque, to begin with 7 % of the rated one: a smaller error may be cogging torque."""


def adapt(
    template: Template, inverter: str, where: Path, answers: Answers, ask: Ask | None
) -> tuple[Tables, frozenset[str]]:
    """Return the tables of a new bench file, and the keys that were answered or follow from those.

    where: the file to be, which gives the bench its name unless that is answered. Raises
    ConfigError for an answer that is wrong, or to a question that this bench does not have.
    """
    tables = template.tables()
    with suppress(ConfigError):  # not every file name is good for a bench
        tables["bench"]["name"] = parse(QUESTIONS[0], where.stem)
    if template.real:
        tables["loop"].pop("cpu", None)  # one that this computer may not have
        tables["bench"].pop("notes", None)
        tables["inverter"] = inverter_tables(inverter or "phase-currents")
        if tables["inverter"]["driver"] == "can-dq":
            tables["motor"]["connection"] = "star"
    elif inverter:
        raise ConfigError("--inverter is for a real bench: the example has one of its own")
    left = dict(answers)
    answered = {"bench.name"}
    for question in QUESTIONS:
        if not question.applies(tables):
            continue
        default = _default(question.key, tables, where)
        given = left.pop(question.key, None)
        if given is not None or ask is not None:
            answered.add(question.key)
        if given is None:
            given = ask(question, default) if ask is not None else default
        _put(tables, question.key, _parsed(question, given))
    if left:
        raise ConfigError(_not_asked(left, template))
    derived = _of_a_real_bench(tables) if template.real else _of_an_example(tables)
    for key, value in derived.items():
        _put(tables, key, value)
    return tables, frozenset(answered | derived.keys())


def _parsed(question: Question, text: str) -> Any:
    try:
        return parse(question, text)
    except ConfigError as error:
        raise error.after(f"{question.option}: ") from None


def _not_asked(left: Answers, template: Template) -> str:
    options = ", ".join(question.option for question in QUESTIONS if question.key in left)
    if not template.real:
        return (
            f"{options}: the rig of this template has its own motor and devices; take a template "
            "of a real bench, or change rig file and bench file together"
        )
    return f"{options}: this bench has no such device, or it is reached otherwise"


def _put(tables: Tables, key: str, value: Any) -> None:
    *names, last = key.split(".")
    for name in names:
        tables = tables.setdefault(name, {})
    tables[last] = value


def _default(key: str, tables: Tables, where: Path) -> str:
    """Return what is taken without an answer: what the example says, or what follows."""
    if key == BACK_EMF:
        return f"{get(tables, key)[0]['amplitude_V_s_per_rad']:g}"
    if key == "limits.torque_Nm" and is_real(tables):
        return f"{_three_digits(SMALL * tables['motor']['rated_torque_Nm']):g}"
    if key == "limits.current_A" and is_real(tables):
        motor = _motor(tables, where)
        part = tables["limits"]["torque_Nm"] / motor.rated_torque_Nm
        return f"{_three_digits(motor.rated_current_A() * max(0.75, 1.25 * part)):g}"
    value = get(tables, key)
    return str(field_of(key).get_default() if value is None else value)


def _motor(tables: Tables, where: Path) -> MotorConfig:
    content = dict(tables["motor"])
    if isinstance(content["back_emf"], str):
        content["back_emf"] = resolve(where, Path(content["back_emf"]))
    return check_table(MotorConfig, "motor", content)


def _three_digits(value: float) -> float:
    return float(f"{value:.3g}")


def _of_a_real_bench(tables: Tables) -> Tables:
    """Return limits and plans that fit the answers."""
    for name in ("brake", "drive"):
        if tables[name]["driver"] == "none":
            tables[name] = {"driver": "none"}
        elif tables[name]["modbus"]["transport"] == "tcp":
            for key in ("serial_port", "baud", "parity"):
                tables[name]["modbus"].pop(key, None)
    torque_Nm, current_A = tables["limits"]["torque_Nm"], tables["limits"]["current_A"]
    largest_Nm = max(torque_Nm, tables["motor"]["rated_torque_Nm"])
    torques_Nm = [min(_three_digits(torque_Nm * part / 4), torque_Nm) for part in (1, 2, 3, 4)]
    return {
        "limits.torque_rate_Nm_per_s": torque_Nm,
        "limits.trip_torque_Nm": _three_digits(2 * largest_Nm),
        "limits.torque_error_Nm": _torque_error_Nm(tables),
        "limits.trip_current_A": _three_digits(4 / 3 * current_A),
        "limits.i2t_current_A": _three_digits(2 / 3 * current_A),
        "plans.calibrate.torques_Nm": torques_Nm,
        "plans.verify.torques_Nm": torques_Nm,
    }


def _torque_error_Nm(tables: Tables) -> float:
    """Return what a motor that is not calibrated stays within, and a dead torque sensor does not.

    As far as the sensor's high-pass leaves more than LEAST_ERROR of the torque: below that, as if
    it had none, and `motord check` says what it hides.
    """
    torque_Nm = tables["limits"]["torque_Nm"]
    lasting = {k: v for k, v in tables["limits"].items() if k == "torque_error_s"}
    limits = LimitsConfig.model_construct(
        torque_Nm=torque_Nm, torque_rate_Nm_per_s=torque_Nm, **lasting
    )
    sensor = check_table(TorqueSensorConfig, "torque_sensor", tables["torque_sensor"])
    rate_Hz = tables["loop"]["rate_Hz"]
    late_s = found_late_s(rate_Hz, tables["bridge"].get("rate_Hz") or rate_Hz)
    dead_Nm = dead_sensor_error_Nm(limits, sensor.highpass_time_constant_s, late_s)
    if 0.9 * dead_Nm < LEAST_ERROR * torque_Nm:
        dead_Nm = dead_sensor_error_Nm(limits, 0.0, 0.0)
    return _three_digits(0.9 * dead_Nm)


def _of_an_example(tables: Tables) -> Tables:
    """Return what an emulated bench needs at another rate than its own."""
    rate_Hz, derived = tables["loop"]["rate_Hz"], {}
    if "overrun_ticks" in tables["loop"]:
        derived["loop.overrun_ticks"] = min(rate_Hz, tables["loop"]["overrun_ticks"])
    if "link_errors_per_s" in tables["limits"]:
        derived["limits.link_errors_per_s"] = min(
            2.0 * rate_Hz, tables["limits"]["link_errors_per_s"]
        )
    if "rig_patience_s" in tables["bench"]:
        derived["bench.rig_patience_s"] = max(2 / rate_Hz, tables["bench"]["rig_patience_s"])
    return derived
