"""A bench of arrays around the kernel: healthy feedback, one tick at a time."""

from copy import deepcopy
from typing import Any, Self

import numpy as np

from motord.config import Config
from motord.control import parameters
from motord.control.step import new_memory, step
from motord.control.types import COMMAND, FEEDBACK, SETPOINT
from motord.jit import jit
from motord.schema import TICK_DTYPE, BridgeStatus, InverterStatus, Request, State

EPOCH_NS = 1_700_000_000_000_000_000


def make_config(**sections: Any) -> Config:
    motor = {
        "name": "test motor",
        "pole_pairs": 8,
        "slots": 48,
        "counts": 4096,
        "rated_torque_Nm": 6.0,
        "connection": "independent",
        "back_emf": [
            {"order": 1, "amplitude_V_s_per_rad": 0.206},
            {"order": 3, "amplitude_V_s_per_rad": 0.01, "phase_rad": 0.3},
            {"order": 5, "amplitude_V_s_per_rad": 0.006},
        ],
    }
    motor.update(sections.pop("motor", {}))
    return Config.model_validate({"motor": motor, **sections})


class Bench:
    def __init__(self, config: Config | None = None, calibration: Any = None) -> None:
        self.config = config or make_config()
        tables = parameters.build(self.config, calibration)
        self.parameters, self.back_emf, self.cogging_Nm, self.learned_Nm = tables
        # it does not answer its commands: no current flows, no torque is made
        limits = self.config.limits
        for name in ("current_error_A", "torque_error_Nm"):
            if getattr(limits, name) is None:
                self.parameters[name] = 1e6
        self.memory = new_memory()
        self.feedback = np.zeros(1, FEEDBACK)
        self.setpoint = np.zeros(1, SETPOINT)
        self.command = np.zeros(1, COMMAND)
        self.tick = np.zeros(1, TICK_DTYPE)
        self.period_ns = round(1e9 / self.config.loop.rate_Hz)
        self.now_ns = EPOCH_NS
        self.angle_rad = 1.0
        self.speed_rad_s = 5.0
        self.feedback["u_bus_V"] = 24.0
        self.feedback["inverter_status"] = InverterStatus.READY
        self.feedback["bridge_status"] = BridgeStatus.ENABLE_LINE
        self.number = 0
        self._counts = self.config.motor.counts

    def count_at(self, angle_rad: float) -> int:
        return round(angle_rad / (2 * np.pi) * self._counts) % self._counts

    def run(self, ticks: int = 1, healthy: bool = True, supervised: bool = True) -> np.record:
        # counts that a test makes of its own are asked for tick by tick
        own = healthy and getattr(self.count_at, "__func__", None) is not Bench.count_at
        for _ in range(ticks if own else 1):
            several = 1 if own else ticks
            if own:
                count = self.count_at(self.angle_rad + self.speed_rad_s * self.period_ns * 1e-9)
                self.feedback["encoder_gray"] = count ^ (count >> 1)
            self.angle_rad = _run(
                self.parameters,
                self.back_emf,
                self.cogging_Nm,
                self.learned_Nm,
                self.memory,
                self.feedback,
                self.setpoint,
                self.command,
                self.tick,
                several,
                self.number,
                self.now_ns,
                self.period_ns,
                float(self.angle_rad),
                float(self.speed_rad_s),
                self._counts if healthy and not own else 0,
                healthy,
                supervised,
            )
            self.now_ns += several * self.period_ns
            self.number += several
        return self.tick[0]

    def ask(self, request: Request) -> None:
        self.setpoint["request"] = request
        self.setpoint["request_seq"] += 1

    def enable(self, torque_Nm: float = 0.0, compensate: int = 0) -> None:
        self.run(5)
        self.ask(Request.ENABLE)
        self.setpoint["torque_Nm"] = torque_Nm
        self.setpoint["compensate"] = compensate
        self.run(3)
        assert self.tick["state"][0] == State.ENABLED, self.tick["trip_bits"][0]

    def currents_A(self) -> np.ndarray:
        return self.command["i_A"][0].astype(float)

    def copied(self) -> Self:
        """Return another bench in the same state: what nobody writes to is that of both."""
        fixed = (self.config, self.back_emf, self.cogging_Nm, self.learned_Nm)
        return deepcopy(self, {id(one): one for one in fixed})


@jit
def _run(
    parameters: np.ndarray,
    back_emf: np.ndarray,
    cogging_Nm: np.ndarray,
    learned_Nm: np.ndarray,
    memory: np.ndarray,
    feedback: np.ndarray,
    setpoint: np.ndarray,
    command: np.ndarray,
    tick: np.ndarray,
    ticks: int,
    number: int,
    now_ns: int,
    period_ns: int,
    angle_rad: float,
    speed_rad_s: float,
    counts: int,
    healthy: bool,
    supervised: bool,
) -> float:
    """Run ticks and return the angle after them; counts: of the encoder that is read, 0 if none."""
    f, s, t = feedback[0], setpoint[0], tick[0]
    for _ in range(ticks):
        number += 1
        now_ns += period_ns
        angle_rad += speed_rad_s * period_ns * 1e-9
        f["now_ns"] = now_ns
        if healthy:
            f["t_ns"] = now_ns
            f["t_inverter_ns"] = now_ns
        if counts:
            count = round(angle_rad / (2 * np.pi) * counts) % counts
            f["encoder_gray"] = count ^ (count >> 1)
        if supervised:
            s["heartbeat_ns"] = now_ns
        t["tick"] = number
        t["flags"] = 0
        step(
            parameters,
            back_emf,
            cogging_Nm,
            learned_Nm,
            memory,
            feedback,
            setpoint,
            command,
            tick,
        )
    return angle_rad
