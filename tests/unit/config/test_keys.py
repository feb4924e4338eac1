"""Every key of a bench file does something, and a test shows what.

Each key is read by the program, and named by a test that fails if it changes nothing. Keys that no
other test needs are shown here.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import BaseModel

from motord.config import (
    AccelerationConfig,
    AccuracyConfig,
    Config,
    OscillationConfig,
    load,
    packaged,
)
from motord.config.experiments import PlansConfig, plan_kinds, plans_model
from motord.experiments.inertia.acceleration import accelerate
from motord.experiments.inertia.springs import SpringSetup
from motord.experiments.plans import build
from motord.schema import InverterStatus, Request, Trip
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan
from motord.wire.can import dbc
from tests.contract.benches import dq_config
from tests.contract.peers import SIGNALS, can_config
from tests.unit.control.bench import Bench, make_config
from tests.unit.experiments.inertia.inertia_runs import named, pushes
from tests.unit.experiments.inertia.test_plan import Bar, released, watch
from tests.unit.sequencing.test_driven import Driven

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / "src/motord/config"
READ_ELSEWHERE = {  # by alignment, design of a quick calibration, profiles, efficiency maps, and
    # where the back-EMF is referred to a temperature
    *("back_emf_temperature_percent", "magnet_temperature_K"),
    *("encoder_error_rad", "torque_gain_percent", "current_gain_percent", "back_emf_percent"),
    *("torque_zero_Nm", "power_gain_percent", "power_zero_W"),
    *("friction_ripple_percent", "torque_crosstalk_percent", "saturation_percent"),
}
BY_NAME = {
    **{
        f"accuracy.{name}": "by its name in experiments.calibration.estimate.budget"
        for name in AccuracyConfig.model_fields
        if name not in READ_ELSEWHERE
    },
    "plans.calibrate.alpha_percent": "in CalibrateConfig.targets",
    "plans.calibrate.cogging_percent": "in CalibrateConfig.targets",
    "limits.current_error_s": "by its name in control.interlock_table",
    "limits.torque_error_s": "by its name in control.interlock_table",
    **{
        f"inverter.can.signals.{name}": "getattr, by command_ or feedback_ and the slot's name"
        for name in (
            *("command_i_d_A", "command_i_q_A", "feedback_i_d_A", "feedback_i_q_A"),
            *("feedback_u_d_V", "feedback_u_q_V", "feedback_u_bus_V", "feedback_temperature_C"),
        )
    },
    **{
        f"inverter.can.signals.status_{name}": "getattr, by the name of the status bit"
        for name in (
            *("ready_value", "fault_value", "enable_line_mask", "enable_line_value"),
            *("timeout_mask", "timeout_value"),
        )
    },
}
"""Keys that the program reads by a name that it puts together, and how."""


def models(kind: Any) -> Iterator[type[BaseModel]]:
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        yield kind
    for part in get_args(kind):
        yield from models(part)


def sections(kind: Any) -> Iterator[type[BaseModel]]:
    for model in models(kind):
        yield plans_model() if model is PlansConfig else model


def keys(model: type[BaseModel] = Config, prefix: str = "") -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield f"{prefix}{name}"
        for section in sections(field.annotation):
            yield from keys(section, f"{prefix}{name}.")


KEYS = sorted(set(keys()))


@cache
def read_by_the_program() -> frozenset[str]:
    """Return the keys that are read as attributes anywhere but where bench files are checked.

    Files are parsed only where a name after a dot may be a key that no file before them reads.
    """
    wanted, read = {key.rpartition(".")[2] for key in KEYS}, set[str]()
    for file in (p for p in (ROOT / "src").rglob("*.py") if CONFIG not in p.parents):
        text = file.read_text()
        if (wanted - read).intersection(re.findall(r"\.\s*(\w+)", text)):
            read |= wanted & {
                node.attr
                for node in ast.walk(ast.parse(text))
                if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load)
            }
    return frozenset(read)


@cache
def named_by_tests() -> frozenset[str]:
    return frozenset(
        word for p in (ROOT / "tests").rglob("*.py") for word in re.findall(r"\w+", p.read_text())
    )


def test_every_key_is_read() -> None:
    by_plan = {f"plans.{name.replace('-', '_')}" for name in plan_kinds()}  # read by PlansConfig.of
    unread = {key for key in KEYS if key.rpartition(".")[2] not in read_by_the_program()} - by_plan
    assert unread == set(BY_NAME)


def test_every_key_is_named_by_a_test() -> None:
    assert [key for key in KEYS if key.rpartition(".")[2] not in named_by_tests()] == []


def changed(**tables: dict[str, Any]) -> Config:
    content = load().model_dump()
    for table, values in tables.items():
        content[table] |= values
    return Config.model_validate(content)


def test_observer_bandwidth_Hz() -> None:
    """The faster the observer, the more of the encoder's steps is seen in the speed."""

    def noise_rad_s(bandwidth_Hz: float) -> float:
        bench = Bench(make_config(loop={"observer_bandwidth_Hz": bandwidth_Hz}))
        bench.speed_rad_s = 3.0
        return float(np.std([bench.run()["speed_rad_s"] for _ in range(600)][300:]))

    assert noise_rad_s(100.0) > 3 * noise_rad_s(15.0) > 0.0


@pytest.mark.parametrize(
    ("key", "value", "word", "status"),
    [
        ("status_fault_mask", 0x40, 0x40, InverterStatus.FAULT),
        ("status_timeout_mask", 0x40, 0x40, InverterStatus.COMMAND_TIMEOUT),
        ("status_enable_line_mask", 0x40, 0x40, InverterStatus.ENABLE_LINE),
    ],
)
def test_masks_of_the_status_word(key: str, value: int, word: int, status: InverterStatus) -> None:
    before, after = (
        dbc.load(can_config("virtual", signals=signals))
        for signals in (SIGNALS, {**SIGNALS, key: value})
    )
    assert not before.decode_status(word) & status
    assert after.decode_status(word) & status
    assert after.status_word(status) == word


@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("status_fault_value", InverterStatus.FAULT),
        ("status_timeout_value", InverterStatus.COMMAND_TIMEOUT),
        ("status_enable_line_value", InverterStatus.ENABLE_LINE),
    ],
)
def test_values_of_the_status_word(name: str, status: InverterStatus) -> None:
    """With a value its mask's bits are a mode; without one any of them will do."""
    mask = {name.replace("value", "mask"): 0x70}
    bits, mode = (
        dbc.load(can_config("virtual", signals={**SIGNALS, **mask, **value}))
        for value in ({}, {name: 0x30})
    )
    assert bits.decode_status(0x10) & status
    assert not mode.decode_status(0x10) & status
    assert mode.decode_status(0x30) & status


def test_command_disable_value() -> None:
    def payload(**value: int) -> bytes:
        return dbc.load(dq_config(**value)).encode_command((0.0, 0.0), False, 0)

    assert payload(command_disable_value=3) != payload()


def test_feedback_temperature_C() -> None:
    mapped = dbc.load(can_config("virtual"))
    left_out = {**SIGNALS, "feedback_temperature_C": ""}
    assert "temperature_C" in {slot for m in mapped.feedback for slot in m.slots}
    unmapped = dbc.load(can_config("virtual", signals=left_out))
    assert "temperature_C" not in {slot for m in unmapped.feedback for slot in m.slots}


def test_settle_tolerance() -> None:
    """A speed that sways by 4 % holds still for one tolerance and not for another."""

    def message(tolerance: float) -> str:
        sways = Driven(
            lambda drive, n: drive * (1 + 0.02 * np.sin(n / 300)),
            settle_s=8.0, settle_timeout_s=12.0, settle_tolerance=tolerance,
        )  # fmt: skip
        return sways.finish()

    assert "it does not hold still" in message(0.001)
    assert message(0.1) == ""


def test_spin_up() -> None:
    def fastest_Hz(spin_up: float) -> float:
        driven, demands = Driven(lambda drive, _: drive, spin_up=spin_up), []
        while not driven.executor.finished:
            driven.look()
            demands.append(driven.demand.drive_rad_s)
        return float(max(demands) / (2 * np.pi))

    assert fastest_Hz(1.0) == pytest.approx(1.0)
    assert fastest_Hz(1.6) == pytest.approx(1.6)


def test_still_s() -> None:
    """A bar that is held for half a second before it is let go is held long enough, or not."""
    held = [watch(Bar(released), 8.0, repeats=1, still_s=span_s) for span_s in (0.1, 0.4)]
    starts = [executor.points[0]["tick_start"] for executor in held]
    assert starts[1] > starts[0] + 200
    assert not watch(Bar(released), 8.0, repeats=1, still_s=1.5).points


def test_swing_max_s() -> None:
    """One that never fades ends when it has to."""

    def for_ever(t_s: float) -> float:
        return released(t_s) if t_s < 2.0 else 1.0 + 0.2 * float(np.cos(47 * (t_s - 2.0)))

    ends = [
        watch(Bar(for_ever), 12.0, repeats=1, swing_max_s=span_s).points[0]["tick_end"]
        for span_s in (1.0, 3.0)
    ]
    assert ends == pytest.approx([3000, 5000], abs=60)


def test_coast_s() -> None:
    config = load()

    def marked(coast_s: float) -> int:
        plan = build("inertia-acceleration", config, {"repeats": 1, "coast_s": coast_s})
        [point] = run_plan(VirtualBench(config, seed=2), plan, lambda *_: None)[:1]
        return int(point["tick_end"] - point["tick_start"])

    assert marked(0.9) - marked(0.3) == pytest.approx(600, abs=40)


def test_move_s() -> None:
    config = load()
    short = {"turns": 1, "rests": 13, "hold_s": 0.2, "currents_A": [6.0]}
    slow, fast = (build("align", config, {**short, "move_s": s}).seconds for s in (0.3, 0.1))
    assert slow - fast == pytest.approx(2 * 0.2 * (14 + 13), rel=0.5)  # both ways: stops and lead


def test_again_alpha_and_again_beta_A() -> None:
    settings = {"again_alpha": (0.9, 1.0, 1.1111), "again_beta_A": (0.3, -0.1, -0.2)}
    plan = build("sensitivity", load(), {"again_torques_Nm": [2.0, 4.0], **settings})
    assert plan.points[-1].induced.gain == settings["again_alpha"]
    assert plan.points[-1].induced.offset_A == settings["again_beta_A"]


@pytest.mark.parametrize(
    "key",
    [
        *("stiffness_tolerance", "lever_tolerance", "mass_tolerance", "bar_tolerance"),
        "effective_mass_tolerance",
    ],
)
def test_tolerances_of_the_springs(key: str) -> None:
    own = load(packaged("inertia.toml")).plans.inertia_oscillation
    name = key.removesuffix("_tolerance")
    wider = OscillationConfig.model_validate(
        {**own.model_dump(), key: 3 * getattr(own, key) + 0.01}
    )
    assert getattr(SpringSetup.of(wider).tolerances, name) > getattr(
        SpringSetup.of(own).tolerances, name
    )


@pytest.mark.parametrize(
    ("key", "source"),
    [("gain_tolerance", "gain of the torque sensor"), ("highpass_tolerance", "its time constant")],
)
def test_tolerances_of_the_torque_sensor(key: str, source: str) -> None:
    config, data = load(), pushes(4, 6)

    def uncertainty(tolerance: float) -> float:
        settings = AccelerationConfig(**{key: tolerance})
        found = accelerate(named(data), 4096, config.torque_sensor, settings)
        return next(each.uncertainty for each in found.budget if each.source == source)

    assert uncertainty(0.2) > 10 * uncertainty(0.001)


def test_effective_mass() -> None:
    own = load(packaged("inertia.toml")).plans.inertia_oscillation
    found = {
        SpringSetup.of(own.model_copy(update={"effective_mass": way})).effective_mass
        for way in ("wave", "heavy")
    }
    assert found == {"wave", "heavy"}


def test_enable_timeout_s() -> None:
    """A drive that never gets ready trips the bench after this time, and not before."""

    def trip_after_s(timeout_s: float) -> float:
        bench = Bench(make_config(loop={"enable_timeout_s": timeout_s}))
        bench.feedback["inverter_status"] = 0
        bench.run(5)
        bench.ask(Request.ENABLE)
        ticks = 0
        while not bench.run().trip_bits:
            ticks += 1
            assert ticks < 5000
        assert bench.tick["first_trip"][0] == Trip.ENABLE_TIMEOUT
        return ticks * bench.period_ns * 1e-9

    assert trip_after_s(0.4) == pytest.approx(0.4, abs=0.005)
    assert trip_after_s(1.2) == pytest.approx(1.2, abs=0.005)
