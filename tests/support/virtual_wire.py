"""The loop with its drivers, the devices on the wire and the supervisor's core, in virtual time.

Everything runs in this process, one after the other; the clocks of the module `time` show the
world's time, which passes only where somebody waits. So no computer is too slow for a time limit,
and every run is the same to the bit.
"""

import select
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from motord.config import Config
from motord.control import parameters
from motord.control.types import SETPOINT
from motord.emulate.process import Emulator
from motord.hal.inverter import can_drive
from motord.hal.registry import make_rig
from motord.loop.control_loop import ControlLoop, StopRequest, run
from motord.loop.pacer import Pacer
from motord.rig.truth import load as load_truth
from motord.schema import TRUTH_DTYPE
from motord.shm.mailbox import MailboxReader, MailboxWriter
from motord.shm.ring import RingReader, RingWriter
from motord.shm.run_directory import RunDir
from motord.shm.tables import TablesReader, TablesWriter
from motord.unix_clock import Clock
from tests.unit.service import virtual_service
from tests.unit.service.virtual_service import STEP_NS, VirtualService

START_NS = 1_000_000_000_000_000
STEP_MAX_NS = 250_000
"""The emulator looks at its wires so often, as one that is never kept waiting."""


class World:
    """Time and the emulated devices; `truth` has a row of what the rig did for each step."""

    def __init__(self, config: Config) -> None:
        self.now_ns = START_NS
        self.emulator = Emulator(config, load_truth(config.bench.rig))
        self._rows, self._steps = np.zeros(1024, TRUTH_DTYPE), 0

    @property
    def truth(self) -> np.ndarray:
        return self._rows[: self._steps].copy()

    def advance(self, to_ns: int) -> None:
        """Let time pass for the devices."""
        while self.now_ns < to_ns:
            self.now_ns = min(to_ns, self.now_ns + STEP_MAX_NS)
            self._step()

    def _step(self) -> None:
        devices = self.emulator
        devices.bench.wake(self.now_ns)
        devices._listen(self.now_ns)
        devices._produce(self.now_ns)
        if self._steps == self._rows.size:
            self._rows = np.append(self._rows, np.zeros_like(self._rows))
        devices.bench.fill_truth(self.now_ns, self._rows[self._steps])
        self._steps += 1


class LastingPacer(Pacer):
    """Goes on where it was when the loop is run again."""

    _begun = False

    def start(self) -> None:
        if not self._begun:
            super().start()
        self._begun = True


class WireLoop:
    """The loop as its process has it; `write` and `run` are what the supervisor's core calls."""

    budget_exceeded = False

    def __init__(self, config: Config, world: World, run_dir: RunDir) -> None:
        self.world = world
        self.running = True
        self.last_torque_set_Nm = 0.0
        self.blocks: list[np.ndarray] = []
        run_dir.create()
        self._step_ticks = config.loop.rate_Hz * STEP_NS // 1_000_000_000
        self._mailbox = MailboxWriter(run_dir.setpoint, Clock(0))
        TablesWriter(run_dir.tables, config.motor.counts).write(*parameters.build(config))
        self.write(np.zeros(1, SETPOINT))
        self.rig = make_rig(config)
        self.rig.open()
        self._cycle = ControlLoop(
            self.rig,
            RingWriter(run_dir.ring, 1 << 14),
            MailboxReader(run_dir.setpoint),
            TablesReader(run_dir.tables),
            StopRequest(),
        )
        self._cycle.warm_up_kernel()
        self._reader = RingReader(run_dir.ring, "oldest")
        self._pacer = LastingPacer(1_000_000_000 // config.loop.rate_Hz, self)

    def start(self) -> None:
        """Nothing to note."""

    def clock_ns(self) -> int:
        return self.world.now_ns

    def wait_until(self, deadline_ns: int) -> int:
        self.world.advance(deadline_ns)
        return self.world.now_ns

    def write(self, setpoint: np.ndarray) -> None:
        self._mailbox.write(setpoint)

    def run(self, ticks: int | None = None) -> np.ndarray:
        """Run and return the ticks of the next 10 ms, or so many."""
        run(self._cycle, self._pacer, self._step_ticks if ticks is None else ticks)
        block, lost = self._reader.read()
        assert lost == 0
        self.blocks.append(block)
        self.last_torque_set_Nm = float(block["torque_set_Nm"][-1])
        return block

    @property
    def ticks(self) -> np.ndarray:
        return np.concatenate(self.blocks)


@contextmanager
def on_the_wire(
    config: Config, folder: Path, equip: Callable[[Emulator], object] | None = None
) -> Iterator[tuple[VirtualService, WireLoop]]:
    """Run a bench with a serial bridge, on the CAN bus `virtual` of python-can or on the kernel's.

    Brake and drive must be "none". `equip` may change the emulator once its ports are open.
    """
    with pytest.MonkeyPatch.context() as patch, ExitStack() as opened:
        world = World(config)
        clocks = {"monotonic_ns": 1, "time_ns": 1, "monotonic": 1e-9, "time": 1e-9}
        real_select, real_open = select.select, can_drive.open_bus

        def waiting(reading: Any, writing: Any, other: Any, timeout_s: float = 0.0) -> Any:
            world.advance(world.now_ns + round(min(timeout_s, 1e-3) * 1e9))
            return real_select(reading, writing, other, 0)

        def open_bus(*arguments: Any) -> Any:
            bus = real_open(*arguments)
            take = bus.receive

            def receive(timeout_s: float = 0.0) -> Any:
                world.advance(world.now_ns + round(timeout_s * 1e9))
                # a kernel stamps with its own clock
                return [(key, data, min(t_ns, world.now_ns)) for key, data, t_ns in take(0.0)]

            bus.receive = receive
            return bus

        patch.setenv("XDG_RUNTIME_DIR", str(folder))
        for name, scale in clocks.items():
            patch.setattr(time, name, lambda scale=scale: world.now_ns * scale)
        patch.setattr(select, "select", waiting)
        patch.setattr(can_drive, "open_bus", open_bus)
        opened.enter_context(world.emulator)
        if equip is not None:
            equip(world.emulator)
        world.emulator._start(world.now_ns)
        loop = WireLoop(config, world, RunDir("wire", folder / "run"))
        opened.callback(loop.rig.close)
        patch.setattr(virtual_service, "VirtualLoop", lambda _config, _virtual: loop)
        patch.setattr(virtual_service, "START_NS", world.now_ns)
        yield VirtualService(bench_config=config), loop
