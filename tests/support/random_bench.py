"""Benches with random legal settings around the control kernel, whose rotor, currents, sensors and
clocks are played here: what the kernel is judged by does not come from it."""

import math
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np
from pydantic import ValidationError

from motord.config import Config
from motord.config.timing import SAMPLE_TIME_S
from motord.control import parameters
from motord.control.interlock_table import EvidenceSource
from motord.schema import BridgeStatus, InverterStatus, State
from tests.unit.control.bench import EPOCH_NS, Bench, make_config

HEARTBEAT_NS = 10_000_000
Refused = Callable[[str], None]
Departure = Callable[["PlayedBench"], None]
"""Changes what a bench has read, before each tick."""


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def drawn_settings(rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Return tables of a bench file, each number over the range that its field has, or nearly."""

    def number(low: float, high: float) -> float:
        return log_uniform(rng, low, high)

    def whole(low: float, high: float) -> int:
        return round(log_uniform(rng, low, high))

    rate_Hz, torque_Nm, current_A = whole(100, 2000), number(0.1, 100.0), number(0.5, 200.0)
    delay_s = float(rng.choice([0.0, number(1e-5, 0.02)]))
    amplitude = torque_Nm / current_A * rng.uniform(0.5, 1.5)
    return {
        "loop": {
            "rate_Hz": rate_Hz,
            "observer_bandwidth_Hz": number(15, 1000),
            "supervisor_timeout_s": number(0.02, 1.0),
            "enable_timeout_s": number(0.02, 1.0),
            "overrun_ticks": whole(2, rate_Hz),
        },
        "bridge": {
            "rate_Hz": [None, whole(100, 2000)][rng.integers(2)],
            "stale_after_s": number(0.001, 1.0),
            "heartbeat_timeout_s": 1.0,
        },
        "inverter": {
            "stale_after_s": number(0.001, 1.0),
            "timeout_s": 1.0,
            "actuation_delay_s": delay_s,
            "lag_s": delay_s * float(rng.choice([0.0, rng.uniform(0.0, 1.0)])),
            "feedback_age_s": float(rng.choice([0.0, number(1e-4, 0.5)])),
        },
        "torque_sensor": {"highpass_time_constant_s": float(rng.choice([0.0, number(0.02, 10.0)]))},
        "motor": {
            "counts": int(rng.choice([whole(16, 100_000), 2 ** int(rng.integers(4, 17))])),
            "pole_pairs": whole(1, 50),
            "connection": str(rng.choice(["star", "independent"])),
            "encoder_direction": int(rng.choice([1, -1])),
            "back_emf": [{"order": 1, "amplitude_V_s_per_rad": amplitude}],
        },
        "limits": {
            "torque_Nm": torque_Nm,
            "trip_torque_Nm": torque_Nm * rng.uniform(1.3, 3.0),
            "torque_rate_Nm_per_s": torque_Nm * number(0.1, 1000.0),
            "current_A": current_A,
            "trip_current_A": current_A * rng.uniform(1.05, 3.0),
            "current_error_A": current_A * number(0.1, 0.86),
            "current_error_s": number(0.0005, 1.0),
            "torque_error_Nm": torque_Nm * number(0.1, 0.79),
            "torque_error_s": number(0.001, 1.0),
            "i2t_current_A": current_A * number(0.3, 2.0),
            "i2t_time_s": number(0.01, 30.0),
            "trip_speed_rad_s": number(1.0, 300.0),
            "encoder_jump_rad": number(0.002, math.pi / 2),
            "link_errors_per_s": number(1.0, 1000.0),
        },
    }


def drawn_bench(rng: np.random.Generator, refused: Refused) -> Config:
    """Return a bench that is legal. `refused` gets the setting that each refusal names.

    Half of the settings that are refused take the bound that the refusal names: so that many
    benches have several settings at their very bounds."""
    while True:
        tables = drawn_settings(rng)
        for _ in range(12):
            try:
                return make_config(**tables)
            except ValidationError as error:
                text = error.errors()[0]["msg"]
            section, _, key = text.partition("[")[2].partition(" = ")[0].partition("] ")
            refused(f"[{section}] {key}")
            bound = text.partition("make it ")[2].partition(",")[0].split(";")[0].split()
            table = tables.get(section, {})
            if not bound or key not in table or rng.random() < 0.3:
                break
            taken = float(bound[-1]) * (0.999 if bound[0] == "less" else 1.0)
            table[key] = math.floor(taken) if key == "overrun_ticks" else taken


class PlayedBench(Bench):
    """A bench in virtual time whose samples come at their own rates, late, and not all of them.

    The rotor turns with `acceleration_rad_s2`; currents follow commands with the delay and lag of
    the bench file, and are sampled `feedback_age_s` before they arrive; the torque sensor has its
    high-pass. `wrong` departs from what was read, before each tick; `truth_A` is what flows.
    """

    def __init__(self, config: Config, rng: np.random.Generator) -> None:
        super().__init__(config)
        tables = parameters.build(config)
        self.parameters = tables[0]
        self.rng, self.wrong = rng, list[Departure]()
        inverter, loop_Hz = config.inverter, config.loop.rate_Hz
        self.speed_rad_s, self.acceleration_rad_s2 = 0.0, 0.0
        self.angle_rad = float(rng.uniform(0, 2 * math.pi))
        self.interval_ns = 1e9 / config.sample_rate_Hz
        self.seen_s = config.sample_interval_s
        self.dead_ns = round((inverter.actuation_delay_s - inverter.lag_s) * 1e9)
        self.age_ns, self.lag_s = round(inverter.feedback_age_s * 1e9), inverter.lag_s
        self.tau_s = config.torque_sensor.highpass_time_constant_s
        self._k = tables[1].tolist()
        self._t_ns, self._target_A = self.now_ns, (0.0, 0.0, 0.0)
        self.truth_A = (0.0, 0.0, 0.0)
        self._torque_Nm = self.shown_Nm = 0.0
        self._commands: deque[tuple[int, tuple[float, ...]]] = deque()
        self._feedback: deque[tuple[int, tuple[float, ...]]] = deque()
        self._samples: deque[tuple[int, int, int, float]] = deque()
        self._sample_ns = self.now_ns + rng.uniform(0, 1) * self.interval_ns
        self._due_ns, self.phase = self.now_ns, float(rng.uniform(0.05, 1.0))
        period_s = 1.0 / loop_Hz
        late_s = min(
            config.bridge.stale_after_s - 2 * self.seen_s,
            inverter.stale_after_s - inverter.feedback_age_s - 2 * period_s,
            0.03 - 2 * self.seen_s,
        )
        self.lossy = late_s > 0.6 * period_s + 0.3 * self.seen_s
        late_s -= 0.6 * period_s + 0.3 * self.seen_s
        # old feedback lacks what was not sampled in a stall: that may come in the next one
        stalled_most = int(max(late_s, 0.0) * loop_Hz / 2)
        self.stalled_most = min(stalled_most, config.loop.overrun_ticks - 1)
        self.off_ns = round(rng.uniform(0, SAMPLE_TIME_S) * 1e9) if self.lossy else 0
        self._lost = dict.fromkeys(EvidenceSource, False)
        self._stalled = self._stalled_at = 0
        self.bridge_silent = self.inverter_silent = self.supervisor_silent = False
        self.gap_s = dict.fromkeys(EvidenceSource, 0.0)
        self._arrived_ns = dict.fromkeys(EvidenceSource, self.now_ns)

    def note_gaps(self) -> None:
        """Begin to note the longest gaps between ticks and between new samples."""
        period_s = self.period_ns * 1e-9
        self.gap_s = dict.fromkeys(EvidenceSource, period_s)
        self.gap_s[EvidenceSource.BRIDGE] = self.seen_s

    def stall(self, ticks: int) -> None:
        """Let the loop miss so many periods before its next tick."""
        self._stalled = ticks

    def heal(self) -> None:
        """Let all sources speak, and truly."""
        self.wrong.clear()
        self.bridge_silent = self.inverter_silent = self.supervisor_silent = False
        self.acceleration_rad_s2 = 0.0
        self.feedback["inverter_status"] = InverterStatus.READY
        self.feedback["bridge_status"] = BridgeStatus.ENABLE_LINE
        self.feedback["u_bus_V"], self.feedback["temperature_C"] = 24.0, 20.0
        self.setpoint["brake_temperature_C"] = self.setpoint["channels_beyond"] = 0

    def tick_once(self) -> np.record:
        """Let time pass until the next tick, and run it."""
        before_ns = self.now_ns
        stalled, self._stalled = self._stalled, 0
        may_stall = self.stalled_most > 0 and self.number - self._stalled_at > 3
        if not stalled and may_stall and self.rng.random() < 0.02:
            stalled = int(self.rng.integers(1, self.stalled_most + 1))
        self._stalled_at = self.number if stalled else self._stalled_at
        self._due_ns += (1 + stalled) * self.period_ns
        late = self.rng.uniform(0, 0.3) if self.lossy and self.rng.random() < 0.1 else 0.0
        self._play(self._due_ns + round(late * self.period_ns))
        self.tick["missed"] += stalled
        for depart in self.wrong:
            depart(self)
        if not self.supervisor_silent:
            self.setpoint["heartbeat_ns"] = EPOCH_NS + (
                (self.now_ns - EPOCH_NS) // HEARTBEAT_NS * HEARTBEAT_NS
            )
        now_ns = self.now_ns
        self.now_ns, turning, self.speed_rad_s = now_ns - self.period_ns, self.speed_rad_s, 0.0
        tick = self.run(healthy=False, supervised=False)
        self.speed_rad_s = turning
        self.gap_s[EvidenceSource.LOOP] = max(
            self.gap_s[EvidenceSource.LOOP], (now_ns - before_ns) * 1e-9
        )
        self._commands.append((now_ns + self.dead_ns, tuple(self.command["i_A"][0].tolist())))
        return tick

    def _arrives(self, source: EvidenceSource) -> bool:
        lost = self.lossy and not self._lost[source] and self.rng.random() < 0.1
        self._lost[source] = lost
        return not lost

    def _play(self, to_ns: int) -> None:
        f = self.feedback[0]
        sense_ns = self.now_ns + round(self.phase * (to_ns - self.now_ns))
        sensed = False
        while self._sample_ns <= to_ns or not sensed:
            if not sensed and sense_ns <= self._sample_ns:
                self._advance(sense_ns)
                self._feedback.append((sense_ns, self.truth_A))
                sensed = True
                continue
            t_ns = round(self._sample_ns)
            self._sample_ns += self.interval_ns
            self._advance(t_ns)
            latency_ns = self.rng.uniform(0, 0.3) * 1e9 * self.seen_s if self.lossy else 0.0
            count = self.count_at(self.angle_rad % (2 * math.pi))
            if self.config.motor.encoder_direction < 0:
                count = -count % self._counts
            stamp_ns = min(t_ns + self.off_ns, t_ns + round(latency_ns))
            self._samples.append(
                (t_ns + round(latency_ns), stamp_ns, count ^ (count >> 1), self.shown_Nm)
            )
        self._advance(to_ns)
        self.now_ns = to_ns
        while self._feedback and self._feedback[0][0] + self.age_ns <= to_ns:
            t_ns, i_A = self._feedback.popleft()
            if not self.inverter_silent and self._arrives(EvidenceSource.INVERTER):
                self._arrive(EvidenceSource.INVERTER)
                f["t_inverter_ns"], f["i_A"] = t_ns, i_A
        while self._samples and self._samples[0][0] <= to_ns:
            _, t_ns, gray, torque_Nm = self._samples.popleft()
            if not self.bridge_silent and self._arrives(EvidenceSource.BRIDGE) and t_ns > f["t_ns"]:
                self._arrive(EvidenceSource.BRIDGE)
                f["t_ns"], f["encoder_gray"], f["torque_Nm"] = t_ns, gray, torque_Nm

    def _arrive(self, source: EvidenceSource) -> None:
        gap_s = (self.now_ns - self._arrived_ns[source]) * 1e-9
        self.gap_s[source] = max(self.gap_s[source], gap_s)
        self._arrived_ns[source] = self.now_ns

    def longest_gap_s(self, source: EvidenceSource) -> float:
        """Return the longest gap between new samples that was noted, or the one that goes on."""
        return max(self.gap_s[source], (self.now_ns - self._arrived_ns[source]) * 1e-9)

    def _advance(self, to_ns: int) -> None:
        while self._commands and self._commands[0][0] <= to_ns:
            t_ns, i_A = self._commands.popleft()
            self._flow(max(t_ns, self._t_ns))
            self._target_A = i_A
            if not self.lag_s:
                self._flow(self._t_ns)
        self._flow(to_ns)

    def _flow(self, to_ns: int) -> None:
        dt_s = (to_ns - self._t_ns) * 1e-9
        self._t_ns = to_ns
        a_rad_s2 = self.acceleration_rad_s2
        self.angle_rad += (self.speed_rad_s + 0.5 * a_rad_s2 * dt_s) * dt_s
        self.speed_rad_s += a_rad_s2 * dt_s
        decay = math.exp(-dt_s / self.tau_s) if self.tau_s else 1.0
        torque_Nm = 0.0
        if any(self._target_A) or any(self.truth_A):
            left = math.exp(-dt_s / self.lag_s) if self.lag_s else 0.0
            (a, b, c), (x, y, z) = self.truth_A, self._target_A
            self.truth_A = a, b, c = x + left * (a - x), y + left * (b - y), z + left * (c - z)
            counts = self._counts
            k = self._k[int(self.angle_rad / (2 * math.pi) * counts + 0.5) % counts]
            torque_Nm = k[0] * a + k[1] * b + k[2] * c
        self.shown_Nm = decay * (self.shown_Nm + torque_Nm - self._torque_Nm)
        self._torque_Nm = torque_Nm

    @property
    def state(self) -> State:
        return State(int(self.tick["state"][0]))
