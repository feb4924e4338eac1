"""The compiled tick does what the control kernel does, and the bookkeeping around it."""

import numpy as np
import pytest

from motord import config
from motord.control import parameters
from motord.control import step as kernel
from motord.control.types import COMMAND, FEEDBACK, SETPOINT
from motord.loop.tick_kernel import NO_WORK, Beat, beat
from motord.schema import TICK_DTYPE, BridgeStatus, InverterStatus, Request, State
from motord.shm.tables import TableSet
from motord.shm.timing import Timing


class Bench:
    """Records of a healthy rig that turns, told to apply torque."""

    def __init__(self) -> None:
        self.tables = TableSet(*parameters.build(config.load()))
        self.timing = Timing()
        self.memory = kernel.new_memory()
        self.feedback, self.setpoint = np.zeros(1, FEEDBACK), np.zeros(1, SETPOINT)
        self.command, self.ring = np.zeros(1, COMMAND), np.zeros(4, TICK_DTYPE)
        self.setpoint[0].request = Request.ENABLE
        self.setpoint[0].torque_Nm = 2.0
        self.beat = Beat(
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
        beat(bound.beat.frame, slot, n, n // 10, 1, 30 + n, 5_000 + n)
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


@pytest.mark.kernel
def test_counts_the_times_of_every_tick() -> None:
    bench = Bench()
    bench.step(0)
    beat(bench.beat.frame, 0, 0, 0, 0, 40, NO_WORK)
    beat(bench.beat.frame, 1, 3, 2, 0, 70_000, 9_000)
    assert bench.ring["work_ns"].tolist() == [0, 9_000, 0, 0]
    kept = bench.timing.summary()
    assert kept.missed == 2
    assert (kept.wake_late.samples, kept.wake_late.max_us) == (2, 70.0)
    assert (kept.work.samples, kept.work.max_us) == (1, 9.0)


def test_other_tables_from_the_next_tick_on() -> None:
    bench = Bench()
    other = TableSet(*parameters.build(config.load()))
    other.parameters["torque_limit_Nm"] = 0.25
    bench.beat.use(other)
    for n in range(3000):
        bench.step(n)
        beat(bench.beat.frame, 0, n, 0, 0, 0, 0)
    assert bench.memory["torque_set_Nm"][0] == 0.25
    with pytest.raises(ValueError, match="argument 1"):
        bench.beat.use(other._replace(back_emf_V_s_per_rad=np.zeros((8, 3))))
