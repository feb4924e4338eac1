"""What a calibration says of a bench that departs from its model; all rows in the campaign."""

from math import radians

import numpy as np
import pytest

from motord.experiments.calibration.estimate.lack_of_fit import _left_orders
from motord.experiments.calibration.estimate.turn_spectrum import SMOOTHED_ORDERS
from tests.campaigns.departures import DEPARTURES, calibrated

MESH = {"torques_Nm": [1.0, 3.0, 5.0], "speeds_Hz": [0.9], "turns": 6, "settle_s": 0.3}


def names(connection: str, changes: object, mesh: dict[str, object] = MESH) -> list[str]:
    return [one.name for one in calibrated(connection, changes, 1, mesh).findings]


@pytest.mark.parametrize("connection", ["independent", "star"])
def test_a_bench_as_the_model_has_it_gives_no_finding(connection: str) -> None:
    assert names(connection, {}) == []


def test_an_eccentric_encoder_is_named_with_its_size() -> None:
    error = {"order": 1, "amplitude_rad": radians(0.1), "phase_rad": 0.4}
    result = calibrated("independent", {"encoder": {"errors": [error]}}, 1, MESH)
    [finding] = [one for one in result.findings if one.name == "encoder-error-order-1"]
    assert finding.value == pytest.approx(0.1, rel=0.05)
    assert (finding.unit, finding.severity) == ("deg", "serious")
    assert finding.value > finding.limit
    assert "eccentric" in finding.in_words()


@pytest.mark.parametrize("name", ["current sensors' gain 1 % over range",
                                  "cogging 5 % more with current"])  # fmt: skip
def test_what_grows_with_the_current_is_named(name: str) -> None:
    departure = next(one for one in DEPARTURES if one.name == name)
    assert set(names("star", departure.changes(1.0))) & set(departure.found_as)


def test_noise_alone_is_rarely_taken_for_an_order() -> None:
    rng = np.random.default_rng(5)
    points, orders, meshes = 4, 200, 300
    torque_Nm = np.array([1.0, 2.0, 3.0, 4.0])
    found = 0
    for _ in range(meshes):
        parts = rng.normal(size=(2, points, orders)) / np.sqrt(2)
        rest = parts[0] + 1j * parts[1]
        freedom = 2 * SMOOTHED_ORDERS
        noise = np.sqrt(rng.chisquare(freedom, size=(points, orders)) / freedom)
        found += bool(_left_orders(torque_Nm, rest, noise))
    assert found <= 6  # 0.2 % expected of 300


def test_an_order_that_stands_out_is_found_with_its_growth() -> None:
    rng = np.random.default_rng(6)
    torque_Nm = np.array([1.0, 2.0, 3.0, 4.0])
    noise = np.full((4, 100), 1.0)
    rest = (rng.normal(size=(4, 100)) + 1j * rng.normal(size=(4, 100))) / np.sqrt(2)
    for order, power in ((10, 0), (20, 1), (30, 2)):
        rest[:, order - 1] += 30 * torque_Nm**power / (torque_Nm**power).max()
    found = _left_orders(torque_Nm, rest, noise)
    assert [(one.order, one.power) for one in found] == [(10, 0), (20, 1), (30, 2)]
