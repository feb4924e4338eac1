"""Control kernel and simulated rig stepped together in virtual time, seeded and compiled."""

import math
from typing import TYPE_CHECKING

import numpy as np

from motord.config import Config, ConfigError
from motord.config.faults import Fault, Timeline, load_timeline
from motord.config.timing import LATE_MAX_S
from motord.control import parameters as control_parameters
from motord.control.park import dq_frame_record
from motord.control.step import new_memory, step
from motord.control.types import COMMAND, FEEDBACK
from motord.jit import jit
from motord.rig.build import build, with_drive
from motord.rig.feedback import apply_command, fill_feedback
from motord.rig.step import advance, fill_truth, sense
from motord.rig.truth import RigTruth, load
from motord.rig.types import RIG_INPUT, RIG_OUTPUT
from motord.schema import TICK_DTYPE, TRUTH_DTYPE, Flag
from motord.virtual.drive import command_to_drive, feedback_from_drive
from motord.virtual.faults import Player, deliver, deliver_command, expire, new_link

if TYPE_CHECKING:
    from motord.calibration import Calibration

EPOCH_NS = 1_767_225_600_000_000_000
"""Unix time at which virtual time starts: 2026-01-01 00:00:00 UTC."""


def rig_and_faults(
    config: Config, truth: RigTruth | None = None, faults: Timeline | None = None
) -> tuple[RigTruth, Timeline | None]:
    """Return the rig of a bench and the faults to come, if any; by default those of its files.

    Raises ConfigError where the files are wrong, or do not fit the bench.
    """
    truth = with_drive(truth or load(config.bench.rig), config.inverter)
    if truth.encoder.counts != config.motor.counts:
        raise ConfigError(
            f"{config.bench.rig or 'the simulated rig'}: its encoder has "
            f"{truth.encoder.counts} counts, [motor] counts says {config.motor.counts}"
        )
    if faults is None and config.simulated and config.bench.faults is not None:
        faults = load_timeline(config.bench.faults)
    if faults is not None:
        faults.check_place("virtual")
    return truth, faults


class VirtualBench:
    """A bench in virtual time: each `run` continues where the one before ended.

    `truth` is by default the rig file of `[bench] rig`, or the packaged rig; `seed` by default
    that of `[bench]`. The same config, truth, seed and calls give the same bits. The supervisor's
    heartbeat is fresh unless a fault says otherwise. `faults` is by default the timeline of
    `[bench] faults` of a simulated bench, counted from the start of virtual time. Raises
    ConfigError as `rig_and_faults` does.
    """

    def __init__(
        self,
        config: Config,
        truth: RigTruth | None = None,
        seed: int | None = None,
        calibration: "Calibration | None" = None,
        faults: Timeline | None = None,
    ) -> None:
        self.config = config
        self.truth, faults = rig_and_faults(config, truth, faults)
        self.tick = 0
        self.missed = 0
        self._axes = dq_frame_record(config)
        seed = config.bench.seed if seed is None else seed
        self._rig = build(self.truth, seed, self._fitting_substep_s())
        self._input, self._output = np.zeros(1, RIG_INPUT), np.zeros(1, RIG_OUTPUT)
        self._memory = new_memory()
        self._feedback = np.zeros(1, FEEDBACK)
        self._command, self._sent = np.zeros(1, COMMAND), np.zeros(1, COMMAND)
        self._link = new_link(
            seed, config.inverter.timeout_s, config.bridge.heartbeat_timeout_s, config.loop.rate_Hz
        )
        late_ticks = LATE_MAX_S * config.loop.rate_Hz
        self._ring, self._fresh = np.zeros(late_ticks + 1, FEEDBACK), np.zeros(1, FEEDBACK)
        self._player = None
        if faults is not None:
            self._player = Player(faults, config.loop.rate_Hz, self._link)
        self.install(calibration)

    @property
    def fault_events(self) -> list[dict[str, object]]:
        """Every fault injected so far: t_ns, tick, kind and parameters."""
        return self._player.events if self._player else []

    @property
    def fault_peak_A(self) -> float:
        """Largest true current of a phase, at any instant at which a fault of the rig was on."""
        return float(self._rig[1]["fault_peak_A"][0])

    def inject(self, fault: Fault) -> None:
        """Let a fault begin `at_s` from now. Raises ValueError for one not possible here."""
        if self._player is None:
            self._player = Player(Timeline(), self.config.loop.rate_Hz, self._link)
            self._link["heartbeat_ns"] = self.t_ns
        self._player.inject(fault, self.tick)

    @property
    def t_ns(self) -> int:
        """Unix ns of the next tick."""
        return EPOCH_NS + self.tick * 1_000_000_000 // self.config.loop.rate_Hz

    @property
    def t_s(self) -> float:
        """Seconds of virtual time passed."""
        return self.tick / self.config.loop.rate_Hz

    def install(self, calibration: "Calibration | None") -> None:
        """Let the kernel use `calibration`, or none, from the next tick on."""
        self._tables = control_parameters.build(self.config, calibration)

    def alter(self, truth: RigTruth) -> None:
        """Let the rig be `truth` from the next tick on, moving and as warm as it is."""
        self.truth = with_drive(truth, self.config.inverter)
        self._rig = (build(self.truth, 0, self._fitting_substep_s())[0], self._rig[1])

    def run(self, setpoint: np.ndarray, ticks: int) -> tuple[np.ndarray, np.ndarray]:
        """Run `ticks` periods under `setpoint` (SETPOINT, shape (1,)).

        Returns blocks of TICK_DTYPE and TRUTH_DTYPE, shape (ticks,): row n of both is the same
        instant.
        """
        tick_block, truth_block = np.zeros(ticks, TICK_DTYPE), np.zeros(ticks, TRUTH_DTYPE)
        self.fill(setpoint, tick_block, truth_block)
        return tick_block, truth_block

    def fill(self, setpoint: np.ndarray, tick_block: np.ndarray, truth_block: np.ndarray) -> None:
        """Run one period for each row of two blocks of equal length; they must be zero before."""
        if self._player is None:
            self._run_rows(setpoint, tick_block, truth_block)
            return
        row = 0
        while row < tick_block.size:
            stalled = self._player.play(self.tick, self.t_ns, self._input)
            if stalled:
                self._stall(stalled)
                tick_block["flags"][row] |= Flag.LATE | Flag.AFTER_GAP
                continue
            end = min(row + self._player.next_edge(self.tick), tick_block.size)
            tick_block["missed"][row:end] = self.missed
            self._run_rows(setpoint, tick_block[row:end], truth_block[row:end])
            row = end

    def _stall(self, ticks: int) -> None:
        """Let time pass without the loop: its last command stays, until devices time out."""
        for _ in range(ticks):
            self._link["command_age"] += 1
            self._link["beat_age"] += 1
            expire(self._link, self._input)
            advance(*self._rig, self._input, 1.0 / self.config.loop.rate_Hz)
        self._link["tick"] += ticks
        self.tick += ticks
        self.missed += ticks

    def _run_rows(
        self, setpoint: np.ndarray, tick_block: np.ndarray, truth_block: np.ndarray
    ) -> None:
        _run(
            *self._rig,
            self._input,
            self._output,
            *self._tables,
            self._memory,
            self._feedback,
            setpoint.copy(),
            self._command,
            self._axes,
            self._sent,
            self._link,
            self._ring,
            self._fresh,
            self.config.torque_Nm_per_count,
            self.tick,
            self.config.loop.rate_Hz,
            tick_block,
            truth_block,
        )
        self.tick += tick_block.size

    def _fitting_substep_s(self) -> float:
        """Return the longest step that the rig allows and that fits the period evenly."""
        period_s = 1.0 / self.config.loop.rate_Hz
        return period_s / math.ceil(period_s / self.truth.simulation.substep_s - 1e-9)


@jit
def _run(
    rig_parameters: np.ndarray,
    rig_state: np.ndarray,
    rig_input: np.ndarray,
    rig_output: np.ndarray,
    parameters: np.ndarray,
    back_emf: np.ndarray,
    cogging_Nm: np.ndarray,
    learned_Nm: np.ndarray,
    memory: np.ndarray,
    feedback: np.ndarray,
    setpoint: np.ndarray,
    command: np.ndarray,
    axes: np.ndarray,
    sent: np.ndarray,
    link: np.ndarray,
    ring: np.ndarray,
    fresh: np.ndarray,
    torque_Nm_per_count: float,
    first_tick: int,
    rate_Hz: int,
    tick_block: np.ndarray,
    truth_block: np.ndarray,
) -> None:
    """Sense, decide, act, let a period pass; once for every row of the blocks."""
    s, lk, period_s = setpoint[0], link[0], 1.0 / rate_Hz
    disturbed, turning = lk.active != 0, axes[0].turning != 0
    receives_dq = turning and not axes[0].sends_phases
    sensed, received = fresh if disturbed else feedback, sent if turning else command
    for row in range(tick_block.size):
        number = first_tick + row
        t_ns = EPOCH_NS + number * 1_000_000_000 // rate_Hz
        sense(rig_parameters, rig_state, rig_output)
        fill_feedback(rig_output, t_ns, torque_Nm_per_count, sensed)
        if receives_dq:
            feedback_from_drive(axes, command, rig_output, sensed)
        if disturbed:
            deliver(link, ring, fresh, feedback)
            if not lk.supervisor_silent:
                lk.heartbeat_ns = t_ns
            s.heartbeat_ns = lk.heartbeat_ns
        else:
            s.heartbeat_ns = t_ns
        s.brake_temperature_C = rig_output[0].brake_temperature_C
        tick_block[row].tick = number
        step(
            parameters,
            back_emf,
            cogging_Nm,
            learned_Nm,
            memory,
            feedback,
            setpoint,
            command,
            tick_block[row : row + 1],
        )
        fill_truth(rig_state, t_ns, truth_block[row])
        if turning:
            command_to_drive(axes, command, sent, rig_parameters, rig_state)
        if disturbed:
            deliver_command(link, received, rig_input)
        else:
            apply_command(received, rig_input)
        advance(rig_parameters, rig_state, rig_input, period_s)
