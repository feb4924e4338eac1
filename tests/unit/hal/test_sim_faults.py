"""Faults of the bench simulated in the loop: from the first read on, reported in bridge_status."""

from pathlib import Path

import numpy as np
import pytest

from motord import config
from motord.config import ConfigError
from motord.config.faults import Fault, Timeline
from motord.control.types import COMMAND, FEEDBACK
from motord.hal.sim.faults import NEVER_NS, SimFaults
from motord.hal.sim.rig import SimRig
from motord.rig.types import RIG_INPUT
from motord.schema import FAULT_COUNT_SHIFT, InverterStatus

T0_NS = 1_800_000_000_000_000_000
MS = 1_000_000


def test_faults_begin_and_end_counted_from_the_first_read(tmp_path: Path) -> None:
    (tmp_path / "t.toml").write_text(
        '[[fault]]\nkind = "inverter_hot"\nat_s = 0.01\nfor_s = 0.02\n'
        '[[fault]]\nkind = "inverter_fault"\nat_s = 0.02\nfor_s = 0.02\n'
    )
    data = config.load().model_dump()
    data["bench"]["faults"] = tmp_path / "t.toml"
    rig = SimRig(config.Config.model_validate(data))
    rig.open()
    feedback, command = np.zeros(1, FEEDBACK), np.zeros(1, COMMAND)
    hot, fault, counts = [], [], []
    for at_ms in range(60):
        rig.read(T0_NS + at_ms * MS, feedback)
        rig.write(command)
        f = feedback[0]
        hot += [at_ms] if f.temperature_C == 120.0 else []
        fault += [at_ms] if f.inverter_status & InverterStatus.FAULT else []
        counts.append(int(f.bridge_status) >> FAULT_COUNT_SHIFT)
    rig.close()
    assert (hot[0], hot[-1]) == (10, 29)
    assert (fault[0], fault[-1]) == (20, 39)
    assert counts == [0] * 10 + [1] * 10 + [2] * 40


def test_a_stall_sleeps_and_nothing_stays() -> None:
    slept: list[float] = []
    timeline = Timeline(fault=(Fault(kind="host_stall", at_s=0.01, for_s=0.03),))
    faults = SimFaults(timeline, np.zeros(1, RIG_INPUT), slept.append)
    faults.play(T0_NS)
    assert faults.due_ns == T0_NS + 10 * MS
    faults.play(T0_NS + 10 * MS)
    assert slept == [0.03]
    faults.play(T0_NS + 40 * MS)
    assert faults.due_ns == NEVER_NS
    assert faults.status_bits == 1 << FAULT_COUNT_SHIFT


def test_without_a_timeline_nothing_is_ever_due() -> None:
    assert SimFaults(Timeline(), np.zeros(1, RIG_INPUT)).due_ns == NEVER_NS


def test_faults_of_wires_need_wires() -> None:
    with pytest.raises(ConfigError, match="can_drop is not possible here, only in: emulate, virt"):
        SimFaults(Timeline(fault=(Fault(kind="can_drop"),)), np.zeros(1, RIG_INPUT))
