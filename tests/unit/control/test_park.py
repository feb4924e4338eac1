"""The axes configured for a drive, against those of the simulated rig: two derivations."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.calibration import Calibration
from motord.config import Config, DqConfig, packaged
from motord.control import park
from motord.control.park import DqFrame, flux_axis
from motord.rig.build import build
from motord.rig.park import latch, sense_dq
from motord.rig.truth import RigTruth
from motord.rig.types import RIG_OUTPUT
from motord.schema import Compensate, Request, State
from tests.contract.peers import DQ_SIGNALS
from tests.unit.control.bench import Bench, make_config

angles = st.floats(-10.0, 10.0)
currents = st.floats(-30.0, 30.0)
HARMONICS = (
    {"order": 1, "amplitude_V_s_per_rad": 0.2},
    {"order": 5, "amplitude_V_s_per_rad": 0.01},
)


def star(q_only: bool = False, dq: dict[str, Any] | None = None, **motor: Any) -> Config:
    """Return a bench with a drive that takes d and q, or q alone."""
    signals = dict(DQ_SIGNALS)
    if q_only:
        del signals["command_i_d_A"]
    can = {"interface": "virtual", "dbc": packaged("dq_drive.dbc"), "signals": signals}
    inverter = {"driver": "can-dq", "can": can, "dq": dq or {}}
    bridge = {"driver": "serial", "port": "/dev/null"}
    return make_config(motor={"connection": "star", **motor}, inverter=inverter, bridge=bridge)


@pytest.mark.kernel
@given(angles, st.sampled_from([1, -1]), currents, currents, currents)
def test_there_and_back(electrical_rad: float, sequence: int, a: float, b: float, c: float) -> None:
    d, q = park.abc_to_dq(electrical_rad, sequence, a, b, c)
    mean = (a + b + c) / 3
    back = park.dq_to_abc(electrical_rad, sequence, d, q)
    assert back == pytest.approx((a - mean, b - mean, c - mean), abs=1e-9)
    assert abs(sum(back)) < 1e-9


@pytest.mark.kernel
def test_a_sine_of_amplitude_one_has_length_one() -> None:
    phases = tuple(math.cos(0.3 - n * 2 * math.pi / 3) for n in range(3))
    assert park.abc_to_dq(0.3, 1.0, *phases) == pytest.approx((1.0, 0.0))
    assert park.abc_to_dq(0.3 - math.pi / 2, 1.0, *phases) == pytest.approx((0.0, 1.0))
    assert park.abc_to_dq(0.3, -1.0, phases[0], phases[2], phases[1]) == pytest.approx((1.0, 0.0))


@given(
    st.sampled_from(["abc", "acb"]),
    st.floats(-3.0, 3.0),
    st.sampled_from([0.2, -0.2]),
    st.floats(0.0, 6.28),
)
def test_current_along_q_makes_torque(
    order: str, offset_rad: float, amplitude: float, angle_rad: float
) -> None:
    """In the positive direction, and none along d, wherever the rotor and its encoder are."""
    back_emf = ({"order": 1, "amplitude_V_s_per_rad": amplitude, "phase_rad": 0.4},)
    config = star(phase_order=order, encoder_offset_rad=offset_rad, back_emf=back_emf)
    axes, counts = DqFrame.of(config), config.motor.counts
    n = round(angle_rad / 2 / math.pi * counts) % counts
    k = config.motor.back_emf_table()[n]
    at_rad = 2 * math.pi * n / counts
    assert np.dot(axes.from_drive(at_rad, 0.0, 0.0, 2.0), k) == pytest.approx(1.5 * 2 * 0.2)
    assert np.dot(axes.from_drive(at_rad, 0.0, 2.0, 0.0), k) == pytest.approx(0.0, abs=1e-9)
    assert axes.sequence == (1 if order == "abc" else -1)


dqs = st.builds(
    DqConfig,
    direction=st.sampled_from([1, -1]),
    d_axis_rad=st.floats(-4.0, 4.0),
    scale=st.sampled_from([1.0, math.sqrt(1.5), math.sqrt(0.5)]),
    angle=st.sampled_from(["turning", "latched"]),
)


@settings(deadline=None)
@given(
    dqs,
    st.sampled_from(["abc", "acb"]),
    st.floats(-3.0, 3.0),
    st.tuples(currents, currents, currents),
)
def test_the_rig_agrees_with_the_configured_axes(
    dq: DqConfig, order: str, angle_rad: float, i_A: tuple[float, float, float]
) -> None:
    """Phase currents, through the configured axes and the rig's own back to phases, but for their
    mean; and what it then says of them the other way."""
    configured = star(dq=dq.model_dump(), phase_order=order, back_emf=HARMONICS)
    truth = RigTruth.model_validate(
        {
            "motor": {"pole_pairs": 8, "connection": "star", "back_emf": HARMONICS},
            "inverter": {"phase_order": order, "dq": dq},
            "rotor": {"angle_rad": angle_rad},
        }
    )
    parameters, state = build(truth, 1)
    axes, output = DqFrame.of(configured), np.zeros(1, RIG_OUTPUT)
    values = np.array([*axes.to_drive(angle_rad, 0.0, i_A), 0.0])
    latch(parameters, state, values)
    expected = np.array(i_A) - np.mean(i_A)
    assert values == pytest.approx(expected, abs=1e-6)
    output[0].i_sensed_A[:] = i_A
    output[0].u_V[:] = np.multiply(i_A, 0.5)
    sense_dq(parameters[0], state[0], output[0])
    d, q = output[0].i_d_A, output[0].i_q_A
    assert axes.from_drive(angle_rad, 0.0, d, q) == pytest.approx(expected, abs=1e-6)
    d, q = output[0].u_d_V, output[0].u_q_V
    assert axes.from_drive(angle_rad, 0.0, d, q) == pytest.approx(0.5 * expected, abs=1e-6)


def test_how_old_the_drives_angle_is() -> None:
    turning = DqFrame.of(star(dq={"angle_age_s": 1e-4}))
    assert (turning.command_age_s, turning.feedback_age_s) == (1e-4, 1e-4)
    latched = DqFrame.of(star(dq={"angle": "latched", "angle_age_s": 2e-4}))
    assert latched.command_age_s == pytest.approx(0.7e-3)
    assert latched.feedback_age_s == 0.0
    i_A = (1.0, 2.0, -3.0)
    behind = latched.to_drive(1.0 - 10.0 * 0.7e-3, 0.0, i_A)
    assert latched.to_drive(1.0, 10.0, i_A) == pytest.approx(behind)


def test_flux_axis_of_a_measured_table() -> None:
    table = star(back_emf=HARMONICS, encoder_offset_rad=0.01).motor.back_emf_table()
    flux_rad, sequence = flux_axis(table, 8)
    assert sequence == 1
    assert math.cos(flux_rad - (8 * 0.01 - math.pi)) == pytest.approx(1.0)


def calibration_of(config: Config) -> Calibration:
    alpha = np.array([0.8, 1.118, 1.118])
    return Calibration.model_construct(
        alpha=tuple(alpha / np.cbrt(alpha.prod())),
        beta_A=(1.0, -0.5, -0.5),
        delta_epsilon=1.02,
        tau_cog_Nm=np.zeros(config.motor.counts),
        learned=None,
    )


@pytest.mark.kernel
@pytest.mark.parametrize("compensate", [0, int(Compensate.CURRENTS)])
@pytest.mark.parametrize("dq", [{}, {"d_axis_rad": 0.3, "direction": -1, "angle_age_s": 2e-4}])
def test_along_q_alone_the_torque_is_right(compensate: int, dq: dict[str, Any]) -> None:
    """What flows in a star that is commanded nothing along d makes the torque asked for."""
    config = star(q_only=True, dq=dq, back_emf=HARMONICS)
    calibration = calibration_of(config)
    bench = Bench(config, calibration)
    bench.setpoint["compensate"] = compensate
    bench.setpoint["torque_Nm"] = 3.0
    bench.run(50)
    bench.setpoint["request"], bench.setpoint["request_seq"] = Request.ENABLE, 1
    tick = bench.run(1200)
    assert tick.state == State.ENABLED
    axes = DqFrame.of(config)
    beta = np.array(calibration.beta_A) if compensate else np.zeros(3)
    gains = np.array(calibration.alpha) * calibration.delta_epsilon if compensate else np.ones(3)
    for _ in range(20):
        tick = bench.run(7)
        command = bench.command[0]
        d, q = axes.to_drive(command.angle_rad, command.speed_rad_s, tuple(command.i_A.tolist()))
        assert d == pytest.approx(0.0, abs=1e-5)
        assert abs(q) > 5.0
        x = command.i_A.astype(float)
        x -= (gains @ x + beta.sum()) / gains.sum()
        flowing = gains * x + beta
        turn_rad = 2 * np.pi * np.arange(config.motor.counts + 1) / config.motor.counts
        table = config.motor.back_emf_table()[np.r_[0 : config.motor.counts, 0]]
        k = [np.interp(tick.angle_predicted_rad, turn_rad, table[:, p]) for p in range(3)]
        assert flowing @ k == pytest.approx(3.0, abs=2e-4)


@pytest.mark.kernel
def test_no_flux_along_q_no_current() -> None:
    bench = Bench(star(q_only=True, back_emf=HARMONICS))
    from motord.control.reference import currents_along_q

    k = (0.0, 0.0, 0.0)
    assert currents_along_q(bench.parameters[0], True, 3.0, 1.0, k) == (0.0, 0.0, 0.0)
