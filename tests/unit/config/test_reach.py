"""No accepted number makes a limit that is never passed, or a set-point beyond it."""

from itertools import product
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from motord.config import ChannelConfig, Config, Finite, ModbusConfig, NonNegative, Positive
from motord.config.devices.slow_devices import BrakeConfig, DriveConfig, register_counts
from motord.hal.modbus import devices
from motord.sequencing.limits import PlanError, check_drive
from motord.wire.modbus.registers import layout
from tests.unit.hal.test_modbus import MOTOR

KINDS = ("u16", "i16", "u32", "i32")
SCALES = (1e-12, 1e-9, 1e-5, 1.5e-5, 1e-4, 1e-3, 0.015, 0.02, 0.3, 0.5, 7.0, 1e6)


def bench(**tables: Any) -> Config:
    return Config.model_validate({"motor": MOTOR, **tables})


def slow(name: str, modbus: dict[str, Any], **section: Any) -> Config:
    modbus = {"watchdog_s": 0.2} | modbus
    return bench(**{name: {"driver": "modbus", "modbus": modbus, **section}})


@pytest.mark.parametrize("name", ["brake", "drive"])
def test_every_set_point_can_be_written_and_none_is_beyond_its_limit(name: str) -> None:
    accepted = 0
    for kind, scale, most in product(KINDS, SCALES, (1e-3, 0.5, 15.0, 1e4)):
        section = {"speed_max_rad_s": most} if name == "drive" else {}
        try:
            config = slow(name, {"setpoint_kind": kind, "setpoint_scale": scale}, **section)
        except ValidationError:
            continue
        accepted += 1
        device = getattr(devices, name)(config)
        register = device._layout.setpoint
        for end in (device._low, device._high):
            written = register.decode(register.encode(end))
            assert abs(written - end) <= 0.01 * device._high
    assert 0 < accepted < 4 * 12 * 4


@given(kind=st.sampled_from(KINDS), scale=st.floats(1e-6, 10), hottest_C=st.floats(-100, 1000))
def test_a_brake_that_is_too_hot_can_say_so(kind: Any, scale: float, hottest_C: float) -> None:
    modbus = {"value_kind": kind, "value_scale": scale}
    try:
        config = slow("brake", modbus, temperature_max_C=hottest_C)
    except ValidationError:
        assert register_counts(kind)[1] * scale <= hottest_C + 10.0
        return
    assert config.brake.modbus is not None
    value = layout(config.brake.modbus).value
    assert value.decode(value.encode(1e9)) > config.brake.trip_temperature_C


@given(
    kind=st.sampled_from(KINDS),
    scale=st.floats(-10, 10).filter(bool),
    offset=st.floats(-1000, 1000),
    above=st.none() | st.floats(-1e6, 1e6),
    below=st.none() | st.floats(-1e6, 1e6),
)
def test_a_channel_can_pass_its_trip_limits(
    kind: Any, scale: float, offset: float, above: float | None, below: float | None
) -> None:
    ends = sorted(offset + scale * count for count in register_counts(kind))
    if above is not None and below is not None and below >= above:
        above = None
    content = {
        "name": "a", "unit": "", "scale": scale, "offset": offset,
        "trip_above": above, "trip_below": below,
        "source": {"driver": "modbus", "address": 0, "kind": kind},
    }  # fmt: skip
    reached = (above is None or above < ends[1]) and (below is None or below > ends[0])
    if reached:
        ChannelConfig.model_validate(content)
    else:
        with pytest.raises(ValidationError, match="it could never trip at trip_"):
            ChannelConfig.model_validate(content)


@pytest.mark.parametrize("model", [BrakeConfig, DriveConfig])
def test_a_slow_device_that_is_silent_is_missed(model: Any) -> None:
    model.model_validate({"poll_s": 5.0, "stale_after_s": 10.0})
    with pytest.raises(ValidationError, match="less than or equal to 10"):
        model.model_validate({"stale_after_s": 10.1})


@pytest.mark.parametrize(
    ("kind", "value", "accepted"),
    [
        (Positive, 1e-12, True), (Positive, 1e-13, False), (Positive, 5e-324, False),
        (Positive, 1e12, True), (Positive, 1e13, False), (Positive, 1.7e308, False),
        (NonNegative, 0.0, True), (NonNegative, 1e13, False), (NonNegative, -1.0, False),
        (Finite, -1e12, True), (Finite, -1e13, False), (Finite, float("nan"), False),
    ],
)  # fmt: skip
def test_quantities_leave_room_to_calculate(kind: Any, value: float, accepted: bool) -> None:
    if accepted:
        assert TypeAdapter(kind).validate_python(value) == value
        return
    with pytest.raises(ValidationError):
        TypeAdapter(kind).validate_python(value)


@pytest.mark.parametrize(
    "inverter",
    [{"feedback_age_s": 1.01}, {"dq": {"angle_age_s": 0.021}}],
)
def test_an_age_beyond_what_is_stale_is_refused(inverter: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match="less than or equal"):
        bench(inverter=inverter)


def test_the_packaged_defaults_of_a_drive_are_not_those_of_a_brake() -> None:
    with pytest.raises(ValidationError, match=r"drive.modbus.*it takes 0 to 15 .*speed_max_rad_s"):
        slow("drive", ModbusConfig().model_dump() | {"watchdog_s": 0.2})


@pytest.mark.parametrize(("kind", "backwards"), [("u16", False), ("i16", True), ("u32", False)])
def test_a_drive_without_a_sign_turns_one_way(kind: str, backwards: bool) -> None:
    config = slow("drive", {"setpoint_kind": kind, "setpoint_scale": 0.001})
    check_drive(config, 1.0)
    assert devices.drive(config)._low == (-15.0 if backwards else 0.0)
    if backwards:
        check_drive(config, -1.0)
        return
    with pytest.raises(PlanError, match="one way only"):
        check_drive(config, -1.0)
