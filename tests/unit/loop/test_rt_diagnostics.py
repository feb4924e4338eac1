from pathlib import Path

import pytest

from motord.loop.rt_diagnostics import Host, RtFinding, findings

CPU = "sys/devices/system/cpu"

GOOD = {
    "sys/kernel/realtime": "1",
    "proc/version": "Linux version 6.1.0-rt-amd64 #1 SMP PREEMPT_RT",
    "proc/sys/kernel/osrelease": "6.1.0-rt-amd64",
    "proc/sys/kernel/sched_rt_runtime_us": "950000",
    "proc/sys/kernel/sched_rt_period_us": "1000000",
    "proc/self/cgroup": "4:cpu,cpuacct:/system.slice\n0::/system.slice",
    "sys/fs/cgroup/cpu/system.slice/cpu.rt_runtime_us": "950000",
    f"{CPU}/isolated": "2-3",
    f"{CPU}/cpu3/cpufreq/scaling_governor": "performance",
    f"{CPU}/cpu3/cpuidle/state0/latency": "0",
    f"{CPU}/cpu3/cpuidle/state0/name": "POLL",
    f"{CPU}/cpu3/cpuidle/state1/latency": "2",
    f"{CPU}/cpu3/cpuidle/state1/name": "C1",
    f"{CPU}/cpu3/cpuidle/state2/latency": "133",
    f"{CPU}/cpu3/cpuidle/state2/name": "C6",
    f"{CPU}/cpu3/cpuidle/state2/disable": "1",
    "proc/irq/9/smp_affinity_list": "0-1",
    "proc/irq/40/smp_affinity_list": "0",
    "sys/devices/system/clocksource/clocksource0/current_clocksource": "tsc",
    "proc/meminfo": "MemTotal: 8 kB\nSwapTotal:       0 kB",
}


def machine(folder: Path, **changed: str) -> Host:
    for name, text in {**GOOD, **changed}.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text + "\n")
    return Host(folder)


def look(host: Host, cpu: int | None = 3) -> dict[str, RtFinding]:
    return {found.name: found for found in findings(cpu, host)}


def test_a_machine_made_for_it_has_nothing_to_change(tmp_path: Path) -> None:
    found = look(machine(tmp_path))
    assert len(found) == 9
    assert all(f.good and not f.how for f in found.values()), found
    assert found["CPU sleep states"].found == "down to C1, 2 us to wake up"


@pytest.mark.parametrize(
    ("file", "text", "name", "expected"),
    [
        ("sys/kernel/realtime", "0", "kernel", "PREEMPT_RT kernel"),
        ("proc/sys/kernel/sched_rt_runtime_us", "500000", "real-time limit", "sched_rt_runtime_us"),
        (
            "sys/fs/cgroup/cpu/system.slice/cpu.rt_runtime_us", "0", "control group",
            "/sys/fs/cgroup/cpu/system.slice/cpu.rt_runtime_us",
        ),
        (f"{CPU}/isolated", "1", "isolated CPUs", "isolcpus=3"),
        (f"{CPU}/cpu3/cpufreq/scaling_governor", "powersave", "CPU frequency", "performance"),
        (f"{CPU}/cpu3/cpuidle/state2/disable", "0", "CPU sleep states", "cpu_dma_latency"),
        ("proc/irq/40/smp_affinity_list", "0,2-3", "interrupts on CPU 3", "of: 40;"),
        (
            "sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet", "clock",
            "clocksource=tsc",
        ),
        ("proc/meminfo", "SwapTotal: 2097148 kB", "swap", "swapoff"),
    ],
)  # fmt: skip
def test_each_flaw_is_found_and_its_remedy_given(
    tmp_path: Path, file: str, text: str, name: str, expected: str
) -> None:
    changed = {file: text}
    if file == "sys/kernel/realtime":
        changed["proc/version"] = "Linux version 6.1 #1 SMP PREEMPT_DYNAMIC"
    found = look(machine(tmp_path, **changed))
    bad = [f.name for f in found.values() if not f.good]
    assert bad == [name]
    assert expected in found[name].how
    assert found[name].how in found[name].line()


def test_what_a_machine_does_not_have_is_left_out(tmp_path: Path) -> None:
    assert set(look(Host(tmp_path), None)) == {"kernel", "isolated CPUs"}


def test_without_a_cpu_of_its_own_the_cure_says_how_to_choose_one(tmp_path: Path) -> None:
    found = look(machine(tmp_path), None)
    assert "set [loop] cpu" in found["isolated CPUs"].how
    assert "interrupts on CPU 3" not in found


def test_this_machine_can_be_looked_at() -> None:
    assert findings(0)
