"""Daemon and emulated devices with a drive that takes d and q."""

import numpy as np
import pytest

from tests.system.daemons import daemon, emulator, patient
from tests.system.test_wire import Wire, hold
from tests.unit.emulate.benches import DRAG_NM_S_PER_RAD, EMULATED, write_bench

pytestmark = [pytest.mark.system, pytest.mark.slow]

PERIOD_NS = 2_000_000
COMPARED = 300
"""Samples between ticks of which none was missed, at least."""
DQ = EMULATED.with_name("dq.toml")
OWN_AXES = 'direction = -1\nd_axis_rad = 0.6\nscale = 1.2247\nangle = "turning"\n'


def write_dq_bench(folder, axes):
    """Write config/dq.toml with ports of its own and a drive with axes of its own."""
    path = write_bench(folder, source=DQ, drag_Nm_s_per_rad=DRAG_NM_S_PER_RAD)
    text = patient(path.read_text(), "dqwire")
    start = text.index("\n", text.index("[inverter.dq]")) + 1
    end = text.index("\n[", start)
    text = text[:start] + axes + text[end:]
    text = text.replace("[brake]\n", "[brake]\nstale_after_s = 5.0\n")
    path.write_text(text)
    return path


@pytest.fixture(params=["", OWN_AXES], ids=["default", "own-axes"])
def wire(tmp_path, request):
    bench = write_dq_bench(tmp_path, request.param)
    truth = tmp_path / "truth.mcap"
    with emulator(tmp_path, bench, truth) as devices, daemon(tmp_path, bench) as running:
        yield Wire(running, devices, truth)


def wait_for_ticks_in_a_row(client, count):
    """Wait until so many ticks came of which the one before was not missed."""
    in_a_row = 0
    with client.subscribe_ticks() as blocks:
        for block in blocks:
            in_a_row += int((np.diff(block["t_ns"].astype(np.int64)) <= 2 * PERIOD_NS).sum())
            if in_a_row >= count:
                return


def test_torque_and_speed_by_d_and_q(wire):
    with wire.daemon.connect() as client:
        with client.lease("anna") as lease:
            begun, _ = hold(client, lease, 3.0, 0.7, states_in_a_row=20)
            wait_for_ticks_in_a_row(client, 3 * COMPARED)
            held = client.state()
            client.rpc("disable", token=lease.token)
        client.rpc("stop")
    assert wire.daemon.end() == 0, wire.daemon.said()
    [run] = wire.daemon.runs()
    ticks = run.ticks()
    truth = wire.truth()
    then = (truth["t_ns"] > begun.tick.t_ns) & (truth["t_ns"] < held.tick.t_ns)
    assert then.sum() > COMPARED
    # without a calibration the phases' errors stand; their mean gain is 1.012
    assert np.mean(truth["torque_Nm"][then]) == pytest.approx(3.0 * 1.012, rel=0.04)
    # what is recorded are phase currents: those that flow, but for the sensors' errors
    during = ticks[(ticks["t_ns"] > begun.tick.t_ns) & (ticks["t_ns"] < held.tick.t_ns)]
    sensed_ns = during["t_ns"] - during["i_age_ns"]
    told = truth[then]["t_ns"]
    after = np.searchsorted(sensed_ns, told).clip(1, len(sensed_ns) - 1)
    near = sensed_ns[after] - sensed_ns[after - 1] <= 2 * PERIOD_NS  # no tick was missed there
    assert near.sum() > COMPARED
    for phase, alpha, beta_A in (("a", 0.8, 1.0), ("b", 1.118, -0.5), ("c", 1.118, -0.5)):
        sensed_A = np.interp(told[near], sensed_ns, during[f"i_{phase}_A"])
        likely_A = alpha * sensed_A + beta_A
        assert np.corrcoef(likely_A, truth[f"i_{phase}_A"][then][near])[0, 1] > 0.97
    assert np.abs(during["i_a_A"] + during["i_b_A"] + during["i_c_A"]).max() < 1e-4
