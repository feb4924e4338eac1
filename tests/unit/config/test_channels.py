"""`[[channels]]`: what is refused, by which words and in which line, and what of it can be kept."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from motord.config import ChannelConfig, Config, ConfigError, load, packaged
from motord.config.channel_sources import OtherSource
from motord.config.timing import INTERVALS_MIN, SLOW_SILENCE_MAX_S, SUPERVISOR_ACTS_S

SIMULATED = {"driver": "simulated"}
MODBUS = {"driver": "modbus", "address": 1}
SERIAL = {"driver": "serial", "port": "/dev/ttyX", "pattern": "T=(.*)"}


def channel(**values: Any) -> dict[str, Any]:
    return {"name": "winding_C", "unit": "degC", "source": SIMULATED, **values}


def bench(*channels: dict[str, Any], **tables: dict[str, Any]) -> Config:
    content = load().model_dump()
    for table, values in tables.items():
        content[table] |= values
    return Config.model_validate({**content, "channels": list(channels)})


REFUSED = [
    ({"name": "2nd"}, "takes letters, digits and _, at most 48"),
    ({"name": "torque_Nm"}, "torque_Nm is a field of the tick"),
    ({"scale": 0.0}, "scale = 0"),
    ({"rate_Hz": 20.1}, "less than or equal to 20"),
    ({"timeout_s": 1.9}, "timeout_s = 1.9 is too short.* make it at least 2, or raise rate_Hz"),
    ({"frozen_after_s": 1.9}, "two readings may be alike; make it at least 2, or raise rate_Hz"),
    ({"rate_Hz": 0.15, "trip_above": 1.0}, "one reading may be lost; raise rate_Hz"),
    ({"timeout_s": 9.5, "trip_above": 1.0}, "would trip within 10.55 s only.* at most 10 s"),
    ({"trip_above": 1.0, "warn_above": 1.0}, "trip_above = 1 must be above warn_above = 1"),
    ({"valid_max": 1.0, "trip_above": 2.0}, "valid_max = 1 must be above trip_above = 2"),
    ({"valid_min": 1.0, "trip_below": 1.0}, "trip_below = 1 must be above valid_min"),
    ({"warn_below": 5.0, "warn_above": 4.0}, "warn_above = 4 must be above warn_below"),
    ({"role": "winding", "unit": "K"}, 'role = "winding" is a temperature: unit = "degC"'),
    ({"role": "oil"}, "'winding' or 'magnet'"),
    ({"source": {"driver": "modbus"}}, "address"),
    ({"source": {**MODBUS, "transport": "rtu"}}, 'transport = "rtu" needs serial_port'),
    ({"source": {**SERIAL, "pattern": "T=.*"}}, "needs a group around the number"),
    ({"source": {**SERIAL, "pattern": "(?P<a>.)(?P<b>.)"}}, "needs a group around the number"),
    ({"source": {**SERIAL, "pattern": "("}}, "not a regular expression"),
    ({"source": {**SIMULATED, "quantity": "oil_C"}}, "winding_C"),
    (
        {"source": {"driver": "can", "dbc": "a.dbc", "signal": "A"}},
        "takes Message.Signal, with one",
    ),
    ({"source": {"driver": "acme", "host": "x"}}, "Extra inputs"),
    ({"source": {"driver": "../acme"}}, "takes letters, digits, _, . and -"),
]


@pytest.mark.parametrize(("values", "message"), REFUSED)
def test_a_channel_that_cannot_be_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        bench(channel(**values))


CAN = {"driver": "can", "dbc": "a.dbc", "signal": "A.B"}
RTU = {**MODBUS, "transport": "rtu", "serial_port": "/dev/ttyX"}
TOGETHER = [
    ([channel(), channel()], "the name winding_C is there twice"),
    (
        [channel(source=RTU), channel(name="b", source={**RTU, "baud": 9600})],
        "winding_C.* and b share /dev/ttyX and say differently",
    ),
    (
        [channel(source=SERIAL), channel(name="b", source={**SERIAL, "request": "?"})],
        "share /dev/ttyX",
    ),
    (
        [
            channel(
                source={**CAN, "bus": {"interface": "slcan", "channel": "x", "bitrate": 500000}}
            ),
            channel(name="b", source={**CAN, "bus": {"interface": "slcan", "channel": "x"}}),
        ],
        r"share slcan x and say differently how it is set up \(bus, ",
    ),
    (
        [
            channel(source={**MODBUS, "timeout_s": 0.8}, trip_above=1.0),
            *(channel(name=f"b{n}", source={**MODBUS, "timeout_s": 0.8}) for n in range(2)),
        ],
        r"channels\[0\] \"winding_C\" has a trip limit.* all readings of 127.0.0.1:502 if nothing "
        r"answers \(2.4 s\).* at least 3.4",
    ),
    (
        [channel(source={"driver": "acme", "timeout_s": 2.5}, trip_above=1.0)],
        r"all readings of winding_C if nothing answers \(2.5 s\)",
    ),
    (
        [channel(source=CAN)],
        r"there is no \[inverter.can\]",
    ),
]


@pytest.mark.parametrize(("channels", "message"), TOGETHER)
def test_channels_that_do_not_go_together(channels: list[dict[str, Any]], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        bench(*channels)


def test_bit_rates_of_a_bus_of_the_kernel_need_not_agree_as_none_is_set() -> None:
    buses = {"interface": "socketcan", "channel": "can1"}, {"channel": "can1", "bitrate": 500000}
    ours = [
        channel(name=name, source={**CAN, "bus": bus})
        for name, bus in zip("ab", buses, strict=True)
    ]
    assert len(bench(*ours).channels) == 2


def test_ports_and_rigs_that_the_bench_has_itself() -> None:
    text = (Path(__file__).parents[3] / "config" / "emulated.toml").read_text()
    for source, message in (
        ('{driver = "simulated"}', "needs a rig that is simulated in the loop"),
        (
            '{driver = "serial", port = "/tmp/motord-emulated-bridge", pattern = "(.*)"}',
            "is the port of the bridge, which another process has open",
        ),
    ):
        with pytest.raises(ConfigError, match=message):
            parsed(text, f'[[channels]]\nname = "a"\nunit = ""\nsource = {source}\n')


def parsed(text: str, more: str, folder: Path | None = None) -> Config:
    from motord.config.reading import check_text

    return check_text((folder or packaged("sim.toml").parent) / "bench.toml", f"{text}\n{more}")


def test_the_line_of_what_is_wrong_is_named_and_files_lie_next_to_the_bench() -> None:
    text = packaged("sim.toml").read_text()
    line = text.count("\n") + 7
    with pytest.raises(ConfigError, match=rf"bench.toml:{line}: channels\[1\].source.adress: unk"):
        parsed(
            text,
            '[[channels]]\nname = "a"\nunit = ""\nsource = {driver = "simulated"}\n'
            '[[channels]]\nsource = {driver = "modbus", adress = 1}\n',
        )
    found = parsed(
        (Path(__file__).parents[3] / "config" / "emulated.toml").read_text(),
        '[[channels]]\nname = "a"\nunit = ""\n'
        'source = {driver = "can", dbc = "package:inverter.dbc", signal = "A.B"}\n',
    )
    assert found.channels[0].source.model_dump()["dbc"] == packaged("inverter.dbc")


def test_drivers_of_other_packages_are_taken_by_name() -> None:
    source = bench(channel(source={"driver": "acme", "settings": {"a": [1]}})).channels[0].source
    assert isinstance(source, OtherSource)
    assert source.settings == {"a": [1]}
    assert source.read_s == source.timeout_s == 1.0


@given(
    rate_Hz=st.floats(0.001, 20),
    timeout_s=st.floats(0.001, 3600),
    trip_above=st.none() | st.floats(-1e6, 1e6),
    frozen_after_s=st.none() | st.floats(0.001, 1e4),
)
def test_what_is_accepted_keeps_its_time(
    rate_Hz: float, timeout_s: float, trip_above: float | None, frozen_after_s: float | None
) -> None:
    values = {"rate_Hz": rate_Hz, "timeout_s": timeout_s, "trip_above": trip_above}
    content = channel(**values, frozen_after_s=frozen_after_s)
    too_slow = trip_above is not None and 1 / rate_Hz + timeout_s + SUPERVISOR_ACTS_S > 10.0
    shortest_s = min(timeout_s, frozen_after_s or timeout_s)
    if too_slow or shortest_s < INTERVALS_MIN / rate_Hz:
        with pytest.raises(ValidationError, match=r"too short|would trip within|shorter than two"):
            ChannelConfig.model_validate(content)
        return
    made = ChannelConfig.model_validate(content)
    assert made.timeout_s >= INTERVALS_MIN * made.period_s
    assert made.trips == (trip_above is not None)
    assert not made.trips or made.trip_s <= SLOW_SILENCE_MAX_S
    assert ChannelConfig.model_validate(made.model_dump()) == made


DERATED = {"i2t_derating_from_C": 80.0, "i2t_derating_to_C": 120.0}
WINDING = {"role": "winding", "trip_above": 130.0}
LIMITS_REFUSED = [
    (DERATED, [channel()], 'no channel measures the winding.*role = "winding"'),
    (DERATED, [channel(role="magnet", trip_above=1.0)], "no channel measures the winding"),
    (DERATED, [channel(role="winding")], r'channels\[0\] "winding_C" has no trip_above'),
    (
        DERATED,
        [channel(**WINDING), channel(name="b", role="winding", trip_below=1.0)],
        r'channels\[1\] "b" has no trip_above',
    ),
    ({"i2t_derating_from_C": 80.0}, [channel(**WINDING)], "go together"),
    ({"i2t_derating_to_C": 80.0}, [channel(**WINDING)], "go together"),
    (DERATED | {"i2t_derating_to_C": 80.0}, [channel(**WINDING)], "= 80 must be above"),
    ({}, [channel(role="magnet"), channel(name="b", role="magnet")], "winding_C and b"),
]


@pytest.mark.parametrize(("limits", "channels", "message"), LIMITS_REFUSED)
def test_a_derating_that_cannot_be_is_refused(limits, channels, message) -> None:
    with pytest.raises(ValidationError, match=message):
        bench(*channels, limits=limits)


@pytest.mark.parametrize("key", ["back_emf_temperature_percent_per_K", "back_emf_reference_C"])
def test_a_temperature_coefficient_and_its_reference_go_together(key: str) -> None:
    with pytest.raises(ValidationError, match="go together"):
        bench(motor={key: -0.1})
    both = {"back_emf_temperature_percent_per_K": -0.1, "back_emf_reference_C": 20.0}
    assert bench(motor=both).motor.back_emf_reference_C == 20.0
