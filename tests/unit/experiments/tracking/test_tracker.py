"""Tracking of the calibration in force: what it follows, leaves out, does not see, and offers."""

import json
import pickle
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from motord.calibration import Calibration, CalibrationError
from motord.config import Config, load
from motord.config.sections import TrackingConfig
from motord.control import parameters
from motord.experiments.check_calibration.quantities import Quantity
from motord.experiments.check_calibration.result import Change
from motord.experiments.tracking.adopted import adopted as adopt
from motord.experiments.tracking.adopted import is_adoptable
from motord.experiments.tracking.tracked import TrackedCalibration
from motord.experiments.tracking.tracker import FORGOTTEN, WINDOW_SHARE, CalibrationTracker
from motord.experiments.tracking.window_lines import LONGEST_S
from motord.schema import Flag, State
from motord.virtual import VirtualBench
from tests.campaigns.check_calibration import stated_calibration, with_drift
from tests.campaigns.estimator import rig
from tests.campaigns.tracking import Operation, departed, gains_against_others

SEED = 1
MEMORY_S = 100.0
DRIFT = 0.02
TORQUES_Nm = (2.0, 5.0, 3.5)
SECONDS = 120
CONFIG = load()
CALIBRATION = stated_calibration(SEED, CONFIG)
TRUTH = rig(SEED)[0]


def operate(
    seconds: int = SECONDS,
    torques_Nm: tuple[float, ...] = TORQUES_Nm,
    calibration: Calibration = CALIBRATION,
    drift: float = 0.0,
) -> np.ndarray:
    """Return ticks of operation; drift: of the gain of phase b."""
    truth = with_drift(TRUTH, 1, drift)
    bench = VirtualBench(CONFIG, truth, SEED, calibration)
    return np.concatenate(list(Operation(bench, torques_Nm).blocks(seconds)))


def tracker_of(
    ticks: np.ndarray, calibration: Calibration = CALIBRATION, block: int = 10_000
) -> CalibrationTracker:
    tracker = CalibrationTracker(CONFIG, calibration, MEMORY_S)
    for start in range(0, ticks.size, block):
        tracker.take(ticks[start : start + block])
    return tracker


def tracked_of(ticks: np.ndarray, **changes: object) -> TrackedCalibration:
    return stated_of(tracker_of(ticks, **changes))


def stated_of(tracker: CalibrationTracker) -> TrackedCalibration:
    found = tracker.tracked()
    assert found is not None
    return found


def values(found: TrackedCalibration) -> dict[str, float]:
    return {one.name: one.value for one in found.quantities}


def changed(**changes: object) -> Calibration:
    """Return a calibration that differs from the one in force by this."""
    return Calibration(**{**dict(CALIBRATION), "id": "", **changes})


def later(ticks: np.ndarray, times: int) -> np.ndarray:
    """Return ticks as they would be `times` their length later."""
    shifted = ticks.copy()
    shifted["tick"] += times * ticks.size
    shifted["t_ns"] += times * (ticks.size * 1_000_000_000 // CONFIG.loop.rate_Hz)
    return shifted


@pytest.fixture(scope="module")
def quiet() -> np.ndarray:
    return operate()


@pytest.fixture(scope="module")
def drifted() -> np.ndarray:
    return operate(drift=DRIFT)


@pytest.fixture(scope="module")
def quiet_tracker(quiet: np.ndarray) -> CalibrationTracker:
    """Return the tracker of all of `quiet`; a test that goes on takes a deep copy."""
    return tracker_of(quiet)


@pytest.fixture(scope="module")
def quiet_tracked(quiet_tracker: CalibrationTracker) -> TrackedCalibration:
    return stated_of(quiet_tracker)


@pytest.fixture(scope="module")
def half(quiet: np.ndarray) -> np.ndarray:
    return quiet[:60_000]


@pytest.fixture(scope="module")
def half_tracked(half: np.ndarray) -> TrackedCalibration:
    return tracked_of(half)


@pytest.fixture(scope="module")
def drifted_tracker(drifted: np.ndarray) -> CalibrationTracker:
    """Return the tracker of all of `drifted`; a test that goes on takes a deep copy."""
    return tracker_of(drifted)


def test_a_calibration_that_holds_has_not_departed(
    quiet: np.ndarray, quiet_tracked: TrackedCalibration
) -> None:
    found = quiet_tracked
    assert departed(found) == []
    assert found.calibration == CALIBRATION.id
    assert found.turns == pytest.approx(0.72 * SECONDS, rel=0.15)
    assert found.memory_s == MEMORY_S
    assert quiet["t_ns"][0] < found.t_ns <= quiet["t_ns"][-1]
    assert found.obstacle == ""
    for one in found.quantities:
        assert abs(one.value - one.in_force) < 1.5 * np.hypot(
            one.half_width, one.in_force_half_width
        )
    assert json.loads(found.model_dump_json())["calibration"] == CALIBRATION.id


def test_values_are_those_of_the_calibration_file(quiet_tracked: TrackedCalibration) -> None:
    found = quiet_tracked
    in_force = {one.name: one.in_force for one in found.quantities}
    units = {one.name: one.unit for one in found.quantities}
    first = CALIBRATION.tau_cog_harmonics[0]
    assert in_force["alpha-a"] == pytest.approx(CALIBRATION.alpha[0])
    assert in_force["beta-c"] == pytest.approx(CALIBRATION.beta_A[2])
    assert in_force[f"cogging-{first.order}-amplitude"] == pytest.approx(first.amplitude_Nm)
    assert in_force[f"cogging-{first.order}-phase"] == pytest.approx(first.phase_rad)
    assert {units["alpha-a"], units["beta-a"]} == {"1", "A"}
    half_width = next(o.in_force_half_width for o in found.quantities if o.name == "alpha-a")
    assert half_width == pytest.approx(1.96 * CALIBRATION.alpha_stderr[0], rel=1e-3)


def test_a_gain_that_changed_is_followed_and_found(drifted_tracker: CalibrationTracker) -> None:
    found = stated_of(drifted_tracker)
    alpha = [values(found)[f"alpha-{phase}"] for phase in "abc"]
    true = np.array(TRUTH.inverter.alpha) * [1, 1 + DRIFT, 1]
    assert np.prod(alpha) == pytest.approx(1)
    assert gains_against_others(alpha) == pytest.approx(gains_against_others(true), abs=0.002)
    assert departed(found) == ["alpha-b"]


def test_a_gain_that_drifts_is_followed_without_lag_and_in_its_interval() -> None:
    bench = VirtualBench(CONFIG, TRUTH, SEED, CALIBRATION)
    operation = Operation(bench, (2.0, 5.0, 3.5))
    tracker = CalibrationTracker(CONFIG, CALIBRATION, MEMORY_S)
    for second, block in enumerate(operation.blocks(240)):
        tracker.take(block)
        now = with_drift(TRUTH, 0, 4.5 * 0.01 * second / 3600)
        bench.alter(now)
    found = tracker.tracked()
    assert found is not None
    off = gains_against_others([values(found)[f"alpha-{p}"] for p in "abc"])
    off -= gains_against_others(now.inverter.alpha)
    half_width = 1.5 * found.quantities[0].half_width / found.quantities[0].value
    assert abs(off[0]) < half_width < 0.003


def test_cogging_torque_that_changed_is_found() -> None:
    a, *others = TRUTH.motor.cogging
    waves = (a.model_copy(update={"amplitude_Nm": 1.2 * a.amplitude_Nm}), *others)
    truth = TRUTH.model_copy(update={"motor": TRUTH.motor.model_copy(update={"cogging": waves})})
    bench = VirtualBench(CONFIG, truth, SEED, CALIBRATION)
    found = tracked_of(np.concatenate(list(Operation(bench, TORQUES_Nm).blocks(SECONDS))))
    assert departed(found) == [f"cogging-{a.order}-amplitude"]
    delta = TRUTH.torque_sensor.delta
    assert values(found)[f"cogging-{a.order}-amplitude"] == pytest.approx(
        1.2 * delta * a.amplitude_Nm, abs=0.003
    )


def test_only_enabled_and_compensated_ticks_of_this_calibration_count(quiet: np.ndarray) -> None:
    cases = {
        "off": ("state", State.OFF),
        "tripped": ("trip_bits", 1),
        "no gains": ("flags", Flag.COGGING_COMPENSATED),
        "no cogging": ("flags", Flag.CURRENTS_COMPENSATED),
        "ramping": (
            "flags",
            Flag.RAMPING | Flag.CURRENTS_COMPENSATED | Flag.COGGING_COMPENSATED,
        ),
    }
    enough = quiet[:10_000]
    assert tracker_of(enough).tracked() is not None
    for name, (field, value) in cases.items():
        ticks = enough.copy()
        ticks[field] = value
        assert tracker_of(ticks).tracked() is None, name
    other = stated_calibration(SEED + 1, CONFIG, (TRUTH, 1.0, 1.0))
    assert tracker_of(enough, calibration=other).tracked() is None


def test_blocks_of_any_size_are_the_same(
    half: np.ndarray, half_tracked: TrackedCalibration
) -> None:
    assert tracked_of(half, block=53) == half_tracked


def test_lost_ticks_cost_their_turns_and_nothing_else(
    half: np.ndarray, half_tracked: TrackedCalibration
) -> None:
    whole = half_tracked
    rng = np.random.default_rng(SEED)
    single = np.ones(half.size, bool)
    single[rng.integers(0, half.size, half.size // 500)] = False
    found = tracked_of(half[single])
    assert found.turns == whole.turns
    holes = np.arange(half.size) % 20_000 > 100
    fewer = tracked_of(half[holes])
    assert 0.5 * whole.turns < fewer.turns < whole.turns
    for other in (found, fewer):
        for one, same in zip(whole.quantities[:3], other.quantities[:3], strict=True):
            assert one.value == pytest.approx(same.value, abs=one.half_width)
        assert departed(other) == []


def test_at_one_torque_gains_and_the_common_gain_are_not_seen(
    half_tracked: TrackedCalibration,
) -> None:
    """As long at several torques shows the gains."""
    assert {f"alpha-{phase}" for phase in "abc"} <= values(half_tracked).keys()
    found = tracked_of(operate(60, (4.0,)))
    assert not any(one.name.startswith(("alpha", "delta")) for one in found.quantities)
    assert "the gain of phase a against the others" in found.unseen
    assert "the common gain of the phases (delta epsilon)" in found.unseen


def test_an_order_whose_error_is_not_stated_is_listed_as_not_seen(
    half: np.ndarray, half_tracked: TrackedCalibration
) -> None:
    first, *others = CALIBRATION.tau_cog_harmonics
    unknown = (first.model_copy(update={"stderr_Nm": None}), *others)
    found = tracked_of(half, calibration=changed(tau_cog_harmonics=unknown))
    assert f"order {first.order} of the cogging torque" in found.unseen
    assert f"cogging-{first.order}-amplitude" not in values(found)
    assert f"cogging-{first.order}-amplitude" in values(half_tracked)
    assert not any(one.startswith("order") for one in half_tracked.unseen)


def test_the_common_gain_is_not_seen_by_constant_torques(
    quiet_tracked: TrackedCalibration,
) -> None:
    found = quiet_tracked
    assert "delta-epsilon" not in values(found)
    assert "the common gain of the phases (delta epsilon)" in found.unseen


def test_nothing_is_tracked_before_there_are_enough_turns(quiet: np.ndarray) -> None:
    assert tracker_of(quiet[:3_000]).tracked() is None
    few = tracker_of(quiet[:10_000])
    found = few.tracked()
    assert found is not None
    assert (found.quantities, found.turns > 0) == ((), True)
    assert "windows of turns at torques that recur, at least 8 are needed" in found.obstacle
    assert found.obstacle.endswith("hold steady torques, again and again, with compensation on")
    with pytest.raises(CalibrationError, match=f"nothing to adopt: {found.obstacle}"):
        few.adopted()


def test_turns_are_forgotten(
    quiet: np.ndarray, quiet_tracked: TrackedCalibration, drifted_tracker: CalibrationTracker
) -> None:
    tracker = deepcopy(drifted_tracker)
    tracker.take(later(quiet, 1))
    found = stated_of(tracker)
    fresh = values(quiet_tracked)
    was = values(stated_of(drifted_tracker))
    left = (values(found)["alpha-b"] - fresh["alpha-b"]) / (was["alpha-b"] - fresh["alpha-b"])
    assert abs(left) < 0.15
    long_ago = round(FORGOTTEN * MEMORY_S / SECONDS) + 1
    standing = later(quiet[:1000], 1000 * long_ago)
    standing["state"] = State.READY
    tracker.take(standing)
    assert tracker.tracked() is None


def test_what_is_adopted_has_the_tracked_values_and_installs(
    drifted: np.ndarray, drifted_tracker: CalibrationTracker
) -> None:
    found = stated_of(drifted_tracker)
    adopted = drifted_tracker.adopted()
    adopted.check_motor(CONFIG.motor)
    parameters.build(CONFIG, adopted)
    assert adopted.id != CALIBRATION.id
    assert adopted.alpha == pytest.approx([values(found)[f"alpha-{p}"] for p in "abc"])
    half_width = {one.name: one.half_width for one in found.quantities}
    assert adopted.alpha_half_width[1] == pytest.approx(half_width["alpha-b"], rel=1e-2)
    assert adopted.budget[0].alpha == adopted.alpha_stderr
    assert adopted.delta_epsilon == CALIBRATION.delta_epsilon
    assert adopted.runs[-1] == f"tracking in operation with {CALIBRATION.id}"
    assert 0 < adopted.created.timestamp() - 1e-9 * drifted["t_ns"][0] < SECONDS + 1
    again = operate(calibration=adopted, drift=DRIFT)
    assert departed(tracked_of(again, calibration=adopted)) == []


def test_alpha_of_another_product_keeps_it(
    drifted: np.ndarray, drifted_tracker: CalibrationTracker
) -> None:
    scaled = changed(
        alpha=tuple(1.1 * each for each in CALIBRATION.alpha),
        alpha_stderr=tuple(1.1 * each for each in CALIBRATION.alpha_stderr),
        delta_epsilon=CALIBRATION.delta_epsilon / 1.1,
    )
    tracker = tracker_of(drifted, calibration=scaled)
    found, adopted = tracker.tracked(), tracker.adopted()
    assert found is not None
    in_force = {one.name: one.in_force for one in found.quantities}
    assert [in_force[f"alpha-{p}"] for p in "abc"] == pytest.approx(scaled.alpha)
    assert adopted.alpha == pytest.approx([values(found)[f"alpha-{p}"] for p in "abc"])
    plain = drifted_tracker.adopted()
    assert adopted.delta_epsilon * np.array(adopted.alpha) == pytest.approx(
        plain.delta_epsilon * np.array(plain.alpha)
    )
    assert adopted.alpha_stderr == pytest.approx([1.1 * each for each in plain.alpha_stderr])


def departure(name: str, family: str, change: float = 9.0) -> tuple[Quantity, Change]:
    """Return a quantity and its change, which is none by chance if it is above 5."""
    quantity = Quantity(name, f"the {name}", family, "mA", np.zeros(1), 1.0, None, 2.0, 0.0)
    found = Change(name, f"the {name}", "mA", change, 2.0, 50.0, 5.0, 6.0, 0.0, change > 5)
    return quantity, found


@pytest.mark.parametrize(
    "seen",
    [
        [departure("offset-common", "common")],
        [departure("gain-common", "common")],
        [departure("gain-a", "gain"), departure("gain-b", "gain", 0.0)],
        [departure("cogging-48-phase", "cogging")],
    ],
)
def test_what_departed_and_cannot_be_adopted_is_said(seen: list[tuple[Quantity, Change]]) -> None:
    quantities, changes = zip(*seen, strict=True)
    assert not any(is_adoptable(one, quantities) for one in quantities)
    with pytest.raises(CalibrationError) as caught:
        adopt(CALIBRATION, quantities, changes, CALIBRATION.created)
    said = str(caught.value)
    assert f"what has departed from calibration {CALIBRATION.id} is the {seen[0][0].name}: " in said
    assert "agrees" not in said
    assert said.endswith("calibrate again")


def test_what_is_adopted_moves_nothing_else() -> None:
    seen = [departure("offset-common", "common")]
    seen += [departure(f"offset-{phase}", "offset", 9.0 * (phase == "a")) for phase in "abc"]
    quantities, changes = zip(*seen, strict=True)
    assert [is_adoptable(one, quantities) for one in quantities] == [False, True, True, True]
    adopted = adopt(CALIBRATION, quantities, changes, CALIBRATION.created)
    moved_A = np.array(adopted.beta_A) - CALIBRATION.beta_A
    assert moved_A == pytest.approx([6e-3, 0.0, 0.0])
    assert adopted.alpha == CALIBRATION.alpha


@pytest.mark.parametrize(("mean_A", "of_mean_A"), [(0.4, 3e-3 / 3**0.5), (0.0, 0.0)])
def test_the_error_of_the_mean_offset_stays(mean_A: float, of_mean_A: float) -> None:
    seen = [departure(f"offset-{phase}", "offset") for phase in "abc"]
    offsets_A = tuple(mean_A + apart_A for apart_A in (-0.1, 0.0, 0.1))
    calibration = changed(beta_A=offsets_A, beta_stderr_A=(3e-3,) * 3)
    adopted = adopt(calibration, *zip(*seen, strict=True), calibration.created)
    assert adopted.beta_stderr_A == pytest.approx([np.hypot(2e-3 * 2 / 3, of_mean_A)] * 3)
    assert adopted.budget[0].beta_A == adopted.beta_stderr_A


def test_the_budget_has_the_degrees_of_freedom_of_what_was_adopted() -> None:
    first, second = CALIBRATION.tau_cog_harmonics[:2]
    parts = ("amplitude", "phase")
    seen = [departure(f"cogging-{first.order}-{part}", "cogging") for part in parts]
    quantities, changes = zip(*seen, strict=True)
    stated = CALIBRATION.budget[0].model_copy(update={"degrees_of_freedom": (None,) * 3 + (7.0,)})
    calibration = changed(budget=(stated,))
    adopted = adopt(calibration, quantities, changes, calibration.created)
    assert adopted.tau_cog_harmonics[0].degrees_of_freedom == 50.0
    assert adopted.tau_cog_harmonics[1] == second
    assert adopted.budget[0].cogging_Nm == adopted.tau_cog_harmonics[0].stderr_Nm == 2e-3
    assert adopted.budget[0].degrees_of_freedom[3] == 50.0


def test_what_has_not_departed_and_is_known_no_better_stays(
    quiet_tracker: CalibrationTracker,
) -> None:
    with pytest.raises(CalibrationError, match="nothing to adopt: operation agrees"):
        quiet_tracker.adopted()


@pytest.mark.parametrize(
    ("freedom", "better"), [(50.0, False), (1.0, True)], ids=["many turns", "one degree of freedom"]
)
def test_better_known_is_what_has_the_narrower_interval(freedom: float, better: bool) -> None:
    """An error that is smaller, but hardly known itself, makes an interval that is wider."""
    order = CALIBRATION.tau_cog_harmonics[0].order
    seen = [departure(f"cogging-{order}-{part}", "cogging") for part in ("amplitude", "phase")]
    quantities = [replace(q, stderr=0.8 * c.stderr, degrees_of_freedom=freedom) for q, c in seen]
    changes = [replace(change, drifted=False) for _, change in seen]
    if better:
        found = adopt(CALIBRATION, quantities, changes, CALIBRATION.created)
        assert found.tau_cog_harmonics[0].stderr_Nm == 1e-3 * changes[0].stderr
        return
    with pytest.raises(CalibrationError, match="shows nothing better"):
        adopt(CALIBRATION, quantities, changes, CALIBRATION.created)


def test_memory_is_bounded(half: np.ndarray) -> None:
    memory_s = half.size / CONFIG.loop.rate_Hz / FORGOTTEN
    tracker = CalibrationTracker(CONFIG, CALIBRATION, memory_s)
    sizes = []
    for times in range(2):
        tracker.take(later(half, times))
        sizes.append(len(pickle.dumps(tracker)))
    assert sizes[1] < 1.1 * sizes[0]
    standing = np.repeat(later(half, 1)[-1:], 1000)
    standing["tick"] += np.arange(1, 1001, dtype=np.uint64)
    standing["t_ns"] += np.arange(1, 1001) * 1_000_000
    for second in range(round(1.5 * LONGEST_S)):
        tracker.take(later(standing, second))
    assert len(pickle.dumps(tracker)) < sizes[1] + 1.1 * LONGEST_S * 1000 * 52


def test_no_memory_makes_windows_longer_than_a_slow_rotor_does() -> None:
    with pytest.raises(ValueError, match="memory_s"):
        TrackingConfig(memory_s=1.01 * LONGEST_S / WINDOW_SHARE)


def test_a_calibration_of_another_motor_is_refused() -> None:
    motor = CONFIG.motor.model_copy(update={"serial": "another"})
    other: Config = CONFIG.model_copy(update={"motor": motor})
    with pytest.raises(CalibrationError, match="another motor"):
        CalibrationTracker(other, CALIBRATION, MEMORY_S)


def test_without_currents_it_says_so(half: np.ndarray) -> None:
    ticks = half.copy()
    for phase in "abc":
        ticks[f"i_{phase}_A"] = np.nan
    found = tracker_of(ticks).tracked()
    assert found is not None
    assert found.quantities == ()
    assert "were not recorded" in found.obstacle


def test_counts_out_of_range_are_left_out_and_those_of_another_encoder_said(
    half: np.ndarray, half_tracked: TrackedCalibration
) -> None:
    ticks = half.copy()
    ticks["encoder_count"][::5000] = 65535
    found = tracked_of(ticks)
    assert (found.turns, found.obstacle) == (half_tracked.turns, "")
    ticks["encoder_count"] += 100
    refused = tracker_of(ticks).tracked()
    assert refused is not None
    assert "counts a turn; correct counts" in refused.obstacle


def test_a_torque_that_was_left_long_ago_says_little_of_gains_now() -> None:
    ticks = operate(270, (5.0,) + (2.0,) * 8)
    tracker = tracker_of(ticks[:90_000])
    early = stated_of(tracker)
    tracker.take(ticks[90_000:])
    late = stated_of(tracker)
    assert early.quantities[0].name == late.quantities[0].name == "alpha-a"
    assert late.quantities[0].half_width > 1.8 * early.quantities[0].half_width
