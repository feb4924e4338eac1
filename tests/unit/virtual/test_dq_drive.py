"""A drive that takes d and q, in virtual time: calibrated and verified as one of phase currents."""

from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motord import config
from motord.config import Config, ConfigError
from motord.config.faults import Fault
from motord.control.types import SETPOINT
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.plans import build
from motord.experiments.ripple.estimate import explain
from motord.identification import IdentifyError
from motord.identification.operating_points import PointData, prepare, split
from motord.identification.point_ripple import point_ripple
from motord.identification.zero_sequence import is_missing, restored
from motord.schema import Request, State, Trip
from motord.sequencing import PlanError
from motord.virtual import VirtualBench, run_plan
from tests.support.virtual_calibration import calibrate

DQ = Path(__file__).parents[3] / "config" / "dq.toml"
MESH = {"torques_Nm": [1.5, 4.0], "speeds_Hz": [0.7, 1.0], "turns": 4, "settle_s": 0.5}
TRUE_ALPHA, TRUE_BETA_A = np.array([0.8, 1.118, 1.118]), np.array([1.0, -0.5, -0.5])
OWN_AXES = {"direction": -1, "d_axis_rad": 0.5, "scale": 1.2247}
LATCHED = {"angle": "latched", "angle_age_s": 0.4e-3}
PHASES = {"feedback_i_A": tuple(f"PhaseFeedback.Current{p}" for p in "ABC")}
ALONG_AXES = ("feedback_i_d_A", "feedback_i_q_A", "feedback_u_d_V", "feedback_u_q_V")


def bench_file(
    dq: dict[str, Any] | None = None, without: tuple[str, ...] = (), **signals: Any
) -> Config:
    """Return config/dq.toml with other axes, without some signals, and with others."""
    content = config.load(DQ).model_dump()
    mapped = content["inverter"]["can"]["signals"]
    for name in without:
        del mapped[name]
    mapped.update(signals)
    content["inverter"]["dq"].update(dq or {})
    return Config.model_validate(content)


def recorded(bench: Config, plan: str, calibration: Any = None) -> list[PointData]:
    blocks: list[np.ndarray] = []
    virtual = VirtualBench(bench, seed=3, calibration=calibration)
    points = run_plan(virtual, build(plan, bench, MESH), lambda ticks, _: blocks.append(ticks))
    return list(split(np.concatenate(blocks), points))


def ripples_percent(bench: Config, points: list[PointData]) -> np.ndarray:
    """Return the ripples of the points, which may be of several takes."""
    counts = bench.motor.counts
    return np.array(
        [
            point_ripple(prepare(p, counts), bench.motor, bench.torque_sensor).rms_percent
            for p in points
        ]
    )


def calibrated(bench: Config, points: list[PointData]) -> CalibrationResult:
    return calibrate(points, bench.motor, bench.torque_sensor)


CASES = {
    "d and q": bench_file(),
    "axes of its own": bench_file(OWN_AXES),
    "q alone": bench_file(
        without=("command_i_d_A", "feedback_i_d_A", "feedback_u_d_V", "feedback_u_q_V")
    ),
    "latched, says phases": bench_file(LATCHED, ALONG_AXES, **PHASES),
}


Uncalibrated = Callable[[str], list[PointData]]


@pytest.fixture(scope="module")
def uncalibrated() -> Uncalibrated:
    """Return what returns the points of a case that is not calibrated yet, to be read only."""
    return cache(lambda case: recorded(CASES[case], "calibrate"))


@pytest.mark.parametrize("case", CASES)
def test_calibrated_the_ripple_is_gone(uncalibrated: Uncalibrated, case: str) -> None:
    """10 % of rated torque at 4 Nm becomes a twentieth of that, as with phase currents."""
    bench, points = CASES[case], uncalibrated(case)
    result = calibrated(bench, points)
    assert result.alpha / TRUE_ALPHA == pytest.approx(np.ones(3), abs=5e-3)
    assert result.beta_A == pytest.approx(TRUE_BETA_A, abs=0.04)
    calibration = result.to_calibration(bench.motor, datetime.now(UTC), ["x"])
    before = ripples_percent(bench, points)
    after = ripples_percent(bench, recorded(bench, "verify", calibration))
    assert before.min() > 5.0
    assert before.max() > 10.0
    assert after.max() < 0.8
    assert after.min() > 0.1  # a ripple that is not there would have been computed wrongly
    # the calibrated model makes the measured ripple of the recorded currents
    samples = prepare(points[0], bench.motor.counts)
    assert explain(samples, bench.motor, bench.torque_sensor, calibration).share_explained > 0.99


def test_a_common_part_that_was_not_recorded() -> None:
    bench = bench_file()
    mesh = {**MESH, "torques_Nm": [3.0], "speeds_Hz": [1.0], "turns": 2}
    blocks: list[np.ndarray] = []
    points = run_plan(
        VirtualBench(bench, seed=3), build("calibrate", bench, mesh), lambda t, _: blocks.append(t)
    )
    point = next(split(np.concatenate(blocks), points))
    samples = prepare(point, bench.motor.counts)
    assert is_missing(samples)
    assert np.abs(samples.i_A.sum(axis=1)).max() < 1e-4
    whole = restored(samples, TRUE_ALPHA)
    assert not is_missing(whole)
    assert np.abs(whole.i_A @ TRUE_ALPHA).max() < 1e-6  # Kirchhoff's law
    common_A = whole.i_A - samples.i_A
    assert np.ptp(common_A, axis=1).max() < 1e-9
    assert np.abs(common_A).max() > 0.5


def test_runs_of_two_kinds_of_drives_do_not_mix(uncalibrated: Uncalibrated) -> None:
    points = uncalibrated("d and q") + uncalibrated("latched, says phases")
    with pytest.raises(IdentifyError, match="calibrate from runs of one drive"):
        calibrated(CASES["latched, says phases"], points)


def test_the_axes_of_the_rig_file_are_true() -> None:
    """A bench file that is wrong by a quarter turn: current along what it takes for q is none."""
    bench = bench_file({"d_axis_rad": np.pi / 2})
    truth = VirtualBench(bench).truth
    assert truth.inverter.dq is not None
    assert truth.inverter.dq.d_axis_rad == pytest.approx(np.pi / 2)
    own = truth.inverter.dq.model_copy(update={"d_axis_rad": 0.0})
    wrong = truth.model_copy(update={"inverter": truth.inverter.model_copy(update={"dq": own})})
    virtual = VirtualBench(bench, wrong)
    state, torque_Nm = enabled(virtual, 2.0)
    assert state == State.ENABLED
    assert abs(torque_Nm) < 0.3
    _, torque_Nm = enabled(VirtualBench(bench), 2.0)
    assert torque_Nm == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize(
    ("bench", "trip"),
    [
        (bench_file(), Trip.TORQUE_IMPLAUSIBLE),
        (bench_file(None, ALONG_AXES, **PHASES), Trip.CURRENT_IMPLAUSIBLE),
    ],
    ids=["says d and q", "says phases"],
)
def test_a_drive_that_pushes_the_other_way_is_found_out(bench: Config, trip: Trip) -> None:
    """A wrong direction in the bench file: the drive's own d and q look right, the torque not."""
    truth = VirtualBench(bench).truth
    own = bench.inverter.dq.model_copy(update={"direction": -1})
    wrong = truth.model_copy(update={"inverter": truth.inverter.model_copy(update={"dq": own})})
    virtual = VirtualBench(bench, wrong)
    virtual.run(np.zeros(1, SETPOINT), 50)
    ticks, _ = virtual.run(setpoint(4.0), 1500)
    assert State(int(ticks["state"][-1])) is State.TRIPPED
    assert Trip(int(ticks["first_trip"][-1])) is trip
    assert np.abs(ticks["torque_set_Nm"]).max() < 3.5


def test_faults_reach_a_drive_that_takes_d_and_q() -> None:
    virtual = VirtualBench(bench_file())
    virtual.inject(Fault(kind="can_drop", at_s=0.8, for_s=2.0, fraction=1.0))
    state, _ = enabled(virtual, 2.0)
    assert state == State.ENABLED
    ticks, truth = virtual.run(setpoint(2.0), 2500)
    assert State(int(ticks["state"][-1])) is State.TRIPPED
    assert Trip.INVERTER_STALE in Trip(int(ticks["trip_bits"][-1]))
    assert np.abs(truth["i_a_A"][-10:]).max() < 1e-6


def setpoint(torque_Nm: float) -> np.ndarray:
    record = np.zeros(1, SETPOINT)
    record["torque_Nm"], record["brake"], record["plan_point"] = torque_Nm, 0.5, -1
    record["request"], record["request_seq"] = Request.ENABLE, 1
    return record


def enabled(virtual: VirtualBench, torque_Nm: float) -> tuple[State, float]:
    """Return state and mean true electromagnetic torque of the last tenth of 0.8 s."""
    virtual.run(np.zeros(1, SETPOINT), 50)
    ticks, truth = virtual.run(setpoint(torque_Nm), 750)
    return State(int(ticks["state"][-1])), float(truth["torque_em_Nm"][-100:].mean())


@pytest.mark.kernel
@pytest.mark.parametrize(
    "bench", [bench_file(OWN_AXES), bench_file(LATCHED)], ids=["own", "latched"]
)
def test_currents_flow_as_the_kernel_commands_them(bench: Config) -> None:
    """Through the configured axes to the drive and back: small steps, both rigs agreeing."""
    virtual = VirtualBench(bench)
    virtual.run(np.zeros(1, SETPOINT), 5)
    ticks, truth = virtual.run(setpoint(1.0), 60)
    assert ticks["state"][-1] == State.ENABLED
    command_A, sensed_A, flowing_A = (
        np.array([block[name.format(phase)][-1] for phase in "abc"], dtype=float)
        for block, name in ((ticks, "i_cmd_{}_A"), (ticks, "i_{}_A"), (truth, "i_{}_A"))
    )
    assert np.abs(command_A).max() > 0.5
    assert sensed_A == pytest.approx(command_A, abs=0.35)  # noise, and a tick's ramp
    common_A = -(TRUE_ALPHA @ sensed_A) / TRUE_ALPHA.sum()
    assert flowing_A == pytest.approx(TRUE_ALPHA * (sensed_A + common_A) + TRUE_BETA_A, abs=0.25)


def test_independent_windings_are_refused() -> None:
    content = config.load(DQ).model_dump()
    content["motor"]["connection"] = "independent"
    with pytest.raises(ValueError, match="it takes a star"):
        Config.model_validate(content)


def test_errors_of_phases_cannot_be_induced_along_q_alone() -> None:
    with pytest.raises(PlanError, match="along q alone"):
        build("sensitivity", CASES["q alone"], {})
    assert build("sensitivity", CASES["d and q"], {}).points


def test_the_refusal_names_the_file(tmp_path: Path) -> None:
    text = DQ.read_text().replace('connection = "star"', 'connection = "independent"')
    path = tmp_path / "bench.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"bench\.toml.*can-dq.*takes a star") as caught:
        config.load(path)
    assert "\n" not in str(caught.value)
