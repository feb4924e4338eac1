"""A rig whose magnets get warm: the back-EMF referred to one temperature, or not."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from motord.config import AccuracyConfig, load, packaged
from motord.experiments.calibration.command import estimate
from motord.experiments.calibration.estimate.calibrator import NOT_REFERRED, Calibrator
from motord.experiments.calibration.estimate.result import CalibrationResult
from motord.experiments.calibration.report import report
from motord.experiments.magnet_temperature import UNKNOWN, ReferredBackEmf, mean_over, referred
from motord.experiments.plans import build
from motord.experiments.subject import AnalysisError, Recordings, Subject
from motord.identification import IdentifyError
from motord.recording.captures import captures
from motord.recording.metadata import describe
from motord.recording.reader import Run, open_run
from motord.recording.writer import RunWriter
from motord.rig.energy.thermal import ThermalNetwork
from motord.rig.truth import load as load_truth
from motord.virtual import VirtualBench, run_plan

PER_K = -0.005
MESH = {"torques_Nm": [2.0, 5.0], "speeds_Hz": [0.9], "turns": 4, "settle_s": 0.3}
QUICK = {
    "winding_J_per_K": 20.0, "magnet_J_per_K": 10.0, "winding_magnet_K_per_W": 0.5,
    "magnet_housing_K_per_W": 3.0, "back_emf_per_K": PER_K,
}  # fmt: skip
"""A motor that is warm within seconds."""
EVERY = 250
CHANNEL = """
[[channels]]
name = "rotor_C"
unit = "degC"
role = "magnet"
source = {driver = "simulated", quantity = "magnet_C"}
"""
S = 10**9


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A calibration with the channel of the magnets, whose bench file has no coefficient."""
    folder = tmp_path_factory.mktemp("magnets")
    text = packaged("sim.toml").read_text() + CHANNEL
    text = text.replace('rig = "report.rig.toml"', 'rig = "package:report.rig.toml"')
    (folder / "bench.toml").write_text(text)
    config, truth = load(folder / "bench.toml"), load_truth()
    truth = truth.model_copy(update={"thermal": truth.thermal.model_copy(update=QUICK)})
    network = ThermalNetwork(truth)
    with RunWriter(folder / "run.mcap", describe(config, text)) as writer:

        def take(ticks: np.ndarray, true: np.ndarray) -> None:
            writer.ticks(ticks)
            for part in np.split(true, range(EVERY, len(true), EVERY)):
                squares_A2 = sum(part[f"i_{phase}_A"].astype(float) ** 2 for phase in "abc").mean()
                network.advance(squares_A2, len(part) / config.loop.rate_Hz)
                reading = {"value": network.named_C["magnet_C"], "raw": 0.0, "status": "ok"}
                writer.channel(int(part["t_ns"][-1]), "rotor_C", "degC", 3.0, reading)

        for point in run_plan(
            VirtualBench(config, truth, 6), build("calibrate", config, MESH), take
        ):
            spans = {"temperatures": {"rotor_C": {"mean_C": 31.4, "change_K": 2.6}}}
            last = {"temperatures": {"rotor_C": {"mean_C": None, "change_K": None}}}
            more = last if "induced" in point else spans
            writer.operating_point(int(point["t_end_ns"]), {**point, **more})
    return open_run(folder / "run.mcap")


def subject_of(run: Run, *, with_keys: bool) -> Subject:
    subject = Subject.of_runs([run])
    keys = {"back_emf_temperature_percent_per_K": 100 * PER_K, "back_emf_reference_C": 25.0}
    return replace(subject, motor=subject.motor.model_copy(update=keys)) if with_keys else subject


@pytest.fixture(scope="module")
def corrected(recorded: Run) -> Calibrator:
    return Calibrator.of_runs([recorded], subject_of(recorded, with_keys=True))


@pytest.fixture(scope="module")
def result(corrected: Calibrator) -> CalibrationResult:
    return corrected.joint()


@pytest.fixture(scope="module")
def uncorrected(recorded: Run) -> CalibrationResult:
    return Calibrator.of_runs([recorded], subject_of(recorded, with_keys=False)).joint()


def errors(found: CalibrationResult) -> tuple[float, float]:
    """Return the largest error of alpha, and that of delta epsilon, over their truth."""
    alpha = np.array([0.8, 1.118, 1.118])
    return (
        float(np.abs(found.alpha * np.cbrt(alpha.prod()) / alpha - 1).max()),
        abs(found.delta_epsilon - 1.0),
    )


def test_alpha_and_the_common_gain_are_right_with_the_coefficient_only(
    result: CalibrationResult, uncorrected: CalibrationResult
) -> None:
    assert errors(result)[0] < 0.002
    assert errors(result)[1] < 0.006
    assert errors(uncorrected)[0] > 0.004
    assert errors(uncorrected)[1] > 0.03


def test_the_result_says_so_with_what_it_adds_to_the_uncertainty(
    result: CalibrationResult, uncorrected: CalibrationResult
) -> None:
    [note] = [one for one in result.observable if one.startswith("back-EMF: referred to 25 degC")]
    assert "by -0.5 %/K from magnets of 25" in note
    by_source = {one.source: one for one in result.budget}
    sensor = by_source["temperature of the magnets"]
    assert sensor.delta_epsilon == pytest.approx(0.005 * 3.0 / 3**0.5 * result.delta_epsilon)
    assert (sensor.limit_text, max(sensor.alpha)) == ("3 K, assumed", pytest.approx(0.0, abs=1e-9))
    coefficient = by_source["temperature coefficient of the back-EMF"]
    assert 0.001 < coefficient.delta_epsilon < 0.003  # of about 1.5 % by 20 %
    text = " ".join(uncorrected.observable)
    assert "back-EMF: referred" not in text
    assert set(by_source) - {one.source for one in uncorrected.budget} == {
        "temperature of the magnets", "temperature coefficient of the back-EMF",
    }  # fmt: skip


def test_the_estimator_of_the_report_says_that_it_does_not(
    corrected: Calibrator, recorded: Run
) -> None:
    assert NOT_REFERRED in corrected.residual().observable
    plain = Calibrator.of_runs([recorded], subject_of(recorded, with_keys=False))
    assert NOT_REFERRED not in plain.residual().observable


def factors(run: Run, subject: Subject) -> list[float]:
    return [point.back_emf_factor for point in referred(captures(run), run, subject)]


def test_without_coefficient_or_channel_nothing_is_corrected(recorded: Run) -> None:
    assert set(factors(recorded, subject_of(recorded, with_keys=False))) == {1.0}
    subject = subject_of(recorded, with_keys=True)
    without = replace(subject, motor=subject.motor)
    bare = Run(recorded.path)
    bare.metadata["config"] = packaged("sim.toml").read_text()
    assert set(factors(bare, without)) == {1.0}
    assert min(factors(recorded, subject)) < 0.98


class Silenced(Run):
    """A recording whose sensor of the magnets gave no number from `since` of it on."""

    since = 0.0

    def channel(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        times_ns, values = super().channel(name)
        values[round(self.since * values.size) :] = np.nan
        return times_ns, values


def test_points_without_a_temperature_are_left_out_and_named(recorded: Run) -> None:
    broken = Silenced(recorded.path)
    broken.since = 0.75
    found = factors(broken, subject_of(recorded, with_keys=True))
    assert np.isnan(found[-1])
    assert np.isfinite(found[:2]).all()
    result = Calibrator.of_runs([broken], subject_of(recorded, with_keys=True)).joint()
    [note] = [one for one in result.observable if UNKNOWN in one]
    assert note.startswith(
        "left out, as the temperature of the magnets is not known: run.mcap: 5 Nm"
    )


def test_a_temperature_that_no_magnet_survives_is_refused(recorded: Run) -> None:
    class Wrong(Run):
        def channel(self, name: str) -> tuple[np.ndarray, np.ndarray]:
            times_ns, values = super().channel(name)
            return times_ns, values + 273.15

    with pytest.raises(AnalysisError, match=r"magnets of 29. degC \(rotor_C\) would have -0.3"):
        factors(Wrong(recorded.path), subject_of(recorded, with_keys=True))


def test_a_recording_without_any_temperature_is_refused(recorded: Run) -> None:
    broken = Silenced(recorded.path)
    calibrator = Calibrator.of_runs([broken], subject_of(recorded, with_keys=True))
    with pytest.raises(IdentifyError, match=r"no good .*not known; repair .* out of \[motor\]"):
        calibrator.joint()


MEANS: Sequence[tuple[list[float], list[float], float]] = [
    ([0, 1, 2, 3, 4], [20, 30, 40, 50, 60], 35.0),  # from 1 to 2 s
    ([-0.1, 4], [20, 60], np.nan),  # longer than timeout_s without a reading
    ([0, 4], [20, 60], 20.0),
    ([1], [30], 30.0),
    ([1, 1.5], [30, np.nan], 30.0),
    ([2.5], [30], np.nan),
    ([1.5], [30], 30.0),
    ([0, 1.5, 2.5], [30, 60, 0], 57.5),  # 50 at 1 s
    ([-0.5, 1.75], [20, 30], np.nan),
    ([], [], np.nan),
    ([1], [np.nan], np.nan),
    ([-2.0], [30], np.nan),
    ([0.0], [30], 30.0),
]


@pytest.mark.parametrize(("times_s", "values", "mean"), MEANS)
def test_mean_over_a_capture(times_s: list[float], values: list[float], mean: float) -> None:
    times_ns = (np.array(times_s) * S).astype(np.int64)
    found = mean_over(times_ns, np.array(values, float), 1 * S, 2 * S, 2.0 * S)
    assert found == pytest.approx(mean, nan_ok=True)
    assert not values or np.isnan(mean) or min(values) <= found <= max(values)


def test_what_the_correction_adds_is_by_sensor_and_coefficient() -> None:
    motor = load().motor.model_copy(
        update={"back_emf_temperature_percent_per_K": -0.1, "back_emf_reference_C": 20.0}
    )
    back_emf = ReferredBackEmf.of(motor, (0.98, 0.96))
    assert back_emf is not None
    accuracy = AccuracyConfig(magnet_temperature_K=3.0, back_emf_temperature_percent=20.0)
    assert back_emf.standard_uncertainty(accuracy) == pytest.approx(
        np.hypot(0.001 * 3.0, 0.03 * 0.2) / 3**0.5
    )
    assert "magnets of 40.0 to 60.0 degC" in back_emf.to_text(accuracy)
    assert ReferredBackEmf.of(motor, (1.0, 1.0)) is None


@pytest.mark.usefixtures("no_pictures")
def test_the_report_has_the_temperatures_of_each_point(recorded: Run) -> None:
    recordings = Recordings((recorded,))
    text = report(estimate(recordings), recordings).html()
    assert "<th>rotor_C: mean, change (K)</th>" in text
    assert "<tr><td>2 Nm, 0.9 Hz</td><td>31.4, 2.6</td></tr>" in text
    assert "<td>not known</td>" in text
