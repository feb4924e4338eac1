"""Does every interlock keep its time on benches with random legal settings?

`python -m tests.campaigns.interlock_search [--seed 1] [--draws 1000]`. Each draw makes a bench
(`tests.support.random_bench`), operates it at random, lets a fault (`interlock_causes`) begin in a
random state, asks for this and that meanwhile, ends it, resets and operates again. Findings are
trips where nothing is wrong, causes found later than stated, and, whatever the kernel thinks of
them, currents that flow, positions and requests for which there must be no current. Prints what was
refused, what was played, and each finding with its seed; exits with 1 if there is any.
"""

import argparse
import math
import sys
from collections import Counter
from collections.abc import Iterator

import numpy as np

from motord.config.rules.encoder import speed_resolution_rad_s
from motord.config.rules.torque import reversal_shows_Nm
from motord.config.timing import ACCELERATION_RAD_S2, POSITION_AGE_MAX_S, SETTLING_LAGS
from motord.control.interlock_table import EvidenceSource
from motord.schema import InverterStatus, Request, State, Trip
from tests.campaigns import seeds
from tests.campaigns.interlock_causes import BEGIN, TICKS_MAX, Cause, status
from tests.support.random_bench import PlayedBench, drawn_bench

STATES = ("off", "ready", "arming", "idle", "torque", "torque", "torque", "stopping")
SMALL_RAD = 0.15
"""Electrical angle by which currents are off at most, for each of the reasons for which they are,
in normal operation: a bench that cannot commutate makes another torque than is asked for."""

NOTHING_A = 1e-9
"""A current that has decayed for a second is no number of its own any more."""


class Finding(AssertionError):
    """Something that must not be."""


class Warm(Exception):
    """I2t has tripped, as the currents that flowed explain: the draw is over."""


class Operation:
    """A played bench and its operator; every tick is compared with what none may do."""

    def __init__(self, b: PlayedBench) -> None:
        self.b, self.rng, self.config = b, b.rng, b.config
        self.may_enable = self.faulty = False
        self.heat_s = [0.0, 0.0, 0.0]
        c, w_rad_s = b.config, 2 * math.pi * b.config.loop.observer_bandwidth_Hz
        period_s, most_rad = 1.0 / c.loop.rate_Hz, SMALL_RAD / c.motor.pole_pairs
        ahead_s = 2 * b.seen_s + (2 + b.stalled_most) * period_s + c.inverter.actuation_delay_s
        held_s = (0.5 + b.stalled_most) * period_s + c.inverter.lag_s + b.off_ns * 1e-9
        self.most_rad_s = min(0.8 * c.limits.trip_speed_rad_s, most_rad / held_s)
        lag_s2 = 1 / w_rad_s**2 + 2 * ahead_s / w_rad_s + 0.5 * ahead_s**2
        self.most_rad_s2 = min(ACCELERATION_RAD_S2, most_rad / lag_s2)
        coarse_rad = 2.3 * math.pi / c.motor.counts + speed_resolution_rad_s(c) * ahead_s
        shown = reversal_shows_Nm(c) <= c.limits.trip_torque_Nm
        most_Nm = c.limits.torque_Nm if shown else c.limits.trip_torque_Nm / 2
        self.most_Nm = most_Nm if coarse_rad < most_rad else 0.0
        b.speed_rad_s = self.wanted_rad_s = float(self.rng.uniform(-1, 1) * self.most_rad_s)

    def ask(self, request: Request) -> None:
        self.may_enable = request == Request.ENABLE
        self.b.ask(request)

    def run_s(self, seconds: float) -> None:
        self.run(min(max(round(seconds * self.config.loop.rate_Hz), 1), TICKS_MAX))

    def run(self, ticks: int = 1) -> None:
        b = self.b
        for _ in range(ticks):
            if not self.faulty:
                period_s = b.period_ns * 1e-9 * (1 + b.stalled_most)  # it lasts through a stall
                a_rad_s2 = (self.wanted_rad_s - b.speed_rad_s) / period_s
                b.acceleration_rad_s2 = min(max(a_rad_s2, -self.most_rad_s2), self.most_rad_s2)
            before, before_Nm = b.state, abs(float(b.tick["torque_set_Nm"][0]))
            now_ns, truth_A = b.now_ns, b.truth_A
            b.tick_once()
            self._heat(truth_A, (b.now_ns - now_ns) * 1e-9)
            for what in self._wrongs(before, before_Nm):
                raise Finding(what)
            self.may_enable &= b.state != State.TRIPPED

    def _wrongs(self, before: State, before_Nm: float) -> Iterator[str]:
        b, limits, state = self.b, self.config.limits, self.b.state
        largest_A = max(map(abs, b.command["i_A"][0].tolist()))
        torque_Nm = abs(float(b.tick["torque_set_Nm"][0]))
        if state != State.ENABLED:
            if largest_A:
                yield f"current in {state.name}"
            if b.command["enable"][0] and not b.memory["arming"][0]:
                yield f"enable in {state.name}"
        elif before != State.ENABLED and not self.may_enable:
            yield "enabled without a request"
        if largest_A > limits.current_A * (1 + 1e-6):
            yield f"{largest_A:g} A commanded"
        rise_Nm = limits.torque_rate_Nm_per_s / self.config.loop.rate_Hz + 1e-6 * limits.torque_Nm
        if torque_Nm > min(limits.torque_Nm * (1 + 1e-6), before_Nm + rise_Nm):
            yield f"torque from {before_Nm:g} to {torque_Nm:g} Nm"
        position_s = (b.now_ns - int(b.feedback["t_ns"][0])) * 1e-9
        if largest_A and position_s > POSITION_AGE_MAX_S + 2e-4:
            yield f"torque by a position of {position_s:g} s ago"
        if state == State.OFF != before:
            yield "OFF without a request"
        if state == State.TRIPPED != before and not self.faulty:
            if b.tick["first_trip"][0] == Trip.I2T and limits.current_A > limits.i2t_current_A:
                raise Warm
            yield f"false trip: {Trip(int(b.tick['first_trip'][0])).name}"

    def _heat(self, truth_A: tuple[float, ...], dt_s: float) -> None:
        """Sum up the heat of the currents that flow; more than is allowed must have tripped."""
        limits, gap_s = self.config.limits, self.b.gap_s
        for phase, i_A in enumerate(truth_A):
            heat_s = self.heat_s[phase] + ((i_A / limits.i2t_current_A) ** 2 - 1.0) * dt_s
            self.heat_s[phase] = max(heat_s, 0.0)
        late_s = 2 * (gap_s[EvidenceSource.INVERTER] + gap_s[EvidenceSource.LOOP])
        late_s += self.config.inverter.feedback_age_s
        late_s *= 2 * (limits.current_A / limits.i2t_current_A) ** 2
        if max(self.heat_s) > 1.05 * limits.i2t_time_s + late_s and self.b.state == State.ENABLED:
            raise Finding(f"I2t heat of {max(self.heat_s):g} s")

    def operate(self, seconds: float) -> None:
        """Set torques and speeds at random; disable and enable again now and then."""
        for _ in range(parts := int(self.rng.integers(1, 4))):
            if self.rng.random() < 0.3:
                self.ask(Request.DISABLE)
                self.run(int(self.rng.integers(1, 30)))
                self.enable()
            self.wanted_rad_s = self.rng.uniform(-1, 1) * self.most_rad_s
            self.b.setpoint["torque_Nm"] = self.rng.uniform(-1, 1) * self.most_Nm
            self.run_s(seconds / parts)

    def enable(self) -> None:
        self.ask(Request.ENABLE)
        self.run(2)
        while self.b.memory["arming"][0]:
            self.run()
        if self.b.state != State.ENABLED:
            raise Finding(f"not enabled: {Trip(int(self.b.tick['trip_bits'][0]))!r}")

    def reach(self, state: str) -> None:
        """Go to a state in which a fault may begin."""
        self.b.setpoint["torque_Nm"] = 0.0
        self.run_s(0.15 + self.config.inverter.feedback_age_s)
        if state == "arming":
            self.ask(Request.ENABLE)
            self.b.wrong.append(status("inverter_status", 0, int(InverterStatus.READY)))
            self.run()
        elif state != "off":
            self.enable()
        if state in ("torque", "stopping"):
            self.operate(0.4)
        if state in ("ready", "stopping"):
            self.ask(Request.DISABLE)
            self.run(1 if state == "stopping" else 3)

    def suffer(self, cause: Cause, state: str) -> None:
        """Run until the cause is found; then no current flows, whatever is asked for."""
        b, inverter, begun_ns = self.b, self.config.inverter, self.b.now_ns
        while b.state != State.TRIPPED:
            took_s = (b.now_ns - begun_ns) * 1e-9
            gaps_s = cause.gaps * b.longest_gap_s(cause.source) if cause.source else 0.0
            most_s = cause.stated_s + gaps_s + 2 * b.gap_s[EvidenceSource.LOOP]
            if took_s > most_s:
                if state == "off":
                    break
                raise Finding(f"not tripped after {took_s:g} s, stated {most_s:g} s")
            self.run()
        b.acceleration_rad_s2 = 0.0
        settled_s = inverter.actuation_delay_s + SETTLING_LAGS * inverter.lag_s
        gone_ns, flows_A = b.now_ns + round(settled_s * 1e9), max(map(abs, b.truth_A))
        for _ in range(40):
            if self.rng.random() < 0.2 and (cause.lasting or state != "off"):
                self.ask(Request([Request.ENABLE, Request.DISABLE][self.rng.integers(2)]))
            self.run()
            if b.state != (State.OFF if state == "off" else State.TRIPPED):
                raise Finding(f"{b.state.name} while the fault lasts")
            left_A = max(0.05 * flows_A if inverter.lag_s else 0.0, NOTHING_A)
            if b.now_ns > gone_ns + b.period_ns and max(map(abs, b.truth_A)) > left_A:
                raise Finding("current flows after the trip")

    def recover(self) -> None:
        """End the fault and reset; the bench takes a new request to be enabled."""
        b = self.b
        b.heal()
        b.speed_rad_s = self.wanted_rad_s = min(
            max(b.speed_rad_s, -self.most_rad_s), self.most_rad_s
        )
        for _ in range(60):
            self.run_s(0.05 + self.config.inverter.feedback_age_s)
            if b.state == State.TRIPPED:
                self.ask(Request.RESET)
                self.run(2)
            if b.state != State.TRIPPED and not b.tick["trip_bits"][0]:
                break
            if b.tick["trip_bits"][0] & Trip.I2T:
                raise Warm
        else:
            raise Finding(f"no reset: {Trip(int(b.tick['trip_bits'][0]))!r}")
        self.faulty = False
        self.run(30)
        self.reach("torque")


def play(seed: int, refused: Counter[str]) -> str:
    """Play a draw; return its fault, "" if it cannot be. Raises Finding."""
    rng = np.random.default_rng(seed)
    o = Operation(PlayedBench(drawn_bench(rng, lambda reason: refused.update([reason])), rng))
    begin, state = BEGIN[rng.integers(len(BEGIN))], str(rng.choice(STATES))
    try:
        o.reach(state)
        o.faulty, o.b.acceleration_rad_s2 = True, 0.0
        o.b.note_gaps()
        cause = begin(o.b)
        if cause is not None:
            o.suffer(cause, state)
            o.recover()
    except Warm:
        return ""
    except Finding as finding:
        raise Finding(f"{begin.__name__} in {state}: {finding}") from None
    return begin.__name__ if cause is not None else ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=seeds.first())
    parser.add_argument("--draws", type=int, default=1000)
    options = parser.parse_args()
    refused, played, findings = Counter[str](), Counter[str](), 0
    for seed in range(options.seed, options.seed + options.draws):
        try:
            played[play(seed, refused)] += 1
        except Finding as finding:
            findings += 1
            print(f"{seed}: {finding}", flush=True)
    print(*(f"refused {times}: {setting}" for setting, times in refused.most_common()), sep="\n")
    print(*(f"played {times}: {fault}" for fault, times in played.most_common() if fault), sep="\n")
    print(f"{findings} findings in {options.draws} draws")
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
