"""Torque over angle and its orders, of turns that were passed from end to end."""

import numpy as np
import pytest

from motord.dashboard.turns import BINS, FILLED_MIN, ORDERS, TURNS, TurnAverager
from tests.unit.dashboard.ticks import block

RATE_HZ = 10_000.0
LINES = {0: 2.0, 1: 0.1, 8: 0.05, 48: 0.3, 144: 0.02}


def torque_Nm(angle_rad):
    waves = (a * np.sin(h * angle_rad + h) for h, a in LINES.items() if h)
    return LINES[0] + sum(waves)


def turned(turns_per_s, seconds, rate_Hz=RATE_HZ, **fields):
    ticks = block(round(seconds * rate_Hz), rate_Hz=rate_Hz, turns_per_s=turns_per_s, **fields)
    ticks["torque_Nm"] = torque_Nm(ticks["angle_rad"].astype(float))
    return ticks


def gathered(ticks, size=997):
    turns = TurnAverager()
    for begin in range(0, len(ticks), size):
        turns.add(ticks[begin : begin + size])
    return turns


@pytest.mark.parametrize("turns_per_s", [0.7, -0.7, 3.0, -10.0])
def test_the_spectrum_has_the_amplitudes_of_the_torque(turns_per_s):
    turns = gathered(turned(turns_per_s, 6.0 / abs(turns_per_s)))
    amplitudes_Nm = turns.amplitudes_Nm()
    expected = np.zeros(ORDERS + 1)
    expected[list(LINES)] = list(LINES.values())
    np.testing.assert_allclose(amplitudes_Nm, expected, atol=0.01)


def test_few_ticks_a_turn_resolve_few_orders():
    turns = gathered(turned(10.0, 2.0, rate_Hz=1000.0))
    amplitudes_Nm = turns.amplitudes_Nm()
    assert amplitudes_Nm[[0, 1, 8]] == pytest.approx([2.0, 0.1, 0.05], abs=0.01)
    highest_order = np.flatnonzero(np.isfinite(amplitudes_Nm))[-1]
    assert highest_order < 50
    assert np.isnan(amplitudes_Nm[highest_order + 1 :]).all()


def test_turns_in_which_the_set_point_moves_have_no_part_in_the_spectrum():
    ticks = turned(1.0, 4.5)
    ticks["torque_set_Nm"] = 2.0
    moving = (ticks["tick"] > 2.2 * RATE_HZ) & (ticks["tick"] < 2.8 * RATE_HZ)
    ticks["torque_Nm"][moving] += 1.0
    ticks["torque_set_Nm"][moving] = 3.0
    amplitudes_Nm = gathered(ticks).amplitudes_Nm()
    assert amplitudes_Nm[[1, 8, 48]] == pytest.approx([0.1, 0.05, 0.3], abs=0.01)
    ticks["torque_set_Nm"] = np.linspace(1.0, 2.0, len(ticks))
    assert np.isnan(gathered(ticks).amplitudes_Nm()).all()


def test_torque_is_over_the_angle_the_newest_turn_last():
    ticks = turned(1.0, 4.5)
    ticks["torque_Nm"] += np.floor(ticks["tick"] / RATE_HZ)  # 1 Nm more with each turn
    ticks["cogging_comp_Nm"], ticks["torque_set_Nm"] = 0.25, 1.5
    turns = gathered(ticks)
    by_bin = turns.by_bin()
    middle_rad = 2 * np.pi * (np.arange(BINS) + 0.5) / BINS
    assert by_bin.shape == (3, BINS)  # the first and the last were not whole
    for number, turn in enumerate(by_bin, start=1):
        np.testing.assert_allclose(turn, torque_Nm(middle_rad) + number, atol=0.02)
    assert turns.compensation() == pytest.approx(np.full(BINS, 0.25))
    assert turns.set_Nm() == pytest.approx(1.5)
    assert turns.steady()
    ticks["torque_set_Nm"] = np.linspace(1.0, 2.0, len(ticks))
    assert not gathered(ticks).steady()


def test_the_newest_turns_are_kept():
    turns = gathered(turned(2.0, 20.0 / 2.0))
    assert len(turns.by_bin()) == TURNS
    assert turns.completed == 18


@pytest.mark.parametrize("motion", ["standing", "to and fro", "too fast"])
def test_what_does_not_pass_a_turn_is_no_turn(motion):
    ticks = turned(0.0, 4.0)
    time_s = ticks["tick"] / RATE_HZ
    angle_rad = {
        "standing": 0.0 * time_s,
        "to and fro": 0.3 * np.sin(2 * np.pi * time_s),  # over the mark and back
        "too fast": 2 * np.pi * time_s * RATE_HZ / (0.4 * FILLED_MIN),
    }[motion]
    ticks["angle_rad"] = angle_rad % (2 * np.pi)
    assert gathered(ticks).completed == 0


def test_a_turn_that_is_turned_back_is_not_whole():
    ticks = turned(0.0, 4.0)
    angle_turns = np.interp(ticks["tick"] / RATE_HZ, [0, 1, 2, 3, 4], [0.5, 1.5, 0.9, 1.5, 2.5])
    ticks["angle_rad"] = 2 * np.pi * angle_turns % (2 * np.pi)
    turns = gathered(ticks)
    assert turns.completed == 1
    by_bin = turns.by_bin()[0]
    assert np.isfinite(by_bin).all()


def test_an_interruption_begins_a_turn_anew():
    ticks = turned(1.0, 4.5)
    turns = TurnAverager()
    turns.add(ticks[:15_000])
    turns.interrupt()
    turns.add(ticks[15_000:])
    assert turns.completed == 2


def test_ticks_without_torque_or_angle_are_left_out():
    ticks = turned(1.0, 3.5)
    ticks["torque_Nm"][::3] = np.nan
    ticks["angle_rad"][::7] = np.nan
    turns = gathered(ticks)
    assert turns.completed == 2
    assert np.isfinite(turns.by_bin()).all()
    assert turns.amplitudes_Nm()[48] == pytest.approx(0.3, abs=0.01)
