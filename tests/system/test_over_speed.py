"""A rotor that runs away on the wire, in virtual time: found and without current in 50 ms.

Real drivers, emulated inverter and board; samples and ticks at rates down to the lowest.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from motord.config import load
from motord.schema import State, Trip
from tests.support.virtual_wire import on_the_wire
from tests.system.test_shipped_limits import shipped
from tests.unit.emulate.benches import EMULATED

LIMIT_RAD_S = 15.0
TORQUE_NM = 2.0
"""More than the cogging torque: with no brake the rotor goes faster and faster."""
FOUND_NS = 50_000_000
NO_CURRENT_A = 0.05


@pytest.mark.parametrize(
    ("loop_Hz", "bridge_Hz"), [(1000, 100), (1000, 199), (1000, 1000), (200, 199), (100, 100)]
)
def test_a_rotor_that_runs_away_is_found_within_50_ms(
    tmp_path: Path, loop_Hz: int, bridge_Hz: int
) -> None:
    shipped(tmp_path, EMULATED)
    [path] = tmp_path.glob("*.toml")
    text = re.sub(r"^rate_Hz = .*$", f"rate_Hz = {loop_Hz}", path.read_text(), flags=re.M)
    text = re.sub(r"^overrun_ticks = .*$", "overrun_ticks = 50", text, flags=re.M)
    text = re.sub(r"^link_errors_per_s = .*$", "link_errors_per_s = 200", text, flags=re.M)
    text = re.sub(r"^rig_patience_s = .*\n", "", text, flags=re.M)  # no computer stalls here
    text = text.replace("[bridge]\n", f"[bridge]\nrate_Hz = {bridge_Hz}\n")
    limits = f"[limits]\ntrip_speed_rad_s = {LIMIT_RAD_S}\nencoder_jump_rad = 0.5\n"
    text = re.sub(r"^(trip_speed_rad_s|encoder_jump_rad) = .*\n", "", text, flags=re.M)
    path.write_text(text.replace("[limits]\n", limits))
    with on_the_wire(load(path), tmp_path) as (service, loop):
        token = service.enabled()
        service.ask("set", token=token, torque_Nm=TORQUE_NM)
        while service.bench.state is State.ENABLED:
            service.run_s(0.1, token)
        service.run_s(0.1, token)
        truth, ticks = loop.world.truth, loop.ticks
    trips = ticks[ticks["state"] == State.TRIPPED]
    assert Trip(int(trips[0]["first_trip"])) is Trip.OVER_SPEED
    crossed_ns = int(truth["t_ns"][np.abs(truth["speed_rad_s"]) > LIMIT_RAD_S][0])
    largest_A = np.max([np.abs(truth[f"i_{phase}_A"]) for phase in "abc"], axis=0)
    before = largest_A[truth["t_ns"] <= crossed_ns]
    assert before[-1] > NO_CURRENT_A  # it was driven there
    powered_ns = truth["t_ns"][(largest_A > NO_CURRENT_A) & (truth["t_ns"] > crossed_ns)]
    assert int(powered_ns[-1]) - crossed_ns <= FOUND_NS
