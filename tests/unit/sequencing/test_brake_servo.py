"""The brake servo: it learns the brake's departure from its curve, from a rotor that it can see."""

import math
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motord import config
from motord.sequencing.brake_servo import (
    SHIFT_MAX,
    TRUST_S,
    BrakeServo,
    brake_torque_Nm,
    speed_held_rad_s,
)

LOOK_NS = 20_000_000
WANTED_HZ = 0.7


@pytest.fixture
def servo():
    return BrakeServo(config.load().brake)


def look(servo, speed_Hz, seconds, begun_ns=0):
    """Let the servo see a speed for a while; return the time then (ns)."""
    end_ns = begun_ns + round(seconds * 1e9)
    for t_ns in range(begun_ns, end_ns + 1, LOOK_NS):
        servo.correct(t_ns, speed_Hz, WANTED_HZ)
    return end_ns


def learnt(servo):
    """Let the servo learn that the brake is weaker than configured, and hold its speed."""
    servo.start()
    t_ns = look(servo, 1.4 * WANTED_HZ, 1.0)
    return look(servo, WANTED_HZ, 2 * TRUST_S, t_ns)


def test_a_rotor_too_fast_gets_more_brake_and_one_too_slow_less(servo):
    plain = servo.excitation(2.0, WANTED_HZ)
    look(servo, 1.4 * WANTED_HZ, 0.5)
    assert servo.excitation(2.0, WANTED_HZ) > 1.05 * plain
    look(servo, 0.5 * WANTED_HZ, 2.0, 500_000_000)
    assert servo.excitation(2.0, WANTED_HZ) < plain


@given(st.floats(-50, 50), st.floats(0.1, 10))
def test_it_departs_from_the_configured_curve_only_so_far(speed_Hz, seconds):
    servo = BrakeServo(config.load().brake)
    look(servo, speed_Hz, seconds)
    assert abs(servo.shift) <= math.log(SHIFT_MAX)


def test_what_was_learnt_with_the_speed_held_is_kept(servo):
    learnt(servo)
    shift = servo.shift
    assert shift > 0.3
    servo.start()
    assert servo.shift == shift


@pytest.mark.parametrize("seen_Hz", [0.0, -0.3, 3.0])
def test_what_was_learnt_of_a_rotor_out_of_sight_is_forgotten(servo, seen_Hz):
    t_ns = learnt(servo)
    shift = servo.shift
    t_ns = look(servo, seen_Hz, 1.0, t_ns)
    assert abs(servo.shift - shift) > 0.3
    servo.start()
    assert servo.shift == shift


def test_a_speed_passed_through_teaches_nothing(servo):
    t_ns = learnt(servo)
    shift = servo.shift
    t_ns = look(servo, 0.0, 0.5, t_ns)
    t_ns = look(servo, WANTED_HZ, 0.5 * TRUST_S, t_ns)
    look(servo, 3.0, 0.1, t_ns)
    servo.start()
    assert servo.shift == shift


@pytest.mark.parametrize(("gains_Hz", "waits"), [(0.02, True), (0.0, False)])
def test_a_rotor_that_turns_back_is_waited_for_while_it_is_on_its_way(servo, gains_Hz, waits):
    servo.start(WANTED_HZ)
    shift, speed_Hz = servo.shift, -WANTED_HZ
    for look_number in range(1, 30):
        seen = SimpleNamespace(t_ns=look_number * LOOK_NS, torque_set_Nm=2.0, speed_Hz=speed_Hz)
        servo.follow(seen, 2.0, WANTED_HZ)
        speed_Hz += gains_Hz
    assert speed_Hz < 0.0
    assert (servo.shift == shift) == waits


@given(
    share=st.floats(-1.0, 1.0).filter(lambda share: abs(share) > 1e-3),
    excitation=st.floats(0.05, 1.0),
)
def test_the_speed_that_is_held_is_where_the_brake_has_the_torque(share, excitation):
    brake = config.load().brake
    speed_rad_s = share * brake.critical_speed_rad_s
    torque_Nm = brake_torque_Nm(brake, excitation, speed_rad_s)
    assert speed_held_rad_s(brake, excitation, torque_Nm) == pytest.approx(speed_rad_s, rel=1e-6)


def test_a_torque_that_the_brake_does_not_hold_has_the_critical_speed():
    brake = config.load().brake
    too_much_Nm = 1.1 * brake.torque_max_Nm
    assert speed_held_rad_s(brake, 1.0, too_much_Nm) == brake.critical_speed_rad_s
    assert speed_held_rad_s(brake, 1.0, -too_much_Nm) == -brake.critical_speed_rad_s
