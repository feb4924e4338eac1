"""What of this machine stands in the way of real time, and how to change it.

Rights are asked for (`runtime.realtime`); here is what a process can only read: kernel, limits of
real-time scheduling, processor frequency and sleep, interrupts, clock. Each finding names the file
that it was read from, so that an operator can look again after a change.
"""

import re
from collections.abc import Callable

from pydantic import BaseModel

from motord.loop.rt_setup import Host, preemption

SLEEP_LATENCY_MAX_US = 20
"""Longest wake-up of a sleep state that a loop of some kHz hardly notices."""

GOOD_CLOCKS = ("tsc", "arch_sys_counter")
"""Clocks that are read in tens of nanoseconds, without a call of the kernel."""


class RtFinding(BaseModel, frozen=True):
    """One thing looked at: what was found, whether it is as a loop wants it, and what to do."""

    name: str
    found: str
    good: bool
    how: str = ""

    def line(self) -> str:
        """Return it as one line for people."""
        return f"{self.name}: {self.found}" + (f"; {self.how}" if not self.good else "")


def findings(cpu: int | None, host: Host | None = None) -> list[RtFinding]:
    """Return what was found for a loop on `cpu`, None for any."""
    host = host or Host()
    looks: list[Callable[[Host, int | None], RtFinding | None]] = [
        _kernel, _throttling, _group, _isolation, _frequency, _sleep, _interrupts, _clock, _swap,
    ]  # fmt: skip
    return [found for look in looks if (found := look(host, cpu)) is not None]


def _finding(name: str, found: str, good: bool, how: str) -> RtFinding:
    return RtFinding(name=name, found=found, good=good, how="" if good else how)


def _kernel(host: Host, cpu: int | None) -> RtFinding:
    model = preemption(host.text("sys/kernel/realtime"), host.text("proc/version"))
    how = "install a PREEMPT_RT kernel (Debian: linux-image-rt-amd64) for the shortest worst case"
    release = host.text("proc/sys/kernel/osrelease")
    return _finding("kernel", f"{release}, {model}", model == "PREEMPT_RT", how)


def _throttling(host: Host, cpu: int | None) -> RtFinding | None:
    runtime_us = host.number("proc/sys/kernel/sched_rt_runtime_us")
    period_us = host.number("proc/sys/kernel/sched_rt_period_us")
    if runtime_us is None or period_us is None:
        return None
    if runtime_us < 0:
        return _finding("real-time limit", "none", True, "")
    share = runtime_us / period_us
    how = "sysctl kernel.sched_rt_runtime_us=950000; below that the loop spins less and skips ticks"
    return _finding("real-time limit", f"{100 * share:.0f} % of a core", share >= 0.9, how)


def _group(host: Host, cpu: int | None) -> RtFinding | None:
    """Look whether the control group has real-time bandwidth (CONFIG_RT_GROUP_SCHED)."""
    for line in host.text("proc/self/cgroup").splitlines():
        _, controllers, path = line.split(":", 2)
        if "cpu" in controllers.split(","):
            file = f"sys/fs/cgroup/cpu{path.rstrip('/')}/cpu.rt_runtime_us"
            budget_us = host.number(file)
            if budget_us is not None:
                how = f"write 950000 to /{file} and to that of each group above it"
                return _finding("control group", f"{budget_us} us", budget_us != 0, how)
    return None


def _isolation(host: Host, cpu: int | None) -> RtFinding:
    isolated = host.text("sys/devices/system/cpu/isolated")
    if cpu is not None and cpu in _cpus(isolated):
        return _finding("isolated CPUs", isolated, True, "")
    number = cpu if cpu is not None else "N"
    how = f"boot with isolcpus={number} nohz_full={number}" + (
        "" if cpu is not None else " and set [loop] cpu = N"
    )
    return _finding("isolated CPUs", isolated or "none", False, how)


def _frequency(host: Host, cpu: int | None) -> RtFinding | None:
    folder = "sys/devices/system/cpu"
    which = "cpu[0-9]*" if cpu is None else f"cpu{cpu}"
    files = host.under(folder, f"{which}/cpufreq/scaling_governor")
    governors = sorted({host.text(str(file)) for file in files})
    if not governors:
        return None
    how = "cpupower frequency-set -g performance: a core that speeds up only under load is late"
    return _finding("CPU frequency", ", ".join(governors), governors == ["performance"], how)


def _sleep(host: Host, cpu: int | None) -> RtFinding | None:
    folder = f"sys/devices/system/cpu/cpu{cpu or 0}/cpuidle"
    states = [
        (host.number(str(file)) or 0, host.text(str(file.parent / "name")))
        for file in host.under(folder, "state[0-9]*/latency")
        if host.text(str(file.parent / "disable")) != "1"
    ]
    if not states:
        return None
    latency_us, name = max(states)
    how = (
        "the loop keeps it out of there through /dev/cpu_dma_latency if it may write to that; "
        "else boot with processor.max_cstate=1"
    )
    found = f"down to {name}, {latency_us} us to wake up"
    return _finding("CPU sleep states", found, latency_us <= SLEEP_LATENCY_MAX_US, how)


def _interrupts(host: Host, cpu: int | None) -> RtFinding | None:
    if cpu is None:
        return None
    files = host.under("proc/irq", "*/smp_affinity_list")
    here = [file.parent.name for file in files if cpu in _cpus(host.text(str(file)))]
    how = (
        f"boot with irqaffinity= of the other CPUs, or write them to /proc/irq/N/smp_affinity_list "
        f"of: {', '.join(sorted(here, key=int))}; and stop irqbalance"
    )
    return _finding(f"interrupts on CPU {cpu}", f"{len(here)} of {len(files)}", not here, how)


def _clock(host: Host, cpu: int | None) -> RtFinding | None:
    source = host.text("sys/devices/system/clocksource/clocksource0/current_clocksource")
    if not source:
        return None
    how = "boot with clocksource=tsc tsc=reliable if the processor's counter is stable"
    good = source in GOOD_CLOCKS or source.startswith("kvm")
    return _finding("clock", source, good, how)


def _swap(host: Host, cpu: int | None) -> RtFinding | None:
    found = re.search(r"^SwapTotal:\s+(\d+) kB", host.text("proc/meminfo"), re.MULTILINE)
    if not found:
        return None
    megabytes = int(found.group(1)) // 1024
    how = "fine with locked memory; without, swapoff -a while the bench runs"
    return _finding("swap", f"{megabytes} MB" if megabytes else "none", megabytes == 0, how)


def _cpus(text: str) -> set[int]:
    """Return the CPUs of a list such as 0-2,5."""
    cpus: set[int] = set()
    for part in text.split(","):
        first, _, last = part.partition("-")
        if first.isdigit():
            cpus.update(range(int(first), int(last or first) + 1))
    return cpus
