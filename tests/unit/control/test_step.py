"""The whole kernel: enabling, torque, compensation, limits under any input, trips."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.control.step import FAST_BARS_NS
from motord.schema import BridgeStatus, Compensate, Flag, InverterStatus, Request, State, Trip
from tests.support.properties import examples
from tests.unit.control.bench import Bench, make_config

BOTH = Compensate.CURRENTS | Compensate.COGGING


def calibration(
    config, alpha=(1.0, 1.0, 1.0), beta_A=(0.0, 0.0, 0.0), amplitude_Nm=0.0, learned=None
):
    theta_rad = 2 * np.pi * np.arange(config.motor.counts) / config.motor.counts
    return SimpleNamespace(
        alpha=alpha,
        beta_A=beta_A,
        delta_epsilon=1.0,
        tau_cog_Nm=amplitude_Nm * np.sin(48 * theta_rad + 0.4),
        learned=learned,
    )


def back_emf_at(bench: Bench, angle_rad: float) -> np.ndarray:
    theta_rad = np.arange(4097) * 2 * np.pi / 4096
    table = np.vstack([bench.back_emf, bench.back_emf[:1]])
    return np.array([np.interp(angle_rad, theta_rad, table[:, phase]) for phase in range(3)])


@pytest.mark.kernel
def test_starts_off_and_stays_off() -> None:
    bench = Bench()
    bench.setpoint["torque_Nm"] = 3.0
    tick = bench.run(50)
    assert tick.state == State.OFF
    assert bench.command["enable"][0] == 0
    assert not bench.currents_A().any()


def test_a_request_from_before_the_start_is_not_carried_out() -> None:
    bench = Bench()
    bench.ask(Request.ENABLE)
    assert bench.run(20).state == State.OFF


@pytest.mark.kernel
@pytest.mark.parametrize("connection", ["independent", "star"])
def test_torque_is_what_was_asked_for(connection: str) -> None:
    bench = Bench(make_config(motor={"connection": connection}))
    bench.enable(torque_Nm=3.0)
    bench.run(400)
    for _ in range(20):
        tick = bench.run()
        k = back_emf_at(bench, float(tick.angle_predicted_rad))
        assert bench.currents_A() @ k == pytest.approx(3.0, rel=2e-4)
        if connection == "star":
            assert abs(bench.currents_A().sum()) < 1e-5


@pytest.mark.kernel
@given(
    alpha_a=st.floats(0.8, 1.2),
    alpha_b=st.floats(0.8, 1.2),
    beta_a_A=st.floats(-1, 1),
    beta_b_A=st.floats(-1, 1),
    torque_Nm=st.floats(-4, 4),
    turned=st.integers(0, 50),
)
@settings(max_examples=examples(40))
def test_compensation_inverts_the_model(
    alpha_a: float, alpha_b: float, beta_a_A: float, beta_b_A: float, torque_Nm: float, turned: int
) -> None:
    """What flows is alpha i + beta: with cogging added, the torque is the set-point (4.1)."""
    config = make_config()
    alpha = np.array([alpha_a, alpha_b, 1 / (alpha_a * alpha_b)])
    beta_A = np.array([beta_a_A, beta_b_A, -beta_a_A - beta_b_A])
    bench = Bench(config, calibration(config, tuple(alpha), tuple(beta_A), 0.3))
    bench.enable(torque_Nm=torque_Nm, compensate=BOTH)
    tick = bench.run(450 + turned)
    angle_rad = float(tick.angle_predicted_rad)
    flowing_A = alpha * bench.currents_A() + beta_A
    cogging_Nm = float(tick.cogging_comp_Nm)
    assert flowing_A @ back_emf_at(bench, angle_rad) + cogging_Nm == pytest.approx(
        torque_Nm, abs=3e-3
    )
    assert cogging_Nm == pytest.approx(0.3 * math.sin(48 * angle_rad + 0.4), abs=2e-3)
    assert tick["flags"] & Flag.CURRENTS_COMPENSATED
    assert tick["flags"] & Flag.COGGING_COMPENSATED


@pytest.mark.kernel
def test_induced_errors_are_what_would_flow_with_such_a_motor() -> None:
    """With the true errors compensated, what flows is gain i + offset; cogging is scaled."""
    config = make_config()
    alpha, beta_A = np.array([0.8, 1.25, 1.0]), np.array([1.0, -0.5, -0.5])
    bench = Bench(config, calibration(config, tuple(alpha), tuple(beta_A), 0.3))
    gain, offset_A = np.array([0.9, 1.2, 1.0]), np.array([0.4, -0.1, -0.3])
    bench.setpoint["induced_gain"] = gain - 1
    bench.setpoint["induced_offset_A"] = offset_A
    bench.setpoint["induced_cogging"] = -0.4
    bench.enable(torque_Nm=3.0, compensate=BOTH)
    tick = bench.run(450)
    angle_rad = float(tick.angle_predicted_rad)
    k = back_emf_at(bench, angle_rad)
    cogging_Nm = 0.6 * 0.3 * math.sin(48 * angle_rad + 0.4)
    assert float(tick.cogging_comp_Nm) == pytest.approx(cogging_Nm, abs=2e-3)
    wanted_A = gain * (3.0 - float(tick.cogging_comp_Nm)) * k / (k @ k) + offset_A
    np.testing.assert_allclose(alpha * bench.currents_A() + beta_A, wanted_A, atol=5e-3)


def test_torque_ramps() -> None:
    bench = Bench(make_config(limits={"torque_rate_Nm_per_s": 10.0}))
    bench.enable(torque_Nm=2.0)
    before_Nm = float(bench.tick["torque_set_Nm"][0])
    tick = bench.run(50)
    assert float(tick.torque_set_Nm) - before_Nm == pytest.approx(0.5, abs=1e-3)
    assert tick["flags"] & Flag.RAMPING
    tick = bench.run(300)
    assert float(tick.torque_set_Nm) == pytest.approx(2.0)
    assert not tick["flags"] & Flag.RAMPING


def test_disable_ramps_down_first() -> None:
    bench = Bench()
    bench.enable(torque_Nm=1.0)
    bench.run(300)
    bench.ask(Request.DISABLE)
    tick = bench.run(50)
    assert tick.state == State.ENABLED
    assert 0.4 < float(tick.torque_set_Nm) < 0.6
    tick = bench.run(80)
    assert tick.state == State.READY
    assert bench.command["enable"][0] == 0


@pytest.mark.parametrize("end", ["disable", "silence", "zero"])
@pytest.mark.parametrize("missing", [0, 4])
def test_down_to_zero_takes_a_second_at_most(end: str, missing: int) -> None:
    """However gentle the way up is, and though the loop misses four of five ticks."""
    bench = Bench(make_config(limits={"torque_rate_Nm_per_s": 0.5, "torque_Nm": 2.0}))
    bench.enable(torque_Nm=2.0)
    bench.run(4000)
    assert float(bench.tick["torque_set_Nm"][0]) == pytest.approx(2.0)
    if end == "disable":
        bench.ask(Request.DISABLE)
    elif end == "zero":
        bench.setpoint["torque_Nm"] = 0.0
    begun_ns, supervised = bench.now_ns, end != "silence"
    while float(bench.run(supervised=supervised).torque_set_Nm) > 0.0:
        bench.now_ns += missing * bench.period_ns
        bench.angle_rad += bench.speed_rad_s * missing * bench.period_ns * 1e-9
    took_s = (bench.now_ns - begun_ns) * 1e-9
    took_s -= 0.0 if supervised else bench.config.loop.supervisor_timeout_s
    assert 0.99 <= took_s <= 1.012


def test_stop_is_at_once() -> None:
    bench = Bench()
    bench.enable(torque_Nm=3.0)
    bench.run(400)
    bench.ask(Request.STOP)
    assert bench.run().state == State.OFF
    assert not bench.currents_A().any()


wild = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True, width=32),
    st.sampled_from([0.0, 24.0, math.nan, math.inf, -math.inf]),
)


@given(data=st.data())
@settings(max_examples=examples(150))
def test_limits_hold_for_any_input(data: st.DataObject) -> None:
    """Currents and torque never exceed their limits, whatever sensors and set-points say."""
    config = make_config(limits={"current_A": 12.0})
    bench = Bench(config, calibration(config, (0.8, 1.118, 1.118), (1.0, -0.5, -0.5), 0.3))
    bench.enable(torque_Nm=data.draw(wild), compensate=BOTH)
    for _ in range(6):
        f, s = bench.feedback[0], bench.setpoint[0]
        f.torque_Nm, f.u_bus_V, f.temperature_C = (data.draw(wild) for _ in range(3))
        f.i_A[:] = [data.draw(wild) for _ in range(3)]
        f.encoder_gray = data.draw(st.integers(0, 2**32 - 1))
        f.inverter_status = data.draw(st.sampled_from([1, 1, 0, 3, 2**32 - 1]))
        f.t_ns = bench.now_ns + data.draw(st.integers(-(10**10), 10**10))
        f.t_inverter_ns = bench.now_ns + data.draw(st.integers(-(10**10), 10**10))
        s.torque_Nm = data.draw(wild)
        s.compensate = data.draw(st.integers(0, 2**32 - 1))
        s.request = data.draw(st.integers(0, 2**32 - 1))
        s.request_seq += data.draw(st.integers(0, 1))
        bench.run(healthy=False)
        currents_A = bench.currents_A()
        assert np.isfinite(currents_A).all()
        assert np.abs(currents_A).max() <= 12.0
        assert abs(float(bench.tick["torque_set_Nm"][0])) <= config.limits.torque_Nm
        if bench.tick["state"][0] != State.ENABLED:
            assert not currents_A.any()


def trip_after(bench: Bench, ticks: int, **run: bool) -> int:
    tick = bench.run(ticks, **run)
    assert tick.state == State.TRIPPED, bin(tick.trip_bits)
    assert bench.command["enable"][0] == 0
    assert not bench.currents_A().any()
    return int(tick.first_trip)


def _over_current(b: Bench) -> None:
    b.feedback["i_A"][0, 1] = -36.0


def _over_torque(b: Bench) -> None:
    b.feedback["torque_Nm"] = 12.5


def _invalid(b: Bench) -> None:
    b.feedback["i_A"][0, 2] = math.nan


def _hot(b: Bench) -> None:
    b.feedback["temperature_C"] = 101.0


def _low_bus(b: Bench) -> None:
    b.feedback["u_bus_V"] = 17.9


def _high_bus(b: Bench) -> None:
    b.feedback["u_bus_V"] = 32.1


def _unknown_bus(b: Bench) -> None:
    b.feedback["u_bus_V"] = math.nan


def _fault(b: Bench) -> None:
    b.feedback["inverter_status"] = InverterStatus.READY | InverterStatus.FAULT


def _power_lost(b: Bench) -> None:
    b.feedback["inverter_status"] = 0


def _bus_off(b: Bench) -> None:
    b.feedback["inverter_status"] = InverterStatus.READY | InverterStatus.BUS_OFF


def _bridge_fault(b: Bench) -> None:
    b.feedback["bridge_status"] |= int(BridgeStatus.FAULT)


def _torque_invalid(b: Bench) -> None:
    b.feedback["bridge_status"] |= int(BridgeStatus.TORQUE_INVALID)


def _line_open(b: Bench) -> None:
    b.feedback["bridge_status"] = 0


def _over_speed(b: Bench) -> None:
    b.speed_rad_s = 21.0


def _overrun(b: Bench) -> None:
    b.tick["missed"] += 60


def _link_errors(b: Bench) -> None:
    b.feedback["link_errors"] += 60


TRIPS = [
    (_over_current, Trip.OVER_CURRENT, 5),
    (_over_torque, Trip.OVER_TORQUE, 8),
    (_invalid, Trip.FEEDBACK_INVALID, 1),
    (_hot, Trip.TEMPERATURE, 25),
    (_low_bus, Trip.BUS_VOLTAGE, 25),
    (_high_bus, Trip.BUS_VOLTAGE, 25),
    (_unknown_bus, Trip.BUS_VOLTAGE, 25),
    (_fault, Trip.INVERTER_FAULT, 4),
    (_power_lost, Trip.INVERTER_FAULT, 4),
    (_bus_off, Trip.BUS_OFF, 1),
    (_bridge_fault, Trip.BRIDGE_FAULT, 1),
    (_torque_invalid, Trip.TORQUE_STALE, 8),
    (_over_speed, Trip.OVER_SPEED, 60),
    (_overrun, Trip.LOOP_OVERRUN, 1),
    (_link_errors, Trip.LINK_ERRORS, 1),
    (_line_open, Trip.ENABLE_LINE, 6),
]


@pytest.mark.kernel
@pytest.mark.parametrize(("cause", "trip", "ticks"), TRIPS, ids=lambda x: getattr(x, "name", None))
def test_each_condition_trips(cause, trip: Trip, ticks: int) -> None:
    bench = Bench()
    bench.enable(torque_Nm=1.0)
    bench.run(20)
    cause(bench)
    assert trip_after(bench, ticks) == trip


@pytest.mark.parametrize(
    ("field", "value"),
    [("torque_Nm", 11.9), ("temperature_C", 99.0), ("u_bus_V", 18.1), ("u_bus_V", 31.9)],
)
def test_below_the_limit_nothing_trips(field: str, value: float) -> None:
    bench = Bench()
    bench.enable(torque_Nm=1.0)
    bench.feedback[field] = value
    bench.feedback["i_A"][0] = (34.9, 0.0, -34.9)
    assert bench.run(50).state == State.ENABLED


@pytest.mark.parametrize("tripped", [False, True])
def test_a_speed_that_falls_below_its_limit_for_a_sample_bars_enabling_and_reset(
    tripped: bool,
) -> None:
    """As the estimate from few counts does while the rotor is too fast."""
    bench = Bench()
    if tripped:
        bench.enable()
    _over_speed(bench)
    bench.run(60)
    bench.speed_rad_s = 0.0
    while abs(bench.memory["speed_rad_s"][0]) > 20.0:
        bench.run()
    request, before = Request.ENABLE, State.OFF
    if tripped:
        request, before = Request.RESET, State.TRIPPED
    bench.ask(request)
    for _ in range(FAST_BARS_NS // bench.period_ns - 2):
        tick = bench.run()
        assert tick.state == before
        assert tick.trip_bits & Trip.OVER_SPEED
    bench.run(2)
    bench.ask(request)
    assert bench.run().state == State.READY


def test_short_disturbances_are_debounced() -> None:
    bench = Bench()
    bench.enable()
    _over_torque(bench)
    bench.run(4)
    bench.feedback["torque_Nm"] = 0.0
    assert bench.run(10).state == State.ENABLED


def test_stale_devices_trip() -> None:
    for field, trip in (("t_ns", Trip.ENCODER_STALE), ("t_inverter_ns", Trip.INVERTER_STALE)):
        bench = Bench()
        bench.enable()
        bench.run(10)
        frozen = int(bench.feedback[field][0])
        for age in range(1, 40):
            count = bench.count_at(bench.angle_rad)
            now_ns = bench.now_ns + bench.period_ns
            bench.feedback["t_ns"] = bench.feedback["t_inverter_ns"] = now_ns
            bench.feedback["encoder_gray"] = count ^ (count >> 1)
            bench.feedback[field] = frozen
            tick = bench.run(healthy=False)
            assert (tick.state == State.TRIPPED) == (age > 20), (field, age)
        assert tick.first_trip == trip


def test_encoder_jumps_trip_after_three_samples() -> None:
    bench = Bench()
    bench.enable()
    bench.run(50)
    bench.angle_rad += 1.0
    assert bench.run(2).state == State.ENABLED
    assert bench.run(1).state == State.TRIPPED
    assert bench.tick["first_trip"][0] == Trip.ENCODER_IMPLAUSIBLE
    bench.run(10)  # the observer starts afresh, so a reset is possible
    bench.ask(Request.RESET)
    assert bench.run().state == State.READY


@pytest.mark.kernel
def test_i2t_trips_at_its_time() -> None:
    """At sqrt(2) times the continuous current the heat reaches the limit after i2t_time_s."""
    bench = Bench(make_config(limits={"i2t_current_A": 10.0, "i2t_time_s": 0.3}))
    bench.enable()
    bench.feedback["i_A"][0, 0] = 10.0 * math.sqrt(2)
    assert bench.run(295).state == State.ENABLED
    assert bench.run(10).state == State.TRIPPED
    assert bench.tick["first_trip"][0] == Trip.I2T


@pytest.mark.kernel
@pytest.mark.parametrize("reading_A", [200.0, -3e38])
def test_a_single_reading_is_no_heat_that_trips_and_several_are_over_current(
    reading_A: float,
) -> None:
    """Heat of currents that were found is kept, as they may have flowed: the winding cools."""
    bench = Bench(make_config(limits={"i2t_current_A": 10.0, "i2t_time_s": 0.3}))
    bench.enable()
    bench.feedback["i_A"][0, 0] = reading_A
    assert bench.run().state == State.ENABLED
    bench.feedback["i_A"][0, 0] = 0.0
    assert bench.run(3).state == State.ENABLED
    bench.feedback["i_A"][0, 0] = reading_A
    assert bench.run(2).state == State.TRIPPED
    assert bench.tick["first_trip"][0] == bench.tick["trip_bits"][0] == Trip.OVER_CURRENT
    assert bench.run(2).trip_bits & Trip.I2T
    bench.feedback["i_A"][0, 0] = 0.0
    for wait, state in ((200, State.TRIPPED), (150, State.READY)):
        bench.run(wait)
        bench.ask(Request.RESET)
        assert bench.run().state == state


@pytest.mark.kernel
@pytest.mark.parametrize(("derating", "ticks"), [(0.0, 300), (0.5, 150), (1.0, 1)])
def test_i2t_trips_the_earlier_the_warmer_the_winding(derating: float, ticks: int) -> None:
    bench = Bench(make_config(limits={"i2t_current_A": 10.0, "i2t_time_s": 0.3}))
    bench.enable()
    bench.setpoint["i2t_derating"] = derating
    assert bench.run(5).state == State.ENABLED  # no current, no heat
    bench.feedback["i_A"][0, 0] = 10.0 * math.sqrt(2)
    count = next(n for n in range(1, 400) if bench.run().state == State.TRIPPED)
    assert ticks <= count <= ticks + 2
    assert bench.tick["first_trip"][0] == Trip.I2T


def test_a_silent_supervisor_ramps_to_zero_then_trips() -> None:
    bench = Bench()
    bench.enable(torque_Nm=2.0)
    bench.run(300)
    torque_Nm = [float(bench.run(supervised=False).torque_set_Nm) for _ in range(600)]
    steps_Nm = np.abs(np.diff(torque_Nm))
    assert steps_Nm.max() <= 0.0101  # a ramp, no jump
    assert torque_Nm[240] == pytest.approx(2.0)
    assert torque_Nm[460] == 0.0
    assert bench.tick["state"][0] == State.TRIPPED
    assert bench.tick["first_trip"][0] == Trip.SUPERVISOR_STALE


def test_an_inverter_that_never_gets_ready_times_out() -> None:
    bench = Bench()
    bench.feedback["inverter_status"] = 0
    bench.run(5)
    bench.ask(Request.ENABLE)
    assert bench.run(900).state == State.READY
    assert bench.command["enable"][0] == 1
    assert trip_after(bench, 200) == Trip.ENABLE_TIMEOUT


def test_a_line_that_the_bridge_never_closes_times_out() -> None:
    """The inverter may say that it is ready: without the line it will not be."""
    bench = Bench()
    bench.feedback["bridge_status"] = 0
    bench.run(5)
    bench.ask(Request.ENABLE)
    assert bench.run(900).state == State.READY
    assert trip_after(bench, 200) == Trip.ENABLE_TIMEOUT


def test_first_cause_is_kept_and_reset_needs_it_gone() -> None:
    bench = Bench()
    bench.enable()
    _over_current(bench)
    bench.run(5)
    _hot(bench)
    tick = bench.run(30)
    assert tick.first_trip == Trip.OVER_CURRENT
    assert tick.trip_bits == Trip.OVER_CURRENT | Trip.TEMPERATURE
    bench.ask(Request.RESET)
    assert bench.run(5).state == State.TRIPPED
    bench.feedback["i_A"] = 0.0
    bench.feedback["temperature_C"] = 30.0
    bench.run(5)
    bench.ask(Request.RESET)
    tick = bench.run(1)
    assert (tick.state, tick.trip_bits, tick.first_trip) == (State.READY, 0, 0)


def test_off_shows_what_stands_against_enabling() -> None:
    bench = Bench()
    _low_bus(bench)
    tick = bench.run(40)
    assert (tick.state, tick.trip_bits) == (State.OFF, Trip.BUS_VOLTAGE)
    bench.ask(Request.ENABLE)
    assert bench.run(5).state == State.OFF


def test_limited_currents_are_flagged() -> None:
    bench = Bench(make_config(limits={"current_A": 3.0}))
    bench.enable(torque_Nm=6.0)
    tick = bench.run(700)
    assert tick["flags"] & Flag.CURRENT_LIMITED
    bench.setpoint["torque_Nm"] = 60.0
    assert bench.run(5)["flags"] & Flag.TORQUE_LIMITED


def test_one_sample_seen_often_is_one_sample() -> None:
    """A loop that gets no new samples has no new evidence of too much torque."""
    bench = Bench()
    bench.enable(torque_Nm=1.0)
    bench.run(20)
    _over_torque(bench)
    bench.run(2)
    assert bench.run(15, healthy=False).state == State.ENABLED
    assert trip_after(bench, 6) == Trip.OVER_TORQUE
