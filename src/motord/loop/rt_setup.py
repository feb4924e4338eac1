"""Real-time rights of the loop process: all that can be had, and a loud account of the rest.

`apply` changes the calling process for the rest of its life; `probe` asks in a process of its own
and leaves nothing behind. docs/realtime.md says how a system grants each right.
"""

import ctypes
import gc
import os
import platform
import resource
import subprocess
import sys
from pathlib import Path

from pydantic import BaseModel

from motord.config import LoopConfig
from motord.process.module_command import module_command

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_PR_SET_TIMERSLACK, _PR_GET_TIMERSLACK = 29, 30
_M_TRIM_THRESHOLD, _M_MMAP_MAX = -1, -4
_CAP_IPC_LOCK = 14

_libc = ctypes.CDLL(None, use_errno=True)


class RealtimeItem(BaseModel, frozen=True):
    """One right: what was wanted, what was got, and if not the same, why not and how to get it."""

    name: str
    wanted: str
    got: str
    granted: bool
    why: str = ""
    how: str = ""

    def line(self) -> str:
        """Return the item as one line for people."""
        if self.granted:
            return f"{self.name}: {self.got}"
        return f"{self.name}: wanted {self.wanted}, got {self.got} ({self.why}); {self.how}"


def _all_of(name: str, wanted: str, got: str = "") -> RealtimeItem:
    return RealtimeItem(name=name, wanted=wanted, got=got or wanted, granted=True)


def _less(name: str, wanted: str, got: str, why: str, how: str) -> RealtimeItem:
    return RealtimeItem(name=name, wanted=wanted, got=got, granted=False, why=why, how=how)


def stop_garbage_collector() -> RealtimeItem:
    """Collect once, keep what is left out of all later collections, and switch these off."""
    gc.collect()
    gc.freeze()
    gc.disable()
    return _all_of("garbage collector", "off")


def set_timer_slack() -> RealtimeItem:
    """Let timers fire on time even without real-time priority (the default is 50 us late)."""
    _libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1), 0, 0, 0)
    slack_ns = _libc.prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0)
    wanted = "at most 1 ns"
    if 0 <= slack_ns <= 1:
        return _all_of("timer slack", wanted)
    why = "the kernel refused prctl(PR_SET_TIMERSLACK)"
    return _less("timer slack", wanted, f"{slack_ns} ns", why, "allow prctl in the unit's filter")


def lock_memory() -> RealtimeItem:
    """Lock all memory, and later mappings too unless a limit would then make them fail.

    Freed memory is kept by the process, so that the loop does not fault it in again.
    """
    _libc.mallopt(_M_TRIM_THRESHOLD, -1)
    _libc.mallopt(_M_MMAP_MAX, 0)
    _, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (hard, hard))
    no_limit = hard == resource.RLIM_INFINITY
    limit = "no limit" if no_limit else f"limit {hard // 1024} KiB"
    unlimited = no_limit or has_capability(_CAP_IPC_LOCK)
    wanted = "all memory, now and later"
    how = "LimitMEMLOCK=infinity in the unit, or `memlock unlimited` in /etc/security/limits.d"
    if _libc.mlockall(_MCL_CURRENT | (_MCL_FUTURE if unlimited else 0)) != 0:
        why = f"{os.strerror(ctypes.get_errno())}, {limit}"
        return _less("memory lock", wanted, "nothing", why, how)
    if not unlimited:
        return _less("memory lock", wanted, "the memory of now", limit, how)
    return _all_of("memory lock", wanted)


def keep_cpu_awake(device: Path = Path("/dev/cpu_dma_latency")) -> RealtimeItem:
    """Ask for no sleep states with a wake-up latency, for as long as the process lives."""
    wanted = "no sleep states with a wake-up latency"
    try:
        descriptor = os.open(device, os.O_WRONLY)  # left open: closing it withdraws the request
        os.write(descriptor, (0).to_bytes(4, sys.byteorder))
    except FileNotFoundError:
        return _all_of("CPU sleep", wanted, "not managed by this kernel")
    except OSError as error:
        why = f"{device}: {error.strerror}"
        how = f"let the user write to {device} (a udev rule), or boot with cpuidle.off=1"
        return _less("CPU sleep", wanted, "any sleep state", why, how)
    return _all_of("CPU sleep", wanted)


def pin(cpu: int | None) -> RealtimeItem:
    """Run on CPU `cpu` only; None leaves it to the kernel."""
    allowed = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
    if cpu is None:
        return _all_of("CPU", "any", f"any of {allowed}; set [loop] cpu to pin")
    try:
        os.sched_setaffinity(0, {cpu})
    except OSError as error:
        how = f"set [loop] cpu to one of {allowed}, or widen the cpuset of the service"
        return _less("CPU", f"CPU {cpu}", f"any of {allowed}", str(error.strerror), how)
    return _all_of("CPU", f"CPU {cpu}")


def schedule(priority: int) -> RealtimeItem:
    """Run as SCHED_FIFO at `priority`, or at the highest one allowed."""
    wanted = f"SCHED_FIFO {priority}"
    _, limit = resource.getrlimit(resource.RLIMIT_RTPRIO)
    resource.setrlimit(resource.RLIMIT_RTPRIO, (limit, limit))
    refusal = _refusal(priority)
    if not refusal:
        return _all_of("scheduler", wanted)
    how = f"LimitRTPRIO={priority} in the unit, or `rtprio {priority}` in /etc/security/limits.d"
    if 0 < limit < priority and not _refusal(limit):
        why = f"priority is limited to {limit}"
        return _less("scheduler", wanted, f"SCHED_FIFO {limit}", why, how)
    return _less("scheduler", wanted, "normal priority", refusal, how)


def _refusal(priority: int) -> str:
    """Run as SCHED_FIFO at `priority`; return why the kernel refuses that, "" if it does not."""
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    try:
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except OSError as error:
        return str(error.strerror)
    return ""


def has_capability(number: int, status: Path = Path("/proc/self/status")) -> bool:
    """Return whether the process has Linux capability `number` in effect."""
    effective = [r for r in status.read_text().splitlines() if r.startswith("CapEff:")]
    return bool(effective) and bool(int(effective[0].split()[1], 16) >> number & 1)


class Host:
    """The system files of a machine; `root` is another folder in tests."""

    def __init__(self, root: Path = Path("/")) -> None:
        self._root = root

    def text(self, path: str) -> str:
        """Return the content of a file without white space around it; "" if there is none."""
        try:
            return (self._root / path).read_text().strip()
        except OSError:
            return ""

    def number(self, path: str) -> int | None:
        """Return the number in a file, or None."""
        text = self.text(path)
        return int(text) if text.lstrip("-").isdigit() else None

    def under(self, folder: str, pattern: str) -> list[Path]:
        """Return the files under `folder` that fit, in order, from the root on."""
        found = sorted((self._root / folder).glob(pattern))
        return [path.relative_to(self._root) for path in found]


class RealtimeStatus(BaseModel, frozen=True):
    """All rights, and the system's kernel, preemption, real-time bandwidth and isolated CPUs."""

    items: list[RealtimeItem]
    kernel: str
    preemption: str
    rt_runtime_us: int | None
    rt_period_us: int | None
    isolated_cpus: str

    @property
    def granted(self) -> bool:
        """True if everything that was asked for was granted."""
        return all(item.granted for item in self.items)

    def lines(self) -> list[str]:
        """Return one line for each item."""
        return [item.line() for item in self.items]


def apply(loop: LoopConfig) -> RealtimeStatus:
    """Give the calling process the real-time rights of `[loop]`, each as far as granted.

    Call it when everything is loaded and compiled: it freezes the garbage collector and locks
    memory. The scheduler comes last, so that nothing before it runs with real-time priority.
    """
    items = [
        stop_garbage_collector(),
        set_timer_slack(),
        lock_memory(),
        keep_cpu_awake(),
        pin(loop.cpu),
        schedule(loop.priority),
    ]
    host = Host()
    return RealtimeStatus(
        items=items,
        kernel=f"{platform.system()} {platform.release()}",
        preemption=preemption(host.text("sys/kernel/realtime"), platform.version()),
        rt_runtime_us=host.number("proc/sys/kernel/sched_rt_runtime_us"),
        rt_period_us=host.number("proc/sys/kernel/sched_rt_period_us"),
        isolated_cpus=host.text("sys/devices/system/cpu/isolated"),
    )


def probe(loop: LoopConfig) -> RealtimeStatus:
    """Return what `apply` would be granted, asked in a short-lived process of its own."""
    answer = subprocess.run(
        module_command("motord.loop.rt_setup"),
        input=loop.model_dump_json(),
        capture_output=True,
        text=True,
        check=True,
    )
    return RealtimeStatus.model_validate_json(answer.stdout)


def preemption(realtime_flag: str, version: str) -> str:
    """Return the kernel's preemption model from /sys/kernel/realtime and `uname -v`."""
    if realtime_flag == "1":
        return "PREEMPT_RT"
    models = ("PREEMPT_RT", "PREEMPT_DYNAMIC", "PREEMPT")
    return next((model for model in models if model in version), "none")


def main() -> None:
    """Apply the rights of the `[loop]` given as JSON on stdin, print the status as JSON."""
    status = apply(LoopConfig.model_validate_json(sys.stdin.read()))
    sys.stdout.write(status.model_dump_json())


if __name__ == "__main__":
    main()
