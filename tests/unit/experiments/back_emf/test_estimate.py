"""Back-EMF of driven rotors against the truth, over motors, encoders and what recordings lack."""

from dataclasses import replace

import numpy as np
import pytest

from motord.config import AccuracyConfig
from motord.experiments.back_emf.between_speeds import (
    Delay,
    average,
    correlated_freedom,
    delay_with_scatter,
    distinct_speeds,
)
from motord.experiments.back_emf.estimate import fit_delay, measure
from motord.experiments.back_emf.result import MeasuredBackEmf
from motord.experiments.back_emf.voltages import VoltageSamples
from motord.experiments.magnet_temperature import UNKNOWN
from motord.identification import IdentifyError
from motord.identification.cluster_robust_ls import ClusterFit, Regressors, first_rows
from motord.identification.operating_points import PointData
from motord.intervals import coverage_factor
from tests.campaigns.back_emf import BOUND_PERCENT, errors, measured
from tests.campaigns.driven import MOTORS, REPORT, Motor, bench_of, inverter_apart, ticks_of


def test_the_simulated_rig_within_the_bound() -> None:
    found, truth = measured(REPORT, 1, turns=15)
    line_percent, table_percent, z = errors(found, truth)
    assert line_percent < BOUND_PERCENT
    assert table_percent < BOUND_PERCENT
    assert np.sqrt((z**2).mean()) == pytest.approx(1.0, abs=0.3)
    assert (found.order[found.kept] // 8).tolist()[:4] == [1, 3, 5, 7]
    assert found.delay_s is not None
    assert abs(found.delay_s[0]) < 4 * found.delay_s[1] < 5e-5
    assert found.noise_V == pytest.approx(0.02, rel=0.1)
    assert np.abs(found.offset_V).max() < 1e-3
    assert found.fundamental == pytest.approx(0.206, rel=1e-3)


@pytest.mark.parametrize("motor", MOTORS, ids=lambda motor: motor.name)
def test_any_motor(motor: Motor) -> None:
    found, truth = measured(motor, 2, apart=False, speeds_Hz=(0.87, 1.37), turns=9)
    line_percent, table_percent, _ = errors(found, truth)
    assert line_percent < 2 * BOUND_PERCENT  # a third of the campaign's turns
    assert table_percent < 2 * BOUND_PERCENT
    assert found.table().shape == (motor.counts, 3)


@pytest.fixture(scope="module")
def fast_points() -> list[PointData]:
    """Points of a loop of 4 kHz, for what is between the ticks of others."""
    return ticks_of("back-emf", REPORT, 3, rate_Hz=4000, speeds_Hz=(0.6, 1.2), turns=8)[2]


@pytest.fixture(scope="module")
def points(fast_points: list[PointData]) -> list[PointData]:
    """The same at 1 kHz."""
    return [replace(point, ticks=point.ticks[::4].copy()) for point in fast_points]


@pytest.fixture(scope="module")
def found(points: list[PointData]) -> MeasuredBackEmf:
    return measure(points, bench_of(REPORT)[0].motor)


def test_an_age_that_the_recording_does_not_state_is_found(fast_points: list[PointData]) -> None:
    motor = bench_of(REPORT)[0].motor
    late = []
    for point in fast_points:
        ticks = point.ticks[4::4].copy()
        for phase in "abc":
            ticks[f"u_{phase}_V"] = point.ticks[f"u_{phase}_V"][2:-2:4][: ticks.size]
        late.append(replace(point, ticks=ticks))
    found = measure(late, motor)
    assert found.delay_s is not None
    assert found.delay_s[0] == pytest.approx(0.5e-3, abs=4 * found.delay_s[1])
    angle = np.angle(1j * found.line[0, 0])
    assert angle == pytest.approx(0.0, abs=4 * found.phase_stderr[0, 0] / 0.206)
    alone = measure(late[:1], motor)
    assert alone.delay_s is None
    assert np.angle(1j * alone.line[0, 0]) == pytest.approx(-8 * 3.77 * 0.5e-3, rel=0.1)


@pytest.mark.parametrize(
    ("part", "moved_counts", "size_percent", "said"),
    [
        (1.05, 0, None, ""),
        (1 / 3**0.5, 0, 42.3, "0.577 times that of [motor] back_emf and 0 deg"),
        (-1.0, 0, 200.0, "1 times that of [motor] back_emf"),
        (1.0, 128, 141.4, "1 times that of [motor] back_emf and -90 deg"),
    ],
)
def test_a_fundamental_far_from_the_configured_one_is_a_finding(
    points: list[PointData], part: float, moved_counts: int, size_percent: float | None, said: str
) -> None:
    motor = bench_of(REPORT)[0].motor
    changed = [replace(point, ticks=point.ticks.copy()) for point in points]
    for point in changed:
        point.ticks["encoder_count"] = (point.ticks["encoder_count"] + moved_counts) % motor.counts
        for phase in "abc":
            point.ticks[f"u_{phase}_V"] *= part
    named = {one.name: one for one in measure(changed, motor).findings}
    assert ("other-than-configured" in named) == (size_percent is not None)
    if size_percent is not None:
        assert named["other-than-configured"].value == pytest.approx(size_percent, rel=0.01)
        assert said in named["other-than-configured"].meaning


def with_misread_counts(points: list[PointData], share: float) -> list[PointData]:
    """Return points of which a share of the samples has one coarse line changed."""
    rng, wrong = np.random.default_rng(5), []
    for point in points:
        ticks = point.ticks.copy()
        at = np.flatnonzero(rng.random(ticks.size) < share)
        ticks["encoder_count"][at] ^= 1 << rng.integers(8, 12, at.size)
        wrong.append(replace(point, ticks=ticks))
    return wrong


@pytest.mark.parametrize("share", [0.025, 0.04])
def test_misread_counts_are_left_out_and_said(points: list[PointData], share: float) -> None:
    """One of 40 made the fundamental 0.56 times what it is."""
    found = measure(with_misread_counts(points, share), bench_of(REPORT)[0].motor)
    assert found.fundamental == pytest.approx(0.206, rel=5e-3)
    assert "encoder-misread" in {one.name for one in found.findings}


def test_more_misread_counts_than_can_be_left_out_are_refused(points: list[PointData]) -> None:
    with pytest.raises(IdentifyError, match=r"the encoder is misread in [\d.]+% of the samples"):
        measure(with_misread_counts(points, 0.25), bench_of(REPORT)[0].motor)


@pytest.mark.parametrize("share", [0.005, 0.025])
def test_misread_counts_four_in_a_row_state_no_figures(
    points: list[PointData], share: float
) -> None:
    """The fundamental was 0.57 and 0.24 times what it is."""
    wrong = []
    for point in points:
        ticks = point.ticks.copy()
        count = ticks["encoder_count"]
        for first in range(50, ticks.size - 4, round(4 / share)):
            count[first : first + 4] ^= 1 << 10
        wrong.append(replace(point, ticks=ticks))
    with pytest.raises(IdentifyError, match="several in a row"):
        measure(wrong, bench_of(REPORT)[0].motor)


def test_samples_that_repeat_one_of_the_inverter_count_once(fast_points: list[PointData]) -> None:
    motor = bench_of(REPORT)[0].motor
    held = []
    for point in fast_points:
        ticks = point.ticks.copy()
        rows = np.arange(ticks.size) // 4 * 4
        for phase in "abc":
            ticks[f"u_{phase}_V"] = ticks[f"u_{phase}_V"][rows]
        ticks["i_age_ns"] = ticks["t_ns"] - ticks["t_ns"][rows]
        held.append(replace(point, ticks=ticks))
    found = measure(held, motor)
    every = measure([inverter_apart(point, 4, 1) for point in fast_points], motor)
    assert np.abs(found.line[0] - every.line[0]).max() < 0.003 * 0.206
    assert found.stderr[0, 0] == pytest.approx(every.stderr[0, 0], rel=0.4)


def test_an_order_that_is_no_multiple_of_the_pole_pairs_is_kept(points: list[PointData]) -> None:
    motor = bench_of(REPORT)[0].motor
    bent = []
    for point in points:
        ticks = point.ticks.copy()
        angle_rad = 2 * np.pi * ticks["encoder_count"] / 4096
        ticks["u_b_V"] += 0.01 * ticks["speed_rad_s"] * np.sin(9 * angle_rad + 0.3)
        bent.append(replace(point, ticks=ticks))
    found = measure(bent, motor)
    place = int(np.flatnonzero(found.order == 9)[0])
    assert found.kept[place]
    assert abs(found.line[place, 1]) == pytest.approx(0.01, rel=0.1)
    assert abs(found.line[place, 0]) < 0.001


def test_what_cannot_be_identified_is_refused(points: list[PointData]) -> None:
    config, _ = bench_of(REPORT)
    motor, point = config.motor, points[1]
    with pytest.raises(IdentifyError, match="no good operating point"):
        measure([], motor)
    without = replace(point, ticks=point.ticks[["t_ns", "encoder_count", "u_a_V"]])
    with pytest.raises(IdentifyError, match="has no u_b_V, u_c_V: no phase voltages"):
        measure([without], motor)
    dead = point.ticks.copy()
    dead["u_c_V"] = 0.0
    with pytest.raises(IdentifyError, match="nothing was recorded in u_c_V"):
        measure([replace(point, ticks=dead)], motor)
    with pytest.raises(IdentifyError, match="samples a turn cannot show 8 periods"):
        measure([replace(point, ticks=point.ticks[::55].copy())], motor)


def test_voltages_of_other_pole_pairs_or_of_none_are_refused(points: list[PointData]) -> None:
    motor = bench_of(REPORT)[0].motor
    for pole_pairs in (4, 7, 16):
        with pytest.raises(IdentifyError, match=f"8 periods a turn, where .* {pole_pairs}: "):
            measure(points, motor.model_copy(update={"pole_pairs": pole_pairs}))
    noise = points[1].ticks.copy()
    rng = np.random.default_rng(1)
    for phase in "abc":
        noise[f"u_{phase}_V"] = rng.normal(0, 0.01, noise.size)
    with pytest.raises(IdentifyError, match="voltages are noise"):
        measure([replace(points[1], ticks=noise)], motor)


def test_standard_errors_know_of_noise_that_holds_over_a_turn() -> None:
    rng = np.random.default_rng(1)
    turn = np.repeat(np.arange(40), 100)
    columns = np.column_stack([np.ones(4000), np.tile(np.linspace(-1, 1, 100), 40)])
    truth = np.array([2.0, -1.0])
    apart = []
    for _ in range(200):
        noise = rng.standard_normal(4000) + rng.standard_normal(40)[turn]
        fit = Regressors.of(columns, first_rows(turn)).fit(columns @ truth + noise)
        apart.append((fit.solution - truth) / np.sqrt(np.diag(fit.covariance)))
    rms = np.sqrt((np.array(apart) ** 2).mean(axis=0))
    assert rms[0] == pytest.approx(1.0, abs=0.25)
    assert rms[1] < 1.2


def test_one_more_column_is_the_same_as_fitting_it_too() -> None:
    rng = np.random.default_rng(2)
    turn = np.repeat(np.arange(10), 50)
    columns = rng.standard_normal((500, 4))
    more = columns @ np.array([0.3, 0.1, -0.2, 0.0]) + rng.standard_normal(500)
    values = 0.7 * more + rng.standard_normal(500)
    regressors = Regressors.of(columns, first_rows(turn))
    coefficient, variance = regressors.one_more(regressors.fit(values), more)
    together = Regressors.of(np.column_stack([columns, more]), regressors.first).fit(values)
    assert coefficient == pytest.approx(together.solution[-1])
    assert variance == pytest.approx(together.covariance[-1, -1], rel=0.05)


def test_without_noise_the_lines_are_averaged_all_the_same() -> None:
    """Data that is fitted exactly has no variance to weigh it by."""
    solution = np.array([1.0, 0.5, 0.0])
    exact = ClusterFit(solution, np.zeros((3, 3)), np.zeros(8), 0.0)
    found = average([[exact] * 3, [exact] * 3], np.zeros((2, 1)), 8)
    assert found.line == pytest.approx(np.full((1, 3), 1.0 - 0.5j), rel=1e-12)
    assert np.isfinite(found.stderr).all()
    assert found.stderr.max() < 1e-12


def fits_of(lines: np.ndarray, variance: np.ndarray) -> list[list[ClusterFit]]:
    """Return fits of which each order is a trial: the average is of each order by itself.

    lines (trials, n, 3): of n speeds and three phases; variance (n,): of each speed's components.
    """
    waves = np.stack([lines.real, -lines.imag], axis=-1)
    one = np.eye(2 * len(lines) + 1)
    return [
        [
            ClusterFit(np.append(waves[:, n, phase], 0.0), own, np.zeros(8), 0.0)
            for phase in range(3)
        ]
        for n, own in enumerate(each * one for each in variance)
    ]


@pytest.mark.parametrize(
    ("speeds", "drift"), [(2, 0.01), (3, 0.01), (6, 0.01), (6, 3e-4), (3, 0.0)]
)
@pytest.mark.parametrize("turned", [1.0, 1.0j])
def test_what_moves_all_phases_from_speed_to_speed_is_in_the_interval(
    speeds: int, drift: float, turned: complex
) -> None:
    """An amplitude (turned by 1) or a phase (1j) that is another at each speed."""
    rng = np.random.default_rng(speeds)
    turns_stderr, trials, lines = 1e-4, 400, []
    for _ in range(trials):
        moved = 1 + drift * turned * rng.standard_normal(speeds)
        lines.append(
            moved[:, None] + turns_stderr * (rng.standard_normal((speeds, 3, 2)) @ [1, 1j])
        )
    fits = fits_of(np.array(lines), np.full(speeds, turns_stderr**2))
    found = average(fits, np.zeros((speeds, trials)), 40)
    off = found.line.mean(axis=1) - 1
    place = 0 if turned == 1.0 else 1
    factor = np.array([coverage_factor(n) for n in found.freedom[:, place]])
    half = factor * found.mean_stderr[:, place]
    held = np.abs((off / turned).real) < half
    assert np.mean(held) >= 0.95 - 0.022  # two standard errors of the trials
    if drift > 10 * turns_stderr:
        assert np.median(half) < 1.5 * coverage_factor(speeds - 1) * drift / np.sqrt(speeds)
    if not drift:
        assert np.median(half) < 2 * 1.96 * turns_stderr / np.sqrt(3 * speeds)


def test_back_emf_is_that_of_the_reference_temperature(points: list[PointData]) -> None:
    plain = bench_of(REPORT)[0].motor
    keys = {"back_emf_temperature_percent_per_K": -0.1, "back_emf_reference_C": 20.0}
    motor = plain.model_copy(update=keys)
    before = measure(points, motor)
    assert before.referred is None
    warm = []
    for point, factor in zip(points, (0.97, 0.95), strict=True):
        ticks = point.ticks.copy()
        for phase in "abc":
            ticks[f"u_{phase}_V"] *= factor
        warm.append(replace(point, ticks=ticks, back_emf_factor=factor))
    found = measure(warm, motor)
    assert found.fundamental == pytest.approx(before.fundamental, rel=1e-4)
    assert found.referred is not None
    finding = found.referred.finding(AccuracyConfig())
    assert (finding.severity, finding.value) == ("note", pytest.approx(-4.0))
    assert "from magnets of 50.0 to 70.0 degC" in finding.meaning
    some = measure([warm[0], replace(warm[1], back_emf_factor=np.nan)], motor)
    assert some.speeds_Hz == found.speeds_Hz[: len(some.speeds_Hz)]
    assert [one.reason for one in some.left_out][-1] == UNKNOWN
    with pytest.raises(IdentifyError, match="not known in any of the runs: repair its channel"):
        measure([replace(one, back_emf_factor=np.nan) for one in points], motor)


@pytest.mark.parametrize(
    ("speeds", "drift", "takes"),
    [(3, 0.02, 1), (6, 0.02, 1), (6, 3e-4, 1), (6, 0.0, 1), (3, 0.02, 2), (4, 0.02, 3)],
)
def test_a_phase_that_drifts_is_in_the_interval_of_the_age(
    speeds: int, drift: float, takes: int
) -> None:
    """400 trials: lines whose phase is another at each speed (rad), an age fitted through them.

    takes: of each speed, at which the phase is the same.
    """
    rng = np.random.default_rng(speeds)
    turns_stderr, order, trials = 1e-4, 8, 400
    velocity_rad_s = np.tile(2 * np.pi * np.linspace(0.5, 1.0, speeds), takes)
    weight = velocity_rad_s**2
    apart = velocity_rad_s - weight @ velocity_rad_s / weight.sum()
    shifts, lines = [], []
    for _ in range(trials):
        angle = np.tile(drift * rng.standard_normal(speeds), takes)
        error = turns_stderr / velocity_rad_s[:, None] * rng.standard_normal((speeds * takes, 3))
        line = np.exp(1j * (angle[:, None] + error))
        shift = (weight * apart) @ np.angle(line).mean(axis=1) / (weight @ apart**2)
        lines.append(line * np.exp(-1j * shift * velocity_rad_s)[:, None])
        shifts.append(shift)
        speed = distinct_speeds(velocity_rad_s * rng.uniform(0.999, 1.001, velocity_rad_s.size))
        assert speed.max() + 1 == speeds
    fits = fits_of(np.array(lines), (turns_stderr / velocity_rad_s) ** 2)
    found = average(fits, np.zeros((speeds * takes, trials)), 40, speed=speed, age_fitted=True)
    held_age, held_phase, half = [], [], []
    for trial, shift in enumerate(shifts):
        of_turns_s = turns_stderr / order / np.sqrt(3 * (apart**2 * weight).sum())
        tau2 = float(found.between[trial]) / order**2
        delay = delay_with_scatter(
            Delay(shift / order, of_turns_s, 40),
            tau2,
            found.phase_scatter[trial],
            velocity_rad_s,
            weight,
        )
        half.append(coverage_factor(delay.freedom) * delay.stderr_s)
        held_age.append(abs(delay.age_s) < half[-1])
        across, turned = found.mean_stderr[trial, 1], order * delay.stderr_s * velocity_rad_s.mean()
        stderr = np.hypot(across, turned)
        freedom = correlated_freedom((across, found.freedom[trial, 1]), (turned, delay.freedom))
        fewest, most = sorted((found.freedom[trial, 1], delay.freedom))
        assert fewest <= freedom * (1 + 1e-9)
        assert freedom <= max(most, 1.0) * (1 + 1e-9)
        factor = coverage_factor(freedom)
        held_phase.append(abs(np.angle(found.line[trial].mean())) < factor * stderr)
    assert np.mean(held_age) >= 0.95 - 0.022  # two standard errors of the trials
    assert np.mean(held_phase) >= 0.95 - 0.022
    if not drift:
        assert np.median(half) < 2 * 1.96 * of_turns_s
    if drift == 0.02:
        assert np.mean(held_age) <= 0.985
        assert np.mean(held_phase) <= 0.985
        assert np.median(half) > 10 * 1.96 * of_turns_s  # all that was stated before


def test_two_speeds_do_not_show_a_phase_that_drifts(
    points: list[PointData], found: MeasuredBackEmf
) -> None:
    """However often they are taken; a third one does."""
    motor = bench_of(REPORT)[0].motor
    assert found.delay_s is not None
    for taken in (found, measure([*points, *points], motor)):
        [finding] = [one for one in taken.findings if one.name == "phase-drift-not-seen"]
        assert (finding.value, finding.limit) == (2, 3)
    slipped = replace(points[0], ticks=points[0].ticks.copy())
    slipped.ticks["encoder_count"] = (slipped.ticks["encoder_count"] + 3) % motor.counts
    apart = measure([*points, slipped], motor)  # takes of one speed show how these differ
    assert "phase-drift-not-seen" in {one.name for one in apart.findings}
    assert apart.delay_s is not None
    assert apart.delay_s.stderr_s > 3 * found.delay_s.stderr_s
    assert apart.delay_s.freedom < 3 < found.delay_s.freedom
    [third] = ticks_of("back-emf", REPORT, 4, rate_Hz=1000, speeds_Hz=(0.9,), turns=8)[2]
    turned = replace(third, ticks=third.ticks.copy())
    turned.ticks["encoder_count"] = (turned.ticks["encoder_count"] + 3) % motor.counts
    drifted = measure([*points, turned], motor)
    assert not {one.name for one in drifted.findings} & {"phase-drift-not-seen", "few-turns"}
    assert drifted.delay_s is not None
    assert drifted.delay_s.stderr_s > 3 * found.delay_s.stderr_s
    assert drifted.delay_s.freedom < 3 < found.delay_s.freedom
    steady = measure([*points, third], motor).harmonics[0]
    assert steady.degrees_of_freedom > 3  # of the amplitude, which no age is in
    first = drifted.harmonics[0]
    assert first.phase_degrees_of_freedom < 3
    assert first.degrees_of_freedom == drifted.freedom[0, 0]


def test_speeds_are_distinct_with_their_signs_beyond_two_percent() -> None:
    velocity_rad_s = np.array([6.0, -3.0, 3.0, 6.05, -3.02, 3.05])
    assert distinct_speeds(velocity_rad_s).tolist() == [2, 0, 1, 2, 0, 1]
    many = distinct_speeds(np.linspace(1.0, 2.0, 101))  # no chain of speeds is one
    assert 20 <= many.max() + 1 <= 50


def test_few_turns_show_noise_that_holds_over_a_turn_and_fewer_are_a_finding(
    points: list[PointData], found: MeasuredBackEmf
) -> None:
    """An age by 4 turns whose phases differ: its error was that of white noise below 6 turns."""
    rng = np.random.default_rng(4)
    turn = np.repeat(np.arange(4), 500)
    speed_rad_s = np.repeat([4.0, 4.0, 8.0, 8.0], 500)
    angle_rad = np.tile(np.linspace(0, 2 * np.pi, 500, endpoint=False), 4)
    z = []
    for _ in range(200):
        moved_rad = angle_rad + 1e-2 / 8 * rng.standard_normal(4)[turn]
        phases = [np.cos(8 * moved_rad - 2 * np.pi / 3 * phase) for phase in range(3)]
        u_V = speed_rad_s[:, None] * np.array(phases).T
        u_V += 0.01 * rng.standard_normal(u_V.shape)
        delay_s, stderr_s = fit_delay(
            VoltageSamples(u_V, angle_rad, speed_rad_s, turn), np.array([8])
        )
        z.append(delay_s / stderr_s)
    assert 0.5 < np.median(np.abs(z)) < 6  # 0.67 of many turns alike in the phases
    motor = bench_of(REPORT)[0].motor
    short = [
        replace(point, ticks=point.ticks[: int(2.6 * 1000 / point.speed_Hz)]) for point in points
    ]
    for taken, named in ((found, False), (measure(short, motor), True)):
        assert (min(taken.turns) < 3) == named
        assert ("few-turns" in {one.name for one in taken.findings}) == named
