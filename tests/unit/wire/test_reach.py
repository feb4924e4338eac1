"""A drive whose signals do not reach the limits of its bench is refused."""

import math
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from motord.config import CanBusConfig, ChannelConfig, Config, ConfigError, load, packaged
from motord.hal.channels.can import CanChannel, ListeningPort
from motord.hal.inverter.can_drive import CanInverter
from motord.wire.can import dbc, reach

ROOT = Path(__file__).parents[3] / "config"
EMULATED, DQ = load(ROOT / "emulated.toml"), load(ROOT / "dq.toml")
BRIDGE = {"driver": "can", "can": {"interface": "udp_multicast", "channel": "239.74.163.2"}}


def check(config: Config, dbc_path: Path | None = None, **signals: Any) -> None:
    can = config.inverter.can
    assert can is not None
    can = can.model_copy(
        update={
            "dbc": dbc_path or can.dbc,
            "signals": type(can.signals).model_validate(can.signals.model_dump() | signals),
        }
    )
    inverter = config.inverter.model_copy(update={"can": can})
    config = config.model_copy(update={"inverter": inverter})
    reach.check(dbc.load(can), config)


def limited(config: Config = EMULATED, **limits: float) -> Config:
    return config.model_copy(update={"limits": config.limits.model_copy(update=limits)})


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ({"current_A": 65.534, "trip_current_A": 65.53}, ""),
        ({"current_A": 65.54}, "holds -65.536 to 65.534"),
        ({"current_A": 0.099}, "in steps of 0.00198 at most"),
        ({"trip_current_A": 65.534}, "trip_current_A could never trip"),
        ({"trip_temperature_C": 300.0}, "trip_temperature_C could never trip"),
        ({"bus_V_max": 327.675}, "bus_V_min to bus_V_max could never trip"),
        ({"bus_V_min": 0.0}, ""),
    ],
)
def test_limits_at_the_end_of_a_signal(limits: dict[str, float], says: str) -> None:
    if not says:
        check(limited(**limits))
        return
    with pytest.raises(ConfigError, match=says):
        check(limited(**limits))


@pytest.mark.parametrize("scale", [0.001, 0.01, 0.7071, 1.0, 2.0, 10.0, 1e6])
def test_the_unit_of_a_drive_with_axes_counts(scale: float) -> None:
    """The drive has 65.534 units for a command along one axis, 81.91 for feedback."""
    inverter = DQ.inverter
    dq = inverter.dq.model_copy(update={"scale": scale})
    config = DQ.model_copy(update={"inverter": inverter.model_copy(update={"dq": dq})})
    limits = config.limits
    fits = 0.002 / reach.STEP_MAX <= scale * limits.current_A * 2 / math.sqrt(3) <= 65.534
    if fits and scale * limits.trip_current_A < 81.91:
        check(config)
        return
    with pytest.raises(ConfigError, match=r"current_A"):
        check(config)


def with_cycles(folder: Path, **cycles_ms: int) -> Path:
    """Return the emulated drive's DBC with how often its messages come."""
    text = packaged("inverter.dbc").read_text()
    identifiers = {"PhaseFeedback": 384, "InverterStatus": 385}
    lines = [
        'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;',
        'BA_DEF_DEF_ "GenMsgCycleTime" 0;',
        *(f'BA_ "GenMsgCycleTime" BO_ {identifiers[n]} {ms};' for n, ms in cycles_ms.items()),
    ]
    path = folder / "cycles.dbc"
    path.write_text(text + "\n".join(lines) + "\n")
    return path


def timed(slow_stale_after_s: float, stale_after_s: float, enable_timeout_s: float) -> Config:
    inverter = EMULATED.inverter
    assert inverter.can is not None
    can = inverter.can.model_copy(update={"slow_stale_after_s": slow_stale_after_s})
    inverter = inverter.model_copy(update={"can": can, "stale_after_s": stale_after_s})
    loop = EMULATED.loop.model_copy(update={"enable_timeout_s": enable_timeout_s})
    return EMULATED.model_copy(update={"inverter": inverter, "loop": loop})


@pytest.mark.parametrize(
    ("cycles_ms", "times_s", "says"),
    [
        ({}, (0.001, 0.02, 0.05), ""),
        ({"InverterStatus": 100}, (0.2, 0.02, 0.22), ""),
        ({"InverterStatus": 0}, (0.001, 0.02, 0.05), ""),
        ({"InverterStatus": 100}, (0.199, 0.02, 1.0), r"slow_stale_after_s = 0.199 .* least 0.2$"),
        ({"InverterStatus": 100}, (0.01, 0.02, 1.0), r"slow_stale_after_s = 0.01 .* least 0.2$"),
        ({"InverterStatus": 100}, (0.2, 0.02, 0.219), r"enable_timeout_s = 0.219 .* least 0.22$"),
        (
            {"InverterStatus": 300},
            (0.5, 0.02, 1.0),
            "drive is well: have .* states that$",
        ),
        ({"PhaseFeedback": 1}, (0.5, 0.001, 1.0), ""),
        ({"PhaseFeedback": 10}, (0.5, 0.02, 1.0), ""),
        ({"PhaseFeedback": 11}, (0.5, 0.02, 1.0), r"\[inverter\] stale_after_s .* least 0.022$"),
    ],
)
def test_a_drive_that_sends_as_often_as_its_dbc_states_is_not_stale(
    tmp_path: Path,
    cycles_ms: dict[str, int],
    times_s: tuple[float, float, float],
    says: str,
) -> None:
    path = with_cycles(tmp_path, **cycles_ms)
    if not says:
        check(timed(*times_s), path)
        return
    with pytest.raises(ConfigError, match=says):
        check(timed(*times_s), path)


@pytest.mark.parametrize(
    ("attribute", "cycle_s"),
    [
        (('BA_DEF_ BO_ "GenMsgCycleTime" INT 0 9;', 'BA_DEF_DEF_ "GenMsgCycleTime" 100;'), 0.0),
        (('BA_DEF_ BO_ "GenMsgCycleTime" STRING ;', 'BA_ "GenMsgCycleTime" BO_ 384 "100";'), 0.1),
        (('BA_DEF_ BO_ "GenMsgCycleTime" STRING ;', 'BA_ "GenMsgCycleTime" BO_ 384 "?";'), 0.0),
        (('BA_DEF_ BO_ "GenMsgCycleTime" INT 0 9;', 'BA_ "GenMsgCycleTime" BO_ 384 100;',
          'BA_DEF_ BO_ "GenMsgSendType" ENUM "Cyclic","OnRequest";',
          'BA_ "GenMsgSendType" BO_ 384 1;'), 0.0),
    ],
)  # fmt: skip
def test_a_cycle_is_what_a_cyclic_message_states_of_itself(
    tmp_path: Path, attribute: tuple[str, ...], cycle_s: float
) -> None:
    path = tmp_path / "drive.dbc"
    path.write_text(packaged("inverter.dbc").read_text() + "\n".join(attribute) + "\n")
    assert dbc.signal_codec(path, "PhaseFeedback.CurrentA").cycle_s == pytest.approx(cycle_s)


@pytest.mark.parametrize(("cycle_ms", "fits"), [(0, True), (100, True), (101, False)])
def test_a_channel_waits_for_as_long_as_its_dbc_states(
    tmp_path: Path, cycle_ms: int, fits: bool
) -> None:
    """It is read every 0.1 s, and a frame may be lost."""
    path, bus = with_cycles(tmp_path, InverterStatus=cycle_ms), CanBusConfig(channel="none")
    source = {"driver": "can", "dbc": path, "signal": "InverterStatus.Temperature", "bus": bus}
    times = {"rate_Hz": 10.0, "timeout_s": 0.3}
    given = {"name": "t_C", "unit": "degC", "source": source, **times}
    channel = ChannelConfig.model_validate(given)
    if fits:
        CanChannel(channel, ListeningPort(bus))
        return
    with pytest.raises(ConfigError, match=r"timeout_s = 0.3 would be over .* at least 0.302"):
        CanChannel(channel, ListeningPort(bus))


@pytest.mark.parametrize(("on", "off"), list(product((1, 2), (0, 3))))
def test_a_value_that_enables_or_disables_fits_its_signal(on: int, off: int) -> None:
    """Of one bit: 3, saturated, would enable."""
    values = {"command_enable_value": on, "command_disable_value": off}
    if (on, off) == (1, 0):
        check(EMULATED, **values)
        return
    with pytest.raises(ConfigError, match="must be within 0 to 1"):
        check(EMULATED, **values)


@pytest.mark.parametrize("name", ["ready", "fault", "timeout", "enable_line"])
def test_a_mask_beyond_the_status_word_is_refused(name: str) -> None:
    check(EMULATED, **{f"status_{name}_mask": 1 << 15})
    with pytest.raises(ConfigError, match=f"status_{name}_mask = 65536 has bits beyond the 16"):
        check(EMULATED, **{f"status_{name}_mask": 1 << 16})


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("Status : 32|16@1+ (1,0)", "Status : 32|16@1+ (2,0)", "must be an integer"),
        ("Enable : 48|1@1+ (1,0)", "Enable : 48|1@1+ (1,1)", "must be an integer"),
        ("BusVoltage : 0|16@1+ (0.005,0)", "BusVoltage : 0|16@1+ (0,0)", "a factor of 0"),
        ("BusVoltage : 0|16@1+ (0.005,0) [0|327.675]",
         "BusVoltage : 0|16@1+ (0.005,20) [0|0]", "could never trip"),
    ],
)  # fmt: skip
def test_signals_that_cannot_be_used(tmp_path: Path, old: str, new: str, says: str) -> None:
    text = packaged("inverter.dbc").read_text()
    assert old in text
    path = tmp_path / "drive.dbc"
    path.write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=says):
        check(EMULATED, path)


def test_a_float_of_a_width_that_there_is_none_of(tmp_path: Path) -> None:
    text = packaged("inverter.dbc").read_text().replace("BusVoltage : 0|16", "BusVoltage : 0|12")
    path = tmp_path / "drive.dbc"
    path.write_text(text + "\nSIG_VALTYPE_ 385 BusVoltage : 1;\n")
    with pytest.raises(ConfigError, match="floating-point number of 12 bits"):
        check(EMULATED, path)


def test_a_constant_beyond_its_signal() -> None:
    with pytest.raises(ConfigError, match="Profile = 16 is beyond 0 to 15"):
        check(DQ, command_constants={"DqCommand.Profile": 16.0})


@pytest.mark.parametrize(
    ("identifiers", "canopen", "says"),
    [
        ({}, {}, ""),
        ({"host_id": 0x100}, {}, "host_id = 0x100 is that of CurrentCommand"),
        ({"board_id": 0x181}, {}, "board_id = 0x181 is that of InverterStatus"),
        ({"host_id": 0}, {"start_node": 5}, "that of NMT"),
        ({"host_id": 0x80}, {"sync": True}, "that of SYNC"),
        ({"board_id": 0x702}, {"heartbeat_node": 2}, "that of the heartbeat"),
        ({"host_id": 0x100, "channel": "239.74.163.3"}, {}, ""),
    ],
)
def test_a_bridge_on_the_bus_of_the_drive_has_identifiers_of_its_own(
    identifiers: dict[str, Any], canopen: dict[str, Any], says: str
) -> None:
    content = EMULATED.model_dump(exclude={"plans"}) | {
        "bridge": BRIDGE | {"can": BRIDGE["can"] | {"bitrate": 8_000_000} | identifiers}
    }
    content["bridge"] |= {"stale_after_s": 1.0, "heartbeat_timeout_s": 1.0}
    content["inverter"]["can"]["canopen"] = canopen
    config = Config.model_validate(content)
    if not says:
        CanInverter(config)
        return
    with pytest.raises(ConfigError, match=says):
        CanInverter(config)
