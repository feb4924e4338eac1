"""Efficiency map against the simulated truth: `python -m tests.campaigns.torque_speed`.

The packaged efficiency bench takes its mesh once, in virtual time; then torque sensor and power
analyser have other errors, within what [accuracy] states, in each of many trials. Prints how far
losses and efficiency are from the truth without these errors, and in how many trials intervals
hold it; exits with 1 if a bound is not kept. `tests/unit/experiments/torque_speed` asks the same of
a few points.

`python -m tests.campaigns.torque_speed departures 40`: made-up captures of a bench that departs,
each as often, torque sensor and power reading within TIGHT.
"""

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter, lfilter_zi

from motord.config import AccuracyConfig, Config, TorqueSensorConfig, load, packaged
from motord.experiments.plans import build
from motord.experiments.subject import Subject
from motord.experiments.torque_speed.estimate import operating_power
from motord.experiments.torque_speed.findings import ACCURACIES, IN_STEP, findings
from motord.experiments.torque_speed.power_series import PowerSeries
from motord.experiments.torque_speed.result import OperatingPower
from motord.experiments.torque_speed.turns import CapturedTurns
from motord.identification.operating_points import PointData, split
from motord.virtual.mesh import MeshPiece, processors, run_points
from tests.campaigns import departed, seeds
from tests.unit.experiments.torque_speed.captures import MOTOR, RATE_HZ, Machine

BENCH = packaged("../../../config/efficiency.toml")
TRIALS = 100
COVERED = (0.90, 0.99)
"""Share of the trials in which intervals are to hold the truth."""

ERROR_MAX = 0.005
"""Of the efficiency, in parts, without errors of the sensors but for their noise."""

EXACT = AccuracyConfig(
    torque_gain_percent=0.0, torque_zero_Nm=0.0, power_gain_percent=0.0, power_zero_W=0.0
)


@dataclass(frozen=True)
class TruePoint:
    """A captured operating point, with the energies that the rig truly took and gave."""

    point: PointData
    t_ns: np.ndarray
    energy_dc_J: np.ndarray
    energy_shaft_J: np.ndarray

    @classmethod
    def of(cls, piece: MeshPiece) -> "TruePoint":
        """Return the point of a piece of a mesh."""
        (point,) = split(piece.ticks, [piece.point])
        truth = piece.truth
        return cls(point, truth["t_ns"], truth["energy_dc_J"], truth["energy_shaft_J"])

    def read(
        self, rng: np.random.Generator, t0_ns: int, every_s: float, means: bool
    ) -> PowerSeries:
        """Return what an analyser reads, at a random phase, up to half a period late or early."""
        t_s = (self.t_ns - t0_ns) * 1e-9
        at_s = np.arange(t_s[0] + rng.uniform(1, 2) * every_s, t_s[-1] - every_s, every_s)
        if means:
            power_W = np.diff(np.interp(at_s, t_s, self.energy_dc_J)) / every_s
        else:
            power_W = np.interp(at_s, t_s, np.gradient(self.energy_dc_J, t_s))[1:]
        return PowerSeries(at_s[1:] + rng.uniform(-0.5, 0.5) * every_s, power_W, means)

    def truth(self, found: OperatingPower) -> tuple[float, float, float]:
        """Return losses (W), efficiency (%), mechanical power over the same turns."""
        ends_s = (np.array([found.t_start_ns, found.t_end_ns]) - self.t_ns[0]) * 1e-9
        t_s = (self.t_ns - self.t_ns[0]) * 1e-9
        shaft_W, dc_W = (
            float(np.diff(np.interp(ends_s, t_s, energy_J))[0] / np.diff(ends_s)[0])
            for energy_J in (self.energy_shaft_J, self.energy_dc_J)
        )
        part = shaft_W / dc_W if found.mode == "motoring" else dc_W / shaft_W
        return dc_W - shaft_W, 100 * part, shaft_W


@dataclass(frozen=True)
class Outcome:
    """Whether intervals hold the truth (None: efficiency is not stated), and the errors."""

    loss: bool
    efficiency: bool | None
    loss_error_W: float
    in_step: float
    efficiency_error: float


def true_points(config: Config, seed: int, **settings: object) -> Iterator[TruePoint]:
    """Yield the points of the bench's mesh, those of good quality."""
    with processors() as pool:
        for piece in run_points(config, build("torque-speed", config, settings), seed, pool=pool):
            if piece.point["quality"] == "ok":
                yield TruePoint.of(piece)


def outcome(
    one: TruePoint, config: Config, seed: int, accuracy: AccuracyConfig, means: bool = True
) -> Outcome:
    """Return what a trial with random errors within `accuracy` shows; noise is there anyway."""
    rng = np.random.default_rng(seed)
    torque_gain, torque_zero, power_gain, power_zero = rng.uniform(-1, 1, 4)
    ticks = one.point.ticks.copy()
    ticks["torque_Nm"] *= 1 + accuracy.torque_gain_percent / 100 * torque_gain
    ticks["torque_Nm"] += accuracy.torque_zero_Nm * torque_zero
    turns = CapturedTurns.of(replace(one.point, ticks=ticks), config.motor)
    read = one.read(rng, turns.t0_ns, 0.2, means)
    power_W = read.power_W * (1 + accuracy.power_gain_percent / 100 * power_gain)
    power_W = (
        power_W + accuracy.power_zero_W * power_zero + 0.05 * rng.standard_normal(power_W.size)
    )
    series = PowerSeries(read.t_s, power_W, means)
    place = (one.point.torque_Nm, one.point.speed_Hz)
    found = operating_power(*place, turns, series, accuracy, config.motor.pole_pairs)
    loss_W, efficiency, _ = one.truth(found)
    loss, stated = found.loss, found.efficiency
    assert loss.value is not None
    held = None if stated.low is None else stated.low < efficiency < (stated.high or 0.0)
    error = 0.0 if stated.value is None else stated.value / efficiency - 1
    return Outcome(
        (loss.low or 0.0) < loss_W < (loss.high or 0.0),
        held,
        loss.value - loss_W,
        found.in_step,
        error,
    )


def main(trials: int = TRIALS) -> int:
    """Run all trials and print what they show; return the exit code."""
    config, seed = load(BENCH), seeds.first()
    points = list(true_points(config, seed))
    accuracy, failed = config.accuracy, False
    for name, means in (("readings are means", True), ("readings are instants", False)):
        exact = [outcome(one, config, seed, EXACT, means) for one in points]
        # those that are in step with the rotor have a finding, not an interval that holds
        taken = [one for one, each in zip(points, exact, strict=True) if each.in_step <= IN_STEP]
        exact = [each for each in exact if each.in_step <= IN_STEP]
        worst = max(abs(each.efficiency_error) for each in exact)
        outcomes = [
            outcome(one, config, seed + 1 + number, accuracy, means)
            for number in range(trials)
            for one in taken
        ]
        loss = float(np.mean([each.loss for each in outcomes]))
        stated = [each.efficiency for each in outcomes if each.efficiency is not None]
        efficiency = float(np.mean(stated))
        kept = worst <= ERROR_MAX and all(COVERED[0] <= s <= COVERED[1] for s in (loss, efficiency))
        failed |= not kept
        print(
            f"{len(taken)} of {len(points)} points, {name}: efficiency off by {100 * worst:.2f} % "
            f"at most; in their intervals losses {100 * loss:.1f} %, "
            f"efficiency {100 * efficiency:.1f} %",
            *("NOT KEPT",) * (not kept),
        )
    return int(failed)


TIGHT = AccuracyConfig(
    torque_gain_percent=0.05, torque_zero_Nm=0.002, power_gain_percent=0.05, power_zero_W=0.02
)
"""Of a good torque sensor and power analyser, next to which departures show."""

Torque = Callable[[np.random.Generator, np.ndarray, np.ndarray], np.ndarray]
"""Torque that is recorded, of times (s) and of what the sensor shows (n,)."""


def as_shown(rng: np.random.Generator, t_s: np.ndarray, torque_Nm: np.ndarray) -> np.ndarray:
    """Return the torque as the sensor shows it."""
    return torque_Nm


def low_pass(rng: np.random.Generator, t_s: np.ndarray, torque_Nm: np.ndarray) -> np.ndarray:
    """Return the torque behind a low-pass of 20 Hz."""
    keep = np.exp(-2 * np.pi * 20.0 / RATE_HZ)
    b, a = [1 - keep], [1.0, -keep]
    return np.asarray(lfilter(b, a, torque_Nm, zi=lfilter_zi(b, a) * torque_Nm.mean())[0])


@dataclass(frozen=True)
class Departure:
    """An encoder's error once a turn, what the sensor shows of a coupling in phase with what that
    makes of the speed, ticks that are lost (parts), what else becomes of the torque."""

    encoder_deg: float = 0.0
    coupling_Nm: float = 0.0
    lost: float = 0.0
    torque: Torque = as_shown
    named: str = ""

    def ticks(self, rng: np.random.Generator, machine: Machine, ticks: np.ndarray) -> np.ndarray:
        """Return the ticks of a capture as they are recorded."""
        t_s, angle_rad, _, _ = machine.path()
        turned_rad = angle_rad + rng.uniform(0, 2 * np.pi)
        read_rad = angle_rad + np.radians(self.encoder_deg) * np.sin(turned_rad)
        shown_Nm = ticks["torque_Nm"] + self.coupling_Nm * np.cos(turned_rad)
        ticks["encoder_count"] = np.floor(read_rad / (2 * np.pi) * MOTOR.counts) % MOTOR.counts
        ticks["torque_Nm"] = self.torque(rng, t_s, shown_Nm)
        return ticks[rng.random(t_s.size) >= self.lost]

    def trial(self, seed: int) -> departed.Trial:
        """Return what a capture shows."""
        rng = np.random.default_rng(seed)
        machine = Machine(ripple_order=int(rng.integers(3, 30)), speed_Hz=rng.uniform(3, 5))
        torque_gain, torque_zero, power_gain, power_zero = rng.uniform(-1, 1, 4)
        point = machine.captured(
            rng,
            1 + TIGHT.torque_gain_percent / 100 * torque_gain,
            TIGHT.torque_zero_Nm * torque_zero,
        )
        turns = CapturedTurns.of(replace(point, ticks=self.ticks(rng, machine, point.ticks)), MOTOR)
        read = machine.readings(rng, rng.uniform(0.1, 0.4), noise_W=0.3)
        power_W = read.power_W * (1 + TIGHT.power_gain_percent / 100 * power_gain)
        series = PowerSeries(read.t_s, power_W + TIGHT.power_zero_W * power_zero, means=True)
        place = machine.torque_Nm, machine.speed_Hz
        found = operating_power(*place, turns, series, TIGHT, MOTOR.pole_pairs)
        shaft_W = machine.mechanical_W()
        efficiency = 100 * shaft_W / (shaft_W + machine.loss_W)
        held = {
            "losses": found.loss.low < machine.loss_W < found.loss.high,
            "efficiency": found.efficiency.low < efficiency < found.efficiency.high,
        }
        return departed.Trial(held, findings([found], SUBJECT))


SUBJECT = Subject(
    "made up",
    MOTOR,
    TorqueSensorConfig(resonance_Hz=200.0),
    AccuracyConfig(**{name: getattr(TIGHT, name) for name in ACCURACIES}),
)
DEPARTURES: Mapping[str, Departure] = {
    "none": Departure(),
    "encoder 1 deg": Departure(1.0),
    "coupling 0.5 Nm": Departure(0.0, 0.5),
    "encoder 0.3 deg, coupling 0.5 Nm": Departure(0.3, 0.5, named="shaft-ripple"),
    "encoder 1 deg, coupling 0.5 Nm": Departure(1.0, 0.5, named="shaft-ripple"),
    "torque in steps of 0.3 Nm": Departure(
        torque=lambda _, t_s, shown: np.round(shown / 0.3) * 0.3
    ),
    "heavy tails, 50 mNm times t of 2": Departure(
        torque=lambda rng, t_s, shown: shown + 0.05 * rng.standard_t(2, shown.size)
    ),
    "mains hum 0.15 Nm": Departure(
        torque=lambda rng, t_s, shown: (
            shown + 0.15 * np.sin(100 * np.pi * t_s + rng.uniform(0, 2 * np.pi))
        )
    ),
    "a tenth of the ticks lost": Departure(lost=0.1),
    "low-pass 20 Hz": Departure(torque=low_pass),
}


def departures(trials: int = TRIALS) -> int:
    """Run all departures and print what they show; return the exit code."""
    kept = [
        departed.judge(
            name,
            [departed.attempted(one.trial, seed) for seed in seeds.several(trials)],
            named=one.named,
        )
        for name, one in DEPARTURES.items()
    ]
    return int(not all(kept))


if __name__ == "__main__":
    sys.exit(departed.run(main, departures))
