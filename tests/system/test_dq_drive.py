"""The core of the daemon and emulated devices with a drive that takes d and q, in virtual time."""

import re
from pathlib import Path

import numpy as np
import pytest

from motord.config import load
from motord.schema import State
from tests.support.virtual_wire import on_the_wire
from tests.unit.emulate.benches import EMULATED, write_bench

DQ = EMULATED.with_name("dq.toml")
OWN_AXES = 'direction = -1\nd_axis_rad = 0.6\nscale = 1.2247\nangle = "turning"\n'
DRAG = {"viscous_Nm_s_per_rad": "0.6"}
"""In the place of a brake: 3 Nm turn the rotor at 5 rad/s."""
TORQUE_NM = 3.0


def write_dq_bench(folder: Path, axes: str) -> Path:
    """Write config/dq.toml without brake and external drive, and a drive with axes of its own."""
    path = write_bench(folder, source=DQ, rig=DRAG)
    text = path.read_text().replace('driver = "modbus"', 'driver = "none"')
    text = text.replace('interface = "udp_multicast"', 'interface = "virtual"')
    text = re.sub(r'channel = "[\d.]+"', f'channel = "{folder}"', text)
    text = re.sub(r"^(options|rig_patience_s) = .*\n", "", text, flags=re.M)
    start = text.index("\n", text.index("[inverter.dq]")) + 1
    end = text.index("\n[", start)
    path.write_text(text[:start] + axes + text[end:])
    return path


@pytest.mark.parametrize("axes", ["", OWN_AXES], ids=["default", "own-axes"])
def test_torque_and_currents_by_d_and_q(tmp_path: Path, axes: str) -> None:
    config = load(write_dq_bench(tmp_path, axes))
    with on_the_wire(config, tmp_path) as (service, loop):
        token = service.enabled()
        service.ask("set", token=token, torque_Nm=TORQUE_NM)
        service.run_s(2.0, token)
        assert service.bench.state is State.ENABLED, service.messages()
        ticks, truth = loop.ticks, loop.world.truth
    last_ns = int(ticks["t_ns"][-1])
    during = ticks[ticks["t_ns"] > last_ns - 1_000_000_000]
    sensed_ns = during["t_ns"] - during["i_age_ns"]
    then = truth[(truth["t_ns"] > sensed_ns[0]) & (truth["t_ns"] < sensed_ns[-1])]
    assert np.mean(then["speed_rad_s"]) > 4.0
    # without a calibration the phases' errors stand; their mean gain is 1.012
    assert np.mean(then["torque_em_Nm"]) == pytest.approx(TORQUE_NM * 1.012, rel=0.04)
    # what is recorded are phase currents: those that flow, but for the sensors' errors
    for phase, alpha, beta_A in (("a", 0.8, 1.0), ("b", 1.118, -0.5), ("c", 1.118, -0.5)):
        sensed_A = np.interp(then["t_ns"], sensed_ns, during[f"i_{phase}_A"])
        likely_A = alpha * sensed_A + beta_A
        assert np.corrcoef(likely_A, then[f"i_{phase}_A"])[0, 1] > 0.97
    assert np.abs(during["i_a_A"] + during["i_b_A"] + during["i_c_A"]).max() < 1e-4
