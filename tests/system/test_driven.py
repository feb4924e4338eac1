"""Cogging and back-EMF over the wires: drive by Modbus, voltages by CAN, encoder by serial line."""

from pathlib import Path

import numpy as np
import pytest

from motord.config import load
from motord.experiments.back_emf.command import estimate as measured_back_emf
from motord.experiments.cogging.command import estimate as measured_cogging
from motord.experiments.subject import Recordings
from tests.support.patience import until
from tests.system.daemons import daemon, emulator, forgive, patient, stalls_from_now
from tests.unit.emulate.benches import write_bench

pytestmark = [pytest.mark.system, pytest.mark.long]


def run_plan(client, name, **settings):
    """Run a plan to its end; return its recording."""
    with client.lease("anna") as lease:
        while True:
            kept = stalls_from_now(client)
            client.rpc("reset", token=lease.token)
            view = client.rpc("plan/start", token=lease.token, name=name, settings=settings)
            until(lambda: client.state().plan.over, name)
            done = client.state()
            if done.plan.state == "done":
                return view["recording"]
            assert done.state == "TRIPPED", done.plan.message
            forgive(client, kept)


def test_a_driven_rotor_on_the_wire(tmp_path):
    bench = write_bench(tmp_path)
    text = patient(bench.read_text(), "wire", 500).replace(
        "[drive]\n", "[drive]\nstale_after_s = 5.0\n"
    )
    bench.write_text(text)
    truth = tmp_path / "truth.mcap"
    with emulator(tmp_path, bench, truth), daemon(tmp_path, bench) as running:
        with running.connect() as client:
            emf = run_plan(client, "back-emf", speeds_Hz=[0.8, 1.2], turns=5, settle_s=0.5)
            cogging = run_plan(client, "cogging", speeds_Hz=[0.8], turns=5, settle_s=0.5)
        assert running.end() == 0, running.said()
    found = measured_back_emf(Recordings.open([Path(emf)]))
    configured = load(bench).motor.back_emf_table()
    assert np.abs(found.table() - configured).max() < 0.06 * 0.206
    measured = measured_cogging(Recordings.open([Path(cogging)]))
    place = int(np.flatnonzero(measured.order == 48)[0])
    assert measured.amplitude_Nm[place] == pytest.approx(0.33, rel=0.1)
    assert measured.phase_rad[place] == pytest.approx(0.3, abs=0.2)
