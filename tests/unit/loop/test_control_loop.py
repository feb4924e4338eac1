"""The loop body with the real kernel, a scripted rig and a fake clock."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest

from motord import config
from motord.control import parameters
from motord.loop.control_loop import SUPERVISOR_GONE_S, ControlLoop, StopRequest, run
from motord.loop.pacer import Pacer
from motord.schema import Flag, Request, State
from motord.shm.mailbox import MailboxReader
from motord.shm.ring import RingReader, RingWriter
from motord.shm.run_directory import RunDir
from motord.shm.tables import TablesReader
from tests.unit.loop.bench import ScriptedRig, Supervisor, write_bench

PERIOD_NS = 1_000_000


class Loop:
    """A loop whose time passes only by waiting and by `stall_ns`."""

    def __init__(self, folder: Path) -> None:
        self.config_path = write_bench(folder)
        run_dir = RunDir("fake", folder / "run")
        self.supervisor = Supervisor(run_dir, self.config_path)
        self.stop = StopRequest()
        self.rig = ScriptedRig()
        self.loop = ControlLoop(
            self.rig,
            RingWriter(run_dir.ring, 16384),
            MailboxReader(run_dir.setpoint),
            TablesReader(run_dir.tables),
            self.stop,
        )
        self.reader = RingReader(run_dir.ring)
        self.now_ns = time.monotonic_ns()
        self.pacer = Pacer(PERIOD_NS, self)
        self.loop.warm_up_kernel()

    budget_exceeded = False

    def start(self) -> None:
        """Nothing to note."""

    def clock_ns(self) -> int:
        return self.now_ns

    def wait_until(self, deadline_ns: int) -> int:
        self.now_ns = max(deadline_ns, self.now_ns)
        return self.now_ns

    def run(self, ticks: int, script: dict[int, object] | None = None) -> np.ndarray:
        """Run; `script` maps a tick's number to what is called in it."""

        def on_read(reads: int) -> None:
            action = (script or {}).get(reads)
            if callable(action):
                action()
            if reads == ticks - 1:
                self.stop.reason = "enough"

        self.rig.on_read = on_read
        run(self.loop, self.pacer)
        block, lost = self.reader.read()
        assert lost == 0
        return block


@pytest.fixture
def loop(tmp_path: Path) -> Loop:
    return Loop(tmp_path)


def test_every_tick_is_published_once_with_its_time(loop: Loop) -> None:
    block = loop.run(200)
    assert block["tick"].tolist() == list(range(200))
    assert (np.diff(block["t_ns"]) == PERIOD_NS).all()
    assert block["t_ns"][0] == loop.now_ns - 199 * PERIOD_NS + loop.supervisor.clock.offset_ns
    assert (block["missed"] == 0).all()
    assert (block["state"] == State.OFF).all()
    assert loop.rig.reads == len(loop.rig.commands) == 200
    assert loop.stop.reason == "enough"


def test_stalls_are_skipped_counted_and_flagged(loop: Loop) -> None:
    def stall() -> None:
        loop.now_ns += 7 * PERIOD_NS + 700_000

    block = loop.run(50, {10: stall, 30: stall})
    gaps = np.diff(block["tick"].astype(np.int64), prepend=-1) - 1
    assert block["missed"].tolist() == np.cumsum(gaps).tolist()
    assert block["missed"][-1] == 14
    after_gap = (block["flags"] & Flag.AFTER_GAP) != 0
    assert np.flatnonzero(after_gap).tolist() == [11, 31]
    assert np.flatnonzero(gaps).tolist() == [11, 31]


def test_setpoint_reaches_the_kernel(loop: Loop) -> None:
    script = {
        20: lambda: loop.supervisor.ask(Request.ENABLE),
        50: lambda: loop.supervisor.ask(torque_Nm=2.0),
    }
    block = loop.run(150, script)
    assert (block["state"][:20] == State.OFF).all()
    assert (block["state"][25:] == State.ENABLED).all()
    assert block["setpoint_seq"][[19, 49, 50]].tolist() == [0, 1, 2]
    assert block["torque_set_Nm"][49] == 0
    assert 0.9 < block["torque_set_Nm"][-1] < 1.1
    sent = np.concatenate(loop.rig.commands)
    assert (sent["i_A"][:, 0] == block["i_cmd_a_A"]).all()
    assert np.abs(sent["i_A"]).max() > 1


def test_tables_are_swapped_between_ticks(loop: Loop) -> None:
    table = parameters.build(config.load(loop.config_path))
    table[0]["torque_rate_Nm_per_s"] = 1000.0
    loop.run(5, {2: lambda: loop.supervisor.tables.write(*table)})
    assert loop.supervisor.tables.in_use == 2
    assert loop.loop.tables.current.parameters["torque_rate_Nm_per_s"][0] == 1000.0


def test_loop_ends_when_the_supervisor_is_gone(loop: Loop) -> None:
    block = loop.run(20_000)
    assert loop.stop.reason == "the supervisor is gone"
    lasted_s = len(block) * PERIOD_NS * 1e-9
    assert SUPERVISOR_GONE_S < lasted_s < SUPERVISOR_GONE_S + 0.2


def test_loop_stays_while_there_is_torque(loop: Loop) -> None:
    loop.run(1)
    loop.loop.memory["state"] = State.ENABLED
    assert not loop.loop.end_reason(2**62)
    loop.loop.memory["state"] = State.TRIPPED
    assert loop.loop.end_reason(2**62) == "the supervisor is gone"


def test_loop_ends_with_what_the_rig_refuses_when_there_is_no_torque(loop: Loop) -> None:
    """`motord reset` starts it again, which takes the board that answers then."""
    loop.run(1)
    assert not loop.loop.end_reason(loop.now_ns)
    loop.rig.refused = "bridge: it has serial number 9"
    loop.loop.memory["state"] = State.ENABLED
    assert not loop.loop.end_reason(loop.now_ns)
    loop.loop.memory["state"] = State.TRIPPED
    assert loop.loop.end_reason(loop.now_ns) == loop.rig.refused


def test_work_is_in_the_tick_after_and_in_the_histogram(loop: Loop) -> None:
    block = loop.run(100, {50: lambda: setattr(loop, "now_ns", loop.now_ns + 400_000)})
    assert np.flatnonzero(block["work_ns"]).tolist() == [51]
    assert block["work_ns"][51] == 400_000
    assert loop.loop.timing.wake_late.summary().samples == 100
    assert loop.loop.timing.work.summary().samples == 100
    assert loop.loop.timing.work.max_ns == 400_000


def test_reason_to_stop_before_the_first_tick(loop: Loop) -> None:
    loop.stop.reason = "SIGTERM"
    run(loop.loop, loop.pacer)
    assert loop.rig.reads == 0


def test_loop_allocates_nothing_that_stays(loop: Loop) -> None:
    """The number of live memory blocks is the same after 2000 ticks as after 3000."""
    loop.rig.write = lambda _command: None
    blocks: list[int] = []
    script = {n: lambda: blocks.append(sys.getallocatedblocks()) for n in (1000, 2000, 3000)}
    loop.run(3100, script)
    assert abs(blocks[2] - blocks[1]) < 50
