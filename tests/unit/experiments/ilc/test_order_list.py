"""Which orders learning takes, which it says it cannot reach, and how the list grows."""

import numpy as np
import pytest

from motord.config import TorqueSensorConfig
from motord.experiments.ilc.estimate import (
    Learning,
    over_orders,
    pass_residual,
    refine,
    unlearned,
)
from motord.experiments.ilc.order_list import (
    SeenRipple,
    in_lines,
    reach_text,
    shown,
    to_learn,
    unreached,
)
from motord.identification import IdentifyError
from motord.learned import MAX_ORDERS

NOISE_NM, HIGHEST = 1e-3, 120


def ripple(
    lines_Nm: dict[int, float], seed: int = 1, band: int = 100, highest: int = 100
) -> SeenRipple:
    rng = np.random.default_rng(seed)
    parts = rng.normal(size=(2, 2, HIGHEST))
    even_odd_Nm = NOISE_NM * (parts[0] + 1j * parts[1])
    for order, size_Nm in lines_Nm.items():
        even_odd_Nm[:, order - 1] += size_Nm
    return SeenRipple(
        torque_Nm=3.0,
        speed_Hz=0.7,
        compensate=3,
        turns=8,
        rms_percent=1.0,
        stderr_percent=0.1,
        raw_percent=1.0,
        order=np.arange(1, HIGHEST + 1),
        line_Nm=even_odd_Nm.mean(axis=0),
        noise_Nm=np.full(HIGHEST, NOISE_NM),
        even_odd_Nm=even_odd_Nm,
        turns_Hz=0.7,
        band=band,
        highest=highest,
    )


def test_noise_is_rarely_taken_for_an_order() -> None:
    assert sum(bool(shown([ripple({}, seed)])) for seed in range(200)) <= 3  # 0.4 expected


def test_what_the_torque_shows_is_learned_in_addition_to_multiples_of_the_pole_pairs() -> None:
    points = [ripple({6: 0.03, 15: 0.01}, 1), ripple({6: 0.03, 15: 0.01}, 2)]
    assert shown(points) == (6, 15)
    assert to_learn(points, 40) == (6, 15, 40, 80)
    assert to_learn(points, 40, (7,)) == (6, 7, 15, 40, 80)
    with pytest.raises(IdentifyError, match="nothing can be learned"):
        to_learn([ripple({}, highest=7)], 8)


def test_where_there_is_no_room_the_strongest_are_taken() -> None:
    lines_Nm = {order: 1.0 - 0.01 * order for order in range(1, 99)}
    orders = to_learn([ripple(lines_Nm)], 8)
    assert orders == tuple(range(1, MAX_ORDERS + 1))


def test_orders_out_of_reach_are_named_with_the_reason() -> None:
    point = ripple({6: 0.03, 60: 0.02, 90: 0.02, 110: 0.02}, band=100, highest=80)
    found = unreached(point, (6,))
    assert [(one.order, one.why) for one in found] == [
        (60, "one-point"), (90, "highest-order"), (110, "bandwidth"),
    ]  # fmt: skip
    [line] = in_lines(found)
    assert line.startswith("3 Nm, 0.7 /s: not corrected, order 60 (20.")
    assert "the currents do not follow" in line
    full = unreached(point, tuple(range(1, 49)) + tuple(range(61, 77)))
    assert (full[0].order, full[0].why) == (60, "room")


def test_the_reach_names_what_limits_it() -> None:
    sensor = TorqueSensorConfig(highpass_time_constant_s=0.1, resonance_Hz=120.0)
    text = reach_text(ripple({}), sensor)
    assert "corrected up to order 100, seen up to 120 (the mount resonates at 120 Hz)" in text
    assert "noise is larger up to order 2 (the sensor's high-pass)" in text
    stiff = TorqueSensorConfig(highpass_time_constant_s=0.0, resonance_Hz=0.0)
    assert reach_text(ripple({}), stiff).startswith(
        "0.7 /s: corrected up to order 100, seen up to 120; noise"
    )


def test_a_point_keeps_what_it_learned_when_the_list_grows() -> None:
    first, step = ripple({6: 0.03}, 1), Learning()
    point = refine(unlearned(1, step), pass_residual(first, (6,), 6.0), 6.0, step)
    second = ripple({6: 0.009, 10: 0.02}, 2)
    wider = over_orders(point, (6,), (6, 10), second, 6.0)
    assert wider.cos_Nm == (point.cos_Nm[0], 0.0)
    assert wider.best is not None
    assert point.best is not None
    grown = np.hypot(point.best.rms_percent, 100 / 6.0 * 0.02 / np.sqrt(2))
    assert wider.best.rms_percent == pytest.approx(grown, rel=0.05)
    after = refine(wider, pass_residual(second, (6, 10), 6.0), 6.0, step)
    assert after.gain == step.gain
    assert after.cos_Nm[1] == pytest.approx(0.7 * 0.02, rel=0.1)
    assert over_orders(wider, (6, 10), (6, 10), second, 6.0) is wider
    assert over_orders(point, (6,), (6, 10), None, 6.0).cos_Nm == wider.cos_Nm
