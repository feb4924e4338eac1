"""Steps of torque: made-up ones whose inertia is known, and those of the simulated rig."""

from functools import cache

import numpy as np
import pytest

from motord.config import AccelerationConfig, TorqueSensorConfig, load
from motord.experiments.inertia.acceleration import accelerate
from motord.experiments.inertia.folded_cogging import main_orders
from motord.experiments.inertia.torque_step import REQUIRED, read_step
from motord.identification import IdentifyError
from motord.rig.truth import load as load_truth
from tests.unit.experiments.inertia.inertia_runs import named, pushes, taken
from tests.unit.experiments.inertia.step_simulator import Rotor, misaligned, steps

J, VISCOUS, COULOMB = 0.0105, 0.004, 0.03
DIRECT = TorqueSensorConfig()
PIEZO = TorqueSensorConfig(highpass_time_constant_s=2.0)
EXACT = AccelerationConfig(gain_tolerance=1e-6, highpass_tolerance=1e-6)


@cache
def noisy() -> list[np.ndarray]:
    """Return steps of a rotor forwards and back in turn, of which tests take some."""
    return [read_only(ticks) for ticks in steps(Rotor(), 200, np.random.default_rng(1))]


def read_only(ticks: np.ndarray) -> np.ndarray:
    ticks.flags.writeable = False
    return ticks


@cache
def made_up(sensor: TorqueSensorConfig, sign: int = 1, drift_Nm_per_s: float = 0.0) -> np.ndarray:
    """1 s at rest, 1 Nm ramped up and down within 0.3 s, coasting; exact but for the encoder."""
    h = 1e-4
    t_s = np.arange(0, 1.6, h)
    torque_Nm = np.interp(t_s, [1.0, 1.1, 1.2, 1.3], [0, 1, 1, 0], 0, 0)
    angle = speed = measured = 0.0
    angles, sensed = np.empty_like(t_s), np.empty_like(t_s)
    tau_s = sensor.highpass_time_constant_s
    before = 0.0
    for n, torque in enumerate(torque_Nm):
        friction = COULOMB if speed > 0 or torque > COULOMB else torque
        speed += h / J * (torque - friction - VISCOUS * speed)
        angle += h * speed
        if tau_s:
            measured += torque - before - h * measured / tau_s + h * drift_Nm_per_s
            before = torque
        angles[n], sensed[n] = angle, measured if tau_s else torque
    every = slice(None, None, 10)
    count = np.rint(sign * angles[every] * 4096 / (2 * np.pi)).astype(int) % 4096
    t_ns = np.rint(t_s[every] * 1e9).astype(np.int64)
    columns = (t_ns, count, sign * sensed[every], sign * torque_Nm[every])
    return read_only(np.rec.fromarrays(columns, names=REQUIRED))


def changed(ticks: np.ndarray, **columns: np.ndarray | float) -> np.ndarray:
    other = ticks.copy()
    for name, values in columns.items():
        other[name] = values
    return other


@pytest.mark.parametrize("sensor", [DIRECT, PIEZO])
@pytest.mark.parametrize("sign", [1, -1])
def test_inertia_and_friction_of_a_known_rotor(sensor: TorqueSensorConfig, sign: int) -> None:
    found = read_step(0, made_up(sensor, sign), 4096, sensor, "step")
    assert found.inertia_kg_m2 == pytest.approx(J, rel=2e-3)
    assert found.commanded_kg_m2 == pytest.approx(J, rel=2e-3)
    assert found.viscous_Nm_s_per_rad == pytest.approx(VISCOUS, abs=1.5e-3)
    assert found.friction_Nm == pytest.approx(COULOMB, abs=0.01)
    assert 1.02 * J < found.plain_kg_m2 < 1.4 * J  # friction passes for inertia
    assert found.fitted_rad.size == found.fitted_s.size < found.t_s.size


def test_a_pause_while_the_rotor_stands_before_the_step_is_no_gap() -> None:
    """A count that trembles at rest passed for turns within a minute of it."""
    ticks = made_up(DIRECT).copy()
    ticks["encoder_count"][499:700:200] += 1
    ticks["t_ns"][500:] += 60 * 10**9
    found = read_step(0, ticks, 4096, DIRECT, "step")
    assert found.inertia_kg_m2 == pytest.approx(J, rel=2e-3)


def without_half_a_turn(step: np.ndarray) -> np.ndarray:
    turned = np.unwrap(step["encoder_count"], period=4096) / 4096
    begin = float(turned[0] + 0.3 * np.ptp(turned))
    return step[(turned < begin) | (turned > begin + 0.5)]


def test_a_step_with_lost_turns_is_left_out_and_said() -> None:
    step = made_up(DIRECT)
    gap = without_half_a_turn(step)
    found = accelerate(named([step, gap, made_up(DIRECT, -1)]), 4096, DIRECT, AccelerationConfig())
    assert [one.index for one in found.steps] == [0, 2]
    [left_out] = [one for one in found.findings if one.name == "points-left-out"]
    assert "step 2: " in left_out.meaning
    assert "cannot be counted" in left_out.meaning


def test_what_drifts_before_the_step_is_taken_off() -> None:
    settled = read_step(0, made_up(PIEZO, drift_Nm_per_s=0.02), 4096, PIEZO, "step")
    assert settled.inertia_kg_m2 == pytest.approx(J, rel=5e-3)


def test_the_simulated_rig_within_what_is_stated() -> None:
    config = load()
    found = accelerate(
        named(pushes(4, 6)), 4096, config.torque_sensor, config.plans.inertia_acceleration
    )
    assert found.inertia_kg_m2 == pytest.approx(0.0105, abs=2.5 * found.uncertainty_kg_m2)
    assert 0.003 < found.uncertainty_kg_m2 / 0.0105 < 0.02
    assert found.budget[0].source == "gain of the torque sensor"
    assert abs(found.plain_kg_m2 / 0.0105 - 1) > 0.03
    assert len(found.steps) == 6


def test_one_step_alone_has_its_own_error() -> None:
    found = accelerate(named([made_up(DIRECT)]), 4096, DIRECT, AccelerationConfig())
    assert {s.source for s in found.budget} == {"gain of the torque sensor", "repetition"}
    assert found.inertia_kg_m2 == pytest.approx(J, rel=2e-3)
    assert found.freedom is None
    assert "few-steps" in {one.name for one in found.findings}


def test_steps_are_within_their_intervals_and_without_bias() -> None:
    """A part of tests/campaigns/inertia.py: noise that is integrated twice is not white."""
    data = noisy()
    sets = [accelerate(named(data[n : n + 10]), 4096, PIEZO, EXACT) for n in range(0, 200, 10)]
    read = [step for one in sets for step in one.steps]
    assert len(read) == 200
    inertia = np.array([step.inertia_kg_m2 for step in read])
    stderr = np.array([step.stderr_kg_m2 for step in read])
    assert 0.90 <= np.mean(np.abs(inertia - J) < 1.96 * stderr) <= 0.99
    assert abs(inertia.mean() - J) < 3 * inertia.std() / np.sqrt(200)
    held = [s.interval_95_kg_m2[0] < J < s.interval_95_kg_m2[1] for s in sets]
    assert np.mean(held) >= 0.85  # of 20 sets
    assert sum(len(s.findings) for s in sets) <= 1


def test_a_wrong_gain_one_way_and_steps_that_differ_are_findings() -> None:
    data = noisy()[:12]
    weak = [ticks.copy() for ticks in data]
    for ticks in weak[1::2]:
        ticks["torque_Nm"] *= 0.9
    found = accelerate(named(weak), 4096, PIEZO, AccelerationConfig())
    assert "directions-differ" in {one.name for one in found.findings}
    loose = [ticks.copy() for ticks in data]
    for n, ticks in enumerate(loose):
        ticks["torque_Nm"] *= 1 + 0.05 * (n // 2 % 3)
    found = accelerate(named(loose), 4096, PIEZO, AccelerationConfig())
    assert "steps-scatter" in {one.name for one in found.findings}


def test_a_torque_that_is_cut_off_is_a_serious_finding() -> None:
    """At 90 % of what is set the inertia is 6 % too small, and steps hardly scatter more."""
    chosen = noisy()[:8]
    cut = [changed(one, torque_Nm=np.clip(one["torque_Nm"], -0.9, 0.9)) for one in chosen]
    for data, severity in ((chosen, None), (cut, "serious")):
        found = {one.name: one for one in accelerate(named(data), 4096, PIEZO, EXACT).findings}
        clipped = found.get("torque-clipped")
        assert (clipped.severity if clipped else None) == severity


def test_steps_that_all_begin_at_one_angle_are_noted() -> None:
    """A coupling out of line once a turn does not show then, and moves the inertia by 3 %."""
    chosen = noisy()[:8]
    alike = [
        changed(one, encoder_count=(one["encoder_count"] - one["encoder_count"][0]) % 4096)
        for one in chosen
    ]
    seen = [misaligned(one, 1, 0.01, 0.0) for one in alike]
    for data, noted in ((chosen, False), (alike, True), (seen, True)):
        found = accelerate(named(data), 4096, PIEZO, EXACT)
        assert ("steps-alike" in {one.name for one in found.findings}) == noted
    assert abs(found.inertia_kg_m2 / J - 1) > 0.02


def test_what_steps_that_scatter_bias_the_mean_by_is_in_the_interval() -> None:
    """A coupling that is misaligned: 20 mNm twice a turn on the sensor alone."""
    data, sets = noisy(), []
    phase_rad = np.random.default_rng(5).uniform(0, 2 * np.pi, 8)
    for n in range(8):
        chosen = data[10 * n : 10 * n + 10]
        sets.append(
            accelerate(
                named([misaligned(one, 2, 0.02, phase_rad[n]) for one in chosen]),
                4096,
                PIEZO,
                EXACT,
            )
        )
    held = [one.interval_95_kg_m2[0] < J < one.interval_95_kg_m2[1] for one in sets]
    assert all(held)
    for one in sets:
        assert "steps-scatter" in {finding.name for finding in one.findings}
        [part] = [each.uncertainty for each in one.budget if "not act" in each.source]
        assert 0.01 < part < 0.06
    assert 1.02 < np.mean([one.inertia_kg_m2 for one in sets]) / J < 1.05  # the bias is there


def test_friction_that_fades_in_all_steps_alike_is_named_and_in_the_interval() -> None:
    """50 mNm of a brake that sticks make the inertia 3.5 % too large, in steps that do not scatter;
    of four sets of sound steps none shows such friction."""
    data = noisy()
    sound = [accelerate(named(data[n : n + 10]), 4096, PIEZO, EXACT) for n in range(0, 40, 10)]
    assert not [one for each in sound for one in each.findings]
    stuck = steps(Rotor(sticking_Nm=0.05), 10, np.random.default_rng(5))
    found = accelerate(named(stuck), 4096, PIEZO, EXACT)
    assert found.inertia_kg_m2 > 1.02 * J
    assert found.interval_95_kg_m2[0] < J < found.interval_95_kg_m2[1]
    assert [one.name for one in found.findings] == ["friction-fades"]
    assert "friction that changes" in [one.source for one in found.budget]


@pytest.mark.parametrize("seed", [1, 2])
def test_cogging_torque_that_samples_do_not_resolve_is_taken_out(seed: int) -> None:
    """Order 240 at 500 Hz: at 2.08 turns/s all samples show the same of it, whatever acts."""
    config, truth = load(), load_truth()
    config = config.model_copy(update={"loop": config.loop.model_copy(update={"rate_Hz": 500})})
    fast = truth.motor.cogging[0].model_copy(update={"order": 240, "amplitude_Nm": 0.3})
    motor = truth.motor.model_copy(update={"cogging": (*truth.motor.cogging, fast)})
    truth = truth.model_copy(update={"motor": motor})
    data = named(taken(config, "inertia-acceleration", seed, truth, repeats=6, torque_Nm=2.0))
    known, unknown = (
        accelerate(data, 4096, config.torque_sensor, EXACT, orders) for orders in ((240, 480), ())
    )
    errors = np.array(
        [[step.inertia_kg_m2 / J - 1 for step in one.steps] for one in (known, unknown)]
    )
    left, whole = np.sqrt((errors**2).mean(axis=1))
    assert left < 0.05
    assert left < whole / 4
    assert "steps-misfit" in {one.name for one in unknown.findings}
    sources = {one.source: one.uncertainty for one in unknown.budget}
    assert sources["torque that does not act on the rotor"] > 0.02


def test_main_orders_are_those_of_slots_and_poles_that_the_encoder_resolves() -> None:
    motor = load().motor.model_copy(update={"slots": 48, "pole_pairs": 20, "counts": 3000})
    assert main_orders(motor) == (240, 480, 720)


@pytest.mark.parametrize(("resonance_Hz", "seen"), [(700.0, False), (900.0, True), (0.0, False)])
def test_a_mount_that_resonates_near_the_sampling_rate_is_a_finding(
    resonance_Hz: float, seen: bool
) -> None:
    sensor = PIEZO.model_copy(update={"resonance_Hz": resonance_Hz, "damping_ratio": 0.02})
    found = accelerate(named([made_up(sensor)]), 4096, sensor, AccelerationConfig())
    assert ("mount-resonance" in {one.name for one in found.findings}) == seen


def test_cogging_torque_of_less_than_a_turn_is_no_wrong_scale() -> None:
    """The impulse of the sensor was 0.62 times that of the torque set, from these angles."""
    truth = load_truth()
    rotor = truth.rotor.model_copy(update={"angle_rad": -2.110973})
    truth = truth.model_copy(update={"rotor": rotor})
    data = taken(load(), "inertia-acceleration", 102, truth, repeats=6)
    found = accelerate(named(data), 4096, load().torque_sensor, AccelerationConfig())
    assert "torque-scale" not in {one.name for one in found.findings}
    assert abs(np.mean([one.work_ratio for one in found.steps]) - 1) < 0.15


@pytest.mark.parametrize(
    ("part", "late_ticks", "name"),
    [(1000.0, 0, "torque-scale"), (0.5, 0, "torque-scale"), (1.0, 8, "torque-age")],
)
def test_a_torque_that_is_not_the_one_that_acted_is_a_finding(
    part: float, late_ticks: int, name: str
) -> None:
    data = noisy()[:6]
    assert accelerate(named(data), 4096, PIEZO, AccelerationConfig()).findings == ()
    changed = [ticks.copy() for ticks in data]
    for ticks in changed:
        ticks["torque_Nm"] = part * np.roll(ticks["torque_Nm"], late_ticks)
    found = accelerate(named(changed), 4096, PIEZO, AccelerationConfig())
    seen = {one.name: one for one in found.findings}
    assert seen[name].severity == "serious"
    assert ("torque-scale" in seen) == (part != 1.0)


@pytest.mark.parametrize("part", [1000.0, 0.5])
def test_two_steps_are_enough_for_a_wrong_scale(part: float) -> None:
    data = noisy()[:2]
    wrong = [changed(ticks, torque_Nm=part * ticks["torque_Nm"]) for ticks in data]
    for measured, seen in ((data, False), (wrong, True)):
        found = accelerate(named(measured), 4096, PIEZO, AccelerationConfig())
        assert ("torque-scale" in {one.name for one in found.findings}) == seen


def test_what_does_not_determine_the_inertia_is_refused() -> None:
    good = made_up(PIEZO)
    with pytest.raises(IdentifyError, match="no good step"):
        accelerate([], 4096, PIEZO, AccelerationConfig())
    cases = (
        (changed(good, torque_set_Nm=0.0), "no step of torque from rest"),
        (changed(good, encoder_count=0), "did not turn on in one direction"),
        (changed(good, torque_Nm=-good["torque_Nm"]), "its sign"),
        (changed(good, torque_Nm=0.1), r"torque_Nm is 0\.1 from the first sample to the last"),
        (changed(good, t_ns=good["t_ns"] // 10), r"at rest for 0.1 s only"),
        (changed(good, t_ns=good["t_ns"][::-1]), "times go back"),
        (without_half_a_turn(good), "they cannot be counted"),
    )
    for data, message in cases:
        with pytest.raises(IdentifyError, match=f"step 1: .*{message}"):
            read_step(0, data, 4096, PIEZO, "step 1")


def test_a_step_of_as_many_samples_as_parameters_is_refused() -> None:
    """They fit it without a residual; noise leaves none either, which was divided by."""
    few = made_up(DIRECT)[[*range(1001), *range(1022, 1198, 22)]]
    with pytest.raises(IdentifyError, match="cannot tell inertia from friction"):
        read_step(0, few, 4096, DIRECT, "step")


def test_ticks_that_repeat_a_sample_change_nothing() -> None:
    step = made_up(PIEZO)
    repeated = np.repeat(step, 1 + (np.arange(step.size) % 100 == 50))
    assert repeated.size > step.size
    found, again = (read_step(0, ticks, 4096, PIEZO, "step") for ticks in (step, repeated))
    assert (again.inertia_kg_m2, again.faults) == (found.inertia_kg_m2, found.faults)


def test_a_step_that_cannot_be_used_is_left_out_by_the_name_of_its_recording() -> None:
    """Whatever its error is: it ended the analysis of all the others."""
    step, other = made_up(DIRECT), made_up(DIRECT, -1)
    late = step.copy()
    late["t_ns"][-10] = late["t_ns"][-12]
    wrong = changed(step, encoder_count=65535)
    data = [(f"run.mcap: {name}", one) for name, one in named([step, late, wrong, other])]
    found = accelerate(data, 4096, DIRECT, AccelerationConfig())
    assert [one.label for one in found.steps] == ["run.mcap: step 1", "run.mcap: step 4"]
    [left_out] = [one for one in found.findings if one.name == "points-left-out"]
    assert "(run.mcap: step 2: times go back); (run.mcap: step 3: encoder c" in left_out.meaning
    with pytest.raises(IdentifyError, match=r"no step can be used; left out: run\.mcap: step 2: t"):
        accelerate([("run.mcap: step 2", late)], 4096, DIRECT, AccelerationConfig())


def test_steps_that_are_all_alike_are_as_uncertain_as_their_noise() -> None:
    """Their scatter is 0, which was divided by."""
    step = made_up(DIRECT)
    found = accelerate(named([step, step.copy()]), 4096, DIRECT, AccelerationConfig())
    alone = accelerate(named([step]), 4096, DIRECT, AccelerationConfig())
    assert found.freedom is None
    assert found.uncertainty_kg_m2 == pytest.approx(alone.uncertainty_kg_m2, rel=0.5)
