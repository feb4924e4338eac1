"""A bench for the loop without devices or real time: files in a folder, a scripted rig."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from motord import config
from motord.control import parameters
from motord.control.types import COMMAND, SETPOINT
from motord.schema import BridgeStatus, InverterStatus, Request
from motord.shm.mailbox import MailboxWriter
from motord.shm.run_directory import RunDir
from motord.shm.tables import TablesWriter
from motord.unix_clock import Clock

BENCH = """
[bench]
name = "fake"
[loop]
rate_Hz = 1000
ring_s = 4
[motor]
name = "m"
pole_pairs = 8
slots = 48
counts = 4096
rated_torque_Nm = 6.0
connection = "independent"
back_emf = [{order = 1, amplitude_V_s_per_rad = 0.206}]
"""


def write_bench(folder: Path) -> Path:
    path = folder / "fake.toml"
    path.write_text(BENCH)
    return path


class Supervisor:
    """Writes what a supervisor writes: tables, set-points."""

    def __init__(self, run_dir: RunDir, config_path: Path) -> None:
        bench = config.load(config_path)
        run_dir.create()
        self.clock = Clock.measure()
        self.mailbox = MailboxWriter(run_dir.setpoint, self.clock)
        self.tables = TablesWriter(run_dir.tables, bench.motor.counts)
        self.tables.write(*parameters.build(bench))
        self.setpoint = np.zeros(1, SETPOINT)

    def ask(self, request: Request = Request.NONE, torque_Nm: float = 0.0) -> None:
        if request != Request.NONE:
            self.setpoint["request"] = request
            self.setpoint["request_seq"] += 1
        self.setpoint["torque_Nm"] = torque_Nm
        self.setpoint["seq"] += 1
        self.mailbox.write(self.setpoint)


class ScriptedRig:
    """A healthy rig at standstill that calls `on_read(reads)` in every tick, and remembers."""

    refused = ""
    clock = None

    def __init__(self, on_read: Callable[[int], None] = lambda _reads: None) -> None:
        self.on_read = on_read
        self.calls: list[str] = []
        self.commands: list[np.ndarray] = []
        self.reads = 0

    def open(self) -> None:
        self.calls.append("open")

    def read(self, now_ns: int, feedback: np.ndarray) -> None:
        self.on_read(self.reads)
        self.reads += 1
        feedback["t_ns"] = feedback["t_inverter_ns"] = now_ns
        feedback["inverter_status"] = InverterStatus.READY | InverterStatus.ENABLE_LINE
        feedback["bridge_status"] = BridgeStatus.ENABLE_LINE
        feedback["u_bus_V"] = 24.0
        feedback["temperature_C"] = 25.0

    def write(self, command: np.ndarray) -> None:
        assert command.dtype == COMMAND
        self.commands.append(command.copy())

    def safe_stop(self) -> None:
        self.calls.append("safe_stop")

    def close(self) -> None:
        self.calls.append("close")
