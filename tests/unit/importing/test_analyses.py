"""Imported recordings give what the original ones give, and what is true."""

import json
from dataclasses import replace
from math import lcm
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from motord.cli import app
from motord.config import MotorConfig, TorqueSensorConfig, load
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.captures_left_out import EveryCapture
from motord.experiments.plans import build
from motord.experiments.ripple.estimate import ripples
from motord.experiments.subject import Subject
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData, split
from motord.rig.truth import load as load_truth
from motord.virtual import VirtualBench
from motord.virtual.plan import run_plan
from tests.support.virtual_calibration import calibrate
from tests.unit.identification.synthetic_bench import SENSOR, Bench, Truth, motor
from tests.unit.importing.tables import imported, write_csv, write_motor

MESH = {"torques_Nm": [2.0, 4.0], "speeds_Hz": [0.8, 1.0], "turns": 4, "settle_s": 1.0}

GERMAN = """\
motor = "package:sim.toml"
[columns]
t_s = {column = "Zeit [ms]", scale = 0.001}
angle_rad = {column = "Winkel [°]", scale = 0.017453292519943295}
torque_Nm = {column = "M [mNm]", scale = 0.001}
i_a_A = "Ia"
i_b_A = "Ib"
i_c_A = "Ic"
torque_set_Nm = "M Soll"
speed_set_Hz = "n Soll"
[split]
by = ["torque_set_Nm", "speed_set_Hz"]
settle_s = 1.5
"""

OTHERS = [
    (12, 10, 1000, True),
    (36, 12, 2001, False),
    (18, 24, 4096, True),
    (9, 8, 20_000, False),
]
"""Slots, poles, counts, and whether sensor passes the mean and angles go on beyond a turn: what
that does to a calibration is the same of any motor, and of its orders `test_any_motor` has more.
"""


def motor_toml(of: MotorConfig, sensor: TorqueSensorConfig) -> str:
    """Return a motor file."""
    text = "[motor]\n"
    for key, value in of.model_dump(mode="json", exclude={"back_emf"}, exclude_none=True).items():
        text += f"{key} = {json.dumps(value)}\n"
    lines = [
        ", ".join(f"{key} = {value}" for key, value in harmonic.model_dump().items())
        for harmonic in of.back_emf
    ]
    text += f"back_emf = [{', '.join('{' + line + '}' for line in lines)}]\n[torque_sensor]\n"
    return text + "".join(f"{key} = {value}\n" for key, value in sensor.model_dump().items())


def test_a_run_of_the_simulated_rig_in_german(tmp_path: Path) -> None:
    config, blocks = load(), []
    points = run_plan(
        VirtualBench(config, seed=5), build("calibrate", config, MESH | {"gain_steps": []}),
        lambda ticks, truth: blocks.append(ticks),
    )  # fmt: skip
    ticks = np.concatenate(blocks)
    columns = {
        "Zeit [ms]": (ticks["t_ns"] - ticks["t_ns"][0]) * 1e-6,
        "Winkel [°]": ticks["encoder_count"] * (360 / 4096),
        "M [mNm]": ticks["torque_Nm"] * 1000.0,
        "Ia": ticks["i_a_A"],
        "Ib": ticks["i_b_A"],
        "Ic": ticks["i_c_A"],
        "M Soll": ticks["torque_set_Nm"],
        "n Soll": ticks["speed_set_rad_s"] / (2 * np.pi),
    }
    source = write_csv(tmp_path / "lauf.csv", columns, ";", ",", "Prüfstand 3\n\n", "latin-1")
    done, run = imported(tmp_path, source, GERMAN)
    assert not done.problems
    assert [(p["torque_Nm"], p["speed_Hz"]) for p in run.operating_points()] == [
        (p["torque_Nm"], p["speed_Hz"]) for p in points
    ]
    subject = Subject.of_runs([run])
    assert subject.sensor == config.torque_sensor
    original = calibrate(split(ticks, points), config.motor, config.torque_sensor)
    result = Calibrator.of_runs([run], subject).joint()
    truth = load_truth().inverter
    assert result.alpha == pytest.approx(original.alpha, abs=2e-3)
    assert result.alpha == pytest.approx(np.array(truth.alpha), rel=5e-3)
    assert result.beta_A == pytest.approx(np.array(truth.beta_A), abs=0.03)
    for mine, theirs in zip(result.harmonics, original.harmonics, strict=True):
        assert mine.amplitude_Nm == pytest.approx(theirs.amplitude_Nm, abs=2e-3)
    before = {
        (r.torque_Nm, r.speed_Hz): r.rms_percent for r in ripples([run], subject, EveryCapture())
    }
    for ripple in original.ripples:
        assert before[ripple.torque_Nm, ripple.speed_Hz] == pytest.approx(
            ripple.rms_percent, abs=0.05
        )


def in_one_table(points: list[PointData], counts: int, *, unwrapped: bool) -> dict[str, np.ndarray]:
    """Return points one after the other, a second apart, as another program might have them."""
    tables, start_s = [], 0.0
    for point in points:
        t_s = (point.ticks["t_ns"] - point.ticks["t_ns"][0]) * 1e-9 + start_s
        start_s = t_s[-1] + 1.0
        count = point.ticks["encoder_count"].astype(float)
        if unwrapped:
            count = np.unwrap(count, period=counts) - 7 * counts
        tables.append(
            {
                "t": t_s,
                "pos": count * (2 * np.pi / counts),
                "M": point.ticks["torque_Nm"].astype(float),
                **{p: point.ticks[f"i_{p}_A"].astype(float) for p in "abc"},
                "Mset": np.full(t_s.size, point.torque_Nm),
                "nset": np.full(t_s.size, point.speed_Hz),
            }
        )
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


MESH_MAP = """\
motor = "motor.toml"
[columns]
t_s = "t"
angle_rad = "pos"
torque_Nm = "M"
i_a_A = "a"
i_b_A = "b"
i_c_A = "c"
torque_set_Nm = "Mset"
[split]
by = ["torque_set_Nm", "nset"]
"""


@pytest.mark.parametrize(("slots", "poles", "counts", "passes_mean"), OTHERS)
def test_other_motors_have_their_own_orders(
    tmp_path: Path, slots: int, poles: int, counts: int, passes_mean: bool
) -> None:
    main = lcm(slots, poles)
    cogging = {poles: (0.05, 0.3), main: (0.15, -0.5), 2 * main: (0.03, 2.0)}
    bench = Bench(
        motor=motor(slots, poles // 2, counts, "independent", third=0.04),
        truth=replace(Truth(), cogging=cogging),
        sensor=TorqueSensorConfig() if passes_mean else SENSOR,
        ripple_order=poles,
    )
    points = bench.mesh(turns=6)
    columns = in_one_table(points, counts, unwrapped=passes_mean)
    (tmp_path / "motor.toml").write_text(motor_toml(bench.motor, bench.sensor))
    _, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns), MESH_MAP)
    subject = Subject.of_runs([run])
    assert subject.motor == bench.motor
    assert [p["torque_Nm"] for p in run.operating_points()] == [p.torque_Nm for p in points]
    result = Calibrator.of_runs([run], subject).joint()
    alpha = np.array(bench.truth.alpha)
    if result.delta_epsilon_stderr is None:
        alpha = alpha / np.cbrt(alpha.prod())
    assert result.alpha == pytest.approx(alpha, rel=5e-3)
    assert result.beta_A == pytest.approx(np.array(bench.truth.beta_A), abs=0.05)
    largest = sorted(result.harmonics, key=lambda h: -h.amplitude_Nm)[:3]
    assert [h.order for h in largest] == [main, poles, 2 * main]
    for h in largest:
        amplitude_Nm, phase_rad = cogging[h.order]
        assert h.amplitude_Nm == pytest.approx(amplitude_Nm, abs=max(0.003, 5 * h.stderr_Nm))
        assert h.phase_rad == pytest.approx(phase_rad, abs=0.1)


KAGGLE = """\
motor = "motor.toml"
[columns]
t_s = "Time"
angle_rad = {column = "Position[rad]", scale = 1.0}
torque_Nm = {column = "Iq", scale = 0.02}
[constants]
torque_set_Nm = 3.0
[split]
by = ["torque_set_Nm", "speed_set_Hz"]
"""


def test_time_position_and_torque_are_enough_to_verify(tmp_path: Path) -> None:
    write_motor(tmp_path, slots=12, pole_pairs=5, counts=1000)
    t_s = np.arange(20_000) / 1000
    angle_rad = 2 * np.pi * 0.7 * t_s - 3.0
    torque_Nm = 1.5 + 0.3 * np.sin(60 * angle_rad + 0.3) + 0.05 * np.sin(10 * angle_rad)
    columns = {"Time": t_s, "Position[rad]": angle_rad, "Iq": torque_Nm / 0.02}
    source = write_csv(tmp_path / "a.csv", columns)
    (tmp_path / "map.toml").write_text(KAGGLE)
    run, result = tmp_path / "a.mcap", tmp_path / "a.json"
    runner = CliRunner()
    options = ["--map", str(tmp_path / "map.toml"), "-o", str(run)]
    done = runner.invoke(app, ["record", "import", str(source), *options])
    assert done.exit_code == 0, done.output
    assert "3 Nm  0.700 Hz" in done.output
    assert "no column has speed_set_Hz" in done.output
    again = runner.invoke(app, ["record", "import", str(source), *options])
    assert again.exit_code == 1
    assert "exists already" in again.stderr
    assert runner.invoke(app, ["analyse", "verify", str(run), "-o", str(result)]).exit_code == 0
    (point,) = json.loads(result.read_text())["points"]
    expected = 100 / 6 * np.hypot(0.3, 0.05) / np.sqrt(2)
    assert point["rms_percent"] == pytest.approx(expected, rel=0.01)
    refused = runner.invoke(app, ["analyse", "calibrate", str(run)])
    assert refused.exit_code == 1
    assert "i_a_A, i_b_A, i_c_A were not recorded" in refused.stderr
    assert len(refused.stderr.strip().splitlines()) == 1


def test_errors_of_an_import_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(KAGGLE.replace("angle_rad", "angle"))
    (tmp_path / "a.csv").write_text("Time,Position[rad],Iq\n")
    options = ["--map", str(tmp_path / "map.toml"), "-o", str(tmp_path / "run.mcap"), "--json"]
    result = CliRunner().invoke(app, ["record", "import", str(tmp_path / "a.csv"), *options])
    assert result.exit_code == 1
    assert "map.toml:4: columns.angle: no field of a tick" in result.stderr
    assert "got 'angle'" not in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_one_torque_only_is_refused(tmp_path: Path) -> None:
    bench = Bench()
    points = bench.mesh((3.0,), (0.8, 1.0), turns=8)
    (tmp_path / "motor.toml").write_text(motor_toml(bench.motor, bench.sensor))
    columns = in_one_table(points, 4096, unwrapped=False)
    _, run = imported(tmp_path, write_csv(tmp_path / "a.csv", columns), MESH_MAP)
    with pytest.raises(IdentifyError, match="about the same torque"):
        Calibrator.of_runs([run], Subject.of_runs([run])).joint()
