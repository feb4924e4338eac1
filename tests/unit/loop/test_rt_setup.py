"""Real-time rights: what this machine grants, and what is said when it refuses."""

import ctypes
import gc
import io
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from motord.config import LoopConfig
from motord.config.base import CPUS_MAX
from motord.loop import rt_setup
from motord.loop.rt_setup import RealtimeItem

NAMES = ["garbage collector", "timer slack", "memory lock", "CPU sleep", "CPU", "scheduler"]


def scheduling() -> tuple[int, set[int], bool, str]:
    status = Path("/proc/self/status").read_text()
    locked = next(r for r in status.splitlines() if r.startswith("VmLck"))
    return os.sched_getscheduler(0), os.sched_getaffinity(0), gc.isenabled(), locked


def test_probe_answers_for_this_machine_and_changes_nothing_here() -> None:
    before = scheduling()
    status = rt_setup.probe(LoopConfig(cpu=min(os.sched_getaffinity(0))))
    assert [item.name for item in status.items] == NAMES
    assert scheduling() == before
    for item in status.items:
        assert item.granted or (item.why and item.how and item.got != item.wanted)
    assert status.granted == all(item.granted for item in status.items)
    assert len(status.lines()) == len(NAMES)
    assert status.kernel.startswith("Linux ")


def test_absent_cpu_is_said_with_those_there_are() -> None:
    cpu = rt_setup.probe(LoopConfig(cpu=CPUS_MAX - 1)).items[NAMES.index("CPU")]
    assert not cpu.granted
    assert f"{min(os.sched_getaffinity(0))}" in cpu.how


UNPRIVILEGED = """
import os, resource
from motord.config import LoopConfig
from motord.config.base import CPUS_MAX
from motord.loop import rt_setup
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
print(rt_setup.apply(LoopConfig(priority=80)).model_dump_json())
print(os.sched_getscheduler(0))
"""


@pytest.mark.skipif(os.getuid() != 0, reason="needs root, to become a user with few rights")
def test_missing_rights_are_reported_to_the_user() -> None:
    command = [sys.executable, "-c", UNPRIVILEGED]
    answer = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    status_json, policy = answer.splitlines()
    status = rt_setup.RealtimeStatus.model_validate_json(status_json)
    items = {item.name: item for item in status.items}
    assert not status.granted
    assert items["scheduler"].got == "normal priority"
    assert "LimitRTPRIO=80" in items["scheduler"].how
    assert items["memory lock"].got == "nothing"
    assert "64 KiB" in items["memory lock"].why
    assert "LimitMEMLOCK=infinity" in items["memory lock"].how
    assert items["timer slack"].granted
    assert int(policy) == os.SCHED_OTHER


class FakeLibc:
    """Answers of the C library, set by the test."""

    def __init__(self, lock_error: int = 0, slack_ns: int = 1) -> None:
        self.lock_error, self.slack_ns = lock_error, slack_ns
        self.lock_flags = 0

    def prctl(self, option: int, *_arguments: object) -> int:
        return self.slack_ns if option == 30 else 0

    def mallopt(self, _option: int, _value: int) -> int:
        return 1

    def mlockall(self, flags: int) -> int:
        self.lock_flags = flags
        ctypes.set_errno(self.lock_error)
        return -1 if self.lock_error else 0


@pytest.fixture
def limits(monkeypatch: pytest.MonkeyPatch) -> dict[int, int]:
    hard = {resource.RLIMIT_MEMLOCK: 2**20, resource.RLIMIT_RTPRIO: 0}
    monkeypatch.setattr(resource, "getrlimit", lambda which: (0, hard[which]))
    monkeypatch.setattr(resource, "setrlimit", lambda _which, _limits: None)
    monkeypatch.setattr(rt_setup, "has_capability", lambda _number: False)
    return hard


def test_memory_lock(monkeypatch: pytest.MonkeyPatch, limits: dict[int, int]) -> None:
    libc = FakeLibc()
    monkeypatch.setattr(rt_setup, "_libc", libc)
    partly = rt_setup.lock_memory()
    assert (partly.granted, partly.why, libc.lock_flags) == (False, "limit 1024 KiB", 1)
    limits[resource.RLIMIT_MEMLOCK] = resource.RLIM_INFINITY
    assert rt_setup.lock_memory().granted
    assert libc.lock_flags == 3
    libc.lock_error = 12
    refused = rt_setup.lock_memory()
    assert (refused.granted, refused.got) == (False, "nothing")
    assert "memory, no limit" in refused.why


def test_timer_slack(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rt_setup, "_libc", FakeLibc())
    assert rt_setup.set_timer_slack().granted
    monkeypatch.setattr(rt_setup, "_libc", FakeLibc(slack_ns=50_000))
    assert rt_setup.set_timer_slack().got == "50000 ns"


def test_scheduler(monkeypatch: pytest.MonkeyPatch, limits: dict[int, int]) -> None:
    asked: list[int] = []

    def schedule(_process: int, _policy: int, parameters: os.sched_param) -> None:
        asked.append(parameters.sched_priority)
        if parameters.sched_priority > highest:
            raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", schedule)
    highest = 98
    assert rt_setup.schedule(80).granted
    highest = 0
    assert rt_setup.schedule(80).got == "normal priority"
    limits[resource.RLIMIT_RTPRIO] = highest = 20
    lower = rt_setup.schedule(80)
    assert (lower.got, lower.granted) == ("SCHED_FIFO 20", False)
    assert asked == [80, 80, 80, 20]
    highest = 0  # a control group without real-time bandwidth refuses whatever the limit grants
    assert rt_setup.schedule(80).got == "normal priority"


def test_pinning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _process: {2, 0})
    assert "0, 2" in rt_setup.pin(None).got

    def refuse(_process: int, _cpus: set[int]) -> None:
        raise OSError(22, "Invalid argument")

    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    refused = rt_setup.pin(1)
    assert (refused.granted, refused.why) == (False, "Invalid argument")
    monkeypatch.setattr(os, "sched_setaffinity", lambda _process, _cpus: None)
    assert rt_setup.pin(1).got == "CPU 1"


def test_cpu_sleep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device = tmp_path / "cpu_dma_latency"
    assert rt_setup.keep_cpu_awake(device).got == "not managed by this kernel"
    device.write_bytes(b"????")
    opened: list[int] = []
    real_open = os.open

    def remember(path: Path, flags: int) -> int:
        opened.append(real_open(path, flags))
        return opened[-1]

    monkeypatch.setattr(os, "open", remember)
    assert rt_setup.keep_cpu_awake(device).granted
    assert device.read_bytes() == bytes(4)
    os.close(opened[0])  # still open until here
    refused = rt_setup.keep_cpu_awake(tmp_path)
    assert not refused.granted
    assert str(tmp_path) in refused.why


def test_garbage_collector() -> None:
    try:
        assert rt_setup.stop_garbage_collector().granted
        assert not gc.isenabled()
    finally:
        gc.unfreeze()
        gc.enable()


def test_capabilities(tmp_path: Path) -> None:
    status = tmp_path / "status"
    status.write_text("CapPrm:\t0000000000004000\nCapEff:\t0000000000000400\n")
    assert rt_setup.has_capability(10, status)
    assert not rt_setup.has_capability(14, status)
    status.write_text("Name: x\n")
    assert not rt_setup.has_capability(10, status)


def test_a_refused_right_is_one_line() -> None:
    item = RealtimeItem(name="x", wanted="1", got="0", granted=False, why="no", how="ask")
    assert item.line() == "x: wanted 1, got 0 (no); ask"


@pytest.mark.parametrize(
    ("flag", "version", "model"),
    [
        ("1", "#1 SMP", "PREEMPT_RT"),
        ("", "#1 SMP PREEMPT_RT Debian", "PREEMPT_RT"),
        ("", "#1 SMP PREEMPT_DYNAMIC", "PREEMPT_DYNAMIC"),
        ("", "#1 SMP PREEMPT", "PREEMPT"),
        ("0", "#1 SMP", "none"),
    ],
)
def test_preemption(flag: str, version: str, model: str) -> None:
    assert rt_setup.preemption(flag, version) == model


def test_system_files(tmp_path: Path) -> None:
    (tmp_path / "n").write_text("-1\n")
    (tmp_path / "t").write_text("text\n")
    host = rt_setup.Host(tmp_path)
    assert host.number("n") == -1
    assert host.number("t") is None
    assert host.text("none") == ""


def test_apply_asks_for_everything_the_scheduler_last(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = []
    for name in (
        "stop_garbage_collector",
        "set_timer_slack",
        "lock_memory",
        "keep_cpu_awake",
        "pin",
        "schedule",
    ):

        def ask(*_arguments: object, name: str = name) -> RealtimeItem:
            asked.append(name)
            return RealtimeItem(name=name, wanted="", got="", granted=name != "pin")

        monkeypatch.setattr(rt_setup, name, ask)
    monkeypatch.setattr(sys, "stdin", io.StringIO(LoopConfig().model_dump_json()))
    rt_setup.main()
    status = rt_setup.RealtimeStatus.model_validate_json(capsys.readouterr().out)
    assert asked[-1] == "schedule"
    assert [item.name for item in status.items] == asked
    assert not status.granted
