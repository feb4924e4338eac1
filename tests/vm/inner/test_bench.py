"""Loop, supervisor's core and emulated devices over the kernel's CAN, which goes down in mid-run.

In virtual time (`tests.support.virtual_wire`), so at the limits of config/emulated.toml.
"""

import re
from pathlib import Path

import numpy as np

from motord.config import load
from motord.hal.can.base import REFUSED_MAX
from motord.schema import InverterStatus, State, Trip
from tests.contract.peers import SOCKETCAN
from tests.support.virtual_wire import on_the_wire
from tests.unit.emulate.benches import write_bench
from tests.vm.inner import interface

SOME_S = 0.2
DOWN_S = 1.5
"""More than the time after which the drive gives up its host."""


def write(folder: Path) -> Path:
    """Write a bench without brake and drive, on the kernel's CAN."""
    path = write_bench(folder)
    text = path.read_text().replace('driver = "modbus"', 'driver = "none"')
    text = text.replace('interface = "udp_multicast"', 'interface = "socketcan"')
    text = re.sub(r'channel = "239[^"]*"', f'channel = "{SOCKETCAN}"', text)
    text = re.sub(r"^(options|rig_patience_s) = .*\n", "", text, flags=re.MULTILINE)
    path.write_text(text)
    return path


def test_a_run_whose_bus_goes_down_and_up(tmp_path: Path) -> None:
    config = load(write(tmp_path))
    limit_ns = round(config.inverter.timeout_s * 1e9) + 10_000_000
    assert limit_ns < DOWN_S * 1e9
    with on_the_wire(config, tmp_path) as (service, loop):
        token = service.enabled()
        service.run_s(SOME_S, token)
        assert service.bench.state is State.ENABLED, service.messages()
        interface.down()
        down_ns = loop.world.now_ns
        service.run_s(DOWN_S, token)
        assert service.bench.state is State.TRIPPED
        interface.up()
        up_ns = loop.world.now_ns
        service.run_s(DOWN_S, token)  # LINK_ERRORS is a matter of the last second
        service.ask("reset", token=token)
        service.ask("enable", token=token)
        service.run_s(SOME_S, token)
        assert service.bench.state is State.ENABLED, service.messages()
        ticks, truth = loop.ticks, loop.world.truth
    period_ns = int(np.median(np.diff(ticks["t_ns"])))
    off = (ticks["inverter_status"] & InverterStatus.BUS_OFF) != 0
    found_ns = int(ticks["t_ns"][off][0]) - down_ns
    assert 0 < found_ns <= (REFUSED_MAX + 2) * period_ns  # so many commands were refused before
    assert not off[-1]
    assert (ticks["trip_bits"][off] & Trip.BUS_OFF).all()
    tripped = ticks[ticks["state"] == State.TRIPPED]
    assert Trip(int(tripped[0]["first_trip"])) is Trip.BUS_OFF
    states = [State(int(s)) for s in ticks["state"][np.flatnonzero(np.diff(ticks["state"])) + 1]]
    assert states.count(State.ENABLED) == 2
    # the drive, which gets no commands any more, switches off by itself
    on_ns = truth["t_ns"][truth["inverter_on"] == 1]
    assert on_ns[0] < down_ns
    assert not ((on_ns > down_ns + limit_ns) & (on_ns < up_ns)).any()
    assert on_ns[-1] > up_ns
