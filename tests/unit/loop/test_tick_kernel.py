"""The compiled tick does what the control kernel does, and the bookkeeping around it."""

import numpy as np
import pytest

from motord import config
from motord.control import parameters
from motord.control import step as kernel
from motord.control.types import COMMAND, FEEDBACK, SETPOINT
from motord.loop import tick_kernel
from motord.loop.tick_kernel import NO_WORK, TickKernel, run_tick
from motord.schema import TICK_DTYPE, BridgeStatus, InverterStatus, Request, State
from motord.shm.tables import TableSet
from motord.shm.timing import Timing


class Bench:
    """Records of a healthy rig that turns, commanded to apply torque."""

    def __init__(self) -> None:
        self.tables = TableSet(*parameters.build(config.load()))
        self.timing = Timing()
        self.memory = kernel.new_memory()
        self.feedback, self.setpoint = np.zeros(1, FEEDBACK), np.zeros(1, SETPOINT)
        self.command, self.ring = np.zeros(1, COMMAND), np.zeros(4, TICK_DTYPE)
        self.setpoint[0].request = Request.ENABLE
        self.setpoint[0].torque_Nm = 2.0
        self.kernel = TickKernel(
            self.tables,
            self.timing.record,
            *(self.memory, self.feedback, self.setpoint, self.command, self.ring),
        )

    def step(self, n: int) -> None:
        f, s = self.feedback[0], self.setpoint[0]
        f.now_ns = f.t_ns = f.t_inverter_ns = s.heartbeat_ns = 10**18 + n * 500_000
        f.encoder_gray = (n % 4096) ^ (n % 4096 >> 1)
        f.inverter_status = InverterStatus.READY | InverterStatus.ENABLE_LINE
        f.bridge_status = BridgeStatus.ENABLE_LINE
        f.u_bus_V, f.temperature_C = 24.0, 25.0
        s.request_seq = 1 if n > 2 else 0


@pytest.mark.kernel
def test_same_as_the_kernel_called_with_arrays() -> None:
    bound, plain = Bench(), Bench()
    for n in range(300):
        for bench in (bound, plain):
            bench.step(n)
        slot = n % 4
        run_tick(bound.kernel.frame, slot, n, n // 10, 1, 30 + n, 5_000 + n)
        record = plain.ring[slot]
        record.tick, record.missed, record["flags"] = n, n // 10, 1
        record.wake_late_ns, record.work_ns = 30 + n, 5_000 + n
        kernel.step(
            *plain.tables,
            *(plain.memory, plain.feedback, plain.setpoint, plain.command),
            plain.ring[slot : slot + 1],
        )
        assert bound.ring.tobytes() == plain.ring.tobytes()
    assert bound.memory.tobytes() == plain.memory.tobytes()
    assert bound.command.tobytes() == plain.command.tobytes()
    assert bound.memory["state"][0] == State.ENABLED
    assert bound.command["i_A"].any()


def test_a_field_that_nobody_fills_is_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    """In place of what the tick had that was in the slot before."""
    bench = Bench()
    arrays = [*bench.tables, bench.memory, bench.feedback, bench.setpoint, bench.command]
    arrays += [bench.ring, bench.timing.record]
    monkeypatch.setattr(kernel, "step", lambda *_arguments: None)
    monkeypatch.setattr(
        tick_kernel,
        "records_at",
        lambda _frame, place, count, dtype: arrays[place].reshape(-1).view(dtype)[:count],
    )
    bench.ring.view(np.uint8)[:] = 0xFF
    getattr(run_tick, "py_func", run_tick)(0, 1, 3, 2, 0, 40, 9_000)
    filled = {"tick": 3, "missed": 2, "wake_late_ns": 40, "work_ns": 9_000}
    for name in TICK_DTYPE.names or ():
        assert bench.ring[1][name] == filled.get(name, 0), name
    assert bench.ring[0].tobytes() == bench.ring[2].tobytes() == b"\xff" * TICK_DTYPE.itemsize


@pytest.mark.kernel
def test_counts_the_times_of_every_tick() -> None:
    bench = Bench()
    bench.step(0)
    run_tick(bench.kernel.frame, 0, 0, 0, 0, 40, NO_WORK)
    run_tick(bench.kernel.frame, 1, 3, 2, 0, 70_000, 9_000)
    assert bench.ring["work_ns"].tolist() == [0, 9_000, 0, 0]
    kept = bench.timing.summary()
    assert kept.missed == 2
    assert (kept.wake_late.samples, kept.wake_late.max_us) == (2, 70.0)
    assert (kept.work.samples, kept.work.max_us) == (1, 9.0)


def test_other_tables_from_the_next_tick_on() -> None:
    bench = Bench()
    other = TableSet(*parameters.build(config.load()))
    other.parameters["torque_limit_Nm"] = 0.25
    bench.kernel.use(other)
    for n in range(3000):
        bench.step(n)
        run_tick(bench.kernel.frame, 0, n, 0, 0, 0, 0)
    assert bench.memory["torque_set_Nm"][0] == 0.25
    with pytest.raises(ValueError, match="argument 1"):
        bench.kernel.use(other._replace(back_emf_V_s_per_rad=np.zeros((8, 3))))
