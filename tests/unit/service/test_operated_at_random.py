"""What an operator may set does not trip the bench, whatever went before; the rest: campaign."""

import pytest

from motord.schema import State
from motord.service.bench.manual_control import ManualControl
from tests.campaigns.legal_operation import operated
from tests.support.properties import slow
from tests.unit.service.virtual_service import VirtualService

EDGE_HZ = 2.73


@pytest.mark.parametrize("benches", [False, True])
@pytest.mark.parametrize("seed", [0, *slow(1, 2)])
def test_set_points_at_random(seed, benches):
    trip, done = operated(seed, benches=benches)
    assert trip == ""
    assert sum(not refusal for _, refusal, _ in done) > len(done) / 3


def test_a_reversal_teaches_nothing_of_the_rotor_that_still_turns_the_other_way():
    """The brake, which lags, slowed it: it was taken for one without inertia, and overshot then."""
    assert operated(730135, benches=True)[0] == ""


def fastest_Hz(service, token, for_s):
    """Return the highest speed within a time."""
    speeds_rad_s = []
    for _ in range(round(for_s / 0.01)):
        service.run_s(0.01, token)
        speeds_rad_s.append(abs(service.bench.monitor.last["speed_rad_s"]))
    return max(speeds_rad_s) / 6.2832


def test_a_reversal_at_little_torque_does_not_overshoot():
    """A rotor that still turns the other way is on its way, and no reason to brake less."""
    service = VirtualService(brake={"excitation_time_constant_s": 0.2})
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=0.48, speed_Hz=2.5)
    service.run_s(8.0, token)
    service.ask("set", token=token, torque_Nm=-0.48, speed_Hz=-2.5)
    assert fastest_Hz(service, token, 6.0) < 1.1 * 2.5


def changed_soon(service):
    """Set a large torque at a high speed, and a smaller one while the brake still rises."""
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=1.7, speed_Hz=EDGE_HZ)
    service.run_s(6.0, token)
    service.ask("set", token=token, torque_Nm=5.3)
    service.run_s(0.6, token)
    service.ask("set", token=token, torque_Nm=2.1)
    return token


def test_another_torque_is_approached_like_another_speed():
    """The rotor had fallen behind while the brake rose, and nobody saw it."""
    service = VirtualService()
    token = changed_soon(service)
    assert fastest_Hz(service, token, 5.0) < EDGE_HZ + 0.5
    assert service.bench.state is State.ENABLED


def test_a_brake_that_still_rises_leads_the_next_torque_too():
    service = VirtualService(brake={"excitation_time_constant_s": 0.4})
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=4.5, speed_Hz=0.9)
    service.run_s(0.2, token)
    service.ask("set", token=token, torque_Nm=4.0)
    service.run_s(1.0, token)
    assert service.bench.monitor.torque_set_Nm == 0.0
    service.run_s(2.0, token)
    assert service.bench.monitor.torque_set_Nm == pytest.approx(4.0)


def test_a_broken_twin_forgets_the_lead(monkeypatch):
    def forgets(control, request):
        control._lead_s = 0.0
        control._torque_Nm = control._setpoint.torque_Nm
        applied(control, request)

    applied = ManualControl._apply
    monkeypatch.setattr(ManualControl, "_apply", forgets)
    with pytest.raises(AssertionError):
        test_a_brake_that_still_rises_leads_the_next_torque_too()


def test_a_reversal_that_the_high_pass_shows_as_too_much_is_refused():
    service = VirtualService(limits={"torque_rate_Nm_per_s": 100.0})
    token = service.enabled()
    service.ask("set", token=token, torque_Nm=5.8, speed_Hz=1.5)
    service.run_s(4.0, token)
    with pytest.raises(
        Exception, match=r"from 5\.8 to -5\.8 Nm the torque sensor would show up to 11"
    ):
        service.ask("set", token=token, torque_Nm=-5.8, speed_Hz=-1.5)
