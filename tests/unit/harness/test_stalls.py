"""What is forgiven to a computer that stalled, and what is not."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.support import stalls
from tests.support.ports import free_port
from tests.support.stalls import Stalls, forgive
from tests.system.daemons import leave_at_rest


@pytest.fixture(autouse=True)
def nothing_forgiven(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep what happens here out of the account of the whole run."""
    monkeypatch.setattr(stalls, "FORGIVEN", [])


def stalled(seconds: float, monkeypatch: pytest.MonkeyPatch) -> Stalls:
    """Return stalls of a loop at 500 Hz, since which a thread has waited for `seconds`."""
    monkeypatch.setattr(stalls, "stolen_s", lambda: 0.0)
    monkeypatch.setattr(stalls, "waited_s", lambda: {"/proc/1/task/1/schedstat": 5.0})
    kept = Stalls(100, 500.0, 0.0, stalls.waited_s(), 0.0)
    monkeypatch.setattr(stalls, "waited_s", lambda: {"/proc/1/task/1/schedstat": 5.0 + seconds})
    return kept


@pytest.mark.parametrize("cause", ["ENCODER_STALE", "INVERTER_STALE", "LOOP_OVERRUN", "timeout"])
def test_staleness_is_forgiven_with_proof_and_counted(
    cause: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = stalled(1.01, monkeypatch)
    forgive("a test", cause, kept, limit_s=1.0, missed=100)
    assert [f"a test: {cause}; kept from running for 1.01 s"] == stalls.FORGIVEN


@pytest.mark.parametrize(
    ("state", "first_trip", "left"),
    [("OFF", "", True), ("TRIPPED", "SUPERVISOR_STALE", True), ("TRIPPED", "OVER_SPEED", False)],
)
def test_a_test_may_leave_no_trip_that_a_stall_cannot_explain(
    state: str, first_trip: str, left: bool
) -> None:
    lease = SimpleNamespace(holder=None)
    view = SimpleNamespace(lease=lease, state=state, first_trip=first_trip, trips=[first_trip])
    states = contextlib.nullcontext(SimpleNamespace(get=lambda _timeout_s: view))
    client = SimpleNamespace(rpc=lambda *_, **__: None, subscribe_state=lambda: states)
    with contextlib.nullcontext() if left else pytest.raises(AssertionError, match="OVER_SPEED"):
        leave_at_rest(client)


def test_a_stall_that_had_begun_before_counts_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = stalled(0.52, monkeypatch)
    kept.age_s = 0.5
    forgive("a test", "ENCODER_STALE", kept, limit_s=1.0, missed=100)
    kept.age_s = 0.4
    with pytest.raises(AssertionError, match="no stall of 1 s explains it"):
        forgive("a test", "ENCODER_STALE", kept, limit_s=1.0, missed=100)


def test_the_age_of_the_oldest_signal_is_that_of_a_stall_that_goes_on() -> None:
    ages = {"tick": 0.01, "encoder": 0.02, "inverter": 0.4, "brake": 3.0}
    state = SimpleNamespace(ages=ages, loop=SimpleNamespace(missed=7, rate_Hz=500.0))
    assert stalls.of_bench(state).age_s == 0.4
    assert not stalls.is_fresh(state)
    ages["inverter"] = 0.03
    assert stalls.is_fresh(state)


def test_missed_ticks_are_a_stall_too(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = stalled(0.0, monkeypatch)
    forgive("a test", "ENCODER_STALE", kept, limit_s=1.0, missed=600)
    with pytest.raises(AssertionError, match="no stall of 1 s explains it"):
        forgive("a test", "ENCODER_STALE", kept, limit_s=1.0, missed=590)


def test_staleness_without_proof_is_not_forgiven(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = stalled(0.99, monkeypatch)
    with pytest.raises(AssertionError, match="no stall of 1 s explains it"):
        forgive("a test", "ENCODER_STALE", kept, limit_s=1.0, missed=100)
    assert stalls.FORGIVEN == []


@pytest.mark.parametrize("cause", ["OVER_SPEED", "TORQUE_IMPLAUSIBLE", "SIGKILL", "refused", ""])
def test_no_stall_excuses_anything_else(cause: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(AssertionError, match="no trip that a busy computer explains"):
        forgive("a test", cause, stalled(100.0, monkeypatch), limit_s=1.0, missed=10_000)


def test_an_open_line_is_forgiven_only_to_a_loop_that_missed_so_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kept = stalled(100.0, monkeypatch)
    with pytest.raises(AssertionError, match="no stall of 1 s explains it"):
        forgive("a test", "INVERTER_FAULT", kept, limit_s=1.0, missed=590)
    forgive("a test", "INVERTER_FAULT", kept, limit_s=1.0, missed=600)
    assert len(stalls.FORGIVEN) == 1


def test_this_computer_reports_how_long_a_process_waited() -> None:
    assert max(stalls.waited_s().values()) > 0.0
    assert stalls.runs(1) > 0


SPINS = "print(flush=True)\nwhile True: pass"


def test_who_is_ready_is_waited_for_until_each_has_been_run() -> None:
    """Three that want one processor; one of them may have another to itself and never stop."""
    cpu = min(os.sched_getaffinity(0))
    pinned = ("taskset", "-c", str(cpu), sys.executable, "-c", SPINS)
    with contextlib.ExitStack() as stack:
        spinning = [subprocess.Popen(pinned, stdout=subprocess.PIPE) for _ in range(3)]
        for process in spinning:
            stack.callback(process.wait)
            stack.callback(process.kill)
            assert process.stdout is not None
            stack.callback(process.stdout.close)
            process.stdout.readline()
        before = [ran_ns(process.pid) for process in spinning]
        ready = stalls.wait_for_ready()
        after = [ran_ns(process.pid) for process in spinning]
    assert {f"/proc/{process.pid}/task/{process.pid}" for process in spinning} <= set(ready)
    assert all(now > then for now, then in zip(after, before, strict=True))


def ran_ns(pid: int) -> int:
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0])


def test_a_wait_that_goes_on_counts_for_what_it_has_lasted(monkeypatch: pytest.MonkeyPatch) -> None:
    """It began 0.7 s before, and ends 5 s later."""
    now_s, waits = 100.0, {"/proc/1/task/1/schedstat": 5.0, "/proc/2/task/2/schedstat": 1.0}
    clock = SimpleNamespace(monotonic=lambda: now_s)
    monkeypatch.setattr(stalls, "time", clock)
    monkeypatch.setattr(stalls, "stolen_s", lambda: 0.0)
    monkeypatch.setattr(stalls, "waited_s", lambda: dict(waits))
    kept = Stalls(100, 500.0, 0.0, stalls.waited_s(), 0.0)

    def ended() -> list[str]:
        nonlocal now_s
        now_s += 5.0
        waits["/proc/1/task/1/schedstat"] += 0.7 + 5.0
        waits["/proc/2/task/2/schedstat"] += 3.0  # not ready then: a wait since
        return ["/proc/1/task/1"]

    monkeypatch.setattr(stalls, "wait_for_ready", ended)
    kept.settle()
    assert kept.lasted_s(100) == pytest.approx(0.7)


def test_clocks_of_a_test_do_not_reach_who_looks_whether_this_process_stands_still(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its thread lives on in the tests that come after one with stalls."""
    stalls.STOOD.begin()
    looking = stalls.STOOD._thread
    assert looking is not None
    monkeypatch.setattr(stalls, "time", SimpleNamespace())
    looking.join(3 * stalls.LOOK_S)
    assert looking.is_alive()


def test_no_port_is_given_twice() -> None:
    """Not even to a process that begins to look at the same place."""
    mine = [free_port() for _ in range(50)]
    script = "from tests.support.ports import free_port; print([free_port() for _ in range(50)])"
    output = subprocess.run(
        [sys.executable, "-c", f"import os; os.getpid = lambda: {os.getpid()}; {script}"],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    theirs = [int(port) for port in output.strip("[]\n").split(",")]
    assert len({*mine, *theirs}) == 100


def test_a_board_that_is_a_process_may_have_waited_itself(monkeypatch):
    kept = stalled(0.9, monkeypatch)
    with pytest.raises(AssertionError, match="no stall of 1 s"):
        forgive("a test", "INVERTER_FAULT", kept, limit_s=1.0, board_is_a_process=True)
    kept = stalled(1.1, monkeypatch)
    forgive("a test", "INVERTER_FAULT", kept, limit_s=1.0, board_is_a_process=True)
    with pytest.raises(AssertionError, match="no stall of 1 s"):
        forgive("a test", "INVERTER_FAULT", kept, limit_s=1.0)


def test_a_rotor_that_waited_is_not_where_its_speed_would_have_taken_it(monkeypatch):
    kept = stalled(0.29, monkeypatch)
    with pytest.raises(AssertionError, match=r"no stall of 0\.3 s"):
        forgive("a test", "ENCODER_IMPLAUSIBLE", kept, limit_s=1.0)
    forgive("a test", "ENCODER_IMPLAUSIBLE", kept, limit_s=1.0, missed=106)
    assert len(stalls.FORGIVEN) == 1


def test_what_goes_through_several_processes_waits_for_each(monkeypatch):
    names = [f"/proc/{pid}/task/{pid}/schedstat" for pid in (1, 2)]
    monkeypatch.setattr(stalls, "stolen_s", lambda: 0.0)
    monkeypatch.setattr(stalls, "waited_s", lambda: dict.fromkeys(names, 5.0))
    kept = Stalls(100, 500.0, 0.0, stalls.waited_s(), 0.0)
    monkeypatch.setattr(stalls, "waited_s", lambda: dict.fromkeys(names, 5.6))
    with pytest.raises(AssertionError, match="no stall of 1 s"):
        forgive("a test", "ENCODER_STALE", kept, limit_s=1.0)
    forgive("a test", "ENCODER_STALE", kept, limit_s=1.0, board_is_a_process=True)
    [line] = stalls.FORGIVEN
    assert line.endswith("one after the other for 1.20 s")
