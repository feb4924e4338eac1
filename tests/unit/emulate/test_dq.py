"""The emulated drive that takes d and q."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motord.config import Config, load
from motord.control.park import DqFrame
from motord.emulate.bench import CurrentCommand, EmulatedBench
from motord.emulate.devices import Inverter
from motord.emulate.selection import check_drivers, inverter_values, is_fast
from motord.rig import truth as rig_truth
from motord.rig.build import with_drive
from motord.rig.truth import RigTruth
from motord.schema import TRUTH_DTYPE, InverterStatus
from motord.wire.can import dbc
from tests.unit.emulate.benches import EMULATED, beat

DQ = EMULATED.with_name("dq.toml")
MS = 1_000_000
COMMAND_A = (0.5, 6.0, 0.0)


def changed(dq: dict[str, Any] | None = None, **signals: Any) -> Config:
    content = load(DQ).model_dump()
    content["inverter"]["dq"] |= dq or {}
    content["inverter"]["can"]["signals"] |= signals
    return Config.model_validate(content)


def spun(config: Config, truth: RigTruth, duration_ms: int = 60) -> EmulatedBench:
    """Return a bench that was sent the same d and q every millisecond."""
    bench = EmulatedBench(config, truth, 0)
    bench.arrive(0, beat(0))
    for ms in range(duration_ms):
        bench.arrive(ms * MS, CurrentCommand(COMMAND_A, True))
        bench.arrive(ms * MS, beat(1))
        bench.advance((ms + 1) * MS, lambda _frame: None)
    return bench


def true_angle_rad(bench: EmulatedBench) -> float:
    row = np.zeros(1, TRUTH_DTYPE)
    bench.fill_truth(bench.now_ns, row[0])
    return float(row["angle_rad"][0])


def still_rig(**inverter: Any) -> RigTruth:
    """Return a rig that hardly turns, with exact current sensors."""
    return RigTruth.model_validate(
        {
            "motor": {"connection": "star"},
            "inverter": inverter,
            "rotor": {"inertia_kg_m2": 100.0, "angle_rad": 0.3},
        }
    )


@pytest.mark.parametrize("angle", ["turning", "latched"])
@pytest.mark.parametrize("axes", [{}, {"direction": -1, "d_axis_rad": 0.4, "scale": 0.7071}])
def test_commands_along_the_axes_give_currents_there(angle: str, axes: dict[str, Any]) -> None:
    config = changed({"angle": angle, **axes})
    bench = spun(config, still_rig())
    reading = bench.sense()
    assert (reading.i_d_A, reading.i_q_A) == pytest.approx((0.5, 6.0), abs=0.02)
    phases = DqFrame.of(config).from_drive(true_angle_rad(bench), 0.0, 0.5, 6.0)
    assert reading.i_sensed_A == pytest.approx(phases, abs=0.05)
    assert bench.inverter_status(reading) & InverterStatus.READY


def test_a_turning_drive_follows_the_rotor_between_commands() -> None:
    """One command, then none for long: the phases go on with the rotor; latched they stay."""
    angles, phases = [], []
    for kind in ("turning", "latched"):
        truth = RigTruth.model_validate(
            {
                "motor": {"connection": "star"},
                "rotor": {"inertia_kg_m2": 100.0, "speed_rad_s": 20.0},
            }
        )
        bench = spun(changed({"angle": kind}), truth)
        before = bench.sense().i_sensed_A.copy()
        start_rad = true_angle_rad(bench)
        bench.advance(bench.now_ns + 5 * MS, lambda _frame: None)
        angles.append(true_angle_rad(bench) - start_rad)
        phases.append(bench.sense().i_sensed_A - before)
    assert min(angles) > 0.07
    assert np.abs(phases[0]).max() > 2.0  # 0.6 rad electrical
    assert np.abs(phases[1]).max() < 0.3


def test_a_rig_file_without_a_drive_takes_the_configured_one() -> None:
    configured = load(DQ).inverter
    own = configured.dq.model_copy(update={"d_axis_rad": 0.2})
    assert with_drive(still_rig(dq=own), configured).inverter.dq == own
    assert with_drive(still_rig(), configured).inverter.dq == configured.dq
    phases = load(EMULATED).inverter
    assert with_drive(still_rig(dq=own), phases).inverter.dq is None
    plain = still_rig()
    assert with_drive(plain, phases) is plain


def test_its_messages() -> None:
    config = load(DQ)
    check_drivers(config)
    assert config.inverter.can is not None
    codec = dbc.load(config.inverter.can)
    assert {m.name: is_fast(m) for m in codec.feedback} == {
        "DqFeedback": True,
        "DriveStatus": False,
    }
    said = inverter_values(EmulatedBench(config, still_rig(), 0).sense(), 9)
    assert said["status"] == 9
    assert {slot for m in codec.feedback for slot in m.slots} <= said.keys()


def test_a_drive_that_cannot_be_commanded_off_follows_the_next_command() -> None:
    inverter = Inverter(0.05, always_on=True)
    inverter.command(0, COMMAND_A, True)
    inverter.expire(60 * MS)
    assert (inverter.enabled, inverter.timed_out) == (False, True)
    inverter.command(61 * MS, COMMAND_A, True)
    assert (inverter.i_A, inverter.enabled, inverter.timed_out) == (COMMAND_A, True, False)
    config = changed(
        command_enable="", command_constants={"DqCommand.Mode": 9, "DqCommand.Profile": 2}
    )
    assert config.inverter.can is not None
    payload = dbc.load(config.inverter.can).encode_command((0.0, 1.0), False, 0)
    assert payload[4] == 9
    bench = spun(config, still_rig())
    bench.advance(bench.now_ns + 2000 * MS, lambda _frame: None)
    assert bench.inverter.timed_out
    bench.arrive(bench.now_ns, CurrentCommand(COMMAND_A, True))
    bench.advance(bench.now_ns + MS, lambda _frame: None)
    assert bench.inverter.enabled


def test_the_bench_file_agrees_with_its_rig() -> None:
    config = load(DQ)
    true = rig_truth.load(config.bench.rig).motor
    assert (config.motor.connection, true.connection) == ("star", "star")
    assert config.motor.back_emf == true.back_emf
    assert config.inverter.can is not None
    assert config.inverter.can.options["hop_limit"] == 0
    report = load(EMULATED)
    for part in ("torque_sensor", "limits", "plans", "brake"):
        ours, theirs = getattr(config, part).model_dump(), getattr(report, part).model_dump()
        ours.pop("modbus", None)
        theirs.pop("modbus", None)
        assert ours == theirs
    assert Path(str(config.inverter.can.dbc)).name == "dq_drive.dbc"
    assert math.isclose(config.inverter.actuation_delay_s, report.inverter.actuation_delay_s)
