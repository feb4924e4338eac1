"""Blocks of ticks as a daemon publishes them."""

import numpy as np

from motord.schema import TICK_DTYPE


def block(count, *, first=0, rate_Hz=1000.0, t0_ns=0, missed=0, turns_per_s=0.0, **fields):
    """Return `count` ticks from number `first` on, sampled when they are due after `t0_ns`."""
    ticks = np.zeros(count, TICK_DTYPE)
    ticks["tick"] = first + np.arange(count)
    due_s = ticks["tick"] / rate_Hz
    ticks["t_ns"] = t0_ns + np.round(due_s * 1e9).astype(np.int64)
    ticks["missed"] = missed
    ticks["angle_rad"] = 2 * np.pi * turns_per_s * due_s % (2 * np.pi)
    for name, value in fields.items():
        ticks[name] = value
    return ticks
